"""The similarity of the surfaces of two pixels of one frame: edge-stopping weights of variance and à-trous."""

import torch
from torch import Tensor

CUT = 2.0**-64  # weights below this are zero
BACKGROUND, OUTSIDE = -1, -2  # beside the ids


def shift(image: Tensor, dx: int, dy: int, fill) -> Tensor:
    """out[y, x] = image[y + dy, x + dx], and fill outside."""
    height, width = image.shape[:2]
    out = torch.full_like(image, fill)  # (H, W, ...)
    top, bottom = max(0, -dy), min(height, height - dy)
    left, right = max(0, -dx), min(width, width - dx)
    if top < bottom and left < right:
        out[top:bottom, left:right] = image[top + dy : bottom + dy, left + dx : right + dx]
    return out


def _slope(w: Tensor, surface: Tensor, dim: int) -> Tensor:
    """The smaller in magnitude of the forward and backward differences between surfaces; 0 where there is neither."""
    dx, dy = (1, 0) if dim == 1 else (0, 1)
    slopes = []
    for sign in (1, -1):
        there = shift(w, sign * dx, sign * dy, 0)  # (H, W)
        on = shift(surface, sign * dx, sign * dy, False) & surface  # (H, W)
        slopes.append((sign * (there - w)).where(on, torch.inf))  # (H, W)
    ahead, behind = slopes
    slope = ahead.where(ahead.abs() <= behind.abs(), behind)  # (H, W)
    return slope.where(slope.isfinite(), 0)  # (H, W)


class Similarity:
    """exp(-[sigma_normal·½|n - n'|² / (1 + sigma_normal·ρ) + ez]) between pixels of one class, 0 between classes and
    outside the image."""

    def __init__(
        self,
        like: Tensor,
        *,
        depth=None,
        normal=None,
        ids=None,
        sigma_normal=128.0,
        sigma_depth=0.5,
        sigma_plane=0.05,
    ):
        height, width = like.shape[:2]
        self.sigma_normal, self.sigma_depth, self.sigma_plane = sigma_normal, sigma_depth, sigma_plane
        self.kind = torch.ones((height, width), dtype=torch.int64, device=like.device)  # (H, W)
        if ids is not None:
            self.kind = ids.to(torch.int64)  # (H, W)
        if depth is not None:
            self.kind = self.kind.where(depth.isfinite() & (depth > 0), BACKGROUND)  # (H, W)
        self.surface = self.kind != BACKGROUND  # (H, W)
        self.none = like.new_zeros(())
        self.normal = self.inverse = None
        if normal is not None:
            good = (normal.isfinite().all(-1) & self.surface)[..., None]  # (H, W, 1)
            self.normal = normal.where(good, 0)  # (H, W, 3)
            self.sharpness = sigma_normal * 0.5 / (1 + sigma_normal * self._roughness())  # (H, W)
        if depth is not None:
            self.inverse = (1 / depth).where(self.surface, 0)  # (H, W)
            self.slope = [_slope(self.inverse, self.surface, dim) for dim in (1, 0)]  # (H, W) along x, y

    def _roughness(self) -> Tensor:
        """How much normals change between pixels (H, W) but for edges and curvature: half the least of the squared
        differences to either side, and a third of that of their sum, along both axes."""
        rough = self.normal.new_zeros(self.kind.shape)  # (H, W)
        for dx, dy in ((1, 0), (0, 1)):
            sides = [shift(self.normal, sign * dx, sign * dy, 0) - self.normal for sign in (-1, 1)]  # 2 of (H, W, 3)
            same = [shift(self.kind, sign * dx, sign * dy, OUTSIDE) == self.kind for sign in (-1, 1)]  # 2 of (H, W)
            squares = [*(side.square().sum(-1) for side in sides), sum(sides).square().sum(-1) / 3]  # 3 of (H, W)
            least = torch.stack(squares).amin(0)  # (H, W)
            rough = rough + 0.5 * least.where(same[0] & same[1], 0)  # (H, W)
        return rough

    def behind(self, inverse: Tensor, dx: Tensor | float, dy: Tensor | float, reach: float) -> Tensor:
        """Distance (H, W) of points of an inverse depth, seen (dx, dy) pixels away, from each pixel's tangent plane, in
        units of what counts as one for taps up to `reach` pixels away."""
        across, along = self.slope
        plane = self.inverse + across * dx + along * dy  # (H, W)
        allowed = self.sigma_plane * self.inverse + self.sigma_depth * reach * (across.abs() + along.abs())  # (H, W)
        return ((plane - inverse).abs() / allowed).where(self.surface, 0)  # (H, W)

    def __call__(self, dx: int, dy: int, reach: int, step: int = 1) -> tuple[Tensor, Tensor]:
        """The exponent (H, W) for taps at step·(dx, dy) of a kernel that reaches step·reach pixels to the side, and the
        mask of taps that count (H, W)."""
        x, y = step * dx, step * dy
        same = shift(self.kind, x, y, OUTSIDE) == self.kind  # (H, W)
        exponent = self.none  # broadcasts to (H, W)
        if self.normal is not None:
            n = shift(self.normal, x, y, 0)  # (H, W, 3)
            exponent = exponent + self.sharpness * (self.normal - n).square().sum(-1)  # (H, W)
        if self.inverse is not None:
            exponent = exponent + self.behind(shift(self.inverse, x, y, 0), x, y, step * reach)  # (H, W)
        return exponent, same
