"""What a sequence needs: stages and buffers of `SVGF` that the first frames show to be superfluous are left out."""

from __future__ import annotations

import copy
import json
import math
import os
import time
import tomllib
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, islice, pairwise
from numbers import Integral
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._core import SVGF, Camera, Output, collect_warnings, exposure
from .frame import BUFFERS, Frame, alike, turned
from .io.files import beside
from .judge import (
    REPEATS,
    UNMOVED,
    estimate,
    found_again,
    inverse_motion,
    known_motion,
    repetitions,
    rests,
    sums,
)

__all__ = ["PLANNED", "Plan", "Planned", "Stage", "plan", "split_at_cuts"]

#: Version of the plan's file format.
_VERSION = 1
#: Default number of frames from which a plan is made.
PLANNED = 8
#: Index of the first frame that is judged; fewest frames of a plan.
_START, _FEWEST = 2, 5
#: Windows by which large images are judged: number along each side, and size. Small images are judged as a whole.
_ALONG, _WINDOW = 2, (96, 128)
#: Standard errors of the bounds; tolerated loss, relative to the result's change between frames.
_STRICTNESS, _MARGIN = 2.0, 0.05
#: Loss (a gain, as it is negative) below which a buffer is left out. The second is for buffers that distinguish
#: surfaces: these matter most at edges and disocclusions, which are not judged.
_HARM, _SURFACE_HARM = -0.125, -0.5
#: Share of pixels that must be judged before albedo is left out: edges are not, and of grass, which is all edges, only
#: the least typical pixels.
_MOST = 0.5
#: Exposure to which brighter frames are dimmed. None of the study's sequences is as bright.
_BRIGHT = 3.0
#: Share of pixels found again up to which buffers that distinguish surfaces are taken for broken.
_FEW = 0.01
#: A cut: the share of pixels found again, relative to that of the frame before. Least share of that frame, as buffers
#: may be broken.
_LOST, _FOUND = 0.25, 0.1
#: Squared change between frames, relative to the squared radiance, below which nothing changes but by rounding.
_NOTHING = 1e-8
#: Radiance above which values cannot be judged, and make results wrong: squares overflow in single precision.
LARGEST = 1e18
#: The name of the stage that gives new samples more weight than old ones.
_FORGETTING = "forgetting"
#: The other stages that are judged: on by default, parameters of `SVGF` turn them off.
_STAGES = ("choice", "gradient", "innovation", "reflections")
#: Mean history length, relative to the longest, above which the light counts as constant.
_CONSTANT = 0.9

#: Buffers that are judged, each with the buffers that are useless without it.
_GROUPS = {
    "albedo": ("albedo", "emission"),
    "emission": ("emission",),
    "normal": ("normal", "object_normal"),
    "position": ("position",),
    "depth": ("depth", "position", "hit_distance"),
    "ids": ("ids",),
    "motion": ("motion", "motion_next"),
    "camera": ("camera",),
}


@dataclass(frozen=True)
class Stage:
    """A stage or a buffer, and the evidence for its use.

    Parameters
    ----------
    name : str
        A stage of `SVGF`, or a buffer of `Frame`.
    used : bool
        Whether the plan uses it.
    loss : float
        How much worse the result is without it: the mean squared error that it saves, relative to the mean squared
        change of the result from frame to frame, which is about a third of its relMSE. Of the two weightings of
        ``yester.judge.predictive_error``, the one with the higher bound. Negative where the result is better without.
    error : float
        Standard error of `loss`.
    ms : float
        Milliseconds of a frame that are saved without it, as estimated from the parts of the image that were judged:
        small ones take up to twice the time of large ones by the pixel. Around 0, and below, it costs less than the
        machine's other load hides.

    See Also
    --------
    Plan : Has one for each stage and buffer that was judged.

    Examples
    --------
    >>> yester.Stage("ids", used=True, loss=0.2, error=0.05, ms=1.5).used
    True
    """

    name: str
    used: bool
    loss: float
    error: float
    ms: float


