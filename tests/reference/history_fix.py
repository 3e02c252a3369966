import torch
from torch import Tensor

from .similarity import CUT, Similarity, shift


def fix_history(
    color: Tensor, history_length: Tensor, *, max_length=3.0, stride=14.0, margin=False, **similarity
) -> Tensor | tuple[Tensor, Tensor]:
    """Repair short history by a sparse 5x5 of similar neighbours, weighted by their history lengths.

    colour = Σ w N c / Σ w N at multiples of round(stride / (1 + N)) pixels. Source: NRD's history fix.

    Parameters
    ----------
    color : (H, W, 3)
    history_length : (H, W)
    max_length : only shorter histories are changed
    stride : pixels between the taps where the length is 0
    margin : also return the sum of the weights (H, W), infinite where history is not changed
    **similarity : depth, normal, ids and their sigmas, see `similarity.Similarity`

    Returns
    -------
    (H, W, 3)
    """
    height, width = history_length.shape
    present = color.isfinite().all(-1)  # (H, W)
    clean = color.where(present[..., None], 0)  # (H, W, 3)
    alike = Similarity(color, **similarity)
    short = history_length < max_length  # (H, W)
    steps = (stride / (1 + history_length.float()) + 0.5).floor().clamp(min=1)  # (H, W), rounded as in float32
    colors, weights = torch.zeros_like(color), torch.zeros_like(history_length)  # (H, W, 3), (H, W)
    for step in steps[short].unique().int().tolist():
        here = short & (steps == step)  # (H, W)
        for dy in range(-2, 3):
            for dx in range(-2, 3):
                x, y = step * dx, step * dy
                if abs(x) >= width or abs(y) >= height:
                    continue
                exponent, same = alike(dx, dy, 2, step)  # (H, W)
                weight = torch.exp(-exponent).where(here & same & shift(present, x, y, False), 0)  # (H, W)
                weight = weight.where(weight >= CUT, 0) * shift(history_length, x, y, 0)  # (H, W)
                colors += weight[..., None] * shift(clean, x, y, 0)  # (H, W, 3)
                weights += weight  # (H, W)
    fixed = torch.where((weights > 0)[..., None], colors / weights[..., None], color)  # (H, W, 3)
    return (fixed, weights.where(short, torch.inf)) if margin else fixed
