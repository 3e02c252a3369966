"""Check the conventions of a sequence's buffers against each other, and say what would make them canonical.

A convention is a hypothesis: what was stored, and the change that makes it canonical. Every hypothesis is applied to
the frames, and the disagreement that is left is measured by tile of the image. For motion, the neighbouring frame is
warped along it, and the guides (ids, positions, depths, normals, albedo; colour if these tell nothing) are compared
with those of the frame itself. Cameras are checked by projecting positions to pixels, depth by cameras and positions,
normals by the slopes of positions, motion's jitter by the motion of the cameras, albedo by colour, ids by those of the
frame before.

Disagreement is relative: 0 is perfect, 1 is that of unrelated places. The simplest hypothesis that is not significantly
worse than the best one is chosen; the margin to the next is a mean over tiles, with its standard error.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..frame import Frame
from ..io.channels import CANONICAL
from .cameras import judge_cameras, judge_cameras_by_motion
from .depth import judge_depth, judge_depth_by_motion
from .findings import Channels, Finding
from .jitter import judge_jitter
from .motion import judge_motion, judge_motion_next
from .surfaces import judge_albedo, judge_ids, judge_normals

__all__ = ["Finding", "check", "check_motion"]

#: Buffers of vectors, and the length from which these count as missing.
_VECTORS = "position", "normal", "motion", "motion_next"
_FARTHEST = 1e14


def check_motion(
    frames: Iterable[Frame], *, channels: Channels | None = None, display: tuple[int, int] | None = None
) -> Finding:
    """Find the sign, axes, unit, scale and time of motion vectors by warping neighbouring frames.

    Parameters
    ----------
    frames : iterable of Frame
        Consecutive frames of one shot with `motion`, at least two; from three on, motion that belongs to another frame
        is recognised. The guides `ids`, `position`, `depth`, `normal` and `albedo` are the witnesses; colour is used
        if there are none, or if they leave it unclear. Frames should show motion in both axes that is not constant.
        Where motion is so slow that images tell nothing, that of the cameras is the witness, if these and depth or
        position are known.
    channels : mapping of str to sequence of (float, str), optional
        For ``"motion"``, the file's channels that its components were made of, with the factors that were applied: the
        remedy names them. By default ``motion.X`` and ``motion.Y``.
    display : (int, int), optional
        Width and height of the image that the frames are a part of, if motion may be in fractions of it. By default,
        theirs.

    Returns
    -------
    Finding
        Its `matrix` makes stored vectors canonical: ``motion[..., :2] @ finding.matrix.T``.

    Raises
    ------
    TypeError
        If one is no `Frame`.
    ValueError
        If there are fewer than two frames, of several sizes, or some without motion.

    Examples
    --------
    Vertical motion points up, as Blender stores it:

    >>> rng = np.random.default_rng(0)
    >>> texture = rng.random((80, 120, 3), np.float32)
    >>> steps = [(0, 0), (3, 5), (8, 7)]  # rows and columns by which the image has moved
    >>> frames = []
    >>> for i, (y, x) in enumerate(steps):
    ...     down, right = np.subtract(steps[max(i - 1, 0)], steps[i])
    ...     motion = np.full((80, 120, 2), (right, -down), np.float32)
    ...     image = np.roll(texture, (y, x), (0, 1))
    ...     frames.append(yester.Frame(image, albedo=image, motion=motion))
    >>> finding = yester.check_motion(frames)
    >>> finding.verdict, finding.stored
    ('wrong', 'y up')
    >>> finding.remedy
    '--map motion=motion.X,-motion.Y'
    """
    shot = _shot(frames)
    if any(frame.motion is None for frame in shot):
        raise ValueError("frames: expected motion in each of them")
    return judge_motion(shot, _named(channels), display)[0]


def check(
    frames: Iterable[Frame], *, channels: Channels | None = None, display: tuple[int, int] | None = None
) -> list[Finding]:
    """Check the conventions of all buffers of a sequence.

    Parameters
    ----------
    frames : iterable of Frame
        Consecutive frames of one shot, at least two; about five are enough.
    channels : mapping of str to sequence of (float, str), optional
        As for `check_motion`; also for ``"motion_next"``, ``"depth"`` and ``"normal"``.
    display : (int, int), optional
        As for `check_motion`.

    Returns
    -------
    list of Finding
        On cameras, depth, motion, jitter, normals, albedo and ids, and on `motion_next` if frames have it. What is
        found wrong is corrected before the next is checked, so that one mistake is reported once. Cameras that no
        convention makes fit are not used.

    Raises
    ------
    TypeError
        If one is no `Frame`.
    ValueError
        If there are fewer than two frames, or of several sizes.

    Examples
    --------
    Depth is stored as the distance along the ray:

    >>> camera = yester.Camera.from_look_at([1, 2, 5], [0, 0, 0], [0, 1, 0], 60, 96, 64)
    >>> position = camera.unproject(np.stack(np.mgrid[:64, :96][::-1], -1) + 0.5, np.full((64, 96), 5.0))
    >>> distance = np.linalg.norm(position - camera.position, axis=-1)
    >>> frame = yester.Frame(np.ones((64, 96, 3)), depth=distance, position=position, camera=camera)
    >>> cameras, depth, *_ = yester.check([frame, frame])
    >>> cameras.verdict, depth.verdict, depth.stored
    ('right', 'wrong', 'distance along the ray')
    >>> depth.remedy
    '--map depth=depth.Z --map depth.kind=distance'
    """
    shot, names = _shot(frames), _named(channels)
    cameras, shot = judge_cameras(shot)
    depth, shot = judge_depth(shot, names)
    motion, shot = judge_motion(shot, names, display)
    if cameras.verdict == "unchecked":
        cameras, shot = judge_cameras_by_motion(shot)
    if depth.verdict == "unchecked":
        depth, shot = judge_depth_by_motion(shot, names)
    normal = judge_normals(shot, names)
    if normal.verdict == "wrong" and cameras.verdict not in ("right", "wrong"):
        normal = replace(normal, verdict="unclear", stored=f"{normal.stored}, if the cameras are right")
    found = [cameras, depth, motion, judge_jitter(shot), normal, judge_albedo(shot), judge_ids(shot)]
    if any(frame.motion_next is not None for frame in shot):
        found.append(judge_motion_next(shot, names, display))
    return found


def _named(channels: Channels | None) -> dict[str, Sequence[tuple[float, str]]]:
    return {
        name: [(1.0, channel) for channel in CANONICAL[name]] for name in ("motion", "motion_next", "depth", "normal")
    } | {**(channels or {})}


def _shot(frames: Iterable[Frame]) -> list[Frame]:
    shot = list(frames)
    for number, frame in enumerate(shot):
        if not isinstance(frame, Frame):
            raise TypeError(f"frames: expected yester.Frame, got {type(frame).__name__} at {number}")
    if len(shot) < 2:
        raise ValueError(f"frames: expected at least two, got {len(shot)}")
    if len({frame.shape for frame in shot}) > 1:
        raise ValueError(f"frames: expected one size, got {sorted({frame.shape for frame in shot})}")
    return [_bounded(frame) for frame in shot]


def _bounded(frame: Frame) -> Frame:
    """NaN for vectors that are infinite, or so long that their squares may overflow."""
    given = {name: vectors for name, vectors in frame.buffers().items() if name in _VECTORS}
    bounded: dict[str, Any] = {
        name: np.where(np.abs(vectors) < _FARTHEST, vectors, np.float32(np.nan)) for name, vectors in given.items()
    }
    return replace(frame, **bounded)
