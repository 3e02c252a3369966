"""Sequences in hand: every frame is denoised with the help of the frames before it and of those after it."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Iterator
from itertools import islice
from operator import index
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ._core import SVGF, Output, blend, invert_motion, motion_vectors
from .frame import Frame

__all__ = ["LOOKAHEAD", "denoise"]

#: Later frames that are used unless told otherwise. With 2, a chunk's last frames have 1 to 2 % more error.
LOOKAHEAD = 3

#: Frames of a chunk for each frame of lookahead. The frames behind its end, whose results are not used, cost a fifth of
#: the way back.
_CHUNK = 5


class _Steps(Protocol):
    """What `denoise` asks of a pipeline."""

    def step(self, frame: Frame, /) -> Output: ...


def denoise(frames: Iterable[Frame], pipeline: _Steps | None = None, lookahead: int = LOOKAHEAD) -> Iterator[Output]:
    """Denoise a sequence with the frames on both sides of each.

    A pipeline knows the frames before the current one. Here a copy of it also runs backwards, from later frames to
    earlier ones, and the two results are averaged: what was hidden before is seen afterwards, a light that moves is
    too late on one side and too early on the other, and noise and edges have twice as many samples.

    Parameters
    ----------
    frames : iterable of Frame
        A sequence of frames of one size, in order; `Frame.motion_next` where it is known. Otherwise the motion to the
        next frame is computed: by the cameras, if these and depth or position are known, and by `invert_motion` of the
        next frame's `motion` where something else moves.
    pipeline : Pipeline, optional
        Anything with a `step` that takes frames in order, and of which `copy.copy` makes one without history; by
        default ``SVGF()``. It goes on from the history it has, and afterwards has that of the last frame.
    lookahead : int, default 3
        Later frames that every frame can use at least, until the sequence ends; 0 or more. With 0, the results have the
        bits of `pipeline.step`.

    Yields
    ------
    Output
        One for each frame. `history_length` counts the samples of both sides; `confidence` is the larger one;
        `rejection` has the tests that failed on both sides; `missing` is that of the frame.

    Raises
    ------
    ValueError
        If lookahead is negative, or frames differ in size; and what `step` raises.

    Warns
    -----
    UserWarning
        Once, if frames have no `motion`, and no cameras with depth or position: their results are those of the earlier
        frames alone.

    Notes
    -----
    The weights of the two results are their history lengths, pixel by pixel. Something that has just come into view
    therefore has most of its light from the frames in which it stays. A side without confidence anywhere, at an end of
    the sequence or at a cut, does not count: its result is that of the frame alone, and a few bright pixels of it would
    be most of the error.

    At most ``6 * lookahead`` frames are held, and ``5 * lookahead`` results: the sequence is worked on in chunks of
    ``5 * lookahead`` frames, each of which begins backwards `lookahead` frames behind its end. A frame takes 2.2 to 2.5
    times as long as a step.
    """
    ahead = index(lookahead)
    if ahead < 0:
        raise ValueError(f"lookahead: expected 0 or more frames, got {lookahead}")
    if pipeline is None:
        pipeline = SVGF()
    if ahead == 0:
        return (pipeline.step(frame) for frame in frames)
    return _both_sides(iter(frames), pipeline, ahead)


def _both_sides(source: Iterator[Frame], pipeline: _Steps, lookahead: int) -> Iterator[Output]:
    chunk = _CHUNK * lookahead
    window: list[Frame] = []
    warned = False
    while True:
        for frame in islice(source, chunk + lookahead - len(window)):
            if window and frame.shape != window[0].shape:
                (height, width), (own, across) = window[0].shape, frame.shape
                expected = f"height {height} and width {width}, as in earlier frames"
                raise ValueError(f"frames: expected {expected}, got height {own} and width {across}")
            window.append(frame)
        ended = len(window) < chunk + lookahead
        ready = len(window) if ended else chunk
        results, known = _backwards(window, pipeline)
        if not known and not warned:
            warned = True
            unknown = "frames without motion, and without cameras and depth or position to compute it from"
            warnings.warn(f"frames: later frames are not used, as there are {unknown}", stacklevel=2)
        del results[: len(window) - ready]
        for frame in window[:ready]:
            forward, backward = pipeline.step(frame), results.pop()
            yield forward if backward is None else _average(forward, backward)
        del window[:ready]
        if ended:
            return


def _backwards(frames: list[Frame], pipeline: _Steps) -> tuple[list[Output | None], bool]:
    """The results of the frames from the last to the first, None where later frames do not help; and whether the motion
    to every next frame is known."""
    results: list[Output | None] = []
    back, following, known = None, None, True
    for frame in reversed(frames):
        motion = None if following is None else _motion_next(frame, following)
        if following is None or motion is None:
            known &= following is None
            back = None
            results.append(None)
        else:
            if back is None:
                back = copy.copy(pipeline)
                results[-1] = back.step(_turned(following, None))
            results.append(back.step(_turned(frame, motion)))
        following = frame
    return results, known


def _motion_next(frame: Frame, following: Frame) -> NDArray[np.float32] | None:
    """Motion to the next frame; None if nothing tells it."""
    if frame.motion_next is not None:
        return frame.motion_next
    still, motion = None, following.motion
    geometry = frame.depth if frame.position is None else frame.position
    if geometry is not None and frame.camera is not None and following.camera is not None:
        still = motion_vectors(geometry, frame.camera, following.camera)
    if motion is None:
        return still
    if still is not None:
        still = still[..., : motion.shape[-1]]
    return invert_motion(motion, following.depth, still=still)


def _turned(frame: Frame, motion: NDArray[np.float32] | None) -> Frame:
    """The frame as one of the reversed sequence."""
    left_out = ("motion", "motion_next", "replay")
    buffers = {name: buffer for name, buffer in frame.buffers().items() if name not in left_out}
    return Frame(**buffers, motion=motion, camera=frame.camera, jitter=frame.jitter)


def _average(forward: Output, backward: Output) -> Output:
    if not backward.confidence.any():
        return forward
    if not forward.confidence.any():
        return backward
    ahead, behind = forward.history_length, backward.history_length
    total = ahead + behind
    share = np.divide(ahead, total, out=np.full_like(total, 0.5), where=total > 0)

    def mean(one: NDArray[np.float32] | None, other: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        return None if one is None or other is None else other + share * (one - other)

    variance = None
    if forward.variance is not None and backward.variance is not None:
        variance = share**2 * forward.variance + (1 - share) ** 2 * backward.variance
    return Output(
        blend(forward.color, backward.color, share),
        # The new sample is in both.
        np.where((ahead > 0) & (behind > 0), total - 1, total),
        np.maximum(forward.confidence, backward.confidence),
        forward.rejection & backward.rejection,
        variance=variance,
        choice=mean(forward.choice, backward.choice),
        used=tuple(dict.fromkeys([*forward.used, *backward.used])),
        missing=forward.missing,
    )
