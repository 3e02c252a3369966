"""Sequences in hand: every frame is denoised with the help of the frames before it and of those after it."""

from __future__ import annotations

import copy
import inspect
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from operator import index
from typing import Any, NamedTuple, ParamSpec, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ._core import SVGF, TAA, History, Output, blend, collect_warnings
from .frame import Frame, alike, turned
from .judge import inverse_motion, rests
from .plan import Planned, taken_apart

__all__ = ["LOOKAHEAD", "denoise"]

#: Default number of later frames. With 2, the last frames of a chunk have more error.
LOOKAHEAD = 3

#: Frames of a chunk per frame of lookahead. The backward run starts `lookahead` frames behind the chunk's end; these
#: frames, whose results are discarded, add a fifth to its cost.
_CHUNK = 5
#: Buffers beside depth that guide a denoiser. Its output stage asks only whether it had any.
_GUIDES = ("albedo", "normal", "ids")
#: A cut: mean confidence of the later frames, relative to that of both sides.
_LOST = 0.25
#: Frames at rest after which the output stage gives way to the mean of their samples, where a pipeline shows it, and
#: over how many. Before, the mean alone has more error.
_SETTLED, _FADE = 16, 16


class _Steps(Protocol):
    """The interface of a pipeline that `denoise` uses."""

    def step(self, frame: Frame, /) -> Output: ...


class _Stage(Protocol):
    """The output stage of such a pipeline."""

    def step(self, frame: Frame, /, *, samples: NDArray[np.float32], confidence: NDArray[np.float32]) -> Output: ...


@runtime_checkable
class _Recalls(Protocol):
    """A pipeline that joins histories before it filters."""

    def step(self, frame: Frame, /, *, later: History | None = None) -> Output: ...

    def recall(self, frame: Frame, /) -> History: ...

    def split(self, *, both_sides: bool) -> tuple[_Recalls, _Stage | None]: ...


_Given = ParamSpec("_Given")
_Item = TypeVar("_Item")
_Pipeline = TypeVar("_Pipeline")
_Result = TypeVar("_Result")


def denoise(frames: Iterable[Frame], pipeline: _Steps | None = None, lookahead: int = LOOKAHEAD) -> Iterator[Output]:
    """Denoise a sequence with the frames on both sides of each.

    A pipeline knows the frames before the current one. Here a copy of it also runs backwards, from later frames to
    earlier ones: what was hidden before is seen afterwards, a light that moves is too late on one side and too early on
    the other, and noise and edges have twice as many samples.

    Parameters
    ----------
    frames : iterable of Frame
        A sequence of frames of one size, in order; `Frame.motion_next` where it is known. Otherwise the motion to the
        next frame is computed: by the cameras, if these and depth or position are known, and by `invert_motion` of the
        next frame's `motion` where something else moves. In the same way, frames without `motion` get that which the
        `motion_next` of the frame before tells, unless this seems wrong.
    pipeline : Pipeline, optional
        Anything with a `step` that takes frames in order, and of which ``copy.copy`` makes one without history; by
        default ``SVGF()``. Copies of it work; it stays as it is.
    lookahead : int, default 3
        Later frames that every frame can use at least, until the sequence ends; 0 or more. With 0, the results have the
        bits of `step`.

    Returns
    -------
    iterator of Output
        One for each frame, made as it is asked for. `history_length` counts the samples of both sides; `confidence` is
        the larger one; `rejection` has the tests that failed on both sides; `missing` is that of the frame. `used` has
        the buffers of both sides, with "motion" also for that to the next frame, given or computed.

    Raises
    ------
    TypeError
        If one is no `Frame`, or the pipeline has no `step`.
    ValueError
        If lookahead is negative, or frames differ in size; and what `step` raises.

    Warns
    -----
    UserWarning
        Once, if frames have no `motion`, and no cameras with depth or position: their results are those of the earlier
        frames alone.

    See Also
    --------
    SVGF : The default pipeline.
    invert_motion : Motion to the next frame.
    combine_histories : Joins the histories of both sides.

    Notes
    -----
    `SVGF` and `HalfRes` join the histories of both sides before they filter, by their lengths, and the frame's sample
    counts once (`SVGF.recall`, `combine_histories`). Each side holds down fireflies that the other does not confirm.
    Their output stage then runs over the results in both directions; where ``SVGF(average_still=True)`` averages, it
    gives way to the mean from the 16th to the 32nd frame at rest. Of other pipelines, and of the stage, the results
    of both directions are averaged, weighted by history length, pixel by pixel: something that has just come into view
    has most of its light from the frames in which it stays. A side without confidence anywhere, at an end of the
    sequence or at a cut, does not count. Pixels of another shot that pass the tests of the surface still mix in:
    `split_at_cuts` separates shots. The output stage takes it for a cut if the later frames' confidence is in the mean
    less than a quarter of that of both sides. It then shortens all history from beyond that its clipping changes.
    If no motion leads from the first frame to the second, the stage is that of `step` for all frames.

    The sequence is worked on in chunks of ``5 * lookahead`` frames, each of which begins backwards `lookahead` frames
    behind its end. A chunk ends early at a frame from which no motion leads to the next one. At most
    ``6 * lookahead + 2`` frames are held, and as many results, histories and, for the output stage, colours with depth,
    motion and samples; with an output stage, twice as many are read before the first result. If `frames` raises, the
    frames that are held have no results.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=16, height=16)
    >>> depth = np.full((16, 16), 2.0)
    >>> frames = [yester.Frame(rng.gamma(1, 0.5, (16, 16, 3)), depth=depth, camera=camera) for _ in range(6)]
    >>> outputs = [*yester.denoise(frames)]
    >>> len(outputs)
    6
    >>> bool(outputs[0].color.std() < frames[0].color.std() / 4)
    True
    """
    ahead = index(lookahead)
    if ahead < 0:
        raise ValueError(f"lookahead: expected 0 or more frames, got {lookahead}")
    if isinstance(pipeline, type):
        raise TypeError(f"pipeline: expected a pipeline, such as {pipeline.__name__}(), got its class")
    if pipeline is not None and not hasattr(pipeline, "step"):
        raise TypeError(f"pipeline: expected an object with a step, got {type(pipeline).__name__}")
    pipeline = SVGF() if pipeline is None else copy.copy(pipeline)
    if ahead == 0:
        return map(pipeline.step, frames)
    frames = alike(frames)
    if isinstance(pipeline, Planned):
        # Nothing else here may use a buffer that the plan leaves out.
        pipeline, frames = taken_apart(pipeline, frames)
    known = _knowing_next(frames)
    if not isinstance(pipeline, _Recalls):
        return _averaged(known, pipeline, ahead)
    return _joining(known, pipeline, ahead)


