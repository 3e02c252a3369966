"""Metrics: errors of an image against its reference, and temporal stability of a sequence.

Images are (H, W, 3), linear, scene-referred and unclamped. `relmse` and `smape` look at the linear values,
bright ones included; all others judge what a viewer would see and therefore look at `srgb` of the images.

Every function takes arrays. One that is measured in many ways is better given as a `Picture`, which is checked and
encoded once. `METRICS` describes those that charts and reports show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import reproject
from .tensors import as_array

__all__ = [
    "METRICS",
    "Metric",
    "Picture",
    "edge_sharpness",
    "flicker",
    "flip",
    "flip_map",
    "ghost",
    "lag",
    "metric",
    "psnr",
    "relmse",
    "smape",
    "srgb",
    "ssim",
    "temporal_error",
    "tpsnr",
    "warped_error",
]


class Picture:
    """An image that is validated once and encoded at most once, for use with several metrics.

    Parameters
    ----------
    image : (H, W, 3) array_like of float
        Linear. float64 in C order is not copied: leave it as it is.
    name : str, default "image"
        Name in error messages.

    Attributes
    ----------
    linear : (H, W, 3) ndarray of float64
        The image.
    srgb : (H, W, 3) ndarray of float64
        The image, encoded by `yester.metrics.srgb`.

    Raises
    ------
    TypeError
        If it is not of floats, or has a mask.
    ValueError
        If the shape is not (H, W, 3), or a value is not finite.

    Examples
    --------
    >>> from yester import metrics
    >>> image = metrics.Picture(np.full((16, 16, 3), 0.25))
    >>> reference = metrics.Picture(np.full((16, 16, 3), 0.5))
    >>> round(metrics.psnr(image, reference), 2), round(metrics.relmse(image, reference), 4)
    (14.06, 0.2404)
    """

    def __init__(self, image: ArrayLike, name: str = "image") -> None:
        array = _floats(name, image)
        if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
            raise ValueError(f"{name}: expected shape (H, W, 3), got {array.shape}")
        self.linear: NDArray[np.float64] = array.astype(np.float64, order="C", copy=False)
        _finite(name, self.linear)

    @cached_property
    def srgb(self) -> NDArray[np.float64]:
        """The image, encoded by `yester.metrics.srgb`: (H, W, 3) float64."""
        return srgb(self.linear)


Image: TypeAlias = ArrayLike | Picture


def srgb(image: ArrayLike) -> NDArray[np.float64]:
    """Encode linear values for display: clipped to [0, 1], then the sRGB curve.

    Parameters
    ----------
    image : array_like of float
        Linear, of any shape.

    Returns
    -------
    ndarray of float64
        Of the same shape, 0 to 1.

    Raises
    ------
    TypeError
        If it is not of floats, or has a mask.

    Notes
    -----
    ``12.92 x`` up to 0.0031308, above ``1.055 x**(1 / 2.4) - 0.055`` [1]_.

    References
    ----------
    .. [1] IEC 61966-2-1, "Colour management: default RGB colour space: sRGB", 1999.

    Examples
    --------
    >>> from yester import metrics
    >>> metrics.srgb([0.0, 0.18, 1.0, 5.0])
    array([0.    , 0.4614, 1.    , 1.    ])
    """
    linear = np.clip(_floats("image", image).astype(np.float64, copy=False), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def psnr(image: Image, reference: Image) -> float:
    """Peak signal-to-noise ratio of the sRGB-encoded images, in decibels, with a peak of 1.

    Rendered images have no largest value; the encoding supplies one, as it does where denoisers are compared on 8-bit
    images. Linear values above 1 count as 1.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear.

    Returns
    -------
    float
        Higher is better; infinity where the encoded images are equal.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.

    Notes
    -----
    ``-10 log10(mean((srgb(image) - srgb(reference))²))`` over pixels and channels.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.psnr(0.9 * reference, reference), 2)
    29.38
    """
    image, reference = _alike(image=image, reference=reference)
    error = np.mean((image.srgb - reference.srgb) ** 2)
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def relmse(image: Image, reference: Image) -> float:
    """Relative mean squared error, which weights dark pixels like bright ones.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear.

    Returns
    -------
    float
        Lower is better; 0 where the images are equal. A few very bright pixels can make most of it.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.

    See Also
    --------
    smape : Is not dominated by few bright pixels.

    Notes
    -----
    The mean of ``(a - r)² / (r² + 0.01)`` over pixels and channels, with a the image and r the reference [1]_.

    References
    ----------
    .. [1] F. Rousselle, C. Knaus, M. Zwicker, "Adaptive sampling and reconstruction using greedy error
       minimization", ACM Transactions on Graphics 30(6), 2011.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.relmse(0.9 * reference, reference), 5)
    0.00962
    """
    image, reference = _alike(image=image, reference=reference)
    return float(np.mean((image.linear - reference.linear) ** 2 / _relative(reference)))


def smape(image: Image, reference: Image) -> float:
    """Symmetric mean absolute percentage error.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear.

    Returns
    -------
    float
        0 (equal) to 1; lower is better. Dark and bright pixels count alike, and no firefly for more than any other.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.

    Notes
    -----
    The mean of ``|a - r| / (|a| + |r| + 0.001)`` over pixels and channels, with a the image and r the reference [1]_.
    Authors differ in the constant that keeps black from dividing by 0.

    References
    ----------
    .. [1] T. Vogels et al., "Denoising with kernel prediction and asymmetric loss functions", ACM Transactions on
       Graphics 37(4), 2018.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.smape(0.9 * reference, reference), 4)
    0.0526
    """
    image, reference = _alike(image=image, reference=reference)
    a, r = image.linear, reference.linear
    return float(np.mean(np.abs(a - r) / (np.abs(a) + np.abs(r) + 0.001)))


def ssim(image: Image, reference: Image) -> float:
    """Structural similarity of the sRGB-encoded images: its mean over channels and pixels.

    Gaussian weights of standard deviation 1.5 in windows of 11×11 that lie inside the image, and a range of 1, as its
    authors have it [1]_; computed by scikit-image.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear, at least 11×11.

    Returns
    -------
    float
        -1 to 1 (equal); higher is better.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ, are not (H, W, 3) or smaller than the window, or a value is not finite.
    ImportError
        If scikit-image is not installed.

    References
    ----------
    .. [1] Z. Wang, A. Bovik, H. Sheikh, E. Simoncelli, "Image quality assessment: from error visibility to structural
       similarity", IEEE Transactions on Image Processing 13(4), 2004.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.random.default_rng(0).random((16, 16, 3))
    >>> round(metrics.ssim(reference, reference), 4)
    1.0
    """
    image, reference = _alike(image=image, reference=reference)
    if min(reference.linear.shape[:2]) < 11:
        raise ValueError(f"image: SSIM needs at least 11×11 pixels, got shape {reference.linear.shape}")
    try:
        from skimage.metrics import structural_similarity
    except ImportError as error:
        raise ImportError("SSIM needs scikit-image: pip install 'yester[study]'") from error
    return float(
        structural_similarity(
            reference.srgb,
            image.srgb,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
            data_range=1.0,
            channel_axis=2,
        )
    )


def flip(image: Image, reference: Image) -> float:
    """Mean FLIP of the sRGB-encoded images: the difference seen when flipping between them on a display.

    LDR FLIP [1]_ at 67 pixels per degree, the default of NVIDIA's implementation.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear.

    Returns
    -------
    float
        0 (no difference) to 1.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.
    ImportError
        If flip-evaluator is not installed.

    See Also
    --------
    flip_map : FLIP of every pixel.

    References
    ----------
    .. [1] P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proceedings of the ACM on
       Computer Graphics and Interactive Techniques 3(2), 2020.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.flip(0.9 * reference, reference), 2)
    0.13
    """
    return float(flip_map(image, reference).mean(dtype=np.float64))


def flip_map(image: Image, reference: Image) -> NDArray[np.float32]:
    """FLIP of every pixel.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear.

    Returns
    -------
    (H, W) ndarray of float32
        0 (no difference) to 1.

    Raises
    ------
    TypeError, ValueError, ImportError
        As `flip`.

    See Also
    --------
    flip : The mean, with the source.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> metrics.flip_map(reference, reference).shape
    (16, 16)
    """
    # On invalid input, the evaluator would exit the whole process.
    image, reference = _alike(image=image, reference=reference)
    try:
        import flip_evaluator
    except ImportError as error:
        raise ImportError("FLIP needs flip-evaluator: pip install 'yester[demo]'") from error
    encoded = [np.ascontiguousarray(x.srgb, np.float32) for x in (reference, image)]
    errors, _, _ = flip_evaluator.evaluate(*encoded, "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(errors, np.float32)[..., 0]


def temporal_error(image: Image, before: Image, reference: Image, reference_before: Image) -> float:
    """Error of the change from one frame to the next against the reference's change: flicker, crawling, lag.

    The root mean square, over pixels and channels, of
    ``(srgb(image) - srgb(before)) - (srgb(reference) - srgb(reference_before))``.

    Parameters
    ----------
    image, before : (H, W, 3) array_like of float, or Picture
        Linear: a frame and the one before it.
    reference, reference_before : (H, W, 3) array_like of float, or Picture
        Linear: the references of both.

    Returns
    -------
    float
        Lower is better, 0 to 2; 0 if the sequence changes exactly as its reference does. Errors that are equal in both
        frames do not count.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.

    See Also
    --------
    tpsnr : This error in decibels.
    warped_error : Needs no reference.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.temporal_error(0.9 * reference, reference, reference, reference), 4)
    0.0339
    """
    image, before, reference, reference_before = _alike(
        image=image, before=before, reference=reference, reference_before=reference_before
    )
    error = (image.srgb - before.srgb) - (reference.srgb - reference_before.srgb)
    return float(np.sqrt(np.mean(error**2)))


def tpsnr(image: Image, before: Image, reference: Image, reference_before: Image) -> float:
    """Peak signal-to-noise ratio of the change from one frame to the next: `temporal_error` in decibels.

    Parameters
    ----------
    image, before : (H, W, 3) array_like of float, or Picture
        Linear: a frame and the one before it.
    reference, reference_before : (H, W, 3) array_like of float, or Picture
        Linear: the references of both.

    Returns
    -------
    float
        Higher is better; infinity where the sequence changes as its reference does.

    Raises
    ------
    TypeError, ValueError
        As `temporal_error`.

    See Also
    --------
    temporal_error : The root mean square.

    Notes
    -----
    ``-20 log10(temporal_error)``. Noisebase, the framework of Bálint et al. [1]_, takes its mean over a sequence's
    pairs of frames.

    References
    ----------
    .. [1] M. Bálint et al., "Neural partitioning pyramids for denoising Monte Carlo renderings", SIGGRAPH 2023
       conference papers.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.full((16, 16, 3), 0.5)
    >>> round(metrics.tpsnr(0.9 * reference, reference, reference, reference), 2)
    29.38
    """
    error = temporal_error(image, before, reference, reference_before)
    return float("inf") if error == 0 else float(-20 * np.log10(error))


def warped_error(image: Image, before: Image, motion: ArrayLike, valid: ArrayLike | None = None) -> float:
    """Difference between an image and the previous one, reprojected along the motion; needs no reference.

    The root mean square, over pixels and channels, of srgb(image) minus srgb(before) fetched along `motion`
    (`yester.reproject`, bilinear), over the pixels whose whole footprint lies inside the previous image. True changes,
    such as moving highlights and shadows, count as well, and so does the blur of bilinear interpolation: compare
    methods on the same sequence, never with zero. A frozen or uniformly grey sequence scores well.

    Parameters
    ----------
    image, before : (H, W, 3) array_like of float, or Picture
        Linear: a frame and the one before it.
    motion : (H, W, 2) or (H, W, 3) array_like of float
        Previous minus current position in pixels, x right, y down. Where it is not finite, pixels do not count.
    valid : (H, W) array_like of bool, optional
        The pixels that were visible before, for instance ``consistency(…)[0] == 0``. By default all.

    Returns
    -------
    float
        0 to 1; lower is better.

    Raises
    ------
    ValueError
        If shapes do not fit, a value of an image is not finite, or no pixel is both valid and inside.
    TypeError
        If `valid` is not of bool, or an image not of floats.

    See Also
    --------
    temporal_error : Compares with a reference.

    Notes
    -----
    Lai et al. [1]_ have the square of this, with a mask from optical flow.

    References
    ----------
    .. [1] W.-S. Lai et al., "Learning blind video temporal consistency", ECCV 2018.

    Examples
    --------
    >>> from yester import metrics
    >>> image = np.full((16, 16, 3), 0.5)
    >>> round(metrics.warped_error(0.9 * image, image, np.zeros((16, 16, 2))), 4)
    0.0339
    """
    image, before = _alike(image=image, before=before)
    motion = _unmasked("motion", motion)
    shape = image.linear.shape[:2]
    if motion.shape not in [(*shape, 2), (*shape, 3)]:
        raise ValueError(f"motion: expected shape {(*shape, 2)} or {(*shape, 3)}, got {motion.shape}")
    seen = _mask("valid", valid, shape)
    fetched, coverage = reproject(before.srgb, motion, fallback=False)
    # Coverage is a sum of rounded weights: a whole footprint may have a little less than 1.
    seen = seen & (coverage > 0.999)
    if not seen.any():
        raise ValueError("valid: expected a pixel whose previous position is inside the image, got none")
    # In float32 like the fetched image, so that a static image has no difference.
    error = image.srgb.astype(np.float32) - fetched
    return float(np.sqrt(np.mean(error**2, dtype=np.float64, where=seen[..., np.newaxis])))


def flicker(images: Iterable[Image], mask: ArrayLike | None = None) -> float:
    """Temporal variation of a sequence where the reference is static.

    The root of the mean, over pixels and channels, of the variance over time of srgb.

    Parameters
    ----------
    images : (T, H, W, 3) array_like of float, or iterable of images
        Linear, at least two. Of an iterable, one image is held at a time.
    mask : (H, W) array_like of bool, optional
        The static pixels. By default all.

    Returns
    -------
    float
        Lower is better; 0 where all images are equal. The variance is the unbiased one: longer sequences of the same
        noise do not score differently.

    Raises
    ------
    ValueError
        If there are fewer than two images, shapes do not fit, a value is not finite, or the mask is empty.
    TypeError
        If `mask` is not of bool, or an image not of floats.

    Examples
    --------
    >>> from yester import metrics
    >>> image = np.full((16, 16, 3), 0.5)
    >>> round(metrics.flicker([image, 0.9 * image]), 4)
    0.024
    """
    pictures = _each(images)
    encoded = (srgb(one.linear[_mask("mask", mask, one.linear.shape[:2])]) for one in pictures)
    _, _, variance = _moments(encoded)
    return float(np.sqrt(np.mean(variance)))


def ghost(image: Image, reference: Image, former: Image, mask: ArrayLike | None = None) -> float:
    """Ghosting after an event (a switched light, a swapped texture, a cut): the weight of the former image.

    ``<i - r, f - r> / <f - r, f - r>`` over pixels and channels of srgb, with the image i, the reference r and the
    former image f: the weight of `former` in the mixture of it and the reference that best fits the image. Pixels where
    both agree do not count.

    Parameters
    ----------
    image : (H, W, 3) array_like of float, or Picture
        Linear, after the event.
    reference, former : (H, W, 3) array_like of float, or Picture
        The reference of this frame, and the reference if the event had not happened.
    mask : (H, W) array_like of bool, optional
        The pixels to look at. By default all.

    Returns
    -------
    float
        0 without ghosting, 1 if the image equals `former`. Below 0 if the image overshoots.

    Raises
    ------
    ValueError
        If shapes do not fit, a value is not finite, or `former` looks like the reference in all chosen pixels.
    TypeError
        If `mask` is not of bool, or an image not of floats.

    See Also
    --------
    lag : Frames until the ghost is gone.

    Examples
    --------
    >>> from yester import metrics
    >>> reference, former = np.zeros((16, 16, 3)), np.ones((16, 16, 3))
    >>> metrics.ghost(former, reference, former)
    1.0
    """
    image, reference, former = _alike(image=image, reference=reference, former=former)
    seen = _mask("mask", mask, reference.linear.shape[:2])
    event = former.srgb - reference.srgb
    event[~seen] = 0
    strength = np.vdot(event, event)
    if strength == 0:
        raise ValueError("former: expected an image other than the reference, got an equal one")
    return float(np.vdot(image.srgb - reference.srgb, event) / strength)


def lag(ghosts: Sequence[float] | NDArray[np.floating], threshold: float = 0.1) -> int:
    """Count the frames after an event until its ghost is gone for good.

    Parameters
    ----------
    ghosts : (T,) sequence of float
        `ghost` of the frame of the event and those that follow.
    threshold : float, default 0.1
        Largest ghost, above or below 0, that counts as gone.

    Returns
    -------
    int
        Index of the first frame from which on all ghosts are gone; T if the last one is not.

    Raises
    ------
    ValueError
        If `ghosts` is not one-dimensional or not finite, or the threshold below 0.

    See Also
    --------
    ghost : The weight of the former image.

    Examples
    --------
    >>> from yester import metrics
    >>> metrics.lag([1.0, 0.5, 0.25, 0.05, 0.01])
    3
    """
    values = _unmasked("ghosts", ghosts).astype(np.float64)
    if values.ndim != 1:
        raise ValueError(f"ghosts: expected shape (T,), got {values.shape}")
    _finite("ghosts", values)
    if not threshold >= 0:
        raise ValueError(f"threshold: expected a weight from 0, got {threshold}")
    left = np.flatnonzero(np.abs(values) > threshold)
    return int(left[-1]) + 1 if left.size else 0


def edge_sharpness(image: Image, reference: Image, share: float = 0.05) -> float:
    """Edge sharpness: the steepness, in the image, of the reference's strongest edges.

    ``<∇i, ∇r> / <∇r, ∇r>`` of the luminance of srgb (Rec. 709), by central differences, over the `share` of inner
    pixels where the reference is steepest; i is the image, r the reference.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float, or Picture
        Linear, at least 3×3.
    share : float, default 0.05
        Of the pixels, those that count as edges; above 0, up to 1.

    Returns
    -------
    float
        1 where edges are as steep as the reference's, below where they are blurred, above where they are oversharpened.
        Noise of rendered images lowers it, as the curve of srgb is concave and clips: at a sharp edge between 0.08 and
        0.6, to 0.80 where the variance of each pixel is the square of its mean, to 0.29 where it is ten times that.

    Raises
    ------
    TypeError
        If an image is not of floats, or has a mask.
    ValueError
        If the shapes differ, are not (H, W, 3) or smaller than 3×3, a value is not finite, `share` is out of range, or
        the reference has no edges.

    Examples
    --------
    >>> from yester import metrics
    >>> reference = np.zeros((16, 16, 3))
    >>> reference[:, 8:] = 1
    >>> blurred = reference.copy()
    >>> blurred[:, 8] = 0.2
    >>> round(metrics.edge_sharpness(blurred, reference), 3)
    0.742
    """
    image, reference = _alike(image=image, reference=reference)
    if not 0 < share <= 1:
        raise ValueError(f"share: expected above 0 and up to 1, got {share}")
    if min(reference.linear.shape[:2]) < 3:
        raise ValueError(f"image: edges need at least 3×3 pixels, got shape {reference.linear.shape}")
    slopes = _slopes(reference)
    strength = np.sum(slopes**2, axis=0)
    count = max(1, round(share * strength.size))
    edges = strength >= np.partition(strength, -count, axis=None)[-count]
    total = np.sum(strength[edges])
    if total == 0:
        raise ValueError("reference: expected edges, got the same luminance everywhere")
    return float(np.sum(_slopes(image)[:, edges] * slopes[:, edges]) / total)


@dataclass(frozen=True)
class Metric:
    """Description of a metric for charts and reports.

    Parameters
    ----------
    key : str
        Its name in this module.
    label : str
        For axes and headings, with its unit.
    higher_is_better : bool
        True if larger values are better.
    needs : {"reference", "references", "none"}
        The reference of a frame, that of the frame before as well, or none.
    measure : callable
        Takes (image, reference), (image, before, reference, reference_before), or (image, before, motion, valid).
    exact : float, optional
        The reference's own value, if larger and smaller ones are both worse.

    See Also
    --------
    metric : Looks one up by name.
    """

    key: str
    label: str
    higher_is_better: bool
    needs: Literal["reference", "references", "none"]
    measure: Callable[..., float]
    exact: float | None = None

    def loss(self, value: float) -> float:
        """Order values by how good they are.

        Parameters
        ----------
        value : float
            Of this metric.

        Returns
        -------
        float
            Smaller for better values.

        Examples
        --------
        >>> found = yester.metrics.metric("edge_sharpness")
        >>> found.loss(1.5) == found.loss(0.5) > found.loss(0.9)
        True
        """
        if self.exact is not None:
            return abs(value - self.exact)
        return -value if self.higher_is_better else value


METRICS = {
    one.key: one
    for one in (
        Metric("psnr", "PSNR [dB]", True, "reference", psnr),
        Metric("relmse", "relMSE", False, "reference", relmse),
        Metric("smape", "SMAPE", False, "reference", smape),
        Metric("ssim", "SSIM", True, "reference", ssim),
        Metric("flip", "FLIP", False, "reference", flip),
        Metric("edge_sharpness", "edge sharpness (1: the reference's)", True, "reference", edge_sharpness, exact=1.0),
        Metric("temporal_error", "temporal error (RMS)", False, "references", temporal_error),
        Metric("tpsnr", "tPSNR [dB]", True, "references", tpsnr),
        Metric("warped_error", "warped error (RMS)", False, "none", warped_error),
    )
}


def metric(key: str) -> Metric:
    """Look up one of ``METRICS``.

    Parameters
    ----------
    key : str
        Its name.

    Returns
    -------
    Metric
        Its description and function.

    Raises
    ------
    ValueError
        If there is none of that name.

    Examples
    --------
    >>> from yester import metrics
    >>> found = metrics.metric("relmse")
    >>> found.label, found.higher_is_better
    ('relMSE', False)
    """
    if key not in METRICS:
        raise ValueError(f"metric: expected one of {', '.join(METRICS)}, got {key!r}")
    return METRICS[key]


def _unmasked(name: str, values: ArrayLike) -> NDArray[Any]:
    """The values as an array; an error if they have a mask, since their data would be taken for valid everywhere."""
    if np.ma.isMaskedArray(values):
        raise TypeError(f"{name}: expected an array without a mask, got a masked one: metrics compare whole images")
    return as_array(values, name)


def _floats(name: str, image: ArrayLike) -> NDArray[np.floating[Any]]:
    """The image as an array, if its values are floats."""
    array = _unmasked(name, image)
    if array.dtype.kind != "f":
        most = {"uint8": 255, "uint16": 65535}.get(array.dtype.name)
        advice = f": colours of whole numbers are gamma-encoded; (x / {most}) ** 2.2 is linear" if most else ""
        raise TypeError(f"{name}: expected floats, got {array.dtype}{advice}")
    return array


def _finite(name: str, array: NDArray[np.float64]) -> None:
    bad = array.size - np.count_nonzero(np.isfinite(array))
    if bad:
        raise ValueError(f"{name}: {bad} of {array.size} values are not finite")


def _alike(**images: Image) -> list[Picture]:
    """The images as pictures of one shape: the reference's, or without one the first's."""
    pictures = {name: image if isinstance(image, Picture) else Picture(image, name) for name, image in images.items()}
    model = "reference" if "reference" in pictures else next(iter(pictures))
    expected = pictures[model].linear.shape
    for name, picture in pictures.items():
        if picture.linear.shape != expected:
            raise ValueError(f"{name}: expected the shape of {model}, {expected}, got {picture.linear.shape}")
    return [*pictures.values()]


def _each(images: Iterable[Image]) -> Iterator[Picture]:
    """The images one by one, all of the first one's shape."""
    model: dict[str, Picture] = {}
    for i, image in enumerate(images):
        *_, picture = _alike(**model, **{f"images[{i}]": image})
        model = model or {"images[0]": picture}
        yield picture


