import math

import torch
from torch import Tensor

from .accumulate import luminance


def light_change(color: Tensor, history: Tensor, coverage: Tensor | None = None) -> float:
    """The factor by which all light has changed, if it is one factor; else 1.

    Parameters
    ----------
    color, history : (H, W, 3)
    coverage : (H, W)
    """
    height, width = color.shape[:2]
    known = (color.isfinite() & history.isfinite()).all(-1)  # (H, W)
    if coverage is not None:
        known &= coverage > 0.9
    step = height // 128 | 1
    changes = []
    for down in range(8):
        for across in range(8):
            rows = [y for y in range(0, height, step) if y * 8 // height == down]
            columns = [x for x in range(width) if x * 8 // width == across]
            there = known[rows][:, columns]  # (h, w)
            sums = [luminance(image[rows][:, columns])[there].double().sum() for image in (color, history)]
            if there.sum() >= len(range(0, height, step)) * width / 64 / 16 and min(sums) > 0:
                changes.append(sums[0].log() - sums[1].log())
    if len(changes) < 16:
        return 1.0
    logs = torch.stack(changes)  # (N,)
    middle = logs.quantile(0.5)
    spread = (logs - middle).abs().quantile(0.75)
    is_one = 1.25 * spread < abs(middle) < math.log(1e6) and spread < 0.15
    return math.exp(middle) if is_one else 1.0
