"""Scenes to measure on, with their cameras and motion: everything `yester.io.mitsuba.render_sequence` asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import Camera

__all__ = ["Sequence", "cornell_box"]

#: Vertical field of view in degrees: at 4:3, the box fills the image.
_FOV = 33


@dataclass(frozen=True)
class Sequence:
    """A scene in motion.

    Attributes
    ----------
    scene : dict
        For `mitsuba.load_dict`.
    cameras : list of Camera
        One for every frame.
    transforms : list of dict
        For every frame, the (4, 4) matrices, by shape, that take the moving shapes from where the scene puts them to
        where they are.
    """

    scene: dict[str, Any]
    cameras: list[Camera]
    transforms: list[dict[str, NDArray[np.float64]]]


def cornell_box(frames: int = 24, width: int = 320, height: int = 240) -> Sequence:
    """Mitsuba's Cornell box, made harder: textures, a glossy ball, a cube that flies and turns, a camera that moves.

    The textures show blur; the ball's highlight moves unlike its surface, which motion vectors do not know; the cube
    covers and uncovers, and its light and shadow change as it goes. However many the frames, they
    divide the same flight: with fewer, more moves from one to the next.

    Parameters
    ----------
    frames : int
        Number of frames, at least 1.
    width, height : int
        Of the images, in pixels.

    Returns
    -------
    Sequence
        The moving shape is called `"cube"`.

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    """
    try:
        import mitsuba as mi
    except ImportError as error:
        raise ImportError("the Cornell box needs Mitsuba: pip install 'yester[mitsuba]'") from error
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    place = mi.ScalarTransform4f

    scene: dict[str, Any] = mi.cornell_box()
    del scene["small-box"], scene["sensor"]
    scene["floor"]["bsdf"] = _tiles([0.75, 0.72, 0.68], [0.3, 0.29, 0.31], 4)
    scene["poster"] = {
        "type": "rectangle",
        "to_world": place().translate([0.2, 0.3, -0.99]).scale([0.6, 0.45, 1]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": mi.Bitmap(_rings()), "raw": True}},
    }
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
        "bsdf": _tiles([0.1, 0.3, 0.7], [0.85, 0.75, 0.3], 1.5),
    }
    times = np.linspace(0, 1, frames)
    return Sequence(scene, [_view(t, width, height) for t in times], [{"cube": _flight(t)} for t in times])


def _view(t: float, width: int, height: int) -> Camera:
    """An arc of 22 degrees around the middle of the box, rising and closing in a little; t from 0 to 1."""
    angle = np.radians(-11 + 22 * t)
    distance = 3.4 - 0.15 * t
    origin = [distance * np.sin(angle), 0.1 + 0.1 * t, distance * np.cos(angle)]
    return Camera.from_look_at(origin, [0, 0, 0], [0, 1, 0], _FOV, width, height, fov_axis="y")


def _flight(t: float) -> NDArray[np.float64]:
    """Where the cube is: a leap through the box while turning by 60 degrees about a tilted axis."""
    axis = np.array([0.3, 1, 0.2]) / np.linalg.norm([0.3, 1, 0.2])
    angle = np.radians(20 + 60 * t)
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    pose[:3, 3] = [-0.5 + 0.7 * t, -0.4 + 0.2 * np.sin(np.pi * t), 0.35 - 0.1 * t]
    return pose


def _tiles(dark: list[float], bright: list[float], repeat: float) -> dict[str, Any]:
    """A diffuse checkerboard."""
    import mitsuba as mi

    return {
        "type": "diffuse",
        "reflectance": {
            "type": "checkerboard",
            "color0": {"type": "rgb", "value": dark},
            "color1": {"type": "rgb", "value": bright},
            "to_uv": mi.ScalarTransform4f().scale([repeat, repeat, 1]),
        },
    }


def _rings(size: int = 256) -> NDArray[np.float32]:
    """A picture of every spatial frequency: rings that grow finer towards the corners."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    rings = 0.5 + 0.5 * np.cos(40 * np.hypot(x, y) ** 1.5)
    sectors = 0.5 + 0.5 * np.cos(3 * np.arctan2(y, x))
    return np.stack([0.15 + 0.7 * rings, 0.2 + 0.5 * rings * sectors, 0.75 - 0.4 * rings], -1).astype(np.float32)
