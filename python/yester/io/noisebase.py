"""Noisebase stores: sequences of path-traced samples in Zarr zip files.

A training store holds one sequence, with the frame as first axis of every array; of test sequences each frame has a
store of its own, without that axis. The other axes are channel, row, column and sample. Colour is coded in 8 bits with
a shared exponent, geometry is in world space, and matrices are for row vectors, as DirectX has them.

References
----------
Bálint et al. 2023, *Neural Partitioning Pyramids for Denoising Monte Carlo Renderings*, and the documentation of the
package noisebase, "Sample Training Format v1" and "Sample Test Format v1".
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from .._core import Camera, motion_vectors
from ..frame import Frame

__all__ = ["Layout", "decode_color", "layout", "read_noisebase"]

_ARRAYS = ("color", "exposure", "position", "motion", "normal", "diffuse", "view_proj_mat", "crop_offset")
#: Largest distance in pixels between where a sample lies and where its position projects to: the median over an image.
_CLOSE = 1.0


@dataclass(frozen=True)
class Layout:
    """What a store holds, from its metadata.

    Attributes
    ----------
    frames, height, width, samples : int
        Frames in the store, size of an image in pixels, samples per pixel.
    reference : bool
        Whether there are images without noise.
    single : bool
        Whether the arrays lack the axis of frames.
    """

    frames: int
    height: int
    width: int
    samples: int
    reference: bool
    single: bool


def decode_color(color: NDArray[np.uint8], exposure: NDArray[np.float32]) -> NDArray[np.float32]:
    """Decode colours with a shared exponent.

    Parameters
    ----------
    color : (4, ...) ndarray of uint8
        Red, green and blue, and the exponent.
    exposure : (2,) ndarray of float
        Natural logarithms of the least and the largest radiance of the frame.

    Returns
    -------
    (3, ...) ndarray of float32
        rgb / 255 · exp(low + (e + 1) / 256 · (high - low)).
    """
    low, high = np.asarray(exposure, np.float32)
    # There are only 256 exponents.
    scales = np.exp(low + np.arange(1, 257, dtype=np.float32) / 256 * (high - low)) / np.float32(255)
    return np.asarray(color[:3] * scales[color[3]][None], np.float32)


def layout(path: str | os.PathLike[str]) -> Layout:
    """Look at a store's metadata.

    Parameters
    ----------
    path : path-like
        A zip file.

    Returns
    -------
    Layout

    Raises
    ------
    FileNotFoundError
        If it is not there.
    ValueError
        If it is not a Noisebase store.
    ImportError
        If zarr is not installed.
    """
    with _opened(Path(path)) as store:
        return _layout(Path(path), store)


def read_noisebase(
    source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
) -> Iterator[tuple[Frame, NDArray[np.float32] | None]]:
    """Read the frames of a sequence one by one.

    Parameters
    ----------
    source : path-like or iterable of path-like
        A store of a sequence, or the stores of its frames in order.

    Yields
    ------
    frame : Frame
        `color` and `albedo` are means over the samples; `normal`, `position`, `depth` and `motion` are those of the
        first sample. A pixel whose normal is zero hit nothing. The camera is that of the stored image: windows of
        training stores move from frame to frame, which `motion` takes into account.
    reference : (H, W, 3) ndarray of float32, or None
        The image without noise.

    Raises
    ------
    FileNotFoundError
        If a store is not there.
    ValueError
        If one is damaged or lacks an array, or if positions and matrices do not fit the pixels.
    ImportError
        If zarr is not installed.

    Notes
    -----
    Stores lack the size of the image that their window was cut from. It is the one with which positions project to
    where their samples lie; where nothing was hit, that of the frames before, or else of the next in the same store.
    """
    paths = [Path(source)] if isinstance(source, str | os.PathLike) else [Path(path) for path in source]
    before: Camera | None = None
    sides: tuple[float, float] | None = None
    for path in paths:
        with _opened(path) as store:
            known = _layout(path, store)
            for index in range(known.frames):
                surface = _surface(store, known, index)
                sides = _sides(path, store, known, index, surface) or sides or _later_sides(path, store, known, index)
                frame, reference = _frame(store, known, index, surface, before, sides)
                before = frame.camera
                yield frame, reference


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The group in a zip file; whatever goes wrong with it names the file."""
    try:
        import zarr
    except ImportError as error:
        raise ImportError("Noisebase stores need zarr: pip install 'yester[data]'") from error
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        store = zarr.storage.ZipStore(path, mode="r")
        group = zarr.open_group(store, mode="r")  # a store that cannot be opened cannot be closed, either
        try:
            yield group
        finally:
            store.close()
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    except (BadZipFile, KeyError, RuntimeError, EOFError) as error:
        raise ValueError(f"{path}: truncated or corrupt: {error}") from None


