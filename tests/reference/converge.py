import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from .accumulate import luminance
from .choice import TILE, levels


def converge(
    color: Tensor,
    mean: Tensor,
    moments: Tensor,
    history_length: Tensor,
    *,
    exposure: float = 1.0,
    strictness: float = 1.0,
) -> Tensor:
    """The mean of a still scene's samples in its denoised image: O + s r l, r = (M - O)/l, l = max(O, 0) + e/16.

    The share s = max(0, 1 - c v/d) is James and Stein's, of tiles: v is the mean of (m2 - m1²)/(N - 1) · (1 + 4/N)/l²,
    the variance of r, and d the mean square of the luminance of r.

    Parameters
    ----------
    color, mean : (H, W, 3)
    moments : (H, W, 2), means of luminance and of its square
    history_length : (H, W), number of samples
    exposure : float
    strictness : float, c

    Returns
    -------
    (H, W, 3); the colour itself with fewer than eight samples, or where something is not finite
    """
    size = history_length.shape
    light = luminance(color).clamp(min=0) + exposure / 16  # (H, W)
    relative = (mean - color) / light[..., None]  # (H, W, 3)
    first, second = moments.unbind(-1)  # (H, W) twice
    variance = (second - first**2).clamp(min=0) / (history_length - 1).clamp(min=1) * (1 + 4 / history_length)  # (H, W)
    variance = variance / light**2  # (H, W)
    finite = (relative.sum(-1) + variance + moments.sum(-1) + history_length).isfinite()  # (H, W)
    known = (history_length >= 8) & finite  # (H, W)
    relative, variance = relative.where(known[..., None], 0), variance.where(known, 0)
    noise, square = _sums(torch.stack([variance, luminance(relative) ** 2], -1)).unbind(-1)  # (h, w) twice
    share = (1 - strictness * noise / square).nan_to_num(0, neginf=0).clamp(min=0)  # (h, w)
    return color + (levels(share, size) * light)[..., None].where(known[..., None], 0) * relative


def _sums(image: Tensor) -> Tensor:
    """Sums over tiles: (H, W, C) to (h, w, C)."""
    below, right = (-side % TILE for side in image.shape[:2])
    padded = pad(image.movedim(-1, 0), (0, right, 0, below))  # (C, 8h, 8w)
    return avg_pool2d(padded, TILE, divisor_override=1).movedim(0, -1)
