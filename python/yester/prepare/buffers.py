"""The images that a training set has for each frame: the frame's own buffers, and those that earlier frames add."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .._core import SVGF, accumulate, collect_warnings, demodulate, estimate_variance, is_reflectance, reproject
from ..frame import Frame, present
from ..judge import UNMOVED, known_motion, surface_tests

__all__ = ["CHANNELS", "DERIVED", "MOVING", "derive", "filled", "halve", "needs"]

Images = dict[str, NDArray[Any]]

#: Every image by name, and its number of channels.
CHANNELS: dict[str, int] = {
    "color": 3,
    "albedo": 3,
    "normal": 3,
    "depth": 1,
    "motion": 2,
    "ids": 1,
    "position": 3,
    "emission": 3,
    "object_normal": 3,
    "replay": 3,
    "hit_distance": 1,
    "reactive": 1,
    "demodulated": 3,
    "history": 3,
    "history_length": 1,
    "validity": 1,
    "difference": 3,
    "variance": 1,
    "denoised": 3,
    "reference": 3,
}

#: Those that are computed.
DERIVED = ("demodulated", "history", "history_length", "validity", "difference", "variance", "denoised")
_TEMPORAL = {"history", "history_length", "validity", "difference", "variance"}
#: Those that need the motion of every frame but the first.
MOVING = {"motion", "denoised", *_TEMPORAL}

#: Smallest weight of the new sample in the history: that of `SVGF`.
ALPHA = 0.2

#: At half size, these are of one pixel of the four: the one nearest to the camera.
_OF_ONE = {"normal", "depth", "motion", "ids", "position", "object_normal", "hit_distance", "reactive"}
#: Those of a pixel's new sample, and the variance of such a sample.
_OF_SAMPLE = {"color", "demodulated", "difference", "variance"}


def needs(name: str, known: Collection[str]) -> str | None:
    """What is missing for an image, given a sequence's buffers (and ``"camera"``); None if nothing is."""
    places = "camera" in known and ("depth" in known or "position" in known)
    of = f", which {name} is made of" if name in DERIVED else ""
    if name in MOVING:
        return None if "motion" in known or places else f"{UNMOVED}{of}"
    source = "albedo" if name == "demodulated" else name
    return None if source in known else f"no {source}{of}"


def derive(
    frames: Iterable[Frame], wanted: Collection[str], remark: Callable[[str], object] = warnings.warn
) -> Iterator[tuple[Images, int]]:
    """Compute the images of each frame of a sequence.

    Parameters
    ----------
    frames : iterable of Frame
        In order, of one size.
    wanted : collection of str
        Names in `CHANNELS`; ``reference``, which frames do not have, is left out.
    remark : callable, optional
        Gets what ``denoised`` warns of: motion that seems wrong, and noise that repeats. By default a `UserWarning`.

    Yields
    ------
    images : dict of str to (H, W) or (H, W, C) ndarray
        In the order of `CHANNELS`.
    missing : int
        The number of pixels without a finite colour, which are 0 in ``color``, ``demodulated`` and ``difference``.

    Raises
    ------
    ValueError
        If frames differ in size, or an image needs the motion of a frame, other than the first, that is unknown.

    Notes
    -----
    With c the colour, m the motion and h the mean of the earlier frames (`accumulate` with alpha 0.2):

    - ``history`` is h carried along m (`reproject`, validated by depth, normals and ids where frames have them), before
      c is merged into it; ``history_length`` its number of samples; ``validity`` the valid fraction of its footprint,
      0 to 1. All are 0 in the first frame, and where nothing is carried.
    - ``difference`` is c minus the previous frame's c carried along m; 0 where nothing is carried.
    - ``variance`` is that of a sample's luminance, over the frames until this one (`estimate_variance`).
    - ``denoised`` is what ``SVGF()`` makes of this frame and the earlier ones.
    - ``demodulated`` is c divided by the albedo, as `demodulate` does, where it `is_reflectance`.
    - ``motion`` is computed from the cameras where frames have none; 0 where it is not finite, and in the first frame.
    """
    wanted = set(wanted)
    denoiser = SVGF() if "denoised" in wanted else None
    before: Frame | None = None
    known: Any = None
    for frame in frames:
        if before is not None and frame.shape != before.shape:
            (height, width), (own, across) = before.shape, frame.shape
            expected = f"height {height} and width {width}, as in earlier frames"
            raise ValueError(f"expected {expected}, got height {own} and width {across}")
        motion = None if before is None else known_motion(before, frame)
        if before is not None and motion is None and wanted & MOVING:
            raise ValueError(UNMOVED)
        images: Images = dict(frame.buffers())
        seen = np.isfinite(frame.color).all(-1)
        images["color"] = present(frame)
        if "motion" in wanted:
            images["motion"] = np.zeros((*frame.shape, 2), np.float32)
            if motion is not None:
                np.copyto(images["motion"], motion[..., :2], where=np.isfinite(motion[..., :2]))
        if "demodulated" in wanted and frame.albedo is not None:
            where = is_reflectance(frame.albedo, frame.ids, normal=frame.normal, depth=frame.depth)
            images["demodulated"] = demodulate(images["color"], frame.albedo, emission=frame.emission, where=where)
        if wanted & _TEMPORAL:
            temporal, known = _carried(frame, before, known, motion)
            images |= temporal
        if "variance" in wanted:
            guides = {name: getattr(frame, name) for name in ("depth", "normal", "ids")}
            images["variance"] = estimate_variance(known.moments, known.history_length, **guides)
        if denoiser is not None:
            output, said = collect_warnings(denoiser.step, frame)
            images["denoised"] = output.color
            for text in said:
                remark(text)
        before = frame
        yield {name: images[name] for name in CHANNELS if name in wanted and name in images}, int((~seen).sum())


