import torch
from torch import Tensor

SIDE = 16  # of a tile
DIFFERING = 0.4  # share of pairs of neighbours
COSINE = torch.tensor(25.0).to(torch.float64).deg2rad().cos().item()  # of the angle of like normals
FOUND = 0.1, 0.5  # confidence
MIXED = 2**32 - 2  # the id of all surfaces in incoherent tiles


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


def coherent_guides(normal: Tensor | None, ids: Tensor | None, mask: Tensor) -> tuple[Tensor | None, Tensor | None]:
    """Normals (H, W, 3) and ids (H, W), in the mask (H, W) zero, and the same but for the sky's 0."""
    normal = None if normal is None else normal.masked_fill(mask[..., None], 0)
    ids = None if ids is None else ids.masked_fill(mask & (ids != 0), MIXED)
    return normal, ids
