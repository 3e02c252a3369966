"""Validation: the tests by which a tap of the previous frame counts as the same surface, for reproject and consistency.

A threshold is a number or a pair (full, none) between which trust falls linearly from one to zero.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from .accumulate import luminance
from .projection import rays

OUTSIDE, DEPTH, NORMAL, ID, VELOCITY, LUMINANCE, MOTION = 1, 2, 4, 8, 16, 32, 64
NEAR = 1e-5  # of a ramp, where roundings may cross its ends


class Trust(NamedTuple):
    """A test's trust in taps (N,), and its sensitivity to rounding."""

    trust: Tensor  # 0 to 1
    slack: Tensor  # relative distance inside the threshold; near zero, another precision may reject
    steepness: Tensor  # factor by which the ramp multiplies relative roundings; 0 outside the ramp


def bounds(threshold) -> tuple[float, float]:
    full, none = threshold if isinstance(threshold, list | tuple) else (threshold, threshold)
    return full, none


def ramp(value: Tensor, full: Tensor, none: Tensor, size: Tensor) -> Trust:
    """1 for values (N,) up to full, 0 from none on, linear between; computed from numbers of magnitude (N,)."""
    between = torch.where(value < none, (none - value) / (none - full), 0)  # (N,)
    slack = ((none - value) / size).nan_to_num(-torch.inf, torch.inf, -torch.inf)  # (N,)
    near = (full < none) & (value >= full - NEAR * size) & (value <= none + NEAR * size)  # (N,)
    return Trust(torch.where(value <= full, 1, between), slack, torch.where(near, size / (none - full), 0))


