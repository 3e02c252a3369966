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
    fetch=False,
) -> tuple[Tensor, Tensor]:
    """Blend two motion-blurred images, weighted by quality; the old image's quality falls with motion.

    With `fetch` the old image is the previous frame's, and is fetched along the motion.

    Source: Lottes 2008, "Reprojection 2".

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
    still = (along == 0).all(-1)  # (H, W)
    there = along if fetch else torch.zeros_like(along)  # (H, W, 2)
    moves = (blur > 0) & ~still  # (H, W)
    fresh = torch.where(moves[..., None], _blurred(filled, new, 0 * along, blur * along), filled)  # (H, W, 3)
    before = _blurred(reprojected, old, there, blur * along)  # (H, W, 3)
    before = torch.where((moves | fetch & ~still)[..., None], before, reprojected)  # (H, W, 3)
    if fetch:
        old = torch.where(still, old, _look(old[..., None], along)[..., 0])  # (H, W)
    old = old / (1 + along.norm(dim=-1) / fade)  # (H, W)
    part = (new / (new + old)).clamp(*share)[..., None]  # (H, W, 1)
    blended = before + part * (fresh - before)  # (H, W, 3)
    alone = fresh.where((new > 0)[..., None], torch.nan)  # (H, W, 3)
    rest = torch.where((new > 0)[..., None], blended, before)  # (H, W, 3)
    return torch.where((old > 0)[..., None], rest, alone), (new + old).clamp(max=limit)


def _known(image: Tensor, quality: Tensor) -> Tensor:
    """The quality (H, W), 0 where the colour is missing."""
    return quality.where(image.isfinite().all(-1) & quality.isfinite() & (quality > 0), 0)


def _blurred(image: Tensor, quality: Tensor, there: Tensor, step: Tensor) -> Tensor:
    """The mean of taps at an offset (H, W, 2) and a step (H, W, 2) before and after it, bilinear over known pixels."""
    known = (quality > 0).to(image)[..., None]  # (H, W, 1)
    both = torch.cat([image.where(known > 0, 0), known], -1)  # (H, W, 4)
    sums = sum(_look(both, there + side * step) for side in (0, -1, 1))  # (H, W, 4)
    return sums[..., :3] / sums[..., 3:]  # (H, W, 3)


def _look(image: Tensor, away: Tensor) -> Tensor:
    """The image (H, W, C) at an offset (H, W, 2) from each pixel centre, bilinear, 0 outside."""
    height, width = image.shape[:2]
    place = pixel_centres(height, width, image) - 0.5 + away  # (H, W, 2)
    first = place.floor()  # (H, W, 2)
    right, down = (place - first).unbind(-1)  # (H, W), (H, W)
    total = torch.zeros_like(image)  # (H, W, C)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (right if dx else 1 - right) * (down if dy else 1 - down)  # (H, W)
        x, y = first[..., 0] + dx, first[..., 1] + dy  # (H, W), (H, W)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)  # (H, W)
        tap = image[y.clamp(0, height - 1).long(), x.clamp(0, width - 1).long()]  # (H, W, C)
        total = total + (weight * inside)[..., None] * tap  # (H, W, C)
    return total
