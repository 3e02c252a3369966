"""Results of `yester bench`: times, fractions of the machine's limits, targets, tables and a chart."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from yester.io.files import beside

from ..compare.report import COLORS, GRID, INK, PAPER
from .rivals import REFERENCE
from .tasks import TASKS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["OURS", "Limits", "Memory", "Target", "Timing", "draw", "markdown", "targets", "write_csv"]

#: The name of this package among the contenders.
OURS = "yester"
#: Setting of the targets: width and height, and the number of threads.
HD, UHD, SMALL, THREADS = (1920, 1080), (3840, 2160), (256, 256), 2


class Limits(NamedTuple):
    """The machine's limits (roofline) with a setting's threads and SIMD level.

    Attributes
    ----------
    bandwidth : float
        Bytes read and written by copies of arrays of 134 MB, in GB/s.
    arithmetic : float
        Multiply-adds of floats in registers, in 10⁹/s; where there is no such instruction, a multiplication and an
        addition.
    """

    bandwidth: float
    arithmetic: float


class Memory(NamedTuple):
    """Memory of a pipeline beside its inputs and outputs: history and scratch.

    Attributes
    ----------
    most : float
        Peak in MB.
    growth : float
        Growth from the third to the last measured step, in MB.
    """

    most: float
    growth: float


@dataclass(frozen=True)
class Timing:
    """The time of one task, by one contender in one setting.

    Attributes
    ----------
    task : str
        Name of a `tasks.Task`.
    contender : str
        `OURS`, or the name of a rival.
    size : (int, int)
        Width and height, in pixels.
    threads : int
    simd : str
        The SIMD level; empty for rivals, which choose it themselves.
    runs : tuple of float
        Times of all runs, in milliseconds.
    bytes : int
        Minimal traffic: the size of all inputs and outputs; 0 if unknown.
    multiply_adds : float or None
        Minimal number per pixel, if counted.
    limits : Limits or None
        Limits of the setting; None for rivals.
    memory : Memory or None
        Memory of a pipeline, if measured.
    """

    task: str
    contender: str
    size: tuple[int, int]
    threads: int
    simd: str
    runs: tuple[float, ...]
    bytes: int = 0
    multiply_adds: float | None = None
    limits: Limits | None = None
    memory: Memory | None = None

    @property
    def pixels(self) -> int:
        return math.prod(self.size)

    @property
    def ms(self) -> float:
        """Median of the runs."""
        return float(np.median(self.runs))

    @property
    def quartiles(self) -> tuple[float, float]:
        low, high = np.percentile(self.runs, [25, 75])
        return float(low), float(high)

    @property
    def ns_per_pixel(self) -> float:
        return 1e6 * self.ms / self.pixels

    @property
    def bandwidth(self) -> float | None:
        """Minimal traffic per time, in GB/s; None if unknown."""
        return self.bytes / self.ms / 1e6 if self.bytes else None

    @property
    def limit(self) -> tuple[str, float] | None:
        """The bottleneck, ``"memory"`` or ``"arithmetic"``, and the time in milliseconds at that limit."""
        if self.limits is None or not self.bytes:
            return None
        times = {"memory": self.bytes / self.limits.bandwidth / 1e6}
        if self.multiply_adds is not None:
            times["arithmetic"] = self.multiply_adds * self.pixels / self.limits.arithmetic / 1e6
        which = max(times, key=times.__getitem__)
        return which, times[which]

    @property
    def share(self) -> float | None:
        """Time at the limit relative to the measured time; may exceed 1 for images in cache."""
        return self.limit and self.limit[1] / self.ms


class Target(NamedTuple):
    """A performance target.

    Attributes
    ----------
    name : str
    relation : "≤" or "≥"
    wanted : float
    measured : float or None
        None if a measurement that it needs is missing.
    """

    name: str
    relation: str
    wanted: float
    measured: float | None

    @property
    def met(self) -> bool | None:
        if self.measured is None:
            return None
        return self.measured >= self.wanted if self.relation == "≥" else self.measured <= self.wanted


def targets(timings: Sequence[Timing]) -> list[Target]:
    """Compare the measurements with the targets, which hold for 1920×1080 and two threads unless stated otherwise.

    Parameters
    ----------
    timings : sequence of Timing
        Of several SIMD levels, the first one counts.

    Returns
    -------
    list of Target
    """
    found: dict[tuple[Any, ...], Timing] = {}
    for timing in timings:
        found.setdefault((timing.task, timing.contender, timing.size, timing.threads), timing)

    def ratio(one: Timing | None, other: Timing | None, of: Callable[[Timing], float]) -> float | None:
        return None if one is None or other is None else of(one) / of(other)

    def timed(task: str, contender: str = OURS, size: tuple[int, int] = HD, threads: int = THREADS) -> Timing | None:
        return found.get((task, contender, size, threads))

    def slower(task: str, rival: str, wanted: float) -> Target:
        measured = ratio(timed(task), timed(task, rival), lambda t: t.ms)
        return Target(f"{task}: time relative to {rival}", "≤", wanted, measured)

    def faster(task: str, rival: str, wanted: float, beside: str | None = None) -> Target:
        """Of a task, whose rival was timed with another one if `beside` says so."""
        measured = ratio(timed(beside or task, rival), timed(task), lambda t: t.ms)
        return Target(f"{task}: speed relative to {rival}", "≥", wanted, measured)

    def tested(task: str) -> Target:
        measured = ratio(timed(f"{task}, tested"), timed(task), lambda t: t.ms)
        return Target(f"{task}, tested: time relative to untested", "≤", 1.4, measured)

    pipelines = [task.name for task in TASKS if task.pipeline and task.function != "OIDN"]
    one, five = timed("atrous, 1 pass"), timed("atrous, 5 passes")
    binding = f" ({one.limit[0]} binds)" if one and one.limit else ""
    # The difference excludes the work before and after the passes, such as preparing the guide.
    further = None
    if one and five and one.limit and five.limit:
        further = (five.limit[1] - one.limit[1]) / (five.ms - one.ms)

    def held(task: str, what: str, most: float, of: Callable[[Memory], float]) -> Target:
        timing = timed(task)
        return Target(f"{task}: {what}, MB", "≤", most, of(timing.memory) if timing and timing.memory else None)

    return [
        slower("reproject, bilinear", "OpenCV remap, linear", 1.1),
        slower("reproject, catmull-rom", "OpenCV remap, cubic", 1.0),
        tested("reproject, bilinear"),
        tested("reproject, catmull-rom"),
        faster("clip_history, variance", "OpenCV blur + sqrBoxFilter", 2.5),
        faster("clip_history, blended", "OpenCV blur + sqrBoxFilter", 2.5),
        Target(f"atrous, 1 pass with its guide: fraction of the limit{binding}", "≥", 0.4, one.share if one else None),
        Target("atrous, a further pass: fraction of the limit", "≥", 0.4, further),
        slower("TAA, box without tone mapping", "OpenCV remap, linear", 3.5),
        faster("SVGF", "OIDN fast", 15.0, "SVGF, 5 passes, no choice"),
        faster("SVGF, as published but 3x3", "OIDN fast", 22.0),
        faster("SVGF, 5 passes, no choice", REFERENCE, 40.0),
        *(
            Target(
                f"{task}: time of one thread relative to two",
                *("≥", 1.85, ratio(timed(task, threads=1), timed(task), lambda t: t.ms)),
            )
            for task in pipelines
        ),
        *(
            Target(
                f"{task}: time per pixel at 4K relative to 1080p",
                *("≤", 1.15, ratio(timed(task, size=UHD), timed(task), lambda t: t.ns_per_pixel)),
            )
            for task in pipelines
        ),
        *(
            Target(
                f"{task}: time per pixel at 256×256 relative to 1080p",
                *("≤", 1.2, ratio(timed(task, size=SMALL), timed(task), lambda t: t.ns_per_pixel)),
            )
            for task in pipelines
        ),
        held("SVGF", "state and scratch", 220, lambda memory: memory.most),
        held("SVGF, as published", "state and scratch", 110, lambda memory: memory.most),
        held("SVGF", "growth of state and scratch", 0.5, lambda memory: memory.growth),
    ]


def markdown(timings: Sequence[Timing], *, about: str, missing: Iterable[str] = ()) -> str:
    """Write everything as a page of tables.

    Parameters
    ----------
    timings : sequence of Timing
        The first setting is shown in full; for other settings and for references, only the medians.
    about : str
        The first paragraph.
    missing : iterable of str, default none
        The contenders that were not measured, and why.

    Returns
    -------
    str
    """
    ours = [timing for timing in timings if timing.contender == OURS]
    settings = list(dict.fromkeys((timing.threads, timing.simd) for timing in ours))
    known = {(timing.threads, timing.simd): timing.limits for timing in ours if timing.limits}
    pages = ["# yester bench", about]
    head: Sequence[str] = ("the machine's limits", "copies, GB/s", "multiply-adds, 10⁹/s")
    limits = [(_setting(*key), f"{one.bandwidth:.1f}", f"{one.arithmetic:.0f}") for key, one in known.items()]
    pages.append(_table(head, limits))
    for size in dict.fromkeys(timing.size for timing in timings):
        pages.append(_compare([timing for timing in timings if timing.size == size], settings))
    held = [(timing, timing.memory) for timing in ours if timing.memory]
    if held:
        width, height = held[0][0].size
        head = (f"memory at {width}×{height}, {_setting(*settings[0])}", "state and scratch, MB", "growth, MB")
        pages.append(_table(head, [(timing.task, f"{one.most:.1f}", f"{one.growth:.1f}") for timing, one in held]))
    judged = targets(timings)
    if any(target.measured is not None for target in judged):
        rows = [
            (
                target.name,
                f"{target.relation} {target.wanted:g}",
                "not measured" if target.measured is None else f"{target.measured:.2f}",
                {None: "", True: "met", False: "**missed**"}[target.met],
            )
            for target in judged
        ]
        place = f"targets at {HD[0]}×{HD[1]}, {THREADS} threads"
        pages.append(_table((place, "wanted", "measured", ""), rows))
    if not held and any(task.name == timing.task and task.pipeline for task in TASKS for timing in ours):
        pages.append("Not measured: memory, which this system does not report")
    pages += [f"Not measured: {one}" for one in missing]
    return "\n\n".join(pages) + "\n"


def _setting(threads: int, simd: str) -> str:
    return f"{threads} thread{'s' if threads > 1 else ''}" + (f", {simd}" if simd else "")


def _compare(timings: Sequence[Timing], settings: Sequence[tuple[int, str]]) -> str:
    """A table of one size: a row for each task, with its reference in the last column, and below it a row for each
    rival, with its time relative to this package's.
    """
    cells: dict[tuple[str, str], dict[tuple[int, str], Timing]] = {}
    for timing in timings:
        cells.setdefault((timing.task, timing.contender), {})[timing.threads, timing.simd] = timing
    referred = any(contender == REFERENCE for _, contender in cells)
    (most, best), *others = settings
    width, height = timings[0].size
    measures = ("ms", "quartiles", "ns/pixel", "GB/s", "of its limit", *(f"ms, {_setting(*other)}" for other in others))
    rows = []
    for (task, contender), found in cells.items():
        ours = contender == OURS
        # Rivals choose their instructions, and have one time for each number of threads.
        first, *rest = (
            found.get((threads, simd if ours else "")) if ours or simd == best else None for threads, simd in settings
        )
        if contender == REFERENCE or first is None:
            continue
        low, high = first.quartiles
        reached = ""
        if first.limit and first.share is not None:
            reached = f"{first.share:.0%} {first.limit[0]}"
        elif not ours and (us := cells.get((task, OURS), {}).get((most, best))):
            reached = f"({first.ms / us.ms:.2f} × yester)"
        row = [task if ours else f"— {contender}", f"{first.ms:.2f}", f"{low:.2f} to {high:.2f}"]
        row += [f"{first.ns_per_pixel:.2f}", "" if first.bandwidth is None else f"{first.bandwidth:.1f}", reached]
        row += [f"{one.ms:.2f}" if one else "" for one in rest]
        if referred:
            twin = cells.get((task, REFERENCE), {}).get((most, "")) if ours else None
            row.append(f"{twin.ms:.2f}" if twin else "")
        rows.append(row)
    head = [f"{width}×{height}, {_setting(most, best)}", *measures, *([f"ms, {REFERENCE}"] if referred else [])]
    return _table(head, rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table with aligned columns: the first to the left, the others to the right."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        first, *others = cells
        padded = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        return f"| {' | '.join(padded)} |"

    rule = f"|{'-' * (widths[0] + 2)}|" + "".join(f"{'-' * (width + 1)}:|" for width in widths[1:])
    return "\n".join([line(head), rule, *map(line, rows)])


def write_csv(timings: Sequence[Timing], folder: Path) -> None:
    """Write ``bench.csv``, a row for each timing, and ``targets.csv``; unknown values are empty."""
    measures = ("ms", "ms_low", "ms_high", "runs", "ns_per_pixel", "gb_per_s", "share", "limit")
    machine, memory = ("copy_gb_per_s", "giga_multiply_adds_per_s"), ("held_mb", "growth_mb")
    head = ["task", "contender", "width", "height", "threads", "simd", *measures, *machine, *memory]
    rows: list[Sequence[Any]] = []
    for one in timings:
        place = (one.task, one.contender, *one.size, one.threads, one.simd)
        spread = (one.ms, *one.quartiles, len(one.runs), one.ns_per_pixel)
        reached = (one.bandwidth, one.share, one.limit and one.limit[0])
        rows.append([*place, *spread, *reached, *(one.limits or ("", "")), *(one.memory or ("", ""))])
    _write(folder / "bench.csv", head, rows)
    _write(
        *(folder / "targets.csv", ["target", "relation", "wanted", "measured", "met"]),
        [[*target, None if target.met is None else int(target.met)] for target in targets(timings)],
    )


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with beside(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)


def draw(timings: Sequence[Timing]) -> Figure:
    """Draw the time per pixel of every task and its rivals, in the first setting, at the size with most timings.

    Parameters
    ----------
    timings : sequence of Timing
        At least one of `OURS`.

    Returns
    -------
    matplotlib.figure.Figure
        A row for each task: a bar for this package's time, a dot for each rival, a stroke for the machine's limit.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    chief = next(timing for timing in timings if timing.contender == OURS)
    same = [timing for timing in timings if timing.threads == chief.threads and timing.simd in ("", chief.simd)]
    size = max({t.size for t in same}, key=lambda size: (sum(t.size == size for t in same), math.prod(size)))
    same = [timing for timing in same if timing.size == size]
    tasks = list(dict.fromkeys(timing.task for timing in same))
    libraries = list(dict.fromkeys(_library(timing) for timing in same if timing.contender != OURS))
    colors = dict(zip(libraries, COLORS[1:], strict=False))

    height = 1.6 + 0.3 * len(tasks)
    figure = Figure((8.4, height), dpi=72)
    axes = figure.add_axes((0.27, 0.55 / height, 0.69, 1 - 1.55 / height), facecolor="none")
    # On a logarithmic axis, bars start at its lower end, below all values.
    least = min(min(t.ns_per_pixel, 1e6 * t.limit[1] / t.pixels if t.limit else math.inf) for t in same)
    start = 10 ** math.floor(math.log10(least))
    for timing in same:
        row = tasks.index(timing.task)
        if timing.contender == OURS:
            axes.barh(row, timing.ns_per_pixel - start, 0.55, start, color=COLORS[0], zorder=2)
            if timing.limit:
                place = 1e6 * timing.limit[1] / timing.pixels
                axes.plot([place] * 2, [row - 0.38, row + 0.38], color=INK, linewidth=1.8, zorder=4)
            continue
        color = colors[_library(timing)]
        mark: dict[str, Any] = {"marker": "D", "markersize": 6, "markeredgecolor": PAPER, "markeredgewidth": 0.8}
        axes.plot(timing.ns_per_pixel, row, color=color, linestyle="none", zorder=5, **mark)
    axes.set(xscale="log", yticks=range(len(tasks)), yticklabels=tasks, ylim=(len(tasks) - 0.4, -0.6))
    axes.set_xlim(left=start)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.minorticks_off()
    axes.grid(axis="x", color=GRID, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, labelsize=9, labelcolor=INK, pad=5)
    for side, spine in axes.spines.items():
        spine.set(visible=side == "left", edgecolor=GRID)
    axes.set_xlabel("time per pixel [ns]", color=INK, size=10)
    title = f"{size[0]}×{size[1]}, {_setting(chief.threads, chief.simd)}"
    figure.text(0.02, 1 - 0.3 / height, title, color=INK, size=13, weight="bold", va="center")
    keys: list[Any] = [Patch(color=COLORS[0], label="Yester")]
    if any(timing.limit for timing in same):
        keys.append(
            Line2D([], [], color=INK, linewidth=1.8, label="limit", marker="|", linestyle="none", markersize=11)
        )
    keys += [Line2D([], [], color=colors[one], marker="D", linestyle="none", label=one) for one in libraries]
    where = {"loc": "center left", "bbox_to_anchor": (0.01, 1 - 0.68 / height), "frameon": False}
    figure.legend(handles=keys, ncols=len(keys), fontsize=9, labelcolor=INK, columnspacing=1.4, **where)
    return figure


def _library(timing: Timing) -> str:
    """The library of a rival: the first word of its name."""
    return timing.contender if timing.contender == REFERENCE else timing.contender.split()[0]
