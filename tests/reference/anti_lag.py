import torch
from torch import Tensor

from .accumulate import luminance


def anti_lag(history_length: Tensor, history: Tensor, clipped: Tensor, *, strength=1.0) -> Tensor:
    """Shorten histories by how far clipping moved them: N / (1 + strength·d·N), d = |l - l'| / max(|l|, |l'|).

    Source: NRD's anti-lag, which compares a slow history with a fast one.

    Parameters
    ----------
    history_length : (H, W)
    history, clipped : (H, W, 3)

    Returns
    -------
    (H, W)
    """
    before, after = luminance(history), luminance(clipped)  # (H, W), (H, W)
    most = torch.maximum(before.abs(), after.abs())  # (H, W)
    both = (history.isfinite() & clipped.isfinite()).all(-1) & (most > 0)  # (H, W)
    moved = torch.where(both, (before - after).abs() / most, 0)  # (H, W)
    return history_length / (1 + strength * moved * history_length)  # (H, W)