def _layout(path: Path, store: Any) -> Layout:
    absent = [name for name in _ARRAYS if name not in store]
    if absent:
        raise ValueError(f"{path}: not a Noisebase store: expected arrays {', '.join(_ARRAYS)}; {absent[0]} is missing")
    shape = store["color"].shape
    if len(shape) not in (4, 5) or shape[-4] != 4:
        raise ValueError(f"{path}: color: expected shape (F, 4, H, W, S) or (4, H, W, S), got {shape}")
    *frames, _, height, width, samples = shape
    return Layout(frames[0] if frames else 1, height, width, samples, "reference" in store, not frames)


def _of(store: Any, known: Layout, index: int, name: str, *samples: slice | int) -> NDArray[Any]:
    """An array of a frame."""
    return np.asarray(store[name][(*(() if known.single else (index,)), ..., *samples)])


def _image(values: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.moveaxis(values, 0, -1), np.float32)


#: Normals and positions of a frame, and which pixels hit something.
_Surface: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]


def _surface(store: Any, known: Layout, index: int) -> _Surface:
    normal, position = (_image(_of(store, known, index, name, 0)) for name in ("normal", "position"))
    return normal, position, np.asarray(normal.any(-1) & np.isfinite(position).all(-1))


def _frame(
    store: Any, known: Layout, index: int, surface: _Surface, before: Camera | None, sides: tuple[float, float]
) -> tuple[Frame, NDArray[np.float32] | None]:
    of = partial(_of, store, known, index)
    color = _image(decode_color(of("color"), of("exposure")).mean(-1))
    albedo = _image(of("diffuse").astype(np.float32).mean(-1))
    normal, position, hit = surface
    moved = _image(of("motion", 0))
    camera = _camera(of("view_proj_mat"), of("crop_offset"), known, sides)
    position[~hit] = np.nan
    pixels, depth = camera.project(position)
    motion = np.zeros((known.height, known.width, 3))
    if before is not None:
        former, former_depth = before.project(position + moved)
        motion[..., :2], motion[..., 2] = former - pixels, former_depth - depth
        motion[~hit] = motion_vectors(np.full(hit.shape, np.inf, np.float32), camera, before)[~hit]
    frame = Frame(
        color,
        albedo=albedo,
        normal=normal,
        depth=np.where(hit, depth, np.inf),
        motion=motion,
        position=position,
        camera=camera,
    )
    reference = _image(of("reference")) if known.reference else None
    return frame, reference


def _later_sides(path: Path, store: Any, known: Layout, index: int) -> tuple[float, float]:
    """`_sides` of the next frame that hit something."""
    for later in range(index + 1, known.frames):
        if sides := _sides(path, store, known, later, _surface(store, known, later)):
            return sides
    raise ValueError(f"{path}: position: nothing was hit, which leaves the size of the whole image unknown")


def _sides(path: Path, store: Any, known: Layout, index: int, surface: _Surface) -> tuple[float, float] | None:
    """Width and height of the image that a frame was cut from; None if nothing was hit."""
    _, position, hit = surface
    if not hit.any():
        return None
    to_clip = np.asarray(_of(store, known, index, "view_proj_mat"), np.float64).T  # for column vectors
    top, left = (int(value) for value in _of(store, known, index, "crop_offset"))
    points = position[hit].astype(np.float64)
    rows, columns = np.stack(np.nonzero(hit)) + 0.5
    clip = np.concatenate([points, np.ones_like(points[:, :1])], 1) @ to_clip.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (clip[:, :2] / clip[:, 3:]).T
    # A place in the whole image is its side times these.
    whole = []
    for place, share in ((columns + left, (x + 1) / 2), (rows + top, (1 - y) / 2)):
        side = np.rint(place @ share / max(share @ share, 1e-30))
        off = np.median(np.abs(side * share - place))
        if not off <= _CLOSE:
            raise ValueError(f"{path}: view_proj_mat: positions project {off:.1f} pixels from where their samples lie")
        whole.append(float(side))
    return whole[0], whole[1]


def _camera(matrix: NDArray[Any], offset: NDArray[Any], known: Layout, sides: tuple[float, float]) -> Camera:
    """The camera of the stored window."""
    to_clip = np.asarray(matrix, np.float64).T  # for column vectors
    top, left = (int(value) for value in offset)
    across, down = sides[0] / known.width, sides[1] / known.height
    crop = np.diag([across, down, 1, 1])
    crop[0, 3] = across - 2 * left / known.width - 1
    crop[1, 3] = 1 - down + 2 * top / known.height
    return Camera(crop @ to_clip, known.width, known.height)
