"""Every kernel once more, in torch: written from the formula, in whatever precision the tensors have (here float64).

Names, arguments and results are those of the public functions; tensors are (H, W, C). The loops run over taps, never
over pixels. A camera is anything with ``world_to_clip``, ``width`` and ``height``.
"""

from .accumulate import Accumulated, accumulate, luminance
from .atrous import atrous
from .consistency import consistency
from .demodulate import demodulate, remodulate
from .dilate import dilate_motion
from .jitter import jitter
from .motion import motion_vectors
from .neighborhood import clip_history
from .projection import project, rays, unproject
from .reproject import reproject
from .resolve import resolve
from .svgf import SVGF, Output
from .variance import estimate_variance

__all__ = [
    "SVGF",
    "Accumulated",
    "Output",
    "accumulate",
    "atrous",
    "clip_history",
    "consistency",
    "demodulate",
    "dilate_motion",
    "estimate_variance",
    "jitter",
    "luminance",
    "motion_vectors",
    "project",
    "rays",
    "remodulate",
    "reproject",
    "resolve",
    "unproject",
]
