import torch
from torch import Tensor

from .accumulate import luminance
from .similarity import shift


def suppress_fireflies(
    color: Tensor, *, threshold=2.0, radius=4, redistribute=True, margin=False
) -> tuple[Tensor, ...]:
    """Cut luminance to mean + threshold·σ of the ring around each pixel, and give the excess to the darker ones there.

    limit = (mean + threshold·σ)·1.00001, of the present pixels of the window except its centre, at least two of them.
    A firefly's excess goes to the pixels of its window in proportion to their headroom, and no further: what they lack
    to the limits of the image that is left when the excess is gone.
    Source: the limit is that of NRD's anti-firefly.

    Parameters
    ----------
    color : (H, W, 3)
    threshold : standard deviations
    radius : half the window, which has (2·radius + 1)² pixels
    margin : also return the size (H, W) of what the limits of all who may give here are rounded to

    Returns
    -------
    color : (H, W, 3)
    removed : (H, W), luminance that found no place
    """
    height, width = color.shape[:2]
    present = color.isfinite().all(-1)  # (H, W)
    clean = color.where(present[..., None], 0)  # (H, W, 3)
    light = luminance(clean)  # (H, W)
    taps = [(dx, dy) for dy in range(-radius, radius + 1) for dx in range(-radius, radius + 1)]
    taps = [(dx, dy) for dx, dy in taps if abs(dx) < width and abs(dy) < height]

    def window(image: Tensor, *, centre=True) -> Tensor:
        around = (shift(image, dx, dy, 0) for dx, dy in taps if centre or (dx, dy) != (0, 0))
        return sum(around, torch.zeros_like(image))  # (H, W, ...)

    number = window(present.to(light), centre=False)  # (H, W)

    def limits(light: Tensor) -> tuple[Tensor, ...]:
        mean, square = (window(image, centre=False) / number for image in (light, light**2))  # (H, W), (H, W)
        deviation = (square - mean**2).clamp(min=0).sqrt()  # (H, W)
        return (mean + threshold * deviation) * 1.00001, square, deviation  # (H, W) each

    limit, square, deviation = limits(light)  # (H, W)
    limited = present & (number >= 2)  # (H, W)
    excess = (light - limit).clamp(min=0).where(limited & (light > 0), 0)  # (H, W)
    kept = torch.where((excess > 0)[..., None], color * ((light - excess) / light)[..., None], color)  # (H, W, 3)
    # A deviation is as precise as the squares it is the difference of.
    rounded = square.sqrt() + threshold * (square / deviation.clamp(min=1e-3 * square.sqrt())).nan_to_num(0)  # (H, W)
    reach = 6 * radius + 1  # a limit changes a headroom, the headroom a share, the share a gift
    size = light.abs().maximum(rounded.nan_to_num(0))[None]  # (1, H, W)
    size = torch.nn.functional.max_pool2d(size, reach, stride=1, padding=reach // 2)[0]  # (H, W)
    if not redistribute:
        return (kept, excess, size) if margin else (kept, excess)
    left = light - excess  # (H, W)
    room = (limits(left)[0] - left).clamp(min=0).where(limited, 0)  # (H, W)
    total = window(room)  # (H, W)
    given = excess.minimum(total)  # (H, W)
    share = torch.where(given > 0, given / (light * total), 0)  # (H, W)
    gift = room[..., None] * window(clean * share[..., None])  # (H, W, 3)
    return (kept + gift, excess - given, size) if margin else (kept + gift, excess - given)
