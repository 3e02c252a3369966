"""Every kernel in torch: written from the formula, in the precision of its tensors (here float64).

Names, arguments and results are those of the public functions; tensors are (H, W, C). The loops run over taps, never
over pixels. A camera is anything with ``world_to_clip``, ``width`` and ``height``.
"""

from .accumulate import Accumulated, accumulate, luminance
from .alternation import alternation
from .anti_lag import anti_lag
from .atrous import atrous
from .blend import blend
from .blend_factor import blend_factor
from .bmfr import BMFR
from .choice import choice, compare_candidates
from .coherence import incoherent_guides
from .collocation import collocate, collocation_shares
from .combine import combine_histories
from .consistency import consistency
from .converge import converge
from .demodulate import demodulate, is_reflectance, material_ids, remodulate
from .depth_change import depth_change
from .dilate import dilate_motion
from .disocclusion import disocclusion
from .edges import smooth_edges
from .exposure import exposure
from .fireflies import suppress_fireflies
from .gradient import temporal_gradient
from .half_res import HalfRes
from .history_fix import fix_history
from .innovation import innovation
from .invert import invert_motion
from .jitter import jitter
from .joint_bilateral import joint_bilateral_upsample, reconstruct
from .light_change import light_change
from .material_change import material_change
from .morphological import morphological_aa
from .motion import motion_vectors
from .neighborhood import clip_history
from .prediction import prediction_gain
from .projection import project, rays, unproject
from .pull_push import pull_push
from .recirculate import recirculate
from .recirculation import Recirculation
from .regress import regress
from .repetition import repetition
from .reproject import reproject
from .resample import resample
from .resolve import resolve
from .restore import restore_detail
from .sharpen import sharpen
from .splat import splat
from .svgf import SVGF, Output
from .taa import TAA
from .thin_features import thin_features
from .upscaler import Upscaler
from .variance import estimate_variance
from .virtual_motion import virtual_motion

__all__ = [
    "BMFR",
    "SVGF",
    "TAA",
    "Accumulated",
    "HalfRes",
    "Output",
    "Recirculation",
    "Upscaler",
    "accumulate",
    "alternation",
    "anti_lag",
    "atrous",
    "blend",
    "blend_factor",
    "choice",
    "clip_history",
    "collocate",
    "collocation_shares",
    "combine_histories",
    "compare_candidates",
    "consistency",
    "converge",
    "demodulate",
    "depth_change",
    "dilate_motion",
    "disocclusion",
    "estimate_variance",
    "exposure",
    "fix_history",
    "incoherent_guides",
    "innovation",
    "invert_motion",
    "is_reflectance",
    "jitter",
    "joint_bilateral_upsample",
    "light_change",
    "luminance",
    "material_change",
    "material_ids",
    "morphological_aa",
    "motion_vectors",
    "prediction_gain",
    "project",
    "pull_push",
    "rays",
    "recirculate",
    "reconstruct",
    "regress",
    "remodulate",
    "repetition",
    "reproject",
    "resample",
    "resolve",
    "restore_detail",
    "sharpen",
    "smooth_edges",
    "splat",
    "suppress_fireflies",
    "temporal_gradient",
    "thin_features",
    "unproject",
    "virtual_motion",
]
