from collections.abc import Callable
from types import SimpleNamespace
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from .accumulate import luminance
from .alternation import alternation
from .anti_lag import anti_lag
from .blend import blend
from .blend_factor import blend_factor
from .choice import choice, compare_candidates, levels
from .collocation import collocate, collocation_shares, of_all
from .consistency import consistency
from .depth_change import depth_change
from .dilate import dilate_motion
from .edges import smooth_edges
from .exposure import exposure
from .fireflies import suppress_fireflies
from .gradient import temporal_gradient
from .innovation import correct, innovation
from .material_change import material_change
from .motion import motion_vectors
from .neighborhood import clip_history
from .reproject import reproject
from .resolve import resolve
from .similarity import shift

TEXTBOOK = {
    "dilate": "none",
    "dilate_margin": 0.0,
    "dilate_movers": True,
    "filter": "bilinear",
    "box": "minmax",
    "gamma": 1.0,
    "window": "3x3",
    "space": "rgb",
    "response": "clamp",
    "alpha": 0.05,
    "fast_alpha": 0.05,
    "speed": (2.0, 16.0),
    "unguided_alpha": 0.0,
    "guided_exposure": 0.0,
    "weighting": "none",
    "flicker": 1.0,
    "reconstruct": False,
    "relative_depth": None,
    "plane_distance": None,
    "normal_angle": None,
    "relative_albedo": None,
    "ids": False,
    "gradient": False,
    "anti_lag": 0.0,
    "alternation": False,
    "material_change": False,
    "smooth_edges": False,
    "clip_choice": False,
    "choice": False,
}
KARIS = TEXTBOOK | {
    "dilate": "cross",
    "box": "rounded",
    "space": "ycocg",
    "response": "center",
    "weighting": "tone",
    "flicker": 0.2,
    "reconstruct": True,
}
FILAMENT = TEXTBOOK | {
    "dilate": "3x3",
    "filter": "catmull-rom-5",
    "box": "intersection",
    "space": "ycocg",
    "response": "current",
    "alpha": 0.12,
    "fast_alpha": 0.12,
    "weighting": "tone",
    "reconstruct": True,
}
BEST = TEXTBOOK | {
    "dilate": "3x3",
    "dilate_margin": 0.1,
    "filter": "catmull-rom-5",
    "box": "variance",
    "space": "tonemapped-ycocg",
    "fast_alpha": 0.25,
    "speed": (0.0, 1.0),
    "reconstruct": True,
}
DENOISED = BEST | {
    "dilate_movers": False,
    "gamma": 0.75,
    "response": "center",
    "alpha": 0.1,
    "fast_alpha": 0.3,
    "guided_exposure": 16.0,
    "smooth_edges": True,
    "clip_choice": True,
    "choice": True,
    "material_change": True,
}
PRESETS = {"best": BEST, "denoised": DENOISED, "textbook": TEXTBOOK, "karis": KARIS, "filament": FILAMENT}


def find_changed(settings: dict, frame, before, motion: Tensor) -> Tensor | None:
    """Where the material has changed (H, W) since a frame with the `before` albedo; None if nothing tells."""
    if not settings["material_change"] or frame.albedo is None or before is None:
        return None
    return material_change(frame.albedo, before, motion)


def is_unguided(frame) -> bool:
    """Whether nothing but depth, if anything, tells surfaces or their texture apart."""
    return all(image is None for image in (frame.normal, frame.ids, frame.albedo))


def for_frame(settings: dict, frame) -> dict:
    """The settings for a frame, which may lack all that tells surfaces apart."""
    least = settings["unguided_alpha"]
    guided = settings["guided_exposure"]
    if not is_unguided(frame):
        return {**settings, "weighting": "local-tone", "brighter": guided} if guided > 0 else settings
    if least == 0 or (frame.depth is not None and is_thin(torch.as_tensor(frame.depth))):
        return settings
    shares = {name: max(settings[name], least) for name in ("alpha", "fast_alpha")}
    return {**settings, **shares, "weighting": "tone", "brighter": 1.0}


