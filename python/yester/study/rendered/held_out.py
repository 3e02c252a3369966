"""Sequences held out from all tuning: a door that opens, a day's shadows, glass, a carousel, neon signs.

The held-out sequences of `scenes` and `unseen` have been looked at with every change, and components were chosen by
what they do there. Nothing may be tuned on those here, nor chosen by them: they tell what is left of a gain elsewhere.
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
    tiles,
    weave,
)

__all__ = ["NAMES", "carousel", "glass_shelf", "neon_corridor", "opening_door", "passing_day"]

#: Held out: these only tell what the tuning is worth.
NAMES = ("opening_door", "passing_day", "glass_shelf", "carousel", "neon_corridor")


@builder
def opening_door(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A dim room of many materials into which a door lets light, filmed while walking.

    Light grows with the gap, without any sudden change, and its edge travels over what stands still; behind the door
    more and more of the next room comes into view. The camera steps forward, and up and down. The moving shapes are
    called `"door"` and `"handle"`, and turn about the hinge.
    """
    place = mitsuba().ScalarTransform4f
    plaster = paint([0.6, 0.56, 0.5])
    hinge, broad, tall = np.array([0.15, 0.0, -1.6]), 0.8, 1.75
    jar = lathe([[0.2, 0], [0.55, 0.2], [0.05, 0.6], [0.18, 0.8]], [-0.85, -0.45, -1.1])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        "dusk": {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 0.56, 0.68]}},
        "lamp": {
            "type": "sphere",
            "to_world": place().translate([-1.3, 0.9, -0.6]).scale(0.1),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [20.0, 14.0, 8.0]}},
        },
        # The room behind the door.
        "window": {
            "type": "rectangle",
            "to_world": place().look_at([1.9, 1, -4.2], [0.2, -0.5, -1], [0, 1, 0]).scale([0.7, 0.6, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [75.0, 65.0, 48.0]}},
        },
        "hall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -5]).scale([4, 3, 1]),
            "bsdf": tiles([0.3, 0.42, 0.5], [0.75, 0.72, 0.62], 10),
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, -1]).rotate([1, 0, 0], -90).scale(6),
            "bsdf": glaze_tiles([0.28, 0.17, 0.1], [0.46, 0.31, 0.19], 20, 0.2),
        },
        "ceiling": {
            "type": "rectangle",
            "to_world": place().translate([0, 1.35, -1]).rotate([1, 0, 0], 90).scale(6),
            "bsdf": plaster,
        },
        "left wall": {
            "type": "rectangle",
            "to_world": place().translate([-1.9, 0, 0]).rotate([0, 1, 0], 90).scale([3, 2, 1]),
            "bsdf": picture(weave(100, 60)),
        },
        "right wall": {
            "type": "rectangle",
            "to_world": place().translate([1.9, 0, 0]).rotate([0, 1, 0], -90).scale([3, 2, 1]),
            "bsdf": tiles([0.5, 0.25, 0.2], [0.62, 0.4, 0.32], 16),
        },
        "door": {
            "type": "cube",
            "to_world": place()
            .translate([hinge[0] + broad / 2, tall / 2 - 1, hinge[2]])
            .scale([broad / 2, tall / 2, 0.03]),
            "bsdf": glaze([0.45, 0.42, 0.36], 0.25),
        },
        "handle": {
            "type": "sphere",
            "to_world": place().translate([hinge[0] + 0.9 * broad, -0.1, hinge[2] + 0.07]).scale(0.04),
            "bsdf": {"type": "roughconductor", "material": "Au", "alpha": 0.1},
        },
        "cabinet": {
            "type": "cube",
            "to_world": place().translate([-1.05, -0.72, -1.2]).scale([0.55, 0.27, 0.3]),
            "bsdf": glaze([0.2, 0.1, 0.06], 0.15),
        },
        "jar": sheet("jar", jar, {"type": "roughconductor", "material": "Cu", "alpha": 0.2}),
        "ball": {
            "type": "sphere",
            "to_world": place().translate([0.35, -0.78, -0.1]).scale(0.22),
            "bsdf": glaze([0.1, 0.3, 0.5], 0.08),
        },
        "stool": {
            "type": "cube",
            "to_world": place().translate([1.35, -0.75, -0.7]).rotate([0, 1, 0], 20).scale(0.25),
            "bsdf": tiles([0.1, 0.35, 0.25], [0.8, 0.75, 0.6], 3),
        },
        "globe": {
            "type": "sphere",
            "to_world": place().translate([1.35, -0.28, -0.7]).scale(0.22),
            "bsdf": {"type": "dielectric", "int_ior": "bk7"},
        },
        "panel": {
            "type": "cube",
            "to_world": place().translate([-0.7, 0.4, -1.56]).scale([0.45, 0.3, 0.02]),
            "bsdf": {"type": "roughconductor", "material": "Al", "alpha": 0.12},
        },
    }
    # The wall with the doorway, and boards around it.
    top, right = tall - 1, hinge[0] + broad
    for name, (left, low, end, high) in {
        "wall left of the door": (-1.9, -1, hinge[0], 1.35),
        "wall right of the door": (right, -1, 1.9, 1.35),
        "wall above the door": (hinge[0], top, right, 1.35),
    }.items():
        scene[name] = {
            "type": "cube",
            "to_world": place()
            .translate([(left + end) / 2, (low + high) / 2, hinge[2] - 0.03])
            .scale([(end - left) / 2, (high - low) / 2, 0.05]),
            "bsdf": plaster,
        }

    def view(t: float) -> Camera:
        step = 0.035 * np.abs(np.sin(2.5 * np.pi * t))
        origin = [-0.25 + 0.3 * t, 0.1 + step, 3.3 - 0.9 * t]
        return Camera.from_look_at(origin, [0.1, -0.2, -1.6], [0, 1, 0], 40, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return dict.fromkeys(("door", "handle"), _about(hinge, [0, 1, 0], 3 + 80 * t**1.5))

    return animate(scene, frames, view, poses)


@builder
def passing_day(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Rough ground with boulders and posts under a sun that travels, seen by a camera that turns where it stands.

    All shadows move, on ground whose own slopes are lit otherwise from frame to frame. Turning has no parallax: history
    is exact, and light alone is wrong with it. The moving shape is called `"sun"`, and is never in view.
    """
    place = mitsuba().ScalarTransform4f
    rng = np.random.default_rng(23)
    side, reach = 193, 9.0
    heights = 0.9 * _clouds(side, 1.9, rng) + 0.05 * _clouds(side, 0.9, rng)
    across = np.linspace(-reach, reach, side)
    # Level where the camera stands.
    heights *= np.clip(np.hypot(across[None], across[:, None] - 4) / 4, 0.05, 1)
    ground = np.dstack([np.broadcast_to(across, (side, side)), heights, np.broadcast_to(across[:, None], (side, side))])
    rock, moss, sand = ([0.36, 0.33, 0.3], [0.2, 0.27, 0.1], [0.55, 0.45, 0.3])
    cover = _clouds(256, 1.2, rng)[..., None]
    colors = (
        np.where(cover > 0.6, moss, np.where(cover > -0.5, rock, sand)) * (1 + 0.2 * _clouds(256, 0.3, rng))[..., None]
    )
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.2, 0.28, 0.42]}},
        "sun": {
            "type": "sphere",
            "to_world": place().translate([0, 0, 40]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [2800.0, 2350.0, 1650.0]}},
        },
        # From the front to the back, so that normals point up.
        "ground": sheet("ground", ground[::-1], picture(colors.clip(0.02, 0.9).astype(np.float32)), closed=False),
    }

    def height_at(x: float, z: float) -> float:
        column, row = (round((v + reach) / (2 * reach) * (side - 1)) for v in (x, z))
        return float(heights[row, column])

    for i in range(16):
        x, z, size = rng.uniform(-3.4, 3.4), rng.uniform(-5, 1.4), rng.uniform(0.1, 0.3)
        at = place().translate([x, height_at(x, z) + 0.2 * size, z])
        scene[f"boulder-{i}"] = {
            "type": "cube" if i % 2 else "sphere",
            "to_world": at.rotate([0.3, 1, 0.2], rng.uniform(0, 180)).scale(size) if i % 2 else at.scale(size),
            "bsdf": paint((rng.uniform(0.7, 1.3) * np.array([0.4, 0.37, 0.34])).tolist()),
        }
    for i, x in enumerate(np.linspace(-3, 3, 9)):
        z = -0.6 - 0.35 * x
        base = height_at(x, z)
        scene[f"post-{i}"] = {
            "type": "cylinder",
            "p0": [x, base - 0.2, z],
            "p1": [x + rng.uniform(-0.08, 0.08), base + rng.uniform(0.6, 0.9), z],
            "radius": 0.03,
            "bsdf": {"type": "twosided", "nested": paint([0.3, 0.2, 0.12])},
        }

    def view(t: float) -> Camera:
        angle = np.radians(-11 + 22 * t)
        eye = np.array([0, height_at(0, 4) + 1.1, 4])
        toward = eye + np.array([np.sin(angle), -0.3, -np.cos(angle)])
        return Camera.from_look_at(eye, toward, [0, 1, 0], 38, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        # From where the scene has it: up, and around.
        return {
            "sun": rigid([0, 1, 0], 75 - 150 * t, [0, 0, 0]) @ rigid([1, 0, 0], -18 - 22 * np.sin(np.pi * t), [0, 0, 0])
        }

    return animate(scene, frames, view, poses)


@builder
def glass_shelf(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Shelves full of small things of glass and metal before a patterned wall, in a slow truck.

    Each is a few pixels wide, refracts or mirrors all the others, and moves otherwise than what it shows. Guides know
    its own surface alone. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    rng = np.random.default_rng(31)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 9},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.32, 0.34, 0.38]}},
        "softbox": {
            "type": "rectangle",
            "to_world": place().look_at([-2.2, 2.2, 3.2], [0, 0, 0], [0, 1, 0]).scale([1.3, 1, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [9.0, 8.2, 7.0]}},
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -0.75]).scale([3, 2.2, 1]),
            "bsdf": picture(weave(90, 66)),
        },
    }
    metals = ("Au", "Cu", "Al", "Ag")
    for row, low in enumerate((-0.95, -0.3, 0.35)):
        scene[f"board-{row}"] = {
            "type": "cube",
            "to_world": place().translate([0, low - 0.03, -0.35]).scale([2.2, 0.03, 0.4]),
            "bsdf": glaze([0.3, 0.18, 0.1], 0.2),
        }
        for i, x in enumerate(np.linspace(-1.5, 1.5, 13)):
            size, z = rng.uniform(0.06, 0.11), rng.uniform(-0.5, -0.1)
            tall, metal, alpha = rng.uniform(0.2, 0.42), metals[rng.integers(4)], rng.uniform(0.05, 0.25)
            glass = {"type": "dielectric", "int_ior": "bk7"}
            shine = {"type": "roughconductor", "material": metal, "alpha": alpha}
            at = place().translate([x, low, z])
            match (i + 2 * row) % 5:
                case 0:
                    thing: Any = {"type": "sphere", "to_world": at.translate([0, size, 0]).scale(size), "bsdf": glass}
                case 1:
                    outline = [[0.9 * size, 0], [1.6 * size, 0.3 * tall], [0.1 * size, 0.7 * tall], [0.7 * size, tall]]
                    thing = sheet(f"thing-{row}-{i}", lathe(outline, [x, low, z]), shine)
                case 2:
                    turned = at.translate([0, tall / 2, 0]).rotate([0, 1, 0], rng.uniform(0, 90))
                    half = [0.6 * size, tall / 2, 0.6 * size]
                    thing = {"type": "cube", "to_world": turned.scale(half), "bsdf": glass}
                case 3:
                    thing = {"type": "sphere", "to_world": at.translate([0, size, 0]).scale(size), "bsdf": shine}
                case _:
                    turned = at.translate([0, 0.8 * size, 0]).rotate([0, 1, 0], rng.uniform(0, 90))
                    tint = rng.uniform(0.1, 0.7, 3).tolist()
                    thing = {"type": "cube", "to_world": turned.scale(0.8 * size), "bsdf": glaze(tint, 0.1)}
            scene[f"thing-{row}-{i}"] = thing

    def view(t: float) -> Camera:
        x = -0.22 + 0.44 * t
        return Camera.from_look_at([x, 0.05, 3.4], [x, -0.15, 0], [0, 1, 0], 32, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def carousel(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A carousel with printed floor and painted roof that turns, while the camera zooms in on it.

    Every surface of it has another speed, its riders rise and sink, and cover each other and what stands behind. The
    zoom stretches all textures: history has fewer texels than the image needs. The moving shapes are called `"deck"`,
    `"rim"`, `"roof"`, `"drum"`, and `"pole-0"` and `"rider-0"` to `"pole-6"` and `"rider-6"`.
    """
    place = mitsuba().ScalarTransform4f
    y, x = (np.mgrid[:128, :512] + 0.5) / [[[128]], [[512]]]
    scallops = (np.floor(14 * x) % 2 == 0)[..., None] ^ (y > 0.75 + 0.15 * np.abs(np.sin(14 * np.pi * x)))[..., None]
    canvas = np.where(scallops, [0.75, 0.12, 0.1], [0.88, 0.82, 0.68]).astype(np.float32)
    roof = lathe([[1.45, 0.12], [1.2, 0.35], [0.7, 0.5], [0.02, 0.75]], [0, 0.15, 0])
    drum = lathe([[0.28, -1], [0.28, -0.4], [0.28, 0.2], [0.28, 0.7]])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.42, 0.5, 0.62]}},
        "lamp": {
            "type": "rectangle",
            "to_world": place().look_at([2.5, 2.6, 4], [0, -0.4, 0], [0, 1, 0]).scale(0.8),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [22.0, 19.0, 15.0]}},
        },
        "ground": {
            "type": "rectangle",
            "to_world": place().translate([0, -1.12, 0]).rotate([1, 0, 0], -90).scale(9),
            "bsdf": tiles([0.34, 0.32, 0.3], [0.48, 0.46, 0.42], 36),
        },
        "hoarding": {
            "type": "rectangle",
            "to_world": place().translate([0, 0.4, -3]).scale([6, 1.6, 1]),
            "bsdf": picture(printed(70, 18, seed=9)),
        },
        "deck": {
            "type": "disk",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(1.4),
            "bsdf": picture(rings(512, 70)),
        },
        "rim": {
            "type": "cylinder",
            "p0": [0, -1.12, 0],
            "p1": [0, -1, 0],
            "radius": 1.4,
            "bsdf": {"type": "twosided", "nested": tiles([0.15, 0.2, 0.45], [0.8, 0.7, 0.35], 24)},
        },
        "roof": sheet("roof", roof, picture(canvas)),
        "drum": sheet("drum", drum, picture(weave(60, 40))),
    }
    riders = 7
    finishes = (
        tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 4),
        glaze([0.08, 0.3, 0.4], 0.1),
        paint([0.7, 0.6, 0.2]),
        {"type": "roughconductor", "material": "Au", "alpha": 0.2},
    )
    for i in range(riders):
        angle = 2 * np.pi * i / riders
        spot = [1.05 * np.sin(angle), 1.05 * np.cos(angle)]
        scene[f"pole-{i}"] = {
            "type": "cylinder",
            "p0": [spot[0], -1, spot[1]],
            "p1": [spot[0], 0.4, spot[1]],
            "radius": 0.025,
            "bsdf": {"type": "twosided", "nested": {"type": "roughconductor", "material": "Al", "alpha": 0.15}},
        }
        at = place().translate([spot[0], -0.5, spot[1]]).rotate([0, 1, 0], float(np.degrees(angle)))
        scene[f"rider-{i}"] = {
            "type": "cube" if i % 2 else "sphere",
            "to_world": at.scale([0.28, 0.15, 0.12] if i % 2 else 0.18),
            "bsdf": finishes[i % len(finishes)],
        }

    def view(t: float) -> Camera:
        return Camera.from_look_at([0.3, 0.35, 6], [0, -0.3, 0], [0, 1, 0], 36 - 14 * t, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        turned = rigid([0, 1, 0], 70 * t, [0, 0, 0])
        moved = dict.fromkeys(("deck", "rim", "roof", "drum", *(f"pole-{i}" for i in range(riders))), turned)
        for i in range(riders):
            rise = np.eye(4)
            rise[1, 3] = 0.16 * np.sin(2 * np.pi * (t + i / 3))
            moved[f"rider-{i}"] = rise @ turned
        return moved

    return animate(scene, frames, view, poses)


@builder
def neon_corridor(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A long dark corridor lit by nothing but its coloured signs, in a fast pan from wall to wall.

    The signs are print that shines: emission has all the detail, and the polished floor mirrors it. After a quarter of
    the frames, a quarter of the image is new. Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, -8]).rotate([1, 0, 0], -90).scale([1.5, 13, 1]),
            "bsdf": glaze_tiles([0.1, 0.11, 0.13], [0.32, 0.31, 0.3], [3, 26], 0.08),
        },
        "ceiling": {
            "type": "rectangle",
            "to_world": place().translate([0, 1.1, -8]).rotate([1, 0, 0], 90).scale([1.5, 13, 1]),
            "bsdf": paint([0.45, 0.45, 0.47]),
        },
        "end": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -20]).scale([1.5, 1.1, 1]),
            "bsdf": picture(),
        },
        "behind": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, 5]).rotate([0, 1, 0], 180).scale([1.5, 1.1, 1]),
            "bsdf": paint([0.3, 0.3, 0.32]),
        },
    }
    for name, x, turn in (("left wall", -1.5, 90), ("right wall", 1.5, -90)):
        scene[name] = {
            "type": "rectangle",
            "to_world": place().translate([x, 0, -8]).rotate([0, 1, 0], turn).scale([13, 1.1, 1]),
            "bsdf": tiles([0.35, 0.37, 0.4], [0.55, 0.52, 0.48], 26),
        }
    tints = ([1, 0.15, 0.25], [0.15, 0.5, 1], [1, 0.75, 0.2], [0.2, 1, 0.45], [0.9, 0.25, 1])
    for i in range(14):
        right, z = i % 2, 2.2 - 1.3 * i
        letters = (1 - printed(9, 4, seed=40 + i)) ** 2
        light = (40 * letters * tints[i % len(tints)]).astype(np.float32)
        bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(light), "raw": True}
        scene[f"sign-{i}"] = {
            "type": "rectangle",
            "to_world": place()
            .translate([1.47 if right else -1.47, 0.25, z])
            .rotate([0, 1, 0], -90 if right else 90)
            .scale([0.55, 0.38, 1]),
            "bsdf": paint([0.05, 0.05, 0.05]),
            "emitter": {"type": "area", "radiance": bitmap},
        }
        scene[f"bin-{i}"] = {
            "type": "cylinder",
            "p0": [-1.2 if right else 1.2, -1, z],
            "p1": [-1.2 if right else 1.2, -0.5, z],
            "radius": 0.16,
            "bsdf": {"type": "twosided", "nested": {"type": "roughconductor", "material": "Al", "alpha": 0.2}},
        }

    def view(t: float) -> Camera:
        angle = np.radians(-28 + 56 * t)
        eye = np.array([0.1, 0.05, 4.2])
        toward = eye + np.array([np.sin(angle), -0.08, -np.cos(angle)])
        return Camera.from_look_at(eye, toward, [0, 1, 0], 40, width, height, fov_axis="y")

    return animate(scene, frames, view)


def _about(point: ArrayLike, axis: ArrayLike, degrees: float) -> Matrix:
    """Turned about an axis through a point."""
    turned = rigid(axis, degrees, [0, 0, 0])
    turned[:3, 3] = np.asarray(point) - turned[:3, :3] @ np.asarray(point)
    return turned


def _clouds(side: int, fall: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A square field of noise with mean 0 and deviation 1, whose amplitude falls with that power of frequency."""
    rate = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)) * side
    spectrum = np.fft.rfft2(rng.standard_normal((side, side)))
    spectrum *= np.divide(1, rate**fall, out=np.zeros_like(rate), where=rate > 0)
    field = np.fft.irfft2(spectrum, (side, side))
    return np.asarray(field / field.std())
