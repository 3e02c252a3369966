"""What the scenes are built of: materials, meshes, pictures, and what moves in time.

Every function that makes a sequence is decorated with `builder`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from yester import Camera

Matrix = NDArray[np.float64]

#: Vertical field of view in degrees: at 4:3, Mitsuba's Cornell box fills the image.
FOV = 33


@dataclass(frozen=True)
class Sequence:
    """A scene in motion.

    Attributes
    ----------
    scene : dict
        For `mitsuba.load_dict`.
    cameras : list of Camera
        One for every frame.
    transforms : list of dict
        For every frame, the (4, 4) matrices, by shape, that take the moving shapes from where the scene puts them to
        where they are: the same shapes in all frames.
    parameters : list of dict
        For every frame, the values of what else changes, by name as `mitsuba.traverse` has it.
    """

    scene: dict[str, Any]
    cameras: list[Camera]
    transforms: list[dict[str, Matrix]]
    parameters: list[dict[str, Any]]


@dataclass(frozen=True)
class Exposure(Sequence):
    """A sequence with motion blur: each frame is the mean over the instants at which the shutter is open.

    Attributes
    ----------
    instants : list of list of (Camera, dict)
        For every frame, its instants, evenly spaced: the camera and the transforms as in `Sequence`. `cameras` and
        `transforms` are those of the first instant. Motion leads to the same instant of the frame before.
    """

    instants: list[list[tuple[Camera, dict[str, Matrix]]]]


#: Makes a sequence from the number of frames, and the width and height of the images.
Make: TypeAlias = Callable[[int, int, int], Sequence]
_Make = TypeVar("_Make", bound=Make)

#: By name, every function that makes a sequence.
BUILDERS: dict[str, Make] = {}

_SECTIONS = """

Parameters
----------
frames : int
    Number of frames, at least 1.
width, height : int
    Of the images, in pixels.

Returns
-------
{}

Raises
------
ImportError
    If Mitsuba is not installed.
"""


def builder(make: _Make) -> _Make:
    """Register a function that makes a sequence, and add to its docstring what is the same for all of them."""
    make.__doc__ = f"{inspect.getdoc(make)}{_SECTIONS.format(make.__annotations__['return'])}"
    BUILDERS[make.__name__] = make
    return make


def animate(
    scene: dict[str, Any],
    frames: int,
    view: Callable[[float], Camera],
    poses: Callable[[float], dict[str, Matrix]] = lambda t: {},
) -> Sequence:
    """From what happens at time t, 0 to 1."""
    times = np.linspace(0, 1, frames)
    return Sequence(scene, [view(t) for t in times], [poses(t) for t in times], [{} for _ in times])


def expose(
    scene: dict[str, Any],
    frames: int,
    view: Callable[[float], Camera],
    poses: Callable[[float], dict[str, Matrix]],
) -> Exposure:
    """From what happens at time t, 0 to 1; the shutter is open for the first half of each frame, at six instants."""
    step = 1 / max(frames - 1, 1)
    moments = np.linspace(0, 1, frames)[:, None] + 0.5 * step * (np.arange(6) / 6)
    instants = [[(view(t), poses(t)) for t in row] for row in moments.tolist()]
    cameras, transforms = [row[0][0] for row in instants], [row[0][1] for row in instants]
    return Exposure(scene, cameras, transforms, [{} for _ in instants], instants)


def mitsuba() -> Any:
    """The module, with a variant."""
    try:
        import mitsuba as mi
    except ImportError as error:
        raise ImportError("scenes need Mitsuba: pip install 'yester[mitsuba]'") from error
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    return mi


def rigid(axis: ArrayLike, degrees: float, place: ArrayLike) -> Matrix:
    """Turned about an axis through the origin, then moved to a place."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    angle = np.radians(degrees)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    pose[:3, 3] = place
    return pose


def similarity(place: ArrayLike, scale: float, turn: float, lean: float) -> Matrix:
    """Leaning from the vertical and turned about it, in degrees; then scaled and moved to a place."""
    return rigid([0, 1, 0], turn, place) @ rigid([0, 0, 1], lean, [0, 0, 0]) @ np.diag([scale, scale, scale, 1])


