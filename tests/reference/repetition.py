import torch
from torch import Tensor

from .accumulate import luminance
from .reproject import reproject


def repetition(color: Tensor, previous: Tensor, motion: Tensor, deviation: Tensor | None = None) -> tuple:
    """How much of a frame's noise is that of the frame before, at the same place of the screen.

    Parameters
    ----------
    color, previous : (H, W, 3)
    motion : (H, W, 2 or 3)
    deviation : (ceil(H / 8), W) of the frame before

    Returns
    -------
    repetition : float
    deviation : (ceil(H / 8), W)
    """
    now, before = luminance(color), luminance(previous)  # (H, W)
    carried, coverage = reproject(before, motion, fallback=False)  # (H, W) each
    found = ((now - carried) / (now.abs() + carried.abs())).where(coverage > 0, torch.nan)[::8]  # (h, W)
    one, next_one = now[::8, :-1], now[::8, 1:]  # (h, W - 1) each
    light = one.abs() + next_one.abs()  # (h, W - 1)
    rough = (one - next_one).abs() > 0.1 * light  # (h, W - 1)
    pairs = light.isfinite().sum()
    same = (rough & (now == before)[::8, :-1] & light.isfinite()).sum()
    share = float(same / pairs) if pairs >= 256 else 0.0
    if deviation is not None:
        ours, theirs = (each[:, :-1] - each[:, 1:] for each in (found, deviation))  # (h, W - 1) each
        both = ours.isfinite() & theirs.isfinite()
        ours, theirs = ours[both], theirs[both]
        if len(ours) >= 256:
            least = len(ours) / 100
            sticks = (ours * theirs).sum() / ((ours**2).sum() * (theirs**2).sum()).sqrt().clamp(min=least)
            share = max(share, float(sticks))
    return share, found


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
