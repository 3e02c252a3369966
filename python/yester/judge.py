"""Which of two results is better, judged without a reference: by how well they predict the next frame's samples."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._core import Camera, demodulate, invert_motion, is_reflectance, motion_vectors, repetition, reproject
from .frame import Frame
from .metrics import Picture

__all__ = ["Predicted", "predictive_error"]

#: Weightings of squared errors: relative to brightness, as in `relmse`, and in display space, as in `psnr`.
WEIGHTINGS = ("relative", "display")

#: The `repetition` above which the noise of a frame is that of the frame before, as in the pipelines in Rust.
REPEATS = 0.3

#: Why the motion of a frame is unknown (`known_motion`).
UNMOVED = "no motion, and no camera with depth or position to compute it from"

#: ε of the relative error, as in `relmse`.
_EPSILON = 0.01
#: Coverage above which a pixel is compared: all taps are valid, up to rounding.
_WHOLE = 0.99


class Predicted(NamedTuple):
    """How much worse one result is than another, as new samples tell.

    Attributes
    ----------
    difference : float
        Mean squared error of the first result minus that of the second; NaN if no pixel could be compared.
    error : float
        Its standard error; NaN if fewer than two tiles could be compared.
    change : float
        A scale for both: the mean squared change of the second result along the motion, in the frame where it changes
        least. Over the study's 21 sequences, the median is a quarter of the result's relMSE with twelve frames, a third
        with eight.
    tiles : (h, w) float64
        The difference tile by tile; NaN where nothing could be compared.
    """

    difference: float
    error: float
    change: float
    tiles: NDArray[np.float64]


def predictive_error(
    first: Sequence[ArrayLike], second: Sequence[ArrayLike], frames: Sequence[Frame], *, start: int = 0, tile: int = 16
) -> dict[str, Predicted]:
    """Estimate how much worse one pipeline's results are than another's, without a reference.

    The results a and b for frame t are carried to frame t + 1 along the motion. Its samples y are unbiased and unseen
    by both, so that (a - y)² - (b - y)² = (a - b)(a + b - 2 y) is, but for the noise of y, the difference of their
    squared errors; as it is linear in y, that noise averages out.

    Parameters
    ----------
    first, second : sequence of (H, W, 3) array_like of float
        The results a and b for each frame: linear colour, finite.
    frames : sequence of Frame
        The noisy frames that both were made of, in order. Missing samples do not count.
    start : int, default 0
        The first frame whose results are compared. Young histories differ from old ones.
    tile : int, default 16
        Side of the tiles in pixels. A tile should be wider than the errors that neighbouring pixels share: 16 to 32.

    Returns
    -------
    dict of str to Predicted
        By weight w of the squared error. ``"relative"``: 1 / (μ² + 0.01), with μ the mean of a's and b's channels.
        ``"display"``: the squared slope of the sRGB curve at μ, 0 where μ exceeds 1.

    Raises
    ------
    ValueError
        If there are not as many results as frames or they have other shapes, a result is not finite, there are fewer
        than two frames from `start` on, or the tile is below 1.
    TypeError
        If a result is not of floats or has a mask, or `start` or `tile` is not an integer.

    See Also
    --------
    prediction_gain : Compares two histories, pixel by pixel.
    yester.metrics.relmse : Error against a reference.

    Notes
    -----
    Images are carried to the nearest pixel, since interpolation would blur sharp results more than smooth ones. A pixel
    counts where its history and those of its eight neighbours pass the tests of the surface: at edges, these tests
    would select samples of the surface that was visible before, and favour results that are not antialiased. What a
    component does at edges is therefore not seen. Blurred results are favoured where reflections move along no motion
    vector, and a little by texture of few pixels.

    The standard error takes tiles as units, each with the sum over all frames, since errors persist from frame to
    frame: with D the tiles' sums of w d, n their numbers of pixels and m = Σ D / Σ n, it is
    √(T / (T - 1) Σ (D - m n)²) / Σ n. Samples are not clamped: on the 21 sequences, a clamp at 8 times the mean biased
    estimates more than it calmed them.

    Examples
    --------
    >>> from yester.judge import predictive_error
    >>> rng = np.random.default_rng(0)
    >>> frames = [yester.Frame(rng.gamma(4, 0.25, (64, 64, 3))) for _ in range(4)]
    >>> exact, dark = [np.ones((64, 64, 3))] * 4, [np.full((64, 64, 3), 0.5)] * 4
    >>> found = predictive_error(dark, exact, frames)["relative"]
    >>> bool(found.difference > 3 * found.error)
    True
    """
    for name, number in (("start", start), ("tile", tile)):
        if not isinstance(number, Integral):
            raise TypeError(f"{name}: expected an integer, got {type(number).__name__}")
    if tile < 1:
        raise ValueError(f"tile: expected at least 1, got {tile}")
    for name, results in (("first", first), ("second", second)):
        for t, (image, frame) in enumerate(zip(results, frames, strict=False)):
            shape = Picture(image, f"{name}[{t}]").linear.shape
            if shape != frame.color.shape:
                raise ValueError(f"{name}[{t}]: expected shape {frame.color.shape}, got {shape}")
    (found,) = sums([first], second, frames, start=start, tile=tile)
    return estimate(found)


def sums(
    firsts: Sequence[Sequence[ArrayLike]],
    second: Sequence[ArrayLike],
    frames: Sequence[Frame],
    *,
    start: int = 0,
    tile: int = 16,
    untested: Sequence[str] = (),
) -> NDArray[np.float64]:
    """The sums that `estimate` needs, of several first results, (results, frames, 2, 3, h, w).

    The buffers in `untested` do not tell surfaces apart, as where results with and without them are compared. By frame,
    weighting and tile: the weighted differences of squared errors, the number of pixels, and the weighted squared
    change of the second result. Sums of several parts of an image may be joined, flattened, on the last axis.
    """
    for each in (*firsts, second):
        if len(each) != len(frames):
            raise ValueError(f"frames: expected as many as results, got {len(each)} results and {len(frames)} frames")
    if not 0 <= start < len(frames) - 1:
        raise ValueError(f"frames: expected at least two from `start` on, got {len(frames)} and start {start}")
    by_frame = [
        _compared([first[t] for first in firsts], second[t : t + 2], frames[t : t + 2], tile, untested)
        for t in range(start, len(frames) - 1)
    ]
    return np.stack(by_frame, 1)


def estimate(found: NDArray[np.float64]) -> dict[str, Predicted]:
    """What the `sums` say, by weighting."""
    result = {}
    for number, weighting in enumerate(WEIGHTINGS):
        by_frame = found[:, number]
        difference, count, _ = by_frame.sum(0)
        total, units = count.sum(), np.count_nonzero(count)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = difference.sum() / total
            spread = ((difference - mean * count) ** 2).sum() * units / (units - 1)
            _, counts, changes = by_frame.sum(tuple(range(2, by_frame.ndim))).T
            change = np.fmin.reduce(changes / counts)
            tiles = difference / count
            result[weighting] = Predicted(float(mean), float(np.sqrt(spread) / total), float(change), tiles)
    return result


def still_motion(frame: Frame, other: Camera | None) -> NDArray[np.float32] | None:
    """The motion of a still scene from a frame to where another camera sees it; None if unknown."""
    place = frame.depth if frame.position is None else frame.position
    if place is None or frame.camera is None or other is None:
        return None
    return motion_vectors(place, frame.camera, other)


def known_motion(before: Frame, frame: Frame) -> NDArray[np.float32] | None:
    """The motion to the frame before: the frame's own, else that of the cameras; None if unknown."""
    return still_motion(frame, before.camera) if frame.motion is None else frame.motion