def is_thin(depth: Tensor) -> bool:
    """Whether more than an eighth of the pairs of neighbours differ in depth (H, W) by more than a tenth."""
    pairs = (depth[1:], depth[:-1]), (depth[:, 1:], depth[:, :-1])
    differ = [(one - other).abs() > 0.1 * torch.minimum(one, other) for one, other in pairs]
    return bool(sum(d.sum() for d in differ) > 0.125 * sum(d.numel() for d in differ))


def told_by_motion(frame, before) -> dict:
    """The argument of `reproject` for frames whose surfaces no depth tells apart."""
    known = frame.depth is None and frame.motion is not None
    known = known and before.depth is None and before.motion is not None
    return {"previous_motion": before.motion} if known and not any(map(is_erratic, (frame, before))) else {}


def parallax(frame) -> Tensor | None:
    """The frame's depth (H, W), or what stands in for it where nothing but motion tells surfaces apart."""
    others = frame.depth, frame.normal, frame.ids
    if frame.motion is None or any(image is not None for image in others) or is_erratic(frame):
        return frame.depth
    x, y = torch.as_tensor(frame.motion)[..., :2].unbind(-1)  # (H, W), (H, W)
    speed = (x * x + y * y).sqrt()  # (H, W)
    return 1 / (10 + speed.where(speed.isfinite(), 0))


def is_erratic(frame) -> bool:
    """Whether more than an eighth of the pairs of neighbours differ in motion by more than half a pixel."""
    motion = torch.as_tensor(frame.motion[..., :2])  # (H, W, 2)
    pairs = (motion[1:], motion[:-1]), (motion[:, 1:], motion[:, :-1])
    differ = [(one - other).norm(dim=-1) > 0.5 for one, other in pairs]
    return bool(sum(d.sum() for d in differ) > 0.125 * sum(d.numel() for d in differ))


def is_beside_lamps(frame, color: Tensor, bright: Tensor) -> Tensor:
    """Pixels (H, W) of lamps, the sky, and colours (H, W, 3) of six times the exposure, and their neighbours."""
    shines = (luminance(color) > 6 * bright).to(color)  # (H, W)
    if frame.emission is not None:
        shines = shines.maximum((frame.emission > 0).any(-1).to(shines))  # (H, W)
    if frame.depth is not None:
        shines = shines.maximum((~(frame.depth.isfinite() & (frame.depth > 0))).to(shines))  # (H, W)
    return max_pool2d(shines[None], 3, stride=1, padding=1)[0] > 0


class Antialiased(NamedTuple):
    history: list[Tensor]  # colour (H, W, 3) and length (H, W), and with "alternation" its memory (H, W, 7)
    confidence: Tensor
    rejection: Tensor


class Output(NamedTuple):
    color: Tensor
    history_length: Tensor
    confidence: Tensor
    rejection: Tensor
    missing: int


