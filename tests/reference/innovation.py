import torch
from torch import Tensor

from .accumulate import luminance


def _together(image: Tensor) -> Tensor:
    """Sums (h, w, C) over 2×2 blocks of (H, W, C), cut at the image's border."""
    height, width = image.shape[:2]
    padded = torch.nn.functional.pad(image, (0, 0, 0, width % 2, 0, height % 2))  # (2h, 2w, C)
    return padded.unflatten(1, (-1, 2)).unflatten(0, (-1, 2)).sum((1, 3))  # (h, w, C)


def _coarser(image: Tensor, *, squared=False) -> Tensor:
    """Means (h, w, C) of 2×2 blocks of (H, W, C), or variances of these means, by squared weights.

    At odd sizes the last row and column are averaged alone.
    """
    for axis in (0, 1):
        last = image.shape[axis] - 1
        first = torch.arange(0, last + 1, 2)  # (h,)
        weight = torch.where(first < last, 0.5, 1.0).to(image)  # (h,)
        weights = [weight, 1 - weight]
        pairs = [image.index_select(axis, i.clamp(max=last)) for i in (first, first + 1)]  # 2 of (h, W, C)
        shape = [-1 if i == axis else 1 for i in range(3)]
        weights = [(w**2 if squared else w).view(shape) for w in weights]  # 2 of (h, 1, 1)
        image = weights[0] * pairs[0] + weights[1] * pairs[1]
    return image


def _finer(image: Tensor, size: tuple[int, int]) -> Tensor:
    """Bilinear interpolation of (h, w, C) at centres half as far apart (H, W, C): weights 3/4 and 1/4."""
    for axis, count in enumerate(size):
        place = torch.arange(count)  # (H,)
        own = place // 2  # (H,)
        other = (own + 2 * (place % 2) - 1).clamp(0, image.shape[axis] - 1)  # (H,)
        image = 0.75 * image.index_select(axis, own) + 0.25 * image.index_select(axis, other)
    return image


def _blur(image: Tensor, *, squared=False) -> Tensor:
    """{1, 2, 1}/4 along both axes of (h, w, C), borders replicated; or its variances, by squared weights."""
    for axis in (0, 1):
        count = image.shape[axis]
        weights = torch.zeros(count, count).to(image)  # of the new place (row) by the old (column)
        for offset, weight in ((-1, 0.25), (0, 0.5), (1, 0.25)):
            place = torch.arange(count)  # (count,)
            weights[place, (place + offset).clamp(0, count - 1)] += weight  # a border's weights are added
        image = torch.tensordot(weights**2 if squared else weights, image, ([1], [axis])).movedim(0, axis)  # (h, w, C)
    return image


def around(prediction: Tensor) -> Tensor:
    """Mean light of 4×4 blocks of (H, W, 3), cut at the image's border, interpolated bilinearly."""
    functional = torch.nn.functional
    light = prediction.where(prediction.isfinite().all(-1, keepdim=True), 0).clamp(min=0)  # (H, W, 3)
    blocks = functional.avg_pool2d(light.movedim(-1, 0), 4, ceil_mode=True)  # (3, h, w)
    wide = functional.interpolate(blocks[None], scale_factor=4, mode="bilinear")[0].movedim(0, -1)  # (4h, 4w, 3)
    return wide[: light.shape[0], : light.shape[1]]