def inverse_motion(motion: NDArray[np.float32] | None, frame: Frame, other: Frame) -> NDArray[np.float32] | None:
    """Motion from a frame to another one, by the motion that leads back, or by cameras; None if both are unknown."""
    still = still_motion(frame, other.camera)
    if motion is None:
        return still
    if still is not None:
        still = still[..., : motion.shape[-1]]
    return invert_motion(motion, other.depth, still=still)


def rests(before: Frame, frame: Frame) -> bool:
    """Whether neither the camera nor anything else moves, as the pipelines decide it; without motion, cameras tell."""
    if before.camera != frame.camera:
        return False
    if frame.motion is None:
        return frame.camera is not None
    return not (np.abs(frame.motion[..., :2]) > 1e-3).any()


def _fetched_along(before: Frame, frame: Frame) -> NDArray[np.float32]:
    """The known motion; zero where there is none: the pipelines then fetch in place."""
    motion = known_motion(before, frame)
    return np.zeros((*frame.shape, 2), np.float32) if motion is None else motion


def repetitions(frames: Sequence[Frame]) -> list[float]:
    """`repetition` of the light of each frame from the second one on; in place where motion is unknown."""
    lights = [light(frame) for frame in frames]
    found, deviation = [], None
    for (before, frame), pair in zip(pairwise(frames), pairwise(lights), strict=True):
        share, deviation = repetition(pair[1], pair[0], _fetched_along(before, frame), deviation)
        found.append(share)
    return found


