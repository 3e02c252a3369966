"""Accuracy of error estimates without references, and the worth of plans: ``python -m yester.study.compare.judging``.

For every component of `SVGF` that the ablation study switches and every sequence, `predictive_error` estimates from the
noisy frames how much worse the result is without the component. Printed are the rank correlations of these estimates
with the differences measured against references. Then each sequence is planned from its first eight frames, through
every door, and the plan's result is compared with the default's: with earlier frames alone, and with those on both
sides. Last, how many passes of the filter the pixels of each sequence show.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import yester
from yester import SVGF, Frame, Plan
from yester.io import read_exr
from yester.judge import predictive_error
from yester.metrics import METRICS, Picture

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import harm
from .ablation import ABLATIONS, bases
from .doors import DOORS, Door, known_doors
from .methods import Run, pipeline

__all__ = [
    "PARTS",
    "SHAPE",
    "Judged",
    "Worth",
    "compare",
    "correlations",
    "judged",
    "passes",
    "rank_correlation",
    "table",
    "worth",
]

#: The first frame whose results are compared: those before it have next to no history.
START = 2
_MEASURED = ("psnr", "relmse", "flip")
#: Passes that a pixel shows at most: one more than the default.
_MOST = 4

#: The components whose worth is estimated.
PARTS = tuple(each for each in ABLATIONS if each.whole.name == "SVGF" and not each.added)

#: The sequences on which estimates are compared with true errors, as arguments of `record`.
SHAPE: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 64, "references": range(4, 12)}


class Judged(NamedTuple):
    """A component's worth on a sequence: estimated, and measured against references.

    Attributes
    ----------
    scene, component : str
    predicted, error : dict of str to float
        By weighting, the estimated increase of the error without the component, and its standard error.
    clean : dict of str to float
        By weighting, the same estimate with the references' colours as samples: the true increase.
    gains : dict of str to float
        By metric, the gain of the component, as `harm.gains` returns it.
    """

    scene: str
    component: str
    predicted: dict[str, float]
    error: dict[str, float]
    clean: dict[str, float]
    gains: dict[str, float]


class Worth(NamedTuple):
    """The worth of a plan on a sequence.

    Attributes
    ----------
    scene, door : str
    plan : Plan
    gains, both : dict of str to float
        By metric, the gain of the plan over the default, as `harm.gains` returns it: with earlier frames alone, and
        with those on both sides.
    """

    scene: str
    door: str
    plan: Plan
    gains: dict[str, float]
    both: dict[str, float]


def judged(recording: Recording) -> list[Judged]:
    """Estimate and measure the worth of every component of `SVGF` on one sequence with references."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    known = sorted(recording.references)
    clean = [replace(frame, color=recording.reference(i)) if i in known else frame for i, frame in enumerate(frames)]
    wholes = {base: colors(base.run, frames) for base in bases(PARTS)}
    values = {base: errors(whole, recording) for base, whole in wholes.items()}
    found = []
    for each in PARTS:
        whole = wholes[each.base]
        images = colors(each.method.run, frames)
        said = predictive_error(images, whole, frames, start=START)
        # Starts one frame before the first reference, since results are compared with the next frame's samples.
        true = predictive_error(images, whole, clean, start=known[0] - 1)
        found.append(
            Judged(
                recording.name,
                each.component,
                {name: one.difference for name, one in said.items()},
                {name: one.error for name, one in said.items()},
                {name: one.difference for name, one in true.items()},
                harm.gains(values[each.base], errors(images, recording)),
            )
        )
    return found


def correlations(found: Sequence[Judged]) -> str:
    """Write rank correlations over sequences, by component and over all components, as a table.

    The first two columns correlate the estimate with the true difference, for either weighting; the third the relative
    estimate with the gain in relMSE; the last the display-weighted estimate with the gain in PSNR. A component that
    changes nothing has no correlation, and is left out of the row of all.
    """
    parts: dict[str, list[Judged]] = {}
    for each in found:
        parts.setdefault(each.component, []).append(each)
    changing = [each for some in parts.values() if any(any(e.predicted.values()) for e in some) for each in some]
    lines = [["", "relative", "display", "relMSE", "PSNR"]]
    for name, some in {**parts, "all": changing}.items():
        pairs = [
            *(([e.predicted[w] for e in some], [e.clean[w] for e in some]) for w in ("relative", "display")),
            *(
                ([e.predicted[w] for e in some], [e.gains[metric] for e in some])
                for w, metric in (("relative", "relmse"), ("display", "psnr"))
            ),
        ]
        ranks = [rank_correlation(*pair) for pair in pairs]
        lines.append([name, *("–" if math.isnan(value) else f"{value:.2f}" for value in ranks)])
    clear = [
        (each.predicted[w] > 0) == (each.clean[w] > 0)
        for each in found
        for w in each.predicted
        if abs(each.predicted[w]) > 2 * each.error[w]
    ]
    share = f"the sign is right in {100 * np.mean(clear):.0f} % of {len(clear)} cases beyond two standard errors"
    return f"{harm.aligned(lines)}\n{share}"


