"""Stress tests: methods on known failures and extreme inputs, measured against exact references, with a verdict.

`examine` runs the failures that users report (`failures`), `strain` extreme values, sizes and buffers, `endure`
sequences of thousands of frames. All return a `Trial` for each method, with a verdict by `LIMITS`. `run` runs all of
them and writes the results.
"""

from __future__ import annotations

import csv
import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import psutil
from numpy.typing import NDArray
from tqdm import tqdm

from yester import Camera, Frame
from yester.io.files import beside
from yester.metrics import Picture, edge_sharpness, flicker, ghost, lag, psnr, relmse, srgb

from ..compare.methods import PIPELINES, Method, Result, current_name
from .failures import FAILURES, SCENARIOS, TRAIL, Scenario, Shot
from .raycast import Light, Rectangle, Scene, Sphere, Thing, checker, noise, shoot, translate, truth, turn, value_noise

__all__ = ["INPUT", "LIMITS", "STRAINS", "Limit", "Report", "Strain", "Trial", "endure", "examine", "run", "strain"]

T = TypeVar("T")
Image: TypeAlias = NDArray[np.float32]
Verdict: TypeAlias = Literal["holds", "degrades", "fails"]

_VERDICTS: tuple[Verdict, ...] = ("holds", "degrades", "fails")
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Limit:
    """The bounds of a measure up to which a method holds and up to which it degrades; beyond, it fails.

    Attributes
    ----------
    measure : str
        Name of the measure.
    holds, degrades : float
        Bounds of its magnitude.
    why : str
        Definition of the measure, and reason for its bounds.
    """

    measure: str
    holds: float
    degrades: float
    why: str

    def judge(self, value: float) -> Verdict:
        """The verdict on a value."""
        return "holds" if abs(value) <= self.holds else "degrades" if abs(value) <= self.degrades else "fails"


#: The measures of the verdict. The worst of those that apply to a case decides.
LIMITS: tuple[Limit, ...] = (
    Limit("lost", 0, 0, "Pixels of the output that are not finite. Not a single one is acceptable."),
    Limit(
        "ghost",
        0.15,
        0.5,
        "Largest weight of the outdated image in the output, from the event on. The outdated image is the reference "
        "before the event or, with continuous motion, that of four frames ago. Where what moves turns back, the "
        "latter is nearly the reference: frames in which it differs less than half as much (in squares) as in the "
        "median frame do not count. A seventh of an edge's contrast is a faint double image; with half of it, past "
        "and present are equally visible.",
    ),
    Limit(
        "early",
        0.15,
        0.5,
        "Largest weight of the image after the event in the four frames before it. Only methods that use later frames "
        "can show an event too early.",
    ),
    Limit(
        "lag",
        2,
        8,
        "Frames after the event until the ghost stays below a tenth. At 60 frames per second, two frames are the "
        "latency of a display; eight are 130 ms, which every viewer notices.",
    ),
    Limit(
        "flicker",
        0.01,
        0.03,
        "Standard deviation over time, in the last quarter of the frames, of sRGB values from 0 to 1 in pixels whose "
        "reference is constant. 2.5 of 255 steps are at the threshold of vision; three times as much is obvious.",
    ),
    Limit(
        "bias",
        0.02,
        0.1,
        "Relative error of the mean luminance of the affected pixels, late in the sequence. Two percent are the "
        "threshold of contrast (Weber's law); with ten percent, the brightness of an image is visibly wrong.",
    ),
    Limit(
        "blur",
        0.25,
        0.5,
        "Loss of slope at the strongest edges, relative to the reference. A tent filter of one pixel's radius instead "
        "of the reference's box costs 0.1 to 0.2 in these scenes, which is a matter of taste. One bilinear resampling "
        "by half a pixel costs 0.2 to 0.37. With half the slope, every edge of one pixel is two pixels wide.",
    ),
    Limit(
        "error",
        0.5,
        1,
        "relMSE of the affected pixels relative to that of the input, or to 0.01 where the input has less, which is "
        "the cost of aliasing alone here. Twice the samples would halve the squared error without any history; more "
        "than the input's error is harm.",
    ),
    Limit(
        "difference",
        0.02,
        0.25,
        "Mean difference from the output in ordinary conditions, relative to its mean. Two percent are invisible; a "
        "quarter is another image.",
    ),
    Limit(
        "drift",
        0.002,
        0.02,
        "Change of the mean luminance from the beginning to the end of a long run, by linear regression, relative to "
        "the reference. The bounds are a tenth of the threshold of contrast, and the threshold.",
    ),
    Limit(
        "growth",
        0.1,
        0.5,
        "Relative growth of relMSE from the first tenth of a long run to the last. The noise of this measure is below "
        "a tenth.",
    ),
    Limit(
        "memory",
        4,
        32,
        "Growth of the process after the first tenth of a long run, in MiB. Allocators cause a few; a leak of one row "
        "of pixels per frame adds up to five in ten thousand frames.",
    ),
)


