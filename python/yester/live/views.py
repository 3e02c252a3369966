"""The views of a frame: images in 8 bits for the screen, false colours where they are no colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import Frame, Output, rejection
from ..io.pictures import encoded

__all__ = ["VIEWS", "Moment", "View", "shown"]

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]


@dataclass
class Moment:
    """A frame, what its pipeline made of it, and what else is needed for some of the views.

    Attributes
    ----------
    frame : Frame
    output : Output
        Of the pipeline that is chosen.
    mean : (H, W, 3) float32
        Of all samples since something changed.
    extra : dict of str to (H, W, 3) float32
        Results of further pipelines, by the name of their view; None of those that are not installed.
    """

    frame: Frame
    output: Output
    mean: Floats
    extra: dict[str, Floats | None] = field(default_factory=dict)


class View(NamedTuple):
    """One of the images of a moment.

    Attributes
    ----------
    label : str
    key : str
        Chooses it for the right side; with shift, for the left one.
    about : str
        What is seen, with the meaning of its colours.
    image : callable
        From a moment and a factor of exposure to (H, W, 3) uint8; None if the moment has no such image.
    """

    label: str
    key: str
    about: str
    image: Callable[[Moment, float], Bytes | None]


def shown(name: str, moment: Moment, stops: float) -> Bytes:
    """The image of a view for the screen, (H, W, 4) uint8, opaque; grey where there is none."""
    image = VIEWS[name].image(moment, 2.0**stops)
    whole = np.full((*moment.frame.shape, 4), 255, np.uint8)
    whole[..., :3] = 64 if image is None else image
    return whole


@cache
def _curve() -> Bytes:
    """The sRGB bytes of all float16 values: black for NaN and negative ones."""
    values = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
    return encoded(values)


def _screen(color: Floats | None, factor: float) -> Bytes | None:
    if color is None:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        halves = (color * np.float32(factor)).astype(np.float16)
    return np.asarray(_curve()[halves.view(np.uint16)])


@cache
def _ramp(name: str) -> Bytes:
    from matplotlib import colormaps

    return np.asarray(colormaps[name](np.arange(256), bytes=True)[:, :3], np.uint8)


def _bytes(values: NDArray[np.floating[Any]]) -> Bytes:
    return np.asarray(np.nan_to_num(values).clip(0, 1) * 255 + 0.5).astype(np.uint8)


def _colored(values: Floats | None, name: str = "viridis") -> Bytes | None:
    """False colours of values from 0 to 1."""
    if values is None:
        return None
    return np.asarray(_ramp(name)[_bytes(values)])


def _depth(moment: Moment, _: float) -> Bytes | None:
    depth = moment.frame.depth
    if depth is None or not (hit := np.isfinite(depth)).any():
        return None
    return _colored(np.where(hit, depth[hit].min() / depth, np.float32(0)), "magma")


def _normal(moment: Moment, _: float) -> Bytes | None:
    normal = moment.frame.normal
    return None if normal is None else _bytes(normal * 0.5 + 0.5)


def _motion(moment: Moment, _: float) -> Bytes | None:
    motion = moment.frame.motion
    if motion is None:
        return None
    x, y = motion[..., 0], motion[..., 1]
    length = np.hypot(x, y)
    wheel = _ramp("hsv")[(np.arctan2(y, x) / (2 * np.pi) % 1 * 255).astype(np.uint8)]
    return np.asarray(wheel * (length / MOTION).clip(0, 1)[..., None]).astype(np.uint8)


@cache
def _reasons() -> Bytes:
    """The colour of each combination of rejections: the mean of theirs, as in the report."""
    colors = {bit: np.array([int(c[i : i + 2], 16) for i in (1, 3, 5)]) for bit, c in rejection.COLORS.items()}
    table = np.zeros((256, 3), np.uint8)
    for mask in range(1, 256):
        if given := [color for bit, color in colors.items() if mask & bit]:
            table[mask] = np.mean(given, 0)
    return table


def _ends() -> tuple[int, int]:
    from ..study.compare.report import LONGEST, PASSES

    return LONGEST, PASSES


def _extra(name: str) -> Callable[[Moment, float], Bytes | None]:
    return lambda moment, factor: _screen(moment.extra.get(name), factor)


def _choice(moment: Moment, _: float) -> Bytes | None:
    choice = moment.output.choice
    return None if choice is None else _colored(choice / np.float32(_ends()[1]))


#: Pixels of motion from one frame to the next that are shown with full brightness.
MOTION = 8

#: By name, in the order of the page.
VIEWS = {
    "raw": View("raw", "r", "one path a pixel", lambda m, f: _screen(m.frame.color, f)),
    "denoised": View("denoised", "d", "by the pipeline that is chosen", lambda m, f: _screen(m.output.color, f)),
    "antialiased": View("antialiased only", "a", "raw, by TAA with its defaults", _extra("antialiased")),
    "oidn": View("Open Image Denoise", "o", "raw, by OIDN with quality fast, frame by frame", _extra("oidn")),
    "mean": View("mean since a change", "m", "all samples since something changed", lambda m, f: _screen(m.mean, f)),
    "albedo": View("albedo", "b", "guide: reflectance", lambda m, _: _screen(m.frame.albedo, 1)),
    "normal": View("normals", "n", "guide: x red, y green, z blue, from -1 to 1", _normal),
    "depth": View("depth", "z", "guide: nearest bright, far dark", _depth),
    "motion": View("motion", "v", f"hue: direction; brightness: up to {MOTION} pixels a frame", _motion),
    "history": View(
        "history length",
        "h",
        "samples in a pixel, 0 violet to 32 yellow, as logarithm of one more",
        lambda m, _: _colored(np.log1p(m.output.history_length) * np.float32(1 / np.log1p(_ends()[0]))),
    ),
    "confidence": View(
        "confidence", "c", "accepted history, none violet to all yellow", lambda m, _: _colored(m.output.confidence)
    ),
    "rejection": View(
        "rejection",
        "j",
        "failed tests: outside blue, depth yellow, normal green, id pink, velocity orange, luminance white",
        lambda m, _: np.asarray(_reasons()[m.output.rejection]),
    ),
    "choice": View("choice per tile", "t", "passes of the filter, 0 violet to 8 yellow", _choice),
}


def plain() -> list[dict[str, Any]]:
    """The views as the page is told of them."""
    return [{"name": name, "label": v.label, "key": v.key, "about": v.about} for name, v in VIEWS.items()]
