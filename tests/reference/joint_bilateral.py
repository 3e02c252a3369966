import torch
from torch import Tensor

from .similarity import CUT, Similarity, shift


def reconstruct(color: Tensor, *, radius=2, sigma=1.0, margin=False, **similarity) -> Tensor | tuple[Tensor, Tensor]:
    """Fill missing pixels with the mean of similar ones in a window, weighted by distance: Σ w c / Σ w.

    Source: the joint bilateral filter, Kopf et al. 2007, for samples anywhere.

    Parameters
    ----------
    color : (H, W, 3)
    radius : of the window, in pixels
    sigma : of the Gaussian of the distance, in pixels
    margin : also return the sum of the weights (H, W), infinite where nothing is missing
    **similarity : depth, normal, ids and their sigmas, see `similarity.Similarity`

    Returns
    -------
    (H, W, 3), NaN where no pixel is similar
    """
    present = color.isfinite().all(-1)  # (H, W)
    clean = color.where(present[..., None], 0)  # (H, W, 3)
    alike = Similarity(color, **similarity)
    colors, weights = torch.zeros_like(color), torch.zeros_like(color[..., 0])  # (H, W, 3), (H, W)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            exponent, same = alike(dx, dy, radius)  # (H, W)
            weight = torch.exp(-exponent - (dx * dx + dy * dy) / (2 * sigma**2))  # (H, W)
            weight = weight.where(same & shift(present, dx, dy, False) & (weight >= CUT), 0)  # (H, W)
            colors += weight[..., None] * shift(clean, dx, dy, 0)  # (H, W, 3)
            weights += weight  # (H, W)
    filled = (colors / weights[..., None]).where((weights > 0)[..., None], torch.nan)  # (H, W, 3)
    filled = color.where(present[..., None], filled)  # (H, W, 3)
    return (filled, weights.where(~present, torch.inf)) if margin else filled


def joint_bilateral_upsample(
    color: Tensor,
    *,
    depth: Tensor | None = None,
    normal: Tensor | None = None,
    ids: Tensor | None = None,
    low_depth: Tensor | None = None,
    low_normal: Tensor | None = None,
    low_ids: Tensor | None = None,
    scale=2,
    offset=None,
    radius=2,
    sigma=1.0,
    sigma_normal=128.0,
    sigma_depth=0.5,
    sigma_plane=0.05,
    margin=False,
) -> Tensor | tuple[Tensor, Tensor]:
    """Upsample one sample per block of pixels to full resolution: Σ w c / Σ w over near and similar samples.

    Source: Kopf et al. 2007.

    Parameters
    ----------
    color : (h, w, 3), h = ceil(H / scale), w = ceil(W / scale)
    depth : (H, W)
    normal : (H, W, 3)
    ids : (H, W)
    low_depth, low_normal, low_ids : of (h, w), the samples' surfaces; by default those of their pixels
    offset : of each sample from the centre of its block's first pixel, to the right and down
    radius, sigma : of the window and of the Gaussian of the distance, in blocks
    margin : also return the sum of the weights (H, W)

    Returns
    -------
    (H, W, 3), NaN where no pixel is similar
    """
    height, width = next(guide for guide in (depth, normal, ids) if guide is not None).shape[:2]
    right, down = ((scale - 1) / 2,) * 2 if offset is None else offset
    pixel_x, pixel_y = int(right + 0.5), int(down + 0.5)
    columns = (torch.arange(color.shape[1]) * scale + pixel_x).clamp(max=width - 1)  # (w,), of the samples' pixels
    rows = (torch.arange(color.shape[0]) * scale + pixel_y).clamp(max=height - 1)  # (h,)

    def shown(full, low):
        return full[rows][:, columns] if low is None and full is not None else low

    sigmas = {"sigma_normal": sigma_normal, "sigma_depth": sigma_depth, "sigma_plane": sigma_plane}
    here = Similarity(color.new_zeros(height, width, 3), depth=depth, normal=normal, ids=ids, **sigmas)
    there = Similarity(color, depth=shown(depth, low_depth), normal=shown(normal, low_normal), ids=shown(ids, low_ids))
    present = color.isfinite().all(-1)  # (h, w)
    clean = color.where(present[..., None], 0)  # (h, w, 3)
    x, y = torch.arange(width), torch.arange(height)  # (W,), (H,)
    colors, weights = color.new_zeros(height, width, 3), color.new_zeros(height, width)  # (H, W, 3), (H, W)
    for j in range(-radius - 1, radius + 2):
        for i in range(-radius - 1, radius + 2):
            block_x, block_y = x // scale + i, y // scale + j  # (W,), (H,)
            inside = ((block_y >= 0) & (block_y < len(rows)))[:, None] & (block_x >= 0) & (block_x < len(columns))
            block_x, block_y = block_x.clamp(0, len(columns) - 1), block_y.clamp(0, len(rows) - 1)  # (W,), (H,)
            across, along = columns[block_x] - x, rows[block_y] - y  # (W,), (H,), from pixel to pixel
            dx, dy = across + right - pixel_x, (along + down - pixel_y)[:, None]  # (W,), (H, 1), to the sample
            inside = inside & (dy.abs() <= radius * scale) & (dx.abs() <= radius * scale)  # (H, W)

            def tap(image, block_x=block_x, block_y=block_y):
                return image[block_y][:, block_x]  # (H, W, ...)

            exponent = (dx * dx + dy * dy) / (2 * (sigma * scale) ** 2)  # (H, W)
            if normal is not None:
                apart = (here.normal - tap(there.normal)).square().sum(-1)  # (H, W)
                exponent = exponent + here.sharpness * apart  # (H, W)
            if depth is not None:
                exponent = exponent + here.behind(tap(there.inverse), dx, dy, radius * scale)  # (H, W)
            same = inside & (here.kind == tap(there.kind)) & tap(present)  # (H, W)
            weight = torch.exp(-exponent)  # (H, W)
            weight = weight.where(same & (weight >= CUT), 0)  # (H, W)
            colors += weight[..., None] * tap(clean)  # (H, W, 3)
            weights += weight  # (H, W)
    full = (colors / weights[..., None]).where((weights > 0)[..., None], torch.nan)  # (H, W, 3)
    return (full, weights) if margin else full