def light(frame: Frame) -> NDArray[np.float32]:
    """The colour without texture, as far as the albedo tells."""
    if frame.albedo is None:
        return frame.color
    where = is_reflectance(frame.albedo, frame.ids, normal=frame.normal, depth=frame.depth)
    return demodulate(frame.color, frame.albedo, emission=frame.emission, where=where)


def surface_tests(
    before: Frame, frame: Frame, motion: NDArray[np.float32], *, untested: Sequence[str] = ()
) -> dict[str, Any]:
    """Arguments of `consistency` and `reproject`: the tests of the surface that two frames have the buffers for."""
    names = [name for name in ("depth", "normal", "ids") if name not in untested]
    pairs = {name: (getattr(frame, name), getattr(before, name)) for name in names}
    known = {name: pair for name, pair in pairs.items() if pair[0] is not None and pair[1] is not None}
    tests = {name: pair[0] for name, pair in known.items()} | {f"previous_{n}": pair[1] for n, pair in known.items()}
    # The plane test needs all of these; otherwise depths are compared.
    by_plane = known.keys() >= {"depth", "normal"} and motion.shape[-1] == 3
    return {**tests, "previous_camera": before.camera if by_plane else None}


def found_again(before: Frame, frame: Frame) -> float:
    """The share of pixels whose surface the frame before shows, too; 1 if no buffers tell surfaces apart."""
    motion = _fetched_along(before, frame)
    tests = surface_tests(before, frame, motion)
    if not any(tests.get(name) is not None for name in ("depth", "normal", "ids")):
        return 1.0
    _, coverage = reproject([np.zeros(frame.shape, np.float32)], motion, filter="nearest", fallback=False, **tests)
    return float((coverage > _WHOLE).mean())


def _compared(
    firsts: Sequence[ArrayLike],
    second: Sequence[ArrayLike],
    frames: Sequence[Frame],
    tile: int,
    untested: Sequence[str],
) -> NDArray[np.float64]:
    """The sums of one frame, (results, 2, 3, h, w), from the second results for it and for the next."""
    before, frame = frames
    motion = _fetched_along(before, frame)
    tests = surface_tests(before, frame, motion, untested=untested)
    images = [np.asarray(image, np.float32) for image in (second[0], *firsts)]
    carried, coverage = reproject(images, motion, filter="nearest", fallback=False, **tests)
    finite = np.isfinite(frame.color).all(-1) & np.isfinite(second[1]).all(-1)
    known = _eroded((coverage > _WHOLE) & finite)
    b, y, after, *others = (
        np.where(known[..., None], i, 0) for i in (carried[0], frame.color, second[1], *carried[1:])
    )
    change, count = ((after - b) ** 2).mean(-1), tile_sums(known, tile)
    result = []
    for a in others:
        worse = ((a - b) * (a + b - 2 * y)).mean(-1)
        pairs = [(w * worse, w * change) for w in weights(0.5 * (a + b).mean(-1))]
        result.append([[tile_sums(one, tile), count, tile_sums(other, tile)] for one, other in pairs])
    return np.array(result)


def weights(mean: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """The weight of a squared error for each of the `WEIGHTINGS`, by the mean over the results' channels."""
    mean = np.maximum(mean, 0)
    bright = mean.astype(np.float32)
    slope = np.where(bright > 0.0031308, 1.055 / 2.4 * np.maximum(bright, 0.0031308) ** (1 / 2.4 - 1), 12.92)
    return 1 / (mean**2 + _EPSILON), np.where(bright < 1, slope**2, 0).astype(np.float32)


def _eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True where the whole 3×3 window is; outside the image counts as true."""
    for _ in range(2):
        padded = np.pad(mask, ((1, 1), (0, 0)), constant_values=True)
        mask = (padded[:-2] & padded[1:-1] & padded[2:]).T
    return mask


def tile_sums(image: NDArray[Any], tile: int) -> NDArray[np.float64]:
    """Sums over tiles; the last ones may be cut off by the image's edge."""
    rows, columns = (np.arange(0, n, tile) for n in image.shape)
    return np.add.reduceat(np.add.reduceat(image.astype(np.float64), rows, 0), columns, 1)
