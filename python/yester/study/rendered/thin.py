"""Sequences of things that are thinner than a pixel, or hardly thicker: wire, net, fur, pebbles, broad leaves.

In the first three, normals and ids change from pixel to pixel and from frame to frame, and tell a filter nothing. In
the others they change as much from pixel to pixel, but are found again, and tell how light falls. The rule by which
`SVGF` tells them apart was set on all but the net. It showed that even there, light that is divided by albedo must not
mix with light that is not.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from yester import Camera

from .build import Matrix, Sequence, animate, builder, copies, mitsuba, paint, picture, sky, tiles

__all__ = ["NAMES", "fence", "fur", "gravel", "hedge", "net"]

NAMES = ("fence", "net", "fur", "gravel", "hedge")

_FOV = 36


@builder
def fence(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A fence of crossed bars, half a pixel wide, before a painted wall.

    Only the camera moves.
    """
    return _crossed(paint([0.35, 0.36, 0.38]), frames, width, height)


@builder
def net(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A net of black rubber, its cords half a pixel wide, before a painted wall.

    Only the camera moves. The albedo of the cords, a two-thousandth, is too dark to be divided by.
    """
    rubber = {"type": "plastic", "diffuse_reflectance": {"type": "rgb", "value": [0.0005] * 3}}
    return _crossed(rubber, frames, width, height)


def _crossed(bsdf: dict[str, Any], frames: int, width: int, height: int) -> Sequence:
    """Crossed bars of a material before a painted wall."""
    mi = mitsuba()
    place = mi.ScalarTransform4f
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([0.5, 0.6, 0.5]))},
        "wall": {"type": "rectangle", "to_world": place().translate([0, 0, -2]).scale([4, 3, 1]), "bsdf": picture()},
        "ground": _ground(-1.2),
    }
    for i, x in enumerate(np.arange(-22, 23) * 0.09):
        for side, lean in (("left", -0.84), ("right", 0.84)):
            scene[f"bar{i}{side}"] = {
                "type": "cylinder",
                "p0": [x, -1.2, 0],
                "p1": [x + lean, 1.2, 0.024 * lean],
                "radius": 0.009,
                "bsdf": bsdf,
            }

    def view(t: float) -> Camera:
        return Camera.from_look_at([t - 0.5, 0.1, 2.4], [0.1, 0, -0.5], [0, 1, 0], 40, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def fur(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A ball of long hairs, a third of a pixel wide, under a lamp. All hairs are one shape.

    Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f
    rng = np.random.default_rng(5)
    count, radius = 6000, 0.55
    # A hair bends as it grows, and narrows to a point.
    rise = np.linspace(0, 1, 5)
    bend, half = 0.35 * rise**2, 0.014 * (1 - rise**2)
    hair = np.stack([np.concatenate([bend, bend]), np.tile(rise, 2), np.concatenate([-half, half])], -1)
    strips = [[i, i + 1, 5 + i] for i in range(4)] + [[i + 1, 6 + i, 5 + i] for i in range(4)]
    poses = _upright(rng, count)
    poses[:, :3, 3] = radius * poses[:, :3, 1]
    poses[:, :3, :3] *= rng.uniform(0.25, 0.45, (count, 1, 1))
    tints = rng.uniform(0.7, 1.2, (count, 1)) * [0.6, 0.42, 0.25]
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.15, 0.17, 0.2]}},
        "lamp": {
            "type": "rectangle",
            "to_world": place().look_at([1.5, 2.5, 1.5], [0, 0, 0], [0, 1, 0]).scale(0.5),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [22, 20, 17]}},
        },
        "ground": _ground(-0.8),
        "skin": {"type": "sphere", "radius": radius, "bsdf": paint([0.3, 0.2, 0.12])},
        "hairs": copies("hairs", hair, strips, poses, np.minimum(tints, 0.9)),
    }

    def view(t: float) -> Camera:
        return Camera.from_look_at([1.4 * t - 0.7, 0.5, 3.2], [0.1, 0, 0], [0, 1, 0], _FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def gravel(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A heap of pebbles of three to ten pixels under sun and sky, each a shape of its own.

    Only the camera moves.
    """
    mi = mitsuba()
    rng = np.random.default_rng(3)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([0.6, 0.55, 0.35]))},
        "ground": _ground(0),
    }
    for i in range(1600):
        stone = rng.uniform(0.15, 0.7) * np.array([1, 0.95, 0.85]) * rng.uniform(0.9, 1.1, 3)
        scene[f"pebble{i}"] = {
            "type": "sphere",
            "center": [rng.uniform(-1.6, 1.6), rng.uniform(0, 0.09), rng.uniform(-2.5, 1)],
            "radius": rng.uniform(0.035, 0.075),
            "bsdf": paint([float(v) for v in stone]),
        }

    def view(t: float) -> Camera:
        return Camera.from_look_at([0.8 * t - 0.4, 1.3, 2.6], [0, 0, -0.4], [0, 1, 0], 34, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def hedge(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A hedge of broad leaves of four to ten pixels before the wall of a house. All leaves are one shape.

    Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f
    rng = np.random.default_rng(11)
    count = 5200
    poses = _upright(rng, count)
    poses[:, :3, :3] *= rng.uniform(0.05, 0.12, (count, 1, 1))
    poses[:, :3, 3] = rng.uniform([-2, -0.8, -0.35], [2, 0.55, 0.35], (count, 3))
    leaf = np.array([[0, -1, 0], [0.55, -0.2, 0.1], [0, 1, 0], [-0.55, -0.2, 0.1]])
    tints = rng.uniform(0.5, 1.4, (count, 1)) * [0.12, 0.32, 0.07] + rng.uniform(0, 0.05, (count, 3))
    plaster = tiles([0.75, 0.68, 0.6], [0.55, 0.45, 0.38], 14)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([0.6, 0.55, 0.35]))},
        "leaves": copies("leaves", leaf, [[0, 1, 2], [0, 2, 3]], poses, np.minimum(tints, 0.9)),
        "wall": {"type": "rectangle", "to_world": place().translate([0, 0, -1.5]).scale([5, 3, 1]), "bsdf": plaster},
        "ground": _ground(-0.9),
    }

    def view(t: float) -> Camera:
        return Camera.from_look_at([1.2 * t - 0.6, 0.3, 3], [0, 0, 0], [0, 1, 0], _FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


def _ground(y: float) -> dict[str, Any]:
    """A tiled floor."""
    place = mitsuba().ScalarTransform4f
    pose = place().translate([0, y, 0]).rotate([1, 0, 0], -90).scale(8)
    return {"type": "rectangle", "to_world": pose, "bsdf": tiles([0.5, 0.46, 0.4], [0.3, 0.3, 0.29], 20)}


def _upright(rng: np.random.Generator, count: int) -> Matrix:
    """Rotations that take the y axis into random directions, (count, 4, 4)."""
    up, side = rng.normal(size=(2, count, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    across = np.cross(up, side)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    poses[:, :3, :3] = np.stack([across, up, np.cross(across, up)], -1)
    return poses
