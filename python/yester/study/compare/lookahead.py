"""Gain and cost of later frames: ``python -m yester.study.compare.lookahead``.

Prints, for each sequence, the errors and the time of `SVGF` without later frames, of `SVGF` on both sides and, if it is
installed, of Open Image Denoise on single frames. Then, as means over the sequences, the errors at the beginning, in
the middle and at the end, and the error of disoccluded pixels beside that of their neighbours. Last, time and memory
against the lookahead.
"""

from __future__ import annotations

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
from yester.argtypes import count, extent, whole
from yester.metrics import METRICS, Picture, relmse

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from ..speed.bench import CALM, resident, staged
from ..speed.tasks import Inputs
from . import harm, points
from .chart import orders, times
from .methods import PIPELINES, Method, Result, pipeline
from .peers import peers
from .points import Point

__all__ = ["Cost", "Revealed", "Worth", "costs", "ends", "errors", "gains", "methods", "places", "revealed", "worth"]

#: Metrics of each frame, and the metric of the change from frame to frame, which needs two references in a row.
_EACH, _CHANGE = ("psnr", "relmse", "flip"), "temporal_error"
#: Number of frames in each of the `places`.
_PLACE = 3
#: Distance up to which pixels are neighbours, in pixels along rows and columns.
_NEAR = 3
#: Fraction of disoccluded pixels above which a frame counts as the first after a cut, where no neighbour has history.
_CUT = 0.5
#: Memory is measured over this many steps of the pipeline per frame of lookahead, plus this many.
_STEPS, _FEWEST = 12, 16


class Revealed(NamedTuple):
    """The error of disoccluded pixels.

    Attributes
    ----------
    new, neighbours : float
        relMSE of the pixels whose history the pipeline without later frames rejects, and of the pixels around them that
        have history.
    """

    new: float
    neighbours: float


class Worth(NamedTuple):
    """The results of the methods on one sequence.

    Attributes
    ----------
    points : list of Point
        One for each method. Errors are means over the frames with a reference. The time per frame is the mean over the
        whole sequence, its first frames included: the median of three turns, and their range.
    frames : dict of str to dict of int to dict of str to float
        By method, index of the frame and metric, the errors.
    length : int
        Number of frames of the sequence.
    revealed : dict of str to Revealed
        By method; empty if the frames with a reference have no disoccluded pixels.
    share : float
        Fraction of disoccluded pixels in these frames.
    """

    points: list[Point]
    frames: dict[str, dict[int, dict[str, float]]]
    length: int
    revealed: dict[str, Revealed]
    share: float


class Cost(NamedTuple):
    """The cost of a lookahead.

    Attributes
    ----------
    lookahead : int
    ms : float
        Median time of a frame in milliseconds.
    memory : float or None
        Peak growth of a process in MB, from before the pipeline is constructed, while frames are given one at a time
        and results are discarded; None where the system does not report it.
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
        With different names. The first is a pipeline without later frames; its confidence marks disoccluded pixels.

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
    """Write the errors and times of each sequence, and the means over several sequences, as tables."""
    every = [point for each in found for point in each.points]
    scenes = [each.points for each in found] + ([points.means(every)] if len(found) > 1 else [])
    return "\n\n".join(f"{same[0].scene}\n{points.table(same)}" for same in scenes)


def gains(found: Sequence[Worth], method: str = "SVGF, both sides") -> str:
    """Write the gain of one method over each of the others: mean, number of sequences with a gain, worst case."""
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for each in found:
        values = {point.method: point.values for point in each.points}
        for other in values.keys() - {method}:
            rows.setdefault(f"{method} over {other}", {})[each.points[0].scene] = harm.gains(
                values[method], values[other]
            )
    return harm.table(dict(sorted(rows.items(), reverse=True)))


def ends(found: Sequence[Worth]) -> str:
    """Write the errors of each frame as means over sequences of equal length.

    Every frame that has a reference in all sequences has a row, labelled if it is in one of the `places`.
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
    """Write the relMSE of disoccluded pixels and of their neighbours, for each sequence with such pixels, and as means
    and medians over these sequences."""
    some = [each for each in found if each.revealed]
    if not some:
        return "no disoccluded pixels"
    names = [*some[0].revealed]
    rows = [["", "new pixels", *(f"{name}, {which}" for name in names for which in Revealed._fields)]]

    def line(scene: str, share: float, values: Mapping[str, Sequence[float]]) -> list[str]:
        return [scene, f"{100 * share:.2f} %", *(f"{value:.4f}" for name in names for value in values[name])]

    rows += [line(each.points[0].scene, each.share, each.revealed) for each in some]
    # A few pixels beside a lamp can dominate a mean.
    for title, middle in (("mean", np.mean), ("median", np.median)):
        values = {name: middle([each.revealed[name] for each in some], 0).tolist() for name in names}
        rows.append(line(title, float(middle([each.share for each in some])), values))
    return harm.aligned(rows)


