"""A small exact ray-caster: scenes whose buffers, motion and noise-free image are known exactly.

A scene is the arrangement of things at one moment; a sequence is a list of scenes with the same things in the same
order. Shapes are analytic and move rigidly. Shading is Lambertian, by point and directional lights with hard shadows,
plus an ambient term; mirrors are perfect and reflect once. Noise is multiplicative with mean one, so that the mean of
`shoot` is `truth`. Lengths are in scene units, matrices take column vectors, colours are linear.

Internally vectors are (3, N), since numpy is fastest along rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yester import Camera, Frame

__all__ = [
    *("Box", "Hits", "Light", "Rectangle", "Scene", "Shape", "Sphere", "Texture", "Thing", "Wire"),
    *("cast", "centres", "checker", "motion", "noise", "shoot", "stripes", "translate", "truth", "turn", "value_noise"),
]

Floats: TypeAlias = NDArray[np.float64]
Color: TypeAlias = tuple[float, float, float]
#: Maps points in object space, (3, N), to colours, (3, N).
Texture: TypeAlias = Callable[[Floats], Floats]

#: Distance between a surface and the start of rays that leave it, in scene units.
_CLEARANCE = 1e-6
#: Distance of the background in scene units: its parallax is below the resolution of float32 pixel coordinates.
_FAR = 1e9


class Shape(Protocol):
    """A surface in object space."""

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        """Distance along rays of unit direction, (3, 1) or (3, N), to the first hit: (N,), infinity for a miss."""
        ...

    def normal(self, point: Floats) -> Floats:
        """Unit normals at points of the surface, both (3, N); the sign is arbitrary."""
        ...


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in the plane z = 0, centred at the origin. With infinite sides, a plane.

    Attributes
    ----------
    width, height : float, default infinity
        Sides along x and y, in scene units.
    """

    width: float = np.inf
    height: float = np.inf

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -origin[2] / direction[2]
            x, y = (origin[i] + t * direction[i] for i in range(2))
        inside = (t > _CLEARANCE) & (np.abs(x) <= self.width / 2) & (np.abs(y) <= self.height / 2)
        return np.where(inside & np.isfinite(t), t, np.inf)

    def normal(self, point: Floats) -> Floats:
        return np.broadcast_to([[0.0], [0.0], [1.0]], point.shape)


@dataclass(frozen=True)
class Sphere:
    """A sphere centred at the origin.

    Attributes
    ----------
    radius : float
        Radius in scene units.
    """

    radius: float

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        return _sphere(origin, direction, self.radius)

    def normal(self, point: Floats) -> Floats:
        return point / self.radius


@dataclass(frozen=True)
class Box:
    """An axis-aligned box centred at the origin.

    Attributes
    ----------
    size : (x, y, z)
        Lengths of the sides, in scene units.
    """

    size: tuple[float, float, float]

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        half = np.array(self.size)[:, None] / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-half - origin) / direction, (half - origin) / direction
        enter, leave = np.fmin(one, other).max(0), np.fmax(one, other).min(0)
        t = np.where(enter > _CLEARANCE, enter, leave)
        return np.where((enter <= leave) & (t > _CLEARANCE), t, np.inf)

    def normal(self, point: Floats) -> Floats:
        side = np.abs(point / np.array(self.size)[:, None]).argmax(0)
        return np.where(np.arange(3)[:, None] == side, np.sign(point), 0.0)


