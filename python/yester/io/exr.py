"""Multichannel EXR files: our own layers, and those that Mitsuba writes.

Cameras are kept in the standard attributes ``worldToCamera`` (to +X right, +Y up, +Z forward) and ``worldToNDC`` (to
[0, 1] over the display window, y down), both as Imath has them: for row vectors, in single precision. The jitter of a
frame's samples is in an attribute of ours, ``jitter``: two numbers, in pixels, x right, y down.
"""

from __future__ import annotations

import glob
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Camera
from ..frame import Frame
from . import layout
from .channels import CANONICAL, find, missing, signs
from .files import beside
from .stdout import kept_output

Source = str | os.PathLike[str]

_HALVED = {"color", "albedo", "normal", "emission", "object_normal", "replay"}
#: Attributes of the storage layout, which is not preserved.
_STORAGE = {"channels", "chunkCount", "compression", "lineOrder", "tiles", "type", "version"}
_HALF_MAX = float(np.finfo(np.float16).max)
#: The id of pixels in which a renderer has averaged the ids of several objects: those match each other only.
_MIXED = 2**32 - 1
#: worldToNDC to world_to_clip: [0, 1] to [-1, 1], and y up.
_NDC_TO_CLIP = np.array([[2.0, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Description:
    """Description of an EXR file, from its header.

    Parameters
    ----------
    path : Path
        The file.
    width, height : int
        Size of the data window in pixels.
    channels : dict of str to tuple of str
        The buffers of a `Frame` that were recognised, and the channels that they are made of.
    unrecognised : tuple of str
        The other channels.
    camera : Camera or None
        From the attributes ``worldToCamera`` and ``worldToNDC``.
    jitter : (float, float) or None
        From the attribute ``jitter``.
    missing : dict of str to str
        The buffers (and ``"camera"``) that the file lacks, with the consequences; rarely written buffers are left out.
    notes : dict of str to str
        Remarks on buffers in the file.

    See Also
    --------
    describe : Describes a file.
    """

    path: Path
    width: int
    height: int
    channels: dict[str, tuple[str, ...]]
    unrecognised: tuple[str, ...]
    camera: Camera | None
    jitter: tuple[float, float] | None
    missing: dict[str, str]
    notes: dict[str, str]


@dataclass(frozen=True)
class Plate:
    """A frame and all other contents of its file, which `write_exr` can preserve.

    Parameters
    ----------
    frame : Frame
        As `read_exr` gives it.
    parts : tuple of OpenEXR.Part
        All parts of the file in their order, whatever their windows.
    main : OpenEXR.Part
        The one that has the colour.

    See Also
    --------
    read_plate : Reads a plate.
    write_exr : Writes a frame into a copy of a plate.
    """

    frame: Frame
    parts: tuple[Any, ...]
    main: Any


def read_exr(path: Source) -> Frame:
    """Read one frame.

    Parameters
    ----------
    path : path-like
        An EXR file of float16, float32 or uint32 channels, with one part or several. Its data window is the image.

    Returns
    -------
    Frame
        Whatever is recognised, made canonical. The pass ``Vector`` of Blender Cycles becomes `motion` and
        `motion_next`. In files of Mitsuba, pixels where nothing was hit get depth +inf and position NaN, and depth is
        converted from a distance along the ray where the header has a camera (exactly if positions are there as well);
        without one it stays as it is.

    Raises
    ------
    OSError
        If the file cannot be opened; FileNotFoundError if it is not there.
    ValueError
        If it is not an EXR file, is truncated or corrupt, has no colour, or has an unusable camera or jitter.
    ImportError
        If the OpenEXR package is not installed.

    See Also
    --------
    read_sequence : Reads several frames.
    read_plate : Reads everything else in the file, too.
    describe : Tells what a file has without reading its pixels.
    write_exr : Writes a frame.

    Examples
    --------
    >>> from yester import io
    >>> io.write_exr("frame.exr", yester.Frame(np.ones((4, 6, 3)), depth=np.full((4, 6), 2.0)))
    >>> io.read_exr("frame.exr")
    Frame(6x4: color, depth)
    """
    return read_plate(path).frame


def read_plate(path: Source) -> Plate:
    """Read one frame with all other contents of its file.

    Parameters
    ----------
    path : path-like
        As for `read_exr`.

    Returns
    -------
    Plate
        The frame, and all parts of the file.

    Raises
    ------
    OSError, ValueError, ImportError
        As `read_exr`.

    See Also
    --------
    write_exr : Writes a frame with the other contents of a plate.

    Examples
    --------
    >>> from yester import io
    >>> io.write_exr("frame.exr", np.ones((4, 6, 3)))
    >>> plate = io.read_plate("frame.exr")
    >>> plate.frame, len(plate.parts)
    (Frame(6x4: color), 1)
    """
    path = Path(path)
    parts = _parts(path)
    main, planes = _merge(parts)
    header = main.header
    found = find(planes)
    if "color" not in found:
        raise ValueError(f"{path}: no colour: expected channels R, G and B, got {', '.join(planes) or 'none'}")
    camera, jitter = _camera(path, header), _jitter(path, header)
    try:
        buffers = {buffer: np.stack([planes[name].pixels for name in names], -1) for buffer, names in found.items()}
        for buffer in {"motion", "motion_next"} & buffers.keys():
            factors = signs(buffer, found[buffer])
            if min(factors) < 0:
                buffers[buffer] = buffers[buffer] * np.array(factors, np.float32)
        for buffer in {"depth", "ids", "hit_distance", "reactive"} & buffers.keys():
            buffers[buffer] = buffers[buffer][..., 0]
        if "ids" in buffers:
            buffers["ids"] = _whole(buffers["ids"])
        if _by_mitsuba(header, found):
            _mark_misses(buffers, camera, along_ray=_along_ray(found))
        frame = Frame(**buffers, camera=camera, jitter=jitter)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None
    return Plate(frame, tuple(parts), main)


def write_exr(path: Source, frame: Frame | ArrayLike, *, half: bool = False, like: Plate | None = None) -> None:
    """Write one frame, with camera and jitter in the header.

    The file appears when it is complete: it is written beside and then renamed.

    Parameters
    ----------
    path : path-like
        A file in an existing folder; overwritten if it exists.
    frame : Frame or (H, W, 3) array_like of float
        A frame, or just a colour.
    half : bool, default False
        Store colours (albedo, emission and replay among them) and normals as float16, clipped to its largest value,
        65504. The others always have 32 bits.
    like : Plate, optional
        Everything that `frame` lacks is copied from here, bit for bit and in its own type: channels (alpha, other
        layers), windows, the remaining attributes of the header, and all other parts. If `frame` has another size, the
        windows are scaled to it, and the other channels, the other parts and the jitter are left out. Pixels are stored
        as ZIP-compressed scanlines, whatever the source used.

    Raises
    ------
    OSError
        If the file cannot be written.
    ImportError
        If the OpenEXR package is not installed.

    See Also
    --------
    write_sequence : Writes several frames.
    read_plate : Reads what `like` takes.

    Examples
    --------
    >>> from yester import io
    >>> io.write_exr("noisy.exr", np.random.default_rng(0).gamma(1, 0.5, (32, 32, 3)))
    >>> plate = io.read_plate("noisy.exr")
    >>> io.write_exr("clean.exr", yester.SVGF().step(plate.frame).color, half=True, like=plate)
    """
    path = Path(path)
    frame = frame if isinstance(frame, Frame) else Frame(frame)
    exr = _openexr()
    header: dict[str, Any] = {} if like is None else _attributes(like.main)
    channels: dict[str, Any] = {}
    if like is not None and like.frame.shape == frame.shape:
        channels |= like.main.channels
    elif like is not None:
        header |= _scaled_windows(header, frame)
        header.pop("jitter", None)
    if frame.camera is not None:
        crop = _crop(header) if like is not None else np.eye(4)
        to_ndc = np.linalg.inv(_NDC_TO_CLIP @ crop) @ frame.camera.world_to_clip
        header["worldToCamera"] = frame.camera.world_to_camera.T.astype(np.float32)
        header["worldToNDC"] = to_ndc.T.astype(np.float32)
    if frame.jitter is not None:
        header["jitter"] = np.array(frame.jitter)
    for buffer, values in frame.buffers().items():
        array: NDArray[Any] = values
        if half and buffer in _HALVED:
            array = np.where(np.isfinite(array), np.clip(array, -_HALF_MAX, _HALF_MAX), array).astype(np.float16)
        for name, plane in zip(CANONICAL[buffer], np.moveaxis(np.atleast_3d(array), -1, 0), strict=False):
            channels[name] = np.ascontiguousarray(plane)
    main = exr.Part(header | _storage(exr), channels, header.get("name", ""))
    parts = [main]
    if like is not None and like.frame.shape == frame.shape:
        parts = [main if part is like.main else _copy(exr, part) for part in like.parts]
    with beside(path) as temporary:
        try:
            exr.File(parts).write(str(temporary))
        except (RuntimeError, TypeError, ValueError) as error:
            raise OSError(f"{path}: cannot be written: {error}") from None


def sequence_paths(source: Source | Iterable[Source]) -> list[Path]:
    """List the EXR files of a sequence.

    Parameters
    ----------
    source : path-like or iterable of path-like
        A folder (its ``*.exr``), a pattern such as ``shot/*.exr``, a file, or several of these in the order given.

    Returns
    -------
    list of Path
        Within a folder or pattern in natural order: ``frame2`` before ``frame10``.

    Raises
    ------
    FileNotFoundError
        If something named without a pattern is not there.
    ValueError
        If a folder or pattern has no EXR file.

    Examples
    --------
    >>> from yester import io
    >>> for number in (10, 2):
    ...     io.write_exr(f"frame{number}.exr", np.ones((4, 6, 3)))
    >>> [path.name for path in io.sequence_paths("frame*.exr")]
    ['frame2.exr', 'frame10.exr']
    """
    if not isinstance(source, str | os.PathLike):
        paths = [path for item in source for path in sequence_paths(item)]
        if not paths:
            raise ValueError("source: expected at least one EXR file, got an empty list")
        return paths
    path = Path(source)
    if path.is_dir():
        found = [item for item in path.iterdir() if item.suffix.lower() == ".exr"]
    elif path.exists():
        return [path]
    elif glob.has_magic(str(path)):
        found = [Path(item) for item in glob.glob(str(path), recursive=True)]
    else:
        raise FileNotFoundError(f"{path}: no such file or folder")
    if not found:
        raise ValueError(f"{path}: no EXR files found")
    return sorted(found, key=_natural)


def read_sequence(source: Source | Iterable[Source]) -> Iterator[Frame]:
    """Read the frames of a sequence one by one.

    Parameters
    ----------
    source : path-like or iterable of path-like
        As for `sequence_paths`, which is asked at once.

    Returns
    -------
    iterator of Frame
        Only one is in memory at a time.

    Raises
    ------
    ValueError
        As `sequence_paths` and `read_exr`; and when a frame of another size is met, naming its file.

    See Also
    --------
    yester.denoise : Denoises a sequence of frames.

    Examples
    --------
    >>> from yester import io
    >>> paths = io.write_sequence("noisy", np.ones((3, 4, 6, 3)))
    >>> [*io.read_sequence("noisy")]
    [Frame(6x4: color), Frame(6x4: color), Frame(6x4: color)]
    """
    paths = sequence_paths(source)

    def frames() -> Iterator[Frame]:
        size = None
        for path in paths:
            frame = read_exr(path)
            if size not in (None, frame.shape):
                raise ValueError(f"{path}: expected height and width {size} as in the frames before, got {frame.shape}")
            size = frame.shape
            yield frame

    return frames()


def write_sequence(
    folder: Source, frames: Iterable[Frame | ArrayLike], *, names: Sequence[str] | None = None, half: bool = False
) -> list[Path]:
    """Write frames one by one as they arrive.

    Parameters
    ----------
    folder : path-like
        Made if it does not exist.
    frames : iterable of Frame or (H, W, 3) array_like
        May be a generator: only one frame is in memory at a time.
    names : sequence of str, optional
        The file names, one per frame, each another; by default ``frame_0000.exr`` and so on.
    half : bool, default False
        As for `write_exr`.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OSError
        If the folder cannot be written to, before the first frame is asked for.
    ValueError
        If two names are equal, or their number is not that of the frames.

    Examples
    --------
    >>> from yester import io
    >>> paths = io.write_sequence("clean", np.ones((2, 4, 6, 3)), half=True)
    >>> [path.name for path in paths]
    ['frame_0000.exr', 'frame_0001.exr']
    """
    folder = Path(folder)
    if names is not None and len(set(names)) < len(names):
        raise ValueError(f"names: expected each only once, got {sorted({n for n in names if names.count(n) > 1})}")
    _openexr()
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()
    paths = []
    for index, frame in enumerate(frames):
        if names is not None and index == len(names):
            raise ValueError(f"names: expected one per frame, got {len(names)} for more frames")
        path = folder / (names[index] if names is not None else f"frame_{index:04}.exr")
        write_exr(path, frame, half=half)
        paths.append(path)
    if names is not None and len(paths) < len(names):
        raise ValueError(f"names: expected one per frame, got {len(names)} for {len(paths)} frames")
    return paths


def describe(path: Source) -> Description:
    """Describe an EXR file from its header: the buffers that it has and lacks.

    Parameters
    ----------
    path : path-like
        An EXR file.

    Returns
    -------
    Description
        Size, buffers, camera and jitter, and what the file lacks.

    Raises
    ------
    OSError, ValueError, ImportError
        As `read_exr`, except that pixels are not looked at and colour may be absent.

    Examples
    --------
    >>> from yester import io
    >>> io.write_exr("frame.exr", yester.Frame(np.ones((4, 6, 3)), depth=np.full((4, 6), 2.0)))
    >>> found = io.describe("frame.exr")
    >>> found.channels
    {'color': ('R', 'G', 'B'), 'depth': ('depth.Z',)}
    >>> found.missing["albedo"]
    'textures are filtered together with the light, and blur'
    """
    path = Path(path)
    main, planes = _merge(_parts(path, header_only=True))
    header = main.header
    found = find(planes)
    camera = _camera(path, header)
    known = {name for names in found.values() for name in names}
    notes = {
        buffer: "Vector pass of Blender Cycles: turned to y down"
        for buffer in ("motion", "motion_next")
        if min(signs(buffer, found.get(buffer, ())), default=1) < 0
    }
    if _along_ray(found):
        how = "along the ray from the near plane"
        if camera is None:
            notes["depth"] = f"distance {how}: kept as it is, for want of a camera in the header"
        elif "position" in found:
            notes["depth"] = f"distance {how}: replaced by that along the camera axis, from positions"
        else:
            notes["depth"] = f"distance {how}: converted along the camera axis, but for the near plane's distance"
    height, width = _size(header)
    return Description(
        path=path,
        width=width,
        height=height,
        channels=found,
        unrecognised=tuple(name for name in planes if name not in known),
        camera=camera,
        jitter=_jitter(path, header),
        missing=missing(found, camera=camera is not None),
        notes=notes,
    )


def _openexr() -> Any:
    try:
        return import_module("OpenEXR")
    except ImportError as error:
        raise ImportError("EXR files need the OpenEXR package: pip install 'yester[exr]'") from error


def _parts(path: Path, *, header_only: bool = False) -> list[Any]:
    """All parts of a file. OpenEXR skips a part that it cannot decode and only prints the reason."""
    layout.check(path)
    exr = _openexr()
    try:
        parts: list[Any] = exr.File(str(path), header_only=True).parts
        if not header_only:
            expected = len(parts)
            with kept_output() as said:
                parts = exr.File(str(path), separate_channels=True).parts
            if len(parts) < expected:
                raise ValueError(" ".join("".join(said).split()))
    except Exception as error:
        raise ValueError(f"{path}: truncated or corrupt: {' '.join(str(error).split())}") from None
    if not parts:
        raise ValueError(f"{path}: truncated or corrupt: no part")
    return parts


def _storage(exr: Any) -> dict[str, Any]:
    """The storage attributes of all written files."""
    return {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}


def _copy(exr: Any, part: Any) -> Any:
    return exr.Part(_attributes(part) | _storage(exr), dict(part.channels), part.name())


def _attributes(part: Any) -> dict[str, Any]:
    """The attributes of a part's header, without those of storage and empty lists, which OpenEXR cannot write."""
    return {name: value for name, value in part.header.items() if name not in _STORAGE and not _is_empty(value)}


def _is_empty(value: Any) -> bool:
    return isinstance(value, list) and not value


def _scaled_windows(header: dict[str, Any], frame: Frame) -> dict[str, Any]:
    """Both windows, scaled so that the data window has the size of a frame."""
    low, size = _window(header, "dataWindow")
    scale = np.array([frame.width, frame.height]) / size
    first = np.rint(low * scale)
    display, display_size = _window(header, "displayWindow")
    corners = {
        "dataWindow": (first, first + size * scale - 1),
        "displayWindow": (np.rint(display * scale), np.rint((display + display_size) * scale) - 1),
    }
    return {name: tuple(np.rint(corner).astype(np.int32) for corner in both) for name, both in corners.items()}


def _merge(parts: list[Any]) -> tuple[Any, dict[str, Any]]:
    """The first part with colour, and the channels of all parts that cover the same window."""
    coloured = (part for part in parts if "color" in find(channel.name for channel in part.header["channels"]))
    main = next(coloured, parts[0])
    planes: dict[str, Any] = {}
    for part in (main, *(part for part in parts if part is not main)):
        if np.array_equal(part.header["dataWindow"], main.header["dataWindow"]):
            # If only the header was read, part.channels is empty.
            for channel in part.channels.values() or part.header["channels"]:
                name = channel.name if channel.name not in planes else f"{part.name()}.{channel.name}"
                planes[name] = channel
    return main, planes


def _window(header: dict[str, Any], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corner and size of a window, (x, y)."""
    low, high = (np.asarray(corner, np.float64) for corner in header[name])
    return low, high - low + 1


def _size(header: dict[str, Any]) -> tuple[int, int]:
    width, height = _window(header, "dataWindow")[1]
    return int(height), int(width)


def _whole(ids: NDArray[Any]) -> NDArray[Any]:
    """Convert ids from any stored type."""
    if ids.dtype.kind == "u":
        return ids
    with np.errstate(invalid="ignore"):  # of signalling NaN
        ids = ids.astype(np.float64)
        whole = (ids == np.rint(ids)) & (ids >= 0) & (ids <= _MIXED)
    return np.where(whole, ids, _MIXED).astype(np.uint32)


def _along_ray(found: dict[str, tuple[str, ...]]) -> bool:
    return "depth" in found and found["depth"][0].endswith(".T")


def _by_mitsuba(header: dict[str, Any], found: dict[str, tuple[str, ...]]) -> bool:
    return str(header.get("generatedBy", "")).startswith("Mitsuba") or _along_ray(found)


def _mark_misses(buffers: dict[str, NDArray[Any]], camera: Camera | None, *, along_ray: bool) -> None:
    """Background pixels of a Mitsuba file, where all buffers are zero: by depth, else ids, else position."""
    depth, position = buffers.get("depth"), buffers.get("position")
    if along_ray and depth is not None:
        miss = depth == 0
        if camera is not None and position is not None:
            depth = camera.project(position)[1]
        elif camera is not None:
            depth = depth * (camera.rays()[1] @ camera.forward)
        buffers["depth"] = np.where(miss, np.inf, depth)
    elif "ids" in buffers:
        miss = buffers["ids"] == 0
    elif position is not None:
        miss = (position == 0).all(-1)
    else:
        return
    if position is not None:
        buffers["position"] = np.where(miss[..., None], np.nan, position)


def _camera(path: Path, header: dict[str, Any]) -> Camera | None:
    """The header's camera, unless it is orthographic."""
    if "worldToNDC" not in header:
        return None
    given = [header[name] for name in ("worldToNDC", "worldToCamera") if name in header]
    with np.errstate(invalid="ignore"):  # of signalling NaN
        stored = [np.asarray(matrix, np.float64) for matrix in given if isinstance(matrix, np.ndarray)]
    if len(stored) < len(given) or any(one.shape != (4, 4) or not np.isfinite(one).all() for one in stored):
        raise ValueError(f"{path}: worldToNDC, worldToCamera: expected finite (4, 4) matrices")
    if any(not row[:3].any() and row[3] for row in (stored[0][3], stored[0].T[3])):
        return None
    # Imath uses row vectors, but pbrt writes matrices for column vectors into the same attributes.
    to_ndc, *_ = min(([matrix.T for matrix in stored], stored), key=_implausibility)
    height, width = _size(header)
    try:
        return Camera(_NDC_TO_CLIP @ _crop(header) @ to_ndc, width, height)
    except ValueError as error:
        raise ValueError(f"{path}: worldToNDC: {error}") from None


def _crop(header: dict[str, Any]) -> NDArray[np.float64]:
    """The matrix from NDC of the display window to NDC of the data window, which is the image."""
    (display, display_size), (data, data_size) = _window(header, "displayWindow"), _window(header, "dataWindow")
    crop = np.eye(4)
    crop[[0, 1], [0, 1]], crop[:2, 3] = display_size / data_size, (display - data) / data_size
    return crop


def _jitter(path: Path, header: dict[str, Any]) -> tuple[float, float] | None:
    """The header's jitter."""
    if "jitter" not in header:
        return None
    given = np.asarray(header["jitter"])
    if given.dtype.kind not in "fiu" or given.shape != (2,) or not (np.abs(given) <= 0.5).all():
        raise ValueError(f"{path}: jitter: expected two offsets from -0.5 to 0.5, got {header['jitter']!r}")
    return float(given[0]), float(given[1])


def _implausibility(matrices: list[NDArray[np.float64]]) -> float:
    """How far matrices for column vectors, worldToNDC and maybe worldToCamera, are from those of one camera.

    The homogeneous coordinate of one is the depth of the other, and the middle of the view is on the screen.
    """
    to_ndc, *to_camera = matrices
    length = np.linalg.norm(to_ndc[3, :3])
    if length == 0:
        return np.inf
    axis = to_ndc[3] / length
    ahead = to_ndc[[0, 1, 3], :3] @ axis[:3]
    middle = np.abs(ahead[:2] / ahead[2] - 0.5).max()
    return float(middle + sum(np.abs(matrix[2] - axis).max() for matrix in to_camera))


def _natural(path: Path) -> list[tuple[int, str]]:
    """Key for natural sorting: digits compare as numbers."""
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]