def antialias(
    settings: dict,
    history: list[Tensor] | None,
    color: Tensor,
    motion: Tensor,
    depth,
    still: Tensor | None = None,
    tests: dict | None = None,
    others: Tensor | None = None,
    lag: Callable | None = None,
    clip: "ClipChoice | None" = None,
) -> Antialiased:
    """Merge a colour into the history: dilate, reproject, clip, blend.

    The weight of a pixel's N-th sample is at least 1/N; N stops at 1/alpha. A temporal gradient λ first shortens N to
    N (1 - λ)^10, and raises the weight to lerp(weight, 1, λ).

    Parameters
    ----------
    history : colour (H, W, 3) and length (H, W), and with "alternation" its memory (H, W, 7)
    color : (H, W, 3)
    motion : (H, W, 2) or (H, W, 3)
    depth : (H, W), or None: then the longest motion of the neighbourhood is used
    still : (H, W, 3), the motion that the cameras cause, if it is known
    tests : of surfaces, as for `reproject`
    others : (H, W), where a denoiser found no history of the surface
    lag : for a reprojected history (H, W, 3) and its coverage (H, W), its innovation (H, W, 3), where samples were
        compared with it (H, W), and where, besides, no pixel nearby lacks history (H, W)
    clip : tells where history is not clipped
    """
    tests = tests or {}
    memory = None
    change = torch.zeros_like(color[..., 0])  # (H, W)
    if history is None:
        old, length = torch.zeros_like(color), torch.zeros_like(color[..., 0])  # (H, W, 3), (H, W)
        coverage, rejection = length, torch.zeros_like(length, dtype=torch.uint8)  # (H, W), (H, W)
    else:
        there = dilated(settings, motion, depth, still)  # (H, W, 2|3)
        (old, length), coverage = reproject(history[:2], there, filter=settings["filter"], fallback=False, **tests)
        if settings["alternation"]:
            memory, known = reproject(history[2], there, fallback=False, **tests)  # (H, W, 7), (H, W)
            memory = memory.where((known > 0)[..., None], torch.nan)  # (H, W, 7)
        rejection, _ = consistency(there, **tests)  # (H, W)
        if settings["gradient"]:
            known = old.where((coverage > 0)[..., None], torch.nan)  # (H, W, 3)
            change = temporal_gradient(color, known, noise=2.2, passes=3, widest=5)  # (H, W)
        if still is not None and not settings["dilate_movers"] and depth is not None:
            other = dilated(settings, motion, depth, None)  # (H, W, 2|3)
            found = reproject(history[:2], other, filter=settings["filter"], fallback=False, **tests)
            (moved, age), seen = found  # (H, W, 3), (H, W), (H, W)
            taken = follows(color, old, moved, seen) & ((other - there)[..., :2].abs() > 0.05).any(-1)  # (H, W)
            old, length = moved.where(taken[..., None], old), age.where(taken, length)  # (H, W, 3), (H, W)
            coverage = seen.where(taken, coverage)  # (H, W)
    if lag is not None:
        found, compared, steady = lag(old, coverage)  # (H, W, 3), (H, W), (H, W)
        nearer = correct(old, found)[0].maximum(old.minimum(color)).minimum(old.maximum(color))  # (H, W, 3)
        compared = compared & (found != 0).any(-1) & torch.cat([old, color], -1).isfinite().all(-1)  # (H, W)
        nearer = nearer.where(compared[..., None], old)  # (H, W, 3)
        moved = (luminance(nearer) - luminance(old)).abs()  # (H, W)
        steady = steady & (moved <= 0.01 * (luminance(nearer) + exposure(color) / 16))  # (H, W)
        old = nearer
    among = {name: settings[name] for name in ("box", "gamma", "window", "space", "response")}
    bright = exposure(color)
    clipped = clip_history(old, color, exposure=bright, **among)  # (H, W, 3)
    kept = []
    if settings["alternation"]:
        kept = [alternation(color, memory, exposure=bright)]  # (H, W, 7)
        hold = (kept[0][..., 6].nan_to_num() - 1).clamp(0, 1)  # (H, W)
        clipped = blend(old, clipped, hold)  # (H, W, 3)
    if clip is not None:
        clipped = clip.release(old, clipped, steady, bright)  # (H, W, 3)
    pace = {name: settings[name] for name in ("alpha", "fast_alpha", "speed")}
    length = anti_lag(length, old, clipped, strength=settings["anti_lag"])  # (H, W)
    if others is not None and history is not None:
        own = ((there - motion)[..., :2].abs() <= 0.05).all(-1)  # (H, W)
        length = shorten_others(length, old, clipped, color).where(others & own, length)  # (H, W)
    length = length * (1 - change) ** 10  # (H, W)
    counted = length + 1  # (H, W)
    if settings["alpha"] > 0:
        counted = counted.clamp(max=1 / settings["alpha"])  # (H, W)
    share = blend_factor(coverage, motion, **pace).maximum(1 / counted)  # (H, W)
    share = share + change * (1 - share)  # (H, W)
    weights = {name: settings[name] for name in ("weighting", "flicker")}
    brighter = settings.get("brighter", 1.0)  # of the tone curve
    new = blend(color, clipped, share, exposure=brighter * bright, **weights)  # (H, W, 3)
    if clip is not None:
        clip.predict(new, share)
    length = counted.where(color.isfinite().all(-1), length)  # (H, W)
    return Antialiased([new, length, *kept], coverage, rejection)


