import torch
from torch import Tensor


def combine_histories(
    color: Tensor,
    moments: Tensor,
    history_length: Tensor,
    other_color: Tensor,
    other_moments: Tensor,
    other_length: Tensor,
    *,
    gradient: Tensor | None = None,
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

    Returns
    -------
    color, moments, history_length; NaN, NaN and 0 where neither has samples
    """
    if gradient is not None:
        other_length = other_length * (1 - gradient.nan_to_num(0).clamp(0, 1)) ** 10  # (H, W)
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
