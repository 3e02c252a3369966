"""Writes the images of a sequence: to a Zarr store or to EXR files."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..io.channels import CANONICAL
from ..io.exr import HALF_MAX, held_within_half
from .buffers import CHANNELS, Images

__all__ = ["EXRFiles", "Writer", "ZarrStore", "checksums", "stored"]

#: All but colours, normals and validity: float16 is too coarse for distances, and lacks the range of moments.
_WHOLE = {"depth", "motion", "ids", "position", "hit_distance", "reactive", "variance", "history_length"}


def stored(name: str, half: bool) -> np.dtype[Any]:
    """The type in which an image is stored."""
    if name == "ids":
        return np.dtype(np.uint32)
    return np.dtype(np.float16 if half and name not in _WHOLE else np.float32)


class Writer(Protocol):
    """Writes one sequence into a folder."""

    def __init__(self, folder: Path, frames: int, half: bool) -> None: ...

    def write(self, index: int, group: str, images: Mapping[str, NDArray[Any]]) -> None:
        """Write the images of one frame to a group: a crop and a size, or neither."""


class ZarrStore:
    """A Zarr store ``data.zarr``: an array (F, C, H, W) for each image, a chunk for each frame."""

    def __init__(self, folder: Path, frames: int, half: bool) -> None:
        try:
            zarr = import_module("zarr")
        except ImportError as error:
            raise ImportError("Zarr stores need zarr: pip install 'yester[data]'") from error
        self._root: Any = zarr.create_group(folder / "data.zarr", zarr_format=3)
        self._arrays: dict[str, Any] = {}
        self._frames, self._half = frames, half

    def write(self, index: int, group: str, images: Mapping[str, NDArray[Any]]) -> None:
        for name, image in images.items():
            planes = np.moveaxis(np.atleast_3d(image), -1, 0)
            path = f"{group}/{name}" if group else name
            if path not in self._arrays:
                self._arrays[path] = self._root.create_array(
                    path,
                    shape=(self._frames, *planes.shape),
                    chunks=(1, *planes.shape),
                    dtype=stored(name, self._half),
                    # Otherwise every chunk would lie in four folders of its own.
                    chunk_key_encoding={"name": "default", "separator": "."},
                    dimension_names=("frame", "channel", "y", "x"),
                )
            self._arrays[path][index] = _typed(name, planes, self._half)


class EXRFiles:
    """Files ``frame_0000.exr`` and so on, in a folder for each group; each image is a layer."""

    def __init__(self, folder: Path, frames: int, half: bool) -> None:
        try:
            self._exr: Any = import_module("OpenEXR")
        except ImportError as error:
            raise ImportError("EXR files need the OpenEXR package: pip install 'yester[exr]'") from error
        self._folder, self._half = folder, half

    def write(self, index: int, group: str, images: Mapping[str, NDArray[Any]]) -> None:
        folder = self._folder / group
        folder.mkdir(parents=True, exist_ok=True)
        channels = {}
        for name, image in images.items():
            planes = np.moveaxis(np.atleast_3d(image), -1, 0)
            for channel, plane in zip(_layer(name), planes, strict=False):
                channels[channel] = np.ascontiguousarray(_typed(name, plane, self._half))
        header = {"compression": self._exr.ZIP_COMPRESSION, "type": self._exr.scanlineimage}
        path = folder / f"frame_{index:04}.exr"
        try:
            self._exr.File(header, channels).write(str(path))
        except (RuntimeError, TypeError, ValueError) as error:
            # OpenEXR does not tell the reason in a way that programs could read.
            raise OSError(errno.EIO, f"cannot be written: {error}", str(path)) from None


def _layer(name: str) -> tuple[str, ...]:
    """The channels of an image: those of a frame's buffer, or a layer of its name."""
    if name in CANONICAL:
        return CANONICAL[name]
    return tuple(f"{name}.{component}" for component in ("RGB" if CHANNELS[name] == 3 else "Y"))


def clipped(images: Images, half: bool) -> list[str]:
    """Which images have values that float16 does not hold."""
    beyond = [
        name
        for name, image in images.items()
        if stored(name, half) == np.float16 and (np.abs(image[np.isfinite(image)]) > HALF_MAX).any()
    ]
    return [f"{name}: values beyond ±{HALF_MAX:g} are stored as that, as 16 bits have no more" for name in beyond]


def _typed(name: str, values: NDArray[Any], half: bool) -> NDArray[Any]:
    kind = stored(name, half)
    if kind == np.float16:
        values = held_within_half(values)
    return values.astype(kind, copy=False)


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file in a folder, by its path there, in order."""
    found = {}
    for where, inner, names in os.walk(folder):
        inner.sort()
        for name in names:
            path = Path(where, name)
            with path.open("rb") as file:
                found[path.relative_to(folder).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return dict(sorted(found.items()))
