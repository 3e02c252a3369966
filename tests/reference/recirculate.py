import torch
from torch import Tensor

from .projection import pixel_centres


def recirculate(
    filled: Tensor,
    filled_quality: Tensor,
    reprojected: Tensor,
    reprojected_quality: Tensor,
    motion: Tensor,
    *,
    blur=0.25,
    share=(0.0, 1.0),
    fade=64.0,
    limit=8.0,
) -> tuple[Tensor, Tensor]:
    """Blend two motion-blurred images by their share of quality, of which the old one's falls with motion.

    Source: "Reprojection 2", a developer's diary of 2008.

    Parameters
    ----------
    filled, reprojected : (H, W, 3)
    filled_quality, reprojected_quality : (H, W)
    motion : (H, W, 2) or (H, W, 3)

    Returns
    -------
    (H, W, 3), (H, W)
    """
    along = motion[..., :2]  # (H, W, 2)
    along = along.where((along.abs() < 1e6).all(-1, keepdim=True), 0)  # (H, W, 2)
    new, old = _known(filled, filled_quality), _known(reprojected, reprojected_quality)  # (H, W), (H, W)
    fresh, before = (
        _blurred(image, good, blur * along) for image, good in ((filled, new), (reprojected, old))
    )  # (H, W, 3), (H, W, 3)
    old = old / (1 + along.norm(dim=-1) / fade)  # (H, W)
    part = (new / (new + old)).clamp(*share)[..., None]  # (H, W, 1)
    blended = before + part * (fresh - before)  # (H, W, 3)
    alone = fresh.where((new > 0)[..., None], torch.nan)  # (H, W, 3)
    rest = torch.where((new > 0)[..., None], blended, before)  # (H, W, 3)
    return torch.where((old > 0)[..., None], rest, alone), (new + old).clamp(max=limit)


def _known(image: Tensor, quality: Tensor) -> Tensor:
    """The quality (H, W), 0 where there is nothing."""
    return quality.where(image.isfinite().all(-1) & quality.isfinite() & (quality > 0), 0)


def _blurred(image: Tensor, quality: Tensor, step: Tensor) -> Tensor:
    """The mean at a step back, in place and a step on (H, W, 2), bilinear among what is known."""
    height, width = quality.shape
    known = (quality > 0).to(image)[..., None]  # (H, W, 1)
    both = torch.cat([image.where(known > 0, 0), known], -1)  # (H, W, 4)
    sums = both.clone()  # (H, W, 4)
    for side in (-1, 1):
        place = pixel_centres(height, width, image) - 0.5 + side * step  # (H, W, 2)
        first = place.floor()  # (H, W, 2)
        right, down = (place - first).unbind(-1)  # (H, W), (H, W)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = (right if dx else 1 - right) * (down if dy else 1 - down)  # (H, W)
            x, y = first[..., 0] + dx, first[..., 1] + dy  # (H, W), (H, W)
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)  # (H, W)
            tap = both[y.clamp(0, height - 1).long(), x.clamp(0, width - 1).long()]  # (H, W, 4)
            sums = sums + (weight * inside)[..., None] * tap  # (H, W, 4)
    mean = sums[..., :3] / sums[..., 3:]  # (H, W, 3)
    still = (step == 0).all(-1, keepdim=True)  # (H, W, 1)
    return torch.where(still, image, mean)  # (H, W, 3)
