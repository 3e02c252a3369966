"""Two-buffer error estimates compared with estimates by prediction: ``python -m yester.study.compare.halves``.

Each sequence is rendered twice with independent noise, as two half-buffers. Both are denoised with and without every
component of `SVGF` that the ablation study switches, and each half estimates the error of the other's results. The true
difference is that of the mean of both results, measured against references; printed are the rank correlations of both
estimates with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yester import Frame
from yester.judge import WEIGHTINGS, Predicted, estimate, predictive_error, tile_sums, weights

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import harm, judging
from .ablation import bases
from .judging import Judged

__all__ = ["judged", "two_buffer_error"]

Images: TypeAlias = Sequence[ArrayLike]


def two_buffer_error(
    first: Sequence[Images],
    second: Sequence[Images],
    halves: Sequence[Sequence[Frame]],
    *,
    start: int = 0,
    tile: int = 16,
) -> dict[str, Predicted]:
    """Estimate, without a reference, the difference of two methods' errors, of the mean over two half-buffers each.

    With A and B the halves, F_A and F_B a method's results for them, and Var the variance of the halves' mean, the
    squared error of the mean of F_A and F_B is the expectation of
    ½ [(B - F_A)² + (A - F_B)²] - 2 Var - ¼ (F_B - F_A)². Between two methods, Var cancels.

    Parameters
    ----------
    first, second : pair of sequences of (H, W, 3) array_like of float
        The results of each method: for every frame of the first half, and of the second.
    halves : pair of sequences of Frame
        The frames of both halves, in order: the same views, with noise independent of each other, as
        `render_sequence` renders with `halves`.
    start : int, default 0
        The first frame whose results are compared.
    tile : int, default 16
        Side of the tiles in pixels.

    Returns
    -------
    dict of str to Predicted
        By weighting of the squared error, as in `yester.judge.predictive_error`. `difference` is positive where the
        first method is worse; `change` is the mean squared deviation of the second method's results from their mean.

    Raises
    ------
    ValueError
        If halves and results differ in length, or no frame is left.

    Notes
    -----
    A half is compared with results for the same frame. Nothing is reprojected, so that edges and reflections count like
    all other pixels. The weight of a sample depends only on results of the other half, which are independent of it. The
    last term has the mean of both weights. As the weights share the results' noise, the sum is without bias only where
    results have little of it: of results with a noise of 0.3, at light of 0.2 to 0.8, the relative weighting says a
    quarter too much.

    References
    ----------
    Rousselle, Knaus and Zwicker, "Adaptive Rendering with Non-Local Means Filtering", 2012: two buffers of half the
    samples each, one of which is filtered with weights from the other.
    """
    lengths = {len(each) for each in (*first, *second, *halves)}
    if len(lengths) > 1 or not 0 <= start < len(halves[0]):
        raise ValueError(f"halves: expected as many frames as results, more than {start}, got {sorted(lengths)}")
    by_frame = []
    for t in range(start, len(halves[0])):
        a, b = ([half[t] for half in pair] for pair in (first, second))
        by_frame.append(_compared(a, b, [half[t].color for half in halves], tile))
    return estimate(np.array(by_frame))


def judged(one: Recording, other: Recording) -> tuple[list[Judged], list[Judged]]:
    """Estimate the worth of every component of `SVGF` on one sequence, by two buffers and by prediction.

    Parameters
    ----------
    one, other : Recording
        The same sequence with independent noise, and with references up to the last frame.

    Returns
    -------
    two_buffer, predicted : list of Judged
        One for each component. The two-buffer estimate is that of the mean of both results. The estimate by prediction
        is the mean of the estimates for either half, its standard error that of independent halves.
    """
    halves = [[half.frame(i) for i in range(len(half.frames))] for half in (one, other)]
    known = sorted(one.references)
    true = {i: one.reference(i) for i in known}
    clean = [[replace(f, color=true[i]) if i in true else f for i, f in enumerate(half)] for half in halves]
    wholes = {base: [judging.colors(base.run, half) for half in halves] for base in bases(judging.PARTS)}
    own = {base: [judging.errors(some, one) for some in (*whole, _mean(*whole))] for base, whole in wholes.items()}
    by_halves, by_prediction = [], []
    for each in judging.PARTS:
        whole = wholes[each.base]
        images = [judging.colors(each.method.run, half) for half in halves]
        values = [judging.errors(some, one) for some in (*images, _mean(*images))]
        *single, both = (harm.gains(*pair) for pair in zip(own[each.base], values, strict=True))
        by_halves.append(
            _judged(
                *(one.name, each.component),
                [two_buffer_error(images, whole, halves, start=judging.START)],
                [_true_error(_mean(*images), _mean(*whole), true)],
                [both],
            )
        )
        pairs = [*zip(images, whole, halves, clean, strict=True)]
        by_prediction.append(
            _judged(
                *(one.name, each.component),
                [predictive_error(a, b, half, start=judging.START) for a, b, half, _ in pairs],
                [predictive_error(a, b, shown, start=known[0] - 1) for a, b, _, shown in pairs],
                single,
            )
        )
    return by_halves, by_prediction


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the rank correlations of both estimates."""
    options = parser("yester.study.compare.halves", __doc__).parse_args(arguments)
    by_halves: list[Judged] = []
    by_prediction: list[Judged] = []
    for name in expand(options.sequences):
        one = record(name, options.cache, **judging.SHAPE, halves=True)
        found = judged(one, one.variants[0])
        by_halves += found[0]
        by_prediction += found[1]
    judging.compare({"two buffers": by_halves, "prediction": by_prediction})


