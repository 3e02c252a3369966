import torch
from torch import Tensor

BLACKMAN_HARRIS = [0.35875, 0.48829, 0.14128, 0.01168]


def resolve(samples, offsets, *, filter="blackman-harris") -> Tensor:
    """The supersampling sum of jittered samples, Σwc/Σw.

    Sources: Karis 2014 (Blackman-Harris, 3.3 pixels wide); Mitchell and Netravali 1988 (B = C = 1/3).

    Parameters
    ----------
    samples : sequence of (H, W) or (H, W, C)
    offsets : (N, 2)
    filter : "box", "tent", "blackman-harris" or "mitchell"

    Returns
    -------
    image : (H, W) or (H, W, C)
    """
    shape = samples[0].shape
    height, width = shape[:2]
    rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]  # (H, 1), (1, W)
    total = torch.zeros_like(samples[0].reshape(height, width, -1))  # (H, W, C)
    weights = torch.zeros_like(total[..., :1])  # (H, W, 1)
    for image, (ox, oy) in zip(samples, torch.as_tensor(offsets, dtype=torch.float64), strict=True):
        image = image.reshape(height, width, -1)  # (H, W, C)
        present = image.isfinite().all(-1)  # (H, W)
        for dy in range(-3, 4):
            for dx in range(-3, 4):
                weight = WEIGHTS[filter](dx + ox) * WEIGHTS[filter](dy + oy)  # ()
                y, x = (rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)  # (H, 1), (1, W)
                counts = (rows + dy == y) & (columns + dx == x) & present[y, x]  # (H, W)
                total += weight * image[y, x].where(counts[..., None], 0)  # (H, W, C)
                weights += weight * counts[..., None]  # (H, W, 1)
    return torch.where(weights > 1e-6, total / weights, torch.nan).reshape(shape)


def blackman_harris(d: Tensor) -> Tensor:
    """The window as usually written, over 0 to 1."""
    place = d / 3.3 + 0.5
    terms = [(-1) ** k * a * torch.cos(2 * torch.pi * k * place) for k, a in enumerate(BLACKMAN_HARRIS)]
    return torch.where(d.abs() < 1.65, sum(terms), 0)


def mitchell(d: Tensor, b=1 / 3, c=1 / 3) -> Tensor:
    x = d.abs()
    near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
    far = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
    return torch.where(x < 1, near, torch.where(x < 2, far, 0)) / 6


WEIGHTS = {
    "box": lambda d: ((d >= -0.5) & (d < 0.5)).double(),
    "tent": lambda d: (1 - d.abs()).clamp(min=0),
    "blackman-harris": blackman_harris,
    "mitchell": mitchell,
}
