import math

import torch
from torch import Tensor

from .accumulate import luminance
from .similarity import CUT, Similarity, shift

#: By radius.
KERNELS = {1: (1.0, 1 / 2), 2: (1.0, 2 / 3, 1 / 6)}


def _gaussian(image: Tensor) -> Tensor:
    """3x3 gaussian of (H, W), the border replicated."""
    padded = torch.nn.functional.pad(image[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]  # (H + 2, W + 2)
    rows = padded[:-2] / 4 + padded[1:-1] / 2 + padded[2:] / 4  # (H, W + 2)
    return rows[:, :-2] / 4 + rows[:, 1:-1] / 2 + rows[:, 2:] / 4  # (H, W)


def atrous(
    color: Tensor,
    variance: Tensor,
    *,
    prediction: Tensor | None = None,
    history_length: Tensor | None = None,
    iterations=5,
    radius=2,
    sigma_luminance=4.0,
    relative_noise=2.5,
    tap_exposure=None,
    settled=3.5,
    margin=False,
    **similarity,
) -> tuple[Tensor, ...]:
    """Smooth by ever wider, edge-stopping 5x5 or 3x3 passes with holes (à trous), carrying the variance along.

    w = h·exp(-[surface + |l - l'| / (sigma_luminance·√g + 1e-3·|l|)]), colour = Σwc / Σw, variance = Σw²v / (Σw)².
    Source: Dammertz et al. 2010; Schied et al. 2017, section 4.4. l is the luminance of each pass's input, or a
    prediction of it, which becomes Σwl / Σw. √g is at most relative_noise·L/√N, with L the luminance of the unfiltered
    colour, blurred as the variance, and N samples. Of two pixels of `settled` samples or more, a tap that is brighter
    before the first pass has its weight multiplied by ((tap_exposure + l) / (tap_exposure + l'))^2.

    Parameters
    ----------
    color : (H, W, 3)
    variance : (H, W), of the luminance
    prediction : (H, W), of the luminance; where it is not finite, the colour's
    history_length : (H, W), the number of samples; without it, √g has no bound
    tap_exposure : without it, brighter taps weigh no less
    margin : also return the smallest sum of weights (H, W) of any pass
    **similarity : depth, normal, ids and their sigmas, see `similarity.Similarity`

    Returns
    -------
    color : (H, W, 3)
    variance : (H, W)
    prediction : (H, W), only if one was given; NaN where the colour is
    """
    height, width = variance.shape
    alike = Similarity(color, **similarity)
    color = color.where(color.isfinite().all(-1, keepdim=True), torch.nan)  # (H, W, 3)
    variance = variance.where(variance.isfinite(), 0)  # (H, W)
    light = luminance(color)  # (H, W), NaN where the colour is missing
    most = torch.full_like(variance, torch.inf)  # (H, W)
    if history_length is not None and relative_noise < math.inf:
        around = _gaussian(light.nan_to_num(0)).clamp(min=0)  # (H, W)
        most = relative_noise * around / history_length.nan_to_num(1).clamp(min=1).sqrt()  # (H, W)
    if prediction is not None:
        light = prediction.where(prediction.isfinite() & light.isfinite(), light)  # (H, W)
    tone = torch.full_like(variance, torch.nan)  # (H, W), NaN where brighter taps weigh no less
    if tap_exposure is not None:
        tone = (tap_exposure + light.clamp(min=0)).where(history_length >= settled, torch.nan)  # (H, W)
    least = torch.full_like(variance, torch.inf)  # (H, W)
    for i in range(iterations):
        step, kernel = 2**i, KERNELS[radius]
        finite = light.isfinite()  # (H, W)
        clean, light = color.where(finite[..., None], 0), light.where(finite, 0)  # (H, W, 3), (H, W)
        deviation = _gaussian(variance).sqrt().minimum(most)  # (H, W)
        scale = sigma_luminance * deviation + 1e-3 * light.abs() + 1e-30  # (H, W)
        colors, (variances, lights, weights) = torch.zeros_like(color), torch.zeros(3, height, width).to(color)
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                x, y = step * dx, step * dy
                if abs(x) >= width or abs(y) >= height:
                    continue
                exponent, same = alike(dx, dy, radius, step)  # (H, W)
                brighter = (light - shift(light, x, y, 0)).abs() / scale  # (H, W)
                exponent = exponent + brighter.where(finite, 0)  # (H, W)
                weight = kernel[abs(dx)] * kernel[abs(dy)] * torch.exp(-exponent)  # (H, W)
                weight = weight.where(same & shift(finite, x, y, False) & (weight >= CUT), 0)  # (H, W)
                brightness = tone / shift(tone, x, y, torch.nan)  # (H, W)
                weight = weight * torch.where(brightness < 1, brightness * brightness, 1)  # (H, W)
                colors += weight[..., None] * shift(clean, x, y, 0)  # (H, W, 3)
                variances += weight * weight * shift(variance, x, y, 0)  # (H, W)
                lights += weight * shift(light, x, y, 0)  # (H, W)
                weights += weight  # (H, W)
        least = torch.where(weights > 0, least.minimum(weights), least)  # (H, W)
        color = torch.where(weights[..., None] > 0, colors / weights[..., None], torch.nan)  # (H, W, 3)
        light = luminance(color)  # (H, W)
        if prediction is not None:
            light = torch.where(weights > 0, lights / weights, torch.nan)  # (H, W)
        variance = torch.where(weights > 0, variances / (weights * weights), 0)  # (H, W)
        variance = variance.where(variance >= 1e-30, 0)  # (H, W)
    results = (color, variance) if prediction is None else (color, variance, light)
    return (*results, least) if margin else results
