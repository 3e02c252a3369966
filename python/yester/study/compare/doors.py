"""The loss of each method from poor doors: frames with missing, degraded or differently encoded buffers."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import Frame
from yester.io import read_exr
from yester.io.files import beside
from yester.metrics import metric

from ..rendered.recording import Recording
from . import harm
from .chart import measure
from .methods import PIPELINES, QUARTERS, Method, Result

__all__ = [
    "DOORS",
    "FULL",
    "METHODS",
    "NETWORK",
    "Door",
    "Worth",
    "enter",
    "harmful",
    "known_doors",
    "measure_doors",
    "passing",
    "table",
    "through",
]

#: The name of the door that passes frames unchanged.
FULL = "every buffer"


@dataclass(frozen=True)
class Door:
    """A transformation that drops, degrades or re-encodes buffers of frames.

    Attributes
    ----------
    name : str
        The buffers that are missing or changed.
    take : callable
        Transforms a recorded frame; its second argument is the renderer's raw albedo.
    richer : tuple of str
        Names of the doors with one degradation less, whose results should therefore not be worse.
    raw : bool
        True if `take` needs the raw albedo; otherwise it gets None.
    """

    name: str
    take: Callable[[Frame, NDArray[np.float32] | None], Frame]
    richer: tuple[str, ...] = (FULL,)
    raw: bool = False


def _lacking(*names: str) -> Callable[[Frame, object], Frame]:
    absent: dict[str, Any] = dict.fromkeys(names)
    return lambda frame, _: replace(frame, **absent)


def _only(*names: str) -> Callable[[Frame, object], Frame]:
    return lambda frame, _: replace(Frame(frame.color), **{name: getattr(frame, name) for name in names})


def _flat_motion(frame: Frame, _: object, **changes: Any) -> Frame:
    return replace(frame, motion=None if frame.motion is None else frame.motion[..., :2], **changes)


def _raw_albedo(frame: Frame, raw: NDArray[np.float32] | None, **changes: Any) -> Frame:
    return replace(frame, albedo=raw, **changes)


def _misses(frame: Frame, _: object, *, depth: float) -> Frame:
    """Frames of renderers that do not mark background by infinite depth."""
    coded: dict[str, Any] = {}
    if frame.depth is not None:
        coded["depth"] = np.where(np.isfinite(frame.depth), frame.depth, np.float32(depth))
    if frame.position is not None:
        coded["position"] = np.where(np.isfinite(frame.position), frame.position, np.float32(0))
    return replace(frame, **coded)


#: All doors; the full one comes first.
DOORS = (
    Door(FULL, lambda frame, _: frame, richer=()),
    Door("no emission", _lacking("emission")),
    Door("raw albedo", _raw_albedo, raw=True),
    Door(
        "raw albedo, no emission", partial(_raw_albedo, emission=None), richer=("no emission", "raw albedo"), raw=True
    ),
    Door(
        "no albedo",
        _lacking("albedo", "emission"),
        richer=(FULL, "no emission", "raw albedo", "raw albedo, no emission"),
    ),
    Door("2-channel motion", _flat_motion),
    Door("no camera", _lacking("camera")),
    Door("2-channel motion, no camera", partial(_flat_motion, camera=None), richer=("2-channel motion", "no camera")),
    Door("no motion", _lacking("motion"), richer=(FULL, "2-channel motion")),
    Door("no ids", _lacking("ids")),
    Door("raw albedo, no ids", partial(_raw_albedo, ids=None), richer=("raw albedo", "no ids"), raw=True),
    Door(
        "no albedo, no ids",
        _lacking("albedo", "emission", "ids"),
        richer=("no albedo", "no ids", "raw albedo, no ids"),
    ),
    Door("no normals", _lacking("normal", "object_normal")),
    Door("misses have depth 0", partial(_misses, depth=0)),
    Door("misses have depth 1e10", partial(_misses, depth=1e10)),
    Door(
        "no depth",
        _lacking("depth", "position"),
        richer=(FULL, "misses have depth 0", "misses have depth 1e10"),
    ),
    Door("depth alone", _only("depth", "motion")),
    Door("motion alone", _only("motion"), richer=(FULL, "depth alone")),
)


#: The pipelines that run with all doors by default.
METHODS = tuple(
    m
    for m in (*PIPELINES, *QUARTERS)
    if m.name in ("SVGF", "SVGF, both sides", "BMFR", "TAA best", "HalfRes, a quarter traced")
)
#: The name of another library's network that runs with them, where it is installed.
NETWORK = "temporal OIDN high"


def through(door: Door, method: Method, recording: Recording) -> Method:
    """Make a method that runs on the frames of a recording as a door passes them.

    Parameters
    ----------
    door : Door
        One of `DOORS`.
    method : Method
        The method to run.
    recording : Recording
        The recording, or the variant of one, whose frames the method will get, in order; with raw albedo if the door
        needs it.

    Returns
    -------
    Method
        Its name is that of the method and the door.
    """

    if door.name == FULL:
        return method

    def run(frames: Iterable[Frame]) -> Iterator[Result]:
        return method.run(enter(door, frames, recording))

    return replace(method, name=f"{method.name}, {door.name}", run=run, default=False)


def passing(pairs: Sequence[tuple[Method, Door]]) -> Callable[[Recording], list[Method]]:
    """Make methods through doors for a recording, whose variants have other raw albedo, as `chart.measure` asks for."""
    return lambda recording: [through(door, method, recording) for method, door in pairs]


def enter(door: Door, frames: Iterable[Frame], recording: Recording) -> Iterator[Frame]:
    """Pass the frames of a recording, in order, through a door."""
    numbers = range(len(recording.frames))
    raw = (read_exr(recording.raw_albedo[i]).color for i in numbers) if door.raw else repeat(None)
    return map(door.take, frames, raw)


def known_doors(recording: Recording, doors: Iterable[Door]) -> list[Door]:
    """Select the doors that a recording can pass: those that need raw albedo only if it has raw albedo."""
    return [door for door in doors if recording.raw_albedo or not door.raw]


@dataclass(frozen=True)
class Worth:
    """A method's errors on one sequence through two doors, one richer than the other.

    Attributes
    ----------
    scene, method : str
        Names of the recording and of the method.
    door, richer : str
        Names of the two doors.
    poor, rich : tuple of dict of str to float
        For each realisation of the noise, by metric, the values through `door` and through `richer`.
    """

    scene: str
    method: str
    door: str
    richer: str
    poor: tuple[dict[str, float], ...]
    rich: tuple[dict[str, float], ...]


def measure_doors(
    recordings: Sequence[Recording],
    methods: Sequence[Method],
    folder: Path,
    *,
    doors: Sequence[Door] = DOORS,
    metrics: Iterable[str] = tuple(harm.LIMITS),
) -> list[Worth]:
    """Run methods through all doors on every sequence.

    Writes `doors.csv`. Measurements are cached in `doors/`, from which an interrupted run resumes.

    Parameters
    ----------
    recordings : sequence of Recording
        With different names. Doors that need raw albedo are skipped for recordings without it.
    methods : sequence of Method
        With different names.
    folder : Path
        Output folder, created if missing.
    doors : sequence of Door, default DOORS
        The full door is always added.
    metrics : iterable of str
        Keys of `yester.metrics.METRICS`.

    Returns
    -------
    list of Worth
        For each sequence, method and door, one for each richer door among `doors`; the full door comes first.

    Raises
    ------
    ValueError
        If a metric is unknown.
    """
    keys = [metric(key).key for key in metrics]
    chosen = [DOORS[0], *(door for door in doors if door.name != FULL)]
    rows, found = [], []
    for recording in recordings:
        here = known_doors(recording, chosen)
        pairs = [(method, door) for method in methods for door in here]
        _, *points = measure(recording, passing(pairs), folder / "doors", metrics=keys, images=0)
        values = {(method.name, door.name): point.runs for (method, door), point in zip(pairs, points, strict=True)}
        for names, runs in values.items():
            for number, value in enumerate(runs):
                rows.append([recording.name, *names, number, *(value.get(key, "") for key in keys)])
        for method, door in pairs:
            for richer in dict.fromkeys((FULL, *door.richer)):
                if richer != door.name and (method.name, richer) in values:
                    both = values[method.name, door.name], values[method.name, richer]
                    found.append(Worth(recording.name, method.name, door.name, richer, *both))
    with beside(folder / "doors.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "method", "door", "run", *keys])
        writer.writerows(rows)
    return found


def table(found: Sequence[Worth]) -> str:
    """Write each door's gain over the full one, mean and worst case; losses are negative."""
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for each in found:
        if each.richer == FULL:
            rows.setdefault(f"{each.method}, {each.door}", {})[each.scene], _ = harm.mean_gains(each.poor, each.rich)
    return harm.table(rows)


def harmful(found: Sequence[Worth], limits: Mapping[str, float] = harm.LIMITS) -> list[str]:
    """List the cases in which a richer door is worse than a poorer one, beyond limits and two standard errors."""
    one_more = {(door.name, richer) for door in DOORS for richer in door.richer}
    lines = []
    for each in found:
        gained = harm.sure(*harm.mean_gains(each.rich, each.poor))
        if (each.door, each.richer) in one_more and (bad := harm.harms(gained, limits)):
            losses = ", ".join(f"{key} {harm.amount(key, gained[key])}" for key in bad)
            lines.append(f"{each.method}, {each.scene}: {each.richer} is worse than {each.door}: {losses}")
    return lines
