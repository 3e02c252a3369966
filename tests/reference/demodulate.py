import torch
from torch import Tensor

FLOOR = 2.0**-10  # an albedo below this counts as this: what is black cannot be divided by


def _floor(albedo: Tensor) -> Tensor:
    return albedo.where(albedo.isfinite(), 0).clamp(min=FLOOR)  # (H, W, 3)


def _emitted(color: Tensor, emission: Tensor | None) -> Tensor:
    return torch.zeros_like(color) if emission is None else emission.where(emission.isfinite(), 0)  # (H, W, 3)


def demodulate(color: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Illumination (H, W, 3) = (color - emission) / max(albedo, 2⁻¹⁰). Source: Falcor's SVGF pass."""
    return (color - _emitted(color, emission)) / _floor(albedo)  # (H, W, 3)


def remodulate(illumination: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Colour (H, W, 3) = illumination · max(albedo, 2⁻¹⁰) + emission: what `demodulate` took apart."""
    return illumination * _floor(albedo) + _emitted(illumination, emission)  # (H, W, 3)
