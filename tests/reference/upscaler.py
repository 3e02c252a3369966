import torch
from torch import Tensor

from .blend import blend
from .blend_factor import blend_factor
from .consistency import consistency
from .dilate import dilate_motion
from .disocclusion import disocclusion
from .exposure import exposure
from .gradient import temporal_gradient
from .neighborhood import clip_history
from .reproject import reproject
from .resample import resample
from .sharpen import sharpen
from .taa import Output, find_motion, hold_down
from .thin_features import thin_features

HIDDEN = 2  # yester.Rejection.DEPTH


class Upscaler:
    """Temporal upscaling, composed of the references. Frames are as those of `SVGF`, and may have a `reactive` mask.

    Source: FSR 2, in its parts.

    Parameters
    ----------
    scale : output pixels per input pixel, along each side
    alpha, fast_alpha, speed : as for `blend_factor`, of one sample per output pixel
    separation : as for `disocclusion`
    lifetime : of a lock, in frames
    sharpness : as for `sharpen`
    fireflies : whether outliers of the samples are held down first
    """

    def __init__(
        self,
        scale=2.0,
        *,
        alpha=0.06,
        fast_alpha=0.5,
        speed=(0.0, 1.0),
        separation=0.05,
        lifetime=16.0,
        sharpness=0.0,
        fireflies=False,
    ):
        self.scale, self.pace, self.speed = scale, {"alpha": alpha, "fast_alpha": fast_alpha, "speed": speed}, speed
        self.separation, self.lifetime, self.sharpness = separation, lifetime, sharpness
        self.fireflies = fireflies
        self.reset()

    def reset(self) -> None:
        self.history = self.before = None

    def step(self, frame) -> Output:
        height, width = frame.color.shape[:2]
        large = round(height * self.scale), round(width * self.scale)
        zoom_x, zoom_y = large[1] / width, large[0] / height
        x, y = (0.0, 0.0) if frame.jitter is None else (float(offset) for offset in frame.jitter)

        def enlarge(image: Tensor) -> Tensor:
            return resample(image, large, offset=(x, y), filter="nearest")[0]  # (h, w, ...)

        motion = find_motion(frame, self.before)  # (H, W, 2|3)
        choose = "longest" if frame.depth is None else "nearest"
        moved = enlarge(dilate_motion(motion, frame.depth, choose=choose, margin=0.1))[..., :2]  # (h, w, 2)
        moved = moved * torch.tensor([zoom_x, zoom_y], dtype=moved.dtype)  # (h, w, 2)
        hidden = moved.new_zeros(large)  # (h, w)
        if frame.depth is not None:
            hidden = enlarge(disocclusion(frame.depth, motion, separation=self.separation))  # (h, w)
        reactive = getattr(frame, "reactive", None)  # (H, W)
        reacts = hidden * 0 if reactive is None else enlarge(reactive).nan_to_num(0).clamp(0, 1)  # (h, w)

        history, samples = moved.new_zeros((*large, 3)), moved.new_zeros(large)  # (h, w, 3), (h, w)
        lock, coverage, rejection = samples, samples, torch.zeros_like(samples, dtype=torch.uint8)  # (h, w) each
        if self.history is not None:
            (history, samples, lock), coverage = reproject(self.history, moved, filter="catmull-rom-5", fallback=False)
            rejection, _ = consistency(moved)  # (h, w)
        there, _ = resample(history, (height, width), offset=(-x * zoom_x, -y * zoom_y), filter="nearest")  # (H, W, 3)
        if self.fireflies:
            frame = hold_down(frame, there)
        color, weight = resample(frame.color, large, offset=(x, y))  # (h, w, 3), (h, w)
        thin = enlarge(thin_features(frame.color))  # (h, w)
        change, around = (
            enlarge(temporal_gradient(frame.color, there, noise=2.2, passes=passes, widest=passes)) for passes in (1, 3)
        )  # (h, w) each
        bright = exposure(frame.color)
        clipped = clip_history(history, color, exposure=bright, space="tonemapped-ycocg", response="clamp")  # (h, w, 3)

        confidence = coverage * (1 - hidden) * (1 - reacts)  # (h, w)
        haste = blend_factor(torch.ones_like(samples), moved, alpha=0.0, fast_alpha=1.0, speed=self.speed)  # (h, w)
        lock = lock * (1 - (4 * around - 1).clamp(0, 1))  # (h, w)
        hold = ((1 - (4 * change).clamp(max=1)) * (1 - haste)).maximum(lock)  # (h, w)
        held = blend(history, clipped, hold)  # (h, w, 3)
        new = weight.where(color.isfinite().all(-1), 0)  # (h, w)
        samples = samples.minimum(1 / blend_factor(confidence, moved, **self.pace) - 1)  # (h, w)
        share = torch.where(samples > 0, new / (samples + new), 1)  # (h, w)
        lock = (lock * confidence - 1 / self.lifetime).maximum(thin * weight.clamp(max=1))  # (h, w)
        self.history = [blend(color, held, share), samples + new, lock]
        self.before = frame
        shown = sharpen(self.history[0], strength=self.sharpness, exposure=bright)  # (h, w, 3)
        rejection = rejection | (HIDDEN * (hidden > 0)).to(rejection.dtype)  # (h, w)
        missing = int((~frame.color.isfinite().all(-1)).sum())
        return Output(shown, samples + new, confidence, rejection, missing)
