import torch
from torch import Tensor
from torch.nn.functional import pad

from .choice import around, carry, together

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (3, 3), (0, 4), (1, 4), (4, 4), (3, 4))


def details(planes: Tensor) -> tuple[Tensor, Tensor]:
    """Differences (H, W, 5) from means over 3×3 pixels, 0 outside of the mask (H, W) of pixels where all are known."""
    windows = pad(planes.movedim(-1, 0), (1, 1, 1, 1), value=torch.nan)  # (5, H + 2, W + 2)
    windows = windows.unfold(1, 3, 1).unfold(2, 3, 1).flatten(-2)  # (5, H, W, 9)
    known = windows.isfinite().all(-1).all(0)  # (H, W)
    detail = planes - windows.mean(-1).movedim(0, -1)  # (H, W, 5)
    return detail.where(known[..., None], 0), known


def collocate(planes: Tensor, evidence: Tensor | None = None, *, exposure=1.0) -> Tensor:
    """Add the products of a frame's detail, in tiles, to the evidence (h, w, 14).

    Parameters
    ----------
    planes : (H, W, 5), luminances of new samples, those of the frame before, those of two frames before, two results
    evidence : (ceil(H / 8), ceil(W / 8), 14) of earlier frames
    exposure : of the image; detail below 1/1024 of it is black
    """
    detail, finite = details(planes)
    products = torch.stack([detail[..., a] * detail[..., b] for a, b in PAIRS], -1)  # (H, W, 13)
    seen, n = together(products), together(finite[..., None].to(planes))  # (h, w, 13), (h, w, 1)
    samples = seen[..., [0]] + seen[..., [3]]  # (h, w, 1)
    energy = torch.cat([samples, seen[..., [5, 8, 11]] / 16], -1).amax(-1, keepdim=True)  # (h, w, 1)
    floor = max((exposure / 1024) ** 2, torch.finfo(torch.float32).tiny)
    known = (n > 0) & energy.isfinite()  # (h, w, 1)
    seen = torch.cat([seen / (energy / n + floor), n], -1).where(known, 0)  # (h, w, 14)
    return seen if evidence is None else evidence + seen


def noise(evidence: Tensor) -> tuple[Tensor, Tensor]:
    """The noise (h, w) in products of the frame before, and the factor (h, w) that makes new detail as large as its."""
    new, lasting, lost, before, earlier, oldest = evidence[..., :6].unbind(-1)  # (h, w) each
    third = lost.maximum(0.1 * (new * oldest).sqrt())  # (h, w)
    signal = (lasting.clamp(min=0) * earlier.clamp(min=0) / third).nan_to_num(0).minimum(before)  # (h, w)
    return before - signal, torch.where(signal > 0, signal / lasting, 0)


def gram(evidence: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Products of two results with each other (h, w, 2, 2), with new samples and those before (h, w, 2 each)."""
    (ya, pa, aa, yb, pb, bb, ab) = evidence[..., 6:13].unbind(-1)
    results = torch.stack([torch.stack([aa, ab], -1), torch.stack([ab, bb], -1)], -2)
    return results, torch.stack([ya, yb], -1), torch.stack([pa, pb], -1)


def errors(evidence: Tensor, first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """Squared errors (h, w) of results mixed with share `first`, and of these mixed with samples with share `second`.

    Those of results lack the energy of the reference's detail, which is the same for all.
    """
    rest, scale = noise(evidence)
    results, new, before = gram(evidence)
    shares = torch.stack([first, 1 - first], -1)  # (h, w, 2)
    energy = (shares[..., :, None] * shares[..., None, :] * results).sum((-1, -2))  # (h, w)
    own, seen = ((shares * products).sum(-1) for products in (before, new))  # (h, w) twice
    shared = (own - seen * scale).clamp(min=0).minimum(rest / 2)  # (h, w)
    apart = energy - 2 * own + evidence[..., 3]  # (h, w)
    whole = apart - rest + 2 * shared  # (h, w), the error of the mixture of results
    mixed = (1 - second) ** 2 * whole + second**2 * rest + 2 * second * (1 - second) * shared  # (h, w)
    return energy - 2 * seen * scale, mixed


def mixture(evidence: Tensor) -> Tensor:
    """Shares (h, w, 2) of evidence that is averaged: of the first result, and of the samples."""
    rest, scale = noise(evidence)
    results, new, before = gram(evidence)
    error = (
        torch.diagonal(results, dim1=-2, dim2=-1) - 2 * new * scale[..., None]
    )  # (h, w, 2), less the detail's energy
    apart = results[..., 0, 0] + results[..., 1, 1] - 2 * results[..., 0, 1]  # (h, w)
    first = (0.5 + 0.5 * (error[..., 1] - error[..., 0]) / apart).nan_to_num(0).clamp(0, 1)  # (h, w)
    shares = torch.stack([first, 1 - first], -1)  # (h, w, 2)
    energy = (shares[..., :, None] * shares[..., None, :] * results).sum((-1, -2))  # (h, w)
    own, seen = ((shares * products).sum(-1) for products in (before, new))  # (h, w) twice
    shared = (own - seen * scale).clamp(min=0).minimum(rest / 2)  # (h, w)
    second = (1 - (rest - shared) / (energy - 2 * own + evidence[..., 3])).nan_to_num(0).clamp(0, 1)  # (h, w)
    return torch.stack([first, second], -1).where((evidence[..., 13] >= 16)[..., None], 0)


def of_all(evidence: Tensor) -> Tensor:
    """The sums (1, 1, 14) of all tiles' evidence, each times its samples' share of the energy it has."""
    new, before, first, second = evidence[..., [0, 3, 8, 11]].split(1, -1)  # (h, w, 1) each
    share = ((new + before) / (new + before + first + second)).nan_to_num(1)  # (h, w, 1)
    return torch.cat([share * evidence[..., :13], evidence[..., 13:]], -1).sum((0, 1), keepdim=True)


def collocation_shares(evidence: Tensor, motion: Tensor, coverage: Tensor, *, share=0.2) -> tuple[Tensor, Tensor]:
    """How samples and two results are best mixed, tile by tile, after Stoffelen's triple collocation.

    Parameters
    ----------
    evidence : (ceil(H / 8), ceil(W / 8), 14) of the frame before
    motion : (H, W, 2|3), pixels to the frame before
    coverage : (H, W), above 0 where the pixel has a history
    share : fraction of the evidence that is forgotten

    Returns
    -------
    shares (h, w, 2) of the first result against the second, and of the samples against their mixture; evidence
    (h, w, 14) at the tiles' current places
    """
    carried = (1 - share) * carry(evidence, motion, coverage)  # (h, w, 14)
    return mixture(around(carried)), carried
