import itertools

import torch
from torch import Tensor

TO_YCOCG = [[0.25, 0.5, 0.25], [0.5, 0, -0.5], [-0.25, 0.5, -0.25]]
TO_RGB = [[1, 1, -1], [1, 0, 1], [1, -1, -1]]


def clip_history(
    history: Tensor,
    color: Tensor,
    *,
    box="variance",
    gamma=1.0,
    window="3x3",
    space="ycocg",
    response="center",
    exposure=1.0,
    margin=False,
) -> Tensor | tuple[Tensor, Tensor]:
    """Clip history to the colours of each pixel's neighbourhood.

    Hulls are intersections of half-spaces: "hull" by slabs along 13 directions (26-DOP, Klosowski et al. 1998),
    "exact-hull" by slabs along all possible normals of its sides, "chroma-hull" by the range of Y and the half-planes
    through pairs of (Co, Cg) with all others on one side.

    Sources: Karis 2014; Salvi 2016; Playdead 2016; Lottes 2016 (tone mapping); FSR 3.1 (ellipsoid).

    Parameters
    ----------
    history, color : (H, W, 3)
    box : "minmax", "rounded", "variance", "intersection"; with response "current" also "hull", "exact-hull" and
        "chroma-hull"
    gamma : half the side of the variance box in standard deviations
    window : "3x3" or "5x5"
    space : "rgb", "ycocg", "tonemapped-rgb" or "tonemapped-ycocg"
    response : "clamp", "center", "current" or "ellipsoid"
    exposure : radiance that the tone-mapped spaces take for 1
    margin : also return the factor (H, W) by which hulls may multiply roundings: large where a path grazes their sides

    Returns
    -------
    history : (H, W, 3)
    """
    radius = {"3x3": 1, "5x5": 2}[window]
    present = color.isfinite().all(-1)  # (H, W)
    known = color.where(present[..., None], 0)  # (H, W, 3)
    own = to_space(known, space, exposure)  # (H, W, 3)
    taps, counts, in_cross, places = [], [], [], []
    height, width = present.shape
    rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]  # (H, 1), (1, W)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            y, x = (rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)  # (H, 1), (1, W)
            taps.append(own[y, x])  # (H, W, 3)
            counts.append((rows + dy == y) & (columns + dx == x) & present[y, x])  # (H, W)
            in_cross.append(dx == 0 or dy == 0)
            places.append((dy, dx))
    taps, counts = torch.stack(taps), torch.stack(counts)[..., None]  # (T, H, W, 3), (T, H, W, 1)
    crossed = counts & torch.tensor(in_cross)[:, None, None, None]  # (T, H, W, 1)
    number = counts.sum(0)  # (H, W, 1)
    grazing = torch.ones_like(own[..., 0])  # (H, W)
    mean = taps.where(counts, 0).sum(0) / number  # (H, W, 3)
    deviation = (((taps - mean) ** 2).where(counts, 0).sum(0) / number).sqrt()  # (H, W, 3)

    def extent(among: Tensor) -> tuple[Tensor, Tensor]:
        return taps.where(among, torch.inf).amin(0), taps.where(among, -torch.inf).amax(0)  # (H, W, 3) each

    low, high = extent(counts)  # (H, W, 3)
    if box == "rounded":
        cross_low, cross_high = extent(crossed & counts)  # (H, W, 3)
        some = crossed.any(0)  # (H, W, 1)
        low = torch.where(some, (low + cross_low) / 2, low)  # (H, W, 3)
        high = torch.where(some, (high + cross_high) / 2, high)  # (H, W, 3)
    elif box in ("variance", "intersection"):
        below, above = mean - gamma * deviation, mean + gamma * deviation  # (H, W, 3)
        low, high = (below, above) if box == "variance" else (low.maximum(below), high.minimum(above))

    # A margin, so that rounding does not decide which colours lie outside a flat box.
    bounds = low, high
    room = 1e-6 * torch.maximum(low.abs(), high.abs()).amax(-1, keepdim=True)  # (H, W, 1)
    low, high = low - room, high + room  # (H, W, 3)

    old = to_space(history, space, exposure)  # (H, W, 3)
    held = old.maximum(low).minimum(high)  # (H, W, 3)
    middle = (low + high) / 2  # (H, W, 3)
    if "hull" in box:
        target = torch.where(present[..., None], own, mean)  # (H, W, 3)
        sides = {"hull": slabs, "exact-hull": facets, "chroma-hull": half_planes}[box]
        beyond = sides(torch.stack([old, target]), taps, counts)  # (K, 2, H, W)
        t, grazing = enter(beyond, (target - old).norm(dim=-1))  # (H, W), (H, W)
        new = old + t[..., None] * (target - old)  # (H, W, 3)
    elif response == "clamp":
        new = held
    elif response == "center":
        new = middle + (old - middle) / share(old - middle, (high - low) / 2).amax(-1, keepdim=True).clamp(min=1)
    elif response == "current":
        target = torch.where(present[..., None], own.maximum(bounds[0]).minimum(bounds[1]), middle)  # (H, W, 3)
        border = old.maximum(bounds[0]).minimum(bounds[1])  # (H, W, 3)
        t = torch.where(held == old, 0, (border - old) / (target - old)).amax(-1, keepdim=True)  # (H, W, 1)
        new = old + t * (target - old)  # (H, W, 3)
    else:
        axes = torch.tensor([1.7, 1, 1] if "ycocg" in space else [1.0, 1, 1], dtype=old.dtype)  # (3,)
        length = share(old - mean, gamma * deviation * axes + room).norm(dim=-1, keepdim=True)  # (H, W, 1)
        new = mean + (old - mean) / length.clamp(min=1)  # (H, W, 3)
    if response in ("clamp", "center", "current") and "hull" not in box:
        inside = (held == old).all(-1, keepdim=True)  # (H, W, 1)
        new = torch.where(inside, old, new.maximum(bounds[0]).minimum(bounds[1]))  # (H, W, 3)
    stays = (number == 0) | ~history.isfinite().all(-1, keepdim=True)  # (H, W, 1)
    brightest = known.amax(-1)  # (H, W)
    around = [brightest[(rows + dy).clamp(0, height - 1), (columns + dx).clamp(0, width - 1)] for dy, dx in places]
    most = torch.stack([*around, history.amax(-1)]).amax(0).clamp(min=0)[..., None]  # (H, W, 1)
    result = history.where(stays | (new == old).all(-1, keepdim=True), to_rgb(new, space, exposure, most))  # (H, W, 3)
    return (result, grazing) if margin else result


