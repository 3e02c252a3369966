"""A Mitsuba scene that is changed between frames: its camera, its lights, and the cube of the demo."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Camera, Frame
from ..io import mitsuba as renderer
from ..study.rendered import build, scenes

__all__ = ["Pose", "Shot", "World", "prepare"]

Vector = tuple[float, ...]

#: Older versions of LLVM end the process on code that Dr.Jit generates ("Cannot select: fminimum").
_LLVM = 16
#: Parameters that scale light, by the ends of their names; of those called scale, only those of emitters do.
_LIGHT = re.compile(r"(.*)\.((?:(?:ir)?radiance|intensity)\.(?:value|data|color[01]\.value)|scale)$")
#: Seconds in which the cube flies through the box, before it flies back.
_FLIGHT = 4.0


def prepare() -> str:
    """Choose Mitsuba's variant, unless one is set: the vectorised one where it can run, else the scalar one."""
    try:
        import drjit
        import mitsuba as mi
    except ImportError as error:
        raise ImportError("yester.live needs Mitsuba: pip install 'yester[live]'") from error
    if mi.variant() is None:
        try:
            mi.set_variant("llvm_ad_rgb")
            able = drjit.detail.llvm_version()[0] >= _LLVM
        except ImportError:  # without LLVM
            able = False
        if not able:
            mi.set_variant("scalar_rgb")
    return str(mi.variant())


@dataclass(frozen=True)
class Pose:
    """The place of a camera, the point that it looks at and turns about, and the direction that is up."""

    eye: Vector
    target: Vector
    up: Vector

    def __post_init__(self) -> None:
        values = {"eye": self.eye, "target": self.target, "up": self.up}
        for name, vector in values.items():
            if len(vector) != 3 or not all(math.isfinite(value) for value in vector):
                raise ValueError(f"{name}: expected three finite numbers, got {vector}")
        along = np.subtract(self.target, self.eye)
        if np.linalg.norm(np.cross(along, self.up)) <= 1e-6 * np.linalg.norm(along) * np.linalg.norm(self.up):
            raise ValueError(f"target: expected a point that is not above, below or at the eye, got {self.target}")


@dataclass(frozen=True)
class Shot:
    """What a frame is to show.

    Attributes
    ----------
    pose : Pose
    size : tuple of int
        Width and height.
    light : bool
        Whether the lights are on.
    flight : float
        Where the cube is, 0 to 1.
    """

    pose: Pose
    size: tuple[int, int]
    light: bool = True
    flight: float = 0.0


@dataclass
class _Film:
    """The shots of a sequence that goes on as long as it is asked for: holds the newest two."""

    last: tuple[renderer.Shot, ...] = field(default=(), init=False)
    count: int = field(default=0, init=False)

    def add(self, shot: renderer.Shot) -> None:
        self.last = (*self.last, shot)[-2:]
        self.count += 1

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> renderer.Shot:
        return self.last[index - self.count]

    def __iter__(self) -> Iterator[renderer.Shot]:
        while True:
            yield self.last[-1]