def _mask(name: str, mask: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    if mask is None:
        return np.ones(shape, np.bool_)
    array = _unmasked(name, mask)
    if array.dtype != np.bool_:
        raise TypeError(f"{name}: expected bool, got {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    if not array.any():
        raise ValueError(f"{name}: expected at least one true pixel, got none")
    return array


def _relative(reference: Picture) -> NDArray[np.float64]:
    """The denominator of relative squared errors, bounded from below for black pixels."""
    return reference.linear**2 + 0.01


def _moments(arrays: Iterable[NDArray[np.float64]]) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    """Number, mean and unbiased variance, in one pass (Welford 1962): equal arrays have a variance of exactly 0."""
    count = 0
    for count, array in enumerate(arrays, 1):
        if count == 1:
            mean, squares = array.copy(), np.zeros_like(array)
        else:
            step = array - mean
            mean += step / count
            squares += step * (array - mean)
    if count < 2:
        raise ValueError(f"images: expected at least 2, got {count}")
    return count, mean, squares / (count - 1)


def _slopes(picture: Picture) -> NDArray[np.float64]:
    """Twice the gradient of the encoded luminance by central differences, (2, H - 2, W - 2)."""
    light = picture.srgb @ (0.2126, 0.7152, 0.0722)
    return np.stack([light[1:-1, 2:] - light[1:-1, :-2], light[2:, 1:-1] - light[:-2, 1:-1]])
