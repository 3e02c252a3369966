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


def _energy(passes: int) -> float:
    """Sum of the squared weights of all passes together."""
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

    λ = (|D| - noise·√(V·K / Σw)) / M within [0, 1], with D, V mean and variance of l - l' under a binomial kernel whose
    squared weights sum up to K, M the mean of max(|l|, |l'|).
    Source: Schied et al. 2018 (A-SVGF), whose gradients are free of noise.

    Parameters
    ----------
    color, previous : (H, W, 3)
    noise : standard errors that are subtracted
    passes, widest : fewest and most à-trous passes; the largest gradient counts
    margin : also return the factor (H, W) by which the cancellation in the variance multiplies roundings

    Returns
    -------
    (H, W), 0 to 1
    """
    both = (color.isfinite() & previous.isfinite()).all(-1)  # (H, W)
    now, before = (luminance(image.where(both[..., None], 0)) for image in (color, previous))  # (H, W), (H, W)
    change = now - before  # (H, W)
    planes = [both.to(now), change, change**2, torch.maximum(now.abs(), before.abs())]  # 4 of (H, W)
    gradient, margins = torch.zeros_like(now), torch.ones_like(now)  # (H, W), (H, W)
    for i in range(widest + 1):
        if i >= passes:
            weight = planes[0]  # (H, W)
            mean, square, size = (plane / weight for plane in planes[1:])  # (H, W) each
            variance = (square - mean**2).clamp(min=0)  # (H, W)
            error = noise * (variance * _energy(i) / weight).sqrt()  # (H, W)
            found = torch.where((weight > 0) & (size > 0), (mean.abs() - error) / size, 0).clamp(0, 1)  # (H, W)
            gradient = gradient.maximum(found)  # (H, W)
            rounded = noise * ((variance + 1e-6 * square) * _energy(i) / weight).sqrt() - error  # (H, W)
            margins = margins.maximum(1 + (1e5 * rounded / size).nan_to_num(0, 0, 0))  # (H, W)
        planes = [_smooth(plane, 2**i) for plane in planes]
    return (gradient, margins) if margin else gradient
