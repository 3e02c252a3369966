import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .accumulate import accumulate, luminance
from .blend import blend
from .consistency import consistency
from .demodulate import demodulate, remodulate, texture_of
from .exposure import exposure
from .gradient import temporal_gradient
from .innovation import correct, weighed
from .neighborhood import clip_history
from .regress import regress
from .reproject import reproject
from .restore import restore_detail
from .svgf import SVGF, Output
from .taa import PRESETS, find_motion, find_still

OFFSETS = [(0, 0), (4, 4), (2, 6), (6, 2), (1, 3), (5, 7), (3, 1), (7, 5)]


def by_light(color: Tensor, *, textured: bool) -> Tensor:
    """The weights of bright light in a fit, (H, W, 3) to (H, W)."""
    light = luminance(color)  # (H, W)
    seen = (light >= 0) & light.isfinite()  # (H, W)
    both = torch.stack([light.where(seen, 0), seen.to(light)])  # (2, H, W)
    total, count = avg_pool2d(both, 3, 1, 1)  # (H, W), (H, W)
    mean = total / count.clamp(min=1 / 9)  # (H, W)
    times = mean / exposure(color)  # (H, W)
    return (1 + ((times / 16) ** 2 if textured else times / 2)) ** -2


class BMFR(SVGF):
    """Block-wise multi-order feature regression (Koskela et al. 2019), composed of the references."""

    def __init__(self, *, fitted_alpha=0.1, block=None, by_light=True, features="fewest", restore=True, **named):
        super().__init__(**{"alpha": 0.05, **named})
        self.fitted_alpha, self.features, self.restore = fitted_alpha, features, restore
        self.block, self.by_light = block, by_light
        self.age = 0

    def depth(self, frame) -> Tensor | None:
        return frame.depth

    def step(self, frame) -> Output:
        light = frame.color  # (H, W, 3)
        emission = frame.emission if frame.albedo is not None else None  # (H, W, 3)
        if frame.albedo is not None:
            light = demodulate(light, **texture_of(frame), emission=emission)  # (H, W, 3)
        motion, gradient = find_motion(frame, self.previous), None  # (H, W, 2|3)
        still = find_still(frame, self.previous)  # (H, W, 3)
        self.repeats = (self.antialias or self.restore) and self.noise.repeats(light, motion)
        if self.previous is None:
            flat = torch.zeros_like(light[..., 0])  # (H, W)
            history = [torch.zeros_like(light), torch.zeros_like(light[..., :2]), flat, torch.zeros_like(light)]
            confidence, rejection = flat, flat.to(torch.uint8)  # (H, W), (H, W)
        else:
            tests = {**self._tests(frame, motion), **self.limits}
            planes = self.history  # (H, W, 3), (H, W, 2), (H, W), (H, W, 3)
            replays = self.gradient and frame.replay is not None
            if replays:
                planes = self.relight(frame.replay, planes)  # and (H, W)
            history, confidence = reproject(planes, motion, **tests)  # like planes, (H, W)
            rejection, _ = consistency(motion, **tests)  # (H, W)
            if self.innovation and not replays:
                history = self.follow_light(light, history, confidence)
        fresh = light  # (H, W, 3)
        if self.fireflies:
            light = self.without_fireflies(frame, light, history[0])  # (H, W, 3)
        if self.previous is not None:
            if replays:
                gradient = history[4]  # (H, W)
            elif self.gradient:
                known = history[0].where((confidence > 0)[..., None], torch.nan)  # (H, W, 3)
                gradient = temporal_gradient(light, known, noise=2.2, widest=5)  # (H, W)
        trust = confidence if self.by_confidence else None  # (H, W)
        merged = accumulate(light, *history[:3], gradient=gradient, confidence=trust, **self.blend)
        color, moments, length, missing = merged  # (H, W, 3), (H, W, 2), (H, W)

        geometry = frame.position  # (H, W, 3)
        if geometry is None and frame.camera is not None:
            geometry = frame.depth  # (H, W)
        x, y = OFFSETS[self.age % len(OFFSETS)]
        bright = by_light(color, textured=frame.albedo is not None) if self.by_light else None  # (H, W)
        weight = bright  # (H, W)
        if frame.albedo is not None:
            square = moments[..., 0] ** 2  # (H, W)
            noisy = moments[..., 1] - square > 0.01 * square  # (H, W)
            if emission is not None:
                noisy &= ~(emission > 0).any(-1)
            fitted = noisy | (frame.albedo > 1 / 1024).any(-1)  # (H, W)
            magnified = luminance(demodulate(torch.ones_like(color), **texture_of(frame)))  # (H, W)
            dark = (0.15 * magnified).clamp(min=1) ** -2  # (H, W)
            weight = (dark if bright is None else dark * bright).where(fitted, torch.nan)  # (H, W)
        side = self.block or (8 if frame.albedo is None else 16)
        blocks = {"block": side, "offset": (x * side // 8, y * side // 8), "features": self.features}
        surface = {"normal": frame.normal, "geometry": geometry, "camera": frame.camera, "weight": weight}
        fitted, _ = regress(color, **surface, **blocks)  # (H, W, 3)
        share = (1 / length).clamp(self.fitted_alpha, 1)  # (H, W)
        smooth = blend(fitted, history[3], share)  # (H, W, 3)
        shown = smooth  # (H, W, 3)
        if self.restore and not self.repeats:
            clipped = clip_history(color, fresh, box="minmax", space="rgb", response="clamp")  # (H, W, 3)
            if bright is not None:
                bound = fresh.where(fresh > smooth, smooth)  # (H, W, 3)
                toned = 1 + (bright[..., None] ** -0.5 - 1) / 8  # (H, W, 1)
                held = bound + (clipped - bound) / toned**2  # (H, W, 3)
                clipped = held.where((clipped > bound) & held.isfinite(), clipped)  # (H, W, 3)
            variance = (moments[..., 1] - moments[..., 0] ** 2).clamp(min=0) / length  # (H, W)
            variance = variance.where(length >= 3.5, torch.nan)  # (H, W)
            shown = restore_detail(smooth, clipped, variance, strictness=0.7)  # (H, W, 3)
        counts = weighed(fresh, shown, bright)  # (H, W, 3)
        found = self.find_innovation(counts, shown, length, motion, exposure(color))  # (H, W, 3)
        if found is not None:
            grown = found.where((length >= 3.5)[..., None], 0)  # (H, W, 3)
            color, moments = correct(color, grown, moments)  # (H, W, 3), (H, W, 2)
            shown, _ = correct(shown, found)  # (H, W, 3)
            smooth, _ = correct(smooth, found)  # (H, W, 3)
        self.history, self.previous = [color, moments, length, smooth], frame
        self.age += 1
        if frame.albedo is not None:
            shown = remodulate(shown, **texture_of(frame), emission=emission)  # (H, W, 3)
        if self.antialias:
            shown = self.finish(PRESETS["denoised"], shown, frame, motion, still, confidence, bright)
        shown = shown.where(shown.isfinite(), 0)  # (H, W, 3)
        return Output(shown, None, length, confidence, rejection, missing)