@dataclass(frozen=True)
class Trial:
    """The result of one method in one case.

    Attributes
    ----------
    part : "failures", "strains" or "endurance"
    case, method : str
        Names of case and method.
    values : dict of str to float
        By measure: those of `LIMITS` that apply, and others.
    verdict : "holds", "degrades" or "fails"
    reason : str
        The decisive measures with their values, or the error that the method raised.
    worst : (H, 4 W, 3) uint8 or None
        The frame with the largest relMSE: input, output, reference and four times the error, from left to right.
    """

    part: str
    case: str
    method: str
    values: dict[str, float]
    verdict: Verdict
    reason: str
    worst: NDArray[np.uint8] | None = field(default=None, repr=False)


#: The noisy frames themselves, for comparison.
INPUT = Method("input", "input", lambda frames: (Result(frame.color) for frame in frames))


def examine(
    scenario: Scenario, methods: Sequence[Method] = PIPELINES, *, seed: int = 0, frames: int | None = None
) -> list[Trial]:
    """Run methods on a scenario.

    Parameters
    ----------
    scenario : Scenario
    methods : sequence of Method, default `PIPELINES`
    seed, frames
        As for `Scenario.shots`.

    Returns
    -------
    list of Trial
        The input itself comes first, then the methods in order. A method that raises an exception fails.
    """
    shots = [*scenario.shots(seed, frames)]
    stage = _Stage(scenario, shots)
    trials: list[Trial] = []
    for method in (INPUT, *methods):
        run = _Run(method)
        images = [*run.on(shot.frame for shot in shots)]
        values, worst = ({}, None) if run.error else stage.measure(images)
        if values:
            values["error"] = values["relmse"] / max((trials[0].values if trials else values)["relmse"], 0.01)
        trials.append(_judged("failures", scenario.name, run, values, worst))
    return trials


@dataclass(frozen=True)
class Strain:
    """An extreme kind of input.

    Attributes
    ----------
    name : str
    frames : callable
        Makes the frames.
    ordinary : callable or None
        Makes ordinary frames, whose first and last outputs should be equal to those of `frames` divided by `scale`;
        None if there are none.
    scale : float, default 1
        Divisor of the output before the comparison.
    """

    name: str
    frames: Callable[[], Sequence[Frame]]
    ordinary: Callable[[], Sequence[Frame]] | None
    scale: float = 1.0


def strain(case: Strain, methods: Sequence[Method] = PIPELINES) -> list[Trial]:
    """Run methods on a strain's short sequence.

    Parameters
    ----------
    case : Strain
    methods : sequence of Method, default `PIPELINES`

    Returns
    -------
    list of Trial
        With ``lost``, the number of pixels that are not finite, over all frames, and, if there are ordinary frames,
        ``difference``, the larger one of the first and the last frame. A method that raises an exception on either
        fails.
    """
    trials = []
    for method in methods:
        run, ordinary = _Run(method), _Run(method)
        images = [*run.on(case.frames())]
        usual = [*ordinary.on(case.ordinary())] if case.ordinary else []
        values: dict[str, float] = {"lost": _lost(images)}
        if images and usual:
            values["difference"] = max(
                _difference(images[at].astype(np.float64) / case.scale, usual[at]) for at in (0, -1)
            )
        trials.append(_judged("strains", case.name, run if run.error else ordinary, values))
    return trials


