from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from .accumulate import accumulate, luminance
from .atrous import atrous
from .choice import Choosing
from .coherence import coarse_ids, coherent_guides, incoherent_guides
from .combine import combine_histories
from .consistency import consistency
from .demodulate import demodulate, disowned, remodulate, texture_of
from .edges import smooth_edges
from .exposure import exposure
from .fireflies import suppress_fireflies
from .gradient import temporal_gradient
from .innovation import correct, innovation, weighed
from .light_change import light_change
from .repetition import Noise
from .reproject import reproject
from .taa import (
    PRESETS,
    ClipChoice,
    Mixing,
    antialias,
    find_changed,
    find_motion,
    find_still,
    for_frame,
    is_beside_lamps,
    is_unguided,
    parallax,
    tells_depth,
    told_by_motion,
)
from .variance import estimate_variance

#: Standard deviations by which the mean may exceed a prediction.
MOST = 1.5


class Output(NamedTuple):
    color: Tensor
    variance: Tensor | None
    history_length: Tensor
    confidence: Tensor
    rejection: Tensor
    missing: int
    choice: Tensor | None = None


class SVGF:
    """Spatiotemporal variance-guided filtering (Schied et al. 2017), composed of the references; without reflections.

    Frames are anything with the attributes of `yester.Frame`, the buffers as tensors (H, W, C); history of later frames
    has those of `yester.History`.
    """

    def __init__(
        self,
        *,
        alpha=0.2,
        moments_alpha=0.2,
        iterations=3,
        radius=1,
        sigma_luminance=3.0,
        relative_noise=2.5,
        tap_exposure=16.0,
        sigma_normal=64.0,
        sigma_depth=0.5,
        sigma_plane=0.05,
        relative_depth=0.1,
        plane_distance=0.01,
        normal_angle=25.0,
        motion_difference=0.2,
        relative_albedo=None,
        min_length=3.5,
        feedback=False,
        by_confidence=False,
        gradient=True,
        fireflies=False,
        choice=True,
        innovation=True,
        antialias=True,
        coherence=True,
    ):
        self.blend = {"alpha": alpha, "moments_alpha": moments_alpha}
        self.sigmas = {"sigma_normal": sigma_normal, "sigma_depth": sigma_depth, "sigma_plane": sigma_plane}
        self.filter, self.iterations = {"radius": radius, "sigma_luminance": sigma_luminance}, iterations
        self.limits = {
            "relative_depth": relative_depth,
            "plane_distance": plane_distance,
            "normal_angle": normal_angle,
            "motion_difference": motion_difference,
        }
        self.relative_noise, self.tap_exposure = relative_noise, tap_exposure
        self.min_length, self.feedback = min_length, feedback
        self.gradient, self.fireflies = gradient, fireflies
        self.chooses, self.innovation, self.antialias = choice, innovation, antialias
        self.choice_with_albedo, self.strictness, self.fewest, self.settled = True, 0.5, 2.5, 3.5
        self.coherence = coherence
        self.by_confidence, self.same_albedo = by_confidence, relative_albedo is not None
        if relative_albedo is not None:
            self.limits["relative_luminance"] = relative_albedo
        self.passes, self.stage = 3, PRESETS["denoised"] | {"unguided_alpha": 0.5, "choice": choice}
        self.reset()

    def reset(self) -> None:
        self.previous = self.antialiased = self.albedo = self.clipping = self.evidence = self.lag = self.rest = None
        self.choosing, self.mixing, self.noise = self.start_choosing(), Mixing(), Noise()
        self.repeats = False

    def start_choosing(self) -> Choosing:
        return Choosing(self.iterations, self.strictness)

    def step(self, frame, later=None) -> Output:
        self.joins = later is not None
        emission = frame.emission if frame.albedo is not None else None  # (H, W, 3)
        light = frame.color  # (H, W, 3)
        if frame.albedo is not None:
            light = demodulate(light, **texture_of(frame), emission=emission)  # (H, W, 3)
        motion, gradient, incoherent = find_motion(frame, self.previous), None, None  # (H, W, 2|3)
        still = find_still(frame, self.previous)  # (H, W, 3)
        judges = self.chooses and (self.choice_with_albedo or frame.albedo is None)
        if not judges:
            self.noise = Noise()
        self.repeats = judges and self.noise.repeats(light, motion)
        chooses, min_length = judges and not self.repeats, self.min_length
        if self.repeats:  # history counts for no more than one sample
            min_length /= self.blend["alpha"]
        if self.previous is None:
            history = [torch.zeros_like(light), torch.zeros_like(light[..., :2]), torch.zeros_like(light[..., 0])]
            confidence = torch.zeros_like(light[..., 0])  # (H, W)
            rejection = torch.zeros_like(confidence, dtype=torch.uint8)  # (H, W)
        else:
            tests = {**self._tests(frame, motion), **self.limits}
            planes = self.history  # (H, W, 3), (H, W, 2), (H, W)
            replays = self.gradient and frame.replay is not None
            if replays:
                planes = self.relight(frame.replay, planes)  # and (H, W)
            fetched, confidence = reproject(planes, motion, **tests)  # like planes, (H, W)
            rejection, _ = consistency(motion, **tests)  # (H, W)
            if self.coherence and not (frame.normal is None and frame.ids is None):
                incoherent = incoherent_guides(frame.normal, frame.ids, confidence=confidence)  # (H, W)
                others = {**tests, "normal_angle": 180.0}
                if "ids" in tests:
                    others |= {"ids": coarse_ids(frame), "previous_ids": coarse_ids(self.previous)}
                again, found = reproject(planes, motion, **others)
                shapes = [incoherent.view(*incoherent.shape, *[1] * (image.ndim - 2)) for image in again]
                fetched = [new.where(where, old) for new, where, old in zip(again, shapes, fetched, strict=True)]
                confidence = found.where(incoherent, confidence)  # (H, W)
                rejection = consistency(motion, **others)[0].where(incoherent, rejection)  # (H, W)
            history = fetched[:3]
            if self.innovation and not replays:
                history = self.follow_light(light, history, confidence)
        fresh = light  # (H, W, 3)
        if self.fireflies:
            light = self.without_fireflies(frame, light, history[0])  # (H, W, 3)
        if self.previous is not None:
            if replays:
                gradient = fetched[3]  # (H, W)
            elif self.gradient:
                known = history[0].where((confidence > 0)[..., None], torch.nan)  # (H, W, 3)
                looks = {"passes": self.passes, "widest": self.passes + 2}
                gradient = temporal_gradient(light, known, noise=2.4, **looks)  # (H, W)

        guides = frame.normal, frame.ids  # (H, W, 3), (H, W)
        if incoherent is not None:
            guides = coherent_guides(frame, incoherent)
        similarity = {"depth": self.depth(frame), "normal": guides[0], "ids": guides[1], **self.sigmas}
        missing = int((~light.isfinite().all(-1)).sum())
        light, weight = self.fill(light, history[2], similarity)  # (H, W, 3), (H, W)
        trust = confidence if self.by_confidence else None  # (H, W)
        merged = accumulate(light, *history, weight=weight, gradient=gradient, confidence=trust, **self.blend)
        color, moments, length, _ = merged  # (H, W, 3), (H, W, 2), (H, W)
        kept, prediction = [color, moments, length], None
        # Neither side counts for more samples than accumulation leaves beside a new one.
        longest = 1 / self.blend["alpha"] if self.blend["alpha"] > 0 else torch.inf
        expected = [*history[:2], self.shorten(history[2], gradient).clamp(max=longest - 1)]
        if later is not None:
            joins = later.color, later.moments, later.history_length.clamp(max=longest - 1)
            bright = exposure(color)
            expected = combine_histories(*expected, *joins, exposure=bright)
            color, moments, length = combine_histories(*kept, *joins, exposure=bright)
        if chooses:
            predicted, (first, second) = luminance(expected[0]), expected[1].unbind(-1)  # (H, W) each
            most = MOST * (second - first * first).clamp(min=0).sqrt() + 1e-3 * predicted.abs()  # (H, W)
            near = luminance(color) - predicted <= most  # (H, W)
            prediction = predicted.where(near & (expected[2] >= self.fewest), torch.nan)  # (H, W)
        variance = estimate_variance(moments, length, min_length=min_length, **similarity)  # (H, W)
        if later is not None:
            variance = variance * (longest / length).clamp(max=1)  # (H, W)
        bright, chosen = exposure(color), None

        def filtered(passes: int) -> tuple[Tensor, ...]:
            named = {"prediction": prediction, "iterations": passes, **self.filter, **similarity}
            if not self.repeats:
                noise = self.relative_noise if is_unguided(frame) else torch.inf
                named |= {"history_length": length, "relative_noise": noise}
                named |= {"tap_exposure": self.tap_exposure * bright, "settled": self.settled}
            return atrous(color, variance, **named)  # (H, W, 3), (H, W), and (H, W) if anything is predicted

        if chooses:
            series = [filtered(passes) for passes in range(min(self.iterations + 1, 16) + 1)]
            # One pass more where there is no history, but not to blur texture.
            samples = length if frame.albedo is not None else torch.full_like(length, torch.inf)  # (H, W)
            known = prediction, fresh, motion, confidence, samples, bright
            smooth, smooth_variance, chosen = self.choosing.choose(series, *known)  # (H, W, 3), (H, W), (H, W)
        else:
            smooth, smooth_variance = filtered(self.iterations)  # (H, W, 3), (H, W)
            if self.chooses:
                self.choosing, chosen = self.start_choosing(), torch.full_like(length, self.iterations)
        if self.feedback and self.iterations > 0 and later is None:
            kept[0] = filtered(1)[0]
        found = self.find_innovation(fresh, smooth, length, motion, bright)  # (H, W, 3)
        if found is not None:
            kept[:2] = correct(kept[0], found, kept[1])  # (H, W, 3), (H, W, 2)
            smooth, _ = correct(smooth, found)  # (H, W, 3)
        self.history, self.previous = kept, frame
        if frame.albedo is not None:
            smooth = remodulate(smooth, **texture_of(frame), emission=emission)  # (H, W, 3)
        if self.antialias:
            smooth = self.finish(self.stage, smooth, frame, motion, still, confidence)  # (H, W, 3)
        smooth = smooth.where(smooth.isfinite(), 0)  # (H, W, 3)
        return Output(smooth, smooth_variance, length, confidence, rejection, missing, chosen)

    def finish(
        self,
        stage: dict,
        smooth: Tensor,
        frame,
        motion: Tensor,
        still: Tensor | None,
        confidence: Tensor,
        weight: Tensor | None = None,
    ) -> Tensor:
        """The output stage (H, W, 3), which the samples correct together with its history, from the second frame on.

        `confidence` (H, W) is 0 where pixels had no history; `weight` (H, W) is as for `weighed`.
        """
        changed, self.albedo = find_changed(stage, frame, self.albedo, motion), frame.albedo  # (H, W), (H, W, 3)
        if changed is not None:
            confidence = confidence.where(~changed, 0)  # (H, W)
        before, others = self.antialiased, confidence <= 0  # [(H, W, 3), (H, W)], (H, W)
        if self.innovation and before is not None:
            change = light_change(frame.color, *reproject(before[0], motion, fallback=False))
            before = [before[0] * change, before[1]]  # (H, W, 3), (H, W)
            self.mixing.scale(change)
        stage, bright, late, clip = for_frame(stage, frame), exposure(smooth), None, None
        if self.innovation and before is not None:
            unlike = is_beside_lamps(frame, smooth, bright) | others  # (H, W)

            def late(old: Tensor, covered: Tensor) -> tuple[Tensor, Tensor]:
                (known, count), coverage = reproject(before, motion, fallback=False)  # (H, W, 3), (H, W), (H, W)
                known = known.masked_fill((unlike | (coverage <= 0.9))[..., None], torch.nan)  # (H, W, 3)
                asks = {"evidence": self.lag, "motion": motion, "exposure": bright, "strictness": 4, "share": 0.7}
                samples = weighed(frame.color, known, weight)  # (H, W, 3)
                found, self.lag = innovation(samples, known, count, target=old, **asks)  # (H, W, 3), (h, w, 4)
                compared = ~unlike & (covered > 0.9)  # (H, W)
                return found, compared, compared & ~near

            near = max_pool2d(others.to(smooth)[None, None], 5, 1, 2)[0, 0] > 0  # (H, W)
            if self.repeats:
                self.clipping = None
            elif stage["clip_choice"]:
                self.clipping = clip = self.clipping or ClipChoice()
                clip.judge(frame.color, motion, bright, change)

        given = frame.depth, still, None, others, late, clip
        (color, length), *_ = antialias(stage, before, smooth, motion, *given)  # (H, W, 3), (H, W)
        shown = color.where(color.isfinite(), 0)  # (H, W, 3)
        if self.innovation and before is not None:
            known = {
                "evidence": self.rest,
                "motion": motion,
                "exposure": bright,
                "strictness": 12,
                "share": 0.7,
            }
            fresh = weighed(frame.color, shown, weight)  # (H, W, 3)
            found, self.rest = innovation(fresh, shown, length, **known)  # (H, W, 3), (h, w, 4)
            (color, _), (shown, _) = correct(color, found), correct(shown, found)  # (H, W, 3) twice
        self.antialiased, result = [color, length], color.where(color.isfinite(), 0)  # [(H, W, 3), (H, W)], (H, W, 3)
        if stage["smooth_edges"]:
            shown = smooth_edges(color, newest=smooth, confidence=confidence, exposure=bright)  # (H, W, 3)
            shown = shown.where(shown.isfinite(), 0)  # (H, W, 3)
        if not stage["choice"]:
            return shown
        aliased = getattr(frame, "jitter", None) is not None
        kind = {"exposure": float(bright), "repeats": self.repeats, "aliased": aliased}
        return self.mixing.mix(frame.color, smooth, motion, result, shown, **kind)

    def fill(self, light: Tensor, length: Tensor, similarity: dict) -> tuple[Tensor, Tensor | None]:
        """The colour that is accumulated (H, W, 3), and its weight as a sample (H, W): here unchanged."""
        return light, None

    def follow_light(self, light: Tensor, history: list[Tensor], confidence: Tensor) -> list[Tensor]:
        """History, colour (H, W, 3), moments (H, W, 2), length (H, W) and more, times what all light changed by."""
        change = light_change(light, history[0], confidence)
        color, moments, length, *others = history
        moments = moments * torch.tensor([change, change**2]).to(moments)  # (H, W, 2)
        return [color * change, moments, length, *(image * change for image in others)]

    def shorten(self, length: Tensor, gradient: Tensor | None) -> Tensor:
        """Shorten history (H, W) whose light has changed."""
        return length if gradient is None else length * (1 - gradient.nan_to_num(0).clamp(0, 1)) ** 10

    def find_innovation(
        self, fresh: Tensor, prediction: Tensor, length: Tensor, motion: Tensor, bright: float
    ) -> Tensor | None:
        """The estimated error (H, W, 3) of a prediction, from the second frame on; keeps the evidence for the next."""
        if not self.innovation or self.previous is None:
            return None
        known = {"evidence": self.evidence, "motion": motion, "exposure": bright}
        found, self.evidence = innovation(fresh, prediction, length, **known)  # (H, W, 3), (h, w, 4)
        return found

    def relight(self, replay: Tensor, history: list[Tensor]) -> list[Tensor]:
        """History corrected by the replay's change of light (H, W, 3), and the gradient (H, W) of the remainder.

        The samples' change, relative to their local mean, is a sample of the history's: its shrunk means correct the
        history, lights (H, W, 3) and moments (H, W, 2). The remainder, at least half of the whole change, gives the
        gradient.
        """
        before = self.previous
        emission = before.emission if before.albedo is not None else None  # (H, W, 3)
        now, then = replay, before.color  # (H, W, 3)
        if before.albedo is not None:
            texture = {**texture_of(before), "emission": emission}
            now, then = (demodulate(color, **texture) for color in (now, then))  # (H, W, 3)
        looks = {"noise": 0, "passes": 2, "widest": 2}
        gradient = temporal_gradient(now, then, **looks)  # (H, W)
        if not self.innovation:
            return [*history, gradient]
        color, moments, length, *others = history  # (H, W, 3), (H, W, 2), (H, W), (H, W, 3)
        endless = torch.full_like(length, 1e30)  # (H, W)
        mean, _ = atrous(then, endless, iterations=4, radius=1)  # (H, W, 3), over 31x31 pixels
        black = max(exposure(color) / 16, torch.finfo(torch.float32).tiny)
        scale = (color.clamp(min=0) + black) / (mean.clamp(min=0) + black)  # (H, W, 3)
        fresh = color + (now - then) * scale  # (H, W, 3)
        found, _ = innovation(fresh, color, endless, exposure=exposure(color), strictness=1)  # (H, W, 3)
        corrected, moments = correct(color, found, moments)  # (H, W, 3), (H, W, 2)
        others = [correct(light, found)[0] for light in others]  # (H, W, 3)
        moved = torch.where(found == 0, 0, corrected - color)  # (H, W, 3)
        rest = temporal_gradient(now, then + moved, **looks)  # (H, W)
        return [corrected, moments, length, *others, torch.maximum(gradient / 2, rest)]

    def without_fireflies(self, frame, light: Tensor, known: Tensor) -> Tensor:
        """Suppress fireflies of light (H, W, 3), as the camera sees it, relative to the history's light (H, W, 3)."""
        alike = {"depth": self.depth(frame), "normal": frame.normal, "ids": frame.ids}
        if frame.albedo is None:
            return suppress_fireflies(light, expected=known, **alike)[0]  # (H, W, 3)
        texture = texture_of(frame)
        seen, expected = (remodulate(image, **texture) for image in (light, known))  # (H, W, 3), (H, W, 3)
        return demodulate(suppress_fireflies(seen, expected=expected, **alike)[0], **texture)  # (H, W, 3)

    def depth(self, frame) -> Tensor | None:
        return frame.depth if self.joins else parallax(frame)

    def _tests(self, frame, motion: Tensor) -> dict:
        tests = {}
        for name in ("depth", "normal", "ids", "object_normal"):
            now, before = getattr(frame, name), getattr(self.previous, name)
            if now is not None and before is not None:
                before = disowned(self.previous, frame) if name == "ids" else before
                tests |= {name: now, f"previous_{name}": before}
        tests |= told_by_motion(frame, self.previous)
        if self.same_albedo and frame.albedo is not None:
            tests |= {"color": frame.albedo, "previous_color": self.previous.albedo}
        if "depth" in tests and "normal" in tests and tells_depth(frame, motion):
            tests["previous_camera"] = self.previous.camera
        return tests