def slabs(points: Tensor, taps: Tensor, counts: Tensor) -> Tensor:
    """How far (26, N, H, W) points (N, H, W, 3) lie beyond the taps (T, H, W, 3) that count, along 13 directions."""
    directions = [d for d in itertools.product((-1, 0, 1), repeat=3) if d != (0, 0, 0)]  # and back
    return torch.stack([_beyond(points, taps, counts, taps.new_tensor(d)) for d in directions])


def facets(points: Tensor, taps: Tensor, counts: Tensor) -> Tensor:
    """How far (K, N, H, W) points (N, H, W, 3) lie beyond the taps (T, H, W, 3) that count, along their hull's normals.

    A facet is normal to two edges; where all taps lie in a plane or in line, sides of their hull are normal to an edge
    and to an axis, or along an axis. Additional directions do no harm, so not every one has to be a facet's.
    """
    axes = list(torch.eye(3).to(taps))
    there = taps.where(counts, taps.where(counts, torch.nan).nanmean(0))  # (T, H, W, 3)
    normals = [axis.expand_as(there[0]) for axis in axes]  # (H, W, 3) each
    for i, j in itertools.combinations(range(len(there)), 2):
        edge = there[j] - there[i]  # (H, W, 3)
        normals += [torch.linalg.cross(edge, axis.expand_as(edge)) for axis in axes]
        normals += [torch.linalg.cross(edge, other - there[i]) for other in there[j + 1 :]]
    size = there.abs().amax((0, -1))[..., None]  # (H, W, 1)
    found = []
    for normal in normals:
        length = normal.norm(dim=-1, keepdim=True)  # (H, W, 1)
        normal = (normal / length).where(length > 1e-12 * size**2, torch.nan)  # (H, W, 3)
        along, most = (points * normal).sum(-1), (there * normal).sum(-1)  # (N, H, W), (T, H, W)
        rounding = 1e-13 * size[..., 0]  # (H, W)
        found += [along - most.amax(0) - rounding, most.amin(0) - along - rounding]  # (N, H, W) each
    return torch.stack(found).nan_to_num(-torch.inf)


