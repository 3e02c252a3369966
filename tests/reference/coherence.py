import torch
from torch import Tensor

from .demodulate import is_reflectance

SIDE = 16  # of a tile
DIFFERING = 0.4  # share of pairs of neighbours
COSINE = torch.tensor(25.0).to(torch.float64).deg2rad().cos().item()  # of the angle of like normals
FOUND = 0.1, 0.5  # confidence
DIVIDED, WHOLE = 2**32 - 2, 2**32 - 3  # ids of surfaces in incoherent tiles, by whether their light is divided


def incoherent_guides(normal: Tensor | None, ids: Tensor | None, *, confidence: Tensor | None = None) -> Tensor:
    """Mask (H, W) of the tiles in which most pairs of neighbours differ and history is hardly found."""
    height, width = (normal[..., 0] if ids is None else ids).shape
    mask = torch.zeros(height, width, dtype=torch.bool)  # (H, W)
    for y in range(0, height, SIDE):
        for x in range(0, width, SIDE):
            tile = slice(y, y + SIDE), slice(x, x + SIDE)
            differ = torch.cat([_differ(normal, ids, tile, axis).flatten() for axis in (0, 1)])  # (pairs,)
            # In the kernel's precision, as shares of few pairs are exactly two fifths.
            mask[tile] = differ.sum().float() > torch.tensor(DIFFERING) * len(differ)
            if confidence is not None:
                found = confidence[tile].mean()
                mask[tile] &= (found >= FOUND[0]) & (found < FOUND[1])
    return mask


def _differ(normal: Tensor | None, ids: Tensor | None, tile: tuple, axis: int) -> Tensor:
    """Whether the pixels of a tile differ from the next ones along an axis."""
    differ = torch.zeros(())
    if ids is not None:
        a, b = _pairs(ids[tile], axis)
        differ = a != b
    if normal is not None:
        a, b = _pairs(normal[tile], axis)
        apart = (a * b).sum(-1) < COSINE * a.norm(dim=-1) * b.norm(dim=-1)
        differ = differ.bool() | apart
    return differ


def _pairs(image: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    count = max(image.shape[axis] - 1, 0)
    return image.narrow(axis, 0, count), image.narrow(axis, image.shape[axis] - count, count)


def coherent_guides(frame, mask: Tensor) -> tuple[Tensor | None, Tensor | None]:
    """The normals (H, W, 3) and ids (H, W) of a frame, in the mask (H, W) zero and the coarse ids."""
    normal = None if frame.normal is None else frame.normal.masked_fill(mask[..., None], 0)
    ids = None if frame.ids is None else coarse_ids(frame).where(mask, frame.ids)
    return normal, ids


def coarse_ids(frame) -> Tensor:
    """Ids (H, W) that tell apart which light is divided by albedo; 0 stays."""
    divided = torch.ones_like(frame.ids, dtype=torch.bool)  # (H, W)
    if frame.albedo is not None:
        divided = is_reflectance(frame.albedo, frame.ids)  # (H, W)
    ids = torch.full_like(frame.ids, WHOLE).masked_fill(divided, DIVIDED)  # (H, W)
    return ids.where(frame.ids != 0, 0)
