import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .accumulate import luminance
from .similarity import shift


def blend(
    color: Tensor,
    history: Tensor,
    alpha: Tensor | float = 0.05,
    *,
    weighting="none",
    flicker=1.0,
    exposure=1.0,
    margin=False,
) -> Tensor | tuple[Tensor, Tensor]:
    """Blend a sample into its history, h + a (c - h), with a blend factor or weights that depend on the luminances.

    Sources: Karis 2014 (tone; flicker: a smaller factor where history lies on the border of the 3x3 luminances);
    Playdead 2016 (luminance: up to four times the factor, the more the two differ); our own (local-tone: by tone, but
    relative to four times the mean luminance of the 3x3 samples where that is more than the exposure).

    Parameters
    ----------
    color, history : (H, W, 3)
    alpha : a number or (H, W)
    weighting : "none", "tone", "local-tone" or "luminance"
    flicker : fraction of the factor that remains on the border, 0 to 1
    exposure : radiance that counts as 1
    margin : also return the factor (H, W) by which a narrow range of luminance multiplies roundings

    Returns
    -------
    (H, W, 3)
    """
    seen, known = color.isfinite().all(-1), history.isfinite().all(-1)  # (H, W), (H, W)
    lc, lh = luminance(color), luminance(history)  # (H, W), (H, W)
    share = torch.as_tensor(alpha).to(lc).expand_as(lc).nan_to_num(1, 1, 0).clamp(0, 1)  # (H, W)
    narrow = torch.ones_like(lc)  # (H, W)
    if flicker < 1:
        low, high = torch.full_like(lc, torch.inf), torch.full_like(lc, -torch.inf)  # (H, W), (H, W)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                low = low.minimum(shift(lc.where(seen, torch.inf), dx, dy, torch.inf))  # (H, W)
                high = high.maximum(shift(lc.where(seen, -torch.inf), dx, dy, -torch.inf))  # (H, W)
        extent = high - low  # (H, W)
        inside = torch.minimum(lh - low, high - lh) / (extent / 2)  # (H, W)
        inside = torch.where(extent == 0, 1, inside.clamp(0, 1))  # (H, W)
        keep = flicker + inside * (1 - flicker)  # (H, W)
        share = share * (keep + share * (1 - keep))  # (H, W)
        sizes = torch.maximum(high.abs(), low.abs()) / extent  # (H, W)
        narrow = torch.where(extent > 0, sizes, 1).nan_to_num(1).clamp(min=1)  # (H, W)

    if weighting == "local-tone":
        light = torch.stack([lc.clamp(0, 1e30).where(seen, 0), seen.to(lc)])  # (2, H, W)
        total, count = avg_pool2d(light, 3, 1, 1)  # (H, W), (H, W)
        exposure = (4 * total / count.clamp(min=1 / 9)).clamp(min=exposure)  # (H, W)
    if weighting in ("tone", "local-tone"):
        new, old = share / (exposure + lc.clamp(min=0)), (1 - share) / (exposure + lh.clamp(min=0))  # (H, W), (H, W)
        share = new / (new + old)  # (H, W)
    elif weighting == "luminance":
        differ = (lc - lh).abs() / torch.maximum(lc, lh).clamp(min=0.2 * exposure)  # (H, W)
        alike = (1 - differ).clamp(0, 1) ** 2  # (H, W)
        most = (4 * share).clamp(max=1)  # (H, W)
        share = most + alike * (share - most)  # (H, W)
    blended = history + share[..., None] * (color - history)  # (H, W, 3)
    one = torch.where(seen[..., None], color, history.where(known[..., None], torch.nan))  # (H, W, 3)
    result = torch.where((seen & known)[..., None], blended, one)  # (H, W, 3)
    return (result, narrow) if margin else result
