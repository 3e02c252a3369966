"""Normals, albedo and ids, checked by slopes, light and the frame before."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import reproject
from ..frame import Frame
from .cameras import still_vectors
from .findings import SIGMAS, Channels, Finding, clipped, judged, tile_means
from .guides import have, jitter_between, lack, unprojected
from .hypotheses import mapping

__all__ = ["judge_albedo", "judge_ids", "judge_normals"]

#: Slope of albedo over colour from which albedo is called lit. Paint may follow normals, too, but less.
_LIT = 0.7
#: Deviation of the shares of red, green and blue from normal to normal above which an object is painted: light that is
#: left in albedo changes them little.
_HUE = 0.02
#: Share of a surface's pixels with other ids than before up to which ids are right, and from which they are wrong.
_KEEPS, _CHANGES = 0.25, 0.5
#: The form of normals in camera space.
_IN_CAMERA: dict[str, Any] = {"space": "camera"}


def judge_normals(shot: list[Frame], channels: Channels) -> Finding:
    """Normals beside the slopes of positions."""
    if (lacking := lack(shot, "normal")) is not None:
        return Finding("normal", "unchecked", f"no normals{lacking}")
    if any(frame.camera is None or (frame.position is None and frame.depth is None) for frame in shot):
        return Finding("normal", "unchecked", "no usable cameras with depth or position to compare with")
    flips = {"z forward": (1, 1, 1), "z backwards": (1, 1, -1), "y down": (1, -1, 1)}
    axes = np.eye(3)
    changes: dict[str, tuple[NDArray[np.float64], bool]] = {"world space": (axes, False)}
    changes |= {f"camera space, {how}": (np.diag(signs), True) for how, signs in flips.items()}
    changes["opposite direction"] = -axes, False
    changes["y and z swapped (z is up)"] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), False
    changes["y and z swapped (z is down)"] = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), False
    read = channels["normal"]
    remedies = [mapping("normal", m, read, **_IN_CAMERA if c else {}) for m, c in changes.values()]
    names, remedies = [*changes, "encoded from 0 to 1"], ["", *remedies[1:], "2 * normal - 1"]
    residuals: list[list[NDArray[np.float64]]] = [[] for _ in names]
    for frame in shot:
        assert frame.camera is not None
        slope, known = _slopes(frame)
        normal = np.asarray(frame.normal, np.float64)
        known = known & (np.abs(normal).sum(-1) > 0)
        to_camera = frame.camera.world_to_camera[:3, :3]
        every = [normal @ m.T @ (to_camera if c else axes) for m, c in changes.values()] + [2 * normal - 1]
        for each, guess in zip(residuals, every, strict=True):
            length = np.linalg.norm(guess, axis=-1)
            cosine = (guess * slope).sum(-1) / np.maximum(length, 1e-9)
            # Directions 60 degrees apart are as unrelated as any; encoded normals also have another length.
            each.append(tile_means(clipped(1 - cosine, 0.5) * 0.8 + 0.2 * clipped(np.abs(length - 1), 0.2), known))
    every_tile = np.array([np.concatenate(each) for each in residuals])
    witnesses = ["position" if shot[0].position is not None else "depth"]
    return judged("normal", names, remedies, every_tile, witnesses)[0]


def _slopes(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Unit normals of the surface through neighbouring positions, towards the camera, and where they are known."""
    assert frame.camera is not None
    position = np.asarray(frame.position if frame.position is not None else unprojected(frame), np.float64)
    right, down = (np.roll(position, -1, axis) - np.roll(position, 1, axis) for axis in (1, 0))
    slope = np.cross(right, down)
    length = np.linalg.norm(slope, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = slope / length
    away = position - frame.camera.position
    slope = np.where((slope * away).sum(-1, keepdims=True) > 0, -slope, slope)
    known = np.isfinite(slope).all(-1)
    known[[0, -1]] = known[:, [0, -1]] = False
    # Not across edges: neighbours have the same id and normal.
    for buffer, limit in ((frame.ids, 0), (frame.normal, 0.2)):
        if buffer is None:
            continue
        image = np.atleast_3d(np.asarray(buffer, np.float64))
        for axis in (0, 1):
            for step in (1, -1):
                known &= np.abs(np.roll(image, step, axis) - image).max(-1) <= limit
    return np.nan_to_num(slope), known


def judge_albedo(shot: list[Frame]) -> Finding:
    """Reflectance is 0 to 1, and does not follow the light."""
    if (lacking := lack(shot, "albedo")) is not None:
        return Finding("albedo", "unchecked", f"no albedo{lacking}")
    above = float(np.mean([(np.asarray(frame.albedo) > 1.001).any(-1).mean() for frame in shot]))
    below = float(np.mean([(np.asarray(frame.albedo) < 0).any(-1).mean() for frame in shot]))
    if above > 0.01:
        stored = f"above 1 at {above:.0%} of the pixels: not a reflectance"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light; 1 on metals and mirrors")
    if below > 0.01:
        return Finding("albedo", "wrong", f"negative at {below:.0%} of the pixels", "the reflectance alone")
    if all(_is_colour(frame) for frame in shot):
        stored = "contains lighting: it is the colour"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light", witnesses=("color",))
    if any(frame.normal is None or frame.ids is None for frame in shot):
        return Finding("albedo", "unclear", "from 0 to 1; without ids and normals, lighting in it cannot be told")
    found = [each for frame in shot for each in _lit(frame)]
    if len(found) < 4:
        return Finding("albedo", "unclear", "from 0 to 1; too few normals to tell whether it contains lighting")
    share, weight = np.array(found).T
    mean = float((share * weight).sum() / weight.sum())
    error = float(np.sqrt((weight**2 * (share - mean) ** 2).sum()) / weight.sum())
    if mean > max(_LIT, SIGMAS * error):
        stored = f"contains lighting: within objects it follows colour from normal to normal (slope {mean:.2f})"
        return Finding("albedo", "wrong", stored, "the reflectance alone, without light", mean, error, (), ("color",))
    stored = "reflectance, 0 to 1, without lighting"
    return Finding("albedo", "right", stored, "", 1 - mean, error, (), ("color", "normal", "ids"))


def _is_colour(frame: Frame) -> bool:
    """Whether the albedo is the colour, noise and all, as far as it is below 1."""
    albedo, color = np.asarray(frame.albedo, np.float64), np.asarray(frame.color, np.float64)
    lit = np.isfinite(color).all(-1) & (color > 0).any(-1)
    return bool(lit.any() and np.isclose(albedo, color.clip(0, 1), rtol=1e-3, atol=1e-6)[lit].all(-1).mean() > 0.9)


def _lit(frame: Frame) -> Iterator[tuple[float, float]]:
    """For each object, the slope of albedo over colour, both as functions of the normal, and its weight.

    Within an object, colour follows the normals by its lighting; albedo should not. Means over groups of like normals
    free both from texture and noise. The slope is that of logarithms: 0 for a reflectance, 1 where it is lit alike.
    Such objects are left out if hue changes with the normal: they are painted, and in even light colour follows paint.
    """
    ids, normal = np.asarray(frame.ids), np.asarray(frame.normal, np.float64)
    paint = np.asarray(frame.albedo, np.float64)
    albedo = paint.mean(-1)
    color = np.nan_to_num(np.asarray(frame.color, np.float64).mean(-1), posinf=0)
    color -= 0 if frame.emission is None else np.asarray(frame.emission, np.float64).mean(-1)
    for number in np.unique(ids[ids > 0]):
        here = (ids == number) & (albedo > 0) & np.isfinite(normal).all(-1)
        if here.sum() < 64:
            continue
        groups = np.round(normal[here] * 2) @ np.array([1.0, 10.0, 100.0])
        _, group, count = np.unique(groups, return_inverse=True, return_counts=True)
        sums = [np.bincount(group, weights=image[here]) / count for image in (albedo, color)]
        kept = (count >= 16) & (sums[1] > 0)
        if kept.sum() < 3:
            continue
        a, c = (np.log(each[kept]) for each in sums)
        weights = count[kept] / count[kept].sum()
        a, c = a - weights @ a, c - weights @ c
        variance = float(weights @ c**2)
        if variance <= 0.01:
            continue
        slope = float(weights @ (a * c)) / variance
        hues = np.stack([np.bincount(group, weights=paint[here, k])[kept] for k in range(3)])
        hues = hues / hues.sum(0)
        painted = ((hues - hues @ weights[:, None]) ** 2).sum(0) @ weights > _HUE**2
        if slope < _LIT or not painted:
            yield slope, variance * float(here.sum())


def judge_ids(shot: list[Frame]) -> Finding:
    """Surfaces keep their ids from frame to frame."""
    if (lacking := lack(shot, "ids")) is not None:
        return Finding("ids", "unchecked", f"no ids{lacking}")
    geometry = have(shot, "camera") and all(frame.depth is not None or frame.position is not None for frame in shot)
    if not (have(shot, "motion") or geometry):
        return Finding("ids", "unchecked", "no motion by which to find surfaces in the frame before")
    shares = np.concatenate([_renumbered(before, frame) for before, frame in pairwise(shot)])
    shares = shares[np.isfinite(shares)]
    told = ("motion" if have(shot, "motion") else "camera",)
    if len(shares) < 4:
        return Finding("ids", "unclear", "too few surfaces are found in the frame before", witnesses=told)
    mean, error = float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares)))
    if mean > _CHANGES:
        stored = f"{mean:.0%} of the surfaces that are found in the frame before had another id there"
        remedy = "ids that objects keep from frame to frame, or none: all history is lost with them"
        return Finding("ids", "wrong", stored, remedy, mean, error, (), told)
    if mean > _KEEPS:
        stored = f"{mean:.0%} of the surfaces that are found in the frame before had another id there"
        return Finding("ids", "unclear", stored, "", 1 - mean, error, (), told)
    return Finding("ids", "right", "surfaces keep them from frame to frame", "", 1 - mean, error, (), told)