def half_planes(points: Tensor, taps: Tensor, counts: Tensor) -> Tensor:
    """How far (K, N, H, W) points (N, H, W, 3) lie beyond the range of Y, and beyond the convex hull in (Co, Cg).

    Each pair of taps with all others on its left is an edge; the ranges of Co and Cg are the ends of segments.
    """
    found = [_beyond(points, taps, counts, sign * axis) for sign in (-1, 1) for axis in torch.eye(3).to(taps)]
    chroma, places = taps[..., 1:].where(counts, torch.nan), points[..., 1:]  # (T, H, W, 2), (N, H, W, 2)
    for start in chroma:
        edges = chroma - start  # (T, H, W, 2)
        lengths = edges.norm(dim=-1).where(edges.any(-1), torch.nan)  # (T, H, W): no edges between equals
        left = _cross(edges[:, None], edges) / lengths[:, None]  # (T, T, H, W)
        rounding = 1e-13 * chroma.nan_to_num(0).abs().amax((0, -1))  # (H, W)
        whole = ((left >= -rounding) | ~counts[..., 0]).all(1)  # (T, H, W)
        right = _cross(places - start, edges[:, None]) / lengths[:, None]  # (T, N, H, W)
        found += list(right.where(whole[:, None], -torch.inf))  # T of (N, H, W)
    return torch.stack(found)


def _beyond(points: Tensor, taps: Tensor, counts: Tensor, direction: Tensor) -> Tensor:
    """(N, H, W), along a direction (3,)."""
    most = (taps @ direction).where(counts[..., 0], -torch.inf).amax(0)  # (H, W)
    return (points @ direction - most) / direction.norm()  # (N, H, W)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]  # (...)


def enter(beyond: Tensor, way: Tensor) -> tuple[Tensor, Tensor]:
    """Where (H, W) from 0 to 1 a way from outside to a target comes inside, and how little steeply (H, W).

    The way is (H, W) long, and starts and ends so far beyond each side: (K, 2, H, W).
    """
    start, end = beyond.unbind(1)  # (K, H, W), (K, H, W)
    descent = start - end.clamp(max=0)  # (K, H, W)
    t = torch.where(start > 0, start / descent, 0).amax(0)  # (H, W)
    steepness = way / descent.abs()  # (K, H, W)
    # The most certain of the deciding sides, and sides that rounding may put first.
    surest = steepness.where((start > 0) & (start / descent >= t - 1e-9), torch.inf).amin(0)  # (H, W)
    latest = ((start + 1e-6) / (descent - 1e-6).clamp(min=1e-300)).clamp(max=1)  # (K, H, W)
    later = steepness.where((start > -1e-6) & (latest > t + 1e-4), 0).amax(0)  # (H, W)
    grazing = surest.where(surest.isfinite(), 1).maximum(later)  # (H, W)
    return t.where(t.isfinite(), 0), grazing.nan_to_num(1).clamp(1, 1e6)


def share(distance: Tensor, half: Tensor) -> Tensor:
    return torch.where(distance == 0, 0, distance.abs() / half)  # (H, W, 3)


def to_space(rgb: Tensor, space: str, exposure: float) -> Tensor:
    if "tonemapped" in space:
        rgb = rgb / (exposure + rgb.amax(-1, keepdim=True).clamp(min=0))  # (H, W, 3)
    return rgb @ rgb.new_tensor(TO_YCOCG).T if "ycocg" in space else rgb


def to_rgb(color: Tensor, space: str, exposure: float, most: Tensor) -> Tensor:
    """Tone-mapped colours become no brighter than `most` (H, W, 1)."""
    rgb = color @ color.new_tensor(TO_RGB).T if "ycocg" in space else color  # (H, W, 3)
    if "tonemapped" in space:
        shown = rgb.amax(-1, keepdim=True).clamp(min=0)  # (H, W, 1)
        light = exposure * shown / (1 - shown)  # (H, W, 1)
        light = torch.where(shown < most / (exposure + most), light, most)  # (H, W, 1)
        rgb = torch.where(shown > 0, rgb * light / shown, rgb * exposure)  # (H, W, 3)
    return rgb
