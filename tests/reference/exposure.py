from torch import Tensor

from .accumulate import luminance


def exposure(color: Tensor) -> float:
    """Find the radiance that a tone curve takes for 1: eight times a power mean of luminance, of exponent 1/2.

    Parameters
    ----------
    color : (H, W, 3)
    """
    light = luminance(color[color.isfinite().all(-1)]).clamp(min=0)  # (N,)
    mean = float(light.sqrt().mean()) if len(light) else 0.0
    return 8 * mean**2 or 1.0
