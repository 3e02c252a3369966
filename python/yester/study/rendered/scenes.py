"""Scenes to measure on, with their cameras and motion: everything `yester.io.mitsuba.render_sequence` asks for.

Each makes something else hard. However many the frames, they divide the same events: with fewer, more happens from one
to the next. With 24 frames of 320×240, surfaces move by one to six pixels.
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
    printed,
    rigid,
    rings,
    sheet,
    similarity,
    sky,
    tiles,
    tube,
    weave,
)

__all__ = [
    "HELD_OUT",
    "SEQUENCES",
    "TUNING",
    "Sequence",
    "cornell_box",
    "glossy_plates",
    "many_lights",
    "mirror_room",
    "moving_light",
    "spinning_shapes",
    "sunlit_teapot",
    "switched_light",
    "tapestry",
    "thicket",
]

#: The sequences that parameters may be tuned on, those that only tell what the tuning is worth, and all of them.
TUNING = ("cornell_box", "switched_light", "glossy_plates", "thicket", "spinning_shapes")
HELD_OUT = ("mirror_room", "many_lights", "sunlit_teapot", "tapestry", "moving_light")
SEQUENCES = TUNING + HELD_OUT


@builder
def cornell_box(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Mitsuba's Cornell box, made harder: textures, a glossy ball, a cube that flies and turns, a camera that moves.

    The textures show blur; the ball's highlight moves unlike its surface, which motion vectors do not know; the cube
    covers and uncovers, and its light and shadow change as it goes. The moving shape is called `"cube"`.
    """
    scene = _room()
    place = mitsuba().ScalarTransform4f
    del scene["small-box"]
    scene["ball"] = {
        "type": "sphere",
        "to_world": place().translate([0.5, -0.7, -0.3]).scale(0.3),
        "bsdf": {
            "type": "roughplastic",
            "diffuse_reflectance": {"type": "rgb", "value": [0.6, 0.4, 0.1]},
            "alpha": 0.15,
        },
    }
    scene["cube"] = {
        "type": "cube",
        "to_world": place().scale(0.2),
        "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 1.5),
    }
    return animate(scene, frames, lambda t: box_view(t, width, height), lambda t: {"cube": box_flight(t)})


