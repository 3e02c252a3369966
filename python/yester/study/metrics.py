"""How far an image is from its reference: PSNR, relMSE, FLIP, and the temporal error of two frames in a row.

Images are (H, W, 3), linear, scene-referred and unclamped. PSNR, FLIP and the temporal error judge what a viewer would
see and therefore look at `srgb` of the images; relMSE looks at the linear values, bright ones included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["flip", "flip_map", "psnr", "relmse", "srgb", "temporal_error"]


def srgb(image: ArrayLike) -> NDArray[np.float64]:
    """Encode linear values for display: clipped to [0, 1], then the sRGB curve (IEC 61966-2-1).

    Parameters
    ----------
    image : array_like of float
        Linear, of any shape.

    Returns
    -------
    ndarray of float64
        Of the same shape, 0 to 1.
    """
    linear = np.clip(np.asarray(image, np.float64), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def psnr(image: ArrayLike, reference: ArrayLike) -> float:
    """Peak signal-to-noise ratio of the sRGB-encoded images, in decibels, with a peak of 1.

    Rendered images have no largest value; the encoding supplies one, as it does where denoisers are compared on 8-bit
    images. Linear values above 1 count as 1.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float
        Linear.

    Returns
    -------
    float
        Higher is better; infinity where the encoded images are equal.

    Raises
    ------
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.
    """
    image, reference = _alike(image=image, reference=reference)
    error = np.mean((srgb(image) - srgb(reference)) ** 2)
    return float("inf") if error == 0 else float(-10 * np.log10(error))


def relmse(image: ArrayLike, reference: ArrayLike) -> float:
    """Relative mean squared error: the mean of (a - r)² / (r² + 0.01) over pixels and channels.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float
        Linear.

    Returns
    -------
    float
        Lower is better; 0 where the images are equal. A few very bright pixels can make most of it.

    Raises
    ------
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.

    References
    ----------
    .. [1] F. Rousselle, C. Knaus, M. Zwicker, "Adaptive sampling and reconstruction using greedy error
       minimization", ACM Transactions on Graphics 30(6), 2011.
    """
    image, reference = _alike(image=image, reference=reference)
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


def flip(image: ArrayLike, reference: ArrayLike) -> float:
    """Mean FLIP of the sRGB-encoded images: the difference seen when flipping between them on a display.

    LDR FLIP at 67 pixels per degree, the default of NVIDIA's implementation.

    Parameters
    ----------
    image, reference : (H, W, 3) array_like of float
        Linear.

    Returns
    -------
    float
        0 (no difference) to 1.

    Raises
    ------
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.
    ImportError
        If flip-evaluator is not installed.

    References
    ----------
    .. [1] P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proceedings of the ACM on
       Computer Graphics and Interactive Techniques 3(2), 2020.
    """
    return float(flip_map(image, reference).mean(dtype=np.float64))


def flip_map(image: ArrayLike, reference: ArrayLike) -> NDArray[np.float32]:
    """FLIP of every pixel: see `flip`, whose parameters and errors these are.

    Returns
    -------
    (H, W) ndarray of float32
        0 to 1.
    """
    # The evaluator ends the whole process on input that it does not like: nothing unchecked may reach it.
    image, reference = _alike(image=image, reference=reference)
    try:
        import flip_evaluator
    except ImportError as error:
        raise ImportError("FLIP needs flip-evaluator: pip install 'yester[demo]'") from error
    encoded = [np.ascontiguousarray(srgb(x), np.float32) for x in (reference, image)]
    errors, _, _ = flip_evaluator.evaluate(*encoded, "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(errors, np.float32)[..., 0]


def temporal_error(image: ArrayLike, before: ArrayLike, reference: ArrayLike, reference_before: ArrayLike) -> float:
    """How far the change from one frame to the next is from the reference's: flicker, crawling, lag.

    The root mean square, over pixels and channels, of
    ``(srgb(image) - srgb(before)) - (srgb(reference) - srgb(reference_before))``.

    Parameters
    ----------
    image, before : (H, W, 3) array_like of float
        Linear: a frame and the one before it.
    reference, reference_before : (H, W, 3) array_like of float
        Linear: the references of both.

    Returns
    -------
    float
        Lower is better, 0 to 2; 0 where the sequence changes as its reference does. What is wrong in both frames alike
        does not count.

    Raises
    ------
    ValueError
        If the shapes differ or are not (H, W, 3), or a value is not finite.
    """
    image, before, reference, reference_before = _alike(
        image=image, before=before, reference=reference, reference_before=reference_before
    )
    error = (srgb(image) - srgb(before)) - (srgb(reference) - srgb(reference_before))
    return float(np.sqrt(np.mean(error**2)))


def _alike(**images: ArrayLike) -> list[NDArray[np.float64]]:
    """The images as float64, finite, of the shape that `reference` has."""
    arrays = {}
    for name, value in images.items():
        array = np.asarray(value)
        if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
            raise ValueError(f"{name}: expected shape (H, W, 3), got {array.shape}")
        array = array.astype(np.float64)
        bad = array.size - np.count_nonzero(np.isfinite(array))
        if bad:
            raise ValueError(f"{name}: {bad} of {array.size} values are not finite")
        arrays[name] = array
    expected = arrays["reference"].shape
    for name, array in arrays.items():
        if array.shape != expected:
            raise ValueError(f"{name}: expected the shape of the reference, {expected}, got {array.shape}")
    return [*arrays.values()]
