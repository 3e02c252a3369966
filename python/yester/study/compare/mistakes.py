"""Mistakes planted in exact sequences, and what `yester.check` says: ``python -m yester.study.compare.mistakes``.

A small ray-cast room is seen by a camera that speeds up, with a ball that rolls and a box that turns. The mistakes of
exporters are made with its buffers, one at a time, and the sequence is checked.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from yester import Camera, Frame, check, jitter
from yester.conventions import Finding

from ..synthetic import raycast
from ..synthetic.raycast import Box, Light, Rectangle, Scene, Sphere, Thing, checker, translate, turn, value_noise

__all__ = ["MISTAKES", "Mistake", "findings", "sequence", "table"]

Change: TypeAlias = Callable[[list[Frame]], list[Frame]]

_WIDTH, _HEIGHT, _COUNT = 160, 120, 7


@dataclass(frozen=True)
class Mistake:
    """A mistake, and what is to be said of it.

    Attributes
    ----------
    name : str
    subject : str
        The buffer that it concerns, as `yester.Finding` has it; empty if there is no mistake.
    stored : str
        How the finding begins.
    make : callable
        Turns right frames into wrong ones.
    buffers : tuple of str
        The buffers that the frames have besides colour; by default all.
    jittered : bool, default False
        Samples are jittered, all alike and known, instead of spread over their pixels.
    """

    name: str
    subject: str
    stored: str
    make: Change
    buffers: tuple[str, ...] = ("albedo", "normal", "depth", "motion", "ids", "position", "emission", "camera")
    jittered: bool = False


def scene(number: int) -> Scene:
    """The room at a frame; what moves becomes faster."""
    t = number + 0.2 * number**2
    floor = Thing(Rectangle(), turn([1, 0, 0], -90), value_noise((0.75, 0.68, 0.55), (0.4, 0.33, 0.25), 0.25))
    wall = Thing(Rectangle(), translate(0, 0, -2), checker((0.8, 0.78, 0.7), (0.45, 0.5, 0.42), 0.5))
    ball = Thing(Sphere(0.45), translate(-0.9 + 0.05 * t, 0.45, 0.2) @ turn([0, 0, 1], -6 * t), (0.8, 0.25, 0.2))
    place = translate(0.8, 0.6, -0.4) @ turn([0.2, 1, 0.1], 20 + 2 * t)
    box = Thing(Box((0.8, 0.9, 0.7)), place, checker((0.15, 0.3, 0.6), (0.7, 0.7, 0.6), 0.25))
    camera = Camera.from_look_at(
        *([0.07 * t, 1.0 + 0.05 * t, 3.6 - 0.06 * t], [0.04 * t, 0.5 - 0.02 * t, 0], [0.05, 1, 0], 55, _WIDTH, _HEIGHT)
    )
    lights = (Light((1.5, 3.0, 2.5), (9.0, 8.0, 6.5)), Light((-1.0, 0.8, 0.6), (0.25, 0.3, 0.45), distant=True))
    return Scene((floor, wall, ball, box), camera, lights)


@cache
def _sequence(deviation: float, jittered: bool, seed: int) -> tuple[Frame, ...]:
    rng = np.random.default_rng(seed)
    scenes = [scene(number) for number in range(_COUNT)]
    offsets = jitter(_COUNT) if jittered else [None] * _COUNT
    pairs = zip([scenes[0], *scenes], scenes, offsets, strict=False)
    return tuple(raycast.shoot(now, before, rng, deviation=deviation, jitter=offset) for before, now, offset in pairs)


def sequence(*, deviation: float = 0.5, jittered: bool = False, seed: int = 0) -> list[Frame]:
    """Right frames.

    Parameters
    ----------
    deviation : float, default 0.5
        Relative deviation of the light's noise.
    jittered : bool, default False
        Samples are jittered, all alike and known, instead of spread over their pixels.
    seed : int, default 0

    Returns
    -------
    list of Frame
    """
    return [*_sequence(deviation, jittered, seed)]


def findings(mistake: Mistake, **named: Any) -> list[Finding]:
    """What is said of the sequence with one mistake."""
    right = sequence(jittered=mistake.jittered, **named)
    wrong = mistake.make(right)
    kept = {*mistake.buffers, "jitter"}
    every = {name for frame in wrong for name in (*frame.buffers(), "camera")}
    absent: dict[str, Any] = dict.fromkeys(every - kept - {"color"})
    return check([replace(frame, **absent) for frame in wrong])


def table(**named: Any) -> str:
    """All mistakes, in which frames, and what was said, in Markdown."""
    lines = ["| planted | buffers | samples | found in | what was said | margin |", "|---|---|---|---|---|---|"]
    for mistake in MISTAKES:
        said = [f for f in findings(mistake, **named) if f.verdict == "wrong" or f.subject == mistake.subject]
        few = "all" if mistake.buffers == Mistake.buffers else ", ".join(mistake.buffers)
        samples = "jittered" if mistake.jittered else "random"
        for finding in said or [Finding("", "right", "nothing is wrong")]:
            margin = f"{finding.margin:.3f} ± {finding.error:.3f}" if np.isfinite(finding.margin) else ""
            text = f"{finding.verdict}: {finding.stored}" if finding.subject else finding.stored
            cells = mistake.name, few, samples, finding.subject or "-", text, margin
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _each(name: str, change: Callable[[Frame, Any], Any]) -> Change:
    """A change of one buffer of every frame."""
    return lambda frames: [replace(frame, **{name: change(frame, getattr(frame, name))}) for frame in frames]


def _moved(matrix: Sequence[Sequence[float]], zero: float = 0.0) -> Change:
    """Stored vectors of which canonical ones would be made by the inverse."""
    m = np.array(matrix, np.float64)
    return _each("motion", lambda _, motion: (motion[..., :2] @ m.T + zero).astype(np.float32))


def _shifted(name: str, by: int) -> Change:
    """A buffer of another frame."""

    def change(frames: list[Frame]) -> list[Frame]:
        last = len(frames) - 1
        return [
            replace(frame, **{name: getattr(frames[min(max(i + by, 0), last)], name)}) for i, frame in enumerate(frames)
        ]

    return change


def _forward(sign: float) -> Change:
    """Motion to the next frame instead of from the previous one; none in the last."""

    def change(frames: list[Frame]) -> list[Frame]:
        result = []
        for i, frame in enumerate(frames):
            pixels = _pixels(frame)
            now, after = scene(i), scene(min(i + 1, len(frames) - 1))
            vectors = sign * raycast.motion(raycast.cast(now, pixels), after)[..., :2]
            result.append(replace(frame, motion=vectors.astype(np.float32)))
        return result

    return change


def _pixels(frame: Frame) -> NDArray[np.float64]:
    assert frame.camera is not None
    assert frame.position is not None
    return frame.camera.project(frame.position)[0]


def _relayed(change: Callable[[NDArray[np.float64]], Any]) -> Change:
    return _each("camera", lambda _, camera: Camera(change(camera.world_to_clip), camera.width, camera.height))


def _ray(frame: Frame) -> NDArray[np.float64]:
    assert frame.camera is not None
    assert frame.position is not None
    return np.asarray(np.linalg.norm(frame.position - frame.camera.position, axis=-1))


def _shaken(sign: float) -> Change:
    """Motion between projections of jittered cameras."""

    def change(frames: list[Frame]) -> list[Frame]:
        pairs = zip([frames[0], *frames], frames, strict=False)
        shifts = [np.subtract(frame.jitter or (0, 0), before.jitter or (0, 0)) for before, frame in pairs]
        shaken = []
        for frame, shift in zip(frames, shifts, strict=True):
            assert frame.motion is not None
            shaken.append(replace(frame, motion=(frame.motion[..., :2] + sign * shift).astype(np.float32)))
        return shaken

    return change


def _unmarked(change: Change) -> Change:
    """A mistake in frames that do not tell their jitter."""
    return lambda frames: [replace(frame, jitter=None) for frame in change(frames)]


def _in_camera(sign: Sequence[float]) -> Change:
    def change(frame: Frame, normal: Any) -> Any:
        assert frame.camera is not None
        return ((normal @ frame.camera.world_to_camera[:3, :3].T) * sign).astype(np.float32)

    return _each("normal", change)


def _lit(frame: Frame, albedo: Any) -> Any:
    """Albedo times the light that a denoiser might have left in it."""
    assert frame.normal is not None
    light = 0.25 + 0.75 * np.clip(frame.normal @ np.array([0.4, 0.7, 0.6], np.float32), 0, None)
    return albedo * light[..., None]


def _noise(frames: list[Frame]) -> list[Frame]:
    rng = np.random.default_rng(0)
    return [replace(frame, motion=rng.normal(0, 4, (*frame.shape, 2)).astype(np.float32)) for frame in frames]


_W, _H = _WIDTH, _HEIGHT
_FEW = ("albedo", "normal", "motion")
_RAYS = ("albedo", "normal", "depth", "motion", "ids", "camera")

_RIGHT: Change = list
_Y_UP = _moved([[1, 0], [0, -1]])
_NEGATED = _moved([[-1, 0], [0, -1]])
_NDC_UP = _moved([[2 / _W, 0], [0, -2 / _H]])
_BACKWARDS = _in_camera((1, 1, -1))
_CLIP_DOWN = _relayed(lambda m: np.diag([1, -1, 1, 1]) @ m)
_UV = np.array([[0.5, 0, 0, 0.5], [0, -0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])
_ALONG_RAY = _each("depth", lambda frame, _: _ray(frame))
_FROM_NEAR = _each("depth", lambda frame, depth: _ray(frame) * (1 - 0.2 / depth))
_Z_UP = _each("normal", lambda _, normal: normal[..., [0, 2, 1]] * np.array([1, -1, 1], np.float32))
_CURRENT = "current minus previous position"


def _counted_anew(frames: list[Frame]) -> list[Frame]:
    """Ids of one frame are not those of the next."""
    return [replace(frame, ids=np.asarray(frame.ids) + np.uint32(100 * number)) for number, frame in enumerate(frames)]


def _scattered(frames: list[Frame]) -> list[Frame]:
    """A number for each pixel."""
    rng = np.random.default_rng(0)
    return [replace(frame, ids=rng.integers(1, 2**31, frame.shape, np.uint32)) for frame in frames]


#: No mistake first, then those of motion, cameras, depth, normals, jitter and albedo.
MISTAKES: tuple[Mistake, ...] = (
    Mistake("none", "", "", _RIGHT),
    Mistake("none", "", "", _RIGHT, _RAYS),
    Mistake("none", "", "", _RIGHT, _FEW),
    Mistake("none", "", "", _RIGHT, ("motion",)),
    Mistake("none", "", "", _RIGHT, jittered=True),
    Mistake("none", "", "", _RIGHT, _FEW, jittered=True),
    Mistake("y up", "motion", "y up", _Y_UP),
    Mistake("y up", "motion", "y up", _Y_UP, _RAYS),
    Mistake("y up", "motion", "y up", _Y_UP, _FEW),
    Mistake("y up", "motion", "y up", _Y_UP, ("motion",)),
    Mistake("y up", "motion", "y up", _Y_UP, jittered=True),
    Mistake("current minus previous", "motion", _CURRENT, _NEGATED),
    Mistake("current minus previous", "motion", _CURRENT, _NEGATED, ("motion",)),
    Mistake("current minus previous, y up", "motion", f"{_CURRENT}, y up", _moved([[-1, 0], [0, 1]])),
    Mistake("(row, column)", "motion", "(row, column) order", _moved([[0, 1], [1, 0]])),
    Mistake("(row, column), negated", "motion", f"(row, column) order, {_CURRENT}", _moved([[0, -1], [-1, 0]])),
    Mistake("fractions of the sides", "motion", "fractions of the image's sides", _moved([[1 / _W, 0], [0, 1 / _H]])),
    Mistake("NDC", "motion", "normalised device coordinates", _moved([[2 / _W, 0], [0, 2 / _H]])),
    Mistake("NDC, y up", "motion", "normalised device coordinates, y up", _NDC_UP),
    Mistake("NDC, y up", "motion", "normalised device coordinates, y up", _NDC_UP, ("motion",)),
    Mistake("0.5 is zero", "motion", "0.5 is zero", _moved([[0.5 / _W, 0], [0, 0.5 / _H]], 0.5)),
    Mistake("half the length (shutter)", "motion", "half as long", _moved([[0.5, 0], [0, 0.5]])),
    Mistake("twice the length", "motion", "twice as long", _moved([[2, 0], [0, 2]])),
    Mistake("motion of the previous frame", "motion", "of the previous frame", _shifted("motion", -1)),
    Mistake("motion of the next frame", "motion", "of the next frame", _shifted("motion", 1)),
    Mistake("to the next frame", "motion", "to the next frame", _forward(1)),
    Mistake("to the next frame, negated", "motion", "to the next frame, current minus next", _forward(-1)),
    Mistake("no relation", "motion", "unrelated", _noise),
    Mistake("transposed matrix", "cameras", "transposed", _relayed(lambda m: m.T)),
    Mistake("y down in clip space", "cameras", "y down", _CLIP_DOWN),
    Mistake("y down in clip space", "cameras", "y down", _CLIP_DOWN, _RAYS),
    Mistake("other handedness", "cameras", "x left", _relayed(lambda m: np.diag([-1, 1, 1, 1]) @ m)),
    Mistake("[0, 1] instead of clip space", "cameras", "to [0, 1]", _relayed(lambda m: _UV @ m)),
    Mistake("camera of the previous frame", "cameras", "of the previous frame", _shifted("camera", -1)),
    Mistake("camera of the next frame", "cameras", "of the next frame", _shifted("camera", 1)),
    Mistake("distance along the ray", "depth", "distance along the ray", _ALONG_RAY),
    Mistake("distance along the ray", "depth", "distance along the ray", _ALONG_RAY, _RAYS),
    Mistake(
        "from the near plane", "depth", "distance along the camera axis, from", _each("depth", lambda _, d: d - 0.2)
    ),
    Mistake("Mitsuba's depth", "depth", "distance along the ray, from", _FROM_NEAR),
    Mistake("negative depth", "depth", "negative", _each("depth", lambda _, d: -d)),
    Mistake("depth in centimetres", "depth", "in another unit", _each("depth", lambda _, d: 100 * d)),
    Mistake("a depth buffer", "depth", "a depth buffer", _each("depth", lambda _, d: 1.001 - 0.1001 / d)),
    Mistake("camera space, z backwards", "normal", "camera space, z backwards", _BACKWARDS),
    Mistake("camera space, z backwards", "normal", "camera space, z backwards", _BACKWARDS, _RAYS),
    Mistake("camera space, z forward", "normal", "camera space, z forward", _in_camera((1, 1, 1))),
    Mistake("normals point inwards", "normal", "opposite", _each("normal", lambda _, n: -n)),
    Mistake("z is up", "normal", "y and z swapped (z is up)", _Z_UP),
    Mistake("normals from 0 to 1", "normal", "encoded", _each("normal", lambda _, n: (n + 1) / 2)),
    Mistake("jitter left in motion", "jitter", "left in motion", _shaken(1), jittered=True),
    Mistake("jitter left in motion", "jitter", "left in motion", _shaken(1), (*_FEW, "ids"), jittered=True),
    Mistake("jitter subtracted twice", "jitter", "removed from motion with the wrong", _shaken(-1), jittered=True),
    Mistake("jitter left, and not told", "jitter", "a constant offset", _unmarked(_shaken(1)), jittered=True),
    Mistake("ids counted anew in every frame", "ids", "100% of the surfaces", _counted_anew),
    Mistake("random ids", "ids", "100% of the surfaces", _scattered),
    Mistake("albedo above 1", "albedo", "above 1", _each("albedo", lambda _, a: 1.6 * a)),
    Mistake("albedo is lit", "albedo", "contains lighting", _each("albedo", _lit)),
    Mistake(
        "albedo is the colour", "albedo", "contains lighting", _each("albedo", lambda f, _: np.minimum(f.color, 1))
    ),
)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.mistakes", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the noise; %(default)s")
    parser.add_argument("--deviation", type=float, default=0.5, help="relative deviation of the noise; %(default)s")
    options = parser.parse_args(arguments)
    print(table(seed=options.seed, deviation=options.deviation))


if __name__ == "__main__":
    main()