class ClipChoice:
    """Tiles of 8x8 that leave history unclipped where that has predicted the samples of earlier frames better.

    Attributes
    ----------
    predicted : (H, W, 3), luminances of the last result with the clip and without, and where its history was steady
    evidence : (h, w, 4), as `choice` takes it
    chosen : (h, w), 0 for the clip
    """

    def __init__(self):
        self.predicted = self.evidence = self.chosen = None

    def judge(self, samples: Tensor, motion: Tensor, bright: float, change: float) -> None:
        """Choose, and compare the samples (H, W, 3) with the last result, whose light has all changed by a factor."""
        if self.predicted is None:
            return
        fetched, coverage = reproject(self.predicted, motion, fallback=False)  # (H, W, 3), (H, W)
        candidates, self.settled = change * fetched[..., :2], fetched[..., 2]  # (H, W, 2), (H, W)
        if self.evidence is not None:
            _, self.evidence = choice(self.evidence, motion, coverage)  # (h, w, 4)
        fresh = samples.where((coverage > 0.9)[..., None], torch.nan)  # (H, W, 3)
        self.evidence = compare_candidates(fresh, candidates, self.evidence, exposure=bright)  # (h, w, 4)
        still, everywhere = torch.zeros_like(motion), torch.ones_like(coverage)  # (H, W, 2|3), (H, W)
        self.chosen, _ = choice(self.evidence, still, everywhere, share=0)  # (h, w)

    def release(self, old: Tensor, clipped: Tensor, steady: Tensor, bright: float) -> Tensor:
        """The history (H, W, 3) between a clipped one and one before the clip, where that is steady (H, W)."""
        apart = old - clipped  # (H, W, 3)
        most = (luminance(clipped) + bright / 16) / 4  # (H, W)
        off = luminance(apart).abs()  # (H, W)
        limit = torch.where(off > most, most / off, 1)  # (H, W)
        self.steady = steady & apart.isfinite().all(-1)  # (H, W)
        apart = (limit[..., None] * apart).where(self.steady[..., None], 0)  # (H, W, 3)
        level = torch.zeros_like(limit)  # (H, W)
        if self.chosen is not None:
            level = levels(self.chosen, level.shape) * self.settled  # (H, W)
        self.level, self.apart = level, luminance(apart)  # (H, W) twice
        return clipped + level[..., None] * apart

    def predict(self, merged: Tensor, share: Tensor) -> None:
        """Keep the luminances of a merged colour (H, W, 3) with the clip and without, for a blend factor (H, W)."""
        light, apart = luminance(merged), self.apart * (1 - share)  # (H, W) twice
        both = light - self.level * apart, light + (1 - self.level) * apart  # (H, W) twice
        self.predicted = torch.stack([*both, self.steady.to(light)], -1)  # (H, W, 3)


def shorten_others(length: Tensor, old: Tensor, clipped: Tensor, color: Tensor) -> Tensor:
    """The lengths (H, W) of a history that had to be clipped because it is another surface's.

    A new colour that is brighter than the clipped history may be the one sample that hit a lamp, and shortens less.
    """
    before, light, fresh = luminance(old), luminance(clipped), luminance(color)  # (H, W) each
    least = exposure(color) / 16
    strength = 8 * (light + least) / (fresh.where(fresh > light, light) + least)  # (H, W)
    distance = (before - light).abs() / before.abs().maximum(light.abs())  # (H, W)
    return (1 / (1 / length + strength * distance)).where(strength * distance > 0, length)


