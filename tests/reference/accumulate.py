from typing import NamedTuple

import torch
from torch import Tensor


class Accumulated(NamedTuple):
    color: Tensor
    moments: Tensor
    history_length: Tensor
    missing: int


def luminance(color: Tensor) -> Tensor:
    """Rec. 709 luminance (...) of linear RGB (..., 3)."""
    return color @ torch.tensor([0.2126, 0.7152, 0.0722], dtype=color.dtype, device=color.device)  # (...)


def accumulate(
    color: Tensor,
    history: Tensor,
    history_moments: Tensor,
    history_length: Tensor,
    *,
    weight: Tensor | None = None,
    gradient: Tensor | None = None,
    confidence: Tensor | None = None,
    alpha=0.05,
    moments_alpha=0.2,
    warmup=True,
) -> Accumulated:
    """Blend a sample into its history: N' = min(N + w, 1/alpha), h + w (c - h)/N', and the moments likewise.

    w is 1, or the weight of a partial sample. A gradient λ first shortens N to N (1 - λ)^10, and then moves both blend
    factors a of the sample to a + λ (1 - a); a confidence c then to a + w (1 - c)(1 - a). Sources: Schied et al.
    2017, section 4.2; the warm-up is Falcor's alpha = max(alpha, 1/N); Schied et al. 2018.

    Parameters
    ----------
    color, history : (H, W, 3)
    history_moments : (H, W, 2), means of luminance and of its square
    history_length : (H, W), number of samples
    weight : (H, W), 0 to 1, where 0 is no sample
    gradient, confidence : (H, W), 0 to 1

    Returns
    -------
    Accumulated, with the number of samples that were not finite
    """
    changed = torch.zeros_like(history_length) if gradient is None else gradient.nan_to_num(0).clamp(0, 1)  # (H, W)
    history_length = history_length * (1 - changed) ** 10  # (H, W)
    w = torch.ones_like(history_length) if weight is None else weight.nan_to_num(0).clamp(0, 1)  # (H, W)
    seen = color.isfinite().all(-1) & (w > 0)  # (H, W)
    known = history.isfinite().all(-1) & history_moments.isfinite().all(-1)  # (H, W)
    known &= history_length.isfinite() & (history_length > 0)  # (H, W)
    length = history_length.where(known, 0)  # (H, W)
    history = history.where(known[..., None], torch.nan)  # (H, W, 3)
    history_moments = history_moments.where(known[..., None], torch.nan)  # (H, W, 2)

    light = luminance(color)  # (H, W)
    moments = torch.stack([light, light * light], -1)  # (H, W, 2)
    n = (length + w).clamp(max=1 / alpha if alpha > 0 else torch.inf)  # (H, W)
    n = n.where(known, w)  # (H, W)
    a = w / n if warmup else w * alpha  # (H, W)
    am = w * (1 / n).clamp(min=moments_alpha) if warmup else w * moments_alpha  # (H, W)
    a, am = (share + changed * (1 - share) for share in (a, am))  # (H, W), (H, W)
    if confidence is not None:
        doubt = w * (1 - confidence.nan_to_num(0).clamp(0, 1))  # (H, W)
        a, am = (share + doubt * (1 - share) for share in (a, am))  # (H, W), (H, W)
    blended = history + a[..., None] * (color - history)  # (H, W, 3)
    blended_moments = history_moments + am[..., None] * (moments - history_moments)  # (H, W, 2)

    both, new = (seen & known)[..., None], (seen & ~known)[..., None]  # (H, W, 1)
    return Accumulated(
        torch.where(both, blended, torch.where(new, color, history)),  # (H, W, 3)
        torch.where(both, blended_moments, torch.where(new, moments, history_moments)),  # (H, W, 2)
        torch.where(seen, n, length),  # (H, W)
        int((~seen).sum()),
    )
