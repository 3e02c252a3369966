"""Conversion of stored channels to the canonical form of a frame's buffers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import Camera
from .channels import Form, Found, Recognised

#: The id of pixels in which a renderer has averaged the ids of several objects, and of objects without an id among
#: others that have one: those match each other only.
MIXED = 2**32 - 1
#: Depths from here on are those of nothing: Blender Cycles has 1e10 for a miss, 1e11 where nothing was rendered.
_FAR = 1e9
#: Pixels by which positions tell their space and the layout of matrices.
_PROBES = 4096
#: Share of the larger side by which positions may miss the camera's pixels.
_OFF = 0.02

Array = NDArray[Any]
#: A camera, and the matrix from world to camera space.
View = tuple[Camera, NDArray[np.float64]]


@np.errstate(over="ignore", invalid="ignore")  # of damaged or extreme values, which become infinite or stay NaN
def canonical(
    known: Recognised,
    pixels: Callable[[str], Array],
    views: list[View],
    display: tuple[float, float],
    to_camera: NDArray[np.float64] | None = None,
) -> tuple[dict[str, Array], Camera | None]:
    """The buffers of a file in canonical form.

    Parameters
    ----------
    known : Recognised
    pixels : callable
        Reads a channel, (H, W).
    views : list of (Camera, (4, 4) ndarray)
        The cameras that the header may mean, the likeliest one first.
    display : (float, float)
        Width and height of the display window in pixels, to which motion in other units refers.
    to_camera : (4, 4) ndarray, optional
        From world to camera space, as pbrt stores it: tells the depth of positions where no camera does.

    Returns
    -------
    (dict of str to ndarray, Camera or None)
        The buffers and the camera. Depth from positions is left out where nothing tells their space.
    """
    buffers: dict[str, Array] = {}
    for name, found in known.buffers.items():
        planes = [pixels(channel) for channel in found.channels]
        if found.form.cryptomatte:
            buffers[name] = _cryptomatte(planes)
            continue
        value = np.stack(planes, -1)
        if found.plus:
            value = value + np.stack([pixels(channel) for channel in found.plus], -1)
        buffers[name] = _scaled(value, found.form, name, display)
    for name in {"depth", "ids", "hit_distance", "reactive"} & buffers.keys():
        buffers[name] = buffers[name].reshape(buffers[name].shape[:2])
    forms = {name: found.form for name, found in known.buffers.items()}
    if "ids" in buffers:
        buffers["ids"] = _whole(buffers["ids"])
        if forms["ids"].index and not buffers["ids"].any():
            del buffers["ids"]
    view, space = _view(buffers.get("position"), forms.get("position"), views)
    _to_world(buffers, forms, view, space)
    if "depth" in buffers and (depth := _depth(buffers, forms, view, to_camera)) is not None:
        buffers["depth"] = depth
    else:
        buffers.pop("depth", None)
    if known.renderer:
        _mark_misses(buffers, forms)
    if known.averaged and "normal" in buffers:
        buffers["normal"] = _unit(buffers["normal"])
    if known.renderer and "emission" in buffers:
        # At the edges of lights, the pass may have other samples than the colour has.
        buffers["emission"] = np.fmin(buffers["emission"], buffers["color"])
    return buffers, view[0] if view else None


def notes(known: Recognised, *, camera: bool) -> dict[str, str]:
    """What is converted, by buffer, as far as a header tells it."""
    told = {}
    for name, found in known.buffers.items():
        parts = [found.note, *_conversions(name, found, known, camera=camera)]
        if text := "; ".join(part for part in parts if part):
            told[name] = text
    return told


def _conversions(name: str, found: Found, known: Recognised, *, camera: bool) -> list[str]:
    form, told = found.form, []
    if found.mapped:
        told.append("as mapped")
    if name.startswith("motion"):
        if form.unit != "pixels":
            told.append(
                {"uv": "fractions of the image", "ndc": "-1 to 1 over the image"}[form.unit] + ": turned to pixels"
            )
        if form.scale and not found.note:
            told.append(f"multiplied by {', '.join(f'{one:g}' for one in form.scale)}")
    if name in ("normal", "position"):
        if form.space == "either":
            need = "" if camera else ", but kept as it is, for want of a camera in the header"
            told.append(f"in camera or world space, by which of them puts positions on the screen{need}")
        elif form.space == "camera":
            how = "turned to world space" if camera else "kept in camera space, for want of a camera in the header"
            told.append(f"in camera space: {how}")
    if name == "depth" and form.kind == "distance":
        how = "distance along the ray" + ("" if form.near else " from the near plane")
        if not camera:
            told.append(f"{how}: kept as it is, for want of a camera in the header")
        elif "position" in known.buffers:
            told.append(f"{how}: replaced by that along the camera axis, from positions")
        else:
            told.append(
                f"{how}: converted along the camera axis" + ("" if form.near else ", but for the near plane's distance")
            )
    elif name == "depth" and form.near:
        told.append(f"from the near plane: {form.near:g} added")
    elif name == "depth" and form.space == "either":
        told.append("from positions")
    if name == "depth" and form.miss == "far":
        told.append("1e9 and beyond: nothing was hit")
    if form.cryptomatte:
        told.append("the id that covers most of a pixel")
    if form.index:
        told.append("numbers that users set: not used where all are 0")
    if found.plus:
        told.append(f"and {' '.join(found.plus)} added")
    return told


def multipliers(name: str, form: Form, count: int, display: tuple[float, float]) -> NDArray[np.float32]:
    """What the components of a buffer are multiplied by; `display` as for `canonical`."""
    factors = np.ones(count, np.float32)
    factors[: len(form.scale)] = form.scale[:count]
    if name.startswith("motion") and form.unit != "pixels":
        factors[:2] *= np.asarray(display, np.float32) / (1 if form.unit == "uv" else 2)
    return factors


def _scaled(value: Array, form: Form, name: str, display: tuple[float, float]) -> Array:
    factors = multipliers(name, form, value.shape[-1], display)
    return value if (factors == 1).all() else (value * factors).astype(np.float32)


def _cryptomatte(planes: list[Array]) -> NDArray[np.uint32]:
    """The id that covers most of each pixel; 0 where nothing covers more."""
    best, total = np.zeros((2, *planes[0].shape), np.float32)
    chosen = np.zeros(best.shape, np.uint32)
    for number, share in zip(planes[0::2], planes[1::2], strict=True):
        coverage = np.fmax(share, np.float32(0))  # NaN covers nothing
        more = coverage > best
        chosen[more] = np.ascontiguousarray(number, np.float32).view(np.uint32)[more]
        best[more] = coverage[more]
        total += coverage
    chosen[1 - total > best] = 0
    return chosen


def _whole(ids: Array) -> Array:
    """Convert ids from any stored type."""
    if ids.dtype.kind == "u":
        return ids
    ids = ids.astype(np.float64)
    whole = (ids == np.rint(ids)) & (ids >= 0) & (ids <= MIXED)
    return np.where(whole, ids, MIXED).astype(np.uint32)


def _view(position: Array | None, form: Form | None, views: list[View]) -> tuple[View | None, str]:
    """The camera, and the space of what may be in either: those that put positions where they are on the screen.

    No camera if none does: positions in half floats are a pixel or two off, those of another camera a good part of the
    image.
    """
    likeliest = views[0] if views else None
    if position is None or form is None or not views:
        return likeliest, "camera"
    points, pixels = _probes(position)
    if not len(points):
        return likeliest, "camera"

    def error(choice: tuple[View, str]) -> float:
        (camera, to_camera), space = choice
        world = points if space == "world" else _transformed(points, np.linalg.inv(to_camera))
        offset = np.abs(camera.project(world.astype(np.float32))[0] - pixels).max(-1)
        return float(np.median(np.where(np.isfinite(offset), offset, np.inf)))

    spaces = ("camera", "world") if form.space == "either" else (form.space,)
    best = min(((view, space) for view in views for space in spaces), key=error)
    return best if error(best) < max(2.0, _OFF * max(position.shape)) else (None, "camera")


def _probes(position: Array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Some positions, and their pixels."""
    every = position.reshape(-1, 3)
    step = max(len(every) // (16 * _PROBES), 1)  # tests of all pixels would take longer than to read them
    some = every[::step]
    hit = step * np.flatnonzero(np.isfinite(some).all(-1) & (some != 0).any(-1))
    hit = hit[:: max(len(hit) // _PROBES, 1)]
    points = every[hit].astype(np.float64)
    return points, np.stack([hit % position.shape[1], hit // position.shape[1]], -1) + 0.5


def _to_world(buffers: dict[str, Array], forms: Mapping[str, Form], view: View | None, space: str) -> None:
    """Turn normals and positions from camera to world space."""
    if view is None:
        return
    _, to_camera = view
    for name in ("normal", "position"):
        if name not in buffers or (space if forms[name].space == "either" else forms[name].space) != "camera":
            continue
        if name == "normal":  # which the inverse transpose has turned to camera space
            buffers[name] = _unit((buffers[name].astype(np.float64) @ to_camera[:3, :3]).astype(np.float32))
        else:
            miss = (buffers[name] == 0).all(-1, keepdims=True)
            world = _transformed(buffers[name].astype(np.float64), np.linalg.inv(to_camera))
            buffers[name] = np.where(miss, 0, world).astype(np.float32)


def _depth(
    buffers: dict[str, Array], forms: Mapping[str, Form], view: View | None, to_camera: NDArray[np.float64] | None
) -> Array | None:
    """Depth along the camera axis, +inf where nothing was hit; None if nothing tells the space of positions."""
    depth: Array = buffers["depth"].astype(np.float32, copy=False)
    form = forms["depth"]
    far = ~(depth < _FAR)
    miss = {"zero": far | (depth == 0), "far": far, "inf": np.zeros_like(depth, bool)}[form.miss]
    position = buffers.get("position")
    if form.space == "either" and position is not None:
        miss = (position == 0).all(-1)
        ahead = view[0].project(position)[1] if view else _z(position, miss, to_camera)
        if ahead is None:
            return None
        depth = ahead
    elif view is not None and position is not None and form.kind == "distance" and not form.near:
        depth = view[0].project(position)[1]
    elif view is not None and form.kind == "distance":
        depth = depth * (view[0].rays()[1] @ view[0].forward) + np.float32(form.near)
    elif form.kind == "z" and form.near:
        depth = depth + np.float32(form.near)
    return (
        np.where(miss, np.float32(np.inf), depth).astype(np.float32, copy=False)
        if miss.any() or form != Form()
        else depth
    )


def _z(position: Array, miss: NDArray[np.bool_], to_camera: NDArray[np.float64] | None) -> Array | None:
    """Depth of positions in camera or world space: that of the space whose pixels are most like those of a pinhole.

    None if some positions lie behind the camera in either space.
    """
    points, pixels = _probes(position)

    def bend(matrix: NDArray[np.float64]) -> float:
        """How far pixels are from an affine function of their rays' slopes."""
        inside = _transformed(points, matrix)
        if not (inside[:, 2] > 0).all() or not np.isfinite(inside).all():
            return np.inf
        slopes = inside / inside[:, 2:]
        return float(np.abs(slopes @ np.linalg.lstsq(slopes, pixels)[0] - pixels).sum())

    for matrix in sorted([np.eye(4), *([] if to_camera is None else [to_camera])], key=bend):
        depth = position @ matrix[2, :3] + matrix[2, 3]
        if not (depth[~miss] <= 0).any():
            return np.asarray(depth, np.float32)
    return None


def _mark_misses(buffers: dict[str, Array], forms: Mapping[str, Form]) -> None:
    """Pixels in which nothing was hit, by depth, else positions, else ids: they have neither position nor albedo."""
    position = buffers.get("position")
    if "depth" in buffers and forms["depth"].miss != "inf":
        miss = np.isinf(buffers["depth"])
    elif position is not None:
        miss = (position == 0).all(-1)
    elif "ids" in buffers and not forms["ids"].index:
        miss = buffers["ids"] == 0
    else:
        return
    if "ids" in buffers and forms["ids"].index:
        # Objects without a number are not the background.
        buffers["ids"] = np.where(~miss & (buffers["ids"] == 0), np.uint32(MIXED), buffers["ids"])
    if position is not None:
        buffers["position"] = np.where(miss[..., None], np.float32(np.nan), position)
    if "albedo" in buffers and "normal" in buffers:
        # Depth may be that of one sample where albedo is the mean of several: normals tell whether any has hit.
        nothing = miss & (buffers["normal"] == 0).all(-1)
        buffers["albedo"] = np.where(nothing[..., None], 0, buffers["albedo"])


def _transformed(points: NDArray[np.float64], matrix: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3], np.float64)


def _unit(normal: Array) -> NDArray[np.float32]:
    """Normals of unit length; zeros stay zeros."""
    normal = normal.astype(np.float32, copy=False)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    uneven = (np.abs(length - 1) > 1e-3) & (length > 0)
    unit = normal.copy()
    np.divide(normal, length, out=unit, where=uneven)
    return unit