def _fetch(evidence: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
    """Evidence (h, w, 4) of the block nearest to each one's previous place; 0, and False (h, w), outside."""
    size = torch.tensor(evidence.shape[:2])
    rows, columns = (torch.arange(count) for count in evidence.shape[:2])  # (h,), (w,)
    grid = torch.stack(torch.meshgrid(rows, columns, indexing="ij"), -1)  # (h, w, 2), row and column
    place = (grid + motion.flip(-1) + 0.5).floor()  # (h, w, 2)
    known = ((place >= 0) & (place < size)).all(-1)  # (h, w)
    row, column = place.where(known[..., None], 0).long().unbind(-1)  # (h, w), (h, w)
    fetched = evidence[row, column]  # (h, w, 4)
    known &= fetched.isfinite().all(-1)  # (h, w)
    return fetched.where(known[..., None], 0), known


def innovation(
    color: Tensor,
    prediction: Tensor,
    history_length: Tensor,
    evidence: Tensor | None = None,
    motion: Tensor | None = None,
    *,
    exposure=1.0,
    strictness=3.0,
    share=0.5,
    levels=6,
    fed_back=True,
    sparse=False,
    target: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Estimate the error of a prediction from samples that it has not seen: shrunk means of their relative difference.

    From the coarsest blocks to the finest, the blurred mean b of the remainder of coarser ones is multiplied by max(0,
    1 - strictness · variance / |b|²). Sources: James and Stein 1961 (shrinkage of a mean); Donoho and Johnstone 1994
    (shrinkage scale by scale).

    Parameters
    ----------
    color, prediction : (H, W, 3)
    history_length : (H, W), number of samples
    evidence : (h, w, 4) of the frame before, of blocks of 2×2 pixels: mean difference, and its variance
    motion : (H, W, 2|3), pixels to the frame before
    exposure : of the image; a sixteenth of it counts as black
    strictness : variances that a squared mean must exceed
    share : weight of the new frame in the evidence
    levels : number of block sizes
    fed_back : whether the next prediction will be corrected as well
    sparse : whether few pixels are sampled: differences are relative to the light around, evidence waits for samples
    target : (H, W, 3), the image that is corrected, if it is not the prediction

    Returns
    -------
    correction (H, W, 3), evidence (h, w, 4)
    """
    black = max(exposure / 16, torch.finfo(torch.float32).tiny)
    light = prediction.nan_to_num(0, 0, 0).clamp(min=0) + black  # (H, W, 3)
    present = (color.isfinite() & prediction.isfinite()).all(-1, keepdim=True)  # (H, W, 1)
    unit = around(prediction) + black if sparse else light  # (H, W, 3)
    relative = ((color - prediction) / unit).clamp(-50, 50).where(present, 0)  # (H, W, 3)
    length = history_length.nan_to_num(1, torch.inf, 1).clamp(min=1)[..., None]  # (H, W, 1)
    squares = (relative**2).sum(-1, keepdim=True) * (1 + 4 / length**2)  # (H, W, 1)

    pixels, samples = _together(torch.ones_like(length)), _together(present.to(length))  # (h, w, 1), (h, w, 1)
    seen = _together(relative) / samples.clamp(min=1)  # (h, w, 3)
    noise = _together(squares) / samples.clamp(min=1) ** 2  # (h, w, 1)
    if evidence is None:
        old, known = torch.zeros_like(noise).expand(-1, -1, 4), torch.zeros_like(noise)  # (h, w, 4), (h, w, 1)
    else:
        motion = torch.zeros_like(color) if motion is None else motion  # (H, W, 2|3)
        old, found = _fetch(evidence, _together(motion[..., :2]) / pixels / 2)  # (h, w, 4), (h, w)
        known = found[..., None].to(noise)  # (h, w, 1)
    trust = known * _together((length - 1).clamp(max=1)) / pixels  # (h, w, 1)
    w = trust * torch.where(samples > 0, 1 - share, 1)  # (h, w, 1)
    if sparse:
        w = w.where((samples > 0) | (trust == 0), 1)  # (h, w, 1)
    mean = (1 - w) * seen + w * old[..., :3]  # (h, w, 3)
    variance = (1 - w) ** 2 * noise + w**2 * old[..., 3:]  # (h, w, 1)
    some = ((samples > 0) | (w > 0)).to(mean)  # (h, w, 1), 1 where known

    pyramid = [(mean, variance, some)]  # (h, w, 3), (h, w, 1) and (h, w, 1), halved from level to level
    for _ in range(1, levels):
        means, variances, counts = pyramid[-1]
        share_known = _coarser(counts)  # (h, w, 1)
        per = 1 / share_known.clamp(min=1 / 4)  # (h, w, 1)
        means, variances = _coarser(means * counts) * per, _coarser(variances * counts, squared=True) * per**2
        pyramid.append((means, variances, (share_known > 0).to(mean)))
    found = torch.zeros(1, 1, 3).to(mean)  # of the level below: (h, w, 3)
    for level in range(levels, 0, -1):
        means, variances, counts = pyramid[level - 1]  # (h, w, 3), (h, w, 1), (h, w, 1)
        if level < levels:
            found = _finer(found, means.shape[:2])  # (h, w, 3)
        per = 1 / _blur(counts).clamp(min=1 / 16)  # (h, w, 1)
        b = _blur((means - found) * counts) * per  # (h, w, 3)
        v = _blur(variances * counts, squared=True) * per**2  # (h, w, 1)
        square = (b**2).sum(-1, keepdim=True).clamp(min=1e-12)  # (h, w, 1)
        found = found + (1 - strictness * v / square).clamp(min=0) * b  # (h, w, 3)
    if target is not None:
        light = target.nan_to_num(0, 0, 0).clamp(min=0) + black  # (H, W, 3)
    correction = _finer(found, color.shape[:2]) * light  # (H, W, 3)
    left = (mean - found if fed_back else mean).where(some > 0, 0)  # (h, w, 3)
    return correction, torch.cat([left, variance.where(some > 0, torch.nan)], -1)


def weighed(color: Tensor, prediction: Tensor, weight: Tensor | None) -> Tensor:
    """New samples (H, W, 3) of which each counts for its weight (H, W); all alike without weights."""
    return color if weight is None else prediction + weight[..., None] * (color - prediction)


def correct(light: Tensor, found: Tensor, moments: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
    """Light (H, W, 3) plus the correction, not below black where there is one; moments (H, W, 2) move with it."""
    corrected = torch.where(found == 0, light, (light + found).clamp(min=0))  # (H, W, 3)
    if moments is not None:
        moved, first = luminance(corrected - light), moments[..., 0]  # (H, W), (H, W)
        moments = moments + torch.stack([moved, moved * (2 * first + moved)], -1)  # (H, W, 2)
    return corrected, moments
