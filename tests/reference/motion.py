import numpy as np
import torch
from torch import Tensor

from .projection import pixel_centres, project, project_direction, rays, unproject


def motion_vectors(geometry: Tensor, camera, previous_camera, *, ids=None, transforms=None) -> Tensor:
    """Previous minus current position of each pixel's surface: x, y in pixels, z in view-space depth.

    motion.xy = project(previous, T·X) - project(current, X), motion.z = depth_previous(T·X) - depth_current(X).
    Background lies at infinity, where only rotation moves it. Source: NRD's "2.5-D" motion.

    Parameters
    ----------
    geometry : (H, W) depth, or (H, W, 3) world position
    ids : (H, W) integers
    transforms : {id: (4, 4)} previous · inverse(current)

    Returns
    -------
    (H, W, 3)
    """
    height, width = geometry.shape[:2]
    centres = pixel_centres(height, width, geometry)  # (H, W, 2)
    if geometry.ndim == 2:
        background = (geometry == torch.inf) | (geometry <= 0)  # (H, W)
        points = unproject(camera, centres, geometry.where(~background, 1))  # (H, W, 3)
    else:
        background = ~geometry.isfinite().all(-1)  # (H, W)
        points = geometry.where(~background[..., None], 0)  # (H, W, 3)
    now, depth = project(camera, points)  # (H, W, 2), (H, W)
    if geometry.ndim == 2:
        depth = geometry  # (H, W): as given, or a depth of zero would depend on rounding

    moved = points  # (H, W, 3)
    for name, matrix in (transforms or {}).items():
        m = torch.as_tensor(np.asarray(matrix, np.float64)).to(points)  # (4, 4)
        moved = torch.where((ids == name)[..., None], points @ m[:3, :3].T + m[:3, 3], moved)  # (H, W, 3)
    before, previous_depth = project(previous_camera, moved)  # (H, W, 2), (H, W)
    motion = torch.cat([before - now, (previous_depth - depth)[..., None]], -1)  # (H, W, 3)
    motion = motion.where(((depth > 0) & (previous_depth > 0))[..., None], torch.nan)  # (H, W, 3)

    _, directions = rays(camera, centres)  # (H, W, 3)
    before, ahead = project_direction(previous_camera, directions)  # (H, W, 2), (H, W)
    now, _ = project_direction(camera, directions)  # (H, W, 2)
    far = torch.cat([before - now, torch.zeros_like(ahead)[..., None]], -1)  # (H, W, 3)
    far = far.where((ahead > 0)[..., None], torch.nan)  # (H, W, 3)
    return torch.where(background[..., None], far, motion)  # (H, W, 3)
