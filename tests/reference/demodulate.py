import torch
from torch import Tensor

LEAST = 1 / 32  # the smallest divisor


def divisor(albedo: Tensor) -> Tensor:
    """The divisor: the albedo in [0, 1], at least 1/32; 1 where it is 0 in all channels."""
    a = albedo.where(albedo.isfinite(), 0).clamp(0, 1)  # (H, W, 3)
    return a.clamp(min=LEAST).where(a.amax(-1, keepdim=True) > 0, 1)  # (H, W, 3)


def _emitted(color: Tensor, emission: Tensor | None) -> Tensor:
    return torch.zeros_like(color) if emission is None else emission.where(emission.isfinite(), 0)  # (H, W, 3)


def demodulate(color: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Illumination (H, W, 3) = (color - emission) / divisor(albedo). Source: Falcor's SVGF pass, where bright."""
    return (color - _emitted(color, emission)) / divisor(albedo)  # (H, W, 3)


def remodulate(illumination: Tensor, albedo: Tensor, *, emission: Tensor | None = None) -> Tensor:
    """Colour (H, W, 3) = illumination · divisor(albedo) + emission: the inverse of `demodulate`."""
    return illumination * divisor(albedo) + _emitted(illumination, emission)  # (H, W, 3)