def _mesh(name: str, points: Matrix, faces: ArrayLike, bsdf: dict[str, Any], uv: Matrix | None = None) -> Any:
    """A mesh of points (N, 3) and faces (M, 3), smooth if it has texture coordinates; faces have two sides."""
    mi = mitsuba()
    properties = mi.Properties()
    through = bsdf["type"] == "dielectric"
    properties["mesh_bsdf"] = mi.load_dict(bsdf if through else {"type": "twosided", "nested": bsdf})
    indices = np.asarray(faces, np.uint32)
    smooth = {"has_vertex_normals": uv is not None, "has_vertex_texcoords": uv is not None}
    mesh = mi.Mesh(name, len(points), len(indices), properties, **smooth)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["faces"] = indices.ravel()
    if uv is not None:
        parameters["vertex_texcoords"] = uv.astype(np.float32).ravel()
    parameters.update()
    return mesh


def copies(name: str, vertices: Matrix, faces: ArrayLike, poses: Matrix, colors: Matrix) -> Any:
    """Coloured copies (N, 3) of a small mesh, at every pose (N, 4, 4), diffuse."""
    points = vertices @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    indices = np.asarray(faces) + len(vertices) * np.arange(len(poses))[:, None, None]
    tint = {"type": "mesh_attribute", "name": "face_color"}
    mesh = _mesh(name, points.reshape(-1, 3), indices.reshape(-1, 3), {"type": "diffuse", "reflectance": tint})
    mesh.add_attribute("face_color", 3, np.repeat(colors, indices.shape[1], 0).astype(np.float32).ravel())
    return mesh


def sheet(name: str, points: Matrix, bsdf: dict[str, Any], *, closed: bool = True) -> Any:
    """A smooth mesh of a grid of points (rows, columns, 3), whose last column may join the first."""
    rows, columns = points.shape[:2]
    grid = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        grid = np.concatenate([grid, grid[:, :1]], 1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    uv = np.mgrid[:rows, :columns].transpose(1, 2, 0)[..., ::-1] / [columns - 1, rows - 1]
    return _mesh(name, points.reshape(-1, 3), np.stack([a, b, c, a, c, d], -1).reshape(-1, 3), bsdf, uv)


def lathe(controls: ArrayLike, place: ArrayLike = (0, 0, 0)) -> Matrix:
    """A grid (rows, columns, 3) of what a curve of points (radius, height) turns out of the y axis, then moved."""
    radius, height = _bezier(controls).T[..., None]
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    grid = np.stack(np.broadcast_arrays(radius * np.sin(angle), height, radius * np.cos(angle)), -1)
    return grid + np.asarray(place, np.float64)


def tube(controls: ArrayLike, start: float, end: float) -> Matrix:
    """A grid (rows, columns, 3) around a curve in the plane of x and y, with its radii at start and end."""
    path = np.pad(_bezier(controls), ((0, 0), (0, 1)))
    tangent = np.gradient(path, axis=0)
    across = np.cross([0, 0, 1], tangent / np.linalg.norm(tangent, axis=-1, keepdims=True))
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)[:, None]
    radius = np.linspace(start, end, len(path))[:, None, None]
    ring: Matrix = np.cos(angle) * across[:, None] + np.sin(angle) * [0, 0, 1]
    return path[:, None] + radius * ring


def _bezier(controls: ArrayLike) -> Matrix:
    """Points (N, 2) on a cubic curve, by its four controls."""
    t = np.linspace(0, 1, 40)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    points: Matrix = weights @ np.asarray(controls, np.float64)
    return points


