import torch
from torch import Tensor

from .neighborhood import to_space
from .similarity import shift


def alternation(
    color: Tensor, memory: Tensor | None = None, *, exposure=1.0, margin=False
) -> Tensor | tuple[Tensor, Tensor]:
    """The state of each neighbourhood: its mean, its mean before the last jump, and a count of returns.

    In tone-mapped YCoCg, with m and r the mean and the range of 3×3 pixels: a jump is |m - μ| > r in some channel, and
    max |m - μ| > max(|m|, |μ|) / 5; a return is a jump to within half its length of the mean before the last one.
    Returns count up to 3, other jumps clear the count; without a jump it loses an eighth, as does the way to m.
    Source: after the luminance instability of FSR 2.2, which looks for returns among four frames.

    Parameters
    ----------
    color : (H, W, 3)
    memory : (H, W, 7); unknown where it is not finite
    exposure : radiance that the tone curve takes for 1
    margin : also return the relative distance (H, W) of the nearest decision from its threshold

    Returns
    -------
    memory : (H, W, 7)
    """
    toned = to_space(color.where(color.isfinite().all(-1, keepdim=True), torch.nan), "tonemapped-ycocg", exposure)
    window = [shift(toned[..., c], dx, dy, torch.nan) for c in range(3) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    taps = torch.stack(window).unflatten(0, (3, 9)).movedim(0, -1)  # (9, H, W, 3)
    there = ~taps.isnan()  # (9, H, W, 3)
    mean = taps.nanmean(0)  # (H, W, 3)
    extent = taps.where(there, -torch.inf).amax(0) - taps.where(there, torch.inf).amin(0)  # (H, W, 3)
    if memory is None:
        memory = torch.full((*color.shape[:2], 7), torch.nan, dtype=color.dtype)  # (H, W, 7)
    known = memory.isfinite().all(-1, keepdim=True)  # (H, W, 1)
    last, other = memory[..., :3].where(known, mean), memory[..., 3:6].where(known, mean)  # (H, W, 3), (H, W, 3)
    count = memory[..., 6].where(known[..., 0], 0)  # (H, W)
    off = (mean - last).abs()  # (H, W, 3)
    size = torch.maximum(mean.abs(), last.abs()).amax(-1)  # (H, W)
    jumps = (off > extent).any(-1) & (off.amax(-1) > size / 5)  # (H, W)
    moved, apart = (mean - last).norm(dim=-1), (mean - other).norm(dim=-1)  # (H, W), (H, W)
    returns = apart < moved / 2  # (H, W)
    count = torch.where(jumps, torch.where(returns, (count + 1).clamp(max=3), 0), count * 7 / 8)  # (H, W)
    other = torch.where(jumps[..., None], last, other + (mean - other) / 8)  # (H, W, 3)
    new = torch.cat([mean, other, count[..., None]], -1)  # (H, W, 7)
    empty = ~there.any(0).all(-1, keepdim=True)  # (H, W, 1)
    slacks = [(off - extent).abs().amin(-1), (off.amax(-1) - size / 5).abs(), (apart - moved / 2).abs()]  # (H, W) each
    new = memory.where(empty, new)  # (H, W, 7)
    return (new, (torch.stack(slacks).amin(0) / size).nan_to_num(torch.inf)) if margin else new
