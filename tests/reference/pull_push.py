import torch
from torch import Tensor
from torch.nn.functional import pad


def pull_push(
    color: Tensor, quality: Tensor | None = None, *, factor=2, levels: int | None = None
) -> tuple[Tensor, Tensor]:
    """Fill holes from a pyramid: blocks of factor² pixels averaged by quality, and bilinear expansion weighted by it.

    Source: Gortler et al. 1996, The Lumigraph, section 3.4.

    Parameters
    ----------
    color : (H, W) or (H, W, C)
    quality : (H, W)

    Returns
    -------
    (H, W, C), (H, W)
    """
    height, width = color.shape[:2]
    image = color.reshape(height, width, -1)  # (H, W, C)
    good = torch.ones_like(image[..., 0]) if quality is None else quality  # (H, W)
    known = image.isfinite().all(-1) & good.isfinite() & (good > 0)  # (H, W)
    good = good.where(known, 0)  # (H, W)
    image = image.where(known[..., None], torch.nan)  # (H, W, C)
    if height * width > 1 and levels != 0:
        down, across = -(-height // factor), -(-width // factor)
        room = (0, across * factor - width, 0, down * factor - height)

        def blocks(plane: Tensor) -> Tensor:
            return pad(plane, room).reshape(down, factor, across, factor).sum((1, 3))  # (h, w)

        total = blocks(good)  # (h, w)
        sums = [blocks(plane.nan_to_num(0) * good) for plane in image.unbind(-1)]
        coarse = torch.stack(sums, -1) / total[..., None]  # (h, w, C), NaN in holes
        share = total / blocks(torch.ones_like(good))  # (h, w)
        below = None if levels is None else levels - 1
        coarse, below = pull_push(coarse, share / factor**2, factor=factor, levels=below)  # (h, w, C), (h, w)
        both = torch.cat([coarse.nan_to_num(0) * below[..., None], below[..., None]], -1)  # (h, w, C + 1)
        both = _expand(_expand(both, factor, height).transpose(0, 1), factor, width).transpose(0, 1)  # (H, W, C + 1)
        filled = both[..., :-1] / both[..., -1:]  # (H, W, C)
        image = torch.where(known[..., None], image, filled)  # (H, W, C)
        good = torch.where(known, good, both[..., -1])  # (H, W)
    return image.reshape(color.shape), good


def _expand(image: Tensor, factor: int, length: int) -> Tensor:
    """Linear between the centres of the first axis, constant beyond them."""
    place = (torch.arange(length).to(image) + 0.5) / factor - 0.5  # (L,)
    first = place.floor()  # (L,)
    share = (place - first).reshape(-1, *[1] * (image.ndim - 1))  # (L, 1, 1)
    last = len(image) - 1
    a, b = (image[(first + step).clamp(0, last).long()] for step in (0, 1))
    return a * (1 - share) + b * share