def paint(color: list[float]) -> dict[str, Any]:
    """Diffuse."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}


def glaze(color: list[float], alpha: float) -> dict[str, Any]:
    """Diffuse under a clear coat, the rougher the greater alpha."""
    return {"type": "roughplastic", "diffuse_reflectance": {"type": "rgb", "value": color}, "alpha": alpha}


def tiles(dark: list[float], bright: list[float], repeat: float) -> dict[str, Any]:
    """A diffuse checkerboard."""
    return {
        "type": "diffuse",
        "reflectance": {
            "type": "checkerboard",
            "color0": {"type": "rgb", "value": dark},
            "color1": {"type": "rgb", "value": bright},
            "to_uv": mitsuba().ScalarTransform4f().scale([repeat, repeat, 1]),
        },
    }


def glaze_tiles(dark: list[float], bright: list[float], repeat: float | list[float], alpha: float) -> dict[str, Any]:
    """A checkerboard under a clear coat."""
    checks = tiles(dark, bright, 1)["reflectance"]
    across, down = repeat if isinstance(repeat, list) else (repeat, repeat)
    checks["to_uv"] = mitsuba().ScalarTransform4f().scale([across, down, 1])
    return {"type": "roughplastic", "diffuse_reflectance": checks, "alpha": alpha}


def picture(pixels: NDArray[np.float32] | None = None) -> dict[str, Any]:
    """Diffuse with a picture of reflectances (H, W, 3); by default, of rings."""
    bitmap = mitsuba().Bitmap(rings() if pixels is None else pixels)
    return {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": bitmap, "raw": True}}


def rings(size: int = 256, rate: float = 40) -> NDArray[np.float32]:
    """A picture of every spatial frequency: rings that grow finer towards the corners."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    rings = 0.5 + 0.5 * np.cos(rate * np.hypot(x, y) ** 1.5)
    sectors = 0.5 + 0.5 * np.cos(3 * np.arctan2(y, x))
    return np.stack([0.15 + 0.7 * rings, 0.2 + 0.5 * rings * sectors, 0.75 - 0.4 * rings], -1).astype(np.float32)


def weave(columns: int, rows: int) -> NDArray[np.float32]:
    """A cloth of so many threads, four pixels each, over and under one another, with an ornament."""
    y, x = (np.mgrid[: 4 * rows, : 4 * columns] + 0.5) / 4
    over = (np.floor(x) + np.floor(y)) % 2 == 0
    relief = 0.35 + 0.65 * np.sin(np.pi * (np.where(over, x, y) % 1))
    u, v = (np.abs(np.floor(a) % 20 - 9.5) for a in (x, y))
    ornament = np.select([u + v < 5, u + v < 9, np.abs(u - v) < 1.5, u + v > 16], [0, 1, 2, 3], 4)
    colors = np.array([[0.85, 0.75, 0.5], [0.65, 0.1, 0.08], [0.8, 0.6, 0.2], [0.12, 0.35, 0.2], [0.1, 0.14, 0.35]])
    thread = np.where(over[..., None], colors[ornament], 0.1 + 0.6 * colors[ornament])
    return np.asarray(relief[..., None] * thread, np.float32)


def printed(columns: int, lines: int, seed: int) -> NDArray[np.float32]:
    """A page of text in a script of its own: letters of three by five dots, words and margins."""
    rng = np.random.default_rng(seed)
    ink = rng.random((lines, columns, 5, 3)) < 0.6
    ink[rng.random((lines, columns)) < 0.18] = False
    ink = np.pad(ink, ((0, 0), (0, 0), (1, 2), (0, 1))).transpose(0, 2, 1, 3).reshape(8 * lines, 4 * columns)
    # Two by two, as what lies between pixels is blended.
    dots = np.kron(np.pad(ink, 8), np.ones((2, 2)))[..., None]
    return np.asarray(dots * [0.06, 0.05, 0.08] + (1 - dots) * [0.85, 0.82, 0.74], np.float32)


def sky(sun: ArrayLike, height: int = 256) -> NDArray[np.float32]:
    """A picture of all directions, with y up and a sun of four degrees in the given one."""
    polar, azimuth = (np.mgrid[:height, : 2 * height] + 0.5) / height * np.pi
    up = np.cos(polar)[..., None]
    toward = np.dstack([np.sin(polar) * np.sin(azimuth), up, -np.sin(polar) * np.cos(azimuth)])
    near = (toward @ (np.asarray(sun) / np.linalg.norm(sun)))[..., None]
    haze = 1 - np.abs(up) ** np.where(up > 0, 0.5, 0.25)
    sky = [0.1, 0.22, 0.52] + haze * [0.5, 0.42, 0.16] + near.clip(0) ** 12 * [0.64, 0.54, 0.38]
    ground = [0.13, 0.16, 0.08] + haze * [0.35, 0.35, 0.45]
    picture = np.where(up > 0, sky, ground)
    picture[near[..., 0] > np.cos(np.radians(2))] = [1200, 1030, 730]
    return np.asarray(picture, np.float32)