def _renumbered(before: Frame, frame: Frame) -> NDArray[np.float64]:
    """Where a surface's id is none of the four around its place in the frame before: shares of tiles, flat."""
    motion = frame.motion
    if motion is None:
        assert frame.camera is not None
        assert before.camera is not None
        motion = still_vectors(frame, before.camera)
    motion = np.array(motion, np.float32)
    motion[..., :2] += np.float32(jitter_between(frame, before))
    tests: dict[str, Any] = {}
    for name in ("depth", "normal"):
        if have([before, frame], name):
            tests |= {name: getattr(frame, name), f"previous_{name}": getattr(before, name)}
    _, found = reproject(np.zeros(frame.shape, np.float32), motion, fallback=False, **tests)
    rows, columns = np.mgrid[: frame.height, : frame.width]
    places = np.nan_to_num(np.stack([columns, rows], -1) + motion[..., :2], posinf=0, neginf=0)
    low = np.floor(places).astype(int)
    ids, known = np.asarray(frame.ids), np.asarray(before.ids)
    kept = np.zeros(frame.shape, bool)
    for dy in (0, 1):
        for dx in (0, 1):
            x = np.clip(low[..., 0] + dx, 0, frame.width - 1)
            y = np.clip(low[..., 1] + dy, 0, frame.height - 1)
            kept |= known[y, x] == ids
    return tile_means(~kept, (found > 0.5) & (ids > 0))