class World:
    """A loaded scene, rendered shot by shot with all buffers and the motion since the shot before.

    Parameters
    ----------
    scene : path-like, optional
        An XML file; by default, the Cornell box of the demo.
    size : (int, int), optional
        Largest width and height; by default those of the scene's film, and 640×480 for the demo.
    seed : int, default 0
        Of the first frame; each has its own.

    Attributes
    ----------
    home : Pose
        The scene's own camera.
    lights : list of str
        The parameters that switch the light.
    flies : bool
        Whether there is a cube that flies.
    """

    def __init__(
        self, scene: str | os.PathLike[str] | None = None, size: tuple[int, int] | None = None, seed: int = 0
    ) -> None:
        self.path = None if scene is None else Path(scene)
        if self.path is not None and not self.path.is_file():
            raise FileNotFoundError(f"{self.path}: no such file")
        self.variant = prepare()
        self.flies = self.path is None
        if self.path is None:
            sequence = scenes.cornell_box(1)
            self._stage = renderer.Stage(_with_lamp(sequence.scene))
            self.home = Pose((0.0, 0.15, 3.3), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
            self.fov: float = build.FOV
            whole = 640, 480
            self._stage.poses({"cube": np.eye(4)})
            names = ["light.emitter.radiance.value"]
        else:
            try:
                self._stage = renderer.Stage(self.path)
            except RuntimeError as error:
                raise ValueError(f"{self.path}: {error}") from error
            self.home, self.fov, whole = self._sensor()
            self._compare_home(whole)
            names = [name for name in self._stage.parameters.keys() if self._shines(name)]  # noqa: SIM118
        self.lights = names
        self._off = self._stage.values({name: self._stage.parameters[name] * 0 for name in names})
        self.size = size or whole
        self.seed = seed
        self._film = _Film()
        self._frames: Generator[Frame] | None = None
        self._shape: tuple[int, int] | None = None

    def _shines(self, name: str) -> bool:
        found = _LIGHT.match(name)
        emitters = [emitter.id() for emitter in self._stage.scene.emitters()]
        return found is not None and (found[2] != "scale" or found[1] in emitters)

    def _sensor(self) -> tuple[Pose, float, tuple[int, int]]:
        """Pose, vertical field of view in degrees and size of the scene's own camera."""
        if self._stage.intrinsics is None or self._stage.lens["type"] == "orthographic":
            got = "none" if self._stage.intrinsics is None else "an orthographic one"
            raise ValueError(f"{self.path}: expected a scene with a perspective sensor, got {got}")
        projection, width, height = self._stage.intrinsics
        to_world = self._stage.pose
        eye, forward, above = to_world[:3, 3], to_world[:3, 2], to_world[:3, 1]
        # The axis of the scene that is up in the picture: orbits go around it.
        axis = int(np.argmax(np.abs(above)))
        up = np.eye(3)[axis] * np.sign(above[axis])
        box = self._stage.scene.bbox()
        middle = (np.ravel(box.min) + np.ravel(box.max)) / 2
        forward = forward / np.linalg.norm(forward)
        ahead = float((middle - eye) @ forward)
        if not np.isfinite(ahead) or ahead <= 0:
            ahead = 1.0
        fov = math.degrees(2 * math.atan(1 / abs(projection[1, 1] / projection[3, 2])))
        return Pose(_vector(eye), _vector(eye + ahead * forward), _vector(up)), fov, (width, height)

    def _compare_home(self, size: tuple[int, int]) -> None:
        """Warn if the first view is not that of the scene's camera: a pose has no crop, offset, mirror or roll."""
        own, home = renderer.camera(self._stage.scene.sensors()[0]), self.camera(self.home, size)
        corners = np.array([[0, 0], [size[0], 0], [0, size[1]]], np.float32)
        ahead = np.full(3, np.linalg.norm(np.subtract(self.home.target, self.home.eye)), np.float32)
        if np.abs(own.project(home.unproject(corners, ahead))[0] - corners).max() > 1:
            about = "expected no crop, principal point offset, mirror or roll: the view is that without them"
            warnings.warn(f"{self.path}: sensor: {about}", stacklevel=3)

    def camera(self, pose: Pose, size: tuple[int, int]) -> Camera:
        """The camera of a pose."""
        return Camera.from_look_at(pose.eye, pose.target, pose.up, self.fov, *size, fov_axis="y")

    def cube(self, flight: float) -> dict[str, NDArray[np.float64]]:
        """Where the cube is, from where the scene has it."""
        return {"cube": scenes.box_flight(flight)} if self.flies else {}

    def values(self, *, light: bool) -> dict[str, Any]:
        """The parameters that differ from the scene's own."""
        return {} if light else self._off

    def render(self, shot: Shot) -> Frame:
        """Render the next frame of the sequence: one path a pixel.

        A new sequence begins at another size, and after a frame that failed.
        """
        if self._frames is None or shot.size != self._shape:
            self.close()
            self._film, self._shape = _Film(), shot.size
            self._frames = self._stage.frames(self._film, 1, self.seed, True, False, False)
        self._film.add(self._staged(shot))
        self.seed += 1
        try:
            return next(self._frames)
        except BaseException:
            self.close()  # a generator that has raised yields nothing more
            raise

    def reference(self, shot: Shot, spp: int, seed: int) -> Frame:
        """Render the colour of a shot, with as many paths as it takes; outside of the sequence."""
        self.close()
        # Seeds far from those of the frames.
        seed += 1 << 30
        with closing(self._stage.frames([self._staged(shot)], spp, seed, False, False, False)) as frames:
            return next(frames)

    def _staged(self, shot: Shot) -> renderer.Shot:
        camera = self.camera(shot.pose, shot.size)
        return renderer.Shot(camera, self._stage.sensor(camera), self.cube(shot.flight), self.values(light=shot.light))

    def close(self) -> None:
        """End the sequence."""
        if self._frames is not None:
            self._frames.close()
            self._frames = None


def _vector(values: NDArray[np.floating[Any]]) -> Vector:
    return tuple(float(value) for value in values)


def _with_lamp(scene: dict[str, Any]) -> dict[str, Any]:
    """A small warm lamp, so that something is seen when the light of the ceiling is off."""
    place = build.mitsuba().ScalarTransform4f
    lamp = {
        "type": "sphere",
        "to_world": place().translate([-0.7, 0.15, -0.5]).scale(0.09),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [14.0, 5.6, 2.4]}},
    }
    return scene | {"lamp": lamp}


def flown(seconds: float) -> float:
    """Where the cube is after this time in flight, 0 to 1, there and back."""
    turns = seconds / _FLIGHT % 2
    return 1 - abs(1 - turns)
