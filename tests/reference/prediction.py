import torch
from torch import Tensor

from .similarity import shift


def prediction_gain(
    candidate: Tensor, base: Tensor, color: Tensor, *, ids=None, radius=3, standardized=False
) -> Tensor:
    """The mean difference of squared errors with which a candidate and a base predict the colour.

    q = Σ_c (k - h)(k + h - 2c) / (Σ_c h² + 0.01), averaged over the pixels of (2·radius + 1)² with the centre's id. q
    is linear in c, so its noise cancels. Standardized, it is divided by √(s² / n + 0.01²), s² the sample variance over
    the window's n pixels.

    Parameters
    ----------
    candidate, base, color : (H, W, 3)
    ids : (H, W) integers

    Returns
    -------
    (H, W), negative where the candidate predicts better, 0 without valid pixels
    """
    height, width = color.shape[:2]
    present = (candidate.isfinite() & base.isfinite() & color.isfinite()).all(-1)  # (H, W)
    k, h, c = (image.where(present[..., None], 0) for image in (candidate, base, color))  # (H, W, 3) each
    q = ((k - h) * (k + h - 2 * c)).sum(-1) / ((h * h).sum(-1) + 0.01)  # (H, W)
    kind = torch.zeros_like(present, dtype=torch.int64) if ids is None else ids  # (H, W)
    total, squares, number = (torch.zeros_like(q) for _ in range(3))  # (H, W) each
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if abs(dx) < width and abs(dy) < height:
                counts = shift(present, dx, dy, False) & (shift(kind, dx, dy, -1) == kind)  # (H, W)
                total += shift(q, dx, dy, 0).where(counts, 0)  # (H, W)
                squares += shift(q, dx, dy, 0).where(counts, 0).square()  # (H, W)
                number += counts  # (H, W)
    mean = total / number  # (H, W)
    if not standardized:
        return torch.where(number > 0, mean, 0)  # (H, W)
    variance = (squares - mean * total).clamp(min=0) / (number - 1)  # (H, W)
    t = mean / (variance / number + 0.01**2).sqrt()  # (H, W)
    return torch.where(number > 1, t, 0)  # (H, W)
