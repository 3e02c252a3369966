import torch
from torch import Tensor

from .surface import bounds


def blend_factor(
    confidence: Tensor, motion: Tensor | None = None, *, alpha=0.05, fast_alpha=0.2, speed=(0.0, 1.0)
) -> Tensor:
    """The weight of the new sample: alpha at full confidence, larger for faster motion, and 1 without confidence.

    Parameters
    ----------
    confidence : (H, W)
    motion : (H, W, 2) or (H, W, 3)
    fast_alpha : the least factor where motion is fast
    speed : pixels up to which motion is slow and from which it is fast, or one for both

    Returns
    -------
    (H, W)
    """
    sure = confidence.nan_to_num(0).clamp(0, 1)  # (H, W)
    share = torch.full_like(confidence, alpha)  # (H, W)
    if motion is None:
        return share + (1 - share) * (1 - sure)  # (H, W)
    length, (slow, fast) = motion[..., :2].norm(dim=-1), bounds(speed)  # (H, W)
    haste = (length > slow).to(share) if slow == fast else ((length - slow) / (fast - slow)).clamp(0, 1)  # (H, W)
    share = share + haste * (max(alpha, fast_alpha) - share)  # (H, W)
    moving = motion.isfinite().all(-1)  # (H, W)
    return (share + (1 - share) * (1 - sure)).where(moving, 1)  # (H, W)