def follows(color: Tensor, still: Tensor, moved: Tensor, coverage: Tensor) -> Tensor:
    """Where history along a mover's motion is far nearer to the mean of 3×3 colours than the still scene's (H, W)."""
    window = [shift(color[..., c], dx, dy, torch.nan) for c in range(3) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    mean = torch.stack(window).unflatten(0, (3, 9)).mean(1).movedim(0, -1)  # (H, W, 3)

    def toned(image: Tensor) -> Tensor:
        return image / (luminance(image) + exposure(color))[..., None]  # (H, W, 3)

    near, far = ((toned(image) - toned(mean)).abs().sum(-1) for image in (moved, still))  # (H, W) each
    return (coverage > 0) & (near < 0.3 * far)


def dilated(settings: dict, motion: Tensor, depth: Tensor | None, still: Tensor | None) -> Tensor:
    """The motion (H, W, 2|3) by which the stage fetches."""
    if settings["dilate"] == "none":
        return motion
    among = {"window": settings["dilate"], "margin": settings["dilate_margin"]}
    if not settings["dilate_movers"] and depth is not None:
        among["still"] = still
    return dilate_motion(motion, depth, choose="longest" if depth is None else "nearest", **among)


class Mixing:
    """How much of the samples and the denoised colour each tile shows instead of the output stage's result.

    Tiles show the result where few around them ask for more than a twentieth of the samples. Where fewer than one in 8
    shows anything else, none does, and five frames are not judged.
    """

    def __init__(self):
        self.luminances = self.samples_before = self.evidence = None
        self.rest = 0

    def scale(self, change: float) -> None:
        """Multiply all light."""
        if self.luminances is not None:
            self.luminances = [image * change for image in self.luminances]  # 3 of (H, W)
        if self.samples_before is not None:
            self.samples_before = self.samples_before * change  # (H, W)

    def mix(
        self,
        samples: Tensor,
        denoised: Tensor,
        motion: Tensor,
        result: Tensor,
        shown: Tensor,
        *,
        exposure: float,
        repeats: bool,
        aliased: bool,
    ) -> Tensor:
        """The mixture (H, W, 3), of samples, denoised colour and what is shown (H, W, 3 each).

        The result (H, W, 3) is judged as it was before its edges were smoothed. If noise repeats, nothing is mixed.
        """
        if repeats:
            self.__init__()
            self.rest = 5
            return shown
        if self.rest > 0:
            self.rest -= 1
            return shown
        # No sample counts for more than eight times the result, or is shown as more than three times.
        bright = luminance(samples)  # (H, W)
        once = luminance(result).clamp(min=0) + exposure / 16  # (H, W)
        held, samples = (
            samples * torch.where(bright > times * once, times * once / bright, 1)[..., None] for times in (8, 3)
        )  # (H, W, 3) twice
        light = [luminance(image) for image in (held, denoised, result)]  # 3 of (H, W)
        shares = None
        if self.luminances is not None:
            (before, smooth, recent), coverage = fetch_all(self.luminances, motion)  # 3 of (H, W), (H, W)
            if self.evidence is not None:
                shares, self.evidence = collocation_shares(self.evidence, motion, coverage)  # (h, w, 2), (h, w, 14)
                one = of_all(self.evidence)  # (1, 1, 14)
                whole, _ = collocation_shares(one, torch.zeros(8, 8, 2).to(one), torch.ones(8, 8).to(one), share=0.0)
                many = 4 * (shares[..., 0] > 0.05).sum() >= shares[..., 0].numel()
                together = whole[0, 0, 0] >= 1 / 4 and many and not aliased
                asks = (shares[..., 1] > 0.05).to(shares)[None]  # (1, h, w)
                near = [avg_pool2d(each, 9, 1, 4, divisor_override=1)[0] for each in (asks, torch.ones_like(asks))]
                agreed = 10 * near[0] >= 3 * near[1]  # (h, w)
                if not together and 8 * agreed.sum() < agreed.numel():
                    self.__init__()
                    self.rest = 5
                    return shown
                shares = shares * torch.stack([agreed | (not aliased), agreed], -1)  # (h, w, 2)
            if self.samples_before is not None:
                (older,), _ = fetch_all([self.samples_before], motion)  # (H, W)
                planes = torch.stack([light[0], before, older, smooth, recent], -1)  # (H, W, 5)
                self.evidence = collocate(planes, self.evidence, exposure=exposure)
            self.samples_before = before
        self.luminances = light
        if shares is None:
            return shown
        first, second = (levels(each, shown.shape[:2])[..., None] for each in shares.unbind(-1))  # (H, W, 1) twice
        for share, image in ((first, denoised), (second, samples)):
            mixed = shown.lerp(image, share)  # (H, W, 3)
            shown = mixed.where(mixed.isfinite().all(-1, keepdim=True), shown)  # (H, W, 3)
        return shown


def agree(asks: Tensor) -> Tensor:
    """Where (h, w) at least 3 of 10 tiles ask, of those up to 4 tiles away along each axis."""
    counts = [
        torch.nn.functional.avg_pool2d(image[None, None].double(), 9, stride=1, padding=4, divisor_override=1)[0, 0]
        for image in (asks, torch.ones_like(asks))
    ]
    return 10 * counts[0] >= 3 * counts[1]


def fetch_all(images: list[Tensor], motion: Tensor) -> tuple[list[Tensor], Tensor]:
    """Images (H, W) of the frame before, NaN where the coverage (H, W) is 0."""
    fetched, coverage = reproject(torch.stack(images, -1), motion, fallback=False)  # (H, W, C), (H, W)
    return list(fetched.where((coverage > 0)[..., None], torch.nan).unbind(-1)), coverage


def same_surface(settings: dict, frame, before, motion: Tensor) -> dict:
    """The requested tests for which both frames have buffers, as arguments of `reproject`."""
    limits = {name: settings[name] for name in ("relative_depth", "plane_distance", "normal_angle")}
    limits = {name: limit for name, limit in limits.items() if limit is not None}
    names = ("depth", "normal", "object_normal", "ids")
    pairs = {name: (getattr(frame, name), getattr(before, name)) for name in names}
    known = {name for name, pair in pairs.items() if pair[0] is not None and pair[1] is not None}
    plane = "plane_distance" in limits and before.camera is not None and {"depth", "normal"} <= known
    plane = plane and tells_depth(frame, motion)
    asked = {"depth"} if plane or "relative_depth" in limits else set()
    asked |= {"normal"} if plane or "normal_angle" in limits else set()
    asked |= {"object_normal"} if "normal_angle" in limits else set()
    asked |= {"ids"} if settings["ids"] else set()
    tests = {"normal_angle": 180.0, **limits}
    for name in asked & known:
        tests[name], tests[f"previous_{name}"] = pairs[name]
    if settings["relative_albedo"] is not None and frame.albedo is not None and before.albedo is not None:
        tests |= {"color": frame.albedo, "previous_color": before.albedo}
        tests["relative_luminance"] = settings["relative_albedo"]
    return tests | ({"previous_camera": before.camera} if plane else {})


def find_still(frame, before) -> Tensor | None:
    """The cameras' motion, if cameras and geometry are known."""
    geometry = frame.position if frame.position is not None else frame.depth  # (H, W, 3) or (H, W)
    if geometry is None or before is None or frame.camera is None or before.camera is None:
        return None
    return motion_vectors(geometry, frame.camera, before.camera)  # (H, W, 3)


def find_motion(frame, before) -> Tensor:
    """The frame's motion; else the cameras' motion; else none.

    The cameras complete it where it is unknown, and, where both agree, by the change of depth. Without cameras, motion
    of two channels gets the change that most surfaces share, if any.
    """
    motion, still = frame.motion, find_still(frame, before)  # (H, W, 2|3), (H, W, 3)
    if motion is None:
        return torch.zeros_like(frame.color[..., :2]) if still is None else still  # (H, W, 2|3)
    if still is None:
        depths = [None if each is None else each.depth for each in (frame, before)]
        if motion.shape[-1] == 3 or None in depths or not (change := depth_change(*depths, motion)):
            return motion
        return torch.cat([motion, torch.full_like(motion[..., :1], change)], -1)  # (H, W, 3)
    if frame.position is None:
        missed = frame.depth.isposinf() | (frame.depth <= 0)  # (H, W)
    else:
        missed = ~frame.position.isfinite().all(-1)  # (H, W)
    known = motion[..., :2].isfinite().all(-1) & ~((motion[..., :2] == 0).all(-1) & missed)  # (H, W)
    filled = motion.shape[-1] == 2 or not known[::4].all()
    if motion.shape[-1] == 2:
        alike = (motion - still[..., :2]).square().sum(-1) <= 0.25  # (H, W)
        motion = torch.cat([motion, still[..., 2:].where(alike[..., None], 0)], -1)  # (H, W, 3)
    return motion.where(known[..., None], still) if filled else motion  # (H, W, 3)


def tells_depth(frame, motion: Tensor) -> bool:
    """Whether the motion has its own change of depth, not one completed from the cameras."""
    return motion.shape[-1] == 3 and (frame.motion is None or frame.motion.shape[-1] == 3)


def hold_down(frame, known: Tensor | None):
    """A frame whose colour has no fireflies, relative to the history's colour (H, W, 3)."""
    guide = {name: getattr(frame, name, None) for name in ("depth", "normal", "ids")}
    held, _ = suppress_fireflies(frame.color, expected=known, **guide)  # (H, W, 3), (H, W)
    return SimpleNamespace(**{**vars(frame), "color": held})


class TAA:
    """Temporal antialiasing, composed of the references. Frames are as those of `SVGF`.

    Sources: Karis 2014, High Quality Temporal Supersampling; Filament's TemporalAntiAliasingOptions.

    Parameters
    ----------
    preset : "best", "denoised", "textbook", "karis" or "filament"
    innovation : whether the output, not the history, is corrected by the innovation of the frame's samples
    fireflies : whether outliers of the samples are held down first
    **overrides : settings that replace the preset's
    """

    def __init__(self, preset="best", *, innovation=False, fireflies=False, **overrides):
        self.settings, self.innovation, self.fireflies = PRESETS[preset] | overrides, innovation, fireflies
        self.reset()

    def reset(self) -> None:
        self.history = self.before = self.evidence = None

    def step(self, frame) -> Output:
        motion = find_motion(frame, self.before)  # (H, W, 2|3)
        if self.fireflies:
            known = None if self.history is None else reproject(self.history[0], motion, fallback=False)[0]  # (H, W, 3)
            frame = hold_down(frame, known)
        color = frame.color  # (H, W, 3)
        if self.settings["reconstruct"] and frame.jitter is not None:
            color = resolve([color], torch.as_tensor(frame.jitter)[None], filter="blackman-harris")  # (H, W, 3)
        tests = {} if self.before is None else same_surface(self.settings, frame, self.before, motion)
        still = find_still(frame, self.before)  # (H, W, 3)
        before = getattr(self.before, "albedo", None)  # (H, W, 3)
        changed = find_changed(self.settings, frame, before, motion)  # (H, W)
        given = frame.depth, still, tests, changed
        merged = antialias(for_frame(self.settings, frame), self.history, color, motion, *given)
        self.history, confidence, rejection = merged
        shown, length = self.history[:2]  # (H, W, 3), (H, W)
        shown = shown.nan_to_num(0, 0, 0)  # (H, W, 3)
        if self.innovation and self.before is not None:
            known = {"evidence": self.evidence, "motion": motion, "exposure": exposure(color)}
            found, self.evidence = innovation(frame.color, shown, length, **known, fed_back=False)  # and (h, w, 4)
            shown, _ = correct(shown, found)  # (H, W, 3)
        if self.settings["smooth_edges"]:
            result = shown if self.innovation else self.history[0]  # (H, W, 3)
            known = None if changed is None else 1 - changed.to(color)  # (H, W)
            shown = smooth_edges(result, confidence=known, exposure=exposure(color))  # (H, W, 3)
            shown = shown.nan_to_num(0, 0, 0)  # (H, W, 3)
        self.before = frame
        missing = int((~frame.color.isfinite().all(-1)).sum())
        return Output(shown, length, confidence, rejection, missing)
