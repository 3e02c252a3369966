import torch
from torch import Tensor


def invert_motion(motion: Tensor, depth: Tensor | None = None, *, still: Tensor | None = None) -> Tensor:
    """Motion to the next frame: its pixels are scattered to their previous places, the nearest stay, cracks are closed.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3), of the next frame
    depth : (H, W), of the next frame
    still : like motion, to the next frame

    Returns
    -------
    motion : like motion
    """
    height, width, channels = motion.shape
    rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]  # (H, 1), (1, W)
    # In single precision, as rounding decides.
    motion = motion.float()  # (H, W, 2|3)
    x, y = columns + motion[..., 0], rows + motion[..., 1]  # (H, W), (H, W)
    z = torch.ones(height, width) if depth is None else torch.where(depth > 0, depth, torch.nan).float()  # (H, W)
    z = z + motion[..., 2] if channels == 3 and depth is not None else z  # (H, W)
    column, row = (x + 0.5).floor(), (y + 0.5).floor()  # (H, W), (H, W)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (z > 0)  # (H, W)
    # Sorted by depth, then by position in the image.
    order = torch.argsort(torch.where(inside, z, torch.inf).flatten(), stable=True)  # (P,)
    order = order[inside.flatten()[order]]  # (N,)
    target = (row * width + column).flatten()[order].long()  # (N,)
    nothing = height * width
    first = torch.full((height * width,), nothing).scatter_reduce(0, target, torch.arange(len(order)), "amin")  # (P,)
    first = first.reshape(height, width)  # (H, W), places in that order
    point = torch.cat([order, torch.zeros(nothing + 1 - len(order), dtype=order.dtype)])  # (P + 1,)
    best = first  # (H, W)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            near = first[(rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)]  # (H, W)
            px, py = x.flatten()[point[near]], y.flatten()[point[near]]  # (H, W), (H, W)
            reaches = ((px - columns).abs() < 1) & ((py - rows).abs() < 1)  # (H, W)
            best = torch.where((first == nothing) & reaches, best.minimum(near), best)  # (H, W)
    known = (best < nothing)[..., None]  # (H, W, 1)
    found = torch.where(known, -motion.reshape(-1, channels)[point[best]], torch.nan)  # (H, W, 2|3)
    if still is None:
        return found
    still = still.float()  # (H, W, 2|3)
    away = found[..., :2] - still[..., :2]  # (H, W, 2)
    differs = known[..., 0] & ~((away[..., 0] ** 2 + away[..., 1] ** 2) <= 0.25)  # (H, W)
    return torch.where(differs[..., None], found, still)
