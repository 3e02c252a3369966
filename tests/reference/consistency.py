import torch
from torch import Tensor

from .surface import OUTSIDE, Footprint, SurfaceTests


def consistency(motion: Tensor, *, margin=False, **surface):
    """Why, and how much of, the bilinear footprint of the history is rejected.

    The rejection is the union, over the taps of the footprint, of the tests each fails; the confidence is the weight of
    the taps that fail none.

    Parameters
    ----------
    motion : (H, W, 2) or (H, W, 3)
    margin : also return how near (H, W) the nearest decision was to turning out otherwise
    **surface : see `surface.SurfaceTests`

    Returns
    -------
    rejection : (H, W) uint8, bits OUTSIDE = 1, DEPTH = 2, NORMAL = 4, ID = 8
    confidence : (H, W)
    """
    height, width = motion.shape[:2]
    footprint = Footprint(motion)
    tests = SurfaceTests(motion, footprint, **surface)
    pixel = torch.arange(height * width, device=motion.device)  # (P,)
    rejection = torch.where(footprint.moving, 0, OUTSIDE).to(torch.uint8)  # (P,)
    confidence = torch.zeros(height * width, dtype=motion.dtype, device=motion.device)  # (P,)
    nearest = torch.full_like(confidence, torch.inf)  # (P,)
    for x, y, weight in footprint.bilinear():
        _, inside = footprint.flat(x, y)  # (P,)
        bits = torch.where(inside, 0, OUTSIDE)  # (P,)
        for bit, slack in tests.slacks(pixel, x, y).items():
            bits = bits + torch.where(inside & ~(slack >= 0), bit, 0)  # (P,)
            nearest = torch.where(inside & (weight > 0), nearest.minimum(slack.abs()), nearest)  # (P,)
        rejection |= torch.where(weight > 0, bits, 0).to(torch.uint8)  # (P,)
        confidence += weight * (bits == 0)  # (P,)
    result = (rejection.reshape(height, width), confidence.clamp(max=1).reshape(height, width))
    return (*result, nearest.reshape(height, width)) if margin else result
