import math

import torch
from torch import Tensor

from .reproject import catmull_rom, lanczos2

KERNELS = {"lanczos-2": lanczos2, "catmull-rom": catmull_rom, "bilinear": lambda d: (1 - d.abs()).clamp(min=0)}
DEVIATION = 0.33


def resample(
    image: Tensor, size: tuple[int, int], *, offset=(0.0, 0.0), filter="lanczos-2", dering=True, margin=False
) -> tuple[Tensor, ...]:
    """Resample an image, whose samples lie at an offset from the pixel centres, on a grid of another size.

    Sources: Duchon 1979 (Lanczos); Keys 1981 (Catmull-Rom); the weight is the density of a normal distribution over the
    distances in pixels of the new grid, as in Karis 2014.

    Parameters
    ----------
    image : (H, W) or (H, W, C)
    size : height and width of the grid, (h, w)
    offset : x and y, in pixels of the image
    filter : "lanczos-2", "catmull-rom", "bilinear" or "nearest"
    dering : clamp the first two to the range of the surrounding 2x2 samples
    margin : also return the sum (h, w) of the filter's weights; small sums multiply roundings

    Returns
    -------
    resampled : (h, w) or (h, w, C)
    weight : (h, w)
    """
    height, width = image.shape[:2]
    samples = image.reshape(height, width, -1)  # (H, W, C)
    present = samples.isfinite().all(-1).to(samples.dtype)  # (H, W)
    filled = samples.where(present[..., None] > 0, 0)  # (H, W, C)
    y, x = (
        (torch.arange(new, dtype=torch.float64) + 0.5) * old / new - 0.5 - o
        for new, old, o in zip(size, (height, width), (offset[1], offset[0]), strict=True)
    )  # (h,), (w,): the grid's pixels, counted in samples
    if filter == "nearest":
        rows, columns = ((at + 0.5).floor().clamp(0, n - 1).long() for at, n in ((y, height), (x, width)))  # (h,), (w,)
        resampled, sums = samples[rows][:, columns], torch.ones(size, dtype=torch.float64)  # (h, w, C), (h, w)
    else:
        kernel = KERNELS[filter]

        def matrix(at: Tensor, count: int) -> Tensor:
            """The weights (h, H) of one axis, which sum to one over an unbounded image."""
            every = torch.arange(-3, count + 3, dtype=torch.float64)  # (H + 6,)
            weights = kernel(at[:, None] - every)  # (h, H + 6)
            near = (at[:, None] - every).floor()  # (h, H + 6)
            weights = weights.where((near >= -2) & (near <= 1), 0)  # (h, H + 6)
            return (weights / weights.sum(1, keepdim=True))[:, 3:-3]  # (h, H)

        down, along = (m.to(samples.dtype) for m in (matrix(y, height), matrix(x, width)))  # (h, H), (w, W)
        sums = down @ present @ along.T  # (h, w)
        total = torch.einsum("yr,rck,xc->yxk", down, filled, along)  # (h, w, C)
        resampled = torch.where(sums[..., None] > 1e-6, total / sums[..., None], torch.nan)  # (h, w, C)
        if dering and filter != "bilinear":
            low = torch.full_like(resampled, torch.inf)  # (h, w, C)
            high = -low  # (h, w, C)
            for dy in (0, 1):
                for dx in (0, 1):
                    # The border is replicated.
                    r = (y.floor().long() + dy).clamp(0, height - 1)[:, None]  # (h, 1)
                    c = (x.floor().long() + dx).clamp(0, width - 1)[None]  # (1, w)
                    here = present[r, c][..., None] > 0  # (h, w, 1)
                    low = low.minimum(filled[r, c].where(here, torch.inf))  # (h, w, C)
                    high = high.maximum(filled[r, c].where(here, -torch.inf))  # (h, w, C)
            held = resampled.minimum(high).maximum(low)  # (h, w, C)
            resampled = torch.where((low <= high) & ~resampled.isnan(), held, resampled)  # (h, w, C)

    def density(at: Tensor, count: int) -> Tensor:
        every = torch.arange(count, dtype=torch.float64)  # (H,)
        near = (at[:, None] - every).floor()  # (h, H)
        distance = (at[:, None] - every) * len(at) / count / DEVIATION  # (h, H)
        peak = 1 / (DEVIATION * math.sqrt(2 * math.pi))
        return (peak * torch.exp(-(distance**2) / 2)).where((near >= -2) & (near <= 1), 0).to(samples.dtype)

    weight = density(y, height) @ present @ density(x, width).T  # (h, w)
    resampled = resampled.reshape(*size, *image.shape[2:])  # (h, w) or (h, w, C)
    return (resampled, weight, sums) if margin else (resampled, weight)
