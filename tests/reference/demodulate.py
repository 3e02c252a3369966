import torch
from torch import Tensor

LEAST, BLACK = 1 / 64, 1 / 512  # the least albedo that is divided by, and where taking colour as it is begins


def divisor(albedo: Tensor) -> Tensor:
    """What light is divided by: m + (1 - m)(1 - 512 a)²₊ with m = max(a, 1/64), the albedo a in [0, 1]; 1 for black."""
    a = albedo.where(albedo.isfinite(), 0).clamp(0, 1)  # (H, W, 3)
    m = a.clamp(min=LEAST)  # (H, W, 3)
    return m + (1 - m) * (1 - a / BLACK).clamp(min=0) ** 2  # (H, W, 3)


def _emitted(color: Tensor, emission: Tensor | None) -> Tensor:
    return torch.zeros_like(color) if emission is None else emission.where(emission.isfinite(), 0)  # (H, W, 3)


def demodulate(color: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Illumination (H, W, 3) = (color - emission) / divisor(albedo). Source: Falcor's SVGF pass, where bright."""
    return (color - _emitted(color, emission)) / divisor(albedo)  # (H, W, 3)


def remodulate(illumination: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Colour (H, W, 3) = illumination · divisor(albedo) + emission: what `demodulate` took apart."""
    return illumination * divisor(albedo) + _emitted(illumination, emission)  # (H, W, 3)
