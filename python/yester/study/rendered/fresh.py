"""Sequences made after all tuning: a shaking hand, falling paper, a television, leaves, a pool, spotlights, an attic.

Like those of `held_out`, they only tell what is left of a gain elsewhere. Those have been looked at with every change
since; these are for the next ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yester import Camera

from .build import (
    Matrix,
    Sequence,
    animate,
    builder,
    glaze,
    glaze_tiles,
    lathe,
    mitsuba,
    paint,
    picture,
    printed,
    rigid,
    rings,
    sheet,
    sky,
    tiles,
    weave,
)

__all__ = ["NAMES", "attic", "confetti", "handheld", "leaves", "pool", "spotlights", "television"]

#: Held out: these only tell what the tuning is worth.
NAMES = ("handheld", "confetti", "television", "leaves", "pool", "spotlights", "attic")

#: Steps between frames for which the motion of a hand, and the cuts of a television, are laid out.
_STEPS = 23


@builder
def handheld(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Things of principled materials in a room with one window, by a hand that shakes and rolls.

    Half of them are metals, all have some clear coat, and roughness lies anywhere from 0.1 to 0.8.
    """
    rng = np.random.default_rng(5)
    floor = glaze_tiles([0.3, 0.2, 0.12], [0.5, 0.36, 0.22], [14, 40], 0.25)
    scene = _room(floor, paint([0.62, 0.6, 0.55]), picture(weave(80, 50)), depth=6)
    scene["window"] = _panel([-1.98, 0.5, 0.2], [1, -0.4, 0], [0.5, 0.6, 1], [28.0, 30.0, 34.0])
    for i in range(14):
        x, z, size = rng.uniform(-1.6, 1.6), rng.uniform(-2.0, 0.8), rng.uniform(0.12, 0.3)
        material = {
            "type": "principled",
            "base_color": _rgb(rng.uniform(0.05, 0.9, 3)),
            "roughness": float(rng.uniform(0.1, 0.8)),
            "metallic": float(rng.integers(2) * rng.uniform(0.3, 1)),
            "clearcoat": float(rng.uniform(0, 1)),
            "specular": 0.5,
        }
        place = _at([x, size - 1, z]).rotate([0, 1, 0], rng.uniform(0, 90)).scale(size)
        scene[f"thing {i}"] = {"type": "cube" if i % 2 else "sphere", "to_world": place, "bsdf": material}
    walk = np.cumsum(np.random.default_rng(8).standard_normal((400, 4)), 0) * [0.012, 0.012, 0.012, 0.25]

    def view(t: float) -> Camera:
        step, part = divmod(t * _STEPS, 1)
        before, after = walk[int(step)], walk[int(step) + 1]
        x, y, z, turn = before * (1 - part) + after * part
        roll = np.radians(3 * turn)
        eye, target = [0.2 + 2 * x, 0.1 + 2 * y, 3.6], [3 * y, 3 * z - 0.45, -1]
        return Camera.from_look_at(eye, target, [np.sin(roll), np.cos(roll), 0], 42, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def confetti(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Scraps of paper that fall and tumble before a poster; the camera stands still.

    The moving shapes are called `"scrap 0"` to `"scrap 39"`.
    """
    rng = np.random.default_rng(6)
    floor = tiles([0.3, 0.3, 0.32], [0.6, 0.58, 0.55], 20)
    scene = _room(floor, paint([0.5, 0.55, 0.6]), picture(printed(50, 24, 3)), depth=4)
    scene["lamp"] = _ceiling_lamp([0, 1.38, 0.5], [0.8, 0.5, 1], [16.0, 15.0, 13.0])
    count = 40
    places = rng.uniform([-1.4, -0.6, -1.8], [1.4, 1.3, 1.6], (count, 3))
    axes, turns = rng.standard_normal((count, 3)), rng.uniform(100, 500, count)
    sizes, speeds = rng.uniform(0.04, 0.1, count), rng.uniform(0.5, 1.1, count)
    for i, size in enumerate(sizes):
        material = {"type": "twosided", "nested": paint(rng.uniform(0.1, 0.85, 3).tolist())}
        shape = mitsuba().ScalarTransform4f().scale([size, 0.7 * size, 1])
        scene[f"scrap {i}"] = {"type": "rectangle", "to_world": shape, "bsdf": material}

    def poses(t: float) -> dict[str, Matrix]:
        fallen = places - np.outer(speeds * t, [0, 1, 0])
        return {f"scrap {i}": rigid(axes[i], turns[i] * t, fallen[i]) for i in range(count)}

    return animate(scene, frames, lambda _: _look([0, 0, 3.8], [0, -0.1, 0], 40, width, height), poses)


@builder
def television(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A dark room that only a television lights, whose picture moves and is cut every five frames; a slow truck."""
    mi = mitsuba()
    floor = glaze_tiles([0.2, 0.14, 0.1], [0.3, 0.22, 0.16], 16, 0.15)
    scene = _room(floor, paint([0.5, 0.5, 0.52]), tiles([0.35, 0.3, 0.3], [0.5, 0.45, 0.42], 12), depth=5)
    blank = mi.Bitmap(np.full((32, 48, 3), 1.0, np.float32))
    vase = lathe([[0.15, 0], [0.4, 0.3], [0.02, 0.5], [0.15, 0.7]], [1.0, -1, -1.2])
    scene |= {
        "screen": {
            "type": "rectangle",
            "to_world": _at([0.1, -0.05, -2.4]).scale([0.9, 0.6, 1]),
            "bsdf": paint([0.02, 0.02, 0.02]),
            "emitter": {"type": "area", "radiance": {"type": "bitmap", "bitmap": blank, "raw": True}},
        },
        "sofa": {
            "type": "cube",
            "to_world": _at([-0.2, -0.85, 0.4]).scale([0.9, 0.25, 0.3]),
            "bsdf": picture(weave(30, 16)),
        },
        "vase": sheet("vase", vase, glaze([0.5, 0.1, 0.1], 0.1)),
        "table": {
            "type": "cube",
            "to_world": _at([-1.2, -0.8, -1.2]).scale([0.4, 0.2, 0.4]),
            "bsdf": glaze([0.25, 0.14, 0.07], 0.1),
        },
    }

    def shown(t: float) -> NDArray[np.float32]:
        y, x = np.mgrid[:32, :48] / 32
        rng = np.random.default_rng(int(t * _STEPS) // 5)
        colors = rng.uniform(0.1, 1, (3, 3)) * rng.uniform(2, 14)
        squares = [
            (x - rng.uniform(0, 1.5) - 0.5 * np.sin(4 * t)) ** 2 + (y - rng.uniform(0, 1)) ** 2 for _ in range(3)
        ]
        return np.asarray(0.05 * colors.mean(0) + np.exp(-np.stack(squares, -1) / 0.15) @ colors, np.float32)

    moved = animate(scene, frames, lambda t: _look([0.6 * t - 0.3, 0.2, 3.8], [0, -0.3, -1], 40, width, height))
    pictures = [{"screen.emitter.radiance.data": shown(t)} for t in np.linspace(0, 1, frames)]
    return Sequence(moved.scene, moved.cameras, moved.transforms, pictures)


@builder
def leaves(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Leaves that masks of opacity cut out of rectangles, in the sun, on a walk towards them.

    Mitsuba's guides show the rectangles whole: behind a hole they tell of another surface than the colour.
    """
    mi = mitsuba()
    rng = np.random.default_rng(12)
    y, x = (np.mgrid[:64, :64] + 0.5) / 32 - 1
    leaf = (np.abs(x) < 0.55 * (1 - y**2)) & (np.abs(x - 0.03) > 0.02)
    mask = mi.Bitmap(np.repeat(leaf[..., None], 3, -1).astype(np.float32))
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([0.5, 0.8, 0.4]))},
        "ground": {
            "type": "rectangle",
            "to_world": _at([0, -1, 0]).rotate([1, 0, 0], -90).scale(10),
            "bsdf": tiles([0.3, 0.25, 0.2], [0.42, 0.36, 0.3], 40),
        },
        "wall": {
            "type": "rectangle",
            "to_world": _at([0, 0, -2.5]).scale([3, 1.2, 1]),
            "bsdf": picture(printed(50, 14, 5)),
        },
    }
    for i in range(110):
        place = _at(rng.uniform([-1.6, -0.9, -1.6], [1.6, 1.0, 1.4]))
        tint = (np.array([0.15, 0.4, 0.08]) * rng.uniform(0.6, 1.7)).clip(0, 0.9).tolist()
        scene[f"leaf {i}"] = {
            "type": "rectangle",
            "to_world": place.rotate(rng.standard_normal(3), rng.uniform(0, 180)).scale(rng.uniform(0.12, 0.28)),
            "bsdf": {
                "type": "mask",
                "opacity": {"type": "bitmap", "bitmap": mask, "raw": True},
                "nested": {"type": "twosided", "nested": glaze(tint, 0.3)},
            },
        }

    def view(t: float) -> Camera:
        return _look([0.8 * t - 0.4, 0.1 + 0.05 * np.sin(20 * t), 4 - 0.5 * t], [0, -0.1, 0], 38, width, height)

    return animate(scene, frames, view)


@builder
def pool(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Tiles under water that stands in waves, with their caustics, in the sun; a crane shot."""
    mi = mitsuba()
    z, x = np.mgrid[:120, :120] / 119 * 4 - 2
    waves = 0.012 * np.sin(5 * x + 2 * z) + 0.01 * np.sin(7 * z - 3 * x + 1) + 0.006 * np.sin(14 * x + 11 * z)
    water = np.dstack([x, waves, z])[::-1]
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(np.minimum(sky([0.4, 0.7, 0.5]), 60))},
        "floor": {
            "type": "rectangle",
            "to_world": _at([0, -0.6, 0]).rotate([1, 0, 0], -90).scale(2.2),
            "bsdf": tiles([0.15, 0.4, 0.5], [0.7, 0.8, 0.8], 14),
        },
        "side": {
            "type": "rectangle",
            "to_world": _at([0, -0.3, -2]).scale([2, 0.5, 1]),
            "bsdf": tiles([0.1, 0.2, 0.5], [0.8, 0.8, 0.8], 10),
        },
        "coping": {
            "type": "cube",
            "to_world": _at([0, -0.05, -2.3]).scale([3, 0.2, 0.3]),
            "bsdf": paint([0.6, 0.55, 0.5]),
        },
        "ball": {
            "type": "sphere",
            "to_world": _at([0.4, 0.1, 0.2]).scale(0.22),
            "bsdf": glaze([0.7, 0.15, 0.1], 0.1),
        },
        "lawn": {
            "type": "rectangle",
            "to_world": _at([0, 0.14, -5]).rotate([1, 0, 0], -90).scale([6, 2.5, 1]),
            "bsdf": paint([0.15, 0.3, 0.08]),
        },
        "water": sheet("water", water, {"type": "dielectric", "int_ior": "water"}, closed=False),
    }

    def view(t: float) -> Camera:
        return _look([0.6 * t - 0.6, 1.4 + 0.4 * t, 2.8], [0, -0.3, -0.3], 40, width, height)

    return animate(scene, frames, view)


@builder
def spotlights(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Three small lamps of strong colours that travel over a stage with pillars, each at its own pace; a turn.

    The moving shapes are called `"lamp 0"` to `"lamp 2"`.
    """
    floor = glaze_tiles([0.25, 0.2, 0.2], [0.35, 0.3, 0.28], 12, 0.12)
    scene = _room(floor, paint([0.4, 0.4, 0.42]), picture(rings(256, 60)), depth=4)
    scene["fill"] = {"type": "constant", "radiance": _rgb([0.05, 0.05, 0.06])}
    for i, tint in enumerate(([720.0, 180.0, 120.0], [120.0, 600.0, 240.0], [144.0, 240.0, 840.0])):
        scene[f"lamp {i}"] = {
            "type": "sphere",
            "to_world": mitsuba().ScalarTransform4f().scale(0.06),
            "emitter": {"type": "area", "radiance": _rgb(tint)},
        }
    for i in range(6):
        x, z = 0.6 * i - 1.5, 0.5 * (i % 2) - 1.2
        scene[f"pillar {i}"] = {
            "type": "cylinder",
            "p0": [x, -1, z],
            "p1": [x, 0.2, z],
            "radius": 0.1,
            "bsdf": {"type": "twosided", "nested": paint([0.6, 0.55, 0.5])},
        }
    scene["ball"] = {
        "type": "sphere",
        "to_world": _at([0.3, -0.75, 0.6]).scale(0.25),
        "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.15},
    }

    def poses(t: float) -> dict[str, Matrix]:
        found = {}
        for i in range(3):
            across, along = np.sin(2.2 * i + 3 * t), np.cos(2.2 * i + (3 - 2 * i) * t)
            found[f"lamp {i}"] = rigid([0, 1, 0], 0, [1.2 * across, 0.9, 0.2 + 1.2 * along])
        return found

    def view(t: float) -> Camera:
        angle = np.radians(20 * t - 10)
        return _look([4 * np.sin(angle), 0, 4 * np.cos(angle)], [0, -0.3, -0.6], 38, width, height)

    return animate(scene, frames, view, poses)


@builder
def attic(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Textures everywhere in hardly any light, most of it indirect, from a slit behind a screen; a slow push."""
    rng = np.random.default_rng(77)
    walls = tiles([0.4, 0.33, 0.25], [0.55, 0.46, 0.36], 12)
    scene = _room(picture(weave(60, 60)), walls, picture(printed(40, 24, 8)), depth=8)
    scene["slit"] = _panel([1.98, 0.9, 1.5], [0, -0.9, 0.5], [0.05, 0.3, 1], [260.0, 230.0, 180.0])
    scene["screen"] = {
        "type": "cube",
        "to_world": _at([0.9, 0, 0.2]).scale([0.03, 1, 0.9]),
        "bsdf": paint([0.5, 0.45, 0.4]),
    }
    for i in range(12):
        x, z, size = rng.uniform(-1.7, 0.7), rng.uniform(-2.2, 0.5), rng.uniform(0.12, 0.3)
        place = _at([x, size - 1, z]).rotate([0, 1, 0], rng.uniform(0, 90)).scale(size)
        coats = [picture(printed(12, 6, i)), paint(rng.uniform(0.05, 0.8, 3).tolist())]
        coats += [glaze(rng.uniform(0.05, 0.8, 3).tolist(), 0.2)]
        scene[f"box {i}"] = {"type": "cube" if i % 3 else "sphere", "to_world": place, "bsdf": coats[i % 3]}
    return animate(scene, frames, lambda t: _look([-0.3, 0.1, 3.6 - 0.5 * t], [-0.2, -0.4, -1], 42, width, height))


def _rgb(value: ArrayLike) -> dict[str, Any]:
    return {"type": "rgb", "value": np.asarray(value, float).tolist()}


def _at(place: ArrayLike) -> Any:
    return mitsuba().ScalarTransform4f().translate(np.asarray(place, float).tolist())


def _look(eye: ArrayLike, target: ArrayLike, fov: float, width: int, height: int) -> Camera:
    return Camera.from_look_at(eye, target, [0, 1, 0], fov, width, height, fov_axis="y")


def _room(floor: dict[str, Any], walls: dict[str, Any], back: dict[str, Any], *, depth: int) -> dict[str, Any]:
    """A scene with paths of so many segments, in a closed room of four by two and a half units, eight deep."""
    half, top = 2.0, 1.4
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "floor": {"type": "rectangle", "to_world": _at([0, -1, 0]).rotate([1, 0, 0], -90).scale(6), "bsdf": floor},
        "ceiling": {
            "type": "rectangle",
            "to_world": _at([0, top, 0]).rotate([1, 0, 0], 90).scale(6),
            "bsdf": paint([0.7, 0.7, 0.68]),
        },
        "back": {"type": "rectangle", "to_world": _at([0, 0, -2.5]).scale([4, 2.5, 1]), "bsdf": back},
        "left": {
            "type": "rectangle",
            "to_world": _at([-half, 0, 0]).rotate([0, 1, 0], 90).scale([6, 2.5, 1]),
            "bsdf": walls,
        },
        "right": {
            "type": "rectangle",
            "to_world": _at([half, 0, 0]).rotate([0, 1, 0], -90).scale([6, 2.5, 1]),
            "bsdf": walls,
        },
        "behind": {
            "type": "rectangle",
            "to_world": _at([0, 0, 5.5]).rotate([0, 1, 0], 180).scale([4, 2.5, 1]),
            "bsdf": paint([0.5, 0.5, 0.55]),
        },
    }


def _panel(place: ArrayLike, target: ArrayLike, size: list[float], radiance: list[float]) -> dict[str, Any]:
    """A rectangle that shines towards a point."""
    pose = mitsuba().ScalarTransform4f().look_at(place, target, [0, 1, 0]).scale(size)
    return {"type": "rectangle", "to_world": pose, "emitter": {"type": "area", "radiance": _rgb(radiance)}}


def _ceiling_lamp(place: ArrayLike, size: list[float], radiance: list[float]) -> dict[str, Any]:
    pose = _at(place).rotate([1, 0, 0], 90).scale(size)
    return {"type": "rectangle", "to_world": pose, "emitter": {"type": "area", "radiance": _rgb(radiance)}}
