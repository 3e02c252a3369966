"""Jitter, which is no part of motion: checked by the motion of the cameras, or by warping."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from .cameras import still_vectors
from .findings import Finding, Floats, clipped, judged, tile_means
from .guides import guides_of, have, jitter_between, warped
from .hypotheses import Motion

__all__ = ["judge_jitter"]


def judge_jitter(shot: list[Frame]) -> Finding:
    """The jitter's change since the previous frame is no part of motion."""
    if any(frame.motion is None for frame in shot):
        return Finding("jitter", "unchecked", "no usable motion vectors")
    geometry = have(shot, "camera") and all(frame.depth is not None or frame.position is not None for frame in shot)
    if not have(shot, "jitter"):
        if not geometry:
            return Finding("jitter", "unchecked", "no jitter, and no cameras with depth or position")
        return _constant_offset(_offsets(shot))
    changes = [jitter_between(frame, before) for before, frame in pairwise(shot)]
    if max(np.abs(change).max() for change in changes) < 0.02:
        return Finding("jitter", "unchecked", "the jitter does not change")
    if geometry:
        offsets = _offsets(shot)
        residuals = [_left(offsets, [sign * change for change in changes]) for sign in _SIGNS]
        witnesses = ["camera"]
    else:
        guides = guides_of(shot)
        residuals = [_left_by_warping(shot, guides, sign) for sign in _SIGNS]
        witnesses = [*guides[0]]
    return judged("jitter", [*_SIGNS.values()], ["", *_UNJITTERED], np.array(residuals), witnesses)[0]


#: How often motion contains the change of jitter, and what that means.
_SIGNS = {0: "removed from motion", 1: "left in motion", -1: "removed from motion with the wrong sign"}
#: Remedies for the last two.
_UNJITTERED = (
    "motion - (jitter - previous_jitter): render motion with cameras that are not jittered",
    "motion + (jitter - previous_jitter)",
)


def _offsets(shot: list[Frame]) -> list[NDArray[np.float64]]:
    """Of every frame but the first, the mean difference of its motion from that of the cameras, by tile."""
    offsets = []
    for before, frame in pairwise(shot):
        off = np.asarray(frame.motion)[..., :2].astype(np.float64) - still_vectors(frame, before.camera)
        # What moves by itself is farther off.
        still = np.isfinite(off).all(-1) & (np.linalg.norm(off, axis=-1) < 2)
        offsets.append(np.stack([tile_means(off[..., i], still) for i in range(2)], -1))
    return offsets


def _left(offsets: list[NDArray[np.float64]], changes: list[Floats]) -> NDArray[np.float64]:
    """How far the offsets are from what these changes would leave, relative to the changes; NaN where unknown."""
    found = []
    for offset, change in zip(offsets, changes, strict=True):
        apart = clipped(np.linalg.norm(offset - change, axis=-1), max(float(np.linalg.norm(change)), 0.05))
        found.append(np.where(np.isfinite(offset[:, 0]), apart, np.nan))
    return np.concatenate(found)


def _constant_offset(offsets: list[NDArray[np.float64]]) -> Finding:
    """Whether motion differs from that of the cameras by the same vector everywhere."""
    tiles = [o[np.isfinite(o).all(-1)] for o in offsets]
    mean = np.array([o.mean(0) if len(o) > 3 else np.zeros(2) for o in tiles])
    error = np.array([o.std(0) / np.sqrt(len(o)) if len(o) > 3 else np.ones(2) for o in tiles])
    most = int(np.abs(mean).max(-1).argmax())
    size, sure = np.linalg.norm(mean[most]), np.linalg.norm(error[most])
    # Jitter is the same everywhere; wrong motion is not.
    spread = np.linalg.norm(error[most]) * np.sqrt(len(tiles[most]))
    if size > max(0.05, 5 * sure, 3 * spread):
        x, y = mean[most]
        said = f"a constant offset of ({x:.2f}, {y:.2f}) pixels in motion, as jitter leaves it"
        return Finding("jitter", "wrong", said, _UNJITTERED[0], float(size), float(sure), (), ("camera",))
    return Finding("jitter", "right", "no constant offset in motion", "", 0.0, float(sure), (), ("camera",))


def _left_by_warping(shot: list[Frame], guides: list[dict[str, NDArray[np.float32]]], sign: int) -> NDArray[np.float64]:
    """How badly guides agree along the motion without so many times the change of jitter."""
    clean = []
    for i, frame in enumerate(shot):
        change = jitter_between(frame, shot[max(i - 1, 0)])
        clean.append(np.asarray(frame.motion)[..., :2] - np.float32(sign * change))
    return np.asarray(warped([Motion("", np.eye(2))], range(1, len(shot)), shot, clean, guides, 1)[0])
