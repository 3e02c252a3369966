"""The pinhole camera: clip = M·(X, 1), pixel = ((x/w + 1)/2·W, (1 - y/w)/2·H), depth = w / |M[3, :3]|."""

import numpy as np
import torch
from torch import Tensor


def _matrix(camera, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Rows x, y, w of the matrix, as A (3, 3) and b (3,), scaled so that w is the depth; and the origin -A⁻¹b (3,)."""
    rows = np.asarray(camera.world_to_clip, dtype=np.float64)[[0, 1, 3]]  # (3, 4)
    rows = rows / np.linalg.norm(rows[2, :3])  # (3, 4)
    origin = -np.linalg.solve(rows[:, :3], rows[:, 3])  # (3,)
    a, b, o = (torch.as_tensor(m, dtype=like.dtype, device=like.device) for m in (rows[:, :3], rows[:, 3], origin))
    return a, b, o


def _to_pixels(camera, clip: Tensor) -> Tensor:
    x, y, w = clip.unbind(-1)  # each (...)
    return torch.stack([(x / w + 1) / 2 * camera.width, (1 - y / w) / 2 * camera.height], -1)  # (..., 2)


def project(camera, points: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (..., 2) and view-space depth (...) of world points (..., 3). Pixels behind the camera are undefined."""
    a, b, _ = _matrix(camera, points)  # (3, 3), (3,)
    clip = points @ a.T + b  # (..., 3)
    return _to_pixels(camera, clip), clip[..., 2]


def project_direction(camera, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Project points at infinity: directions (..., 3) to pixels (..., 2), and the sign (...) of their depth."""
    a, _, _ = _matrix(camera, directions)  # (3, 3)
    clip = directions @ a.T  # (..., 3)
    return _to_pixels(camera, clip), clip[..., 2]


def rays(camera, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """The camera's origin (3,) and, through pixels (..., 2), the directions (..., 3) whose depth is one."""
    a, _, origin = _matrix(camera, pixels)  # (3, 3), (3,)
    x, y = pixels.unbind(-1)  # each (...)
    clip = torch.stack([2 * x / camera.width - 1, 1 - 2 * y / camera.height, torch.ones_like(x)], -1)  # (..., 3)
    return origin, clip @ torch.linalg.inv(a).T  # (3,), (..., 3)


def unproject(camera, pixels: Tensor, depth: Tensor) -> Tensor:
    """World points (..., 3) at a view-space depth (...) behind pixels (..., 2)."""
    origin, direction = rays(camera, pixels)  # (3,), (..., 3)
    return origin + depth[..., None] * direction  # (..., 3)


def pixel_centres(height: int, width: int, like: Tensor) -> Tensor:
    """(H, W, 2) positions x, y of all pixel centres."""
    y = torch.arange(height, dtype=like.dtype, device=like.device) + 0.5  # (H,)
    x = torch.arange(width, dtype=like.dtype, device=like.device) + 0.5  # (W,)
    return torch.stack(torch.meshgrid(y, x, indexing="ij")[::-1], -1)  # (H, W, 2)
