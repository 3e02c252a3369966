"""Frames rendered by Mitsuba 3, with exact buffers and motion."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from typing import Any, Literal, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Camera, motion_vectors
from ..frame import Frame

__all__ = ["camera", "render_sequence"]

Matrix = NDArray[np.float64]

_STILL = np.eye(4)
#: How far two hits of one ray may be apart, relative to their distance, and still be the same point.
_SAME = 1e-4
#: Mitsuba's largest blocks of an image, pixels to a side.
_BLOCK = 32
_VERTICES = ".vertex_positions"
_AOVS = "albedo:albedo,depth:depth,normal:sh_normal,position:position,ids:shape_index"


def camera(sensor: Any) -> Camera:
    """The camera of a Mitsuba sensor.

    Parameters
    ----------
    sensor : mitsuba.Sensor
        Of type ``perspective`` or ``thinlens`` (as if its aperture were a point), of any variant. The crop window of
        its film is the image; principal point offsets are taken into account.

    Returns
    -------
    Camera

    Raises
    ------
    ValueError
        If it is of another type.
    """
    kind = getattr(sensor, "class_name", lambda: type(sensor).__name__)()
    if kind not in ("PerspectiveCamera", "ThinLensCamera"):
        raise ValueError(f"sensor: expected a perspective or thinlens sensor, got {kind}")
    parameters = _mitsuba().traverse(sensor)
    film = sensor.film()
    width, height = (int(side) for side in np.ravel(film.crop_size()))
    # The offset is a fraction of the whole film, where the projection spans the crop window, [0, 1] with y down.
    x, y = (
        2 * _number(parameters, f"principal_point_offset_{axis}") * whole / crop
        for axis, whole, crop in zip("xy", np.ravel(film.size()), (width, height), strict=True)
    )
    to_clip = np.array([[2, 0, 0, -1 - x], [0, -2, 0, 1 + y], [0, 0, 1, 0], [0, 0, 0, 1]])
    to_uv, to_world = (_matrix(t, "sensor") for t in (sensor.projection_transform(), sensor.world_transform()))
    return Camera(to_clip @ to_uv @ np.linalg.inv(to_world), width, height)


@overload
def render_sequence(
    scene: Any,
    cameras: Iterable[Camera | ArrayLike],
    *,
    spp: int = 1,
    seed: int = 0,
    transforms: Iterable[Mapping[str, ArrayLike]] | None = None,
    parameters: Iterable[Mapping[str, Any]] | None = None,
    gradient: bool = False,
    next: bool = False,
    buffers: bool = True,
    halves: Literal[False] = False,
) -> Iterator[Frame]: ...
@overload
def render_sequence(
    scene: Any,
    cameras: Iterable[Camera | ArrayLike],
    *,
    spp: int = 1,
    seed: int = 0,
    transforms: Iterable[Mapping[str, ArrayLike]] | None = None,
    parameters: Iterable[Mapping[str, Any]] | None = None,
    gradient: bool = False,
    next: bool = False,
    buffers: bool = True,
    halves: Literal[True],
) -> Iterator[tuple[Frame, Frame]]: ...
def render_sequence(
    scene: Any,
    cameras: Iterable[Camera | ArrayLike],
    *,
    spp: int = 1,
    seed: int = 0,
    transforms: Iterable[Mapping[str, ArrayLike]] | None = None,
    parameters: Iterable[Mapping[str, Any]] | None = None,
    gradient: bool = False,
    next: bool = False,
    buffers: bool = True,
    halves: bool = False,
) -> Iterator[Frame] | Iterator[tuple[Frame, Frame]]:
    """Render frames with all their buffers, one by one.

    Parameters
    ----------
    scene : dict, path-like or mitsuba.Scene
        A dictionary, an XML file, or a loaded scene, which in the end is what it was. The scene's own integrator
        makes the colour. Of its first sensor come the clip planes, the aperture and, for cameras given as matrices,
        the field of view and the size. It may be of type ``perspective``, ``thinlens`` or ``orthographic``.
    cameras : iterable of Camera, or of (4, 4) array_like or mitsuba.ScalarTransform4f
        One per frame: a camera, or just its pose, which takes the place of the first sensor's ``to_world``. An
        orthographic sensor takes poses alone, in which scales of x and y are half the width and height that it sees.
    spp : int, default 1
        Samples per pixel of colour, albedo and emission. The other buffers are always those of the first sample (with
        1, the very one that made the colour), because a mean of ids or of positions means nothing.
    seed : int, default 0
        From 0. Frame i is rendered as frame 0 would be with ``seed + i``. Same seed, same bits. Mitsuba's own seeds, of
        which each sample has another one (without buffers, each image), are below 2³².
    transforms : iterable of mapping of str to (4, 4) array_like, optional
        One per frame: by shape id, the matrix in world space that moves the shape from where the scene has it to where
        it is in this frame. Shapes that are not named stand where the scene has them.
    parameters : iterable of mapping of str to value, optional
        One per frame: by name as ``mitsuba.traverse(scene)`` has it, such as ``"lamp.emitter.radiance.value"``, the
        value of whatever else changes. Parameters that are not named are as the scene has them. Of these, motion
        follows the ``vertex_positions`` of meshes, whose triangles must stay what they are, and which must not be part
        of an instance. Whatever else moves belongs in `transforms`.
    gradient : bool, default False
        Give every frame but the first a `Frame.replay`, for one more rendering per frame. Two independent samples of a
        pixel differ by their noise, however still the light; two that share all random numbers differ by the change
        alone. So the previous frame is rendered again, from its own camera and with its own random numbers, in this
        frame's scene: where neither the surface nor its light has changed, the replay has the very bits of the previous
        colour. It is NaN where the first sample meets another surface than then, or a shape that has moved.
    next : bool, default False
        Give every frame a `Frame.motion_next`, exact as `motion` is; in the last frame it is zero.
    buffers : bool, default True
        If False, frames have a colour and the camera only, and are rendered several times as fast: for references.
    halves : bool, default False
        Yield pairs of frames that show the same with independent noise, each of `spp` samples. They have the samples
        of a frame with twice as many: the mean of their colours is its colour.

    Yields
    ------
    Frame, or tuple of two
        With buffers and camera, which is None for orthographic sensors: `Camera` has a centre of projection. Albedo is
        1 on surfaces without a diffuse part, such as metals, whose light is not to be demodulated. Normals are the
        shading normals. `ids` count `scene.shapes()` from 1. Motion is exact for the point that was hit, under the
        motion of camera, shapes and vertices; in the first frame it is zero. So it is for the background of an
        orthographic sensor, which has no place.
        `emission` is what the camera sees of lights and environment directly; it is None with volumetric integrators,
        whose media would dim it. `object_normal` is the normal turned back to where the scene has the shape; it is None
        if no shape ever moves. `jitter` is None, as samples are spread over their pixels, and so is `hit_distance`.

    Raises
    ------
    ValueError
        If the scene has no sensor to go with a pose, a camera is one that Mitsuba has not (pixels that are not square,
        a thin lens off its axis), cameras differ in size, a shape is unknown or cannot be moved, a parameter is unknown
        or cannot have the value, there are more or fewer transforms or parameters than cameras, or a gradient or the
        motion to the next frame is asked for without buffers.
    ImportError
        If Mitsuba is not installed.

    Notes
    -----
    The variant is the one that is set, else ``scalar_rgb``. Films have a box filter and 32 bits, samplers are
    independent, whatever the scene says. Scenes given as a dictionary or file are loaded without merging shapes, so
    that every shape keeps its id; load them with ``optimize=False`` if you do it yourself.

    References
    ----------
    Schied, Peters and Dachsbacher, "Gradient Estimation for Real-Time Adaptive Temporal Filtering", 2018: shared random
    numbers, there for one pixel in nine, which is carried forward to where its surface has gone. Here it is every
    pixel, where it was.
    """
    if spp < 1:
        raise ValueError(f"spp: expected at least 1, got {spp}")
    if seed < 0:
        raise ValueError(f"seed: expected at least 0, got {seed}")
    for name, wanted in {"gradient": gradient, "next": next}.items():
        if wanted and not buffers:
            raise ValueError(f"{name}: expected False without buffers, got True")
    stage = Stage(scene)
    views = [stage.camera(view) for view in cameras]
    if len({(view.height, view.width) for view in views}) > 1:
        raise ValueError("cameras: expected all of the same size, got several")
    most = 2**32 // ((2 if halves else 1) * (spp if buffers else 1)) - len(views)
    if seed > most:
        raise ValueError(f"seed: expected at most {most} for {len(views)} frames of {spp} samples, got {seed}")
    still: list[dict[str, Any]] = [{} for _ in views]
    poses = still if transforms is None else [stage.poses(named) for named in transforms]
    values = still if parameters is None else [stage.values(named) for named in parameters]
    for name, given in {"transforms": poses, "parameters": values}.items():
        if len(given) != len(views):
            raise ValueError(f"{name}: expected one for each of {len(views)} cameras, got {len(given)}")
    shots = [Shot(view, stage.sensor(view), *state) for view, *state in zip(views, poses, values, strict=True)]
    if not halves:
        return stage.frames(shots, spp, seed, buffers, gradient, next)
    return _pairs(*(stage.frames(shots, spp, seed, buffers, gradient, next, half, 2) for half in range(2)))


def _pairs(one: Generator[Frame], other: Generator[Frame]) -> Iterator[tuple[Frame, Frame]]:
    with closing(one), closing(other):
        yield from zip(one, other, strict=True)


@dataclass(frozen=True)
class Shot:
    """What one frame is to show: the camera, the Mitsuba sensor made of it, where shapes are, and what else changes."""

    camera: Camera | _Parallel
    sensor: dict[str, Any]
    poses: dict[str, Matrix]
    values: dict[str, Any]

    @property
    def known(self) -> Camera | None:
        """The camera of the frame."""
        return self.camera if isinstance(self.camera, Camera) else None


class Shots(Protocol):
    """The shots of a sequence, in order; more may be added while it is rendered."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Shot: ...

    def __iter__(self) -> Iterator[Shot]: ...


