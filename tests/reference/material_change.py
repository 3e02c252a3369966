import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from .reproject import reproject


def material_change(
    albedo: Tensor,
    previous_albedo: Tensor,
    motion: Tensor,
    *,
    relative_luminance=0.2,
    share=0.6,
    radius=7,
    margin=False,
) -> Tensor | tuple[Tensor, Tensor]:
    """Where the albedo is another than in the frame before, and that of most pixels around is, too.

    Own method: the test of luminance of `reproject`, over the 2x2 footprint, and the mean of its failures.

    Parameters
    ----------
    albedo, previous_albedo : (H, W, 3)
    motion : (H, W, 2) or (H, W, 3)
    relative_luminance : of the larger luminance
    share : of the square around that must differ
    radius : of the square
    margin : also return the distance (H, W) of the nearest decision from its threshold

    Returns
    -------
    mask : (H, W)
    """
    anything = torch.ones_like(albedo[..., 0])  # (H, W)
    _, inside = reproject(anything, motion, fallback=False)  # (H, W)
    alike = {"color": albedo, "previous_color": previous_albedo, "relative_luminance": relative_luminance}
    _, same, slack, _ = reproject(anything, motion, fallback=False, margin=True, **alike)  # (H, W) each
    differs = ((inside > 0) & (same <= 0)).to(anything)[None, None]  # (1, 1, H, W)
    around = {"kernel_size": 2 * radius + 1, "stride": 1, "padding": radius}
    mean = avg_pool2d(differs, **around, count_include_pad=False)[0, 0]  # (H, W)
    mask = (differs[0, 0] > 0) & (mean > share)  # (H, W)
    if not margin:
        return mask
    least = -max_pool2d(-slack[None, None], **around)[0, 0]  # (H, W)
    return mask, least.minimum((mean - share).abs())
