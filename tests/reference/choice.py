import math

import torch
from torch import Tensor

from .accumulate import luminance

TILE = 8


def _tiles(size: tuple[int, int]) -> tuple[int, int]:
    return math.ceil(size[0] / TILE), math.ceil(size[1] / TILE)


def relative(color: Tensor, candidates: Tensor, *, exposure=1.0, usual=0) -> tuple[Tensor, Tensor, Tensor]:
    """Candidates (H, W, K) and the samples' luminance (H, W, 1) relative to the usual candidate, 0 outside of the mask
    (H, W) of pixels where all are known."""
    known = color.isfinite().all(-1) & candidates.isfinite().all(-1)  # (H, W)
    shown = known[..., None]  # (H, W, 1)
    candidates, sample = candidates.where(shown, 0), luminance(color)[..., None].where(shown, 0)  # (H, W, K), (H, W, 1)
    middle = candidates[..., usual, None].clamp(min=0)  # (H, W, 1)
    unit = middle + max(exposure / 16, torch.finfo(torch.float32).tiny)  # (H, W, 1)
    return (candidates - middle) / unit, ((sample - middle) / unit).clamp(-8, 8), known


def together(image: Tensor) -> Tensor:
    """Sums (h, w, C) over the tiles of (H, W, C), cut at the image's border."""
    height, width = image.shape[:2]
    padded = torch.nn.functional.pad(image, (0, 0, 0, -width % TILE, 0, -height % TILE))  # (8h, 8w, C)
    return padded.unflatten(1, (-1, TILE)).unflatten(0, (-1, TILE)).sum((1, 3))  # (h, w, C)


