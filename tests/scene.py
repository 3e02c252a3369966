"""A tiny exact ray-caster: ground, box and spheres, one of which moves; and the frames a renderer makes of them."""

from dataclasses import dataclass

import numpy as np
import yester
from numpy.typing import ArrayLike, NDArray

GROUND, BOX, BALL, MOVER = 1, 2, 3, 4
LIGHT = np.array([0.4, 0.8, 0.45]) / np.linalg.norm([0.4, 0.8, 0.45])
ALBEDO = np.array([[0, 0, 0], [0.7, 0.6, 0.5], [0.2, 0.5, 0.8], [0.9, 0.3, 0.2], [0.3, 0.8, 0.3]])
MOVER_SPEED = np.array([0.12, 0.03, 0.06])


def look_at(
    origin: ArrayLike,
    target: ArrayLike,
    up: ArrayLike,
    fov: float,
    width: int,
    height: int,
    *,
    fov_axis: str = "x",
    principal_point: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """world_to_clip of a camera of square pixels, written out: the axes, the field of view, the shifted centre."""
    origin = np.asarray(origin, np.float64)
    forward = np.asarray(target, np.float64) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(up, np.float64))
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    px, py = principal_point or (width / 2, height / 2)
    focal = (width if fov_axis == "x" else height) / 2 / np.tan(np.radians(fov) / 2)  # pixels
    rotation = np.stack([right, above, forward])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = rotation, -rotation @ origin
    clip = np.array(
        [
            [2 * focal / width, 0, 2 * px / width - 1, 0],
            [0, 2 * focal / height, 1 - 2 * py / height, 0],
            [0, 0, 1, -0.1],
            [0, 0, 1, 0],
        ]
    )
    return clip @ view


def mover(frame: int) -> NDArray[np.float64]:
    """Object to world of the moving sphere: it travels and turns."""
    angle = 0.1 * frame
    matrix = np.eye(4)
    matrix[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    matrix[:3, 3] = [-0.6, 0.45, 0.6] + frame * MOVER_SPEED
    return matrix


def camera(frame: int, width: int, height: int) -> yester.Camera:
    origin = [0.08 * frame, 1.5 + 0.02 * frame, 4.0 - 0.05 * frame]
    return yester.Camera(look_at(origin, [0.02 * frame, 0.5, 0], [0, 1, 0], 55, width, height), width, height)


@dataclass
class Shot:
    """What a camera sees exactly, and the light without noise."""

    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    ids: NDArray[np.uint32]
    position: NDArray[np.float32]
    albedo: NDArray[np.float32]
    irradiance: NDArray[np.float32]
    camera: yester.Camera

    @property
    def color(self) -> NDArray[np.float32]:
        return self.irradiance * self.albedo

    def buffers(self) -> dict:
        names = ("depth", "normal", "ids", "position", "albedo", "camera")
        return {name: getattr(self, name) for name in names}


def _sphere(origin, direction, centre, radius):
    b = direction @ (origin - centre)
    c = (origin - centre) @ (origin - centre) - radius**2
    root = b * b - c
    with np.errstate(invalid="ignore"):
        t = -b - np.sqrt(root)
    t = np.where((root > 0) & (t > 1e-6), t, np.inf)
    hit = origin + np.where(np.isfinite(t), t, 0)[..., None] * direction
    return t, (hit - centre) / radius


def _box(origin, direction, low, high):
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (low - origin) / direction, (high - origin) / direction
    near, far = np.minimum(near, far), np.maximum(near, far)
    axis = near.argmax(-1)
    enter = near.max(-1)
    t = np.where((enter < far.min(-1)) & (enter > 1e-6), enter, np.inf)
    return t, -np.eye(3)[axis] * np.sign(np.take_along_axis(direction, axis[..., None], -1))


def _ground(origin, direction):
    with np.errstate(divide="ignore"):
        t = np.where(direction[..., 1] < 0, -origin[1] / direction[..., 1], np.inf)
    t = np.where(t < 60, t, np.inf)
    return t, np.broadcast_to([0.0, 1.0, 0.0], direction.shape)


def centres(camera: yester.Camera) -> NDArray[np.float64]:
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([x, y], -1)


def rays(camera: yester.Camera, pixels: NDArray) -> tuple[NDArray, NDArray]:
    """Origin and unit directions from the matrix alone: the scene owes nothing to what it tests."""
    rows = np.asarray(camera.world_to_clip)[[0, 1, 3]]
    x, y = np.moveaxis(pixels, -1, 0)
    clip = np.stack([2 * x / camera.width - 1, 1 - 2 * y / camera.height, np.ones_like(x)], -1)
    direction = clip @ np.linalg.inv(rows[:, :3]).T
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return -np.linalg.solve(rows[:, :3], rows[:, 3]), direction


def cast(frame: int, camera: yester.Camera, pixels: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Position (NaN where nothing is hit), normal and id of what lies behind any pixels (..., 2)."""
    origin, direction = rays(camera, pixels)
    hits = [
        _ground(origin, direction),
        _box(origin, direction, np.array([-1.6, 0, -1.2]), np.array([-0.6, 1.1, -0.3])),
        _sphere(origin, direction, np.array([0.9, 0.6, -0.4]), 0.6),
        _sphere(origin, direction, mover(frame)[:3, 3], 0.4),
    ]
    t = np.stack([hit[0] for hit in hits])
    nearest = t.argmin(0)
    t = t.min(0)
    hit = np.isfinite(t)
    normal = np.take_along_axis(np.stack([hit[1] for hit in hits]), nearest[None, ..., None], 0)[0]
    position = origin + np.where(hit, t, np.nan)[..., None] * direction
    return position, np.where(hit[..., None], normal, 0), np.where(hit, nearest + 1, 0).astype(np.uint32)


def shoot(frame: int, width: int, height: int, *, moving: bool = True) -> Shot:
    """Frame number `frame`, of the camera's flight and the sphere's, or both stopped at the start."""
    frame = frame if moving else 0
    view = camera(frame, width, height)
    position, normal, ids = cast(frame, view, centres(view))
    hit = ids > 0
    row = np.asarray(view.world_to_clip)[3] / np.linalg.norm(view.world_to_clip[3, :3])
    depth = position @ row[:3] + row[3]
    shade = np.where(hit, 0.3 + np.clip(normal @ LIGHT, 0, None), 0)
    return Shot(
        depth=np.where(hit, depth, np.inf).astype(np.float32),
        normal=normal.astype(np.float32),
        ids=ids,
        position=position.astype(np.float32),
        albedo=ALBEDO[ids].astype(np.float32),
        irradiance=shade[..., None].repeat(3, -1).astype(np.float32),
        camera=view,
    )


def noisy(shot: Shot, rng: np.random.Generator) -> NDArray[np.float32]:
    """The colour one sample a pixel would give: exponential noise of mean one on the irradiance."""
    noise = rng.exponential(1, shot.depth.shape).astype(np.float32)
    return shot.color * noise[..., None]


def transforms(frame: int) -> dict[int, NDArray[np.float64]]:
    """Where the moving sphere's points were one frame ago."""
    return {MOVER: mover(frame - 1) @ np.linalg.inv(mover(frame))}
