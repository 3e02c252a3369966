from typing import NamedTuple

import torch
from torch import Tensor

from .exposure import exposure
from .innovation import correct, innovation
from .motion import motion_vectors
from .projection import pixel_centres, project
from .pull_push import pull_push
from .recirculate import recirculate
from .splat import splat
from .taa import hold_down

BEST = {"factor": 2, "levels": None, "nearness": 0, "history": "splat", "innovation": True}
BEST |= {"fireflies": False, "blur": 0.25, "share": (0.0, 1.0), "fade": 64.0, "limit": 8.0, "tolerance": 0.1}
TEXTBOOK = {"factor": 4, "levels": 2, "nearness": 1, "history": "fetch", "share": (0.1, 0.5), "innovation": False}


class Output(NamedTuple):
    color: Tensor
    history_length: Tensor
    confidence: Tensor
    rejection: Tensor
    missing: int


class Recirculation:
    """Full images from partly traced frames, composed of the references. Frames are as those of `SVGF`.

    Source: Lottes 2008, "Reprojection 2".
    """

    def __init__(self, preset="best", **given):
        params = BEST | (TEXTBOOK if preset == "textbook" else {}) | given
        self.pyramid = {name: params[name] for name in ("factor", "levels")}
        self.blend = {name: params[name] for name in ("share", "fade", "limit")}
        self.blur, self.tolerance, self.nearness = params["blur"], params["tolerance"], params["nearness"]
        self.fetches, self.corrects = params["history"] == "fetch", params["innovation"]
        self.fireflies = params["fireflies"]
        self.reset()

    def reset(self) -> None:
        self.points = self.camera = self.evidence = None

    def step(self, frame) -> Output:
        frame = hold_down(frame, None) if self.fireflies else frame
        height, width = frame.color.shape[:2]
        centres = pixel_centres(height, width, frame.color)  # (H, W, 2)
        own = torch.as_tensor(frame.jitter or (0, 0)).to(centres).expand_as(centres)  # (H, W, 2)
        depth = frame.depth  # (H, W)
        if frame.position is not None:
            hit = frame.position.isfinite().all(-1)  # (H, W)
            place, depth = project(frame.camera, frame.position.where(hit[..., None], 0))  # (H, W, 2), (H, W)
            depth = depth.where(hit, torch.inf)  # (H, W)
            own = torch.where(hit[..., None], place - centres, own)  # (H, W, 2)
        own = own.clamp(-0.5, 0.5)  # (H, W, 2)
        traced = frame.color.isfinite().all(-1) & (depth > 0)  # (H, W)
        drift = torch.zeros_like(frame.color)  # (H, W, 3)
        first = self.points is None
        if frame.motion is not None and not first:
            geometry = frame.depth if frame.position is None else frame.position
            still = motion_vectors(geometry, frame.camera, self.camera)  # (H, W, 3)
            channels = frame.motion.shape[-1]
            drift[..., :channels] = (frame.motion - still[..., :channels]).nan_to_num(0, 0, 0)

        samples = torch.cat([frame.color, 1 / depth[..., None], drift], -1)  # (H, W, 7)
        samples = samples.where(traced[..., None], torch.nan)  # (H, W, 7)
        filled, fresh = pull_push(samples, self._weight(samples[..., 3]), **self.pyramid)  # (H, W, 7), (H, W)
        fresh = (fresh / self._weight(filled[..., 3])).where(fresh > 0, 0)  # (H, W)
        missing = int((~traced).sum())
        sampled = samples[..., :3]  # (H, W, 3)
        if self.fetches:
            return self._fetched(filled, fresh, frame.camera, sampled, missing)

        known = torch.zeros_like(depth)  # (H, W)
        color, place, offset = drift.repeat(1, 1, 2), known, own  # (H, W, 6), (H, W), (H, W, 2)
        before = frame.camera if first else self.camera
        if not first:
            color, drifts, place, offset, known = self.points
            both = torch.cat([color, drifts], -1)  # (H, W, 6)
            given = {"offset": offset, "drift": drifts, "quality": known, "tolerance": self.tolerance, "reach": 0.5}
            color, place, offset, known = splat(both, place, frame.camera, before, **given)
        alike = ((place - depth).abs() <= self.tolerance * depth) | (place == depth)  # (H, W)
        gone = (known > 0) & traced & ~alike  # (H, W)
        rejection = torch.where(known > 0, 2 * gone, 0 if first else 1)  # (H, W)
        known = known.where(~gone, 0)  # (H, W)
        kept = known > 0  # (H, W)

        fresh = fresh.where(traced | (known <= 8 * fresh), 0)  # (H, W)
        share = torch.where(traced & kept & (place != depth), fresh / (fresh + known), 1)  # (H, W)
        met = torch.where(share < 1, place + share * (depth - place), depth)  # (H, W)
        place = torch.where(traced, met, torch.where(kept, place, 1 / filled[..., 3]))  # (H, W)
        share = torch.where(kept, fresh / (fresh + known), 1)[..., None]  # (H, W, 1)
        met = torch.where(share < 1, offset + share * (own - offset), own)  # (H, W, 2)
        offset = torch.where(traced[..., None], met, offset.where(kept[..., None], 0))  # (H, W, 2)
        drift = torch.where((kept & ~traced)[..., None], color[..., 3:], filled[..., 4:])  # (H, W, 3)
        motion = motion_vectors(place, frame.camera, before) + drift  # (H, W, 3)
        images = filled[..., :3], fresh, color[..., :3], known, motion
        carried, quality = recirculate(*images, blur=0, **self.blend)  # (H, W, 3), (H, W)
        shown, _ = recirculate(*images, blur=self.blur, **self.blend)  # (H, W, 3)
        found = self._found(sampled, shown, quality, motion)  # (H, W, 3)
        (shown, _), (carried, _) = correct(shown, found), correct(carried, found)  # (H, W, 3), (H, W, 3)
        self.points, self.camera = (carried, drift, place, offset, quality), frame.camera
        return Output(shown.nan_to_num(0, 0, 0), quality, kept.to(known), rejection, missing)

    def _weight(self, inverse: Tensor) -> Tensor:
        """Weights (H, W) by inverse depth."""
        return (inverse**self.nearness).clamp(min=1e-24)  # (H, W)

    def _found(self, sampled: Tensor, shown: Tensor, quality: Tensor, motion: Tensor) -> Tensor:
        """The estimated error (H, W, 3) of the output."""
        if self.points is None or not self.corrects:
            return torch.zeros_like(shown)  # (H, W, 3)
        known = {"evidence": self.evidence, "motion": motion, "exposure": float(exposure(shown)), "sparse": True}
        found, self.evidence = innovation(sampled, shown, quality, **known)  # (H, W, 3), (h, w, 4)
        return found

    def _fetched(self, filled: Tensor, fresh: Tensor, camera, sampled: Tensor, missing: int) -> Output:
        height, width = fresh.shape
        first = self.points is None
        before, old, known = (camera, torch.zeros_like(filled[..., :3]), torch.zeros_like(fresh))
        if not first:
            before, (old, known) = self.camera, self.points
        motion = motion_vectors(1 / filled[..., 3], camera, before) + filled[..., 4:]  # (H, W, 3)
        images = filled[..., :3], fresh, old, known, motion
        shown, quality = recirculate(*images, blur=self.blur, fetch=True, **self.blend)  # (H, W, 3), (H, W)
        shown, _ = correct(shown, self._found(sampled, shown, quality, motion))  # (H, W, 3)
        there = (pixel_centres(height, width, fresh) + motion[..., :2].nan_to_num(0)).floor().long()  # (H, W, 2)
        x, y = there.unbind(-1)  # (H, W), (H, W)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)  # (H, W)
        found = inside & (known[y.clamp(0, height - 1), x.clamp(0, width - 1)] > 0)  # (H, W)
        self.points, self.camera = (shown, quality), camera
        rejection = (~found & (not first)).long()  # (H, W)
        return Output(shown.nan_to_num(0, 0, 0), quality, found.to(known), rejection, missing)
