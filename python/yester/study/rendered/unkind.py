"""Sequences that are unkind to denoisers, for tuning: dark albedo, glass, naked lamps, fine geometry, a fast dolly.

The sequences of `scenes` have no surface too dark to demodulate, no glass, no lamp brighter than its surroundings by
orders of magnitude, and depth that hardly changes from frame to frame. Frames of other people's scenes have all of
these. The held-out sequences are in `unseen`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from yester import Camera

from .build import (
    FOV,
    Matrix,
    Sequence,
    animate,
    builder,
    copies,
    glaze,
    lathe,
    mitsuba,
    paint,
    picture,
    rigid,
    rings,
    sheet,
    similarity,
    sky,
    tiles,
)

__all__ = ["NAMES", "black_plastic", "fast_dolly", "glassware", "grass", "naked_lamps"]

#: Parameters may be tuned on these.
NAMES = ("black_plastic", "glassware", "naked_lamps", "grass", "fast_dolly")


@builder
def black_plastic(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Black plastic, black rubber, white plaster and gold side by side on a table; a black cube turns among them.

    The diffuse albedo of the plastic is 0.003, so that nearly all of its light is a reflection, which division by
    albedo multiplies by 300. The moving shape is called `"cube"`.
    """
    place = mitsuba().ScalarTransform4f
    plastic, rubber = glaze([0.003, 0.003, 0.003], 0.1), glaze([0.012, 0.011, 0.01], 0.5)
    white, gold = paint([0.85, 0.84, 0.82]), {"type": "roughconductor", "material": "Au", "alpha": 0.15}
    vase = lathe([[0.18, 0], [0.55, 0.25], [0.05, 0.6], [0.22, 0.95]], [-0.15, -1, -0.75])
    tire = lathe([[0.3, 0], [0.62, 0.02], [0.62, 0.28], [0.3, 0.3]], [-0.55, -1, 0.45])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.22, 0.25, 0.3]}},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([-1.8, 3, 2], [0, -0.6, 0], [0, 1, 0]).scale(0.5),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [38.0, 36.0, 33.0]}},
        },
        "table": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            # Every other tile is of the plastic's albedo.
            "bsdf": tiles([0.003, 0.003, 0.003], [0.75, 0.73, 0.7], 12),
        },
        "wall": {"type": "rectangle", "to_world": place().translate([0, 0, -1.8]).scale(4), "bsdf": white},
        "panel": {
            "type": "cube",
            "to_world": place().translate([0.75, -0.35, -1.3]).scale([0.7, 0.65, 0.04]),
            "bsdf": plastic,
        },
        "ball": {"type": "sphere", "to_world": place().translate([0.75, -0.65, -0.2]).scale(0.35), "bsdf": plastic},
        "plaster": {"type": "sphere", "to_world": place().translate([0.2, -0.8, 0.55]).scale(0.2), "bsdf": white},
        "nugget": {"type": "sphere", "to_world": place().translate([-1.1, -0.7, -0.3]).scale(0.3), "bsdf": gold},
        "vase": sheet("vase", vase, rubber),
        "tire": sheet("tire", tire, rubber),
        "cube": {"type": "cube", "to_world": place().scale(0.2), "bsdf": plastic},
    }

    def view(t: float) -> Camera:
        x = -0.5 + t
        return Camera.from_look_at([x, 0.3, 4.2], [0.5 * x, -0.5, 0], [0, 1, 0], 28, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return {"cube": rigid([0.1, 1, 0.2], 70 * t, [-0.7 + 0.5 * t, -0.1 + 0.1 * np.sin(np.pi * t), -0.2])}

    return animate(scene, frames, view, poses)


@builder
def glassware(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Rough glass before checks, a clear ball and rod, and a mirror, filmed in passing: guides show the glass alone.

    The checks are seen blurred through a pane of rough glass, and distorted through clear glass. No buffer shows them
    there, and they do not move as the glass does. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    clear: dict[str, Any] = {"type": "dielectric", "int_ior": "bk7"}
    frosted: dict[str, Any] = {"type": "roughdielectric", "int_ior": "bk7", "alpha": 0.12}
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 10},
        # Light from everywhere: glass would focus that of small lights to caustics, which `unseen` has.
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.8, 0.82, 0.85]}},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.3, 0.2, 0.15], [0.6, 0.5, 0.4], 14),
        },
        "checks": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": tiles([0.05, 0.06, 0.1], [0.85, 0.83, 0.78], 24),
        },
        "pane": {
            "type": "cube",
            "to_world": place().translate([-0.8, -0.3, -0.9]).scale([0.6, 0.7, 0.05]),
            "bsdf": frosted,
        },
        "mirror": {
            "type": "rectangle",
            "to_world": place().translate([0.95, -0.1, -1.2]).rotate([0, 1, 0], -25).scale([0.5, 0.7, 1]),
            "bsdf": {"type": "twosided", "nested": {"type": "conductor", "material": "Ag"}},
        },
        "ball": {"type": "sphere", "to_world": place().translate([0.1, -0.65, 0]).scale(0.35), "bsdf": clear},
        "frosted ball": {
            "type": "sphere",
            "to_world": place().translate([-0.8, -0.75, 0.3]).scale(0.25),
            "bsdf": frosted,
        },
        "rod": {"type": "cylinder", "p0": [0.6, -1, 0.2], "p1": [0.6, 0, 0.2], "radius": 0.1, "bsdf": clear},
        "cube": {
            "type": "cube",
            "to_world": place().translate([1.1, -0.75, 0.2]).rotate([0, 1, 0], 30).scale(0.25),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "matt ball": {
            "type": "sphere",
            "to_world": place().translate([-0.3, -0.8, -0.6]).scale(0.2),
            "bsdf": tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5),
        },
    }

    def view(t: float) -> Camera:
        x = -0.55 + 1.1 * t
        return Camera.from_look_at([x, 0.25, 4.3], [0.45 * x, -0.3, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def naked_lamps(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Small bulbs, hundreds of times as bright as what they light, over glossy plates and balls; no other light.

    The bulbs are seen directly and mirrored in everything, some in less than a pixel, and between them it is dark. Only
    the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.2, 0.21, 0.25], [0.6, 0.57, 0.5], 14),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": glaze([0.35, 0.38, 0.45], 0.2),
        },
    }
    colors = ([1, 0.75, 0.5], [0.6, 0.75, 1], [1, 0.9, 0.75], [1, 0.45, 0.3], [0.5, 1, 0.7])
    spots = [(-1.2, 0.35, -0.8), (-0.55, 0.7, -1.2), (0.1, 0.45, -0.5), (0.7, 0.75, -1.0), (1.25, 0.3, -0.6)]
    for i, (color, spot) in enumerate(zip(colors, spots, strict=True)):
        radius = (0.02, 0.045, 0.03, 0.035, 0.025)[i]
        scene[f"bulb-{i}"] = {
            "type": "sphere",
            "to_world": place().translate(spot).scale(radius),
            # All send out the same power.
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [0.5 * c / radius**2 for c in color]}},
        }
        scene[f"wire-{i}"] = {
            "type": "cylinder",
            "p0": [spot[0], spot[1] + radius, spot[2]],
            "p1": [spot[0], 3, spot[2]],
            "radius": 0.008,
            "bsdf": {"type": "twosided", "nested": paint([0.1, 0.1, 0.1])},
        }
    metal = {"type": "roughconductor", "material": "Al"}
    for i, alpha in enumerate((0.05, 0.12, 0.25)):
        scene[f"plate-{i}"] = {
            "type": "cube",
            "to_world": place()
            .translate([0, -0.75 - 0.08 * i, -0.9 + 0.6 * i])
            .rotate([1, 0, 0], 14)
            .scale([1.3, 0.02, 0.22]),
            "bsdf": glaze([0.06, 0.12, 0.2], alpha) if i == 1 else {**metal, "alpha": alpha},
        }
    scene["metal ball"] = {
        "type": "sphere",
        "to_world": place().translate([-0.75, -0.4, -0.2]).scale(0.25),
        "bsdf": {**metal, "alpha": 0.1},
    }
    scene["plastic ball"] = {
        "type": "sphere",
        "to_world": place().translate([0.7, -0.4, -0.1]).scale(0.25),
        "bsdf": glaze([0.5, 0.08, 0.06], 0.08),
    }

    def view(t: float) -> Camera:
        x = -0.5 + t
        return Camera.from_look_at([x, 0.5, 4.2], [0.5 * x, -0.25, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def grass(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A dense meadow against a bright sky, from low down, in passing: blades thinner than pixels, the sky between them.

    Where a sample misses all blades it sees the environment directly: no depth, no albedo, no id, but the brightest
    colour in the image. All blades are one shape, and so are all hairs of the ears. Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f
    rng = np.random.default_rng(7)
    count = 1100
    spots = np.stack([rng.uniform(-2.6, 2.6, count), rng.uniform(-3.2, 1.2, count)], -1)
    stems = np.array(
        [similarity([x, 0, z], rng.uniform(0.6, 1.5), rng.uniform(0, 360), rng.uniform(2, 20)) for x, z in spots]
    )
    # A blade bends as it rises and narrows to a point.
    rise = np.linspace(0, 1, 6)
    bend, half = 0.25 * rise**2, 0.016 * (1 - rise**2)
    blade = np.stack([np.concatenate([bend, bend]), np.tile(rise, 2), np.concatenate([-half, half])], -1)
    strips = [[i, i + 1, 6 + i] for i in range(5)] + [[i + 1, 7 + i, 6 + i] for i in range(5)]
    # On every fourth blade is an ear of hairs.
    hairs = np.array(
        [similarity([0.25 * y**2, y, 0], 0.16, 137.5 * n, 35) for n, y in enumerate(np.linspace(0.7, 1, 14))]
    )
    ears = (stems[::4, None] @ hairs).reshape(-1, 4, 4)
    hair = np.array([[0, 0, -0.012], [0, 0, 0.012], [0, 1, 0]])
    tints = rng.uniform(0.5, 1.3, (count, 1)) * [0.2, 0.4, 0.09]
    tints[:, 0] *= rng.uniform(0.8, 2, count)
    straw = rng.uniform(0.7, 1.2, (len(ears), 1)) * [0.6, 0.48, 0.25]
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([0.6, 0.55, 0.35]))},
        "ground": {
            "type": "rectangle",
            "to_world": place().rotate([1, 0, 0], -90).scale(30),
            "bsdf": tiles([0.2, 0.16, 0.1], [0.3, 0.25, 0.16], 60),
        },
        "blades": copies("blades", blade, strips, stems, np.minimum(tints, 0.9)),
        "hairs": copies("hairs", hair, [[0, 1, 2]], ears, np.minimum(straw, 0.9)),
    }

    def view(t: float) -> Camera:
        x = -0.35 + 0.7 * t
        return Camera.from_look_at([x, 0.6, 4.2], [0.5 * x, 0.95, 0], [0, 1, 0], 30, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def fast_dolly(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A camera that runs up to a wall of matt and glossy things: each frame's distance is 88 % of the last one's.

    Depth changes by 12 % a frame: more than a depth test tolerates without the third channel of motion. The size of
    texels on the screen changes as fast. The pace does not depend on the number of frames; after the sixteenth, the
    camera runs back. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": 0.25},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([3, 4, 5], [0, 0, 0], [0, 1, 0]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [21.0, 20.0, 18.0]}},
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().scale(8),
            "bsdf": tiles([0.4, 0.3, 0.24], [0.62, 0.55, 0.46], 48),
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(12),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 30),
        },
        "rings": {
            "type": "rectangle",
            "to_world": place().translate([-0.1, 0.05, 0.03]).scale([0.8, 0.6, 1]),
            "bsdf": picture(rings(1024, 220)),
        },
        "shelf": {
            "type": "cube",
            "to_world": place().translate([0.1, -0.3, 0.1]).scale([1.1, 0.02, 0.1]),
            "bsdf": glaze([0.3, 0.16, 0.08], 0.15),
        },
        "plastic ball": {
            "type": "sphere",
            "to_world": place().translate([0.12, -0.18, 0.12]).scale(0.1),
            "bsdf": glaze([0.1, 0.25, 0.5], 0.08),
        },
        "metal ball": {
            "type": "sphere",
            "to_world": place().translate([-0.22, -0.19, 0.12]).scale(0.09),
            "bsdf": {"type": "roughconductor", "material": "Cu", "alpha": 0.15},
        },
        "cube": {
            "type": "cube",
            "to_world": place().translate([0.42, -0.2, 0.12]).rotate([0, 1, 0], 30).scale(0.08),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 4),
        },
    }
    for i, (x, y) in enumerate([(-1.5, 0.3), (1.3, 0.5), (-0.9, -0.75), (1.6, -0.6), (0.1, 1.1)]):
        scene[f"boss-{i}"] = {
            "type": "sphere",
            "to_world": place().translate([x, y, -0.1]).scale(0.3),
            "bsdf": glaze([0.5, 0.45, 0.1], 0.2) if i % 2 else tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 8),
        }

    def view(frame: int) -> Camera:
        distance = 10 * 0.88 ** (15 - abs(15 - frame % 30))
        return Camera.from_look_at(
            [0.02 * distance, 0.03 * distance, distance], [0, 0, 0], [0, 1, 0], FOV, width, height, fov_axis="y"
        )

    still: list[dict[str, Any]] = [{} for _ in range(frames)]
    return Sequence(scene, [view(i) for i in range(frames)], still, still)
