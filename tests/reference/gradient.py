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
    color: Tensor, previous: Tensor, *, noise=2.0, passes=3, margin=False
) -> Tensor | tuple[Tensor, Tensor]:
    """How much of the light has changed: its smoothed signed difference, less what noise explains, over the larger.

    λ = (|D| - noise·√(V·K / Σw)) / M within [0, 1], with D, V mean and variance of l - l' under a binomial kernel whose
    squared weights sum up to K, M the mean of max(|l|, |l'|).
    Source: Schied et al. 2018 (A-SVGF), whose gradients are free of noise.

    Parameters
    ----------
    color, previous : (H, W, 3)
    noise : standard errors that do not count
    passes : number of à-trous passes
    margin : also return how many times (H, W) the subtractions multiply roundings

    Returns
    -------
    (H, W), 0 to 1
    """
    both = (color.isfinite() & previous.isfinite()).all(-1)  # (H, W)
    now, before = (luminance(image.where(both[..., None], 0)) for image in (color, previous))  # (H, W), (H, W)
    change = now - before  # (H, W)
    planes = [both.to(now), change, change**2, torch.maximum(now.abs(), before.abs())]  # 4 of (H, W)
    for i in range(passes):
        planes = [_smooth(plane, 2**i) for plane in planes]
    weight = planes[0]  # (H, W)
    mean, square, size = (plane / weight for plane in planes[1:])  # (H, W) each
    variance = (square - mean**2).clamp(min=0)  # (H, W)
    error = noise * (variance * _energy(passes) / weight).sqrt()  # (H, W)
    gradient = torch.where((weight > 0) & (size > 0), (mean.abs() - error) / size, 0).clamp(0, 1)  # (H, W)
    if not margin:
        return gradient
    lost = (square / variance).nan_to_num(0).clamp(max=1e6)  # (H, W)
    return gradient, 1 + (error * lost / size).nan_to_num(0)  # (H, W), (H, W)