def carry(evidence: Tensor, motion: Tensor, coverage: Tensor) -> Tensor:
    """Evidence (h, w, C) fetched along the motion of each tile's centre, bilinear; none where motion is unknown."""
    height, width = coverage.shape
    down, right = (TILE * torch.arange(n) + TILE // 2 for n in evidence.shape[:2])  # (h,), (w,)
    down, right = down.clamp(max=height - 1), right.clamp(max=width - 1)
    motion = motion[down][:, right][..., :2].flip(-1) / TILE  # (h, w, 2), of rows and columns
    known = motion.isfinite().all(-1) & (coverage[down][:, right] > 0)  # (h, w)
    grid = torch.stack(torch.meshgrid(*map(torch.arange, evidence.shape[:2]), indexing="ij"), -1)  # (h, w, 2)
    last = torch.tensor(evidence.shape[:2]) - 1
    place = (grid + motion.where(known[..., None], 0)).clamp(min=torch.zeros_like(last), max=last)  # (h, w, 2)
    first = place.floor()  # (h, w, 2)
    carried = torch.zeros_like(evidence)  # (h, w, C)
    for dy in (0, 1):
        for dx in (0, 1):
            step = torch.tensor([dy, dx])
            weight = (1 - (place - first - step).abs()).prod(-1, keepdim=True)  # (h, w, 1)
            row, column = torch.minimum(first + step, last).long().unbind(-1)  # (h, w), (h, w)
            carried = carried + weight * evidence[row, column]  # (h, w, C)
    known &= carried.isfinite().all(-1)  # (h, w)
    return carried.where(known[..., None], 0)


def around(evidence: Tensor) -> Tensor:
    """The mean (h, w, C) over neighbouring tiles, weighted {1, 2, 1}/4 along both axes."""
    for axis in (0, 1):
        count = evidence.shape[axis]
        place = torch.arange(count)  # (count,)
        near = [evidence.index_select(axis, (place + d).clamp(0, count - 1)) for d in (-1, 0, 1)]  # 3 of (h, w, C)
        evidence = (near[0] + 2 * near[1] + near[2]) / 4
    return evidence


def costs(evidence: Tensor, usual: int, strictness: float, *, tiles: float = 64 / 9) -> Tensor:
    """Costs (h, w, K) of candidates against the usual one, as squared errors; infinite where too little is known.

    The evidence is the mean of so many tiles.
    """
    steps = evidence.shape[-1] // 2 - 1
    gains, squares, weight, n = evidence.split([steps, steps, 1, 1], -1)  # (h, w, K - 1) twice, (h, w, 1) twice
    cost = torch.zeros(*n.shape[:2], steps + 1).to(n)  # (h, w, K)
    for candidate in range(steps + 1):
        between = slice(min(candidate, usual), max(candidate, usual))
        sign = 1 if candidate > usual else -1
        variance = (squares[..., between] / weight / (tiles * weight)).sum(-1)  # (h, w)
        cost[..., candidate] = sign * (gains[..., between] / weight).sum(-1) + strictness * variance.sqrt()
    cost = cost.nan_to_num(torch.inf, torch.inf, torch.inf).where(n >= 16, torch.inf)
    cost[..., usual] = 0
    return cost


def whole(evidence: Tensor) -> Tensor:
    """The evidence (1, 1, 2 K) of a frame, as if it were one tile, of those that know enough, in units of the costs."""
    steps = evidence.shape[-1] // 2 - 1
    gains, squares, weight, n = evidence.split([steps, steps, 1, 1], -1)  # (h, w, K - 1) twice, (h, w, 1) twice
    scale = n / weight  # (h, w, 1)
    known = (n >= 16) & scale.isfinite()  # (h, w, 1)
    return torch.cat([scale * gains, scale**2 * squares, n, n], -1).where(known, 0).sum((0, 1), keepdim=True)


def best_of_frame(evidence: Tensor, usual: int, strictness: float) -> int:
    """The candidate that is best for the frame as a whole."""
    cost = costs(whole(evidence), usual, strictness, tiles=1).flatten()  # (K,)
    return int(cost.argmin()) if cost.min() < 0 else usual


def choice(
    evidence: Tensor, motion: Tensor, coverage: Tensor, *, usual=0, strictness=0.5, frame_strictness=3.0, share=0.3
) -> tuple[Tensor, Tensor]:
    """Choose of a series of predictions, tile by tile, the one that predicted the samples of earlier frames best.

    Parameters
    ----------
    evidence : (ceil(H / 8), ceil(W / 8), 2 K) of the frame before: sums of gains, squares and weights; number
    motion : (H, W, 2|3), pixels to the frame before
    coverage : (H, W), above 0 where the pixel has a history
    usual : candidate that is chosen without evidence, unless another is better for the frame
    strictness : standard errors by which another must be better
    frame_strictness : standard errors by which another must be better for the frame, to be chosen without evidence
    share : weight of the new frame: the fraction of the evidence that is forgotten

    Returns
    -------
    choice (h, w), evidence (h, w, 2 K) at the tiles' current places
    """
    carried = (1 - share) * carry(evidence, motion, coverage)  # (h, w, 2 K)
    usual = best_of_frame(carried, usual, frame_strictness)
    least, best = costs(around(carried), usual, strictness).min(-1)  # (h, w), (h, w)
    return torch.where(least < 0, best, usual).to(evidence), carried


def weights(squares: Tensor, n: Tensor) -> Tensor:
    """The weight (h, w, 1) of a frame's gains, by their sums of squares (h, w, K - 1) and their number (h, w, 1)."""
    return torch.where(n > 0, (squares.sum(-1, keepdim=True) / n + 1e-6).rsqrt(), 0)


def compare_candidates(
    color: Tensor, candidates: Tensor, evidence: Tensor | None = None, *, exposure=1.0, usual=0
) -> Tensor:
    """Compare predictions with samples that none of them has seen: adds to the evidence (h, w, 2 K).

    The squared error of b minus that of a, by a sample y whose mean is the reference: (b - a)(b + a - 2y), linear in y.
    A frame's gains weigh the less in a tile, the larger their squares.

    Parameters
    ----------
    color : (H, W, 3)
    candidates : (H, W, K), of the luminance
    evidence : (ceil(H / 8), ceil(W / 8), 2 K) of earlier frames: sums of gains, squares and weights; number
    exposure : of the image; a sixteenth of it counts as black
    usual : candidate that the others are relative to
    """
    shown, sample, known = relative(color, candidates, exposure=exposure, usual=usual)
    before, after = shown[..., :-1], shown[..., 1:]  # (H, W, K - 1) each
    gains = ((after - before) * (after + before - 2 * sample)).where(known[..., None], 0)  # (H, W, K - 1)
    seen, squares, n = (together(image) for image in (gains, gains**2, known[..., None].to(gains)))  # (h, w, …)
    weight = weights(squares, n)  # (h, w, 1)
    seen = torch.cat([weight * seen, weight**2 * squares, weight * n, n], -1)  # (h, w, 2 K)
    return seen if evidence is None else evidence + seen


def levels(chosen: Tensor, size: tuple[int, int]) -> Tensor:
    """Interpolation from tile centres (h, w) to pixels (H, W); constant beyond the outermost centres."""
    for axis, (count, pixels) in enumerate(zip(chosen.shape, size, strict=True)):
        place = ((torch.arange(pixels) + 0.5) / TILE - 0.5).clamp(0, count - 1).to(chosen)  # (H,)
        hats = (1 - (place[:, None] - torch.arange(count)).abs()).clamp(min=0)  # (H, h)
        chosen = torch.tensordot(hats, chosen, ([1], [axis])).movedim(0, axis)
    return chosen


class Choosing:
    """The state between frames: the evidence, None before the first."""

    def __init__(self, usual: int, strictness: float):
        self.usual, self.strictness, self.evidence = usual, strictness, None

    def choose(
        self,
        series: list[tuple[Tensor, Tensor, Tensor]],
        prediction: Tensor,
        fresh: Tensor,
        motion: Tensor,
        coverage: Tensor,
        length: Tensor,
        exposure: float,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Mixtures of images (H, W, 3) and of variances (H, W) after 0, 1, 2 … passes, and the number of passes (H, W).

        The third of each in the series is the prediction (H, W) after so many passes, of which the first is not used:
        where there is no prediction it is the image's own luminance. Where the length (H, W) of the history, which has
        this frame's sample, says that there is no other, one more pass is shown.
        """
        size = coverage.shape
        passes = torch.full(size, float(self.usual)).to(fresh)  # (H, W)
        if self.evidence is not None:
            known = {"usual": self.usual, "strictness": self.strictness}
            chosen, self.evidence = choice(self.evidence, motion, coverage, **known)
            present = series[0][0].isfinite().all(-1)  # (H, W)
            alone = (coverage == 0) & (length < 1.5)  # (H, W)
            shown = (levels(chosen, size) + alone).clamp(max=len(series) - 1)  # (H, W)
            passes = shown.where(present, self.usual)  # (H, W)
        candidates = torch.stack([prediction, *(predicted for _, _, predicted in series[1:])], -1)  # (H, W, K)
        known = {"exposure": exposure, "usual": self.usual}
        self.evidence = compare_candidates(fresh, candidates, self.evidence, **known)
        stack = torch.stack([torch.cat([image, rest[..., None]], -1) for image, rest, _ in series])  # (K, H, W, 4)
        shares = (1 - (passes - torch.arange(len(series))[:, None, None]).abs()).clamp(min=0)[..., None]  # (K, H, W, 1)
        mixed = (shares * stack).where(shares > 0, 0).sum(0)  # (H, W, 4)
        return mixed[..., :3], mixed[..., 3], passes