def _carried(frame: Frame, before: Frame | None, known: Any, motion: NDArray[np.float32] | None) -> tuple[Images, Any]:
    """What the frames before are for this one, and the history with this frame in it."""
    if before is None or motion is None:
        mean, moments, length, validity = (np.zeros((*frame.shape, *c), np.float32) for c in ((3,), (2,), (), ()))
        difference = np.zeros_like(mean)
    else:
        # Missing samples are filled from history.
        former = np.where(np.isfinite(before.color).all(-1, keepdims=True), before.color, known.color)
        images = [known.color, known.moments, known.history_length, former]
        (mean, moments, length, former), validity = reproject(images, motion, **surface_tests(before, frame, motion))
        both = np.isfinite(frame.color).all(-1) & (validity > 0)
        difference = np.where(both[..., None], frame.color - former, np.float32(0))
    found = {"history": mean, "history_length": length, "validity": validity, "difference": difference}
    return found, accumulate(frame.color, mean, moments, length, confidence=validity, alpha=ALPHA)


def halve(
    images: Images,
    depth: NDArray[np.float32] | None = None,
    validity: NDArray[np.float32] | None = None,
    missing: NDArray[np.bool_] | None = None,
) -> Images:
    """The images at half size.

    Parameters
    ----------
    images : dict of str to (H, W) or (H, W, C) ndarray
        As `derive` gives them. Of an odd size, the last row or column makes blocks of its own.
    depth : (H, W) ndarray, optional
        Of the frame. NaN is behind all else.
    validity : (H, W) ndarray, optional
        Of the frame: where it is 0, ``history`` is 0 for want of any. By default it counts everywhere.
    missing : (H, W) ndarray of bool, optional
        Pixels without a finite colour in the frame, which are 0 in the images of `derive`. By default none: such zeros
        count.

    Returns
    -------
    dict of str to ndarray
        Of height and width H/2 and W/2, rounded up. Colours, ``validity`` and ``history_length`` are means of four
        pixels, at an odd edge of fewer, and ``variance`` that of such a mean. Geometry is that of the nearest pixel of
        the four by `depth`, or else of the upper left one, and ``motion`` is in pixels of the half size.

    Notes
    -----
    Means are of the finite pixels of the four: of those that are not `missing` for ``color``, ``demodulated``,
    ``difference`` and ``variance``, and of those with `validity` for ``history``. Where there are none, the upper left
    pixel is kept.
    """
    result: Images = {}
    nearest = None if depth is None else np.where(np.isnan(four := _four(depth)), np.inf, four).argmin(0)
    height, width = next(iter(images.values())).shape[:2]
    inside = _four(np.ones((height, width), bool), "constant")
    sampled = None if missing is None else ~_four(missing)
    carried = None if validity is None else _four(validity) > 0
    for name, image in images.items():
        four = _four(image)
        if name in _OF_ONE:
            index = np.zeros(four.shape[1:3], np.intp) if nearest is None else nearest
            half = np.take_along_axis(four, index.reshape(1, *index.shape, *[1] * (image.ndim - 2)), 0)[0]
            half = half * np.float32(0.5) if name == "motion" else half
        else:
            known = np.isfinite(four).reshape(*four.shape[:3], -1).all(-1)
            known &= inside
            if sampled is not None and name in _OF_SAMPLE:
                known &= sampled
            if carried is not None and name == "history":
                known &= carried
            known = known.reshape(*known.shape, *[1] * (image.ndim - 2))
            number = np.maximum(known.sum(0, dtype=np.float32), 1)
            half = np.where(known.any(0), np.where(known, four, 0).sum(0, dtype=np.float32) / number, four[0])
            half = half / number if name == "variance" else half
        result[name] = np.ascontiguousarray(half)
    return result


def filled(images: Images) -> tuple[Images, list[str]]:
    """The images as a set has them, and remarks: NaN that tells nothing would make a loss NaN.

    Pixels with a component that is not finite are 0. ``depth`` and ``hit_distance`` are infinite where nothing is hit,
    and for NaN. ``position`` is not finite where nothing is hit, and ``replay`` NaN where another surface is visible.
    """
    result, remarks = dict(images), []
    for name, image in images.items():
        if name in ("position", "replay") or image.dtype.kind != "f":
            continue
        if far := name in ("depth", "hit_distance"):
            lacking = np.isnan(image)
        else:
            lacking = np.logical_not(np.isfinite(image).reshape(*image.shape[:2], -1).all(-1))
        if lacking.any():
            result[name] = image.copy()
            result[name][lacking] = np.inf if far else 0
            remarks.append(f"{name}: NaN is stored as infinity" if far else f"{name}: missing pixels are stored as 0")
    return result, remarks


def _four(image: NDArray[Any], beyond: Literal["edge", "constant"] = "edge") -> NDArray[Any]:
    """The pixels of each 2×2 block, (4, H/2, W/2, ...); beyond the image, those of its edge, or 0."""
    height, width = image.shape[:2]
    image = np.pad(image, [(0, height % 2), (0, width % 2), *[(0, 0)] * (image.ndim - 2)], beyond)
    return np.stack([image[y::2, x::2] for y in (0, 1) for x in (0, 1)])
