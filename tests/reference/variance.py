import torch
from torch import Tensor

from .similarity import CUT, Similarity, shift


def estimate_variance(
    moments: Tensor, history_length: Tensor, *, min_length=3.5, radius=3, margin=False, **similarity
) -> Tensor:
    """The variance of the luminance: temporal where the history is long enough, else over similar neighbours.

    m2 - m1², of the pixel's own moments or of their weighted means over (2·radius + 1)², the latter times
    max(min_length / max(N, 1), 1). Source: Schied et al. 2017, section 4.2.

    Parameters
    ----------
    moments : (H, W, 2)
    history_length : (H, W)
    margin : also return the sum of the weights (H, W), infinite where the pixel's own moments suffice
    **similarity : depth, normal, ids and their sigmas, see `similarity.Similarity`

    Returns
    -------
    (H, W)
    """
    finite = moments.isfinite().all(-1)  # (H, W)
    clean = moments.where(finite[..., None], 0)  # (H, W, 2)
    alike = Similarity(moments, **similarity)
    total = torch.zeros_like(moments)  # (H, W, 2)
    weights = torch.zeros_like(history_length)  # (H, W)
    height, width = history_length.shape
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if abs(dx) >= width or abs(dy) >= height:
                continue
            exponent, same = alike(dx, dy, radius)  # (H, W)
            counts = same & shift(finite, dx, dy, False)  # (H, W)
            weight = torch.exp(-exponent).where(counts, 0)  # (H, W)
            weight = weight.where(weight >= CUT, 0)  # (H, W)
            total += weight[..., None] * shift(clean, dx, dy, 0)  # (H, W, 2)
            weights += weight  # (H, W)
    mean = torch.where(weights[..., None] > 0, total / weights[..., None], 0)  # (H, W, 2)
    long = (history_length >= min_length) & finite  # (H, W)
    young = (min_length / history_length.clamp(min=1)).clamp(min=1)  # (H, W)
    spatial = (mean[..., 1] - mean[..., 0] ** 2).clamp(min=0) * young  # (H, W)
    temporal = (clean[..., 1] - clean[..., 0] ** 2).clamp(min=0)  # (H, W)
    variance = torch.where(long, temporal, spatial)  # (H, W)
    variance = variance.where(variance >= 1e-30, 0)  # (H, W)
    return (variance, weights.where(~long, torch.inf)) if margin else variance