def endure(method: Method, *, moving: bool, frames: int = 10_000, seed: int = 0, progress: bool = True) -> Trial:
    """Run a method on a long sequence, to see whether brightness, error and memory are stable.

    The frames are 48×32 pixels of a small scene. The camera stands still, or moves by fractions of a pixel on a circle
    of 128 frames.

    Parameters
    ----------
    method : Method
    moving : bool
        Whether the camera moves.
    frames : int, default 10000
        At least 100.
    seed : int, default 0
        Seed of the noise.
    progress : bool, default True
        Whether to show a progress bar.

    Returns
    -------
    Trial
        With ``bias``, ``drift``, ``growth``, ``lost``, ``relmse`` of the last tenth, and ``memory``.
    """
    if frames < 100:
        raise ValueError(f"frames: expected at least 100, got {frames}")
    tour = _tour(moving)
    run = _Run(method)
    lost, begin, energies, errors, times = 0, 0.0, [], [], []
    case = f"{frames} frames, {'moving' if moving else 'still'}"
    images, shows = run.on(_toured(tour, frames, seed)), None if progress else True
    every = tqdm(images, f"{method.name}, {case}", frames, unit="frame", disable=shows, leave=False)
    for i, image in enumerate(every):
        lost += _lost([image])
        if i == frames // 10:
            begin = _resident()
        # The stride has no common factor with the length of the tour, so that all its frames are measured.
        if i >= 64 and i % 7 == 0:
            shown, expected = np.nan_to_num(image), tour[i % len(tour)][1]
            energies.append(np.mean(shown @ _LUMINANCE) / np.mean(expected @ _LUMINANCE))
            errors.append(relmse(shown, expected))
            times.append(i / frames)
    values: dict[str, float] = {}
    if run.error is None:
        tenth = max(len(errors) // 10, 1)
        values = {
            "lost": lost,
            "bias": float(np.mean(energies) - 1),
            "drift": float(np.polyfit(times, energies, 1)[0]),
            "growth": float(np.mean(errors[-tenth:]) / np.mean(errors[:tenth]) - 1),
            "relmse": float(np.mean(errors[-tenth:])),
        }
        if begin > 0:
            values["memory"] = _resident() - begin
    return _judged("endurance", case, run, values)


@dataclass(frozen=True)
class Report:
    """The results of all stress tests.

    Attributes
    ----------
    folder : Path
        The folder of the written results.
    trials : list of Trial
    """

    folder: Path
    trials: list[Trial]

    def __str__(self) -> str:
        return "\n".join(_table(part, trials) for part, trials in self.parts.items())

    @property
    def parts(self) -> dict[str, list[Trial]]:
        """The trials by `Trial.part`."""
        return {part: [t for t in self.trials if t.part == part] for part in dict.fromkeys(t.part for t in self.trials)}


def run(
    folder: str | os.PathLike[str],
    scenarios: Iterable[str] | None = None,
    methods: Iterable[str] | None = None,
    *,
    frames: int | None = None,
    strains: bool = True,
    endurance: int = 10_000,
    quick: bool = False,
    seed: int = 0,
    pipelines: Sequence[Method] = PIPELINES,
) -> Report:
    """Run all failures, strains and long runs on all methods, and write the results.

    Parameters
    ----------
    folder : path
        For ``stress.csv`` with all measures, ``stress.md`` with the verdicts and the definitions of the measures, and
        ``worst/SCENARIO-METHOD.png`` with, from left to right, input, output, reference and four times the error of
        the worst frame. Created if missing. Files of these names are replaced, and all PNG files in ``worst`` removed.
    scenarios, methods : iterable of str, optional
        Names; by default all of `SCENARIOS` and of `pipelines`.
    frames : int, optional
        Maximum number of frames of each scenario, at least 2.
    strains : bool, default True
        Whether to run `STRAINS`.
    endurance : int, default 10000
        Frames of the long runs, with still and with moving camera; 0 for none.
    quick : bool, default False
        Whether to skip strains and long runs, and run 16 frames of each scenario unless `frames` is given.
    seed : int, default 0
        Seed of all noise.
    pipelines : sequence of Method, default `PIPELINES`
        The methods that `methods` chooses from.

    Returns
    -------
    Report
        Its text is the tables of verdicts.

    Raises
    ------
    ValueError
        If a name is unknown, or a number of frames too small.
    """
    staged = _chosen("scenarios", scenarios, {scenario.name: scenario for scenario in SCENARIOS})
    named = None if methods is None else [current_name(name) for name in methods]
    chosen = _chosen("methods", named, {method.name: method for method in pipelines})
    if quick:
        frames, strains, endurance = frames or 16, False, 0
    if frames is not None and frames < 2:
        raise ValueError(f"frames: expected at least 2, got {frames}")
    if endurance and endurance < 100:
        raise ValueError(f"endurance: expected 0 or at least 100, got {endurance}")
    folder = Path(folder)
    try:
        (folder / "worst").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"{folder}: cannot be written: {error.strerror}") from None

    for picture in (folder / "worst").glob("*.png"):
        picture.unlink()
    trials: list[Trial] = []
    for scenario in _progress(staged, "failures"):
        for trial in examine(scenario, chosen, seed=seed, frames=frames):
            trials.append(trial)
            if trial.worst is not None and trial.method != INPUT.name:
                _write_picture(folder / "worst" / f"{_slug(trial.case)}-{_slug(trial.method)}.png", trial.worst)
    for case in _progress(STRAINS if strains else [], "strains"):
        trials += strain(case, chosen)
    long = [(method, moving) for moving in (False, True) for method in chosen if endurance]
    for method, moving in _progress(long, "endurance"):
        trials.append(endure(method, moving=moving, frames=endurance, seed=seed))
    report = Report(folder, trials)
    _write_table(folder / "stress.csv", trials)
    with beside(folder / "stress.md") as temporary:
        temporary.write_text(_written(report), encoding="utf-8")
    return report


