import torch
from torch import Tensor


def depth_change(depth: Tensor, previous_depth: Tensor, motion: Tensor) -> float:
    """By how much the previous depth of most surfaces exceeds that of this frame, if they share a change; else 0.

    Parameters
    ----------
    depth, previous_depth : (H, W)
    motion : (H, W, 2|3)
    """
    height, width = depth.shape
    y, x = torch.meshgrid(torch.arange(height)[4::8], torch.arange(width)[4::8], indexing="ij")  # (H/8, W/8) each
    column, row = ((at + motion[y, x, axis] + 0.5).floor() for axis, at in enumerate((x, y)))  # (H/8, W/8) each
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)  # (H/8, W/8)
    now = depth[y, x][inside]  # (N,)
    before = previous_depth[row[inside].long(), column[inside].long()]  # (N,)
    finite = now.isfinite() & before.isfinite() & (now > 0) & (before > 0)  # (N,)
    now, before = now[finite], before[finite]  # (M,), (M,)
    if len(now) < 16:
        return 0.0
    median, middle = ((values.sort().values[len(values) // 2]) for values in (before - now, now))
    rejected, left = (((before - now - d).abs() > 0.1 * (now + d)).sum() for d in (0, median))
    return median.item() if 2 * left < rejected and abs(median) < 0.25 * middle else 0.0
