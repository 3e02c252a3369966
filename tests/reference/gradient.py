import numpy as np
import torch
from torch import Tensor

from .accumulate import luminance
from .similarity import shift


def _smooth(plane: Tensor, step: int) -> Tensor:
    """{1, 2, 1}/4 along both axes of (H, W), at a step, nothing outside."""
    for dx, dy in ((step, 0), (0, step)):
        plane = plane / 2 + (shift(plane, dx, dy, 0) + shift(plane, -dx, -dy, 0)) / 4  # (H, W)
    return plane


def _cells(plane: Tensor) -> Tensor:
    """Sums over 2×2 pixels, fewer at the last row and column of odd sizes."""
    height, width = plane.shape
    even = torch.nn.functional.pad(plane, (0, width % 2, 0, height % 2))
    return even.unfold(0, 2, 2).unfold(1, 2, 2).sum((-1, -2))  # (⌈H/2⌉, ⌈W/2⌉)


def _energy(passes: int) -> float:
    """Sum of the squared weights of all blurs together."""
    kernel = np.ones(1)
    for i in range(passes):
        taps = np.zeros(2 * 2**i + 1)
        taps[[0, 2**i, -1]] = 0.25, 0.5, 0.25
        kernel = np.convolve(kernel, taps)
    return float((kernel**2).sum() ** 2)


def temporal_gradient(
    color: Tensor, previous: Tensor, *, noise=2.0, passes=3, widest=3, margin=False
) -> Tensor | tuple[Tensor, Tensor]:
    """The relative change of light: the smoothed signed difference, minus noise, divided by the larger light.

    λ = (|D| - noise·√(V·K / Σw)) / M within [0, 1], with D, V mean and variance of l - l' under a binomial kernel over
    cells of 2×2 pixels whose squared weights sum up to K, Σw the number of pixels, M the mean of max(|l|, |l'|).
    Source: Schied et al. 2018 (A-SVGF), whose gradients are free of noise, in cells of 3×3.

    Parameters
    ----------
    color, previous : (H, W, 3)
    noise : standard errors that are subtracted
    passes, widest : fewest and most passes, the first of which sums cells; the largest gradient counts
    margin : also return the factor (H, W) by which the cancellation in the variance multiplies roundings

    Returns
    -------
    (H, W), 0 to 1
    """
    both = (color.isfinite() & previous.isfinite()).all(-1)  # (H, W)
    now, before = (luminance(image.where(both[..., None], 0)) for image in (color, previous))  # (H, W), (H, W)
    change = now - before  # (H, W)
    pixels = [both.to(now), change, change**2, torch.maximum(now.abs(), before.abs())]  # 4 of (H, W)
    planes = [_cells(plane) for plane in pixels]  # 4 of (⌈H/2⌉, ⌈W/2⌉), as all that follow
    gradient, margins = torch.zeros_like(planes[0]), torch.ones_like(planes[0])
    for i in range(widest):
        if i + 1 >= passes:
            weight = planes[0]
            mean, square, size = (plane / weight for plane in planes[1:])
            variance = (square - mean**2).clamp(min=0)
            error = noise * (variance * _energy(i) / weight).sqrt()
            found = torch.where((weight > 0) & (size > 0), (mean.abs() - error) / size, 0).clamp(0, 1)
            gradient = gradient.maximum(found)
            rounded = noise * ((variance + 1e-6 * square) * _energy(i) / weight).sqrt() - error
            margins = margins.maximum(1 + (1e5 * rounded / size).nan_to_num(0, 0, 0))
        planes = [_smooth(plane, 2**i) for plane in planes]
    height, width = now.shape
    gradient, margins = (
        cells.repeat_interleave(2, 0).repeat_interleave(2, 1)[:height, :width] for cells in (gradient, margins)
    )  # (H, W), (H, W)
    return (gradient, margins) if margin else gradient