class _Run:
    """A run of a method on a sequence, and the exception that ended it."""

    def __init__(self, method: Method) -> None:
        self.method = method
        self.error: Exception | None = None

    def on(self, frames: Iterable[Frame]) -> Iterator[Image]:
        """Yield the images until the method raises an exception or returns an image of the wrong shape."""
        shapes: deque[tuple[int, ...]] = deque()

        def noted() -> Iterator[Frame]:
            for frame in frames:
                shapes.append(frame.color.shape)
                yield frame

        try:
            for result in self.method.run(noted()):
                shape, expected = result.color.shape, shapes.popleft()
                if shape != expected:
                    raise ValueError(f"expected an image of shape {expected}, got {shape}")
                yield result.color
            if shapes:
                raise ValueError(f"expected an image for each frame, got {len(shapes)} fewer")
        except Exception as error:  # any exception of the method is a result of the test
            self.error = error


def _difference(image: NDArray[np.float64], expected: Image) -> float:
    error = np.abs(np.nan_to_num(image, posinf=0, neginf=0) - np.float64(expected))
    return float(np.mean(error) / np.mean(expected, dtype=np.float64))


def _judged(part: str, case: str, run: _Run, values: dict[str, float], worst: NDArray[np.uint8] | None = None) -> Trial:
    if run.error is not None:
        return Trial(part, case, run.method.name, {}, "fails", f"{type(run.error).__name__}: {run.error}")
    verdicts = {limit.measure: limit.judge(values[limit.measure]) for limit in LIMITS if limit.measure in values}
    verdict = max(verdicts.values(), key=_VERDICTS.index)
    decisive = [measure for measure, one in verdicts.items() if one == verdict != "holds"]
    return Trial(part, case, run.method.name, values, verdict, ", ".join(_shown(m, values[m]) for m in decisive), worst)


