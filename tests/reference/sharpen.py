import torch
from torch import Tensor

from .similarity import shift


def sharpen(color: Tensor, *, strength=0.5, exposure=1.0) -> Tensor:
    """The pixel minus a fraction of its four neighbours, clamped to the range of all five.

    Source: AMD's FSR 1 (RCAS); tone-mapped as in Lottes 2016.

    Parameters
    ----------
    color : (H, W, 3)
    strength : 0 to 1
    exposure : radiance that counts as 1

    Returns
    -------
    (H, W, 3)
    """
    seen = color.isfinite().all(-1, keepdim=True)  # (H, W, 1)
    steps = [(0, -1), (-1, 0), (1, 0), (0, 1)]
    around = []
    for dx, dy in steps:
        there = shift(color, dx, dy, torch.nan)  # (H, W, 3)
        around.append(torch.where(there.isfinite().all(-1, keepdim=True), there, color))
    tone = [c / (exposure + c.amax(-1, keepdim=True).clamp(min=0)) for c in (color, *around)]  # each (H, W, 3)
    own, four = tone[0], torch.stack(tone[1:])  # (H, W, 3), (4, H, W, 3)
    low, high = four.amin(0), four.amax(0)  # (H, W, 3), (H, W, 3)
    down = torch.where(high > 0, -low.clamp(min=0) / (4 * high), 0)  # (H, W, 3)
    up = (1 - high) / (4 * low - 4)  # (H, W, 3)
    lobe = strength * down.maximum(up).amax(-1, keepdim=True).clamp(-3 / 16, 0)  # (H, W, 1)
    sharp = (own + lobe * four.sum(0)) / (1 + 4 * lobe)  # (H, W, 3)
    sharp = sharp.maximum(low.minimum(own)).minimum(high.maximum(own))  # (H, W, 3)
    back = exposure * sharp / (1 - sharp.amax(-1, keepdim=True).clamp(min=0))  # (H, W, 3)
    return torch.where(seen & (lobe < 0), back, color)
