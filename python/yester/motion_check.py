"""The check of motion that pipelines make at a sequence's second frame, as a function that returns its finding.

The pipelines warn of what they find. Filters of warnings belong to the whole process: a thread that changes them
changes what all others show. The method is that of ``src/pipelines/frame/motion_check.rs``.
"""

from __future__ import annotations

import builtins
from collections.abc import Callable
from itertools import product
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ._core import motion_vectors
from .frame import Frame

__all__ = ["mistake", "quietly"]

_Floats = NDArray[np.float64]
_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")

#: Most pixels of the grid along each side, and the least number of pixels that must show a mistake.
_GRID, _VOTES = 96, 32
#: What motion may be mistaken for, and the signs that correct it.
_DIRECTIONS = {
    "the right direction": (1, 1),
    "y up": (1, -1),
    "the direction from previous to current position": (-1, -1),
    "the direction from previous to current position, y up": (-1, 1),
}


def _call(function: Callable[..., Any], /, *args: Any, **named: Any) -> Any:
    return function(*args, **named)


#: CPython drops the warnings of code whose module has no name. Unlike a filter, this is for one call of one thread.
_nameless = FunctionType(_call.__code__, {"__name__": None, "__builtins__": builtins})


def quietly(function: Callable[_Given, _Result], /, *args: _Given.args, **named: _Given.kwargs) -> _Result:
    """Call a method of a pipeline without its warnings; those of code in Python that it may call stay."""
    result: _Result = _nameless(function, *args, **named)
    return result


def mistake(before: Frame, frame: Frame) -> str:
    """What seems wrong with the motion of a sequence's second frame.

    Parameters
    ----------
    before, frame : Frame
        The first frame and the second one.

    Returns
    -------
    str
        The text of the pipelines' warning; empty if nothing seems wrong.
    """
    if frame.motion is None or before.shape != frame.shape:
        return ""
    height, width = frame.shape
    y, x = np.mgrid[: height : -(-height // _GRID), : width : -(-width // _GRID)].reshape(2, -1)
    known = np.isfinite(frame.motion[y, x, :2]).all(-1)
    y, x = y[known], x[known]
    motion = frame.motion[y, x, :2].astype(np.float64)
    units = {
        "pixels": (1, 1),
        "normalised device coordinates": (width / 2, height / 2),
        "shares of the image's sides": (width, height),
    }
    looks = [*product(units, _DIRECTIONS)]
    factors = [np.multiply(units[unit], _DIRECTIONS[direction]) for unit, direction in looks]
    place = _place(frame)
    with np.errstate(all="ignore"):
        if place is not None and frame.camera is not None and before.camera is not None:
            expected = motion_vectors(place, frame.camera, before.camera)[y, x, :2]
            # Where nothing was hit, some renderers write a depth of 0, which gives a wrong motion.
            moves = (np.hypot(*expected.T) > 0.25) & (frame.depth is None or frame.depth[y, x] > 0)
            losses = [_beside_cameras(motion[moves], expected[moves], factor) for factor in factors[1:]]
            witness = "the cameras"
        else:
            # Of a first frame with a camera, pipelines keep no buffers.
            warp = [] if before.camera is not None and _place(before) is not None else _surface(before)
            losses = _along_warps(warp, _surface(frame), (y, x), motion, factors)
            witness = "the first frame"
    best = int(np.argmin(losses))
    if losses[best] == np.inf:
        return ""
    (unit, direction), (right, down) = looks[1 + best], factors[1 + best]
    return (
        f"motion: expected previous minus current position in pixels, x right, y down; {witness} would agree better "
        f"with {unit} and {direction}: multiply x by {right:.9g} and y by {down:.9g} (`yester check` tells more)"
    )


def _place(frame: Frame) -> NDArray[np.float32] | None:
    return frame.position if frame.depth is None else frame.depth


def _surface(frame: Frame) -> list[NDArray[np.float32]]:
    """Buffers that move with surfaces."""
    return [image for image in (frame.albedo, frame.normal) if image is not None] or [frame.color]


def _beside_cameras(motion: _Floats, expected: NDArray[np.float32], factor: _Floats) -> float:
    """The median error of corrected motion, relative to the correction; infinite if the evidence is not clear."""
    undone = factor * motion
    change = np.hypot(*(undone - motion).T)
    errors = np.sort((np.hypot(*(undone - expected).T) / change)[change >= 0.25])
    median = float(errors[errors.size // 2]) if errors.size >= _VOTES else np.inf
    return median if median < 0.1 else np.inf


def _along_warps(
    before: list[NDArray[np.float32]],
    now: list[NDArray[np.float32]],
    places: tuple[NDArray[np.intp], NDArray[np.intp]],
    motion: _Floats,
    factors: list[_Floats],
) -> list[float]:
    """For each factor but the first: minus the share of pixels that agree; infinite if the evidence is not clear."""
    if len(before) != len(now):
        return [np.inf]
    height, width = now[0].shape[:2]
    y, x = places
    here = [image[y, x] for image in now]

    def agrees(motion: _Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether a pixel came from inside the image, and lies in the range of the four pixels around that place."""
        u, v = x + motion[:, 0], y + motion[:, 1]
        inside = (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
        u, v = np.where(inside, u, 0), np.where(inside, v, 0)
        rows, columns = ([np.floor(at).astype(np.intp), np.ceil(at).astype(np.intp)] for at in (v, u))
        result = inside.copy()
        for image, value in zip(before, here, strict=True):
            taps = [image[row, column] for row, column in product(rows, columns)]
            low, high = np.fmin.reduce(taps), np.fmax.reduce(taps)
            margin = np.float32(0.02) * np.abs(value) + np.float32(0.01)
            near = (low - margin <= value) & (value <= high + margin) & np.isfinite(value)
            result &= (near | (value == low) | (value == high)).all(-1)
        return inside, result

    stays, given = agrees(motion)
    losses = []
    for factor in factors[1:]:
        undone = factor * motion
        lands, then = agrees(undone)
        inside = stays & lands
        apart = inside & (np.hypot(*(undone - motion).T) >= 1)
        gained, lost = np.count_nonzero(apart & then & ~given), np.count_nonzero(apart & given & ~then)
        count, agreeing = np.count_nonzero(inside), np.count_nonzero(inside & then)
        plain = gained >= _VOTES and gained > 4 * lost and 2 * count > len(motion) and 4 * agreeing > 3 * count
        losses.append(-agreeing / count if plain else np.inf)
    return losses
