import torch
from torch import Tensor

from .projection import pixel_centres, project, project_direction, rays, unproject


def splat(
    color: Tensor,
    depth: Tensor,
    camera,
    previous_camera,
    *,
    offset: Tensor | None = None,
    drift: Tensor | None = None,
    quality: Tensor | None = None,
    tolerance=0.1,
    reach=0.0,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Scatter the points of the previous frame to where they appear now.

    A point covers the pixels whose centres lie in a square of side 1 + 1.01 max(0, z/z' · zoom - 1)
    around it; the nearest that covers a
    pixel decides, others count with max(0, 1 - (z' - z0)/(tolerance z0)); all by quality / side⁴. Pixels without a
    point use those that would cover them with sides longer by 2 · reach.

    Parameters
    ----------
    color : (H, W) or (H, W, C)
    depth : (H, W)
    offset : (H, W, 2), from the pixels' centres
    drift : (H, W, 2) or (H, W, 3), previous minus current pixels and depth
    quality : (H, W)

    Returns
    -------
    (H, W, C), (H, W), (H, W, 2), (H, W)
    """
    height, width = depth.shape
    image = color.reshape(height, width, -1)  # (H, W, C)
    own = torch.zeros_like(depth)[..., None].expand(-1, -1, 2) if offset is None else offset  # (H, W, 2)
    good = torch.ones_like(depth) if quality is None else quality  # (H, W)
    own = own.where(own != 0.5, 0.5 - 2**-24)  # (H, W, 2)
    place = pixel_centres(height, width, depth) + own  # (H, W, 2)
    far = depth == torch.inf  # (H, W)
    there, ahead = project(camera, unproject(previous_camera, place, depth.where(~far, 1)))  # (H, W, 2), (H, W)
    beyond, front = project_direction(camera, rays(previous_camera, place)[1])  # (H, W, 2), (H, W)
    moved = torch.where(far[..., None], beyond, there)  # (H, W, 2)
    ahead = torch.where(far, torch.where(front > 0, torch.inf, torch.nan), ahead.where(ahead > 0, torch.nan))  # (H, W)
    if drift is not None:
        moved = moved - drift[..., :2].nan_to_num(0, 0, 0)  # (H, W, 2)
        if drift.shape[-1] == 3:
            ahead = ahead - drift[..., 2].nan_to_num(0, 0, 0)  # (H, W)

    zoom = (_pixels_per_unit(camera) / _pixels_per_unit(previous_camera)) ** 0.5
    side = (1 + 1.01 * (torch.where(far, zoom, zoom * depth / ahead) - 1)).clamp(1, 16)  # (H, W)
    point = image.isfinite().all(-1) & (depth > 0) & (good > 0) & good.isfinite() & (ahead > 0)  # (H, W)
    point &= (moved - place).abs().amax(-1) < 1e6  # (H, W)
    moved, side = moved[point], side[point]  # (N, 2), (N,)
    near, weight = ahead[point], good[point] / side**4  # (N,), (N,)
    cell = moved.floor()  # (N, 2)
    own = moved - cell - 0.5  # (N, 2)

    def cover(reach=0.0) -> list[tuple[Tensor, Tensor, bool]]:
        """The pairs of points and covered pixels, and whether the pixel is the point's own."""
        half = side[:, None] / 2 + reach  # (N, 1)
        first = (own - half).ceil() if reach > 0 else (own - half).floor() + 1  # (N, 2)
        last = (own + half).floor()  # (N, 2)
        most = int(torch.cat([first, last]).abs().max()) if len(side) else 0
        taps = []
        for dy in range(-most, most + 1):
            for dx in range(-most, most + 1):
                step = torch.tensor([dx, dy]).to(cell)  # (2,)
                x, y = (cell + step).unbind(-1)  # (N,), (N,)
                covers = ((first <= step) & (step <= last)).all(-1)  # (N,)
                covers &= (x >= 0) & (x < width) & (y >= 0) & (y < height)  # (N,)
                who = covers.nonzero()[:, 0]  # (M,)
                taps.append((who, (y * width + x)[who].long(), dx == dy == 0))
        return taps

    def find_nearest(taps: list) -> Tensor:
        nearest = torch.full((height * width,), torch.inf).to(depth)  # (H W,)
        for who, where, _ in taps:
            nearest.scatter_reduce_(0, where, near[who], "amin")
        return nearest

    taps = cover()
    nearest, reached = find_nearest(taps), torch.zeros(height * width, dtype=torch.bool)  # (H W,), (H W,)
    for _, where, _ in taps:
        reached[where] = True
    taps = [(*tap, 1.0) for tap in taps]
    if reach > 0:
        wide = cover(reach)
        nearest = torch.where(reached, nearest, find_nearest(wide))  # (H W,)
        for who, where, here in wide:
            free = ~reached[where]  # (M,)
            who, where = who[free], where[free]
            taps.append((who, where, here, (side[who] / (side[who] + 2 * reach)) ** 4))
    numbers = torch.cat([image[point], near[:, None], own, weight[:, None]], -1)  # (N, C + 4)
    sums, total = torch.zeros(height * width, numbers.shape[1]).to(depth), torch.zeros_like(nearest)
    flat = torch.zeros_like(nearest, dtype=torch.bool)  # (H W,): whether the nearest point is background
    for who, where, here, less in taps:
        good = weight[who] * less  # (M,)
        behind = (near[who] - nearest[where]) / (tolerance * nearest[where])  # (M,)
        share = good * torch.where(near[who] == nearest[where], 1, (1 - behind).clamp(min=0).nan_to_num(0))
        some = share > 0  # (M,)
        who, where, share, good = who[some], where[some], share[some], good[some]
        values = numbers[who].clone()  # (M, C + 4)
        values[:, -1] = good
        if not here:
            values[:, -3:-1] = 0
        flat[where] |= near[who] == torch.inf
        values[:, -4] = values[:, -4].nan_to_num(posinf=0)
        sums.index_add_(0, where, share[:, None] * values)
        total.index_add_(0, where, share)
    mean = (sums / total[:, None]).where(total[:, None] > 0, torch.nan)  # (H W, C + 4)
    mean[:, -4] = mean[:, -4].where(~flat, torch.inf)
    mean = mean.reshape(height, width, -1)  # (H, W, C + 4)
    return (
        mean[..., :-4].reshape(color.shape),
        mean[..., -4],
        mean[..., -3:-1],
        mean[..., -1].nan_to_num(0),
    )


def _pixels_per_unit(camera) -> Tensor:
    """Area of a unit square at unit depth, up to a factor of the image's size."""
    rows = torch.as_tensor(camera.world_to_clip)[[0, 1, 3], :3]  # (3, 3)
    return torch.linalg.det(rows / rows[2].norm()).abs()
