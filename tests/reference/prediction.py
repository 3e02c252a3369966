import torch
from torch import Tensor

from .similarity import shift


def prediction_gain(candidate: Tensor, base: Tensor, color: Tensor, *, ids=None, radius=3) -> Tensor:
    """How much worse a candidate predicts the colour than a base does: the mean difference of their squared errors.

    q = Σ_c (k - h)(k + h - 2c) / (Σ_c h² + 0.01), the mean over (2·radius + 1)² of what has the centre's id.
    It is linear in c, whose noise cancels.

    Parameters
    ----------
    candidate, base, color : (H, W, 3)
    ids : (H, W) integers

    Returns
    -------
    (H, W), negative where the candidate predicts better, 0 where there is nothing to tell it by
    """
    height, width = color.shape[:2]
    present = (candidate.isfinite() & base.isfinite() & color.isfinite()).all(-1)  # (H, W)
    k, h, c = (image.where(present[..., None], 0) for image in (candidate, base, color))  # (H, W, 3) each
    q = ((k - h) * (k + h - 2 * c)).sum(-1) / ((h * h).sum(-1) + 0.01)  # (H, W)
    kind = torch.zeros_like(present, dtype=torch.int64) if ids is None else ids  # (H, W)
    total, number = torch.zeros_like(q), torch.zeros_like(q)  # (H, W), (H, W)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if abs(dx) < width and abs(dy) < height:
                counts = shift(present, dx, dy, False) & (shift(kind, dx, dy, -1) == kind)  # (H, W)
                total += shift(q, dx, dy, 0).where(counts, 0)  # (H, W)
                number += counts  # (H, W)
    return torch.where(number > 0, total / number, 0)  # (H, W)