def _compared(first: Images, second: Images, samples: Sequence[NDArray[np.float32]], tile: int) -> NDArray[np.float64]:
    """The sums of one frame that `estimate` needs, (2, 3, h, w)."""
    known = np.asarray(np.isfinite(samples).all((0, -1)))
    a, b, y = (np.where(known[..., None], np.asarray(images, np.float64), 0) for images in (first, second, samples))
    # Reversed: each half's samples are compared with the results of the other half.
    worse = ((a - b) * (a + b - 2 * y[::-1])).mean(-1)
    means = 0.5 * (a + b).mean(-1)
    apart = 0.25 * (((a[1] - a[0]) ** 2) - (b[1] - b[0]) ** 2).mean(-1)
    deviation = 0.25 * ((b[1] - b[0]) ** 2).mean(-1)
    result = []
    for one, other in zip(*map(weights, means), strict=True):
        both = 0.5 * (one + other)
        difference = 0.5 * (one * worse[0] + other * worse[1]) - both * apart
        result.append([tile_sums(image, tile) for image in (difference, known, both * deviation)])
    return np.array(result)


def _true_error(first: Images, second: Images, true: dict[int, NDArray[np.float32]]) -> dict[str, Predicted]:
    """The difference of two methods' errors against references."""
    # With the reference as both halves, the estimate is exact.
    by_frame = [_compared([first[i]] * 2, [second[i]] * 2, [reference] * 2, 16) for i, reference in true.items()]
    return estimate(np.array(by_frame))


def _judged(
    scene: str,
    component: str,
    said: Sequence[dict[str, Predicted]],
    clean: Sequence[dict[str, Predicted]],
    gained: Sequence[dict[str, float]],
) -> Judged:
    """Means over halves."""
    return Judged(
        scene,
        component,
        {w: float(np.mean([each[w].difference for each in said])) for w in WEIGHTINGS},
        {w: float(np.sqrt(np.sum([each[w].error ** 2 for each in said])) / len(said)) for w in WEIGHTINGS},
        {w: float(np.mean([each[w].difference for each in clean])) for w in WEIGHTINGS},
        {key: float(np.mean([each[key] for each in gained])) for key in gained[0]},
    )


def _mean(one: Sequence[NDArray[np.float32]], other: Sequence[NDArray[np.float32]]) -> list[NDArray[np.float32]]:
    """The mean of the results for both halves."""
    return [0.5 * (a + b) for a, b in zip(one, other, strict=True)]


if __name__ == "__main__":
    main()
