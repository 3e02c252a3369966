"""Yester: temporal reprojection and denoising of rendered frames, on any CPU.

Pipelines (`SVGF`, `TAA`, `Upscaler` and others) take one `Frame` of numpy arrays after the other; `denoise` runs one
over a sequence, with the frames on both sides of each. They are composed of kernels, functions on numpy arrays, which
can be used alone: `motion_vectors`, `reproject`, `consistency`, `accumulate`, `estimate_variance`, `atrous` and others.
`yester.io` reads and writes EXR files and renders with Mitsuba; `yester.metrics` measures errors.

Examples in docstrings assume ``import numpy as np`` and ``import yester``.
"""

from enum import IntFlag as _IntFlag

from ._core import (
    BMFR,
    SVGF,
    TAA,
    Accumulated,
    Camera,
    HalfRes,
    History,
    Output,
    Pipeline,
    Recirculation,
    Upscaler,
    __version__,
    accumulate,
    alternation,
    anti_lag,
    atrous,
    blend,
    blend_factor,
    choice,
    clip_history,
    collocate,
    collocation_shares,
    combine_histories,
    compare_candidates,
    consistency,
    converge,
    demodulate,
    dilate_motion,
    disocclusion,
    estimate_variance,
    exposure,
    fix_history,
    incoherent_guides,
    innovation,
    invert_motion,
    is_reflectance,
    jitter,
    joint_bilateral_upsample,
    light_change,
    morphological_aa,
    motion_vectors,
    prediction_gain,
    pull_push,
    recirculate,
    reconstruct,
    regress,
    remodulate,
    repetition,
    reproject,
    resample,
    resolve,
    sharpen,
    splat,
    suppress_fireflies,
    temporal_gradient,
    thin_features,
    virtual_motion,
)
from .check import Finding, check, check_motion
from .frame import Frame
from .oidn import OIDN
from .plan import Plan, Planned, Stage, plan
from .sequence import denoise


class Rejection(_IntFlag):
    """The tests that a pixel's history failed: bits of the masks of `consistency` and `Output.rejection`.

    Attributes
    ----------
    OUTSIDE
        The history lies outside the previous frame.
    DEPTH
        It has another depth than expected.
    NORMAL
        It has another orientation.
    ID
        It is another object.
    VELOCITY
        The motion is longer than allowed.
    LUMINANCE
        It has another brightness.
    MOTION
        It moved otherwise.

    See Also
    --------
    consistency : The tests.
    Output : Its `rejection` has these bits.

    Examples
    --------
    >>> rejection = np.array([[0, 2], [6, 1]], np.uint8)
    >>> yester.Rejection(int(rejection[1, 0]))
    <Rejection.DEPTH|NORMAL: 6>
    >>> rejection & yester.Rejection.DEPTH != 0
    array([[False,  True],
           [ True, False]])
    """

    OUTSIDE = 1
    """The history lies outside the previous frame."""
    DEPTH = 2
    """It has another depth than expected."""
    NORMAL = 4
    """It has another orientation."""
    ID = 8
    """It is another object."""
    VELOCITY = 16
    """The motion is longer than allowed."""
    LUMINANCE = 32
    """It has another brightness."""
    MOTION = 64
    """It moved otherwise."""


__all__ = [
    "BMFR",
    "OIDN",
    "SVGF",
    "TAA",
    "Accumulated",
    "Camera",
    "Finding",
    "Frame",
    "HalfRes",
    "History",
    "Output",
    "Pipeline",
    "Plan",
    "Planned",
    "Recirculation",
    "Rejection",
    "Stage",
    "Upscaler",
    "__version__",
    "accumulate",
    "alternation",
    "anti_lag",
    "atrous",
    "blend",
    "blend_factor",
    "check",
    "check_motion",
    "choice",
    "clip_history",
    "collocate",
    "collocation_shares",
    "combine_histories",
    "compare_candidates",
    "consistency",
    "converge",
    "demodulate",
    "denoise",
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
    "morphological_aa",
    "motion_vectors",
    "plan",
    "prediction_gain",
    "pull_push",
    "recirculate",
    "reconstruct",
    "regress",
    "remodulate",
    "repetition",
    "reproject",
    "resample",
    "resolve",
    "sharpen",
    "splat",
    "suppress_fireflies",
    "temporal_gradient",
    "thin_features",
    "virtual_motion",
]
