"""What later frames are worth, and what they cost: ``python -m yester.study.compare.lookahead``.

For each sequence, `SVGF` alone, `SVGF` on both sides and, where it is installed, Open Image Denoise on each frame by
itself: errors, and the time of a frame. Then means over the sequences: of the errors at the beginning, in the middle
and at the end, and of the error of pixels that have just come into view beside that of their neighbours. Last, time and
memory against the lookahead.
"""

from __future__ import annotations

import argparse
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import cycle, islice
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from yester import SVGF, Frame, denoise
from yester.cli import _count, _size, _whole
from yester.metrics import METRICS, Picture, relmse

from ..rendered.recording import Recording, record
from ..rendered.sequences import GROUPS, LATE, NAMES
from ..speed.bench import CALM, resident, staged
from ..speed.tasks import Inputs
from . import harm, points
from .chart import orders, times
from .methods import PIPELINES, Method, Result, pipeline
from .peers import peers
from .points import Point

__all__ = ["Cost", "Revealed", "Worth", "costs", "ends", "errors", "gains", "methods", "places", "revealed", "worth"]

#: Metrics of each frame; that of the change from frame to frame is taken where the frame before has a reference, too.
_EACH, _CHANGE = ("psnr", "relmse", "flip"), "temporal_error"
#: Frames at each of the places of `places`.
_PLACE = 3
#: Distance, in pixels, up to which pixels are neighbours, along rows and columns.
_NEAR = 3
#: Share of new pixels above which a frame is the first after a cut, whose pixels have no neighbours with history.
_CUT = 0.5
#: Steps of the pipeline for a frame of lookahead, and in any case, over which memory is measured.
_STEPS, _FEWEST = 12, 16


class Revealed(NamedTuple):
    """The error of pixels that have just come into view.

    Attributes
    ----------
    new, neighbours : float
        relMSE of the pixels whose history the pipeline without later frames rejects, and of those around them that have
        history.
    """

    new: float
    neighbours: float


class Worth(NamedTuple):
    """What the methods make of one sequence.

    Attributes
    ----------
    points : list of Point
        One for each method. Errors are means over the frames with a reference; the time is that of a frame of the
        sequence, its first ones included: the median of three turns, and their range.
    frames : dict of str to dict of int to dict of str to float
        By method, index of the frame and metric, the errors.
    length : int
        Frames of the sequence.
    revealed : dict of str to Revealed
        By method; empty if nothing comes into view in the frames with a reference.
    share : float
        Share of the new pixels in these frames.
    """

    points: list[Point]
    frames: dict[str, dict[int, dict[str, float]]]
    length: int
    revealed: dict[str, Revealed]
    share: float


class Cost(NamedTuple):
    """What a lookahead costs.

    Attributes
    ----------
    lookahead : int
    ms : float
        Median time of a frame in milliseconds.
    memory : float or None
        MB by which a process grows at most, from before the pipeline is constructed, while frames are given one at a
        time and results are thrown away; None where the system does not report it.
    """

    lookahead: int
    ms: float
    memory: float | None


def methods() -> list[Method]:
    """`SVGF` without later frames and with them, and Open Image Denoise in its best quality if it is installed."""
    wanted = ("SVGF", "SVGF, both sides", "OIDN high")
    found = {method.name: method for method in (*PIPELINES, *peers()[0])}
    return [found[name] for name in wanted if name in found]


