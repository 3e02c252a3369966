import torch
from torch import Tensor

from .dilate import dilate_motion
from .similarity import shift


def disocclusion(depth: Tensor, motion: Tensor, *, separation=0.05, margin=False) -> Tensor | tuple[Tensor, Tensor]:
    """The fraction of each pixel's history that something nearer hid: previous depths are scattered, the nearest stay.

    Each pixel is the nearest surface of its 3x3. Source: FSR 2's depth clip; Akeley and Su 2006 for the separation.

    Parameters
    ----------
    depth : (H, W)
    motion : (H, W, 2) or (H, W, 3)
    separation : fraction of the depth
    margin : also return the relative distance (H, W) of the nearest decision from its threshold

    Returns
    -------
    share : (H, W)
    """
    height, width = depth.shape
    known = motion.isfinite().all(-1)  # (H, W)
    far = torch.where((depth > 0) & known, depth, torch.inf)  # (H, W)
    near = torch.stack([shift(far, dx, dy, torch.inf) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]).amin(0)  # (H, W)
    moved = dilate_motion(motion, depth)  # (H, W, 2|3)
    moves = moved.isfinite().all(-1)  # (H, W)
    z = (near + moved[..., 2] if motion.shape[-1] == 3 else near).clamp(min=0)  # (H, W)
    rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]  # (H, 1), (1, W)
    # In single precision, as rounding decides.
    x = (moved[..., 0].float() + columns).nan_to_num(-9, -9, -9)  # (H, W)
    y = (moved[..., 1].float() + rows).nan_to_num(-9, -9, -9)  # (H, W)
    left, top = x.floor(), y.floor()  # (H, W), (H, W)
    taps = []
    for dx in (0, 1):
        for dy in (0, 1):
            across, down = left + dx, top + dy  # (H, W), (H, W)
            inside = (across >= 0) & (across < width) & (down >= 0) & (down < height) & moves  # (H, W)
            weight = (1 - (x - across).abs()) * (1 - (y - down).abs())  # (H, W)
            at = torch.where(inside, down * width + across, 0).long()  # (H, W)
            taps.append((at, weight.where(inside, 0).to(depth.dtype)))
    scattered = torch.full((height * width,), torch.inf, dtype=depth.dtype)  # (P,)
    for at, weight in taps:
        hits = weight > 0.01  # (H, W)
        scattered.scatter_reduce_(0, at[hits], z[hits], "amin")
    hidden, total = torch.zeros_like(z), torch.zeros_like(z)  # (H, W), (H, W)
    slack = torch.full_like(z, torch.inf)  # (H, W)
    for at, weight in taps:
        there, limit = scattered[at], (1 - separation) * z  # (H, W), (H, W)
        hidden += weight * (there < limit)  # (H, W)
        total += weight  # (H, W)
        differs = ((there - limit) / limit).abs().nan_to_num(torch.inf, torch.inf)  # (H, W)
        slack = slack.minimum(differs.where(weight > 0, torch.inf))  # (H, W)
        slack = slack.minimum((weight - 0.01).abs().where(weight > 0, torch.inf))  # (H, W)
    share = torch.where(total > 0, hidden / total, 1)  # (H, W)
    return (share, slack) if margin else share