@dataclass(frozen=True)
class _Parallel:
    """An orthographic camera: from world to [0, 1] with y down, its pose, and the size of the image."""

    to_uv: Matrix
    pose: Matrix
    width: int
    height: int

    def project(self, points: NDArray[Any]) -> tuple[Matrix, Matrix]:
        """As `Camera.project`."""
        points = np.asarray(points, np.float64)
        uv = points @ self.to_uv[:2, :3].T + self.to_uv[:2, 3]
        forward = self.pose[:3, 2] / np.linalg.norm(self.pose[:3, 2])
        return uv * [self.width, self.height], (points - self.pose[:3, 3]) @ forward


class Stage:
    """A loaded scene: its shapes moved about, seen by one camera after the other."""

    def __init__(self, scene: Any) -> None:
        self.mi = mi = _mitsuba()
        self.drjit: Any = import_module("drjit")
        if not isinstance(scene, mi.Scene):
            load = mi.load_dict if isinstance(scene, dict) else mi.load_file
            # Loaded in parallel, the shapes come in any order; optimised, those of one material become one.
            scene = load(scene if isinstance(scene, dict) else os.fspath(scene), parallel=False, optimize=False)
            if not isinstance(scene, mi.Scene):
                raise ValueError(f"scene: expected a scene, got {type(scene).__name__}")
        self.scene = scene
        self.scalar = mi.variant().startswith("scalar")
        self.movers: set[str] = set()
        self.changing: set[str] = set()
        self.standing: dict[str, Any] = {}
        self.intrinsics: tuple[Matrix, int, int] | None = None
        #: The first sensor's `to_world`.
        self.pose = _STILL
        self.lens: dict[str, Any] = {"type": "perspective"}
        if scene.sensors() and scene.sensors()[0].class_name() == "OrthographicCamera":
            sensor, known = scene.sensors()[0], mi.traverse(scene.sensors()[0])
            clip = {name: _number(known, name) for name in ("near_clip", "far_clip")}
            self.lens = {"type": "orthographic", **clip}
            width, height = (int(side) for side in sensor.film().crop_size())
            self.intrinsics = _matrix(sensor.projection_transform(), "sensor"), width, height
        elif scene.sensors():
            sensor = scene.sensors()[0]
            base = camera(sensor)
            self.pose = _matrix(sensor.world_transform(), "sensor")
            self.intrinsics = base.world_to_clip @ self.pose, base.width, base.height
            known = mi.traverse(sensor)
            if "aperture_radius" in known:
                self.lens["type"] = "thinlens"
            for name in ("near_clip", "far_clip", "aperture_radius", "focus_distance"):
                if name in known:
                    self.lens[name] = _number(known, name)
        self.light = scene.integrator() or mi.load_dict({"type": "path"})
        self.clear = "Volumetric" not in self.light.class_name()
        self.emission = mi.load_dict({"type": "path", "max_depth": 1})
        # By id, with places for background and for what is inside an instance.
        bsdfs = [shape.bsdf() for shape in scene.shapes()]
        mirrors = [bsdf is not None and not mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse) for bsdf in bsdfs]
        self.mirrors = np.array([False, *mirrors, False])

    def frames(
        self,
        shots: Shots,
        spp: int,
        seed: int,
        buffers: bool,
        gradient: bool,
        onwards: bool,
        part: int = 0,
        parts: int = 1,
    ) -> Generator[Frame]:
        """Render shots one by one, as `render_sequence` does; of several parts of the samples, only one."""
        last: dict[str, NDArray[Any]] = {}
        try:
            for index, shot in enumerate(shots):
                self.arrange(shot.poses, shot.values)
                sensor = self.mi.load_dict(shot.sensor)
                if not buffers:
                    one = self.render(self.light, sensor, (seed + index) * parts + part, spp)
                    yield Frame(one[""], camera=shot.known)
                    continue
                start = ((seed + index) * parts + part) * spp
                seeds = range(start, start + spp)
                first = self.sample(sensor, seeds[0])
                total = {name: first[name].astype(np.float64) for name in ("color", "albedo", "emission")}
                for number in seeds[1:]:
                    another = self.sample(sensor, number)
                    for name in total:
                        total[name] += another[name]
                hit = first["depth"][..., 0] > 0
                position = np.where(hit[..., None], first["position"], np.float32(np.nan))
                ids = first["ids"]
                before, after = shots[max(index - 1, 0)], shots[min(index + 1, len(shots) - 1)]
                back = self.moved(shot, before)
                replay = None
                if gradient and index:
                    former = start - parts * spp
                    replay = self.replay(before, range(former, former + spp), last, [*back])
                last = first
                yield Frame(
                    total["color"] / spp,
                    albedo=total["albedo"] / spp,
                    normal=first["normal"],
                    depth=np.where(hit, shot.camera.project(position)[1], np.inf),
                    motion=self.motion(shot, before, position, first),
                    motion_next=self.motion(shot, after, position, first) if onwards else None,
                    ids=ids,
                    position=position,
                    emission=total["emission"] / spp if self.clear else None,
                    object_normal=self.unturned(first["normal"], ids, shot.poses) if self.movers else None,
                    replay=replay,
                    camera=shot.known,
                )
        finally:
            self.arrange({}, {})

    @cached_property
    def surface(self) -> Any:
        bent = ",prims:prim_index" if self.bent else ""
        return self.mi.load_dict({"type": "aov", "aovs": _AOVS + bent})

    @property
    def bent(self) -> list[str]:
        """The ids of shapes whose vertices move."""
        named = (name.removesuffix(_VERTICES) for name in sorted(self.changing) if name.endswith(_VERTICES))
        return [name for name in named if name in self.index]

    @cached_property
    def parameters(self) -> Any:
        return self.mi.traverse(self.scene)

    @cached_property
    def index(self) -> dict[str, int]:
        return {shape.id(): number for number, shape in enumerate(self.scene.shapes(), 1)}

    def camera(self, view: Camera | ArrayLike) -> Camera | _Parallel:
        if self.lens["type"] == "orthographic" and self.intrinsics is not None:
            if isinstance(view, Camera):
                raise ValueError("cameras: expected poses, as the sensor is orthographic, got yester.Camera")
            to_uv, width, height = self.intrinsics
            pose = _matrix(view, "cameras")
            return _Parallel(to_uv @ np.linalg.inv(pose), pose, width, height)
        if isinstance(view, Camera):
            return view
        if self.intrinsics is None:
            raise ValueError("cameras: expected yester.Camera, as the scene has no sensor, got a matrix")
        projection, width, height = self.intrinsics
        return Camera(projection @ np.linalg.inv(_matrix(view, "cameras")), width, height)

    def sensor(self, view: Camera | _Parallel) -> dict[str, Any]:
        """The description of the Mitsuba sensor of a camera."""
        if isinstance(view, _Parallel):
            return {
                **self.lens,
                "to_world": self.mi.ScalarTransform4f(view.pose),
                "film": self.film(view),
                "sampler": {"type": "independent"},
            }
        to_camera = view.world_to_camera
        projection = view.world_to_clip @ np.linalg.inv(to_camera)
        (zoom, skew, right, _), (lean, tall, up, _) = projection[:2] / projection[3, 2]
        if max(abs(tall * view.height / view.width - zoom), abs(skew), abs(lean)) > 1e-4 * zoom:
            raise ValueError("cameras: expected square pixels, which Mitsuba's cameras have, got others")
        offset = {"principal_point_offset_x": -right / 2, "principal_point_offset_y": up / 2}
        if self.lens["type"] == "thinlens":
            if max(abs(right), abs(up)) > 1e-4:
                raise ValueError("cameras: expected the principal point of a thin lens in the centre of the image")
            offset = {}
        return {
            **self.lens,
            **offset,
            "fov": math.degrees(2 * math.atan(1 / zoom)),
            "fov_axis": "x",
            # Mitsuba's x points left.
            "to_world": self.mi.ScalarTransform4f(np.linalg.inv(np.diag([-1.0, 1, 1, 1]) @ to_camera)),
            "film": self.film(view),
            "sampler": {"type": "independent"},
        }

    def film(self, view: Camera | _Parallel) -> dict[str, Any]:
        return {
            "type": "hdrfilm",
            "width": view.width,
            "height": view.height,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        }

    def poses(self, named: Mapping[str, ArrayLike]) -> dict[str, Matrix]:
        """Checked matrices of shapes that can be moved."""
        for name in named:
            if name not in self.index:
                known = ", ".join(filter(None, self.index))
                raise ValueError(f"transforms: expected ids of shapes ({known}), got {name!r}")
            kind = self.scene.shapes()[self.index[name] - 1].class_name()
            # Vectorised variants tell what was instanced, not which instance.
            if not self._keys(name) or (kind == "Instance" and not self.scalar):
                raise ValueError(f"transforms: {name!r} is a shape that cannot be moved: {kind} in {self.mi.variant()}")
        self.movers |= named.keys()
        return {name: _matrix(pose, f"transforms[{name!r}]") for name, pose in named.items()}

    def moved(self, shot: Shot, other: Shot) -> dict[int, Matrix]:
        """By id, from where shapes are in a shot to where they are in another; those that differ."""
        return {
            self.index[name]: other.poses.get(name, _STILL) @ np.linalg.inv(shot.poses.get(name, _STILL))
            for name in other.poses.keys() | shot.poses.keys()
            if not np.array_equal(other.poses.get(name, _STILL), shot.poses.get(name, _STILL))
        }

    def motion(
        self, shot: Shot, other: Shot, position: NDArray[Any], seen: Mapping[str, NDArray[Any]]
    ) -> NDArray[np.float32]:
        """Motion of what one shot sees to where it is in another."""
        ids, moved = seen["ids"], self.moved(shot, other)
        if isinstance(shot.camera, Camera) and isinstance(other.camera, Camera):
            vectors = motion_vectors(position, shot.camera, other.camera, ids=ids, transforms=moved)
            exact = np.isin(ids, [self.index[name] for name in self.bent])
        else:
            # Without a centre of projection, the background has no place.
            vectors = np.zeros((*ids.shape, 3), np.float32)
            exact = ids > 0
        if not exact.any():
            return vectors
        there = position.astype(np.float64)
        for number, matrix in moved.items():
            here = ids == number
            there[here] = there[here] @ matrix[:3, :3].T + matrix[:3, 3]
        for name in self.bent:
            here = ids == self.index[name]
            faces = np.array(self.parameters[f"{name}.faces"], np.int64).reshape(-1, 3)
            corners = faces[seen["prims"][here, 0].astype(np.int64)]
            now, then = (self.vertices(each, name)[corners] for each in (shot, other))
            there[here] = (_barycentrics(there[here], now)[..., None] * then).sum(1)
        (pixels, depth), (others, further) = shot.camera.project(position), other.camera.project(there)
        change = np.concatenate([others - pixels, (further - depth)[..., None]], -1)
        return np.where(exact[..., None], change, vectors).astype(np.float32)

    def vertices(self, shot: Shot, name: str) -> Matrix:
        """Where the vertices of a mesh are in a shot, (N, 3)."""
        key = name + _VERTICES
        return np.array(shot.values.get(key, self._standing(key)), np.float64).reshape(-1, 3)

    def values(self, named: Mapping[str, Any]) -> dict[str, Any]:
        """Checked values of parameters, as Mitsuba has them."""
        values = {}
        for name, value in named.items():
            if name not in self.parameters:
                close = ", ".join(get_close_matches(name, self.parameters.keys(), cutoff=0.4))
                like = f" ({close})" if close else ""
                raise ValueError(f"parameters: expected names that mitsuba.traverse(scene) has{like}, got {name!r}")
            if any(name in self._keys(mover) for mover in self.movers):
                raise ValueError(f"parameters: {name!r} is what transforms change")
            kind = type(self.parameters[name])
            try:
                values[name] = kind(value)
            except Exception as error:  # Mitsuba's types have several for what they cannot be made of
                raise ValueError(f"parameters[{name!r}]: expected {kind.__name__}, got {value!r}") from error
        self.changing |= values.keys()
        return values

    def arrange(self, poses: Mapping[str, Matrix], values: Mapping[str, Any]) -> None:
        """Moves shapes and sets parameters; those that are not named become again what the scene has."""
        # All that ever change, every time and even to what they are: Mitsuba rounds otherwise what it has loaded.
        for name in sorted(self.movers):
            self._move(name, poses.get(name, _STILL))
        for name in sorted(self.changing):
            self._set(name, values.get(name, self._standing(name)))
        if self.movers or self.changing:
            self.parameters.update()

    def unturned(
        self, normal: NDArray[np.float32], ids: NDArray[np.uint32], poses: Mapping[str, Matrix]
    ) -> NDArray[np.float32]:
        """Normals turned back to where the scene has the shapes."""
        normal = normal.copy()
        for name, pose in poses.items():
            here = ids == self.index[name]
            back = normal[here] @ pose[:3, :3]  # normals go forth with the inverse transpose
            normal[here] = back / np.linalg.norm(back, axis=-1, keepdims=True)
        return normal

    def _keys(self, name: str) -> list[str]:
        keys = (f"{name}.{key}" for key in ("to_world", "vertex_positions", "vertex_normals"))
        return [key for key in keys if key in self.parameters]

    def _move(self, name: str, pose: Matrix) -> None:
        for key in self._keys(name):
            standing = self._standing(key)
            if pose is _STILL:  # gives back what was there, to the bit
                self._set(key, standing)
            elif key.endswith("to_world"):
                self._set(key, self.mi.Transform4f(pose @ _matrix(standing, key)))
            else:
                vectors = np.array(standing, np.float64).reshape(-1, 3)
                if key.endswith("vertex_positions"):
                    vectors = vectors @ pose[:3, :3].T + pose[:3, 3]
                else:
                    vectors = vectors @ np.linalg.inv(pose[:3, :3])
                    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
                self._set(key, vectors.astype(np.float32).ravel())

    def _standing(self, key: str) -> Any:
        """What the scene had before anything was changed."""
        if key not in self.standing:
            value = self.parameters[key]
            self.standing[key] = type(value)(value)
        return self.standing[key]

    def _set(self, key: str, value: Any) -> None:
        self.parameters[key] = value
        self.parameters.set_dirty(key)

    def replay(
        self, shot: Shot, seeds: range, then: Mapping[str, NDArray[Any]], moved: list[int]
    ) -> NDArray[np.float64]:
        """A former shot's colour in the scene as it is now; NaN where its first sample meets something else."""
        sensor = self.mi.load_dict(shot.sensor)
        color = np.zeros((shot.camera.height, shot.camera.width, 3))
        for seed in seeds:
            color += self.render(self.light, sensor, seed)[""]
        now = self.hit(sensor, seeds[0])
        apart = np.linalg.norm(now["position"] - then["position"], axis=-1) > _SAME * then["depth"][..., 0]
        other = (now["ids"] != then["ids"]) | np.isin(now["ids"], moved) | apart
        return np.where(other[..., None], np.nan, color / len(seeds))

    def sample(self, sensor: Any, seed: int) -> dict[str, NDArray[Any]]:
        """One sample per pixel, seen by all integrators: those that share a seed share their first random numbers.

        (One ``aov`` integrator around the others would do as well, but calls each of them twice.)
        """
        light = self.render(self.light, sensor, seed)[""]
        emission = self.render(self.emission, sensor, seed)[""]
        surface = self.hit(sensor, seed)
        # What Mitsuba calls albedo is, without a diffuse part, the BSDF at one pair of directions, from 0 to anything.
        mirror = self.mirrors[np.minimum(surface["ids"], len(self.mirrors) - 1), None]
        return {
            **surface,
            "albedo": np.where(mirror, np.float32(1), surface["albedo"]),
            "color": light,
            # Less than what a path tracer sees only where the scene's own integrator hides lights.
            "emission": np.fmin(emission, light),
        }

    def hit(self, sensor: Any, seed: int) -> dict[str, NDArray[Any]]:
        """What is known of the surface at one sample per pixel."""
        # In scalar variants, shapes that Python has once seen are counted under its lock, several times a sample: one
        # thread is then three times as fast as two.
        with self.threads(1):
            surface = self.render(self.surface, sensor, seed)
        return {**surface, "ids": self.ids(surface["ids"][..., 0])}

    @contextmanager
    def threads(self, most: int) -> Iterator[None]:
        """Render with no more threads than this, if the variant is a scalar one."""
        before = self.drjit.thread_count()
        if self.scalar:
            self.drjit.set_thread_count(min(before, most))
        try:
            yield
        finally:
            self.drjit.set_thread_count(before)

    def render(self, integrator: Any, sensor: Any, seed: int, spp: int = 1) -> dict[str, NDArray[np.float32]]:
        """The layers of the film by name, (H, W, C); the unnamed one is colour. InterruptedError on an interrupt."""
        # Each block of the image has its own random numbers, and blocks are halved until there are more than threads:
        # with as many threads, bits would depend on their number.
        width, height = sensor.film().size()
        blocks = math.ceil(width / _BLOCK) * math.ceil(height / _BLOCK)
        with self.threads(max(blocks - 1, 1)):
            integrator.render(self.scene, sensor=sensor, seed=seed, spp=spp)
        # On SIGINT, Mitsuba ends in any thread, with the blocks that it has.
        if integrator.should_stop():
            raise InterruptedError("rendering was interrupted")
        bitmap = sensor.film().bitmap()
        pixels = np.array(bitmap)
        layers = [field.name.rpartition(".")[0] for field in bitmap.struct_()]
        return {name: pixels[..., [name == layer for layer in layers]] for name in layers}

    def ids(self, stored: NDArray[np.float32]) -> NDArray[np.uint32]:
        """Shapes counted from 1: what scalar variants store; the others have handles that differ on every load."""
        ids = stored.astype(np.uint32)
        if self.scalar:
            return ids
        handles = np.array(self.drjit.reinterpret_array(self.mi.UInt32, self.scene.shapes_dr()))
        # What is neither background nor in the list is inside an instance.
        table = np.arange(max(ids.max(), handles.max()) + 1, dtype=np.uint32) + np.uint32(len(handles))
        table[0] = 0
        table[handles] = np.arange(1, len(handles) + 1)
        return table[ids]


