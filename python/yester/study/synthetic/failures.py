"""Known failures of temporal methods, as reported by users: scenarios with exact references.

Each scenario is a small scene of `raycast`, at 96×64 pixels, that provokes one failure. Frames are numbered from the
event, if there is one: frames before it are warm-up, later frames are measured. Continuous motion has constant speed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from yester import Camera, Frame, jitter

from .raycast import (
    Box,
    Color,
    Light,
    Rectangle,
    Scene,
    Sphere,
    Texture,
    Thing,
    Wire,
    cast,
    centres,
    checker,
    motion,
    shoot,
    stripes,
    translate,
    truth,
    turn,
    value_noise,
)

__all__ = ["FAILURES", "FRAMES", "HEIGHT", "SCENARIOS", "TRAIL", "WIDTH", "Scenario", "Shot", "uncovered"]

Image: TypeAlias = NDArray[np.float32]
Mask: TypeAlias = NDArray[np.bool_]

#: By failure: the symptom, and the reports of users.
FAILURES: dict[str, tuple[str, str]] = {
    "disocclusion": (
        "noise or smear on newly visible surfaces; off-screen entry",
        "bevy #8847, #8974",
    ),
    "moving light, light switched": (
        "lag of many frames",
        "NRD #99, godot-proposals #13787, Q2RTX #485",
    ),
    "reflections of moving objects": (
        "ghosts: the surface's motion is not the reflection's",
        "NRD #93, #110, #52",
    ),
    "shadows that move over a still surface": ("dragged shadows", "NRD #46"),
    "material or texture swap, animated texture": ("stale colour; prevented only by clamping", ""),
    "thin geometry, foliage, wires": ("vanishing or flickering", "godot #113043, FSR 3.1.4 release notes"),
    "red/green flicker filling the neighbourhood": ("clipping returns always one of the two", ""),
    "fast motion": ("blur, over-rejection, noise in motion", "godot #81709, #86809"),
    "camera cut, teleport": ("one frame of another scene", "pmndrs/denoiser's frame contract"),
    "fireflies": ("boiling blobs; suppressing them darkens", "NRD #50"),
    "NaN, infinity": ("spreads through history and stays", "NRD-Sample #15, OIDN #210"),
    "depth slopes missing": ("spatial filter starved at grazing angles", "Falcor PR #434, #358"),
    "jitter in motion vectors": ("the whole image shakes", "FSR2 #39, three.js #33359"),
    "albedo baked into radiance": ("texture blurred", ""),
    "rotating object": ("normals in world space reject good history; normals in object space keep it", ""),
    "sequence ends": ("tools lose the first or last frames", "Super Image Denoiser #18"),
    "additive shimmer on static detail": ("sub-pixel jitter of an over-tight clip", "godot #85123"),
}

#: Size of a scenario's frames in pixels; small, so that all scenarios take only minutes.
WIDTH, HEIGHT = 96, 64
#: Frames of a scenario, of which the second half is measured.
FRAMES = 32
#: In scenarios with continuous motion, a ghost is the reference of this many frames ago.
TRAIL = 4


class Shot(NamedTuple):
    """One frame of a scenario.

    Attributes
    ----------
    frame : Frame
        The input.
    truth : (H, W, 3) float32 or None
        The reference; None during warm-up.
    former : (H, W, 3) float32 or None
        The outdated image that a ghost shows, if the scenario is about ghosting.
    watch : (H, W) bool or None
        The pixels in which the failure is visible; None for all pixels.
    """

    frame: Frame
    truth: Image | None = None
    former: Image | None = None
    watch: Mask | None = None


@dataclass(frozen=True, eq=False)
class Taken:
    """A frame from the ray-caster, and further data to simulate faulty exporters.

    Attributes
    ----------
    frame : Frame
    now : int
        Number of the frame: 0 at the event, negative before.
    shift : (2,) ndarray of float64
        Change of the jitter since the previous frame, in pixels.
    rng : numpy.random.Generator
    """

    frame: Frame
    now: int
    shift: NDArray[np.float64]
    rng: np.random.Generator


@dataclass(frozen=True)
class Scenario:
    """A scene that provokes a failure.

    Attributes
    ----------
    name : str
    failure : str
        A key of `FAILURES`.
    stage : callable
        The scene of a frame by its number, which is 0 at the event and negative before.
    deviation, fireflies : float, default 0
        Parameters of `raycast.noise`. Without noise, all samples of a frame have the same known jitter; with noise,
        samples are distributed randomly over their pixels.
    former : "event" or "trail", optional
        The outdated image that a ghost shows: the reference before the event, or that of `TRAIL` frames ago.
    watch : callable, optional
        Pixels in which the failure is visible, from a scene and the previous one.
    alter : callable, optional
        Converts a `Taken` to the methods' input frame.
    warm_up : bool, default True
        True if the first half of the frames is warm-up.
    frames : int, default `FRAMES`
    """

    name: str
    failure: str
    stage: Callable[[int], Scene]
    deviation: float = 0.0
    fireflies: float = 0.0
    former: Literal["event", "trail"] | None = None
    watch: Callable[[Scene, Scene], Mask] | None = None
    alter: Callable[[Taken], Frame] | None = None
    warm_up: bool = True
    frames: int = FRAMES

    def shots(self, seed: int = 0, frames: int | None = None) -> Iterator[Shot]:
        """Yield the frames with their references.

        Parameters
        ----------
        seed : int, default 0
            Seed of the noise; equal seeds give equal bits.
        frames : int, optional
            Maximum number of frames; by default all frames of the scenario.

        Yields
        ------
        Shot
        """
        count = self.frames if frames is None else min(frames, self.frames)
        start = -(count // 2) if self.warm_up else 0
        rng = np.random.default_rng(seed)
        offsets = jitter(count)
        # Without noise, the error is aliasing alone, so that the reference needs more samples per pixel.
        side = 4 if self.deviation > 0 else 6
        scene, image, watch, shift = self.stage(start), None, None, np.zeros(2)
        truths: deque[Image] = deque(maxlen=TRAIL + 1)
        for number, now in enumerate(range(start, start + count)):
            before, scene = scene, self.stage(now)
            offset = None if self.deviation > 0 else offsets[number]
            if offset is not None and number > 0:
                shift = offset - offsets[number - 1]
            frame = shoot(scene, before, rng, deviation=self.deviation, fireflies=self.fireflies, jitter=offset)
            if self.alter:
                frame = self.alter(Taken(frame, now, shift, rng))
            if now >= -TRAIL:
                if image is None or scene is not before:
                    image = truth(scene, side)
                    watch = self.watch(scene, before) if self.watch else None
                if now < 0 or self.former == "trail":
                    truths.append(image)
            if now < 0:
                yield Shot(frame)
                continue
            former = {"trail": truths[0], "event": truths[-1], None: None} if truths else {}
            yield Shot(frame, image, former.get(self.former), watch)


def uncovered(scene: Scene, before: Scene) -> Mask:
    """Disoccluded pixels: their surface was hidden in the previous frame, or outside the image."""
    camera = scene.camera
    hits = cast(scene, centres(camera))
    moved = motion(hits, before)
    then = hits.pixels + moved[..., :2]
    inside: Mask = np.all((then >= 0) & (then < [camera.width, camera.height]), axis=-1)
    seen = cast(before, np.where(inside[..., None], then, 0.5))
    expected = hits.depth + moved[..., 2]
    same: Mask = (seen.ids == hits.ids) & np.isclose(seen.depth, expected, rtol=1e-3)
    return ~(inside & same)


def _shows(*ids: int) -> Callable[[Scene, Scene], Mask]:
    """Make a `Scenario.watch`: pixels that are at least partly covered by one of these things."""

    def watch(scene: Scene, before: Scene) -> Mask:
        offsets = (np.arange(4) + 0.5) / 4 - 0.5
        places = centres(scene.camera)
        hits = [np.isin(cast(scene, np.add(places, (x, y))).ids, ids) for y in offsets for x in offsets]
        return np.asarray(np.any(hits, 0))

    return watch


# The scenes. One scene unit is 20 to 40 pixels.

_SAND, _EARTH = (0.75, 0.68, 0.55), (0.4, 0.33, 0.25)
_CREAM, _BLUE, _RED, _GREEN = (0.8, 0.78, 0.7), (0.15, 0.3, 0.6), (0.8, 0.15, 0.1), (0.1, 0.7, 0.15)
_KEY = Light((1.5, 3.0, 2.5), (9.0, 8.0, 6.5))
_FILL = Light((-1.0, 0.8, 0.6), (0.25, 0.3, 0.45), distant=True)


def _camera(x: float = 0.0, y: float = 1.0, z: float = 4.0, look: tuple[float, float, float] = (0, 0.6, 0)) -> Camera:
    return Camera.from_look_at([x, y, z], look, [0, 1, 0], 45, WIDTH, HEIGHT)


def _room(
    *things: Thing,
    camera: Camera | None = None,
    lights: tuple[Light, ...] = (_KEY, _FILL),
    wall: Color | Texture | None = None,
    emission: Color | Texture = (0.0, 0.0, 0.0),
    mirror: bool = False,
) -> Scene:
    """A floor (id 1), a wall two units behind the origin (id 2), and things (ids from 3)."""
    floor = Thing(Rectangle(), turn([1, 0, 0], -90), value_noise(_SAND, _EARTH, 0.25))
    paint = wall or checker(_CREAM, (0.45, 0.5, 0.42), 0.5)
    back = Thing(Rectangle(), translate(0, 0, -2), paint, emission, mirror)
    return Scene((floor, back, *things), camera or _camera(), lights)


def _ball(x: float, y: float, z: float, radius: float = 0.45) -> Thing:
    return Thing(Sphere(radius), translate(x, y, z), checker(_RED, _CREAM, radius / 2))


_still_room = cache(lambda: _room(_ball(-0.7, 0.45, 0), Thing(Box((0.7, 0.9, 0.7)), translate(0.8, 0.45, -0.6))))


def _to_and_fro(now: int, pace: float) -> float:
    """Position at constant speed, to and fro within the view."""
    reach = 1.5
    return abs((pace * now - reach) % (4 * reach) - 2 * reach) - reach


def _passing(now: int, pace: float) -> Scene:
    place = translate(_to_and_fro(now, pace), 0.5, 0.2)
    return _room(Thing(Box((0.7, 0.9, 0.4)), place, checker(_BLUE, _CREAM, 0.25)))


def _panning(now: int, pace: float) -> Scene:
    room = _still_room()
    x = _to_and_fro(now, pace)
    return Scene(room.things, _camera(x, look=(x, 0.6, 0)), room.lights)


@cache
def _lit(on: bool) -> Scene:
    return _room(*_still_room().things[2:], lights=(_KEY, _FILL) if on else (_FILL,))


def _moving_lamp(now: int) -> Scene:
    lamp = Light((_to_and_fro(now, 0.2), 1.3, -1.2), (0.7, 0.6, 0.4))
    return _room(*_still_room().things[2:], lights=(lamp, _FILL))


def _mirrored(ball: float, camera: float) -> Scene:
    """A wall and a ball behind the camera, seen in a mirror in front of it."""
    behind = Thing(Rectangle(), translate(0, 0, 7), checker(_SAND, _BLUE, 1.2))
    view = _camera(camera, look=(camera, 0.8, 0))
    return _room(behind, _ball(ball, 1.9, 5, 0.9), camera=view, wall=(0.9, 0.9, 0.9), mirror=True)


def _mirrored_ball(now: int) -> Scene:
    return _mirrored(0.15 * now, 0)


def _mirror_passed(now: int) -> Scene:
    return _mirrored(-1, 0.08 * now)


def _moving_shadow(now: int) -> Scene:
    sun = Light((0.3, 1.0, 0.15), (0.9, 0.85, 0.7), distant=True)
    # The ball is above the view; only its shadow is visible.
    return _room(Thing(Sphere(0.45), translate(0.06 * now + 0.8, 3, 0.8)), lights=(sun,))


@cache
def _papered(swapped: bool) -> Scene:
    wall = stripes(_BLUE, _RED, 0.3) if swapped else checker(_CREAM, _GREEN, 0.4)
    return _room(*_still_room().things[2:], wall=wall)


def _scrolling(now: int) -> Scene:
    texture = value_noise(_CREAM, _BLUE, 0.2)
    return _room(wall=lambda point: texture(point + np.array([[0.06 * now], [0], [0]])))


@cache
def _screen(swapped: bool) -> Scene:
    picture = stripes((1.2, 0.1, 0.1), (0.1, 0.1, 0.9), 0.4, 1) if swapped else checker((0.9,) * 3, (0.05,) * 3, 0.5)
    return _room(wall=(0.05, 0.05, 0.05), emission=picture)


def _wires(now: int, sway: float) -> Scene:
    wires = [
        Thing(
            Wire((0, 0, 0), (0.1 * np.sin(5 * i), 1.4, 0), 0.008),
            translate(-1.5 + 0.3 * i, 0, -0.4 * (i % 3)) @ turn([0, 0, 1], sway * np.sin(0.35 * now + i)),
            albedo=(0.1, 0.25, 0.08) if i % 2 else (0.9, 0.85, 0.6),
        )
        for i in range(11)
    ]
    return _room(*wires, wall=(0.6, 0.65, 0.7))


_still_wires = cache(partial(_wires, 0, 0.0))


@cache
def _red_and_green() -> Scene:
    camera = _camera(y=0, z=3, look=(0, 0, 0))
    # Two stripes per pixel: the jitter decides which of them the whole image shows.
    pixel = float(np.subtract(*camera.unproject([[1.5, 0.5], [0.5, 0.5]], [5.0, 5.0])[:, 0]))
    wall = Thing(Rectangle(), translate(0, 0, -2), stripes(_RED, _GREEN, pixel / 2))
    return Scene((wall,), camera, ambient=(1, 1, 1))


@cache
def _cut(done: bool) -> Scene:
    room = _still_room()
    return Scene(room.things, _camera(-1.6, 0.7, 2.6, (1.2, 0.4, -1.2)) if done else room.camera, room.lights)


@cache
def _teleported(done: bool) -> Scene:
    return _room(_ball(0.9 if done else -0.7, 0.45, 0))


@cache
def _grazing() -> Scene:
    floor = Thing(Rectangle(), turn([1, 0, 0], -90), value_noise(_SAND, _EARTH, 0.5))
    return Scene((floor,), _camera(y=0.12, look=(0, 0.05, 0)), (_KEY, _FILL), background=(0.4, 0.5, 0.7))


def _drifting(now: int) -> Scene:
    return _room(camera=_camera(0.02 * now, look=(0.02 * now, 0.6, 0)), wall=checker(_CREAM, _BLUE, 0.15))


def _spinning(now: int) -> Scene:
    place = translate(0, 0.8, 0.5) @ turn([0.2, 1, 0.1], 30 * now)
    room = _room(Thing(Sphere(0.6), place, value_noise(_CREAM, _SAND, 0.25)))
    # Ambient light only: shading does not change with the rotation, so that history stays valid.
    return Scene(room.things, room.camera, ambient=(0.8, 0.8, 0.8))


@cache
def _fine_detail() -> Scene:
    return _room(wall=value_noise((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.06))


def _without(*buffers: str) -> Callable[[Taken], Frame]:
    absent: dict[str, Any] = dict.fromkeys(buffers)
    return lambda taken: replace(taken.frame, **absent)


def _some_missing(taken: Taken) -> Frame:
    """Before the event, two percent of the samples and a whole block are missing."""
    if taken.now >= 0:
        return taken.frame
    color = taken.frame.color.copy()
    for value in (np.nan, np.inf):
        color[taken.rng.random(taken.frame.shape) < 0.01] = value
    color[20:32, 30:42] = -np.inf
    return replace(taken.frame, color=color)


def _moved(frame: Frame) -> Image:
    assert frame.motion is not None
    return frame.motion


def _unannounced(taken: Taken) -> Frame:
    """A cut that the motion does not mark."""
    frame = taken.frame
    return replace(frame, motion=np.zeros_like(_moved(frame))) if taken.now == 0 else frame


def _shaken(taken: Taken) -> Frame:
    """Motion vectors that contain the jitter of both cameras."""
    return replace(taken.frame, motion=_moved(taken.frame) + np.array([*taken.shift, 0], np.float32))


#: Relative standard deviations of a sample's light; the first gives a PSNR of about 16 dB.
_NOISY, _VERY_NOISY = 0.5, 1.0

_LIGHT = "moving light, light switched"
_MIRROR = "reflections of moving objects"
_SHADOW = "shadows that move over a still surface"
_TEXTURE = "material or texture swap, animated texture"
_THIN = "thin geometry, foliage, wires"
_CUT = "camera cut, teleport"
_WIRES = _shows(*range(3, 14))

SCENARIOS: tuple[Scenario, ...] = (
    *(
        scenario
        for words, noise in (("", 0.0), (", noisy", _NOISY))
        for scenario in (
            Scenario(
                f"object passes{words}",
                "disocclusion",
                partial(_passing, pace=0.09),
                noise,
                former="trail",
                watch=uncovered,
            ),
            Scenario(f"view pans{words}", "disocclusion", partial(_panning, pace=0.12), noise, watch=uncovered),
            Scenario(f"light goes off{words}", _LIGHT, lambda now: _lit(now < 0), noise, former="event"),
            Scenario(f"light comes on{words}", _LIGHT, lambda now: _lit(now >= 0), noise, former="event"),
            Scenario(f"light travels{words}", _LIGHT, _moving_lamp, noise, former="trail"),
            Scenario(f"ball in a mirror{words}", _MIRROR, _mirrored_ball, noise, former="trail", watch=_shows(2)),
            Scenario(f"past a mirror{words}", _MIRROR, _mirror_passed, noise, watch=_shows(2)),
            Scenario(f"shadow travels{words}", _SHADOW, _moving_shadow, noise, former="trail"),
            Scenario(f"wires sway{words}", _THIN, partial(_wires, sway=4.0), noise, watch=_WIRES),
            Scenario(f"object races{words}", "fast motion", partial(_passing, pace=0.36), noise, watch=_shows(3)),
            Scenario(f"view races{words}", "fast motion", partial(_panning, pace=0.5), noise),
            Scenario(f"teleport{words}", _CUT, lambda now: _teleported(now >= 0), noise, former="event"),
            Scenario(f"cut{words}", _CUT, lambda now: _cut(now >= 0), noise, former="event"),
            Scenario(
                f"cut, unannounced{words}", _CUT, lambda now: _cut(now >= 0), noise, former="event", alter=_unannounced
            ),
        )
    ),
    Scenario("wallpaper swapped", _TEXTURE, lambda now: _papered(now >= 0), former="event"),
    Scenario("wallpaper scrolls", _TEXTURE, _scrolling, former="trail"),
    Scenario("screen switches", _TEXTURE, lambda now: _screen(now >= 0), former="event"),
    Scenario(
        "screen switches, emission unknown",
        _TEXTURE,
        lambda now: _screen(now >= 0),
        former="event",
        alter=_without("emission"),
    ),
    Scenario("wires stand", _THIN, lambda now: _still_wires(), watch=_WIRES),
    Scenario("red and green", "red/green flicker filling the neighbourhood", lambda now: _red_and_green()),
    Scenario("fireflies", "fireflies", lambda now: _still_room(), _NOISY, 0.005),
    Scenario("samples missing", "NaN, infinity", lambda now: _still_room(), _NOISY, alter=_some_missing),
    Scenario("grazing floor", "depth slopes missing", lambda now: _grazing(), _VERY_NOISY),
    Scenario(
        "grazing floor, depth alone",
        "depth slopes missing",
        lambda now: _grazing(),
        _VERY_NOISY,
        alter=_without("camera", "normal", "object_normal", "position"),
    ),
    Scenario("jitter", "jitter in motion vectors", lambda now: _still_room()),
    Scenario("jitter in motion", "jitter in motion vectors", lambda now: _still_room(), alter=_shaken),
    Scenario("fine tiles", "albedo baked into radiance", _drifting, _NOISY),
    Scenario("fine tiles, albedo unknown", "albedo baked into radiance", _drifting, _NOISY, alter=_without("albedo")),
    Scenario("ball spins", "rotating object", _spinning, _NOISY, watch=_shows(3)),
    Scenario(
        "ball spins, world normals",
        "rotating object",
        _spinning,
        _NOISY,
        watch=_shows(3),
        alter=_without("object_normal"),
    ),
    Scenario("three frames", "sequence ends", partial(_panning, pace=0.12), warm_up=False, frames=3),
    Scenario("detail of a pixel", "additive shimmer on static detail", lambda now: _fine_detail()),
)
