import torch
from torch import Tensor

from .accumulate import luminance
from .reproject import reproject


def correlation(one: Tensor, other: Tensor) -> float:
    """Of deviations (N,); of those below a tenth, less."""
    if len(one) == 0:
        return 0.0
    return float((one * other).sum() / ((one**2).sum() * (other**2).sum()).sqrt().clamp(min=len(one) / 100))


def difference(one: Tensor, other: Tensor) -> Tensor:
    """Of two lights, relative to them."""
    return (one - other) / (one.abs() + other.abs())


def repetition(color: Tensor, previous: Tensor, motion: Tensor, deviation: Tensor | None = None) -> tuple:
    """How much of a frame's noise is that of the frame before, at the same place of the screen.

    Parameters
    ----------
    color, previous : (H, W, 3)
    motion : (H, W, 2 or 3)
    deviation : (2 ceil(H / 8), W) of the frame before

    Returns
    -------
    repetition : float
    deviation : (2 ceil(H / 8), W)
    """
    now, before = luminance(color), luminance(previous)  # (H, W)
    carried, coverage = reproject(before, motion, fallback=False)  # (H, W) each
    every = difference(now, carried).where(coverage > 0, torch.nan)  # (H, W)
    height = len(every[::8])
    found = torch.full((2 * height, every.shape[1]), torch.nan, dtype=every.dtype)  # (2h, W)
    found[::2], found[1 : 2 * len(every[1::8]) : 2] = every[::8], every[1::8]

    own, below = now[::8][: len(now[1::8])], now[1::8]  # (h, W) each
    steps, under = (difference(rows[:, :-1], rows[:, 1:]) for rows in (own, below))  # (h, W - 1) each
    known = steps.isfinite() & under.isfinite()
    same = known & (steps.abs() > 0.1) & (now == before)[::8][: len(own), :-1]
    standing = sticking = 0.0
    if known.sum() >= 256:
        standing = float(same.sum() / known.sum()) - max(correlation(steps[known], under[known]), 0)
    if deviation is not None:
        ours, theirs = (rows[:, :-1] - rows[:, 1:] for rows in (found, deviation))  # (2h, W - 1) each
        ours, under, theirs = ours[::2], ours[1::2], theirs[::2]  # (h, W - 1) each
        down, down_before = ((rows[::2] - rows[1::2])[:, :-1] for rows in (found, deviation))  # (h, W - 1) each
        each = torch.stack([ours, under, theirs, down, down_before])  # (5, h, W - 1)
        ours, under, theirs, down, down_before = each[:, each.isfinite().all(0)]  # (N,) each
        if len(ours) >= 256:
            lasting = min(correlation(ours, theirs), correlation(down, down_before))
            sticking = lasting - max(correlation(ours, under), 0)
    return max(standing, sticking, 0.0), found


class Noise:
    """Whether the noise of a sequence's frames repeats."""

    def __init__(self):
        self.before = self.deviation = None

    def repeats(self, color: Tensor, motion: Tensor) -> bool:
        """Look at the next frame (H, W, 3); its motion (H, W, 2 or 3)."""
        before, self.before = self.before, color
        if before is None:
            return False
        share, self.deviation = repetition(color, before, motion, self.deviation)
        return share > 0.3