@dataclass(frozen=True)
class Wire:
    """A cylinder with hemispherical ends.

    Attributes
    ----------
    start, end : (x, y, z)
        Two different points, the ends of the axis.
    radius : float
        Radius in scene units.
    """

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        start = np.array(self.start)[:, None]
        axis = np.array(self.end)[:, None] - start
        across = origin - start
        squared = (axis**2).sum()
        along, offset = _dot(axis, direction), _dot(axis, across)
        # Intersect the infinite cylinder: project ray and origin to the plane perpendicular to the axis.
        a = squared - along**2
        b = squared * _dot(across, direction) - offset * along
        c = squared * _dot(across, across) - offset**2 - self.radius**2 * squared
        root = b * b - a * c
        nearest = np.full(root.shape, np.inf)
        near = np.flatnonzero(root >= 0)  # continue with the few rays that hit it
        across, offset, c = (np.broadcast_to(v, (*v.shape[:-1], root.size))[..., near] for v in (across, offset, c))
        direction, along, a, b, root = direction[:, near], along[near], a[near], b[near], root[near]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b - np.sqrt(root)) / a
            y = offset + t * along
        side = np.where((t > _CLEARANCE) & (y >= 0) & (y <= squared), t, np.inf)
        ends = [_sphere(across - end, direction, self.radius) for end in (0, axis)]
        nearest[near] = np.minimum(side, np.minimum(*ends))
        return nearest

    def normal(self, point: Floats) -> Floats:
        start = np.array(self.start)[:, None]
        axis = np.array(self.end)[:, None] - start
        nearest = start + np.clip(_dot(axis, point - start) / (axis**2).sum(), 0, 1) * axis
        return np.asarray((point - nearest) / self.radius)


def checker(one: Color, other: Color, size: float) -> Texture:
    """A 3D chessboard of two colours.

    Parameters
    ----------
    one, other : (r, g, b)
        `one` is the colour of the cube between the origin and (size, size, size).
    size : float
        Side of a cube, in scene units.
    """

    def texture(point: Floats) -> Floats:
        # A small offset, so that a face on the boundary of two cubes has one colour despite rounding.
        return _either(np.floor(point / size + 1e-9).sum(0) % 2 == 0, one, other)

    return texture


def stripes(one: Color, other: Color, width: float, axis: int = 0) -> Texture:
    """Stripes of two colours that alternate along an axis.

    Parameters
    ----------
    one, other : (r, g, b)
        `one` is the colour from the origin to `width`.
    width : float
        Width of a stripe, in scene units.
    axis : int, default 0
        0, 1 or 2 for x, y or z.
    """

    def texture(point: Floats) -> Floats:
        return _either(np.floor(point[axis] / width) % 2 == 0, one, other)

    return texture


def value_noise(one: Color, other: Color, size: float, seed: int = 0) -> Texture:
    """A random blend of two colours: values at the corners of a lattice, smoothly interpolated (Perlin 1985).

    Parameters
    ----------
    one, other : (r, g, b)
    size : float
        Period of the lattice in scene units; the texture repeats after 32 periods.
    seed : int, default 0
    """
    period = 32
    values = np.random.default_rng(seed).random((period,) * 3)

    def texture(point: Floats) -> Floats:
        corner = np.floor(point / size)
        x, y, z = point / size - corner
        i, j, k = corner.astype(np.int64)
        x, y, z = (t * t * (3 - 2 * t) for t in (x, y, z))
        value = np.zeros_like(x)
        for a, b, c in np.ndindex(2, 2, 2):
            weight = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
            value += weight * values[(i + a) % period, (j + b) % period, (k + c) % period]
        return np.asarray(np.array(one)[:, None] * (1 - value) + np.array(other)[:, None] * value)

    return texture


