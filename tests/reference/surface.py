"""The tests by which a pixel of the previous frame counts as the same surface; shared by reproject and consistency.

Each test yields a slack: how far inside its threshold a tap lies, relative to the numbers compared. Negative or NaN
means rejected; a slack near zero is where another precision may decide otherwise.
"""

import math

import torch
from torch import Tensor

from .projection import rays

OUTSIDE, DEPTH, NORMAL, ID = 1, 2, 4, 8


class Footprint:
    """Where each pixel's history lies. Positions are rounded as in float32: they decide which taps there are."""

    def __init__(self, motion: Tensor):
        self.height, self.width = motion.shape[:2]
        flat = motion.reshape(self.height * self.width, -1)  # (P, 2|3)
        self.moving = flat.isfinite().all(-1)  # (P,)
        pixel = torch.arange(len(flat), device=flat.device)  # (P,)
        still = flat.where(self.moving[:, None], 0).float()  # (P, 2|3)
        self.x = (pixel % self.width).float() + still[:, 0]  # (P,)
        self.y = (pixel // self.width).float() + still[:, 1]  # (P,)
        self.dtype = motion.dtype

    def bilinear(self):
        """Four times: tap column (P,), row (P,), weight (P,)."""
        x0, y0 = self.x.floor(), self.y.floor()  # (P,)
        fx, fy = (self.x - x0).to(self.dtype), (self.y - y0).to(self.dtype)  # (P,)
        for dy, wy in ((0, 1 - fy), (1, fy)):
            for dx, wx in ((0, 1 - fx), (1, fx)):
                yield self._index(x0, self.width) + dx, self._index(y0, self.height) + dy, (wx * wy) * self.moving

    def nearest(self) -> tuple[Tensor, Tensor]:
        """Column and row (P,) of the pixel at floor(p + ½)."""
        return self._index((self.x + 0.5).floor(), self.width), self._index((self.y + 0.5).floor(), self.height)

    @staticmethod
    def _index(position: Tensor, size: int) -> Tensor:
        return position.clamp(-9, size + 9).long()  # (P,): far away is far away

    def flat(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Index (N,) into the flattened image, and whether it lies inside (N,)."""
        inside = (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)  # (N,)
        return y.clamp(0, self.height - 1) * self.width + x.clamp(0, self.width - 1), inside


class SurfaceTests:
    """Depth, normal and id tests of the taps of a footprint."""

    def __init__(
        self,
        motion: Tensor,
        footprint: Footprint,
        *,
        depth=None,
        previous_depth=None,
        normal=None,
        previous_normal=None,
        ids=None,
        previous_ids=None,
        previous_camera=None,
        relative_depth=0.1,
        plane_distance=0.01,
        normal_angle=25.0,
    ):
        self.footprint, self.camera = footprint, previous_camera
        self.relative_depth, self.plane_distance = relative_depth, plane_distance
        self.cosine = math.cos(math.radians(normal_angle))
        flat = motion.reshape(-1, motion.shape[-1])  # (P, 2|3)
        self.mz = flat[:, 2] if flat.shape[1] == 3 else torch.zeros_like(flat[:, 0])  # (P,)
        self.z, self.previous_z = self._flat(depth), self._flat(previous_depth)  # (P,)
        self.n, self.previous_n = self._flat(normal, 3), self._flat(previous_normal, 3)  # (P, 3)
        self.ids, self.previous_ids = self._flat(ids), self._flat(previous_ids)  # (P,)

    @staticmethod
    def _flat(buffer, *channels):
        return None if buffer is None else buffer.reshape(-1, *channels)

    def slacks(self, pixel: Tensor, x: Tensor, y: Tensor) -> dict[int, Tensor]:
        """By rejection bit, the slack (N,) of the tap in column x (N,), row y (N,) seen from pixel (N,)."""
        tap, _ = self.footprint.flat(x, y)  # (N,)
        found = {}
        if self.ids is not None:
            found[ID] = torch.where(self.ids[pixel] == self.previous_ids[tap], torch.inf, -torch.inf)  # (N,)
        if self.n is not None:
            n, m = self.n[pixel], self.previous_n[tap]  # (N, 3)
            length = ((n * n).sum(-1) * (m * m).sum(-1)).sqrt()  # (N,)
            cosine = (n * m).sum(-1) / length  # (N,)
            found[NORMAL] = torch.where(length == 0, torch.inf, cosine - self.cosine)  # (N,)
        if self.z is not None:
            found[DEPTH] = self._depth(pixel, tap, x, y)  # (N,)
        return {bit: slack.nan_to_num(-torch.inf, torch.inf, -torch.inf) for bit, slack in found.items()}

    def _depth(self, pixel: Tensor, tap: Tensor, x: Tensor, y: Tensor) -> Tensor:
        z, there = self.z[pixel], self.previous_z[tap]  # (N,)
        expected = z + self.mz[pixel]  # (N,)
        size = torch.maximum(z, expected)  # (N,)
        slack = (self.relative_depth * expected - (there - expected).abs()) / size  # (N,)
        if self.camera is not None:
            here = torch.stack([self.footprint.x[pixel], self.footprint.y[pixel]], -1).to(z.dtype) + 0.5  # (N, 2)
            _, ray = rays(self.camera, here)  # (N, 3)
            _, tap_ray = rays(self.camera, torch.stack([x, y], -1).to(z.dtype) + 0.5)  # (N, 3)
            between = expected[:, None] * ray - there[:, None] * tap_ray  # (N, 3)
            n = self.previous_n[tap]  # (N, 3)
            length = n.norm(dim=-1)  # (N,)
            distance = (between * n).sum(-1).abs() / length  # (N,)
            extent = size * ray.norm(dim=-1)  # (N,)
            slack = torch.where(length == 0, slack, (self.plane_distance * expected - distance) / extent)  # (N,)
        nothing = (z > 0) & (there > 0) & z.isfinite() & there.isfinite() & (expected > 0)  # (N,)
        both = (z == torch.inf) & (there == torch.inf)  # (N,)
        return torch.where(both, torch.inf, torch.where(nothing, slack, -torch.inf))  # (N,)