@dataclass(frozen=True)
class Plan:
    """What a sequence needs, and why.

    Parameters
    ----------
    options : dict of str to value, default {}
        Parameters of `SVGF` that differ from the defaults.
    buffers : tuple of str, default ()
        The buffers of the second of the frames that were looked at, ``"camera"`` among them: the first may lack motion,
        and later ones may have others.
    without : tuple of str, default ()
        Those that the pipeline does not get.
    static : bool, default False
        Whether camera, scene and light stand still, so that all samples are averaged as long as they do.
    stages : tuple of Stage, default ()
        The evidence, in the order in which it was taken.
    reason : str, default ""
        Why nothing could be judged and the plan is the default; empty otherwise.

    See Also
    --------
    plan : Makes a plan from a sequence's first frames.

    Examples
    --------
    >>> yester.Plan(options={"iterations": 2}).pipeline().step(yester.Frame(np.ones((4, 4, 3))))
    Output(4x4, used=(), missing=0)
    """

    options: dict[str, Any] = field(default_factory=dict)
    buffers: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    static: bool = False
    stages: tuple[Stage, ...] = ()
    reason: str = ""

    def __post_init__(self) -> None:
        for name, known in (("buffers", BUFFERS), ("without", BUFFERS[1:])):
            given = getattr(self, name)
            strange = [given] if isinstance(given, str) else [one for one in given if one not in (*known, "camera")]
            if strange:
                raise ValueError(f"{name}: expected names of buffers, got {strange[0]!r}")

    def __str__(self) -> str:
        """A table with a line for each stage: use, evidence with its standard error, and milliseconds of a frame."""
        left = self._left_out()
        width = max((len(stage.name) for stage in self.stages), default=0)
        lines = [self.summary()]
        for stage in self.stages:
            lines.append(
                f"{stage.name:<{width}}  {'left out' if stage.name in left else 'used':<8}  "
                f"{100 * stage.loss:+7.1f} % ± {100 * stage.error:5.1f} %  {stage.ms:8.2f} ms"
            )
        return "\n".join(lines)

    def summary(self) -> str:
        """Describe the plan in one line.

        Returns
        -------
        str
            The buffers and stages that the pipeline does without, and other options; or why the plan is the default.

        Examples
        --------
        >>> yester.Plan().summary()
        'the default: nothing is superfluous'
        >>> yester.Plan(options={"choice": False, "iterations": 2}, without=("ids",)).summary()
        'without ids, choice; iterations = 2'
        """
        parts = [f"without {', '.join(left)}"] if (left := self._left_out()) else []
        if _FORGETTING in left:
            parts.append("all samples are averaged while nothing moves")
        others = {name: value for name, value in self.options.items() if name not in (*left, "average_still")}
        parts += [f"{name} = {value}" for name, value in others.items()]
        if not parts:
            return f"the default: {self.reason or 'nothing is superfluous'}"
        return "; ".join([*parts, *([f"not judged: {self.reason}"] if self.reason else [])])

    def _left_out(self) -> list[str]:
        """The buffers and stages that the pipeline does without, whatever the evidence."""
        stages = [name for name in _STAGES if not self.options.get(name, True)]
        return [*self.without, *stages, *([_FORGETTING] if self.options.get("average_still") else [])]

    def pipeline(self) -> Planned:
        """Make the pipeline.

        Returns
        -------
        Planned
            `SVGF` with the plan's options, on the buffers that the plan uses.
        """
        return Planned(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan as TOML.

        Parameters
        ----------
        path : path-like
            The file; replaced if it exists.

        Raises
        ------
        OSError
            If the file cannot be written.
        ValueError
            If a value is one that TOML lacks, such as None, or that `load` would refuse. The message names it, and no
            file is written.

        Examples
        --------
        >>> yester.Plan(options={"iterations": 2}).save("plan.toml")
        >>> yester.Plan.load("plan.toml").options
        {'iterations': 2}
        """
        options = ", ".join(f"{name} = {_toml(value, f'options.{name}')}" for name, value in self.options.items())
        named = {name: _toml(value, name) for name, value in vars(self).items() if name not in ("options", "stages")}
        lines = [
            f"version = {_VERSION}",
            f"options = {{ {options} }}",
            *(f"{name} = {value}" for name, value in named.items()),
        ]
        for stage in self.stages:
            lines += ["", "[[stages]]"]
            lines += [f"{name} = {_toml(value, f'stages.{name}')}" for name, value in vars(stage).items()]
        text = "\n".join(lines) + "\n"
        _parsed(text)
        with beside(Path(path)) as temporary:
            temporary.write_text(text, encoding="utf-8")

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Plan:
        """Read a plan that `save` has written.

        Parameters
        ----------
        path : path-like
            The file.

        Returns
        -------
        Plan
            With all that was saved.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is not TOML, of another version, lacks a key, has an unknown one, or a value is wrong. The message
            names the file and the key.
        """
        try:
            return _parsed(Path(path).read_text(encoding="utf-8"))
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: not a plan: {error}") from None
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from None


class Planned:
    """The pipeline of a `Plan`: `SVGF` with its options, on the buffers that it uses.

    Parameters
    ----------
    plan : Plan
        As `plan` or `Plan.load` returns it.

    See Also
    --------
    Plan.pipeline : Makes it, too.
    denoise : Runs it over a sequence, from both sides.

    Examples
    --------
    >>> pipeline = yester.Planned(yester.Plan(options={"iterations": 2}, without=("ids",)))
    >>> frame = yester.Frame(np.ones((4, 4, 3)), ids=np.ones((4, 4), np.uint32), depth=np.ones((4, 4)))
    >>> pipeline.step(frame).used
    ('depth',)
    """

    def __init__(self, plan: Plan) -> None:
        if not isinstance(plan, Plan):
            raise TypeError(f"plan: expected yester.Plan, got {type(plan).__name__}")
        self.plan = plan
        self._svgf = SVGF(**plan.options)
        self._steps = 0

    def __repr__(self) -> str:
        return f"Planned({self.plan!r})"

    def step(self, frame: Frame, out: Output | None = None) -> Output:
        """Denoise the next frame, as `SVGF.step` does.

        Parameters
        ----------
        frame : Frame
            The next frame, with all of its buffers: those that the plan leaves out are dropped here.
        out : Output, optional
            As in `SVGF.step`.

        Returns
        -------
        Output
            The denoised frame.

        Raises
        ------
        ValueError
            If the sequence's second frame has a buffer that the plan was not made for, or lacks one that it was made
            for. As in `SVGF.step`.
        """
        output = self._svgf.step(_planned(self.plan, frame, self._steps), out)
        self._steps += 1
        return output

    def reset(self) -> None:
        """Discard all history; the next frame starts a new sequence."""
        self._svgf.reset()
        self._steps = 0

    def __copy__(self) -> Planned:
        other = Planned(self.plan)
        other._svgf = copy.copy(self._svgf)
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Without history, as of all pipelines: what is unpickled, or copied deeply, starts a new sequence."""
        return {**vars(self), "_steps": 0}


def taken_apart(pipeline: Planned, frames: Iterable[Frame]) -> tuple[SVGF, Iterator[Frame]]:
    """The plan's `SVGF`, and the frames as it gets them."""
    return pipeline._svgf, (_planned(pipeline.plan, frame, number) for number, frame in enumerate(frames))


def _planned(plan: Plan, frame: Frame, number: int) -> Frame:
    """The frame without the buffers that the plan leaves out; refused if it is of another sequence than the plan's."""
    if not isinstance(frame, Frame):
        raise TypeError(f"frame: expected a yester.Frame, got {type(frame).__name__}")
    # The second frame tells whether the plan is for this sequence: the first may lack motion.
    if number == 1 and (misfit := unsuited(plan, _buffers(frame))):
        raise ValueError(f"frame: {misfit}")
    return _lacking(frame, plan.without)


def unsuited(plan: Plan, given: Sequence[str]) -> str:
    """Why a plan is not for a sequence whose second frame has the given buffers; empty if it is."""
    # A default that nothing was judged for fits all.
    if not plan.buffers or plan.reason:
        return ""
    # The last frame has no motion to a next one.
    absent = [name for name in plan.buffers if name not in (*given, "motion_next")]
    strange = [*absent, *(name for name in given if name not in plan.buffers)]
    expected, got = ", ".join(plan.buffers), ", ".join(given)
    return f"{strange[0]}: expected the buffers of the plan, {expected}, got {got}" if strange else ""


def split_at_cuts(frames: Iterable[Frame]) -> Iterator[Iterator[Frame]]:
    """Split a sequence where one shot ends and another begins.

    A plan is for one shot, and after a cut there is nothing to be learnt from the frames before.

    Parameters
    ----------
    frames : iterable of Frame
        A sequence of frames of one size.

    Yields
    ------
    iterator of Frame
        A shot. All share `frames`, as with `itertools.groupby`: the frames of a shot are to be taken before the next
        one is asked for.

    Raises
    ------
    TypeError
        If one is no `Frame`, when that is reached.
    ValueError
        If sizes differ.

    See Also
    --------
    plan : What a shot needs.
    disocclusion : The pixels that are not found again.

    Notes
    -----
    Pixels are found again if depth, normals and ids, those that there are, agree with those at the other end of the
    motion, as `reproject` tests them. A cut is where less than a quarter as many are found as in the frame before, if
    those were at least a tenth of all. Two shots of places that look alike may stay together; so do frames without
    these buffers. Without motion, and cameras with depth or position, pixels are looked for where they are. A shot has
    at least two frames.

    A cut to another view of the same place may find more than that, and then is none: its history is of use.

    Examples
    --------
    >>> near, far = (yester.Frame(np.ones((4, 4, 3)), depth=np.full((4, 4), z)) for z in (1.0, 9.0))
    >>> [len([*shot]) for shot in yester.split_at_cuts([near, near, near, far, far])]
    [3, 2]
    """

    def numbered() -> Iterator[tuple[int, Frame]]:
        number, before, share = 0, None, 0.0
        for frame in alike(frames):
            found = 0.0 if before is None else found_again(before, frame)
            # What is found behind a cut tells nothing of the next one.
            cut = share >= _FOUND and found < _LOST * share
            number, before, share = number + cut, frame, 0.0 if cut else found
            yield number, frame

    for _, shot in groupby(numbered(), itemgetter(0)):
        yield map(itemgetter(1), shot)


def plan(frames: Iterable[Frame], *, count: int = PLANNED) -> Plan:
    """Find out what a sequence needs from its first frames: which stages of `SVGF`, and which buffers.

    `SVGF` runs over these frames as it is by default, and without each stage and buffer in turn. New samples judge
    the results (``yester.judge.predictive_error``). The choice of passes and buffers are left out only if the result is
    better without, at two standard errors: by 5 % of its change from frame to frame, 1 to 2 % of its relMSE, and for
    buffers by 12.5 %, or 50 % if they are worth most at edges (position, depth, normals, ids, camera) and find
    surfaces again. Gradient, innovation and reflections are judged but always used: they are there for what the first
    frames may not show. Cameras are not judged while nothing moves, if there is no `motion`. The combination is judged
    once more. Without evidence, everything is used. How many passes filter a tile is no part of a plan, since `SVGF`
    chooses that itself, frame by frame.

    What seems superfluous is judged once more with the frames in reverse order, and must be so in the mean of both:
    results that are blurred in the direction in which light moves seem better than they are, and in reverse worse.
    Albedo is left out only if at least half of the pixels are compared: edges are not, and of grass and fur hardly any
    pixel is.

    If camera and scene stand still and the light is constant, all samples are averaged as long as nothing moves
    (``average_still=True``), unless that is significantly worse.

    Parameters
    ----------
    frames : iterable of Frame
        A sequence from its beginning, of one size. Only the first `count` frames are taken.
    count : int, default 8
        How many frames to look at, at least 5.

    Returns
    -------
    Plan
        The default, with a `UserWarning` and a ``reason``, if nothing can be judged: fewer than five frames, no depth,
        normals or ids, no finite samples, values above 1e18, noise that is the same in most frames, no motion and no
        camera with depth or position to compute it from, no pixel that is found again in the next frame, or nothing
        that changes from frame to frame, as in black or constant images.

    Raises
    ------
    TypeError
        If one is no `Frame`, or `count` is no integer.
    ValueError
        If sizes differ or `count` is below 5.

    See Also
    --------
    Plan : The result, which can be saved and makes the pipeline.
    split_at_cuts : The shots of a sequence, each of which needs a plan of its own.
    SVGF : The pipeline that a plan configures.

    Notes
    -----
    Images of more than twice as many pixels as four windows of 128×96 are judged by these; a stage that has no chance
    after some of them is not run on the others. At 1280×720 a plan then takes less than ten frames' time, at smaller
    sizes more. Antialiasing is always used, since the judge does not see edges.

    The rule of one standard error, to take the cheapest that is not significantly worse than the best, does harm: where
    evidence is weak, it leaves out what is needed.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> known = {"depth": np.full((16, 16), 2.0), "motion": np.ones((16, 16, 2))}
    >>> frames = [yester.Frame(rng.gamma(1, 0.5, (16, 16, 3)), **known) for _ in range(6)]
    >>> found = yester.plan(frames)
    >>> pipeline = found.pipeline()
    >>> images = [pipeline.step(frame).color for frame in frames]
    >>> found.buffers
    ('color', 'depth', 'motion')
    """
    if not isinstance(count, Integral):
        raise TypeError(f"count: expected an integer, got {type(count).__name__}")
    if count < _FEWEST:
        raise ValueError(f"count: expected at least {_FEWEST}, got {count}")
    shape: tuple[int, int] = (0, 0)
    given: dict[str, None] = {}
    buffers: tuple[str, ...] = ()
    windows: list[list[Frame]] = []
    for frame in alike(islice(frames, count)):
        shape = frame.shape
        given.update(dict.fromkeys(_buffers(frame)))
        if len(windows) < 2:
            buffers = tuple(_buffers(frame))
        windows.append([_cropped(frame, *window) for window in _windows(*shape)])
    if len(windows) < _FEWEST:
        return _default(buffers, f"expected at least {_FEWEST} frames to judge by, got {len(windows)}")
    if not {"depth", "normal", "ids"} & given.keys():
        return _default(buffers, "neither depth nor normals nor ids tell surfaces apart")
    if not any(np.isfinite(window.color).all(-1).any() for each in windows for window in each):
        return _default(buffers, "no frame has finite samples")
    if any(((np.abs(w.color) > LARGEST) & np.isfinite(w.color)).any() for each in windows for w in each):
        return _default(buffers, "values too large to judge")
    shown = [*zip(*windows, strict=True)]
    # Of most frames, as one may have been rendered twice.
    if np.median([repetitions(window) for window in shown]) > REPEATS:
        return _default(buffers, "frames have the noise of the frame before, and cannot judge")
    if any(known_motion(*pair) is None for pair in pairwise(shown[0])):
        return _default(buffers, UNMOVED)
    # Brighter values than a display shows would have no weight.
    bright = np.median([exposure(window.color) for each in shown for window in each])
    if bright > _BRIGHT:
        shown = [tuple(_dimmed(window, _BRIGHT / bright) for window in each) for each in shown]
    found = _Planning(shown, tuple(given), shape).plan()
    return _default(buffers, found) if isinstance(found, str) else replace(found, buffers=buffers)


def _dimmed(frame: Frame, factor: float) -> Frame:
    radiance = {name: getattr(frame, name) for name in ("color", "emission", "replay")}
    return replace(frame, **{name: image * np.float32(factor) for name, image in radiance.items() if image is not None})


def _default(buffers: tuple[str, ...], reason: str) -> Plan:
    warnings.warn(f"plan: {reason}; this is the default", UserWarning, stacklevel=3)
    return Plan(buffers=buffers, reason=reason)


class _Trial(NamedTuple):
    """`SVGF` with other options, or without some buffers.

    A plan leaves these out if the loss plus `errors` standard errors does not exceed `allowed`.
    """

    name: str
    options: Mapping[str, Any] = MappingProxyType({})
    without: tuple[str, ...] = ()
    allowed: float = _MARGIN
    errors: float = _STRICTNESS

    def beside(self, base: _Trial) -> _Trial:
        """Combine this trial's omissions with those of the base."""
        without = tuple(dict.fromkeys((*base.without, *self.without)))
        return self._replace(options={**base.options, **self.options}, without=without)

    @property
    def key(self) -> str:
        """Trials with equal keys have equal results."""
        return f"{dict(self.options)} {self.without}"


class _Run(NamedTuple):
    """The results of a trial in a window: images, milliseconds of the fastest frame, and mean length of history."""

    images: list[NDArray[np.float32]]
    ms: float
    length: float


class _Planning:
    """Trials and their evidence on the first frames."""

    def __init__(self, windows: Sequence[Sequence[Frame]], given: tuple[str, ...], shape: tuple[int, int]) -> None:
        self.windows, self.given = windows, given
        #: Whether neither cameras nor anything else moves.
        self.rests = all(rests(*pair) for window in windows for pair in pairwise(window))
        self.runs: dict[tuple[int, str, bool], _Run] = {}
        # Not timed: first runs are slower.
        self.run(0, _Trial("warm-up"))
        self.runs.clear()
        #: Pixels of a frame divided by the pixels of all windows.
        self.scale = math.prod(shape) / sum(math.prod(window[0].shape) for window in windows)

    def plan(self) -> Plan | str:
        """The plan, or why the frames tell nothing."""
        default = _Trial("default")
        if not self.changes(default):
            return "nothing changes from frame to frame"
        groups = {name: tuple(n for n in group if n in self.given) for name, group in _GROUPS.items()}
        if self.rests and "motion" not in self.given:
            # Cameras alone tell that frames rest, and how they move later: now, nothing shows their worth.
            del groups["camera"]
        # What distinguishes surfaces finds them again, unless it is broken.
        surfaces = ("position", "normal", "depth", "ids", "camera") if self.finds(default) else ()
        of_buffers = [
            _Trial(name, {}, group, _SURFACE_HARM if name in surfaces else _HARM)
            for name, group in groups.items()
            if name in group
        ]
        rounds = [
            # Without it first, as without depth there is no position either.
            [trial for trial in of_buffers if trial.name == "position"],
            [trial for trial in of_buffers if trial.name != "position"],
            [
                _Trial("choice", {"choice": False}, (), -_MARGIN),
                _Trial("gradient", {"gradient": False}, (), -np.inf),
                _Trial("innovation", {"innovation": False}, (), -np.inf),
            ],
        ]
        if "camera" in self.given and {"depth", "position"} & {*self.given}:
            rounds[-1].append(_Trial("reflections", {"reflections": ()}, (), -np.inf))
        if self.static(default):
            rounds[-1].append(_Trial(_FORGETTING, {"average_still": True}, (), 0.0, -_STRICTNESS))
        base, evidence = default, list[Stage]()
        for trials in rounds:
            found = self.judge(base, [trial.beside(base) for trial in trials])
            useless = {stage.name for stage in found if not stage.used}
            evidence += [replace(stage, used=stage.name not in useless) for stage in found]
            for trial in trials:
                if trial.name in useless:
                    bounds = max(trial.allowed, _MARGIN), min(trial.errors, base.errors)
                    base = trial.beside(base)._replace(allowed=bounds[0], errors=bounds[1])
        if all(math.isnan(stage.loss) for stage in evidence):
            return "no pixel is found again in the next frame"
        if sum(not stage.used for stage in evidence) > 1:
            (together,) = self.judge(default, [base])
            if together.used:
                base, evidence = default, [replace(stage, used=True) for stage in evidence]
        return Plan(dict(base.options), self.given, base.without, "average_still" in base.options, tuple(evidence))

    def judge(self, base: _Trial, trials: Sequence[_Trial]) -> list[Stage]:
        """The evidence for each trial, window by window; trials whose loss is already certain skip further windows."""
        left = [*trials]
        found: dict[str, list[NDArray[np.float64]]] = {trial.name: [] for trial in trials}
        for number, window in enumerate(self.windows):
            if left:
                for lacking in dict.fromkeys(trial.without for trial in left):
                    alike = [trial for trial in left if trial.without == lacking]
                    images = [self.run(number, trial).images for trial in alike]
                    # A buffer that is broken must not select the pixels that tell whether it is.
                    parts = sums(images, self.run(number, base).images, window, start=_START, untested=lacking)
                    for trial, part in zip(alike, parts, strict=True):
                        found[trial.name].append(part.reshape(*part.shape[:3], -1))
            left = [trial for trial in left if not _bound(found[trial.name], -_STRICTNESS)[0] > trial.allowed]
        result = []
        for trial in trials:
            parts = np.concatenate(found[trial.name], -1)
            useless, loss, error = _decide(trial, parts)
            if "albedo" in trial.without:
                useless &= self.share(parts) > _MOST
            if useless and trial.errors > 0:
                # The next frame's light has moved on. A result that differs in its direction seems better, but not when
                # time runs backwards, as the light then moves the other way.
                useless, loss, error = _decide(trial, parts + self.backwards(base, trial))
            numbers = range(len(found[trial.name]))
            saved = sum(self.run(number, base).ms - self.run(number, trial).ms for number in numbers)
            ms = saved * self.scale * len(self.windows) / len(numbers)
            result.append(Stage(trial.name, not useless, loss, error, ms))
        return result

    def share(self, parts: NDArray[np.float64]) -> float:
        """The share of pixels that were compared, by the sums of all windows."""
        return float(parts[:, 0, 1].sum()) / (len(parts) * sum(math.prod(window[0].shape) for window in self.windows))

    def backwards(self, base: _Trial, trial: _Trial) -> NDArray[np.float64]:
        """The sums for a trial of frames in reverse order, frame by frame as those of the usual order."""
        parts = []
        for number, window in enumerate(self.turned):
            images, others = (self.run(number, each, backwards=True).images for each in (trial, base))
            (part,) = sums([images], others, window, start=_START, untested=trial.without)
            parts.append(part[::-1].reshape(*part.shape[:3], -1))
        return np.concatenate(parts, -1)

    @cached_property
    def turned(self) -> list[list[Frame]]:
        """The windows in reverse order."""
        return [_reversed(window) for window in self.windows]

    def run(self, number: int, trial: _Trial, *, backwards: bool = False) -> _Run:
        """The results of a trial in a window, computed once."""
        key = number, trial.key, backwards
        if key not in self.runs:
            svgf, images, spent = SVGF(**trial.options), [], []
            for frame in (self.turned if backwards else self.windows)[number]:
                lacking = _lacking(frame, trial.without)
                start = time.perf_counter()
                # A window may show nothing but an object that moves by itself. The planned pipeline sees whole frames.
                output, _ = collect_warnings(svgf.step, lacking)
                spent.append(1e3 * (time.perf_counter() - start))
                images.append(output.color)
            length = float(output.history_length.mean())
            self.runs[key] = _Run(images, min(spent[_START:]), length)
        return self.runs[key]

    def finds(self, trial: _Trial) -> bool:
        """Whether more than a few pixels are found again, by all buffers that tell surfaces apart."""
        found = total = 0.0
        for number, window in enumerate(self.windows):
            images = self.run(number, trial).images
            # The second of each tile's sums is the number of its pixels that are compared.
            found += float(sums([images], images, window, start=_START)[0, :, 0, 1].sum())
            total += math.prod(window[0].shape) * (len(window) - 1 - _START)
        return found > _FEW * total

    def changes(self, trial: _Trial) -> bool:
        """Whether results change from frame to frame by more than rounding, so that there is something to judge by."""
        images = [self.run(number, trial).images for number in range(len(self.windows))]
        moved = max(_mean_square(b - a) for each in images for a, b in pairwise(each))
        return moved > _NOTHING * max(_mean_square(each[-1]) for each in images)

    def static(self, trial: _Trial) -> bool:
        """Whether camera, scene and light stand still: motion is zero, and history hardly ever cut short."""
        lengths = [self.run(number, trial).length for number in range(len(self.windows))]
        # By default, the longest history has 1 / alpha = 5 samples.
        return self.rests and float(np.mean(lengths)) >= _CONSTANT * min(len(self.windows[0]), 5)


def _decide(trial: _Trial, parts: NDArray[np.float64]) -> tuple[bool, float, float]:
    """Whether the sums show what a trial leaves out to be useless, the loss, and its standard error."""
    bound, loss, error = _bound([parts], trial.errors)
    # Both halves must agree, so that a change of light in a single frame does not decide.
    half = len(parts) // 2
    halves = [_bound([span], min(trial.errors, 0))[0] for span in (parts[:half], parts[half:])]
    useless = all(each <= trial.allowed for each in (bound, *halves))
    # Where motion is wrong, results change so much that 5 % of the change is a clear loss.
    return useless and (trial.errors < 0 or loss <= 0), loss, error


def _reversed(frames: Sequence[Frame]) -> list[Frame]:
    """Frames in reverse order, with the motion that then leads to the frame before."""
    known = []
    for frame, following in pairwise(frames):
        motion = frame.motion_next
        # Without motion, cameras tell it, as they do forwards; a trial may be without them.
        if motion is None and following.motion is not None:
            motion = inverse_motion(following.motion, frame, following)
        known.append(turned(replace(frame, motion_next=motion)))
    return [turned(replace(frames[-1], motion_next=None)), *reversed(known)]


def _bound(parts: list[NDArray[np.float64]], errors: float) -> tuple[float, float, float]:
    """The loss plus some standard errors, the loss, and the standard error, of the weighting with the highest bound.

    NaN if nothing can be compared.
    """
    bounds = []
    for each in estimate(np.concatenate(parts, -1)).values():
        scale = each.change if each.change > 0 else math.nan
        loss, error = each.difference / scale, each.error / scale
        bounds.append((loss + errors * error, loss, error))
    return max(bounds, key=lambda bound: math.inf if math.isnan(bound[0]) else bound[0])


def _mean_square(image: NDArray[np.float32]) -> float:
    return float(np.square(image, dtype=np.float64).mean())


def _buffers(frame: Frame) -> list[str]:
    return [*frame.buffers(), *(["camera"] if frame.camera is not None else [])]


def _lacking(frame: Frame, names: Sequence[str]) -> Frame:
    """The frame without some of its buffers."""
    absent: dict[str, Any] = dict.fromkeys(names)
    return replace(frame, **absent) if absent else frame


def _windows(height: int, width: int) -> list[tuple[slice, slice]]:
    """The parts of an image that are judged: windows in the middle of equal parts, or all of a small image."""
    if height * width <= 2 * _ALONG**2 * _WINDOW[0] * _WINDOW[1]:
        return [(slice(0, height), slice(0, width))]
    sides = []
    for side, most in zip((height, width), _WINDOW, strict=True):
        size = min(side // _ALONG, most)
        starts = [(2 * i + 1) * side // (2 * _ALONG) - size // 2 for i in range(_ALONG)]
        sides.append([slice(start, start + size) for start in starts])
    return [(rows, columns) for rows in sides[0] for columns in sides[1]]


def _cropped(frame: Frame, rows: slice, columns: slice) -> Frame:
    """A part of a frame, seen by a camera of its own."""
    camera = frame.camera
    height, width = rows.stop - rows.start, columns.stop - columns.start
    if (height, width) == frame.shape:
        return frame
    if camera is not None:
        # Pixels are affine in normalised coordinates; y points down in one and up in the other.
        clip = np.array(camera.world_to_clip)
        clip[0] = (clip[0] * frame.width + clip[3] * (frame.width - 2 * columns.start - width)) / width
        clip[1] = (clip[1] * frame.height - clip[3] * (frame.height - 2 * rows.start - height)) / height
        camera = Camera(clip, width, height)
    buffers = {name: array[rows, columns] for name, array in frame.buffers().items()}
    return Frame(**buffers, camera=camera, jitter=frame.jitter)


#: The keys of the file, and of each stage in it, with the types of their values.
_KINDS = {"options": dict, "buffers": list, "without": list, "static": bool, "stages": list, "reason": str}
_STAGE_KINDS = {"name": str, "used": bool, "loss": float, "error": float, "ms": float}


def _check_keys(found: Any, kinds: Mapping[str, type], prefix: str = "") -> None:
    if not isinstance(found, dict):
        raise ValueError(f"{prefix.rstrip('.')}: expected tables, got {type(found).__name__}")
    for name in found:
        if name not in kinds:
            raise ValueError(f"{prefix}{name}: unknown key; expected some of {', '.join(kinds)}")
    for name, kind in kinds.items():
        if name not in found:
            raise ValueError(f"{prefix}{name}: missing key")
        # TOML has integers, too, which are numbers as well.
        if not isinstance(found[name], kind) and not (kind is float and type(found[name]) is int):
            raise ValueError(f"{prefix}{name}: expected {kind.__name__}, got {type(found[name]).__name__}")


def _check_options(options: Mapping[str, Any]) -> None:
    for name, value in options.items():
        try:
            SVGF(**{name: value})
        except (TypeError, ValueError) as error:
            raise ValueError(f"options.{name}: {str(error).removeprefix(f'{name}: ')}") from None


def _parsed(text: str) -> Plan:
    """The plan that a file has; ValueError, with the key, if there is none."""
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not a plan: {error}") from None
    if (version := found.pop("version", None)) != _VERSION:
        raise ValueError(f"version: expected {_VERSION}, got {version}")
    # The file of a default plan has no stages.
    _check_keys({"stages": [], **found}, _KINDS)
    for stage in found.setdefault("stages", []):
        _check_keys(stage, _STAGE_KINDS, "stages.")
    found["options"] = {n: tuple(v) if isinstance(v, list) else v for n, v in found["options"].items()}
    _check_options(found["options"])
    found |= {name: tuple(found[name]) for name in ("buffers", "without")}
    return Plan(**found | {"stages": tuple(Stage(**stage) for stage in found["stages"])})


def _toml(value: Any, name: str) -> str:
    """A value as TOML writes it: numbers as Python does, the rest as JSON."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(one, name) for one in value)}]"
    if not isinstance(value, bool | int | float | str):
        raise ValueError(f"{name}: expected a value that TOML has, got {value!r}")
    return repr(float(value)) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
