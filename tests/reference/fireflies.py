import torch
from torch import Tensor

from .accumulate import luminance
from .similarity import CUT, Similarity, shift


def suppress_fireflies(
    color: Tensor, *, expected=None, threshold=2.0, radius=4, redistribute=True, margin=False, **similarity
) -> tuple[Tensor, ...]:
    """Cut luminance to a limit from surrounding pixels of the same surface, and spread the excess over them.

    limit = max(mean + threshold·σ, (1 + threshold)·expected luminance)·1.00001, with the weighted mean and deviation of
    the window except its centre, whose weights add up to 2 at least. The excess is distributed over the window, the
    centre included, in proportion to the weights. Source: the first part of the limit is that of NRD's anti-firefly.

    Parameters
    ----------
    color : (H, W, 3)
    expected : (H, W, 3), the history's colour
    threshold : standard deviations
    radius : half the window, which has (2·radius + 1)² pixels
    margin : also return the magnitude (H, W) by which the limits of all pixels that may give light here are rounded
    **similarity : depth, normal, ids and their sigmas, see `similarity.Similarity`

    Returns
    -------
    color : (H, W, 3)
    removed : (H, W), the excess
    """
    present = color.isfinite().all(-1)  # (H, W)
    clean = color.where(present[..., None], 0)  # (H, W, 3)
    light = luminance(clean)  # (H, W)
    alike = Similarity(color, **similarity)
    taps = [(dx, dy) for dy in range(-radius, radius + 1) for dx in range(-radius, radius + 1)]

    def weight(dx: int, dy: int) -> Tensor:
        exponent, same = alike(dx, dy, radius)  # (H, W)
        weight = torch.exp(-exponent) * torch.ones_like(light)  # (H, W)
        return weight.where(same & (weight >= CUT), 0)  # (H, W)

    count, first, second = (torch.zeros_like(light) for _ in range(3))  # (H, W) each
    for dx, dy in taps:
        if (dx, dy) != (0, 0):
            w, there = weight(dx, dy) * shift(present, dx, dy, False), shift(light, dx, dy, 0)  # (H, W), (H, W)
            count, first, second = count + w, first + w * there, second + w * there**2  # (H, W) each
    mean, square = first / count, second / count  # (H, W), (H, W)
    deviation = (square - mean**2).clamp(min=0).sqrt()  # (H, W)
    predicted = torch.zeros_like(light)  # (H, W)
    if expected is not None:
        known = expected.isfinite().all(-1)  # (H, W)
        predicted = luminance(expected.where(known[..., None], 0))  # (H, W)
    limit = (mean + threshold * deviation).maximum((1 + threshold) * predicted)  # (H, W)
    limited = present & (count >= 2) & (light > 0)  # (H, W)
    excess = (light - limit * 1.00001).clamp(min=0).where(limited, 0)  # (H, W)
    share = (excess / light).where(excess > 0, 0)  # (H, W)
    held = clean * (1 - share)[..., None]  # (H, W, 3)
    # A deviation is a difference of squares, and only as precise as they are.
    rounded = square.sqrt() + threshold * (square / deviation.clamp(min=1e-3 * square.sqrt())).nan_to_num(0)  # (H, W)
    reach = 2 * radius + 1  # a limit changes the light that the window receives
    size = light.abs().maximum(rounded.nan_to_num(0))[None]  # (1, H, W)
    size = torch.nn.functional.max_pool2d(size, reach, stride=1, padding=radius)[0]  # (H, W)
    if redistribute:
        gift = clean * (share / (count + 1))[..., None]  # (H, W, 3)
        for dx, dy in taps:
            held = held + weight(dx, dy)[..., None] * shift(gift, dx, dy, 0)  # (H, W, 3)
    held = held.where(present[..., None], color)  # (H, W, 3)
    return (held, excess, size) if margin else (held, excess)
