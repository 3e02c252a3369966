import numpy as np
import torch
from torch import Tensor


def dilate_motion(
    motion: Tensor, depth: Tensor | None = None, *, still=None, choose="nearest", window="3x3", margin=0.0
) -> Tensor:
    """The motion of the nearest surface, or the longest, among a pixel and its neighbours.

    Source: Karis 2014, High Quality Temporal Supersampling.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3)
    depth : (H, W)
    still : (H, W, 2) or (H, W, 3), the motion that the camera causes: neighbours that move by themselves do not count
    choose : "nearest" or "longest"
    window : "3x3" or "cross"
    margin : how much nearer than the pixel a neighbour must be, or how much longer its motion; relative

    Returns
    -------
    motion : like motion
    """
    known = motion.isfinite().all(-1)  # (H, W)
    if choose == "nearest":
        rank = torch.where(depth > 0, depth, torch.inf)  # (H, W)
    else:
        rank = -(motion[..., 0].float() ** 2 + motion[..., 1].float() ** 2)  # (H, W), rounded as it decides
    counts = torch.ones_like(known)  # (H, W)
    if still is not None:
        apart = (motion[..., :2] - still[..., :2]).float()  # (H, W, 2), rounded as it decides
        counts = apart[..., 0] ** 2 + apart[..., 1] ** 2 <= 0.25  # (H, W)
    offsets = [(0, 0)] + [(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if window == "3x3" or dx == 0 or dy == 0]
    height, width = known.shape
    rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]  # (H, 1), (1, W)
    rest = torch.tensor(1 - np.float32(margin), dtype=torch.float32)
    own = rank.float() * (rest if choose == "nearest" else 1 / (rest * rest))  # (H, W), rounded as it decides
    best, best_rank, best_known = motion, own, known  # (H, W, 2|3), (H, W), (H, W)
    for dx, dy in offsets:
        y, x = (rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)  # (H, 1), (1, W)
        inside = (rows + dy == y) & (columns + dx == x)  # (H, W)
        offered = torch.where(counts[y, x] | ((dx, dy) == (0, 0)), rank[y, x], torch.inf)  # (H, W)
        better = inside & known[y, x] & (~best_known | (offered < best_rank))  # (H, W)
        best = torch.where(better[..., None], motion[y, x], best)  # (H, W, 2|3)
        best_rank, best_known = torch.where(better, offered, best_rank), best_known | better  # (H, W)
    return best
