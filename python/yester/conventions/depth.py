"""Depth, checked by cameras and positions, or by cameras and motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from .cameras import still_vectors
from .findings import Channels, Finding, clipped, judged, tile_means
from .guides import lack
from .hypotheses import mapping

__all__ = ["judge_depth", "judge_depth_by_motion"]

_Z, _RAY = "distance along the camera axis", "distance along the ray"


def judge_depth(shot: list[Frame], channels: Channels) -> tuple[Finding, list[Frame]]:
    """Stored depth beside that of positions."""
    if (lacking := lack(shot, "depth")) is not None:
        return Finding("depth", "unchecked", f"no depth{lacking}"), shot
    if any(frame.camera is None or frame.position is None for frame in shot):
        return Finding("depth", "unchecked", "no usable cameras and positions to compare with"), shot
    # The expected convention comes first, even if nothing can be compared.
    residuals: dict[str, list[NDArray[np.float64]]] = {_Z: []}
    remedies = {_Z: ""}
    exact = []
    for frame in shot:
        assert frame.camera is not None
        assert frame.position is not None
        position = np.nan_to_num(np.asarray(frame.position, np.float64))
        z = frame.camera.project(position)[1]
        ray = np.linalg.norm(position - frame.camera.position, axis=-1)
        stored = np.asarray(frame.depth, np.float64)
        known = np.isfinite(frame.position).all(-1) & np.isfinite(stored) & (z > 0)
        exact.append(np.where(np.isfinite(frame.position).all(-1), z, np.inf))
        for name, (expected, remedy) in _depths(stored, z, ray, known, channels).items():
            remedies.setdefault(name, remedy)
            # A hundredth of the depth is as wrong as anything.
            error = clipped(np.abs(stored - expected), 0.01 * np.maximum(np.abs(expected), 1e-9))
            residuals.setdefault(name, []).append(tile_means(error, known))
    # Frames that show nothing but background have none.
    names = [name for name, each in residuals.items() if len(each) == len(residuals[_Z])]
    every = np.array([np.concatenate([np.empty(0), *residuals[name]]) for name in names])
    finding, chosen = judged("depth", names, [remedies[name] for name in names], every, ["position"])
    return finding, [replace(f, depth=z) for f, z in zip(shot, exact, strict=True)] if chosen else shot


def _depths(
    stored: NDArray[np.float64],
    z: NDArray[np.float64],
    ray: NDArray[np.float64],
    known: NDArray[np.bool_],
    channels: Channels,
) -> dict[str, tuple[NDArray[np.float64], str]]:
    """By name, the depth that a convention would store, and how to undo it."""
    if not known.any():
        return {}
    d, a, r = (image[known] for image in (stored, z, ray))
    near_z, near_ray = float(np.median(a - d)), float(np.median((r - d) * a / r))
    unit = float(np.median(d / a))

    def read(factor: float = 1, **form: Any) -> str:
        return mapping("depth", np.array([[factor]]), channels["depth"], **form)

    found = {_Z: (z, ""), _RAY: (ray, read(kind="distance"))}
    # What hardly differs from the expected convention is none of its own.
    some = 1e-3 * float(np.median(a))
    if near_z > some:
        found[f"{_Z}, from the near plane"] = z - near_z, read(near=f"{near_z:.4g}")
    if near_ray > some:
        from_plane = ray - near_ray * ray / np.where(z > 0, z, 1)
        found[f"{_RAY}, from the near plane"] = from_plane, read(kind="distance", near=f"{near_ray:.4g}")
    found[f"negative {_Z}"] = -z, read(-1)
    if unit and abs(unit - 1) > 1e-3:
        found["in another unit"] = unit * z, read(float(f"{1 / unit:.4g}"))
    # A depth buffer is linear in 1/z; two quantiles give the line.
    order = np.argsort(a)
    low, high = order[len(order) // 10], order[-1 - len(order) // 10]
    slope = (d[low] - d[high]) / (1 / a[low] - 1 / a[high]) if a[high] > a[low] else 0.0
    offset = d[low] - slope / a[low]
    if slope:
        depth_buffer = offset + slope / np.where(z > 0, z, 1)
        found["a depth buffer (linear in 1/z)"] = depth_buffer, f"{slope:.4g} / (depth - {offset:.4g})"
    return found


def judge_depth_by_motion(shot: list[Frame], channels: Channels) -> tuple[Finding, list[Frame]]:
    """The motion of a still scene of that depth is that of the vectors."""
    missing = [name for name in ("depth", "camera", "motion") if any(getattr(f, name) is None for f in shot)]
    if missing:
        return Finding("depth", "unchecked", f"no usable {', '.join(missing)}"), shot
    names, forward, back = [_Z, _RAY, f"negative {_Z}"], np.eye(1), -np.eye(1)
    read = channels["depth"]
    remedies = ["", mapping("depth", forward, read, kind="distance"), mapping("depth", back, read)]
    changed: list[list[Frame]] = [[], [], []]
    for frame in shot:
        assert frame.camera is not None
        cosine = frame.camera.rays()[1] @ frame.camera.forward
        depth = np.asarray(frame.depth)
        for each, factor in zip(changed, (np.ones(()), cosine, np.array(-1.0)), strict=True):
            each.append(replace(frame, depth=np.where(np.isfinite(depth), depth * factor, np.inf), position=None))
    residuals = []
    for kind in changed:
        tiles = []
        for before, frame in pairwise(kind):
            assert before.camera is not None
            assert frame.camera is not None
            known = np.isfinite(np.asarray(frame.motion)).all(-1) & np.isfinite(np.asarray(frame.depth))
            motion = np.asarray(frame.motion)[..., :2]
            off = np.linalg.norm(still_vectors(frame, before.camera) - motion, axis=-1)
            length = np.linalg.norm(motion, axis=-1)
            tiles.append(tile_means(clipped(off, 0.02 * length + 0.01), known))
        residuals.append(np.concatenate(tiles))
    finding, chosen = judged("depth", names, remedies, np.array(residuals), ["motion", "camera"])
    return finding, changed[chosen] if chosen else shot