def _mitsuba() -> Any:
    try:
        mi: Any = import_module("mitsuba")
    except ImportError as error:
        raise ImportError("rendering needs Mitsuba: pip install 'yester[mitsuba]'") from error
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    return mi


def _barycentrics(points: Matrix, corners: Matrix) -> Matrix:
    """Weights (N, 3) of the corners (N, 3, 3) of triangles at points (N, 3) in their planes (Ericson, *Real-Time
    Collision Detection*, section 3.4)."""
    one, two, place = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    a, b, c = (one * one).sum(-1), (one * two).sum(-1), (two * two).sum(-1)
    d, e = (place * one).sum(-1), (place * two).sum(-1)
    second, third = np.stack([c * d - b * e, a * e - b * d]) / (a * c - b * b)
    return np.stack([1 - second - third, second, third], -1)


def _number(parameters: Any, name: str) -> float:
    """A parameter that is a number, or in vectorised variants an array of one; 0 if there is none."""
    return float(np.ravel(parameters[name])[0]) if name in parameters else 0.0


def _matrix(transform: Any, name: str) -> Matrix:
    """An invertible (4, 4) matrix from an array or a Mitsuba transform, which vectorised variants make (4, 4, 1)."""
    matrix = np.array(getattr(transform, "matrix", transform), np.float64)
    matrix = matrix[..., 0] if matrix.shape == (4, 4, 1) else matrix
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or np.linalg.det(matrix) == 0:
        raise ValueError(f"{name}: expected an invertible (4, 4) matrix, got {matrix.tolist()}")
    return matrix
