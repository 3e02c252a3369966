import math

import torch
from torch import Tensor

TILE = 8


def _tiles(size: tuple[int, int]) -> tuple[int, int]:
    return math.ceil(size[0] / TILE), math.ceil(size[1] / TILE)


def relative(
    color: Tensor, candidates: Tensor, motion: Tensor, coverage: Tensor, *, offset=(0, 0), exposure=1.0, usual=0
) -> tuple[Tensor, Tensor, Tensor]:
    """Candidates (H, W, K, 3) and samples (H, W, 1, 3) relative to the usual candidate's mean, and where both are known
    (H, W); 0 elsewhere."""
    size = torch.tensor(color.shape[:2])
    rows, columns = (torch.arange(count) for count in color.shape[:2])  # (H,), (W,)
    grid = torch.stack(torch.meshgrid(rows, columns, indexing="ij"), -1)  # (H, W, 2), row and column
    place = (grid + motion[..., :2].flip(-1) + 0.5).floor()  # (H, W, 2)
    known = ((place >= 0) & (place < size)).all(-1)  # (H, W)
    place = place.where(known[..., None], 0).long()  # (H, W, 2)
    known &= (place % 2 == torch.tensor([offset[1], offset[0]])).all(-1) & (coverage > 0)  # (H, W)
    row, column = (place // 2).unbind(-1)  # (H, W), (H, W)
    fetched = candidates[row, column].unflatten(-1, (-1, 3))  # (H, W, K, 3)
    known &= fetched.isfinite().all(-1).all(-1) & color.isfinite().all(-1)  # (H, W)
    shown = known[..., None, None]  # (H, W, 1, 1)
    fetched, sample = fetched.where(shown, 0), color[..., None, :].where(shown, 0)  # (H, W, K, 3), (H, W, 1, 3)
    middle = fetched[..., usual, :].mean(-1).clamp(min=0)[..., None, None]  # (H, W, 1, 1)
    unit = middle + max(exposure / 16, torch.finfo(torch.float32).tiny)  # (H, W, 1, 1)
    return (fetched - middle) / unit, ((sample - middle) / unit).clamp(-8, 8), known


def together(image: Tensor) -> Tensor:
    """Sums (h, w, C) over tiles of (H, W, C), as far as they lie in the image."""
    height, width = image.shape[:2]
    padded = torch.nn.functional.pad(image, (0, 0, 0, -width % TILE, 0, -height % TILE))  # (8h, 8w, C)
    return padded.unflatten(1, (-1, TILE)).unflatten(0, (-1, TILE)).sum((1, 3))  # (h, w, C)


def _carry(evidence: Tensor, motion: Tensor, coverage: Tensor) -> Tensor:
    """Evidence (h, w, C) from where each tile's centre comes from, between four tiles; none where that is not known."""
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


def costs(evidence: Tensor, usual: int, strictness: float) -> Tensor:
    """Of each candidate against the usual one, in squared errors (h, w, K); infinity where too little is known."""
    for axis in (0, 1):
        count = evidence.shape[axis]
        place = torch.arange(count)  # (count,)
        near = [evidence.index_select(axis, (place + d).clamp(0, count - 1)) for d in (-1, 0, 1)]  # 3 of (h, w, C)
        evidence = (near[0] + 2 * near[1] + near[2]) / 4
    steps = evidence.shape[-1] // 2
    gains, squares, n = evidence.split([steps, steps, 1], -1)  # (h, w, K - 1) twice, (h, w, 1)
    cost = torch.zeros(*n.shape[:2], steps + 1).to(n)  # (h, w, K)
    for candidate in range(steps + 1):
        between = slice(min(candidate, usual), max(candidate, usual))
        sign = 1 if candidate > usual else -1
        variance = (squares[..., between] / n / (64 / 9 * n)).sum(-1)  # (h, w)
        cost[..., candidate] = sign * (gains[..., between] / n).sum(-1) + strictness * variance.sqrt()
    cost = cost.nan_to_num(torch.inf, torch.inf, torch.inf).where(n >= 16, torch.inf)
    cost[..., usual] = 0
    return cost


def choice(
    color: Tensor,
    candidates: Tensor,
    motion: Tensor,
    coverage: Tensor,
    evidence: Tensor | None = None,
    *,
    offset=(0, 0),
    exposure=1.0,
    usual=0,
    strictness=0.5,
    share=0.1,
) -> tuple[Tensor, Tensor]:
    """Choose of a series of predictions, tile by tile, the one that predicted samples best which none of them has seen.

    The squared error of b against that of a, by a sample y whose mean is the truth: (b - a)(b + a - 2y), linear in y.

    Parameters
    ----------
    color : (H, W, 3)
    candidates : (ceil(H / 2), ceil(W / 2), 3 K) of the frame before, of one pixel of each 2×2
    motion : (H, W, 2|3), pixels to the frame before
    coverage : (H, W), above 0 where the pixel has a history
    evidence : (ceil(H / 8), ceil(W / 8), 2 K - 1) of the frame before: sums of gains, sums of their squares, number
    offset : x and y of that pixel
    exposure : of the image; a sixteenth of it counts as black
    usual : candidate that is chosen where nothing is known
    strictness : standard errors by which another must be better
    share : of the evidence that is forgotten

    Returns
    -------
    choice (h, w), evidence (h, w, 2 K - 1)
    """
    fetched = color, candidates, motion, coverage
    shown, sample, known = relative(*fetched, offset=offset, exposure=exposure, usual=usual)
    before, after = shown[..., :-1, :], shown[..., 1:, :]  # (H, W, K - 1, 3) each
    gains = ((after - before) * (after + before - 2 * sample)).mean(-1).where(known[..., None], 0)  # (H, W, K - 1)
    seen = together(torch.cat([gains, gains**2, known[..., None].to(gains)], -1))  # (h, w, 2 K - 1)
    if evidence is not None:
        seen = seen + (1 - share) * _carry(evidence, motion, coverage)  # (h, w, 2 K - 1)
    cost = costs(seen, usual, strictness)  # (h, w, K)
    least, best = cost.min(-1)  # (h, w), (h, w)
    return torch.where(least < 0, best, usual).to(color), seen


def levels(chosen: Tensor, size: tuple[int, int]) -> Tensor:
    """Between the centres of tiles (h, w), at every pixel (H, W); beyond the outermost centres the choice stays."""
    for axis, (count, pixels) in enumerate(zip(chosen.shape, size, strict=True)):
        place = ((torch.arange(pixels) + 0.5) / TILE - 0.5).clamp(0, count - 1).to(chosen)  # (H,)
        hats = (1 - (place[:, None] - torch.arange(count)).abs()).clamp(min=0)  # (H, h)
        chosen = torch.tensordot(hats, chosen, ([1], [axis])).movedim(0, axis)
    return chosen


class Choosing:
    """What remains of one frame for the next: candidates, evidence, and which pixel of each 2×2 is known."""

    def __init__(self, usual: int):
        self.usual, self.candidates, self.evidence, self.age = usual, None, None, -1

    @property
    def offset(self) -> tuple[int, int]:
        return ((1, 1), (1, 0), (0, 1), (0, 0))[self.age % 4]

    def choose(self, series: list[Tensor], fresh: Tensor, motion: Tensor, coverage: Tensor, exposure: float):
        """Mixtures (H, W, 4) of images with their variance after 0, 1, 2 … passes, and of how many (H, W)."""
        size = coverage.shape
        passes = torch.full(size, float(self.usual)).to(fresh)  # (H, W)
        if self.candidates is not None:
            known = {"offset": self.offset, "exposure": exposure, "usual": self.usual}
            chosen, self.evidence = choice(fresh, self.candidates, motion, coverage, self.evidence, **known)
            present = series[0][..., :3].isfinite().all(-1)  # (H, W)
            passes = levels(chosen, size).where(present, self.usual)  # (H, W)
        self.age += 1
        x, y = self.offset
        images = torch.cat([image[..., :3] for image in series], -1)  # (H, W, 3 K)
        odd = (0, 0, 0, size[1] % 2, 0, size[0] % 2)
        self.candidates = torch.nn.functional.pad(images, odd, value=torch.nan)[y::2, x::2]  # (h, w, 3 K)
        stack = torch.stack(series)  # (K, H, W, 4)
        shares = (1 - (passes - torch.arange(len(series))[:, None, None]).abs()).clamp(min=0)[..., None]  # (K, H, W, 1)
        return (shares * stack).where(shares > 0, 0).sum(0), passes
