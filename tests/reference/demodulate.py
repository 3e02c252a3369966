import numpy as np
import torch
from torch import Tensor

LEAST = 1 / 32  # the smallest divisor
LOW = 1e-3  # a surface with a reflectance has at least this somewhere,
FAINT, HIGH = 1e-5, 1.25  # and nearly nowhere less than the one, unless it is 0, or more than the other


def _others(most: Tensor) -> Tensor:
    """Where the largest channel (H, W) is out of range."""
    faint, high = (torch.tensor(bound, dtype=torch.float32).to(most) for bound in (FAINT, HIGH))
    return (most > high) | (most > 0) & (most < faint)  # (H, W)


NEIGHBORS = ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1]))


def connected(a: tuple, b: tuple, normal: Tensor | None, depth: Tensor | None) -> Tensor | bool:
    """Whether neighbours are as near and face the same way."""
    joined: Tensor | bool = True
    if normal is not None:
        angle = torch.tensor(0.2, dtype=torch.float32).to(normal)
        joined = (normal[a] - normal[b]).square().sum(-1) < angle
    if depth is not None:
        share = torch.tensor(0.02, dtype=torch.float32).to(depth)
        apart = (depth[a] - depth[b]).abs()
        joined = joined & ((depth[a] == depth[b]) | (apart < share * torch.minimum(depth[a], depth[b])))
    return joined


def regions(normal: Tensor, depth: Tensor) -> Tensor:
    """Label (H, W) of each region: the first of the pixels that are connected by similar neighbours."""
    height, width = depth.shape
    labels = torch.arange(height * width).reshape(height, width)  # (H, W)
    pairs = [(a, b, connected(a, b, normal, depth)) for a, b in NEIGHBORS]
    while True:
        before = labels.clone()
        for a, b, joined in pairs:
            least = torch.minimum(labels[a], labels[b])
            for side in (a, b):
                labels[side] = torch.where(joined, torch.minimum(least, labels[side]), labels[side])
        if torch.equal(before, labels):
            return labels


def is_reflectance(
    albedo: Tensor, ids: Tensor | None = None, *, normal: Tensor | None = None, depth: Tensor | None = None
) -> Tensor | None:
    """Mask (H, W) of the surfaces whose largest albedo is at least `LOW`, with one pixel in 64 out of range at most.

    Without ids, regions are surfaces; None if one pixel in 1024 is out of range at most.
    """
    most = albedo.where(albedo.isfinite(), 0).amax(-1)  # (H, W)
    others = _others(most).flatten().long()  # (H W)
    if ids is None:
        if 1024 * others.sum() <= others.numel():
            return None
        if normal is None or depth is None:
            return torch.zeros_like(most, dtype=torch.bool)
        ids = regions(normal, depth)
    known, index = ids.unique(return_inverse=True)  # (N,), (H, W)
    brightest = torch.zeros(len(known)).to(most).scatter_reduce(0, index.flatten(), most.flatten(), "amax")  # (N,)
    others, pixels = (torch.bincount(index.flatten(), each, len(known)) for each in (others, None))  # (N,) each
    return ((brightest >= torch.tensor(LOW, dtype=torch.float32).to(most)) & (64 * others <= pixels))[index]  # (H, W)


def materials(albedo: Tensor, normal: Tensor | None = None, depth: Tensor | None = None) -> Tensor:
    """Kind of material (H, W): 1 where the albedo is no reflectance, 3 where it is white, else 2."""
    white = (albedo >= torch.tensor(0.99, dtype=torch.float32).to(albedo)).all(-1)  # (H, W)
    mask = is_reflectance(albedo, normal=normal, depth=depth)
    kinds = white.long() + 2  # (H, W)
    return kinds if mask is None else kinds.where(mask, 1)


def is_textured(kinds: Tensor, *, normal: Tensor | None = None, depth: Tensor | None = None) -> bool:
    """Whether white ends within surfaces, for more than an eighth as many pairs of neighbours as it has pixels."""
    rarer = min((kinds == 2).sum(), (kinds == 3).sum())
    split = (((kinds[a] + kinds[b] == 5) & connected(a, b, normal, depth)).sum() for a, b in NEIGHBORS)
    return bool(8 * sum(split) > rarer)


def material_ids(albedo: Tensor, **surface: Tensor | None) -> Tensor:
    """Ids (H, W) of the kinds of material; white is one where it is no texture."""
    kinds = materials(albedo, **surface)
    return kinds.clamp(max=2) if is_textured(kinds, **surface) else kinds


def divisor(albedo: Tensor, where: Tensor | None) -> Tensor:
    """The divisor (H, W, 3): the albedo in [0, 1], at least 1/32; 1 outside `where`, by default where it is black."""
    a = albedo.where(albedo.isfinite(), 0).clamp(0, 1)  # (H, W, 3)
    known = a.amax(-1) > 0 if where is None else where.bool()  # (H, W)
    return a.clamp(min=LEAST).where(known[..., None], 1)  # (H, W, 3)


def _emitted(color: Tensor, emission: Tensor | None) -> Tensor:
    return torch.zeros_like(color) if emission is None else emission.where(emission.isfinite(), 0)  # (H, W, 3)


def demodulate(color: Tensor, albedo: Tensor, *, emission: Tensor | None = None, where: Tensor | None = None) -> Tensor:
    """Illumination (H, W, 3) = (color - emission) / divisor. Source: Falcor's SVGF pass, where albedo is bright."""
    return (color - _emitted(color, emission)) / divisor(albedo, where)  # (H, W, 3)


def remodulate(
    illumination: Tensor, albedo: Tensor, *, emission: Tensor | None = None, where: Tensor | None = None
) -> Tensor:
    """Colour (H, W, 3) = illumination · divisor + emission: the inverse of `demodulate`."""
    return illumination * divisor(albedo, where) + _emitted(illumination, emission)  # (H, W, 3)


def texture_of(frame) -> dict[str, Tensor | None]:
    """Arguments of `demodulate` and `remodulate` for a frame with albedo."""
    mask = None if frame.ids is None else is_reflectance(frame.albedo, frame.ids)  # (H, W)
    return {"albedo": frame.albedo, "where": mask}


def disowned(before, frame) -> Tensor:
    """The ids (H, W) of the frame before, unused where a surface has another kind of albedo in the frame."""
    if before.albedo is None or frame.albedo is None:
        return before.ids
    ids = before.ids.clone()  # (H, W)
    unused = next(i for i in range(frame.ids.numel() + 1) if not (frame.ids == i).any())
    then, now = (is_reflectance(each.albedo, each.ids) for each in (before, frame))  # (H, W) each
    for known in before.ids.unique():
        here = frame.ids == known  # (H, W)
        if here.any() and now[here][0] != then[before.ids == known][0]:
            ids[before.ids == known] = unused
    return ids
