"""Cameras, checked by the positions that they project and by the motion that they explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import Camera
from ..frame import Frame
from ..judge import still_motion
from .findings import Finding, Floats, clipped, judged, tile_means
from .guides import sample_places

__all__ = ["judge_cameras", "judge_cameras_by_motion", "relative_distance", "still_vectors"]


def still_vectors(frame: Frame, before: Camera | None) -> NDArray[np.float32]:
    """Motion of a still scene from a frame of known geometry to a camera."""
    motion = still_motion(frame, before)
    assert motion is not None
    return motion[..., :2]


#: From [0, 1] with y down to clip space.
_FROM_UV = np.array([[2.0, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
#: Names, changes of world_to_clip, and how to write them.
_LAYOUTS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "world to clip, for column vectors": (lambda m: m, ""),
    "transposed (for row vectors)": (lambda m: m.T, "Camera(world_to_clip.T, width, height)"),
    "y down": (lambda m: np.diag([1, -1, 1, 1]) @ m, "Camera(np.diag([1, -1, 1, 1]) @ world_to_clip, width, height)"),
    "x left (of the other handedness)": (
        lambda m: np.diag([-1, 1, 1, 1]) @ m,
        "Camera(np.diag([-1, 1, 1, 1]) @ world_to_clip, width, height)",
    ),
    "x left and y down (looks backwards)": (
        lambda m: np.diag([-1, -1, 1, 1]) @ m,
        "Camera(np.diag([-1, -1, 1, 1]) @ world_to_clip, width, height)",
    ),
    "w negative in front": (
        lambda m: np.diag([1, 1, 1, -1]) @ m,
        "Camera(np.diag([1, 1, 1, -1]) @ world_to_clip, width, height)",
    ),
    "all negative": (lambda m: -m, "Camera(-world_to_clip, width, height)"),
    "to [0, 1] with y down": (
        lambda m: _FROM_UV @ m,
        "Camera(np.array([[2, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]]) @ world_to_clip, width, height)",
    ),
    "inverted (clip to world)": (np.linalg.inv, "Camera(np.linalg.inv(world_to_clip), width, height)"),
    "transposed, y down": (
        lambda m: np.diag([1, -1, 1, 1]) @ m.T,
        "Camera(np.diag([1, -1, 1, 1]) @ world_to_clip.T, width, height)",
    ),
    "transposed, x left": (
        lambda m: np.diag([-1, 1, 1, 1]) @ m.T,
        "Camera(np.diag([-1, 1, 1, 1]) @ world_to_clip.T, width, height)",
    ),
}


def _laid_out(camera: Camera, change: Callable[[Any], Any]) -> Camera | None:
    try:
        return Camera(change(camera.world_to_clip), camera.width, camera.height)
    except (ValueError, np.linalg.LinAlgError):
        return None


def _alternatives(shot: list[Frame]) -> dict[str, tuple[list[Camera | None], str]]:
    """By name of the hypothesis, each frame's camera and the remedy."""
    given = [frame.camera for frame in shot]
    found: dict[str, tuple[list[Camera | None], str]] = {
        name: ([camera and _laid_out(camera, change) for camera in given], remedy)
        for name, (change, remedy) in _LAYOUTS.items()
    }
    found["of the next frame"] = [None, *given[:-1]], "each frame's camera from the file of the previous frame"
    found["of the previous frame"] = [*given[1:], None], "each frame's camera from the file of the next frame"
    return found


def judge_cameras(shot: list[Frame]) -> tuple[Finding, list[Frame]]:
    """Positions are projected to the pixels that show them."""
    if any(frame.camera is None for frame in shot):
        return Finding("cameras", "unchecked", "no cameras"), shot
    if any(frame.position is None for frame in shot):
        return Finding("cameras", "unchecked", "no positions to project"), shot

    def distance(cameras: list[Camera | None], i: int) -> NDArray[np.float64]:
        frame, camera = shot[i], cameras[i]
        position = np.asarray(frame.position, np.float64)
        known = np.asarray(np.isfinite(position).all(-1))
        if camera is None:
            return tile_means(np.ones(frame.shape), known)
        pixels, _ = camera.project(np.nan_to_num(position))
        return tile_means(clipped(np.linalg.norm(pixels - sample_places(frame), axis=-1), 4), known)

    part = range(1, len(shot) - 1) if len(shot) > 2 else range(len(shot))
    return _layout(shot, part, distance, ["position"])


def judge_cameras_by_motion(shot: list[Frame]) -> tuple[Finding, list[Frame]]:
    """The motion of a still scene between two cameras is that of the vectors."""
    if any(frame.camera is None for frame in shot):
        return Finding("cameras", "unchecked", "no cameras"), shot
    missing = [name for name in ("depth", "motion") if any(getattr(f, name) is None for f in shot)]
    if missing:
        return Finding("cameras", "unchecked", f"no positions, and no {' or '.join(missing)}"), shot

    def distance(cameras: list[Camera | None], i: int) -> NDArray[np.float64]:
        frame, before = replace(shot[i], camera=cameras[i]), cameras[i - 1]
        known = np.isfinite(np.asarray(frame.motion)).all(-1)
        if frame.camera is None or before is None:
            return tile_means(np.ones(frame.shape), known)
        return tile_means(relative_distance(still_vectors(frame, before), np.asarray(frame.motion)[..., :2]), known)

    part = range(2, len(shot) - 1) if len(shot) > 3 else range(1, len(shot))
    return _layout(shot, part, distance, ["motion", "depth"])


def relative_distance(vectors: Floats, motion: Floats) -> NDArray[np.float64]:
    """Difference of vectors from a motion, relative to its length."""
    length = np.linalg.norm(motion, axis=-1)
    return clipped(np.linalg.norm(vectors - motion.astype(np.float64), axis=-1), 0.25 * length + 0.1)


def _layout(
    shot: list[Frame],
    part: range,
    distance: Callable[[list[Camera | None], int], NDArray[np.float64]],
    witnesses: list[str],
) -> tuple[Finding, list[Frame]]:
    """The alternative whose cameras have the least distance in a part of the frames; none if none fits."""
    every = _alternatives(shot)
    cameras, remedies = ([*each] for each in zip(*every.values(), strict=True))
    residuals = np.array([np.concatenate([distance(kind, i) for i in part]) for kind in cameras])
    finding, chosen = judged("cameras", [*every], remedies, residuals, witnesses)
    right = [None] * len(shot) if chosen is None else cameras[chosen]
    return finding, [replace(f, camera=c) for f, c in zip(shot, right, strict=True)]
