import torch
from torch import Tensor

from .accumulate import luminance


def combine_histories(
    color: Tensor,
    moments: Tensor,
    history_length: Tensor,
    other_color: Tensor,
    other_moments: Tensor,
    other_length: Tensor,
    *,
    gradient: Tensor | None = None,
    exposure: float | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Combine two independent histories of the same pixels: N'' = N + N', c + N'/N'' (c' - c), moments likewise.

    Each is a mean over its samples. A gradient λ first shortens the second one to N' (1 - λ)^10. A history whose colour
    or length is not finite has no samples; a mean of moments that is not finite is the first's, or else the second's.

    Parameters
    ----------
    color, other_color : (H, W, 3)
    moments, other_moments : (H, W, 2), means of luminance and of its square
    history_length, other_length : (H, W), number of samples
    gradient : (H, W), 0 to 1
    exposure : if given, spikes of one history are held to 8 times the other one's light, a sixteenth of it at least

    Returns
    -------
    color, moments, history_length; NaN, NaN and 0 where neither has samples
    """
    if gradient is not None:
        other_length = other_length * (1 - gradient.nan_to_num(0).clamp(0, 1)) ** 10  # (H, W)
    if exposure is not None:
        sides = (color, moments, history_length), (other_color, other_moments, other_length)
        (color, moments), (other_color, other_moments) = (
            held(own, other, exposure / 16) for own, other in (sides, sides[::-1])
        )
    first, second = torch.cat([color, moments], -1), torch.cat([other_color, other_moments], -1)  # (H, W, 5) each
    lengths = []
    for values, length in ((first, history_length), (second, other_length)):
        known = values[..., :3].isfinite().all(-1) & length.isfinite() & (length > 0)  # (H, W)
        lengths.append(length.where(known, 0))
    n, other = (length[..., None] for length in lengths)  # (H, W, 1) each
    mixed = first + other / (n + other) * (second - first)  # (H, W, 5)
    both = (n > 0) & (other > 0)  # (H, W, 1)
    alone = first.where((n > 0) & (first.isfinite() | ~both), second).where(n + other > 0, torch.nan)  # (H, W, 5)
    combined = mixed.where(both & mixed.isfinite(), alone)  # (H, W, 5)
    return combined[..., :3], combined[..., 3:], (n + other)[..., 0]


def held(own: tuple, other: tuple, black: float) -> tuple[Tensor, Tensor]:
    """Colour (H, W, 3) and moments (H, W, 2), less where one sample has nearly all and the other history little."""
    color, moments, length = own
    light, most = luminance(color), 8 * (luminance(other[0]).clamp(min=0) + black)  # (H, W) each
    first, second = moments.unbind(-1)  # (H, W) each
    spike = (second >= 0.7 * length.clamp(min=2.5) * first * first) & (other[2] >= 2.5) & (light > most)  # (H, W)
    factor = torch.where(spike, most / light, 1)  # (H, W)
    return color * factor[..., None], moments * torch.stack([factor, factor * factor], -1)