@builder
def switched_light(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A Cornell box whose lights are switched while the camera turns: what was known of light is wrong at once.

    At frame ``frames // 3`` the ceiling's light goes off, which leaves a dim blue ball on the small box, and at frame
    ``2 * frames // 3`` a small red one comes on behind the large box. Nothing moves but the camera. The lights are
    called `"light"` and `"lamp"`.
    """
    scene = _room()
    place = mitsuba().ScalarTransform4f
    scene["lamp"] = {
        "type": "sphere",
        "to_world": place().translate([-0.7, 0.15, -0.5]).scale(0.09),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 0.0}},
    }
    scene["glow"] = {
        "type": "sphere",
        "to_world": place().translate([0.33, -0.25, 0.38]).scale(0.1),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3.5, 4.5, 7.0]}},
    }
    off, on = frames // 3, 2 * frames // 3
    sequence = animate(scene, frames, lambda t: box_view(0.1 + 0.8 * t, width, height))
    for values in sequence.parameters[off:]:
        values["light.emitter.radiance.value"] = [0.0, 0.0, 0.0]
    for values in sequence.parameters[on:]:
        values["lamp.emitter.radiance.value"] = [36.0, 14.0, 6.0]
    return sequence


@builder
def glossy_plates(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Plates from nearly smooth to rough under balls of light, seen in passing: reflections go their own way.

    After Veach's scene for multiple importance sampling: each plate mirrors all lights, the smoother the sharper. The
    reflections move like what is behind the plate, not like its surface. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    eye, lights = np.array([0.0, 1.6, 6.0]), np.array([0.0, 1.9, -1.4])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": 0.2},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(8),
            "bsdf": tiles([0.25, 0.25, 0.28], [0.45, 0.43, 0.4], 10),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -3]).scale(8),
            "bsdf": tiles([0.3, 0.35, 0.4], [0.5, 0.45, 0.4], 10),
        },
    }
    colors = ([1.0, 0.35, 0.25], [1.0, 0.9, 0.4], [0.4, 1.0, 0.5], [0.4, 0.55, 1.0])
    for i, (color, radius) in enumerate(zip(colors, (0.06, 0.12, 0.22, 0.35), strict=True)):
        scene[f"light-{i}"] = {
            "type": "sphere",
            "to_world": place().translate([1.2 * i - 1.8, *lights[1:]]).scale(radius),
            # All send out the same power.
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [0.2 * c / radius**2 for c in color]}},
        }
    for i, alpha in enumerate((0.02, 0.06, 0.15, 0.3)):
        center = np.array([0, -0.1 - 0.3 * i, -1.1 + 0.75 * i])
        normal = sum((aim - center) / np.linalg.norm(aim - center) for aim in (eye, lights))
        tilt = float(np.degrees(np.arctan2(normal[2], normal[1])))
        metal = {"type": "roughconductor", "material": "Al", "alpha": alpha}
        plastic = {
            "type": "roughplastic",
            "diffuse_reflectance": {"type": "rgb", "value": [0.1, 0.2, 0.3]},
            "alpha": alpha,
        }
        scene[f"plate-{i}"] = {
            "type": "cube",
            "to_world": place().translate(center).rotate([1, 0, 0], tilt).scale([2, 0.02, 0.3]),
            "bsdf": plastic if i == 2 else metal,
        }

    def view(t: float) -> Camera:
        angle = np.radians(-9 + 18 * t)
        origin = [eye[2] * np.sin(angle), eye[1], eye[2] * np.cos(angle)]
        return Camera.from_look_at(origin, [0, 0.3, 0], [0, 1, 0], 35, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def mirror_room(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Textured shapes on a polished floor before a mirror, filmed in passing: everything is seen twice or more.

    The mirror is perfect, the floor nearly so. What they show moves like what is behind them; and a ball rolls through
    the room, whose reflections move over surfaces that stand still. The moving shape is called `"ball"`.
    """
    place = mitsuba().ScalarTransform4f
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6},
        # Light from everywhere: mirrors would focus that of small lights to more noise than one can look through.
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.7, 0.75, 0.85]}},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": {"type": "roughconductor", "material": "Al", "alpha": 0.03},
        },
        "mirror": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.5]).scale([1.8, 1, 1]),
            "bsdf": {"type": "conductor", "material": "Ag"},
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.6]).scale(4),
            "bsdf": tiles([0.45, 0.2, 0.15], [0.6, 0.5, 0.4], 12),
        },
        "front": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, 6]).rotate([0, 1, 0], 180).scale([4, 2.5, 1]),
            "bsdf": picture(),
        },
        "ball": {
            "type": "sphere",
            "to_world": place().scale(0.45),
            "bsdf": tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5),
        },
        "cube": {
            "type": "cube",
            "to_world": place().translate([0.7, -0.65, -0.2]).rotate([0, 1, 0], 25).scale(0.35),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "column": {
            "type": "cube",
            "to_world": place().translate([0.05, -0.3, -0.7]).rotate([0, 1, 0], 40).scale([0.15, 0.7, 0.15]),
            "bsdf": tiles([0.15, 0.5, 0.3], [0.9, 0.9, 0.85], 3),
        },
    }

    def view(t: float) -> Camera:
        x = -0.6 + 1.2 * t
        return Camera.from_look_at([x, 0.35, 4.4], [0.4 * x, -0.15, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        path = 0.9 * t
        return {"ball": rigid([0, 0, 1], -np.degrees(path / 0.45), [path - 1.2, -0.55, 0.25])}

    return animate(scene, frames, view, poses)


@builder
def thicket(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Bushes of thin twigs and leaves under sun and sky, in passing: more edges than pixels, and gaps that open.

    The bushes are grown by an iterated function system: every twig carries smaller copies of itself. All twigs are one
    shape and all leaves another, so that ids do not tell them apart. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    rng = np.random.default_rng(4)
    # A twig goes from the origin to (0, 1, 0): at its end it forks in three, and from its middle a fourth grows.
    maps = np.array(
        [
            *(similarity([0, 1, 0], 0.7, turn, 33) for turn in (0, 120, 240)),
            similarity([0, 0.55, 0], 0.55, 75, 50),
        ]
    )
    spots = [(-1.9, -0.7), (-0.8, 0.2), (0.3, -0.9), (1.2, 0.1), (2.2, -0.8), (-1.2, -2.1), (0.9, -2.3)]
    generation = np.array([similarity([x, 0, z], rng.uniform(0.5, 0.7), rng.uniform(0, 360), 5) for x, z in spots])
    twigs = [generation]
    for _ in range(4):
        generation = (generation[:, None] @ maps).reshape(-1, 4, 4)
        twigs.append(generation)
    stems = np.concatenate(twigs)
    sprays = np.array([similarity([0, y, 0], 0.55, turn, 60) for y, turn in ((0.5, 30), (0.8, 160), (1, 280))])
    leaves = (generation[:, None] @ sprays).reshape(-1, 4, 4)
    corners = np.radians([0, 120, 240])
    ring = np.stack([np.cos(corners), np.zeros(3), np.sin(corners)], -1)
    prism = np.concatenate([0.035 * ring, 0.022 * ring + [0, 1, 0]])
    sides = [[i, (i + 1) % 3, 3 + i] for i in range(3)] + [[(i + 1) % 3, 3 + (i + 1) % 3, 3 + i] for i in range(3)]
    leaf = np.array([[0, 0, 0], [0.3, 0.5, 0.08], [0, 1, 0], [-0.3, 0.5, 0.08]])
    tints = rng.uniform(0.6, 1.4, (len(leaves), 1)) * [0.22, 0.42, 0.08]
    tints[:, 0] *= rng.uniform(0.7, 2, len(leaves))
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.35, 0.45, 0.6]}},
        "sun": {
            "type": "sphere",
            "to_world": place().translate([6, 12, 7]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [110.0, 95.0, 70.0]}},
        },
        "ground": {
            "type": "rectangle",
            "to_world": place().rotate([1, 0, 0], -90).scale(10),
            "bsdf": tiles([0.3, 0.24, 0.16], [0.42, 0.36, 0.25], 24),
        },
        "twigs": copies("twigs", prism, sides, stems, np.broadcast_to([0.33, 0.22, 0.13], (len(stems), 3))),
        "leaves": copies("leaves", leaf, [[0, 1, 2], [0, 2, 3]], leaves, np.minimum(tints, 0.9)),
    }

    def view(t: float) -> Camera:
        x = -0.5 + t
        return Camera.from_look_at([x, 1.1, 4.2], [0.6 * x, 0.75, 0], [0, 1, 0], 32, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def spinning_shapes(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Textured shapes that fly and spin before a textured wall, filmed in passing: everything moves its own way.

    They cover and uncover the wall and each other, and show and hide their own sides; edges and textures in motion are
    what antialiasing has to cope with. The moving shapes are called `"ball"`, `"cube"` and `"disk"`.
    """
    place = mitsuba().ScalarTransform4f
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "constant", "radiance": 0.25},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([1.5, 4, 3], [0, 0, 0], [0, 1, 0]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [13.0, 12.0, 11.0]}},
        },
        "wall": {"type": "rectangle", "to_world": place().translate([0, 0, -1.5]).scale([3, 3, 1]), "bsdf": picture()},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 10),
        },
        "ball": {"type": "sphere", "radius": 0.45, "bsdf": tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5)},
        "cube": {"type": "cube", "to_world": place().scale(0.3), "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2)},
        "disk": {
            "type": "disk",
            "to_world": place().scale(0.5),
            "bsdf": {"type": "twosided", "nested": tiles([0.15, 0.5, 0.3], [0.9, 0.9, 0.85], 4)},
        },
    }

    def view(t: float) -> Camera:
        x = -0.4 + 0.8 * t
        return Camera.from_look_at([x, 0.3, 4.6], [0.9 * x, -0.05, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        return {
            "ball": rigid([0.2, 1, 0.1], 90 * t, [-0.9 + 0.25 * t, -0.45, 0.3]),
            "cube": rigid([1, 0.6, 0.3], 70 * t, [1.1 - 0.9 * t, -0.35 + 0.7 * t, 0.1]),
            "disk": rigid([0, 1, 0.4], -50 + 100 * t, [0.1 + 0.5 * t, 0.45 - 0.5 * t, -0.6]),
        }

    return animate(scene, frames, view, poses)


@builder
def many_lights(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Strings of coloured lights above a crowd of shapes at night, in passing: every sample finds one light of 30.

    What it finds is often faint, hidden or of the wrong colour, so that light is noisy in brightness and hue, and every
    shape has dozens of soft shadows. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    rng = np.random.default_rng(11)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.015, 0.02, 0.04]}},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.25, 0.16, 0.1], [0.5, 0.36, 0.24], 14),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.8]).scale(4),
            "bsdf": tiles([0.35, 0.38, 0.45], [0.5, 0.5, 0.52], 16),
        },
    }
    warm, amber = [1, 0.65, 0.35], [1, 0.4, 0.1]
    red, green, blue, pink = [1, 0.004, 0.002], [0.004, 0.6, 0.01], [0.003, 0.02, 1], [1, 0.004, 0.35]
    tints = (amber, red, green, blue, pink, warm)
    for row, (depth, top) in enumerate([(-1.2, 0.75), (-0.5, 0.6), (0.25, 0.45)]):
        for i, x in enumerate(np.linspace(-2, 2, 10)):
            sag = 0.35 * np.sin(np.pi * (x / 1.8 + 0.3 * row)) ** 2
            tint = tints[rng.integers(len(tints))]
            scene[f"light-{row}-{i}"] = {
                "type": "sphere",
                "to_world": place().translate([x, top - sag, depth]).scale(0.055),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [48.0 * c for c in tint]}},
            }
    materials = [
        tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 4),
        {"type": "roughconductor", "material": "Au", "alpha": 0.2},
        paint([0.15, 0.4, 0.6]),
        glaze([0.5, 0.1, 0.2], 0.1),
        tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        paint([0.75, 0.72, 0.65]),
        {"type": "roughconductor", "material": "Al", "alpha": 0.3},
    ]
    spots = [(x + rng.uniform(-0.1, 0.1), z) for z in (-1.2, -0.4, 0.5) for x in np.linspace(-1.6, 1.6, 6) + 0.25 * z]
    for i, (x, z) in enumerate(spots):
        size = rng.uniform(0.17, 0.26)
        half = size * (rng.uniform(1, 2.2) if i % 2 else 1)
        where = place().translate([x, half - 1, z]).rotate([0, 1, 0], rng.uniform(0, 90))
        scene[f"shape-{i}"] = {
            "type": "cube" if i % 2 else "sphere",
            "to_world": where.scale([size, half, size]),
            "bsdf": materials[i % len(materials)],
        }

    def view(t: float) -> Camera:
        x = -0.55 + 1.1 * t
        return Camera.from_look_at([x, 0.6, 3.6], [0.45 * x, -0.35, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def sunlit_teapot(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A teapot and other vessels in the sun, from polished to matt, circled by the camera.

    Light comes from a picture of sky and ground with a small sun in it, a thousand times as bright: shadows are sharp,
    and each curved glossy surface has a highlight that moves its own way. Metal throws bright specks onto the table,
    found by few samples. Only the camera moves.
    """
    mi = mitsuba()
    place = mi.ScalarTransform4f
    pot = glaze([0.62, 0.12, 0.07], 0.06)
    body = lathe([[0.32, 0], [0.8, 0.1], [0.62, 0.75], [0.3, 0.68]])
    lid = lathe([[0.32, 0.67], [0.3, 0.8], [0.05, 0.76], [0.04, 0.83]])
    spout = tube([[0.42, 0.2], [0.85, 0.15], [0.68, 0.55], [0.92, 0.68]], 0.13, 0.05)
    handle = tube([[-0.45, 0.55], [-1.1, 0.75], [-0.95, 0.05], [-0.5, 0.18]], 0.045, 0.045)
    cup = lathe([[0.1, 0.02], [0.3, 0], [0.2, 0.25], [0.3, 0.38]], [0.95, 0, 0.75])
    bowl = lathe([[0.12, 0], [0.5, 0.05], [0.25, 0.3], [0.36, 0.32]], [-0.75, 0, 0.85])
    jug = lathe([[0.22, 0], [0.6, 0.3], [0.02, 0.6], [0.24, 0.95]], [1.25, 0, -0.35])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky([-0.55, 0.5, 0.45]))},
        "table": {
            "type": "cube",
            "to_world": place().translate([0, -0.05, 0]).scale([2.2, 0.05, 1.5]),
            "bsdf": tiles([0.45, 0.4, 0.34], [0.68, 0.64, 0.56], 9),
        },
        "body": sheet("body", body, pot),
        "lid": sheet("lid", lid, pot),
        "knob": {"type": "sphere", "to_world": place().translate([0, 0.86, 0]).scale(0.065), "bsdf": pot},
        "spout": sheet("spout", spout, pot),
        "handle": sheet("handle", handle, pot),
        "cup": sheet("cup", cup, {"type": "roughconductor", "material": "Cu", "alpha": 0.18}),
        "bowl": sheet("bowl", bowl, paint([0.5, 0.3, 0.2])),
        "jug": sheet("jug", jug, glaze([0.1, 0.25, 0.45], 0.2)),
        "ball": {
            "type": "sphere",
            "to_world": place().translate([-1.3, 0.3, -0.2]).scale(0.3),
            "bsdf": {"type": "roughconductor", "material": "Al", "alpha": 0.05},
        },
    }

    def view(t: float) -> Camera:
        angle = np.radians(-8 + 16 * t)
        origin = [4.3 * np.sin(angle), 1.45, 4.3 * np.cos(angle)]
        return Camera.from_look_at(origin, [0, 0.3, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def tapestry(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A tapestry in folds, a carpet, a book and a picture of fine rings, in passing: textures down to a pixel or two.

    Everything is matt, and its light soft and still: nothing but textures can be lost. Only the camera moves.
    """
    place = mitsuba().ScalarTransform4f
    wood = paint([0.25, 0.14, 0.08])
    down, along = np.mgrid[:2, :97] / [[[1]], [[96]]]
    folds = (0.09 - 0.05 * down) * np.sin(9 * np.pi * along + np.sin(5 * along))
    cloth = np.stack([-1.55 + 1.45 * along, -0.75 + 1.75 * down, -1.3 + folds], -1)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": 0.2},
        "light": {
            "type": "rectangle",
            "to_world": place().look_at([1.5, 3.5, 3.5], [0, -0.2, -0.5], [0, 1, 0]).scale(0.8),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [34.0, 32.0, 28.0]}},
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.5]).scale(4),
            "bsdf": paint([0.55, 0.58, 0.55]),
        },
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.32, 0.2, 0.12], [0.38, 0.25, 0.15], 12),
        },
        "carpet": {
            "type": "rectangle",
            "to_world": place().translate([0, -0.99, 0.15]).rotate([1, 0, 0], -90).scale([1.7, 0.85, 1]),
            "bsdf": picture(weave(160, 80)),
        },
        "tapestry": sheet("tapestry", cloth, picture(weave(76, 92)), closed=False),
        "rod": {"type": "cylinder", "p0": [-1.65, 1, -1.3], "p1": [-0.05, 1, -1.3], "radius": 0.035, "bsdf": wood},
        "frame": {
            "type": "cube",
            "to_world": place().translate([0.85, 0.4, -1.47]).scale([0.62, 0.52, 0.05]),
            "bsdf": wood,
        },
        "picture": {
            "type": "rectangle",
            "to_world": place().translate([0.85, 0.4, -1.41]).scale([0.56, 0.46, 1]),
            "bsdf": picture(rings(512, 110)),
        },
        "stand": {
            "type": "cube",
            "to_world": place().translate([0.75, -0.7, -0.1]).scale([0.5, 0.3, 0.25]),
            "bsdf": wood,
        },
    }
    book = place().translate([0.75, -0.14, 0]).rotate([1, 0, 0], -35)
    for name, side in (("left page", -1), ("right page", 1)):
        scene[name] = {
            "type": "rectangle",
            "to_world": book.translate([0.262 * side, 0, 0]).rotate([0, 1, 0], -12 * side).scale([0.265, 0.36, 1]),
            "bsdf": picture(printed(22, 14, seed=2 + side)),
        }

    def view(t: float) -> Camera:
        x = -0.55 + 1.1 * t
        return Camera.from_look_at([x, 0.35, 4.3], [0.45 * x, -0.05, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    return animate(scene, frames, view)


@builder
def moving_light(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """A lamp that swings and turns before textured shapes and a fence: light and shadows sweep over what stands still.

    The lamp itself is in view only for a while. The moving shapes are called `"lamp"`, `"shade"` and `"lid"`, and move
    as one.
    """
    place = mitsuba().ScalarTransform4f
    green, wood = {"type": "twosided", "nested": paint([0.1, 0.35, 0.25])}, paint([0.6, 0.55, 0.45])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.08, 0.1, 0.14]}},
        "floor": {
            "type": "rectangle",
            "to_world": place().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(4),
            "bsdf": tiles([0.3, 0.29, 0.31], [0.75, 0.72, 0.68], 12),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.5]).scale(4),
            "bsdf": tiles([0.55, 0.4, 0.3], [0.65, 0.55, 0.45], 20),
        },
        "picture": {
            "type": "rectangle",
            "to_world": place().translate([0.2, 0.25, -1.49]).scale([0.6, 0.45, 1]),
            "bsdf": picture(),
        },
        "ball": {
            "type": "sphere",
            "to_world": place().translate([0.75, -0.65, 0.1]).scale(0.35),
            "bsdf": tiles([0.8, 0.2, 0.15], [0.85, 0.8, 0.7], 5),
        },
        "cube": {
            "type": "cube",
            "to_world": place().translate([-0.85, -0.7, 0.1]).rotate([0, 1, 0], 30).scale(0.3),
            "bsdf": tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 2),
        },
        "rail": {
            "type": "cube",
            "to_world": place().translate([0, 0.08, -0.5]).scale([0.75, 0.04, 0.05]),
            "bsdf": wood,
        },
        "shade": {"type": "cylinder", "p0": [0, -0.03, 0], "p1": [0, 0.1, 0], "radius": 0.18, "bsdf": green},
        "lid": {
            "type": "disk",
            "to_world": place().translate([0, 0.1, 0]).rotate([1, 0, 0], -90).scale(0.18),
            "bsdf": green,
        },
        "lamp": {
            "type": "disk",
            "to_world": place().rotate([1, 0, 0], 90).scale(0.06),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [2000.0, 1700.0, 1250.0]}},
        },
    }
    for i in range(7):
        x = -0.6 + 0.2 * i
        scene[f"post-{i}"] = {
            "type": "cylinder",
            "p0": [x, -1, -0.5],
            "p1": [x, 0.05, -0.5],
            "radius": 0.035,
            "bsdf": wood,
        }

    def view(t: float) -> Camera:
        x = 0.4 - 0.8 * t
        return Camera.from_look_at([x, 0.3, 4.6], [0.5 * x, -0.1, 0], [0, 1, 0], FOV, width, height, fov_axis="y")

    def poses(t: float) -> dict[str, Matrix]:
        swing = rigid([0, 0, 1], 30 * np.cos(np.pi * (0.05 + 0.9 * t)), [0, 2.5, 1.5])
        pose = swing @ rigid([0, 1, 0], 40 * t - 20, [0, -1.6, 0]) @ rigid([1, 0, 0], 42, [0, 0, 0])
        return dict.fromkeys(("lamp", "shade", "lid"), pose)

    return animate(scene, frames, view, poses)


def box_view(t: float, width: int, height: int) -> Camera:
    """An arc of 22 degrees around the middle of the box, rising and closing in a little; t from 0 to 1."""
    angle = np.radians(-11 + 22 * t)
    distance = 3.4 - 0.15 * t
    origin = [distance * np.sin(angle), 0.1 + 0.1 * t, distance * np.cos(angle)]
    return Camera.from_look_at(origin, [0, 0, 0], [0, 1, 0], FOV, width, height, fov_axis="y")


def box_flight(t: float) -> Matrix:
    """Where the cube is: a leap through the box while turning by 60 degrees about a tilted axis."""
    return rigid([0.3, 1, 0.2], 20 + 60 * t, [-0.5 + 0.7 * t, -0.4 + 0.2 * np.sin(np.pi * t), 0.35 - 0.1 * t])


def _room() -> dict[str, Any]:
    """Mitsuba's Cornell box with a tiled floor and a picture on its back wall."""
    mi = mitsuba()
    scene: dict[str, Any] = mi.cornell_box()
    del scene["sensor"]
    scene["floor"]["bsdf"] = tiles([0.75, 0.72, 0.68], [0.3, 0.29, 0.31], 4)
    scene["poster"] = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0.2, 0.3, -0.99]).scale([0.6, 0.45, 1]),
        "bsdf": picture(),
    }
    return scene
