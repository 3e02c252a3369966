from torch import Tensor

from .accumulate import luminance


def exposure(color: Tensor) -> float:
    """Find the radiance that a tone curve takes for 1: eight times a power mean of luminance, of exponent 1/2.

    Parameters
    ----------
    color : (H, W, 3)
    """
    present = color.isfinite().all(-1)
    roots = luminance(color.nan_to_num()).clamp(min=0).sqrt().where(present, 0.0)  # (H, W)
    counts = present.sum(1)
    sums, counts = roots.sum(1)[counts > 0], counts[counts > 0]
    if not len(counts):
        return 1.0
    # A row counts for at most 4096 times the one that is brighter than nine tenths of the rows.
    bound = 4096 * (sums / counts).sort().values[len(counts) * 9 // 10]
    mean = float((sums.minimum(bound * counts) if bound > 0 else sums).sum() / counts.sum())
    return 8 * mean**2 or 1.0
