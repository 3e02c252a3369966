"""Sequences that are unkind to denoisers, held out: brushed metal, a lens, mist, caustics, a passer-by, a cut.

Nothing may be tuned on these. `unkind` has those for tuning.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import Camera

from .build import (
    FOV,
    Exposure,
    Matrix,
    Sequence,
    animate,
    builder,
    expose,
    glaze,
    lathe,
    mitsuba,
    paint,
    picture,
    printed,
    rigid,
    rings,
    sheet,
    tiles,
    weave,
)

__all__ = ["NAMES", "brushed_metal", "caustics", "cut", "mist", "passer_by", "shallow_focus"]

#: Held out: these only tell what the tuning is worth.
NAMES = ("brushed_metal", "shallow_focus", "mist", "caustics", "passer_by", "cut")


@builder
def brushed_metal(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Brushed and hammered metal, with textures of anisotropic roughness and normal maps, circled by the camera.

    No buffer shows the roughness or the mapped normal: the shading has detail that no guide has. Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f

    def texture(pixels: NDArray[np.float32], repeat: float = 1) -> dict[str, Any]:
        to_uv = place().scale([repeat, repeat, 1])
        return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "to_uv": to_uv}

    y, x = (np.mgrid[:256, :256] + 0.5) / 256
    stripes = (0.5 + 0.5 * np.sin(12 * np.pi * x)).astype(np.float32)[..., None]
    swirl = (0.5 + 0.5 * np.sin(8 * np.pi * (x + y))).astype(np.float32)[..., None]
    brushed = {
        "type": "roughconductor",
        "material": "Al",
        "alpha_u": texture(0.04 + 0.4 * stripes),
        "alpha_v": texture(0.44 - 0.4 * stripes),
    }
    gold = {
        "type": "roughconductor",
        "material": "Au",
        "alpha_u": texture(0.05 + 0.3 * swirl),
        "alpha_v": texture(0.1 + 0.1 * swirl),
    }

    def hammered(nested: dict[str, Any], repeat: float, depth: float) -> dict[str, Any]:
        slope = depth * np.stack([np.cos(6 * np.pi * x) * np.sin(6 * np.pi * y), np.sin(6 * np.pi * x)], -1)
        normal = np.dstack([slope, np.ones_like(x)])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return {
            "type": "normalmap",
            "normalmap": texture((0.5 + 0.5 * normal).astype(np.float32), repeat),
            "bsdf": nested,
        }

    jar = lathe([[0.3, 0], [0.65, 0.15], [0.5, 0.7], [0.28, 1.1]], [-0.75, -1, -0.1])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.28, 0.33]}},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([-2, 3, 3], [0, -0.5, 0], [0, 1, 0]).scale(0.6),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [28.0, 26.0, 23.0]}},
        },
        "strip": {
            "type": "rectangle",
            "to_world": place().look_at([2.5, 1.2, 1], [0, -0.5, 0], [0, 1, 0]).scale([0.15, 1, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [8.0, 10.0, 14.0]}},
        },
        "table": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.25, 0.2, 0.16], [0.5, 0.44, 0.36], 12),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": hammered(glaze([0.3, 0.4, 0.45], 0.15), 4, 0.25),
        },
        "sheet": {
            "type": "cube",
            "to_world": place().translate([0.55, -0.35, -1]).rotate([1, 0, 0], -12).scale([0.75, 0.6, 0.03]),
            "bsdf": brushed,
        },
        "jar": sheet("jar", jar, hammered(gold, 3, 0.35)),
        "ball": {
            "type": "sphere",
            "to_world": place().translate([0.25, -0.68, 0.35]).scale(0.32),
            "bsdf": hammered(glaze([0.5, 0.06, 0.05], 0.06), 2, 0.5),
        },
        "disk": {
            "type": "cube",
            "to_world": place().translate([0.95, -0.8, 0.3]).rotate([0, 1, 0], 25).scale(0.2),
            "bsdf": brushed,
        },
    }

    def view(t: float) -> Camera:
        angle = np.radians(-8 + 16 * t)
        origin = [4.2 * np.sin(angle), 0.3, 4.2 * np.cos(angle)]
        return Camera.from_look_at(origin, [0, -0.4, 0], [0, 1, 0], 30, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def shallow_focus(frames: int = 24, width: int = 320, height: int = 240) -> Exposure:
    """Textured things before and behind the focus of a thin lens, with motion blur: guides are as noisy as light.

    Every sample has its own point on the lens and its own instant while the shutter is open, for half of each frame.
    Depth, normals, albedo and ids of neighbours out of focus or in motion are those of different surfaces. The moving
    shape is called `"cube"`.
    """
    place = mitsuba().ScalarTransform4f
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sensor": {"type": "thinlens", "aperture_radius": 0.06, "focus_distance": 4.2, "fov": 40},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.25, 0.27, 0.3]}},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([-2, 3.5, 3], [0, -0.5, 0], [0, 1, 0]).scale(0.7),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [24.0, 23.0, 21.0]}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(8),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 24),
        },
        "wall": {"type": "rectangle", "to_world": place().translate([0, 1, -4]).scale([4, 3, 1]), "bsdf": picture()},
        "cube": {
            "type": "cube",
            "to_world": place().scale(0.22),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "near post": {"type": "cylinder", "p0": [0.35, -1, 2.6], "p1": [0.35, 1, 2.6], "radius": 0.05},
    }
    scene["near post"]["bsdf"] = tiles([0.7, 0.15, 0.1], [0.85, 0.82, 0.75], 8)
    for i, (x, z) in enumerate([(-0.9, 0.2), (0.9, -0.1), (-0.3, -1.6), (1.3, -2.2), (-1.6, -2.6), (-0.75, 2.0)]):
        scene[f"ball-{i}"] = {
            "type": "sphere",
            "to_world": place().translate([x, -0.7, z]).scale(0.3),
            "bsdf": (tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5), glaze([0.1, 0.35, 0.25], 0.12))[i % 2],
        }

    def view(t: float) -> Camera:
        x = -0.45 + 0.9 * t
        return Camera.from_look_at([x, 0, 4.2], [0.4 * x, -0.35, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return {"cube": rigid([0.2, 1, 0.3], 120 * t, [-1.1 + 2.2 * t, -0.1 + 0.3 * np.sin(np.pi * t), 0.1])}

    return expose(scene, frames, view, poses)


@builder
def mist(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Textured shapes in and behind a bank of mist: no buffer shows the medium.

    Guides show the sides of the box that the mist fills, which are invisible. The integrator is volumetric, so that
    there is no emission. The moving shape is called `"ball"`.
    """
    place = mitsuba().ScalarTransform4f
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 12},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.33, 0.38]}},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([1.8, 3, 2], [0, -0.5, -0.5], [0, 1, 0]).scale(0.6),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [24.0, 22.0, 19.0]}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 12),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": tiles([0.4, 0.2, 0.15], [0.65, 0.5, 0.4], 20),
        },
        "bank": {
            "type": "cube",
            "to_world": place().translate([0, -0.65, -0.5]).scale([1.6, 0.34, 0.8]),
            "bsdf": {"type": "null"},
            "interior": {
                "type": "homogeneous",
                "albedo": {"type": "rgb", "value": [0.92, 0.93, 0.95]},
                "sigma_t": 1.1,
                "phase": {"type": "hg", "g": 0.4},
            },
        },
        "column": {
            "type": "cube",
            "to_world": place().translate([0.75, -0.2, -0.7]).rotate([0, 1, 0], 40).scale([0.15, 0.75, 0.15]),
            "bsdf": tiles([0.15, 0.5, 0.3], [0.9, 0.9, 0.85], 3),
        },
        "cube": {
            "type": "cube",
            "to_world": place().translate([-0.6, -0.7, -0.3]).rotate([0, 1, 0], 25).scale(0.28),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "ball": {"type": "sphere", "radius": 0.3, "bsdf": tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5)},
    }

    def view(t: float) -> Camera:
        x = -0.55 + 1.1 * t
        return Camera.from_look_at([x, 0.45, 4.2], [0.45 * x, -0.4, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return {"ball": rigid([0, 1, 0.2], 60 * t, [0.1, 0.4 - 0.8 * t, -0.4])}

    return animate(scene, frames, view, poses)


@builder
def caustics(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Glass balls and a ring of gold that gather a lamp's light on a table, filmed in passing.

    Caustics are found by chance alone: by the few paths from the table that meet glass or gold and then the lamp, each
    of them many times brighter than the mean. What looks like fireflies is all the light there is. Only the camera
    moves.
    """
    place = mitsuba().ScalarTransform4f
    glass = {"type": "dielectric", "int_ior": "bk7"}
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    x, z = 0.75 + 0.5 * np.cos(angle), 0.1 + 0.5 * np.sin(angle)
    ring = np.stack([np.stack([x, np.full(96, y), z], -1) for y in (-1, -0.72)])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 7},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.12, 0.14, 0.18]}},
        "lamp": {
            "type": "sphere",
            "to_world": place().translate([-2.2, 1.8, -1.2]).scale(0.35),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [52.0, 47.0, 40.0]}},
        },
        "table": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.42, 0.38, 0.33], [0.62, 0.58, 0.52], 10),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -2.2]).scale(5),
            "bsdf": paint([0.35, 0.4, 0.45]),
        },
        "glass ball": {"type": "sphere", "to_world": place().translate([-0.7, -0.6, -0.3]).scale(0.4), "bsdf": glass},
        "small ball": {"type": "sphere", "to_world": place().translate([-0.1, -0.8, 0.7]).scale(0.2), "bsdf": glass},
        "ring": sheet("ring", ring, {"type": "roughconductor", "material": "Au", "alpha": 0.05}),
        "cube": {
            "type": "cube",
            "to_world": place().translate([0.5, -0.7, -1.2]).rotate([0, 1, 0], 30).scale(0.3),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
    }

    def view(t: float) -> Camera:
        x = -0.5 + t
        return Camera.from_look_at([x, 0.9, 4.1], [0.5 * x, -0.7, 0], [0, 1, 0], 30, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def passer_by(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A large ball passes close before the camera: half of the image is covered and uncovered, by 25 pixels a frame.

    The moving shape is called `"ball"`.
    """
    place = mitsuba().ScalarTransform4f
    vase = lathe([[0.2, 0], [0.6, 0.3], [0.05, 0.7], [0.25, 1.1]], [0.7, -1, -0.6])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": 0.25},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([1.5, 4, 4], [0, 0, 0], [0, 1, 0]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [13.0, 12.0, 11.0]}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 14),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": picture(weave(120, 120)),
        },
        "vase": sheet("vase", vase, glaze([0.1, 0.25, 0.45], 0.1)),
        "cube": {
            "type": "cube",
            "to_world": place().translate([-0.6, -0.65, -0.5]).rotate([0, 1, 0], 25).scale(0.35),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "ball": {"type": "sphere", "radius": 0.42, "bsdf": picture(rings(512, 60))},
    }

    def view(t: float) -> Camera:
        x = -0.15 + 0.3 * t
        return Camera.from_look_at([x, 0.2, 4.4], [0.5 * x, -0.2, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return {"ball": rigid([0.3, 1, 0.1], 80 * t, [-1.5 + 3 * t, 0.1 * np.sin(np.pi * t), 2.6])}

    return animate(scene, frames, view, poses)


@builder
def cut(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A room filmed in two shots: at frame ``frames // 2`` the camera jumps to the other side.

    Motion at the cut is exact and many hundred pixels long; a little of what the first shot has seen is in the second.
    Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.22, 0.24, 0.28]}},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([0.3, 3.5, 1], [0, -1, 0], [0, 0, 1]).scale(0.6),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [24.0, 23.0, 21.0]}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5),
            "bsdf": tiles([0.32, 0.2, 0.12], [0.5, 0.36, 0.24], 16),
        },
        "back wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -2]).scale(5),
            "bsdf": tiles([0.55, 0.4, 0.3], [0.65, 0.55, 0.45], 20),
        },
        "side wall": {
            "type": "rectangle",
            "to_world": place().translate([-3, 0, 0]).rotate([0, 1, 0], 90).scale(5),
            "bsdf": picture(printed(60, 40, seed=5)),
        },
        "painting": {
            "type": "rectangle",
            "to_world": place().translate([0.7, 0.2, -1.98]).scale([0.7, 0.55, 1]),
            "bsdf": picture(),
        },
        "ball": {
            "type": "sphere",
            "to_world": place().translate([0.2, -0.6, 0]).scale(0.4),
            "bsdf": glaze([0.6, 0.15, 0.1], 0.1),
        },
        "cube": {
            "type": "cube",
            "to_world": place().translate([-0.9, -0.65, -0.4]).rotate([0, 1, 0], 25).scale(0.35),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "metal ball": {
            "type": "sphere",
            "to_world": place().translate([1, -0.75, 0.4]).scale(0.25),
            "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.15},
        },
    }

    def view(frame: int) -> Camera:
        t = frame / max(frames - 1, 1)
        first, second = [-0.4 + 0.8 * t, 0.3, 4.3], [4.2, 0.6, 0.9 - 0.8 * t]
        origin = second if frame >= frames // 2 and frames > 1 else first
        return Camera.from_look_at(origin, [0, -0.35, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    still: list[dict[str, Any]] = [{} for _ in range(frames)]
    return Sequence(scene, [view(i) for i in range(frames)], still, still)
