"""How far an image is from its reference: PSNR, relMSE, FLIP.

Images are (H, W, 3), linear, scene-referred and unclamped. PSNR and FLIP judge what a viewer would see and therefore
look at `srgb` of both images; relMSE looks at the linear values, bright ones included.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["flip", "flip_map", "psnr", "relmse", "srgb"]


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
    image, reference = _pair(image, reference)
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
    image, reference = _pair(image, reference)
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
    image, reference = _pair(image, reference)
    try:
        import flip_evaluator
    except ImportError as error:
        raise ImportError("FLIP needs flip-evaluator: pip install 'yester[demo]'") from error
    encoded = [np.ascontiguousarray(srgb(x), np.float32) for x in (reference, image)]
    errors, _, _ = flip_evaluator.evaluate(*encoded, "LDR", applyMagma=False, computeMeanError=False)
    return np.asarray(errors, np.float32)[..., 0]


def _pair(image: ArrayLike, reference: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both images as float64, of one shape, finite."""
    arrays = []
    for name, value in (("image", image), ("reference", reference)):
        array = np.asarray(value)
        if array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
            raise ValueError(f"{name}: expected shape (H, W, 3), got {array.shape}")
        array = array.astype(np.float64)
        bad = array.size - np.count_nonzero(np.isfinite(array))
        if bad:
            raise ValueError(f"{name}: {bad} of {array.size} values are not finite")
        arrays.append(array)
    if arrays[0].shape != arrays[1].shape:
        raise ValueError(f"image: expected the shape of the reference, {arrays[1].shape}, got {arrays[0].shape}")
    return arrays[0], arrays[1]