def _joining(frames: Iterator[Frame], pipeline: _Recalls, lookahead: int) -> Iterator[Output]:
    """Yield the outputs of a pipeline that joins histories."""
    first = next(frames, None)
    if first is None:
        return
    # Frames without motion are denoised by the earlier ones alone. The first frame decides for all, as the parameters
    # of a stage stay the same.
    denoiser, stage = pipeline.split(both_sides=not _alone(first))
    joined = _joined(chain([first], frames), denoiser, lookahead)
    if stage is None:
        yield from (_of_both(output, later) for _, output, later in joined)
    else:
        yield from _finished(joined, stage, lookahead, averages=_averages_still(pipeline))


def _averages_still(pipeline: _Recalls) -> bool:
    """Whether the pipeline shows the mean of all samples while nothing moves, as the arguments tell that copies get."""
    if not isinstance(pipeline, SVGF):
        return False
    made: Any = pipeline.__reduce__()
    given = made[0].keywords
    return bool(given.get("average_still") and given.get("choice", True))


def _knowing_next(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Add `motion_next` to every frame but the last, if it is known or can be computed.

    Frames without `motion` get the inverse of the motion that leads to them, unless that seems wrong.
    """
    warned, sound, before = False, None, None
    for frame in frames:
        if before is not None:
            if before.motion_next is not None:
                sound = _check_next(before, frame) if sound is None else sound
                if frame.motion is None and sound:
                    frame = replace(frame, motion=inverse_motion(before.motion_next, frame, before))
            motion = inverse_motion(frame.motion, before, frame) if before.motion_next is None else before.motion_next
            if motion is None and not warned:
                warned = True
                unknown = "frames without motion, and without cameras and depth or position to compute it from"
                warnings.warn(f"frames: later frames are not used, as there are {unknown}", stacklevel=_outside())
            yield replace(before, motion_next=motion)
        before = frame
    if before is not None:
        yield replace(before, motion_next=None)


def _check_next(frame: Frame, following: Frame) -> bool:
    """Whether `motion_next` seems right; if not, warn, as pipelines warn of `motion`."""
    pipeline = TAA("textbook")
    pipeline.step(turned(replace(following, motion_next=None)))
    _, said = collect_warnings(pipeline.step, turned(frame))
    for text in said:
        found = text.replace("motion:", "motion_next:").replace("previous", "next")
        warnings.warn(found, stacklevel=_outside())
    return not said


def _quiet(step: Callable[_Given, _Result], *args: _Given.args, **named: _Given.kwargs) -> _Result:
    """What a step returns, without its warnings."""
    result, _ = collect_warnings(step, *args, **named)
    return result


def _outside() -> int:
    """The level in the caller's stack of the function outside this module, for a warning that should name its line."""
    level, frame = 0, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename == __file__:
        level, frame = level + 1, frame.f_back
    return level


def _alone(frame: Frame) -> bool:
    """Whether no later frame can help."""
    return frame.motion_next is None


def _chunks(
    frames: Iterator[_Item], lookahead: int, alone: Callable[[_Item], bool]
) -> Iterator[tuple[list[_Item], int]]:
    """Yield the frames of each chunk and its lookahead, and the length of the chunk; the lookahead is repeated next.

    `alone` tells whether no motion leads from a frame to the next one. It ends a chunk, since none of the later frames
    helps; so does the sequence's last frame.
    """
    chunk = _CHUNK * lookahead
    window: list[_Item] = []
    for frame in frames:
        window.append(frame)
        if alone(frame):
            yield window, len(window)
            window.clear()
        elif len(window) == chunk + lookahead:
            yield window, chunk
            del window[:chunk]


def _backwards(
    frames: list[Frame], pipeline: _Pipeline, look: Callable[[_Pipeline, Frame, int], _Result]
) -> list[_Result | None]:
    """The pipeline's results for the frames in reverse order; None for frames without known later frames.

    `look` gets a pipeline that runs backwards, a frame as it sees it, and the frame's index. It is quiet, as the
    pipeline that runs forward warns of the frame's noise and motion.
    """
    results: list[_Result | None] = []
    back, following = None, None
    for number, frame in reversed([*enumerate(frames)]):
        if following is None or frame.motion_next is None:
            back = None
            results.append(None)
        else:
            if back is None:
                back = copy.copy(pipeline)
                look(back, turned(replace(following, motion_next=None)), number + 1)
            results.append(look(back, turned(frame), number))
        following = frame
    return results


def _joined(
    frames: Iterator[Frame], pipeline: _Recalls, lookahead: int
) -> Iterator[tuple[Frame, Output, History | None]]:
    """Yield each frame, its output with the histories of both sides joined, and the later frames' history.

    Confidence, rejection and names of buffers of the output are those of the earlier frames.
    """
    for window, ready in _chunks(frames, lookahead, _alone):
        histories = _backwards(window, pipeline, lambda back, frame, _: _quiet(back.recall, frame))
        del histories[: len(window) - ready]
        for frame in window[:ready]:
            later = histories.pop()
            yield frame, pipeline.step(frame, later=later), later


def _of_both(output: Output, later: History | None) -> Output:
    """An output of joined histories with what is known of both sides: higher confidence, tests that failed on both."""
    if later is None or not later.confidence.any():
        return output
    (color, length, confidence, rejection), named = output.__getnewargs_ex__()
    joined = np.maximum(confidence, later.confidence), rejection & later.rejection
    return Output(color, length, *joined, **named | {"used": _both(output.used, later.used)})


def _averaged(frames: Iterator[Frame], pipeline: _Steps, lookahead: int) -> Iterator[Output]:
    """Yield the means of the results from both sides."""
    for window, ready in _chunks(frames, lookahead, _alone):
        results = _backwards(window, pipeline, lambda back, frame, _: _quiet(back.step, frame))
        del results[: len(window) - ready]
        for frame in window[:ready]:
            forward, backward = pipeline.step(frame), results.pop()
            yield forward if backward is None else _average(forward, backward, frame.color)


class _Denoised(NamedTuple):
    """A frame for the output stage."""

    #: With the denoised colour.
    frame: Frame
    samples: NDArray[np.float32]
    #: Of the denoiser, with what is known of both sides.
    output: Output
    #: Confidence in the history of the earlier frames, and in that of the later ones. A stage runs from one side, and
    #: shortens its history where the denoiser found none there: what an object uncovers, the other side knows.
    earlier: NDArray[np.float32]
    later: NDArray[np.float32]
    #: Whether a cut comes before it, and after it.
    begins: bool
    ends: bool
    #: How much of the denoised colour is shown as it is.
    settled: float


def _finished(
    joined: Iterator[tuple[Frame, Output, History | None]], stage: _Stage, lookahead: int, *, averages: bool
) -> Iterator[Output]:
    """Yield the outputs with colours from the output stage, which also gets samples and confidence."""

    def denoised() -> Iterator[_Denoised]:
        before, rested, ends = None, 0, False
        for frame, output, later in joined:
            places: dict[str, Any] = {"depth": frame.depth, "position": frame.position, "jitter": frame.jitter}
            motion, following = output.motion, None if later is None else later.motion
            places["motion"] = frame.motion if motion is None else motion
            places["motion_next"] = frame.motion_next if following is None else following
            if frame.emission is not None:
                # The stage only asks where there is any: one channel says so in a third of the memory.
                shines = (frame.emission > 0).any(-1, keepdims=True)
                places["emission"] = np.broadcast_to(shines.astype(np.float32), frame.emission.shape)
            if any(getattr(frame, name) is not None for name in _GUIDES):
                # As if all were one surface: a whole window of frames would hold gigabytes of guides.
                places["ids"] = np.broadcast_to(np.uint32(0), frame.shape)
            # A frame with replay is not averaged.
            still = averages and before is not None and frame.replay is None and rests(before, frame)
            before, rested = frame, rested + 1 if still else 0
            earlier, output = output.confidence, _of_both(output, later)
            known = earlier if later is None else later.confidence
            begins, ends = ends, known.mean() < _LOST * output.confidence.mean()
            # The noise of a mean lasts: a frame's samples would take it for detail.
            samples = frame.color if rested < _SETTLED else np.broadcast_to(np.float32(np.nan), frame.color.shape)
            settled = min(max(rested - _SETTLED, 0) / _FADE, 1.0)
            shown = Frame(output.color, **places, camera=frame.camera)
            yield _Denoised(shown, samples, output, earlier, known, begins, ends, settled)

    def look(window: list[_Denoised], back: _Stage, frame: Frame, number: int) -> Output:
        item = window[number]
        return _quiet(back.step, frame, samples=item.samples, confidence=_unless(item.ends, item.later))

    done = 0
    for window, ready in _chunks(denoised(), lookahead, lambda item: _alone(item.frame)):
        results = _backwards([item.frame for item in window], stage, partial(look, window))
        del results[: len(window) - ready]
        for frame, samples, output, earlier, _, begins, _, settled in window[:ready]:
            # Pipelines check motion at their second frame. There, the denoiser has already warned.
            given = {"samples": samples, "confidence": _unless(begins, earlier)}
            finished = _quiet(stage.step, frame, **given) if done == 1 else stage.step(frame, **given)
            done += 1
            backward = results.pop()
            if backward is not None:
                finished = _average(finished, backward, samples)
            color = finished.color
            if settled:
                color = color + np.float32(settled) * (output.color - color)
            yield Output(
                color,
                output.history_length,
                output.confidence,
                output.rejection,
                variance=output.variance,
                choice=output.choice,
                used=output.used,
                missing=output.missing,
            )


def _unless(cut: bool, confidence: NDArray[np.float32]) -> NDArray[np.float32]:
    """The confidence of a side for the stage that runs from there; 0 if a cut is there."""
    return np.zeros_like(confidence) if cut else confidence


def _both(used: Iterable[str], others: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*used, *others]))


def _average(forward: Output, backward: Output, samples: NDArray[np.float32]) -> Output:
    """The mean of the results from both sides, which share the frame's samples."""
    if not backward.confidence.any():
        return forward
    if not forward.confidence.any():
        return backward
    ahead, behind = forward.history_length, backward.history_length
    total = ahead + behind
    share = np.divide(ahead, total, out=np.full_like(total, 0.5), where=total > 0)

    def mean(one: NDArray[np.float32] | None, other: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        return None if one is None or other is None else other + share * (one - other)

    # An output pixel of `Upscaler` may have less than one.
    shared = np.isfinite(samples).all(-1) if samples.shape == forward.color.shape else np.float32(1)
    variance = None
    if forward.variance is not None and backward.variance is not None:
        variance = share**2 * forward.variance + (1 - share) ** 2 * backward.variance
    return Output(
        blend(forward.color, backward.color, share),
        np.maximum(total - shared, np.maximum(ahead, behind)),
        np.maximum(forward.confidence, backward.confidence),
        forward.rejection & backward.rejection,
        variance=variance,
        choice=mean(forward.choice, backward.choice),
        used=_both(forward.used, backward.used),
        missing=forward.missing,
    )
