"""The images by which frames are recognised in each other, and how well they agree along a motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import reproject
from ..frame import Frame
from ..messages import few
from .findings import Floats, clipped, tile_means
from .hypotheses import Motion, applied

__all__ = ["colours_of", "guides_of", "have", "jitter_between", "lack", "sample_places", "unprojected", "warped"]

#: Less of the image than this must not be lost by warping.
_INSIDE = 0.75


def guides_of(shot: list[Frame]) -> list[dict[str, NDArray[np.float32]]]:
    """The images by which frames can be recognised in each other, by frame: float32 (H, W, C), finite."""
    names = [name for name in _GUIDES if have(shot, name)]
    if not names:
        return colours_of(shot)
    return [{name: _GUIDES[name](frame) for name in names} for frame in shot]


def colours_of(shot: list[Frame]) -> list[dict[str, NDArray[np.float32]]]:
    """As `guides_of`, without guides."""
    return [{"color": _smooth_light(frame)} for frame in shot]


def lack(shot: list[Frame], name: str) -> str | None:
    """Where a buffer is missing, for a message: empty if in all frames. None if it is nowhere missing."""
    without = [number for number, frame in enumerate(shot, 1) if getattr(frame, name) is None]
    if not without:
        return None
    which = f"frame{'s' if len(without) > 1 else ''} {few(without)} of {len(shot)}"
    return "" if len(without) == len(shot) else f" in {which}"


def have(shot: list[Frame], *names: str) -> bool:
    """Whether all frames have these buffers."""
    return all(getattr(frame, name) is not None for frame in shot for name in names)


def _finite(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.nan_to_num(image, posinf=0, neginf=0)


def _by_id(frame: Frame) -> Floats:
    """A colour for each id: what lies between two is neither."""
    mixed = np.asarray(frame.ids, np.uint64)[..., None] * np.array([2654435761, 2246822519, 3266489917], np.uint64)
    return ((mixed >> np.uint64(16)) % np.uint64(1024)) / 1024


def _log_depth(frame: Frame) -> Floats:
    depth = np.abs(np.asarray(frame.depth, np.float64))
    known = np.isfinite(depth) & (depth > 0)
    return np.log(np.where(known, depth, 1e3 * depth[known].max(initial=1)))[..., None]


def sample_places(frame: Frame) -> NDArray[np.float64]:
    """The places of the samples, as far as they are known, in pixels, (H, W, 2)."""
    rows, columns = np.mgrid[: frame.height, : frame.width] + 0.5
    return np.stack([columns, rows], -1) + (frame.jitter or (0, 0))


def unprojected(frame: Frame) -> Floats:
    """Positions of pixel centres by depth; NaN for background."""
    assert frame.camera is not None
    depth = np.asarray(frame.depth, np.float64)
    places = sample_places(frame)
    points = frame.camera.unproject(places, np.where(np.isfinite(depth), depth, 1))
    return np.where(np.isfinite(depth)[..., None], points, np.nan)


def _smooth_light(frame: Frame) -> Floats:
    """Tone-mapped colour, averaged over 5×5 pixels: noise must not outweigh what moves."""
    color = np.nan_to_num(np.log1p(np.maximum(np.nan_to_num(frame.color, posinf=0), 0)))
    for axis in (0, 1):
        padded = np.pad(color, [(3, 2) if i == axis else (0, 0) for i in range(3)], mode="edge").cumsum(axis)
        ahead, behind = ([slice(None)] * 3 for _ in range(2))
        ahead[axis], behind[axis] = slice(5, None), slice(None, -5)
        color = (padded[tuple(ahead)] - padded[tuple(behind)]) / 5
    return color


_GUIDES: dict[str, Callable[[Frame], Any]] = {
    "ids": _by_id,
    "position": lambda frame: frame.position,
    "depth": _log_depth,
    "normal": lambda frame: frame.normal,
    "albedo": lambda frame: frame.albedo,
}


def _footprint(position: Floats) -> Floats:
    """About the distance of neighbouring pixels' positions, (H, W)."""
    steps = []
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(position, axis=axis), axis=-1)
        # Without a neighbour on one side, that of the other counts; in an image of one row, the other axis.
        before = np.pad(step, [(1, 0) if i == axis else (0, 0) for i in range(2)], constant_values=np.nan)
        after = np.pad(step, [(0, 1) if i == axis else (0, 0) for i in range(2)], constant_values=np.nan)
        steps.append(np.fmin(before, after))
    return np.asarray(np.fmax(np.fmax(*steps), 1e-6 * np.linalg.norm(position, axis=-1)))


