"""Speed against accuracy: the errors of every method on every sequence, and its time at one size."""

from __future__ import annotations

import json
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from yester import Frame, _core, consistency
from yester.frame import present
from yester.io.files import beside
from yester.io.mapping import load
from yester.judge import known_motion, surface_tests
from yester.metrics import METRICS, Metric, Picture, metric

from ..rendered.recording import Recording
from ..speed.bench import CALM, PATIENCE, staged
from ..speed.tasks import Inputs
from .methods import Method, Result
from .points import Point, means, write_csv
from .report import save_images, write_figures, write_report

__all__ = ["SIZE", "chart", "measure", "orders", "times"]

#: Width and height of the frames on which methods are timed.
SIZE = (1280, 720)
#: Turns of a method; frames of warm-up in a turn, after which histories are in their steady state; timed frames.
_TURNS, _WARM_UP, _TIMED = 3, 8, 3
#: A method whose turn takes longer, in seconds, gets no further turns.
_LONG = 60.0


def chart(
    recordings: Sequence[Recording],
    methods: Sequence[Method],
    folder: Path,
    *,
    metrics: Iterable[str] = METRICS,
    images: int = 2,
    size: tuple[int, int] = SIZE,
    about: str = "",
) -> list[Point]:
    """Measure and time all methods on all sequences, and write charts and a report.

    Writes `points.csv`, a PNG and an SVG for each metric and scene, `report.html`, and the cache of `measure` and
    `times` in `points/`, from which an interrupted run resumes.

    Parameters
    ----------
    recordings : sequence of Recording
        With different names.
    methods, metrics, images
        As for `measure`.
    folder : Path
        Output folder, created if missing.
    size : (int, int), default 1280x720
        As for `times`.
    about : str
        A paragraph at the head of the report.

    Returns
    -------
    list of Point
        The points of each scene; with several scenes, also their means.

    Raises
    ------
    ValueError
        If two sequences or two methods have the same name, or a metric is unknown.
    """
    keys = [metric(key).key for key in metrics]
    named = {"recordings": [one.name for one in recordings], "methods": [one.name for one in methods]}
    for what, names in named.items():
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{what}: expected different names, got {twice[0]} more than once")
    points = []
    for recording in recordings:
        points += measure(recording, methods, folder / "points", metrics=keys, images=images)
    spent = times(methods, folder / "points", size)
    points = [_timed(point, spent[point.method], size) if point.method in spent else point for point in points]
    if len(recordings) > 1:
        points += means(points)
    write_csv(points, folder / "points.csv")
    write_figures(points, folder)
    write_report(folder / "report.html", points, recordings, about=about)
    return points


def measure(
    recording: Recording,
    methods: Sequence[Method] | Callable[[Recording], Sequence[Method]],
    folder: Path,
    *,
    metrics: Iterable[str] = METRICS,
    images: int = 2,
) -> list[Point]:
    """Run all methods on one sequence and measure the results, but not the time, which `times` measures.

    Frames with a reference are measured; if there is no reference, frames of the second half, by metrics that need
    none. If the recording has variants, values are means over all of them. Results are cached in the folder and reused
    for the same methods, files and reading of them, and the same compiled core. Changes of the Python code are not
    noticed: remove the folder after them.

    Parameters
    ----------
    recording : Recording
        The sequence.
    methods : sequence of Method, or callable
        With different names. A callable makes them, for the recording and for each of its variants.
    folder : Path
        For the points and their images; created if missing.
    metrics : iterable of str, default all
        Keys of `METRICS`.
    images : int, default 2
        Number of frames, counted from the end, whose images are kept.

    Returns
    -------
    list of Point
        The noisy input first, then the methods in order; all without a time.

    Raises
    ------
    ValueError
        If a metric is unknown.
    """
    chosen = [metric(key) for key in metrics]
    place = folder / recording.name
    made = methods if callable(methods) else lambda _: methods
    found = [_measure(recording, made(recording), place, chosen, images)]
    for number, variant in enumerate(recording.variants, 1):
        found.append(_measure(variant, made(variant), place / f"variant-{number}", chosen, 0))
    return [_pooled(same) for same in zip(*found, strict=True)]