def _shown(measure: str, value: float) -> str:
    return f"{measure} {value:.0f}" if measure in ("lag", "lost") else f"{measure} {value:.3g}"


def _lost(images: Iterable[Image]) -> int:
    return sum(int(np.count_nonzero(~np.isfinite(image).all(-1))) for image in images)


class _Stage:
    """The references of a scenario's measured frames."""

    def __init__(self, scenario: Scenario, every: list[Shot]) -> None:
        self.shots = shots = [shot for shot in every if shot.truth is not None]
        self.sudden = scenario.former == "event"
        self.truths = [Picture(shot.truth, "truth") for shot in shots if shot.truth is not None]
        self.formers = [None if shot.former is None else Picture(shot.former, "former") for shot in shots]
        self.settled = len(shots) // 2
        late = np.stack([true.linear for true in self.truths[self.settled :]])
        self.still = (np.ptp(late, axis=0) < 1e-6).all(-1) & (scenario.warm_up and len(late) > 1)

    def measure(self, every: list[Image]) -> tuple[dict[str, float], NDArray[np.uint8]]:
        """The measures of the images of all frames, and the image of the worst frame (`Trial.worst`)."""
        images = every[-len(self.shots) :]
        pictures = [_picture(image) for image in images]
        found: dict[str, list[float]] = {name: [] for name in ("ghost", "bias", "blur", "psnr", "relmse")}
        changes: list[float] = []
        for i, (shot, picture, true, former) in enumerate(
            zip(self.shots, pictures, self.truths, self.formers, strict=True)
        ):
            watch = np.ones(shot.frame.shape, np.bool_) if shot.watch is None else shot.watch
            if np.ptp(true.srgb @ _LUMINANCE) > 1e-6:
                found["blur"].append(1 - edge_sharpness(picture, true))
            if former is not None and (change := float(np.sum(np.square(former.srgb - true.srgb)[watch]))) > 0:
                changes.append(change)
                found["ghost"].append(ghost(picture, true, former, watch))
            if not watch.any():
                found["relmse"].append(0.0)
                continue
            # The affected pixels, as an image of one row.
            output, expected = (Picture(one.linear[watch][None]) for one in (picture, true))
            found["psnr"].append(min(psnr(output, expected), 99.0))
            found["relmse"].append(relmse(output, expected))
            if i >= self.settled:
                light, meant = (float(np.sum(one.linear @ _LUMINANCE)) for one in (output, expected))
                found["bias"].append(light / meant - 1)
        values = {name: float(np.mean(each)) for name, each in found.items() if each}
        if found["ghost"]:
            enough = 0 if self.sudden else np.median(changes) / 2
            counted = [one for one, change in zip(found["ghost"], changes, strict=True) if change >= enough]
            values["ghost"] = max(counted, key=abs)
            if self.sudden:
                values["lag"] = lag(found["ghost"])
                values["early"] = max((self._early(image) for image in every[: -len(self.shots)][-TRAIL:]), key=abs)
        if self.still.any():
            values["flicker"] = flicker(pictures[self.settled :], self.still)
        values["lost"] = _lost(images)
        worst = int(np.argmax(found["relmse"]))
        return values, _comparison(self.shots[worst].frame.color, images[worst], self.truths[worst].linear)

    def _early(self, image: Image) -> float:
        """The weight of the reference after the event in an image from before it."""
        assert self.formers[0] is not None
        return ghost(_picture(image), self.formers[0], self.truths[0])


def _picture(image: Image) -> Picture:
    return Picture(np.nan_to_num(image, posinf=0, neginf=0))


