import torch
from torch import Tensor

DARK = 0.1  # from here on albedo is divided by


def divisor(albedo: Tensor) -> Tensor:
    """What light is divided by: the albedo a in [0, 1]; below 0.1, a + (1 - a)(1 - a / 0.1)², which is 1 for black."""
    a = albedo.where(albedo.isfinite(), 0).clamp(0, 1)  # (H, W, 3)
    return a + (1 - a) * (1 - a / DARK).clamp(min=0) ** 2  # (H, W, 3)


def _emitted(color: Tensor, emission: Tensor | None) -> Tensor:
    return torch.zeros_like(color) if emission is None else emission.where(emission.isfinite(), 0)  # (H, W, 3)


def demodulate(color: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Illumination (H, W, 3) = (color - emission) / divisor(albedo). Source: Falcor's SVGF pass, where bright."""
    return (color - _emitted(color, emission)) / divisor(albedo)  # (H, W, 3)


def remodulate(illumination: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Colour (H, W, 3) = illumination · divisor(albedo) + emission: what `demodulate` took apart."""
    return illumination * divisor(albedo) + _emitted(illumination, emission)  # (H, W, 3)
