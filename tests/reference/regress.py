import torch
from torch import Tensor

from .projection import pixel_centres, unproject


def regress(
    color: Tensor,
    *,
    normal: Tensor | None = None,
    geometry: Tensor | None = None,
    camera=None,
    weight: Tensor | None = None,
    block=32,
    offset=(0, 0),
    features="fewest",
    margin=False,
) -> tuple[Tensor, ...]:
    """Least squares of colour on {1, normal, position, position²} in each block of pixels, or on the fewest of them.

    Features are selected in turn, each orthogonal to those before: "all" selects the one with the largest remainder
    relative to its own deviation, while that exceeds 1/100; "fewest" selects the one that lowers the sum of squared
    residuals S most, while S / (1 - (1 + 3k)/n)² falls.
    Source: Koskela et al. 2019; Craven and Wahba 1979; Friedman 1991.

    Parameters
    ----------
    color, normal : (H, W, 3)
    geometry : (H, W) depth, with camera, or (H, W, 3) positions
    weight : (H, W)
    margin : also return the least relative distance (H, W) from any decision of the pixel's block

    Returns
    -------
    fitted : (H, W, 3)
    used : (H, W)
    """
    height, width = color.shape[:2]
    shows = torch.ones(height, width, dtype=torch.bool)  # (H, W)
    if normal is not None:
        shows &= normal.isfinite().all(-1) & (normal != 0).any(-1)
    position = geometry  # (H, W, 3)
    if geometry is not None and geometry.ndim == 2:
        position = unproject(camera, pixel_centres(height, width, geometry), geometry)
        shows &= geometry > 0
    if position is not None:
        shows &= position.isfinite().all(-1)
    if weight is None:
        weight = torch.ones(height, width).to(color)  # (H, W)
    shows &= weight.isfinite() & (weight >= 0)
    weight = weight.where(shows & color.isfinite().all(-1), 0)  # (H, W)
    fitted, used = color.clone(), torch.zeros(height, width)  # (H, W, 3), (H, W)
    distance = torch.full((height, width), torch.inf)  # (H, W)
    for top, bottom in cuts(height, block, offset[1]):
        for left, right in cuts(width, block, offset[0]):
            here = (slice(top, bottom), slice(left, right))
            seen = shows[here]  # (h, w)
            w = weight[here][seen]  # (N,)
            if not (w > 0).any():
                continue
            columns = []
            if normal is not None:
                columns += varying(normal[here][seen].T, w, 1.0)
            if position is not None:
                columns += positions(position[here][seen].T, w)
            c = color[here][seen].where((w > 0)[:, None], 0)  # (N, 3)
            fit, count, near = combine(c, columns, w, features)
            low, high = c[w > 0].amin(0), c[w > 0].amax(0)  # (3,), (3,)
            area = fitted[here]
            area[seen] = fit.clamp(low, high)
            used[here][seen] = count
            distance[here] = min([near, *(how for _, how in columns)])
    return (fitted, used.to(torch.uint8), distance) if margin else (fitted, used.to(torch.uint8))


def cuts(length: int, block: int, offset: int) -> list[tuple[int, int]]:
    """Block boundaries; less than half a block at either end joins its neighbour."""
    inner = [at for at in range(offset % block, length, block) if 2 * at >= block and 2 * (length - at) >= block]
    return list(zip([0, *inner], [*inner, length], strict=True))


def mean(values: Tensor, w: Tensor) -> Tensor:
    return (w * values).sum(-1) / w.sum()


def from_threshold(value: float, threshold: float) -> float:
    return abs(value / threshold - 1)


def varying(columns: Tensor, w: Tensor, largest: float) -> list[tuple[Tensor | None, float]]:
    """Those whose deviation is more than a thousandth of the largest, in units of it, and how near they are to that."""
    result = []
    for column in columns:
        centred = column - mean(column, w)  # (N,)
        deviation = float(mean(centred**2, w).sqrt())
        varies = deviation > 1e-3 * largest
        result.append((centred / deviation if varies else None, from_threshold(deviation, 1e-3 * largest)))
    return result


def positions(position: Tensor, w: Tensor) -> list[tuple[Tensor | None, float]]:
    middle = torch.stack([mean(axis, w) for axis in position])  # (3,)
    centred = position - middle[:, None]  # (3, N)
    largest = float(torch.stack([mean(axis**2, w).sqrt() for axis in centred]).max())
    rounding = 1e-6 * float(middle.abs().max())
    if largest <= rounding or largest == 0:
        return [(None, from_threshold(largest, rounding) if rounding else torch.inf)]
    first = varying(centred, w, largest)
    squares = [varying(axis[None] ** 2, w, 1.0)[0] for axis, _ in first if axis is not None]
    return [*first, *squares]


def combine(c: Tensor, columns: list, w: Tensor, features: str) -> tuple[Tensor, int, float]:
    """The fit (N, 3), its number of features, and the least relative distance of a decision from its threshold."""
    left = [column for column, _ in columns if column is not None]  # (N,) each
    samples = float(w.sum() ** 2 / (w**2).sum())
    centre = mean(c.T, w)  # (3,)
    rest = c - centre  # (N, 3)
    power = float(mean((c**2).sum(-1), w))
    count, near = 1, torch.inf

    def score(unexplained: float, count: int) -> float:
        room = 1 - (1 + 3 * (count - 1)) / samples
        return unexplained / room**2 if room > 0 else torch.inf

    while left:
        own = [float(mean(column**2, w)) for column in left]
        near = min([near, *(from_threshold(size, 1e-4) for size in own)])
        keep = [i for i, size in enumerate(own) if size > 1e-4]
        if not keep:
            break
        unexplained = float(mean((rest**2).sum(-1), w))
        slopes = [mean(left[i] * rest.T, w) / own[i] for i in keep]  # (3,) each
        gains = [float((slope**2).sum()) * own[i] for slope, i in zip(slopes, keep, strict=True)]
        # At first the remainder of every feature is the whole, up to rounding.
        ranks = gains if features == "fewest" else [round(own[i], 9) for i in keep]
        best = max(range(len(keep)), key=lambda k: ranks[k])
        others = [rank for k, rank in enumerate(ranks) if k != best]
        if features == "fewest":
            near = min(near, from_threshold(unexplained, 1e-14 * power) if unexplained > 0 else torch.inf)
            before, after = score(unexplained, count), score(unexplained - gains[best], count + 1)
            if unexplained <= 1e-14 * power:
                break
            if before < torch.inf and after < torch.inf:
                near = min(near, from_threshold(after, before))
            if not after < before:
                break
            # Only then does the choice among features matter.
            near = min([near, *(from_threshold(other, ranks[best]) for other in others)])
        column = left[keep[best]]  # (N,)
        rest = rest - column[:, None] * slopes[best]
        left = [
            other - column * (mean(column * other, w) / own[keep[best]])
            for i, other in enumerate(left)
            if i != keep[best]
        ]
        count += 1
    return c - rest, count, near