def _comparison(*images: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Input, output, reference and four times the error; pixels that are not finite are magenta."""
    shown = [np.where(np.isfinite(image).all(-1, keepdims=True), srgb(image), (1, 0, 1)) for image in images]
    error = np.clip(4 * np.abs(shown[1] - shown[2]), 0, 1)
    return np.asarray(np.hstack([*shown, error]) * 255 + 0.5, np.uint8)


# The scene of endurance and strains.

_SIZE = 48, 32


def _view(x: float = 0.0, y: float = 0.0, size: tuple[int, int] = _SIZE) -> Camera:
    return Camera.from_look_at([x, 1 + y, 4], [x, 0.6, 0], [0, 1, 0], 45, *size)


@cache
def _things() -> tuple[Thing, ...]:
    return (
        Thing(Rectangle(), turn([1, 0, 0], -90), value_noise((0.75, 0.68, 0.55), (0.4, 0.33, 0.25), 0.25)),
        Thing(Rectangle(), translate(0, 0, -2), checker((0.8, 0.78, 0.7), (0.45, 0.5, 0.42), 0.5)),
        Thing(Sphere(0.6), translate(-0.4, 0.6, 0.3), checker((0.8, 0.15, 0.1), (0.8, 0.78, 0.7), 0.3)),
    )


def _set(camera: Camera) -> Scene:
    return Scene(_things(), camera, (Light((1.5, 3.0, 2.5), (9.0, 8.0, 6.5)),))


@cache
def _tour(moving: bool) -> list[tuple[Frame, Image]]:
    """Frames of a closed path without noise, and their references."""
    angles = np.linspace(0, 2 * np.pi, 128, endpoint=False) if moving else np.zeros(16)
    scenes = [_set(_view(0.3 * np.cos(angle), 0.1 * np.sin(angle))) for angle in angles]
    truths = [truth(scene) for scene in scenes] if moving else [truth(scenes[0])] * len(scenes)
    rng = np.random.default_rng(0)
    return [(shoot(scene, scenes[i - 1], rng), truths[i]) for i, scene in enumerate(scenes)]


def _toured(tour: Sequence[tuple[Frame, Image]], count: int, seed: int) -> Iterator[Frame]:
    """Repeat the frames of a tour, each time with new noise."""
    rng = np.random.default_rng(seed)
    for frame, _ in islice(cycle(tour), count):
        assert frame.emission is not None
        factors = noise(rng, (*frame.shape, 1), 0.5)
        yield replace(frame, color=(frame.color - frame.emission) * factors + frame.emission)


@cache
def _frames(size: tuple[int, int] = _SIZE, count: int = 12) -> tuple[Frame, ...]:
    """Frames with noise, from a slowly moving camera."""
    rng = np.random.default_rng(0)
    scenes = [_set(_view(0.02 * i, size=size)) for i in range(-1, count)]
    return tuple(shoot(scene, before, rng, deviation=0.5) for before, scene in pairwise(scenes))


def _sized(width: int, height: int) -> Strain:
    return Strain(f"{width}×{height} pixels", lambda: _frames((width, height), 3), None)


def _radiance(scale: float) -> Strain:
    def frames() -> list[Frame]:
        return [replace(frame, color=frame.color * np.float32(scale)) for frame in _frames()]

    return Strain(f"radiance × {scale:g}", frames, _frames, scale)


def _length(scale: float) -> Strain:
    """The same scene in another unit of length."""

    def scaled(frame: Frame) -> Frame:
        buffers = frame.buffers()
        units = {"depth": [scale], "position": [scale], "motion": [1, 1, scale]}
        changed: dict[str, Any] = {name: buffers[name] * np.array(unit, np.float32) for name, unit in units.items()}
        assert frame.camera is not None
        matrix = frame.camera.world_to_clip @ np.diag([1 / scale, 1 / scale, 1 / scale, 1])
        return replace(frame, **changed, camera=Camera(matrix, frame.width, frame.height))

    return Strain(f"lengths × {scale:g}", lambda: [scaled(frame) for frame in _frames()], _frames)


def _changed(
    name: str, buffer: str, value: float | None, *, at: int | None = None, like: float | None = None
) -> Strain:
    """A buffer has one value everywhere, in one frame (`at`) or in all.

    The output should be that of ordinary frames, or that of frames whose buffer has the value `like`.
    """

    def frames(value: float | None) -> list[Frame]:
        made = list(_frames())
        for i, frame in enumerate(made):
            if at in (i, None):
                array = None if value is None else np.full_like(frame.buffers()[buffer], value)
                changes: dict[str, Any] = {buffer: array}
                made[i] = replace(frame, **changes)
        return made

    return Strain(name, lambda: frames(value), _frames if at is not None else lambda: frames(like))


#: Extreme values, sizes and buffers. Radiance and lengths may have any unit: the output should scale with radiance and
#: not depend on the unit of length.
STRAINS: tuple[Strain, ...] = (
    *(_radiance(scale) for scale in (1e-6, 1e-3, 1e3, 1e6, 1e-40, 1e30)),
    *(_length(scale) for scale in (2.5e-5, 2.5e5)),
    *(_sized(*size) for size in ((1, 1), (1, 17), (17, 1), (7680, 4))),
    _changed("normals all zero", "normal", 0.0),
    *(
        _changed(f"{buffer} of one frame all NaN", buffer, np.nan, at=5)
        for buffer in ("color", "albedo", "emission", "normal", "object_normal", "depth", "position", "motion")
    ),
)


def _resident() -> float:
    """Resident memory of this process in MiB."""
    return float(psutil.Process().memory_info().rss) / 2**20


# Output.


def _chosen(argument: str, names: Iterable[str] | None, known: dict[str, T]) -> list[T]:
    wanted = list(known) if names is None else list(names)
    for name in wanted:
        if name not in known:
            raise ValueError(f"{argument}: expected some of {', '.join(map(repr, known))}, got {name!r}")
    return [known[name] for name in wanted]


def _progress(items: Sequence[T], what: str) -> Iterable[T]:
    shown: Iterable[T] = tqdm(items, what, disable=None)
    return shown


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture enlarged three times, without interpolation."""
    from PIL import Image as Images

    with beside(path) as temporary:
        Images.fromarray(picture.repeat(3, 0).repeat(3, 1)).save(temporary, "PNG")


def _write_table(path: Path, trials: list[Trial]) -> None:
    measures = list(dict.fromkeys(name for trial in trials for name in trial.values))
    failures = {scenario.name: scenario.failure for scenario in SCENARIOS}
    with beside(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["part", "failure", "case", "method", "verdict", "reason", *measures])
        for trial in trials:
            values = (f"{trial.values[name]:.6g}" if name in trial.values else "" for name in measures)
            about = failures[trial.case] if trial.part == "failures" else ""
            writer.writerow([trial.part, about, trial.case, trial.method, trial.verdict, trial.reason, *values])


def _table(part: str, trials: list[Trial]) -> str:
    """A table of cases by methods: the verdict and the first decisive measure; for the input, its PSNR."""
    methods = list(dict.fromkeys(trial.method for trial in trials))
    rows = [[part, *methods]]
    for case in dict.fromkeys(trial.case for trial in trials):
        cells = {trial.method: trial for trial in trials if trial.case == case}
        rows.append([case, *(_cell(cells[method]) for method in methods)])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    rows.insert(1, ["-" * width for width in widths])
    return "\n".join("| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows) + "\n"


def _cell(trial: Trial) -> str:
    if trial.method == INPUT.name:
        return f"{trial.values['psnr']:.1f} dB" if "psnr" in trial.values else ""
    reason = trial.reason.split(", ")[0].split(": ")[0]
    return f"{trial.verdict}: {reason}" if reason else trial.verdict


def _written(report: Report) -> str:
    failures = "\n".join(
        f"| {name} | {seen} | {threads} | {', '.join(s.name for s in SCENARIOS if s.failure == name)} |"
        for name, (seen, threads) in FAILURES.items()
    )
    limits = "\n".join(f"| {one.measure} | {one.holds:g} | {one.degrades:g} | {one.why} |" for one in LIMITS)
    return f"""# Where it fails

{report}
A verdict is that of the worst measure, whose value follows it. All measures are in `stress.csv`, the worst frames in
`worst/`.

## Measures

| measure | holds up to | degrades up to | |
|---|---|---|---|
{limits}

## Scenarios

| failure | symptom | reported | scenarios |
|---|---|---|---|
{failures}
"""
