"""Stein's estimate compared with the estimate by prediction: ``python -m yester.study.compare.stein``.

Every sequence is denoised with and without each component of `SVGF` that the ablation study switches, and both
estimates say how much worse the result is without it. Stein's needs the derivative of a pixel's result by its own
sample, which Ramani's Monte Carlo method measures: the sequence is denoised again with a little more or less light in
every pixel. Printed are the rank correlations of both with the true differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yester import Frame
from yester.judge import Predicted, estimate, tile_sums, weights

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import judging
from .ablation import bases
from .judging import Judged

__all__ = ["judged", "shifted", "stein_error"]

#: The added light, relative to that of the surroundings: small enough for a derivative, large beside rounding.
_STEP = 1 / 64
#: Side of the window over which light and variance are averaged.
_WINDOW = 5

Images = Sequence[ArrayLike]


def shifted(frames: Sequence[Frame], seed: int = 0) -> tuple[list[Frame], list[NDArray[np.float32]]]:
    """Add light to each sample, or take it away, with equal chances.

    Parameters
    ----------
    frames : sequence of Frame
        The frames, in order.
    seed : int, default 0
        Of the chances.

    Returns
    -------
    frames : list of Frame
        With other colours.
    shifts : list of (H, W, 3) array of float32
        What was added, 1/64 of the light around; missing samples stay missing.
    """
    rng, shifts = np.random.default_rng(seed), []
    for frame in frames:
        light = _mean_around(np.nan_to_num(np.maximum(frame.color, 0)).mean(-1))
        signs = rng.choice([-1, 1], frame.color.shape)
        shifts.append((_STEP * signs * np.maximum(light, 1e-4)[..., None]).astype(np.float32))
    return [replace(frame, color=frame.color + shift) for frame, shift in zip(frames, shifts, strict=True)], shifts


def stein_error(
    first: Sequence[Images],
    second: Sequence[Images],
    frames: Sequence[Frame],
    shifts: Images,
    *,
    start: int = 0,
    tile: int = 16,
) -> dict[str, Predicted]:
    """Estimate, without a reference, the difference of two methods' errors by Stein's unbiased risk estimate.

    The squared error of a result F of samples y is the expectation of (F - y)² - σ² + 2σ² ∂F/∂y. Between two methods
    the variance σ² of the samples cancels but in the last term.

    Parameters
    ----------
    first, second : pair of sequences of (H, W, 3) array_like of float
        The results of each method for every frame, and its results for the frames that `shifted` returns.
    frames : sequence of Frame
        The frames, in order.
    shifts : sequence of (H, W, 3) array_like of float
        What `shifted` added.
    start : int, default 0
        The first frame whose results are compared.
    tile : int, default 16
        Side of the tiles in pixels.

    Returns
    -------
    dict of str to Predicted
        By weighting of the squared error, as in `yester.judge.predictive_error`. `difference` is positive where the
        first method is worse.

    Raises
    ------
    ValueError
        If frames and results differ in length, or no frame is left.

    Notes
    -----
    σ² is the variance of the samples over 5×5 pixels, in which texture counts as noise. The estimate is unbiased for
    Gaussian noise of known variance; a path tracer's noise is neither. A derivative is the change of the result divided
    by that of the sample: changes of other samples, of which the result has parts, have independent signs and average
    out.

    References
    ----------
    Stein, "Estimation of the Mean of a Multivariate Normal Distribution", 1981. Ramani, Blu and Unser, "Monte-Carlo
    Sure: A Black-Box Optimization of Regularization Parameters for General Denoising Algorithms", 2008.
    """
    lengths = {len(each) for each in (*first, *second, frames, shifts)}
    if len(lengths) > 1 or not 0 <= start < len(frames):
        raise ValueError(f"frames: expected as many results, more than {start}, got {sorted(lengths)}")
    by_frame = []
    for t in range(start, len(frames)):
        y = frames[t].color.astype(np.float64)
        known = np.asarray(np.isfinite(y).all(-1))
        a, a_shifted, b, b_shifted, y = (
            np.where(known[..., None], np.asarray(image, np.float64), 0)
            for image in (*(images[t] for images in (*first, *second)), y)
        )
        mean = 0.5 * (a + b)
        spread = np.dstack([_variance_around(channel) for channel in np.moveaxis(y, -1, 0)])
        slopes = ((a_shifted - a) - (b_shifted - b)) / np.asarray(shifts[t], np.float64)
        worse = ((a - b) * (a + b - 2 * y) + 2 * spread * slopes).mean(-1)
        change = ((a - b) ** 2).mean(-1)
        pairs = [(weight * worse, weight * change) for weight in weights(mean.mean(-1))]
        by_frame.append([[tile_sums(image, tile) for image in (one, known, other)] for one, other in pairs])
    return estimate(np.array(by_frame))


def judged(recording: Recording) -> tuple[list[Judged], list[Judged]]:
    """Estimate the worth of every component of `SVGF` on one sequence, by Stein's estimate and by prediction.

    Parameters
    ----------
    recording : Recording
        With references up to the last frame.

    Returns
    -------
    stein, predicted : list of Judged
        One for each component.
    """
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    moved, shifts = shifted(frames)
    wholes = {base: [judging.colors(base.run, each) for each in (frames, moved)] for base in bases(judging.PARTS)}
    predicted, stein = judging.judged(recording), []
    for part, one in zip(judging.PARTS, predicted, strict=True):
        images = [judging.colors(part.method.run, each) for each in (frames, moved)]
        said = stein_error(images, wholes[part.base], frames, shifts, start=judging.START)
        difference = {name: each.difference for name, each in said.items()}
        stein.append(one._replace(predicted=difference, error={name: each.error for name, each in said.items()}))
    return stein, predicted


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the rank correlations of both estimates."""
    options = parser("yester.study.compare.stein", __doc__).parse_args(arguments)
    found = [judged(record(name, options.cache, **judging.SHAPE)) for name in expand(options.sequences)]
    by_stein, by_prediction = ([one for each in side for one in each] for side in zip(*found, strict=True))
    judging.compare({"Stein's estimate": by_stein, "prediction": by_prediction})


def _mean_around(image: NDArray[Any]) -> NDArray[np.float64]:
    """The mean over the window, whose part outside the image repeats the border."""
    padded = np.pad(np.asarray(image, np.float64), _WINDOW // 2, mode="edge")
    for axis in (0, 1):
        padded = np.lib.stride_tricks.sliding_window_view(padded, _WINDOW, axis).mean(-1)
    return padded


def _variance_around(image: NDArray[Any]) -> NDArray[np.float64]:
    """The unbiased variance over the window."""
    count = _WINDOW**2
    return np.maximum(_mean_around(image**2) - _mean_around(image) ** 2, 0) * count / (count - 1)


if __name__ == "__main__":
    main()
