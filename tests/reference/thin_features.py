import torch
from torch import Tensor

from .accumulate import luminance
from .similarity import shift


def thin_features(color: Tensor, *, similarity=1.05, margin=False) -> Tensor | tuple[Tensor, Tensor]:
    """Pixels brighter (or darker) than all dissimilar pixels of their 3x3, without a similar 2x2 around them.

    Source: FSR 2's locks. Similar is a ratio of luminances up to `similarity`; missing and outside pixels count as
    similar.

    Parameters
    ----------
    color : (H, W, 3)
    similarity : from 1
    margin : also return the relative distance (H, W) of the nearest decision from its threshold

    Returns
    -------
    thin : (H, W), 1 or 0
    """
    light = luminance(color).clamp(min=0).where(color.isfinite().all(-1), torch.nan)  # (H, W)
    alike, low, high = {}, torch.full_like(light, torch.inf), torch.full_like(light, -torch.inf)
    slack = torch.full_like(light, torch.inf)  # (H, W)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            there = shift(light, dx, dy, torch.nan)  # (H, W)
            more, less = light.maximum(there), light.minimum(there)  # (H, W), (H, W)
            differs = more > similarity * less  # (H, W)
            alike[dx, dy] = ~differs  # (H, W)
            low = low.minimum(there.where(differs, torch.inf))  # (H, W)
            high = high.maximum(there.where(differs, -torch.inf))  # (H, W)
            if dx or dy:
                slack = slack.minimum(((more - similarity * less) / more).abs().nan_to_num(torch.inf))  # (H, W)
    blocks = [alike[dx, 0] & alike[0, dy] & alike[dx, dy] for dx in (-1, 1) for dy in (-1, 1)]  # (H, W) each
    solid = torch.stack(blocks).any(0)  # (H, W)
    thin = (((light > high) | (light < low)) & ~solid & ~light.isnan()).to(light.dtype)  # (H, W)
    return (thin, slack) if margin else thin
