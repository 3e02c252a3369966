import torch
from torch import Tensor

from .accumulate import luminance


def _beside(image: Tensor, dx: int, dy: int) -> Tensor:
    """out[y, x] = image[y + dy, x + dx] of (H, W, ...), borders replicated."""
    height, width = image.shape[:2]
    rows, columns = (torch.arange(height) + dy).clamp(0, height - 1), (torch.arange(width) + dx).clamp(0, width - 1)
    return image[rows][:, columns]


def _average(image: Tensor, weights: list[float]) -> Tensor:
    """(H, W, ...), averaged along both axes by symmetric weights, from the centre outwards."""
    for dx, dy in ((1, 0), (0, 1)):
        image = weights[0] * image + sum(
            weight * (_beside(image, k * dx, k * dy) + _beside(image, -k * dx, -k * dy))
            for k, weight in enumerate(weights[1:], 1)
        )
    return image


def _spline(t: Tensor) -> Tensor:
    """Catmull-Rom weights (4, ...) of the pixels at -1, 0, 1, 2 for a place between 0 and 1."""
    square, cube = t**2, t**3
    return torch.stack(
        [
            -0.5 * t + square - 0.5 * cube,
            1 - 2.5 * square + 1.5 * cube,
            0.5 * t + 2 * square - 1.5 * cube,
            0.5 * cube - 0.5 * square,
        ]
    )


def smooth_edges(
    color: Tensor, *, newest: Tensor | None = None, confidence: Tensor | None = None, exposure=1.0
) -> Tensor:
    """Average pixels along the direction in which the image changes least.

    Sources: Bigün and Granlund 1987 (structure tensor); Kyprianidis and Kang 2011 (smoothing by its coherence).

    Parameters
    ----------
    color : (H, W, 3)
    newest : (H, W, 3)
        Of which edges show 15 % more.
    confidence : (H, W), in [0, 1]
    exposure : radiance that counts as 1

    Returns
    -------
    (H, W, 3)
    """
    height, width = color.shape[:2]
    present = color.isfinite().all(-1)  # (H, W)
    light = luminance(color).clamp(0, torch.finfo(torch.float32).max).where(present, torch.nan)  # (H, W)
    tone = light / (light + exposure)  # (H, W)
    across = (_beside(tone, 1, 0) - _beside(tone, -1, 0)) / 2  # (H, W)
    down = (_beside(tone, 0, 1) - _beside(tone, 0, -1)) / 2  # (H, W)
    dx = across / 2 + (_beside(across, 0, 1) + _beside(across, 0, -1)) / 4  # (H, W)
    dy = down / 2 + (_beside(down, 1, 0) + _beside(down, -1, 0)) / 4  # (H, W)
    squares = torch.stack([dx * dx, dx * dy, dy * dy], -1)  # (H, W, 3)
    a, b, d = _average(squares, [20 / 64, 15 / 64, 6 / 64, 1 / 64]).unbind(-1)  # (H, W) each
    root = ((a - d) ** 2 + 4 * b**2).sqrt()  # (H, W)

    tones = torch.stack([_beside(tone, x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]).amax(0)  # (H, W)
    bright = tones / (1 - tones) / 12  # (H, W), the largest luminance in times of 12 exposures
    edge = ((a + d) / 3e-5 - 1).clamp(0, 1)  # (H, W)
    straight = ((root / (a + d)) ** 4).nan_to_num(0)  # (H, W)
    unknown = torch.zeros_like(a) if confidence is None else 0.75 * (1 - confidence.nan_to_num(0).clamp(0, 1))  # (H, W)
    share = edge * (unknown + (1 - unknown) * straight) / (1 + bright**2)  # (H, W)
    share = ((16 * share.nan_to_num(0) - 1) / 15).clamp(min=0)  # (H, W)
    slope = (-2 * b / ((a - d).abs() + root)).nan_to_num(0)  # (H, W)

    steep = a > d  # (H, W)
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")  # (H, W) each

    taps, weights = [], []  # (H, W, 3) and (H, W) each
    for step, weight in ((0, 6), (-2, 1), (-1, 4), (1, 4), (2, 1)):
        offset = step * slope  # (H, W)
        near = offset.floor()  # (H, W)
        four, range_of = [], []  # (H, W, 3) each
        for i in (-1, 0, 1, 2):
            aside = near.long() + i  # (H, W)
            row = torch.where(steep, y + step, y + aside)  # (H, W)
            column = torch.where(steep, x + aside, x + step)  # (H, W)
            row, column = row.clamp(0, height - 1), column.clamp(0, width - 1)  # (H, W) each
            old = color[row, column]  # (H, W, 3)
            mixed = (
                old if newest is None else old + (0.15 * straight * share)[..., None] * (newest[row, column] - old)
            )  # (H, W, 3)
            four.append(mixed.where(mixed.isfinite().all(-1, keepdim=True), old))
            range_of.append(old)
        four, range_of = torch.stack(four), torch.stack(range_of)  # (4, H, W, 3) each
        tap = (_spline(offset - near)[..., None] * four).sum(0)  # (H, W, 3)
        taps.append(tap.maximum(range_of.amin(0)).minimum(range_of.amax(0)))
        weights.append(torch.full_like(light, weight))
    taps, weights = torch.stack(taps), torch.stack(weights)  # (5, H, W, 3), (5, H, W)
    weights = weights / (1 + luminance(taps).clamp(min=0) / (2 * exposure))  # (5, H, W)
    mean = (weights[..., None] * taps).sum(0) / weights.sum(0)[..., None]  # (H, W, 3)
    own = taps[0]  # (H, W, 3)
    return torch.where(share[..., None] > 0, own + share[..., None] * (mean - own), color)