def places(length: int) -> dict[str, range]:
    """The first three frames of a sequence, three in its middle, and the last three, by the names of these places."""
    few = min(_PLACE, length)
    starts = {"beginning": 0, "middle": (length - few + 1) // 2, "end": length - few}
    return {name: range(start, start + few) for name, start in starts.items()}


def worth(recording: Recording, compared: Sequence[Method]) -> Worth:
    """Run methods on one sequence, and measure the frames that have a reference.

    Parameters
    ----------
    recording : Recording
        With references; the metric of changes needs some of consecutive frames.
    compared : sequence of Method
        With different names. The first one is a pipeline without later frames, which tells what comes into view.

    Returns
    -------
    Worth
    """
    given = [recording.frame(i) for i in range(len(recording.frames))]
    true = {i: Picture(recording.reference(i), str(recording.references[i])) for i in sorted(recording.references)}
    spent: list[list[float]] = [[] for _ in compared]
    results: list[list[Result]] = [[] for _ in compared]
    for order in orders(len(compared)):
        for number in order:
            time.sleep(CALM)
            start = time.perf_counter()
            results[number] = [*compared[number].run(iter(given))]
            spent[number].append(1e3 * (time.perf_counter() - start) / len(given))

    found, measured, images = [], {}, {}
    for method, made, taken in zip(compared, results, spent, strict=True):
        images[method.name] = pictures = {i: Picture(made[i].color, method.name) for i in true}
        measured[method.name] = each = {i: _errors(pictures, true, i) for i in true}
        keys = dict.fromkeys(key for values in each.values() for key in values)
        found.append(
            Point(
                *(recording.name, method.name, method.family, method.default, method.peer),
                ms=float(np.median(taken)),
                ms_range=(min(taken), max(taken)),
                values={key: float(np.mean([v[key] for v in each.values() if key in v])) for key in keys},
                size=recording.size,
            )
        )
    return Worth(found, measured, len(given), *_revealed(results[0], images, true))


def errors(found: Sequence[Worth]) -> str:
    """Write the errors and times of each sequence, and of several their means, as tables."""
    every = [point for each in found for point in each.points]
    scenes = [each.points for each in found] + ([points.means(every)] if len(found) > 1 else [])
    return "\n\n".join(f"{same[0].scene}\n{points.table(same)}" for same in scenes)


def gains(found: Sequence[Worth], method: str = "SVGF, both sides") -> str:
    """Write what one method gains over each of the others: means, in how many sequences, and the worst case."""
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for each in found:
        values = {point.method: point.values for point in each.points}
        for other in values.keys() - {method}:
            rows.setdefault(f"{method} over {other}", {})[each.points[0].scene] = harm.gains(
                values[method], values[other]
            )
    return harm.table(dict(sorted(rows.items(), reverse=True)))


def ends(found: Sequence[Worth]) -> str:
    """Write the errors of the frames, by their places in the sequence, as means over sequences of one length.

    Every frame that has a reference in all of these sequences has a row, with its place if that is one of `places`.
    """
    common = set.intersection(*({*frames} for each in found for frames in each.frames.values()))
    named = {i: name for name, part in reversed(places(found[0].length).items()) for i in part}
    columns = [(key, name) for key in ("relmse", "flip") for name in found[0].frames]
    rows = [["", "frame", *(f"{METRICS[key].label}, {name}" for key, name in columns)]]
    for i in sorted(common):
        values = [float(np.mean([each.frames[name][i][key] for each in found])) for key, name in columns]
        rows.append([named.get(i, ""), str(i), *(f"{value:.4f}" for value in values)])
    return harm.aligned(rows)


def revealed(found: Sequence[Worth]) -> str:
    """Write the relMSE of pixels that have just come into view, and of their neighbours, for each sequence that has
    such pixels, and as means and medians over these."""
    some = [each for each in found if each.revealed]
    if not some:
        return "nothing comes into view"
    names = [*some[0].revealed]
    rows = [["", "new pixels", *(f"{name}, {which}" for name in names for which in Revealed._fields)]]

    def line(scene: str, share: float, values: Mapping[str, Sequence[float]]) -> list[str]:
        return [scene, f"{100 * share:.2f} %", *(f"{value:.4f}" for name in names for value in values[name])]

    rows += [line(each.points[0].scene, each.share, each.revealed) for each in some]
    # A few pixels beside a lamp can be most of a mean.
    for title, middle in (("mean", np.mean), ("median", np.median)):
        values = {name: middle([each.revealed[name] for each in some], 0).tolist() for name in names}
        rows.append(line(title, float(middle([each.share for each in some])), values))
    return harm.aligned(rows)


def costs(lookaheads: Sequence[int] = (0, 2, 4, 8, 16), size: tuple[int, int] = (640, 360)) -> list[Cost]:
    """Measure time and memory of `denoise` with `SVGF` against the lookahead.

    Parameters
    ----------
    lookaheads : sequence of int, default 0, 2, 4, 8, 16
        All different.
    size : (int, int), default 640x360
        Width and height of the frames, which are those of `yester bench`.

    Returns
    -------
    list of Cost
        Times as `yester.study.compare.chart.times` measures them; memory in a process of its own for each.

    Raises
    ------
    ValueError
        If a lookahead is negative.
    """
    timed = [Method(f"lookahead {n}", "lookahead", pipeline(SVGF, lookahead=n)) for n in lookaheads]
    with TemporaryDirectory(prefix="yester-lookahead-") as folder:
        spent = times(timed, Path(folder), size)
    with (
        staged(*size) as images,
        ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as alone,
    ):
        held = [alone.submit(_memory, n, images, size).result() for n in lookaheads]
    medians = [float(np.median(spent[method.name])) for method in timed]
    return [Cost(*each) for each in zip(lookaheads, medians, held, strict=True)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.lookahead", description=__doc__)
    groups = f"names, {', '.join(GROUPS)}; by default all, which is without the last group"
    parser.add_argument(
        "--sequences", metavar="NAME", nargs="+", default=["all"], choices=[*GROUPS, *NAMES, *LATE], help=groups
    )
    parser.add_argument("--length", metavar="N", type=_count, default=20, help="frames; %(default)s")
    parser.add_argument("--size", metavar="WxH", type=_size, default=(128, 96), help="128x96")
    about = "frames with a reference; by default, three at the beginning, in the middle and at the end"
    parser.add_argument("--references", metavar="FRAME", type=_whole, nargs="+", help=about)
    parser.add_argument("--reference-spp", metavar="N", type=_count, help="by default, 256 or 512")
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder for rendered frames")
    about = "whose time and memory are measured; 0 2 4 8 16, or none"
    parser.add_argument("--lookaheads", metavar="N", type=_whole, nargs="*", default=(0, 2, 4, 8, 16), help=about)
    parser.add_argument("--time-size", metavar="WxH", type=_size, default=(640, 360), help="of these; 640x360")
    options = parser.parse_args(arguments)
    width, height = options.size
    asked = options.references or {i for part in places(options.length).values() for i in part}
    shape = {"frames": options.length, "width": width, "height": height, "reference_spp": options.reference_spp}
    compared, found = methods(), []
    for name in dict.fromkeys(name for one in options.sequences for name in GROUPS.get(one, (one,))):
        found.append(worth(record(name, options.cache, **shape, references=asked), compared))
    print(errors(found), gains(found), ends(found), revealed(found), sep="\n\n", flush=True)
    if options.lookaheads:
        print(f"\n{_costs(costs(options.lookaheads, options.time_size))}")


def _errors(pictures: Mapping[int, Picture], true: Mapping[int, Picture], i: int) -> dict[str, float]:
    """By metric, the errors of one frame."""
    found = {key: METRICS[key].measure(pictures[i], true[i]) for key in _EACH}
    if i - 1 in true:
        found[_CHANGE] = METRICS[_CHANGE].measure(pictures[i], pictures[i - 1], true[i], true[i - 1])
    return found


def _revealed(
    forward: Sequence[Result], images: Mapping[str, Mapping[int, Picture]], true: Mapping[int, Picture]
) -> tuple[dict[str, Revealed], float]:
    """By method, the errors of new pixels and of their neighbours, and the share of new pixels."""
    masks = {}
    for i in true:
        confidence = forward[i].confidence
        assert confidence is not None
        new = confidence == 0
        if i > 0 and new.any() and new.mean() <= _CUT:
            masks[i] = new, _around(new)
    if not masks:
        return {}, 0.0

    def seen(pictures: Mapping[int, Picture], which: int) -> Picture:
        """Pixels of all frames, as an image of one row."""
        return Picture(np.concatenate([pictures[i].linear[mask[which]] for i, mask in masks.items()])[None])

    found = {
        name: Revealed(*(relmse(seen(pictures, which), seen(true, which)) for which in (0, 1)))
        for name, pictures in images.items()
    }
    return found, float(np.mean([new.mean() for new, _ in masks.values()]))


def _around(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The pixels that are not in the mask, but near one that is."""
    side = 2 * _NEAR + 1
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(mask, _NEAR), (side, side))
    return np.asarray(windows.any((-1, -2)) & ~mask)


def _memory(lookahead: int, folder: Path, size: tuple[int, int]) -> float | None:
    """MB by which this process grows at most."""
    frames = Inputs(folder, *size).frames()

    def fresh(count: int) -> Iterator[Frame]:
        for frame in islice(cycle(frames), count):
            yield Frame(**{name: buffer.copy() for name, buffer in frame.buffers().items()}, camera=frame.camera)

    # What was read is in memory before.
    deque(fresh(len(frames)), maxlen=0)
    try:
        before, _ = resident()
    except OSError:
        return None
    deque(denoise(fresh(_FEWEST + _STEPS * lookahead), SVGF(), lookahead), maxlen=0)
    _, most = resident()
    return most - before


def _costs(found: Sequence[Cost]) -> str:
    rows = [["lookahead", "ms", "of the first", "MB"]]
    for cost in found:
        memory = "" if cost.memory is None else f"{cost.memory:.0f}"
        rows.append([str(cost.lookahead), f"{cost.ms:.1f}", f"{cost.ms / found[0].ms:.2f}", memory])
    return harm.aligned(rows)


if __name__ == "__main__":
    main()