def _measure(
    recording: Recording, methods: Sequence[Method], place: Path, chosen: Sequence[Metric], images: int
) -> list[Point]:
    """Measure a recording without its variants."""
    known = place / "points.json"
    methods = [_INPUT, *methods]
    asked = _identity(recording, methods, chosen, images)
    if known.exists():
        kept = json.loads(known.read_text())
        if kept["asked"] == asked:
            return [_restored(place, point) for point in kept["points"]]
    place.mkdir(parents=True, exist_ok=True)

    measured = sorted(recording.references) or [*range(len(recording.frames) // 2, len(recording.frames))]
    shown = measured[len(measured) - images :] if images else []
    own, *sources = _shared(map(recording.frame, range(len(recording.frames))), 1 + len(methods))
    runs = [method.run(frames) for method, frames in zip(methods, sources, strict=True)]
    values: list[dict[str, list[float]]] = [{} for _ in methods]
    former: list[Picture] = []
    frame_before, reference_before = None, None
    every = tqdm(zip(own, *runs, strict=True), recording.name, len(recording.frames), unit="frame", disable=None)
    results: list[Result]
    for i, (frame, *results) in enumerate(every):
        reference = _reference(recording, i)
        flow = _flow(frame_before, frame)
        pictures = [Picture(result.color, method.name) for method, result in zip(methods, results, strict=True)]
        for number, (method, picture) in enumerate(zip(methods, pictures, strict=True)):
            result = results[number]
            if i not in measured:
                continue
            before = former[number] if former else None
            given = _given(picture, before, reference, reference_before, flow)
            for each in chosen:
                if each.needs in given:
                    values[number].setdefault(each.key, []).append(each.measure(*given[each.needs]))
            if i in shown:
                save_images(place / _file(method.name), i, result, None if reference is None else reference.linear)
        former, frame_before, reference_before = pictures, frame, reference

    points = []
    for method, found in zip(methods, values, strict=True):
        points.append(
            Point(
                recording.name,
                method.name,
                method.family,
                method.default,
                method.peer,
                0.0,
                (0.0, 0.0),
                {each.key: float(np.mean(found[each.key])) for each in chosen if each.key in found},
                place / _file(method.name) if shown else None,
            )
        )
    text = json.dumps({"asked": asked, "points": [_plain(point) for point in points]}, indent=1)
    with beside(known) as temporary:
        temporary.write_text(text)
    return points


def _pooled(same: Sequence[Point]) -> Point:
    """The mean of one method's points over a recording and its variants."""
    first = same[0]
    values = {key: float(np.mean([point.values[key] for point in same])) for key in first.values}
    return replace(first, values=values, runs=tuple(point.values for point in same))


def times(methods: Sequence[Method], folder: Path, size: tuple[int, int] = SIZE) -> dict[str, list[float]]:
    """Time methods on frames of one size, which show the scene of `yester bench`, with all threads.

    A method has three turns. In each it starts anew, warms up over eight frames and is timed over the next three; slow
    methods get fewer frames, at least one each, and a single turn if it takes more than a minute. The results of a
    method that reads ahead come in bursts: whole bursts are timed, and every result gets the mean. The first burst
    never counts, as later frames are read and worked on for it that the next bursts need. The order of the methods is
    different in every turn, and each method waits until the threads of its predecessor have stopped spinning. The
    result is cached in ``times.json`` and reused for the same methods, size and build.

    Parameters
    ----------
    methods : sequence of Method
        With different names.
    folder : Path
        For the cache; created if missing.
    size : (int, int), default 1280x720
        Width and height of the frames.

    Returns
    -------
    dict of str to list of float
        By name of the method, the time of each timed frame in milliseconds.
    """
    known = folder / "times.json"
    asked = {"methods": [method.name for method in methods], "size": [*size], "build": [*_build()]}
    if known.exists() and (kept := json.loads(known.read_text()))["asked"] == asked:
        return {name: [*spent] for name, spent in kept["times"].items()}
    result: dict[str, list[float]] = {method.name: [] for method in methods}
    slow: set[int] = set()
    with staged(*size) as images, tqdm(total=_TURNS * len(methods), desc="times", unit="turn", disable=None) as bar:
        frames = Inputs(images, *size).frames()
        for order in orders(len(methods)):
            for number in order:
                start = time.perf_counter()
                if number not in slow:
                    result[methods[number].name] += _turn(methods[number], frames)
                if time.perf_counter() - start > _LONG:
                    slow.add(number)
                bar.update()
    folder.mkdir(parents=True, exist_ok=True)
    with beside(known) as temporary:
        temporary.write_text(json.dumps({"asked": asked, "times": result}, indent=1))
    return result


def orders(count: int) -> list[list[int]]:
    """The order of the methods in each turn: shuffled, so that no method always follows the same one."""
    rng = np.random.default_rng(0)
    return [rng.permutation(count).tolist() for _ in range(_TURNS)]


def _turn(method: Method, frames: Sequence[Frame]) -> list[float]:
    """Milliseconds of the timed frames of one turn."""
    time.sleep(CALM)
    given, spent, timed = cycle(frames), list[float](), list[float]()

    def source() -> Iterator[Frame]:
        for most in (_WARM_UP, _TIMED):
            spent.clear()
            while len(spent) < most and sum(spent) < 1e3 * PATIENCE:
                begin = len(spent)
                while len(spent) == begin:
                    yield next(given)
                # A request for the next frame means that all work on the former frames is done.
                burst = len(spent) - begin
                spent[begin:] = [sum(spent[begin:]) / burst] * burst
        timed.extend(spent)

    start = time.perf_counter()
    for _ in method.run(source()):
        start, before = time.perf_counter(), start
        spent.append(1e3 * (start - before))
    return timed


def _shared(frames: Iterator[Frame], readers: int) -> list[Iterator[Frame]]:
    """Iterators over the same frames; each frame is read once and held until every iterator has yielded it."""
    # `itertools.tee` would hold up to 57 further frames.
    waiting: list[deque[Frame]] = [deque() for _ in range(readers)]

    def read(own: deque[Frame]) -> Iterator[Frame]:
        while True:
            if not own:
                try:
                    frame = next(frames)
                except StopIteration:
                    return
                for each in waiting:
                    each.append(frame)
            yield own.popleft()

    return [read(own) for own in waiting]


def _timed(point: Point, spent: Sequence[float], size: tuple[int, int]) -> Point:
    low, middle, high = (float(v) for v in np.percentile(spent, [25, 50, 75]))
    return replace(point, ms=middle, ms_range=(low, high), size=size)


#: The noisy frames themselves, for comparison.
_INPUT = Method("noisy input", "noisy input", lambda frames: map(Result, map(present, frames)))


def _reference(recording: Recording, index: int) -> Picture | None:
    path = recording.references.get(index)
    return None if path is None else Picture(recording.reference(index), str(path))


def _given(
    picture: Picture,
    before: Picture | None,
    reference: Picture | None,
    reference_before: Picture | None,
    flow: tuple[NDArray[np.float32], NDArray[np.bool_]] | None,
) -> dict[str, tuple[Any, ...]]:
    """By need (`Metric.needs`), the arguments of metrics with that need, if they are known."""
    given: dict[str, tuple[Any, ...]] = {}
    if reference is not None:
        given["reference"] = picture, reference
    if before is not None and reference is not None and reference_before is not None:
        given["references"] = picture, before, reference, reference_before
    if before is not None and flow is not None:
        given["none"] = picture, before, *flow
    return given


def _flow(before: Frame | None, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.bool_]] | None:
    """Motion to the previous frame, and the mask of pixels whose surface is visible there; None if unknown."""
    if before is None:
        return None
    motion = known_motion(before, frame)
    if motion is None:
        return None
    rejection, _ = consistency(motion, **surface_tests(before, frame, motion))
    valid = (rejection == 0) & np.isfinite(motion).all(-1)
    return (motion, valid) if valid.any() else None


def _identity(
    recording: Recording, methods: Sequence[Method], metrics: Sequence[Metric], images: int
) -> dict[str, Any]:
    """The cache key of measurements."""
    paths = [*recording.frames, *recording.references.values()]
    files = [[str(path.resolve()), path.stat().st_mtime_ns] for path in paths]
    names = {"methods": [method.name for method in methods], "metrics": [metric.key for metric in metrics]}
    # Of a mapping in a file, the contents count. JSON turns tuples to lists.
    reading = recording.reading | {"mapping": load(recording.reading.get("mapping"))}
    named = json.loads(json.dumps(reading))
    return {**names, "images": images, "files": files, "reading": named, "built": _build()[0]}


def _build() -> tuple[int, int, str]:
    """Modification time of the binary, which identifies a build during development; threads; SIMD level."""
    return Path(_core.__file__).stat().st_mtime_ns, *_core.settings()


def _file(name: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", name.lower())


def _plain(point: Point) -> dict[str, Any]:
    return asdict(point) | {"images": point.images and point.images.name}


def _restored(place: Path, plain: dict[str, Any]) -> Point:
    images = plain["images"] and place / plain["images"]
    return Point(**plain | {"ms_range": tuple(plain["ms_range"]), "images": images})
