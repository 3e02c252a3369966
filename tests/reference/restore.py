import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .accumulate import luminance


def restore_detail(smooth: Tensor, noisy: Tensor, variance: Tensor, *, strictness=1.0, radius=1) -> Tensor:
    """The detail of a noisy image, as far as it exceeds the noise: the local Wiener filter.

    s + max(0, 1 - strictness·mean(variance) / mean((l_y - l_s)²)) (y - s), means over (2·radius + 1)². Source: Lee
    1980, Digital Image Enhancement and Noise Filtering by Use of Local Statistics.

    Parameters
    ----------
    smooth : (H, W, 3)
    noisy : (H, W, 3)
    variance : (H, W)

    Returns
    -------
    (H, W, 3)
    """
    known = torch.cat([smooth, noisy], -1).isfinite().all(-1) & variance.isfinite() & (variance >= 0)  # (H, W)
    squares = (luminance(noisy) - luminance(smooth)) ** 2  # (H, W)
    both = torch.stack([squares, variance]).where(known, 0)  # (2, H, W)
    squares, noise = avg_pool2d(both, 2 * radius + 1, 1, radius)  # (H, W), (H, W)
    gain = (1 - strictness * noise / squares.clamp(min=1e-300)).clamp(min=0).where(known, 0)  # (H, W)
    return smooth + gain[..., None] * (noisy - smooth).where(known[..., None], 0)