def warped(
    hypotheses: list[Motion],
    bases: Iterable[int],
    shot: list[Frame],
    stored: Sequence[Floats],
    guides: list[dict[str, NDArray[np.float32]]],
    thin: int,
) -> NDArray[np.float64]:
    """Disagreement of warped guides with those of the frame itself, (hypotheses, tiles)."""
    found: list[list[NDArray[np.float64]]] = [[] for _ in hypotheses]
    for t in bases:
        pair = {i: {name: np.asarray(image, np.float32) for name, image in guides[t + i].items()} for i in (-1, 0)}
        images_of = {i: [_finite(image) for image in images.values()] for i, images in pair.items()}
        measures = {0: _disagreement(pair[0], pair[-1]), -1: _disagreement(pair[-1], pair[0])}
        for number, hypothesis in enumerate(hypotheses):
            images, disagreement = images_of[hypothesis.there], measures[hypothesis.here]
            shift = jitter_between(shot[t + hypothesis.here], shot[t + hypothesis.there])
            motion = applied(hypothesis, stored[t + hypothesis.file]) + np.float32(shift)
            moved, coverage = reproject(images, motion / np.float32(thin), fallback=False)
            inside = coverage > 0.5
            left = disagreement(moved)
            # What has left the image tells nothing, unless it is so much that hypotheses would hide there.
            outside = left[inside].mean() if inside.mean() > _INSIDE else 1
            found[number].append(tile_means(np.where(inside, left, outside)))
    return np.array([np.concatenate(tiles) for tiles in found])


def jitter_between(frame: Frame, source: Frame) -> NDArray[np.float64]:
    """From motion without jitter to the place of the same sample in the source's image, in pixels."""
    if frame.jitter is None or source.jitter is None:
        return np.zeros(2)
    return np.subtract(frame.jitter, source.jitter)


def _disagreement(
    now: dict[str, NDArray[np.float32]], then: dict[str, NDArray[np.float32]]
) -> Callable[[list[NDArray[np.float32]]], NDArray[np.float64]]:
    """Measures how far warped images are from a frame's: mean over witnesses, relative to that of unrelated places."""
    scales: list[Any] = []
    chance: list[float] = []
    filled = {name: _finite(image) for name, image in now.items()}

    def apart(name: str, image: NDArray[np.float32]) -> Floats:
        difference = np.abs(image - filled[name])
        return np.asarray(np.linalg.norm(difference, axis=-1) if name == "position" else difference.mean(-1))

    for name, image in now.items():
        height, width = image.shape[:2]
        unrelated = apart(name, np.roll(_finite(then[name]), (height // 3, width // 3), (0, 1)))
        # Positions differ by how many pixels they are apart: four are as bad as all.
        scale = 4 * _footprint(image) if name == "position" else max(float(unrelated.mean()), 1e-9)
        scales.append(np.where(np.isfinite(scale), scale, 1.0))
        chance.append(float(clipped(unrelated, scales[-1]).mean()))
    total = max(sum(chance), 1e-9)

    def disagreement(warped: list[NDArray[np.float32]]) -> NDArray[np.float64]:
        parts = (clipped(apart(name, image), scale) for name, image, scale in zip(now, warped, scales, strict=True))
        return np.asarray(sum(parts) / total)

    return disagreement