def costs(lookaheads: Sequence[int] = (0, 2, 4, 8, 16), size: tuple[int, int] = (640, 360)) -> list[Cost]:
    """Measure time and memory of `denoise` with `SVGF` against the lookahead.

    Parameters
    ----------
    lookaheads : sequence of int, default 0, 2, 4, 8, 16
        Each at most once.
    size : (int, int), default 640x360
        Width and height of the frames, which show the scene of `yester bench`.

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
    """Print all tables."""
    line = parser("yester.study.compare.lookahead", __doc__)
    line.add_argument("--length", metavar="N", type=count, default=20, help="frames; %(default)s")
    line.add_argument("--size", metavar="WxH", type=extent, default=(128, 96), help="128x96")
    about = "frames with a reference; by default, three at the beginning, in the middle and at the end"
    line.add_argument("--references", metavar="FRAME", type=whole, nargs="+", help=about)
    line.add_argument("--reference-spp", metavar="N", type=count, help="by default, 256 or 512")
    about = "lookaheads whose time and memory are measured, or none; by default 0 2 4 8 16"
    line.add_argument("--lookaheads", metavar="N", type=whole, nargs="*", default=(0, 2, 4, 8, 16), help=about)
    line.add_argument("--time-size", metavar="WxH", type=extent, default=(640, 360), help="of timed frames; 640x360")
    options = line.parse_args(arguments)
    width, height = options.size
    asked = options.references or {i for part in places(options.length).values() for i in part}
    shape = {"frames": options.length, "width": width, "height": height, "reference_spp": options.reference_spp}
    compared, found = methods(), []
    for name in expand(options.sequences):
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
    """By method, the errors of disoccluded pixels and of their neighbours; and the fraction of disoccluded pixels."""
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
        """The masked pixels of all frames, as an image of one row."""
        return Picture(np.concatenate([pictures[i].linear[mask[which]] for i, mask in masks.items()])[None])

    found = {
        name: Revealed(*(relmse(seen(pictures, which), seen(true, which)) for which in (0, 1)))
        for name, pictures in images.items()
    }
    return found, float(np.mean([new.mean() for new, _ in masks.values()]))


def _around(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The neighbours of the mask: pixels outside it with a pixel of the mask nearby."""
    side = 2 * _NEAR + 1
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(mask, _NEAR), (side, side))
    return np.asarray(windows.any((-1, -2)) & ~mask)


def _memory(lookahead: int, folder: Path, size: tuple[int, int]) -> float | None:
    """Peak growth of this process, in MB."""
    frames = Inputs(folder, *size).frames()

    def fresh(count: int) -> Iterator[Frame]:
        for frame in islice(cycle(frames), count):
            yield Frame(**{name: buffer.copy() for name, buffer in frame.buffers().items()}, camera=frame.camera)

    # Read all images first, so that they are not counted.
    deque(fresh(len(frames)), maxlen=0)
    try:
        before, _ = resident()
    except OSError:
        return None
    deque(denoise(fresh(_FEWEST + _STEPS * lookahead), SVGF(), lookahead), maxlen=0)
    _, most = resident()
    return most - before


def _costs(found: Sequence[Cost]) -> str:
    rows = [["lookahead", "ms", "relative time", "MB"]]
    for cost in found:
        memory = "" if cost.memory is None else f"{cost.memory:.0f}"
        rows.append([str(cost.lookahead), f"{cost.ms:.1f}", f"{cost.ms / found[0].ms:.2f}", memory])
    return harm.aligned(rows)


if __name__ == "__main__":
    main()
