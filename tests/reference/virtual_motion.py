import torch
from torch import Tensor

from .projection import pixel_centres, project, project_direction, rays


def virtual_motion(geometry: Tensor, hit_distance: Tensor, camera, previous_camera) -> Tensor:
    """Previous minus current position of each pixel's mirror image, for plane mirrors in a static scene.

    The virtual image lies behind the surface X by the length of the reflected ray: at X + v·hit_distance, with v the
    unit vector from the camera to X. Source: virtual motion of NRD's ReBLUR and RELAX.

    Parameters
    ----------
    geometry : (H, W) depth, or (H, W, 3) world position
    hit_distance : (H, W), infinite where the sky is reflected

    Returns
    -------
    (H, W, 2)
    """
    height, width = geometry.shape[:2]
    centres = pixel_centres(height, width, geometry)  # (H, W, 2)
    origin, directions = rays(camera, centres)  # (3,), (H, W, 3)
    if geometry.ndim == 2:
        background, seen = (geometry == torch.inf) | (geometry <= 0), geometry > 0  # (H, W), (H, W)
        points = origin + geometry.where(~background, 1)[..., None] * directions  # (H, W, 3)
        now = centres  # (H, W, 2)
    else:
        background = ~geometry.isfinite().all(-1)  # (H, W)
        points = torch.where(background[..., None], origin + directions, geometry)  # (H, W, 3)
        now, depth = project(camera, points)  # (H, W, 2), (H, W)
        seen = depth > 0  # (H, W)

    view = (points - origin) / (points - origin).norm(dim=-1, keepdim=True)  # (H, W, 3)
    distant = background | (hit_distance == torch.inf)  # (H, W): background reflects nothing, at any hit distance
    near, near_depth = project(previous_camera, points + view * hit_distance[..., None])  # (H, W, 2), (H, W)
    far, far_depth = project_direction(previous_camera, view)  # (H, W, 2), (H, W)
    before = torch.where(distant[..., None], far, near)  # (H, W, 2)
    valid = (background | (seen & (hit_distance >= 0))) & (torch.where(distant, far_depth, near_depth) > 0)  # (H, W)
    return (before - now).where(valid[..., None], torch.nan)  # (H, W, 2)