class Footprint:
    """The position of each pixel's history, rounded to float32, as it decides on the taps."""

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
        """Of each of the four taps: column (P,), row (P,), weight (P,)."""
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
        return position.clamp(-9, size + 9).long()  # (P,): clamped far outside

    def flat(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Index (N,) into the flattened image, and whether it lies inside (N,)."""
        inside = (x >= 0) & (x < self.width) & (y >= 0) & (y < self.height)  # (N,)
        return y.clamp(0, self.height - 1) * self.width + x.clamp(0, self.width - 1), inside


def find_claims(motion: Tensor, previous_motion: Tensor, footprint: Footprint) -> Tensor:
    """The least difference (P,) between a pixel's previous motion (P, 2) and the motions (P, 2) that lead to it."""
    least = torch.full_like(previous_motion[:, 0], torch.inf)  # (P,)
    for x, y, weight in footprint.bilinear():
        tap, inside = footprint.flat(x, y)  # (P,)
        apart = (motion - previous_motion[tap]).norm(dim=-1)  # (P,)
        counts = inside & (weight > 0) & apart.isfinite()  # (P,)
        least.scatter_reduce_(0, tap[counts], apart[counts], "amin")
    return least.where(least.isfinite(), 0)


class SurfaceTests:
    """The tests of the taps of a footprint: speed, depth, normal, id, luminance and motion."""

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
        object_normal=None,
        previous_object_normal=None,
        color=None,
        previous_color=None,
        previous_motion=None,
        previous_camera=None,
        relative_depth=0.1,
        plane_distance=0.01,
        normal_angle=25.0,
        relative_luminance=0.5,
        speed=None,
        motion_difference=0.2,
    ):
        self.footprint, self.camera = footprint, previous_camera
        self.relative_depth, self.plane_distance = bounds(relative_depth), bounds(plane_distance)
        self.cosine = [-math.cos(math.radians(angle)) for angle in bounds(normal_angle)]
        self.relative_luminance = bounds(relative_luminance)
        flat = motion.reshape(-1, motion.shape[-1])  # (P, 2|3)
        self.speed = None if speed is None else bounds(speed)
        self.length = flat[:, :2].where(footprint.moving[:, None], 0).norm(dim=-1)  # (P,)
        self.mz = flat[:, 2] if flat.shape[1] == 3 else torch.zeros_like(flat[:, 0])  # (P,)
        self.z, self.previous_z = self._flat(depth), self._flat(previous_depth)  # (P,)
        self.previous_n = self._flat(previous_normal, 3)  # (P, 3)
        turned = (normal, previous_normal) if object_normal is None else (object_normal, previous_object_normal)
        self.turned = [self._flat(buffer, 3) for buffer in turned]  # 2 of (P, 3)
        self.ids, self.previous_ids = self._flat(ids), self._flat(previous_ids)  # (P,)
        self.colors = [self._flat(buffer, 3) for buffer in (color, previous_color)]  # 2 of (P, 3)
        self.motion, self.previous_motion = flat[:, :2], None  # (P, 2)
        self.motion_difference = bounds(motion_difference)
        if previous_motion is not None:
            self.previous_motion = self._flat(previous_motion, previous_motion.shape[-1])[:, :2]  # (P, 2)
            self.claims = find_claims(self.motion, self.previous_motion, footprint)  # (P,)

    @staticmethod
    def _flat(buffer, *channels):
        return None if buffer is None else buffer.reshape(-1, *channels)

    def __call__(self, pixel: Tensor, x: Tensor, y: Tensor) -> dict[int, Trust]:
        """By rejection bit: the trust (N,) of each pixel (N,) in its tap at column x (N,), row y (N,)."""
        tap, _ = self.footprint.flat(x, y)  # (N,)
        found = {}
        if self.speed is not None:
            full, none = self.length.new_tensor(self.speed)  # (), ()
            length = self.length[pixel]  # (N,)
            found[VELOCITY] = ramp(length, full, none, length.maximum(none))
        if self.ids is not None:
            differs = (self.ids[pixel] != self.previous_ids[tap]).to(self.length)  # (N,)
            found[ID] = ramp(differs, *differs.new_tensor([0.5, 0.5, 1]))
        if self.turned[0] is not None:
            found[NORMAL] = self._normal(self.turned[0][pixel], self.turned[1][tap])
        if self.z is not None:
            found[DEPTH] = self._depth(pixel, tap, x, y)
        if self.colors[0] is not None:
            found[LUMINANCE] = self._luminance(self.colors[0][pixel], self.colors[1][tap])
        if self.previous_motion is not None:
            found[MOTION] = self._motion(self.motion[pixel], self.previous_motion[tap], self.claims[tap])
        return found

    def _normal(self, n: Tensor, m: Tensor) -> Trust:
        """Of directions (N, 3)."""
        length = ((n * n).sum(-1) * (m * m).sum(-1)).sqrt()  # (N,)
        value = torch.where(length == 0, -torch.inf, -(n * m).sum(-1) / length)  # (N,)
        return ramp(value, *value.new_tensor([*self.cosine, 1]))

    def _luminance(self, color: Tensor, there: Tensor) -> Trust:
        """Of colours (N, 3)."""
        missing = ~(color.isfinite() & there.isfinite()).all(-1)  # (N,)
        light, before = luminance(color), luminance(there)  # (N,), (N,)
        most = torch.maximum(light.abs(), before.abs())  # (N,)
        equal = missing | (most == 0)  # (N,)
        value = torch.where(equal, -torch.inf, (light - before).abs() / most)  # (N,)
        size = torch.where(equal, 1, (luminance(color.abs()) + luminance(there.abs())) / most)  # (N,)
        return ramp(value, *value.new_tensor(self.relative_luminance), size)

    def _motion(self, own: Tensor, there: Tensor, claim: Tensor) -> Trust:
        """Of motions (N, 2) and the claims (N,) of taps."""
        unknown = ~there.isfinite().all(-1)  # (N,)
        value = torch.where(unknown, -torch.inf, (own - there).norm(dim=-1) - 2 * claim)  # (N,)
        size = (own.norm(dim=-1) + there.norm(dim=-1) + 2 * claim).maximum(value.new_tensor(1))  # (N,)
        return ramp(value, *value.new_tensor(self.motion_difference), size.where(~unknown, 1))

    def _depth(self, pixel: Tensor, tap: Tensor, x: Tensor, y: Tensor) -> Trust:
        z, there = self.z[pixel], self.previous_z[tap]  # (N,)
        z, there = (depth.where(~(depth <= 0), torch.inf) for depth in (z, there))  # (N,)
        expected = z + self.mz[pixel]  # (N,)
        size = torch.maximum(z, expected)  # (N,)
        value = (there - expected).abs()  # (N,)
        limits = z.new_tensor(self.relative_depth)  # (2,)
        if self.camera is not None:
            here = torch.stack([self.footprint.x[pixel], self.footprint.y[pixel]], -1).to(z.dtype) + 0.5  # (N, 2)
            _, ray = rays(self.camera, here)  # (N, 3)
            _, tap_ray = rays(self.camera, torch.stack([x, y], -1).to(z.dtype) + 0.5)  # (N, 3)
            between = expected[:, None] * ray - there[:, None] * tap_ray  # (N, 3)
            n = self.previous_n[tap]  # (N, 3)
            length = n.norm(dim=-1)  # (N,)
            plain = length == 0  # (N,)
            value = torch.where(plain, value, (between * n).sum(-1).abs() / length)  # (N,)
            size = torch.where(plain, size, size * ray.norm(dim=-1))  # (N,)
            limits = torch.where(plain[:, None], limits, z.new_tensor(self.plane_distance))  # (N, 2)
        both = (z == torch.inf) & (there == torch.inf)  # (N,)
        surface = (z > 0) & (there > 0) & z.isfinite() & there.isfinite() & (expected > 0)  # (N,)
        value = torch.where(both, -torch.inf, torch.where(surface, value, torch.inf))  # (N,)
        unit, size = expected.where(surface, 1), size.where(surface, 1)  # (N,), (N,)
        return ramp(value, limits[..., 0] * unit, limits[..., 1] * unit, size)
