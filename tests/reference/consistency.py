import torch
from torch import Tensor

from .surface import OUTSIDE, Footprint, SurfaceTests


def consistency(motion: Tensor, *, margin=False, **surface):
    """Validate history: why, and how much of, its bilinear footprint is rejected.

    The rejection is the union, over the taps of the footprint, of the tests whose trust is zero; the confidence
    is the sum of the taps' weights times the products of all tests' trust.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3)
    margin : also return the distance (H, W) of the nearest decision from its threshold, and the factor (H, W) by which
        ramps multiply roundings
    **surface : see `surface.SurfaceTests`

    Returns
    -------
    rejection : (H, W) uint8, bits OUTSIDE = 1, DEPTH = 2, NORMAL = 4, ID = 8, VELOCITY = 16, LUMINANCE = 32
    confidence : (H, W)
    """
    height, width = motion.shape[:2]
    footprint = Footprint(motion)
    tests = SurfaceTests(motion, footprint, **surface)
    pixel = torch.arange(height * width, device=motion.device)  # (P,)
    rejection = torch.where(footprint.moving, 0, OUTSIDE).to(torch.uint8)  # (P,)
    confidence = torch.zeros(height * width, dtype=motion.dtype, device=motion.device)  # (P,)
    nearest, steepness = torch.full_like(confidence, torch.inf), torch.zeros_like(confidence)  # (P,), (P,)
    for x, y, weight in footprint.bilinear():
        _, inside = footprint.flat(x, y)  # (P,)
        bits, trust = torch.where(inside, 0, OUTSIDE), inside * weight  # (P,), (P,)
        counts = inside & (weight > 0)  # (P,)
        for bit, test in tests(pixel, x, y).items():
            bits = bits + torch.where(inside & (test.trust == 0), bit, 0)  # (P,)
            trust = trust * test.trust  # (P,)
            nearest = torch.where(counts, nearest.minimum(test.slack.abs()), nearest)  # (P,)
            steepness = torch.where(counts, steepness.maximum(test.steepness), steepness)  # (P,)
        rejection |= torch.where(weight > 0, bits, 0).to(torch.uint8)  # (P,)
        confidence += trust  # (P,)
    result = [rejection, confidence.clamp(max=1), *([nearest, steepness] if margin else [])]
    return tuple(plane.reshape(height, width) for plane in result)