def compare(estimates: Mapping[str, Sequence[Judged]]) -> None:
    """Print the rank correlations of several estimates, by their names."""
    for title, found in estimates.items():
        print(f"{title}\n{correlations(found)}", end="\n\n")


def worth(recording: Recording, door: Door = DOORS[0]) -> Worth:
    """Plan a sequence with references from its first frames, and compare the result with the default's."""
    raw = (read_exr(path).color for path in recording.raw_albedo.values()) if door.raw else repeat(None)
    frames = [*map(door.take, map(recording.frame, range(len(recording.frames))), raw)]
    with warnings.catch_warnings():
        # Frames without motion and cameras have no later frames, and frames without guides no plan.
        warnings.simplefilter("ignore", UserWarning)
        plan = yester.plan(frames)
        default, planned = (
            [
                errors([output.color for output in yester.denoise(frames, pipeline, ahead)], recording)
                for ahead in (0, yester.sequence.LOOKAHEAD)
            ]
            for pipeline in (SVGF(), plan.pipeline())
        )
    gains, both = (harm.gains(*pair) for pair in zip(planned, default, strict=True))
    return Worth(recording.name, door.name, plan, gains, both)


def table(found: Sequence[Worth]) -> str:
    """Write gains of plans by door, mean and worst case over all sequences; then the plans that leave something out."""
    ways = {"earlier frames": [each.gains for each in found], "both sides": [each.both for each in found]}
    lines = [["", "plans", *(f"{key}, {way}" for way in ways for key in _MEASURED)]]
    for door in dict.fromkeys(each.door for each in found):
        through = [number for number, each in enumerate(found) if each.door == door]
        made = sum(bool(found[number].plan.options or found[number].plan.without) for number in through)
        cells = [door, str(made)]
        for gains in ways.values():
            for key in _MEASURED:
                values = [gains[number][key] for number in through]
                cells.append(f"{harm.amount(key, float(np.mean(values)))} ({harm.amount(key, min(values))})")
        lines.append(cells)
    left: dict[str, list[str]] = {}
    for each in found:
        if each.plan.options or each.plan.without:
            left.setdefault(f"{each.door}, {each.plan.summary()}", []).append(each.scene)
    return "\n".join([harm.aligned(lines), "", *(f"{what}: {', '.join(scenes)}" for what, scenes in left.items())])


def passes(recordings: Iterable[Recording]) -> str:
    """Write the shares of pixels by the number of filter passes that they show, in the frames with a reference."""
    lines = [["passes shown", *map(str, range(_MOST + 1))]]
    for recording in recordings:
        shown = [result.choice for result in pipeline(SVGF)(map(recording.frame, range(len(recording.frames))))]
        numbers = np.rint(np.array([shown[i] for i in recording.references])).astype(np.int64)
        shares = np.bincount(numbers.ravel(), minlength=_MOST + 1) / numbers.size
        lines.append([recording.name, *(f"{100 * share:.0f} %" for share in shares)])
    return harm.aligned(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of correlations, then that of plans, then that of passes."""
    options = parser("yester.study.compare.judging", __doc__).parse_args(arguments)
    recordings = [record(name, options.cache, **SHAPE, raw_albedo=True) for name in expand(options.sequences)]
    print(correlations([each for recording in recordings for each in judged(recording)]), end="\n\n")
    found = [worth(recording, door) for recording in recordings for door in known_doors(recording, DOORS)]
    print(table(found), end="\n\n")
    print(passes(recordings))


def colors(run: Run, frames: Iterable[Frame]) -> list[NDArray[np.float32]]:
    """The colours of a method's results, in order."""
    return [result.color for result in run(frames)]


def errors(images: Sequence[NDArray[np.float32]], recording: Recording) -> dict[str, float]:
    """By metric, the mean over the frames with a reference."""
    pairs = [
        (Picture(images[i], "result"), Picture(recording.reference(i), str(path)))
        for i, path in recording.references.items()
    ]
    return {key: float(np.mean([METRICS[key].measure(*pair) for pair in pairs])) for key in _MEASURED}


def rank_correlation(first: ArrayLike, second: ArrayLike) -> float:
    """Spearman's rank correlation; equal values have the mean of their ranks. NaN if a list has no different values."""
    one, other = map(_ranks, (first, second))
    if min(len(np.unique(one)), len(np.unique(other))) < 2:
        return math.nan
    return float(np.corrcoef(one, other)[0, 1])


def _ranks(values: ArrayLike) -> NDArray[np.float64]:
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[place])


if __name__ == "__main__":
    main()
