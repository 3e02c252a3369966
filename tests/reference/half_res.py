from torch import Tensor

from .joint_bilateral import reconstruct
from .svgf import SVGF


class HalfRes(SVGF):
    """SVGF of partly traced frames: other pixels are reconstructed, and count as weight / (1 + N) of a sample."""

    def __init__(self, *, alpha=0.2, weight=0.3, radius=2, iterations=4, sigma_luminance=4.0, choice=None, **named):
        named = {"sigma_luminance": sigma_luminance, "relative_noise": 2.0, **named}
        super().__init__(alpha=alpha, iterations=iterations, radius=2, choice=choice is not False, **named)
        self.choice_with_albedo, self.strictness, self.fewest, self.settled = choice is True, 1.0, 0.9, 1.75
        self.choosing = self.start_choosing()
        self.weight, self.radius = weight, radius
        self.passes, self.stage = 4, {**self.stage, "gamma": 0.6, "choice": False}

    def fill(self, light: Tensor, length: Tensor, similarity: dict) -> tuple[Tensor, Tensor]:
        traced = light.isfinite().all(-1)  # (H, W)
        weight = (self.weight / (1 + length)).where(~traced, 1)  # (H, W)
        return reconstruct(light, radius=self.radius, **similarity), weight  # (H, W, 3), (H, W)