def translate(x: float, y: float, z: float) -> Floats:
    """The matrix of a translation, in scene units."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turn(axis: ArrayLike, degrees: float) -> Floats:
    """The matrix of a right-handed rotation around an axis through the origin (Rodrigues' formula)."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


@dataclass(frozen=True, eq=False)
class Thing:
    """A shape with its pose and material.

    Attributes
    ----------
    shape : Shape
    place : (4, 4) ndarray, default the identity
        Rigid transform from object space to the world.
    albedo : (r, g, b) or Texture, default a light grey
        0 to 1; the reflectance of a mirror.
    emission : (r, g, b) or Texture, default black
        Light emitted to the camera; it illuminates nothing.
    mirror : bool, default False
        A perfect mirror; other mirrors appear black in it.
    shadow : bool, default True
        Whether it casts shadows.
    """

    shape: Shape
    place: Floats = field(default_factory=lambda: np.eye(4))
    albedo: Color | Texture = (0.7, 0.7, 0.7)
    emission: Color | Texture = (0.0, 0.0, 0.0)
    mirror: bool = False
    shadow: bool = True


@dataclass(frozen=True)
class Light:
    """A point light or a directional light.

    Attributes
    ----------
    place : (x, y, z)
        Its position; for a distant light, the direction towards it.
    color : (r, g, b)
        Radiance of a white surface that faces the light, at a distance of one scene unit; for a distant light, at any
        distance.
    distant : bool, default False
    """

    place: tuple[float, float, float]
    color: Color
    distant: bool = False


@dataclass(frozen=True, eq=False)
class Scene:
    """The arrangement of things at one moment. The id of a thing is its position in the list, counted from 1.

    Attributes
    ----------
    things : tuple of Thing
    camera : Camera
    lights : tuple of Light, default none
    ambient : (r, g, b), default (0.3, 0.3, 0.3)
        Radiance of a white surface under the ambient light.
    background : (r, g, b), default black
        Radiance of the background: emission, without noise.
    """

    things: tuple[Thing, ...]
    camera: Camera
    lights: tuple[Light, ...] = ()
    ambient: Color = (0.3, 0.3, 0.3)
    background: Color = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Hits:
    """The surfaces visible at positions of an image, in double precision.

    Attributes
    ----------
    pixels : (..., 2)
        The positions, in pixels, x right, y down, pixel centres at +0.5.
    ids, depth, position, normal, object_normal, albedo, emission : (...) or (..., 3)
        As in `yester.Frame`.
    local : (..., 3)
        The position in object space; for background, a distant point.
    light : (..., 3)
        Radiance of a white surface there; for a mirror, the reflected radiance.
    """

    pixels: Floats
    ids: NDArray[np.uint32]
    depth: Floats
    position: Floats
    normal: Floats
    object_normal: Floats
    albedo: Floats
    emission: Floats
    local: Floats
    light: Floats

    @property
    def color(self) -> Floats:
        """(..., 3) without noise."""
        return self.albedo * self.light + self.emission


def cast(scene: Scene, pixels: ArrayLike) -> Hits:
    """Cast rays through positions of the image.

    Parameters
    ----------
    scene : Scene
    pixels : (..., 2) array_like of float
        In pixels, x right, y down, pixel centres at +0.5.

    Returns
    -------
    Hits
        With the leading shape of `pixels`.

    Raises
    ------
    ValueError
        If `pixels` has another shape.
    """
    pixels = np.asarray(pixels, np.float64)
    if pixels.ndim == 0 or pixels.shape[-1] != 2:
        raise ValueError(f"pixels: expected shape (..., 2), got {pixels.shape}")
    origin, rays = scene.camera.rays(pixels.reshape(-1, 2))
    eye, direction = origin[:, None], np.ascontiguousarray(rays.T)
    seen = _look(scene, eye, direction)
    hit = seen.ids > 0
    light = _lighting(scene, seen.point, seen.normal, hit)
    mirrors = hit & np.array([False, *(thing.mirror for thing in scene.things)])[seen.ids]
    if mirrors.any():
        ray, normal, point = direction[:, mirrors], seen.normal[:, mirrors], seen.point[:, mirrors]
        there = _look(scene, point + _CLEARANCE * normal, ray - 2 * _dot(ray, normal) * normal)
        light[:, mirrors] = there.emission + there.albedo * _lighting(scene, there.point, there.normal, there.ids > 0)
    position = np.where(hit, seen.point, np.nan)
    depth = np.where(hit, scene.camera.project(seen.point.T)[1], np.inf)

    def shaped(values: NDArray[np.float64]) -> Floats:
        return np.ascontiguousarray(np.moveaxis(values, 0, -1)).reshape(*pixels.shape[:-1], *values.shape[:-1])

    return Hits(
        pixels=pixels,
        ids=seen.ids.reshape(pixels.shape[:-1]),
        depth=depth.reshape(pixels.shape[:-1]),
        position=shaped(position),
        normal=shaped(seen.normal),
        object_normal=shaped(seen.object_normal),
        albedo=shaped(seen.albedo),
        emission=shaped(seen.emission),
        local=shaped(seen.local),
        light=shaped(light),
    )


def motion(hits: Hits, before: Scene) -> Floats:
    """Motion vectors from one scene to another.

    Parameters
    ----------
    hits : Hits
        In the one scene.
    before : Scene
        The other one, of the same things in the same order.

    Returns
    -------
    (..., 3) ndarray of float64
        As in `yester.Frame`: previous minus current pixel and depth. NaN where the point was not in front of the
        camera. The background moves with the camera's rotation only.
    """
    places = np.stack([np.eye(4), *(thing.place for thing in before.things)])[hits.ids]
    then = np.einsum("...ij,...j->...i", places[..., :3, :3], hits.local) + places[..., :3, 3]
    pixels, depth = before.camera.project(then)
    background = hits.ids == 0
    change = np.where(background, 0.0, depth - np.where(background, 0.0, hits.depth))
    return np.concatenate([pixels - hits.pixels, change[..., None]], -1)


def truth(scene: Scene, side: int = 4) -> NDArray[np.float32]:
    """The image without noise: the mean over ``side`` × ``side`` positions of every pixel, a box filter.

    Parameters
    ----------
    scene : Scene
    side : int, default 4

    Returns
    -------
    (H, W, 3) ndarray of float32
    """
    places = centres(scene.camera)
    offsets = (np.arange(side) + 0.5) / side - 0.5
    total = sum(cast(scene, np.add(places, (x, y))).color for y in offsets for x in offsets)
    return np.asarray(total / side**2, np.float32)


def noise(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    deviation: float,
    *,
    fireflies: float = 0.0,
    brightness: float = 50.0,
) -> NDArray[np.float32]:
    """Random factors of mean one: a gamma distribution, optionally with rare, bright fireflies.

    Parameters
    ----------
    rng : numpy.random.Generator
    shape : tuple of int
    deviation : float
        Relative standard deviation of the factors other than fireflies. With 1, the distribution is exponential, which
        resembles paths that either hit a light or miss it.
    fireflies : float, default 0
        Fraction of fireflies.
    brightness : float, default 50
        Factor of fireflies. The other factors are reduced, so that the mean stays one.

    Returns
    -------
    ndarray of float32

    Raises
    ------
    ValueError
        If the deviation is negative, or fireflies × brightness is not below 1.
    """
    if not deviation >= 0:
        raise ValueError(f"deviation: expected at least 0, got {deviation}")
    if not 0 <= fireflies * brightness < 1:
        raise ValueError(f"fireflies: expected fireflies × brightness from 0 to below 1, got {fireflies}×{brightness}")
    factors = np.ones(shape)
    if deviation > 0:
        factors = rng.gamma(deviation**-2, deviation**2, shape)
    if fireflies > 0:
        rest = (1 - fireflies * brightness) / (1 - fireflies)
        factors = np.where(rng.random(shape) < fireflies, brightness, rest * factors)
    return factors.astype(np.float32)


def shoot(
    scene: Scene,
    before: Scene | None,
    rng: np.random.Generator,
    *,
    deviation: float = 0.0,
    fireflies: float = 0.0,
    jitter: ArrayLike | None = None,
) -> Frame:
    """Render the scene with one sample per pixel: a frame with all exact buffers.

    Parameters
    ----------
    scene : Scene
    before : Scene or None
        The previous frame's scene, for motion; None for no motion.
    rng : numpy.random.Generator
    deviation, fireflies : float, default 0
        Parameters of `noise`, which multiplies light. Emission and background have no noise.
    jitter : (2,) array_like of float, optional
        One offset for all samples, stored in the frame. By default samples are distributed randomly over their pixels,
        as in a path tracer.

    Returns
    -------
    Frame
        Without ``replay`` and ``hit_distance``. All buffers belong to the sample of the colour.
    """
    camera = scene.camera
    offsets = rng.random((camera.height, camera.width, 2)) - 0.5 if jitter is None else np.asarray(jitter)
    hits = cast(scene, centres(camera) + offsets)
    factors = noise(rng, (camera.height, camera.width, 1), deviation, fireflies=fireflies)
    return Frame(
        hits.albedo * hits.light * factors + hits.emission,
        albedo=hits.albedo,
        normal=hits.normal,
        depth=hits.depth,
        motion=motion(hits, before or scene),
        ids=hits.ids,
        position=hits.position,
        emission=hits.emission,
        object_normal=hits.object_normal,
        camera=camera,
        jitter=jitter,
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """The first hits of rays: (N,) and (3, N)."""

    ids: NDArray[np.uint32]
    point: Floats
    local: Floats
    normal: Floats
    object_normal: Floats
    albedo: Floats
    emission: Floats


def _look(scene: Scene, origin: Floats, direction: Floats) -> _Seen:
    count = direction.shape[1]
    nearest, ids = np.full(count, np.inf), np.zeros(count, np.uint32)
    for number, thing in enumerate(scene.things, 1):
        t = thing.shape.hit(*_into(thing, origin, direction))
        closer = t < nearest
        nearest[closer], ids[closer] = t[closer], number
    point = origin + np.where(ids > 0, nearest, _FAR) * direction
    local, normal, object_normal = point.copy(), np.zeros_like(point), np.zeros_like(point)
    albedo, emission = np.zeros_like(point), np.zeros_like(point)
    emission[:] = np.array(scene.background)[:, None]
    for number, thing in enumerate(scene.things, 1):
        here = np.flatnonzero(ids == number)
        if here.size == 0:
            continue
        rotation, position = thing.place[:3, :3], thing.place[:3, 3:]
        own = rotation.T @ (point[:, here] - position)
        facing = thing.shape.normal(own)
        facing = np.where(_dot(rotation @ facing, direction[:, here]) > 0, -facing, facing)
        local[:, here], object_normal[:, here], normal[:, here] = own, facing, rotation @ facing
        albedo[:, here], emission[:, here] = (_paint(color, own) for color in (thing.albedo, thing.emission))
    return _Seen(ids, point, local, normal, object_normal, albedo, emission)


def _lighting(scene: Scene, point: Floats, normal: Floats, hit: NDArray[np.bool_]) -> Floats:
    """Radiance of white surfaces at these points."""
    total = np.where(hit, np.array(scene.ambient)[:, None], 0.0)
    for light in scene.lights:
        place = np.array(light.place)[:, None]
        way = place / np.linalg.norm(place) if light.distant else place - point
        distance = np.full(hit.size, np.inf) if light.distant else np.sqrt(_dot(way, way))
        toward = np.broadcast_to(way if light.distant else way / distance, point.shape)
        cosine = _dot(normal, toward)
        lit = np.flatnonzero(hit & (cosine > 0))
        start, direction = point[:, lit] + _CLEARANCE * normal[:, lit], toward[:, lit]
        free = np.ones(lit.size, bool)
        for thing in scene.things:
            if thing.shadow:
                free &= thing.shape.hit(*_into(thing, start, direction)) >= distance[lit]
        lit = lit[free]
        falloff = 1.0 if light.distant else distance[lit] ** -2
        total[:, lit] += np.array(light.color)[:, None] * (cosine[lit] * falloff)
    return total


def _into(thing: Thing, origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Transform rays to object space; distances along them do not change."""
    rotation, position = thing.place[:3, :3], thing.place[:3, 3:]
    return rotation.T @ (origin - position), rotation.T @ direction


def _sphere(origin: Floats, direction: Floats, radius: float) -> Floats:
    b, c = _dot(origin, direction), _dot(origin, origin) - radius**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - c)
    near, far = -b - root, -b + root
    t = np.where(near > _CLEARANCE, near, far)
    return np.where(t > _CLEARANCE, t, np.inf)


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _either(choice: NDArray[np.bool_], one: Color, other: Color) -> Floats:
    return np.where(choice, np.array(one)[:, None], np.array(other)[:, None])


def _paint(color: Color | Texture, point: Floats) -> Floats:
    return color(point) if callable(color) else np.array(color, np.float64)[:, None]


def centres(camera: Camera) -> Floats:
    """The (H, W, 2) pixel centres of a camera's image."""
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([x, y], -1)
