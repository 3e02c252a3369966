"""Multichannel EXR files: our own layers, and those of the renderers in `channels`.

Cameras are kept in the standard attributes ``worldToCamera`` (to +X right, +Y up, +Z forward) and ``worldToNDC`` (to
[0, 1] over the display window, y down), both as Imath has them: for row vectors, in single precision. Attributes of
ours: ``yester.camera`` says how the matrices are stored; ``jitter`` is the offset of a frame's samples, two numbers, in
pixels, x right, y down; ``yester.color`` lists the channels of a result beside which the noisy colour is kept.
"""

from __future__ import annotations

import glob
import math
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import Camera
from ..frame import Frame
from ..messages import few
from . import layout
from .channels import CANONICAL, COLOR_NAMES, Recognised, guesses, missing, recognise
from .convert import View, canonical, multipliers, notes
from .files import beside
from .mapping import Mapped, apply, load
from .shots import natural
from .stdout import kept_output

Source = str | os.PathLike[str]

_HALVED = {"color", "albedo", "normal", "emission", "object_normal", "replay"}
#: Attributes of the storage layout, which is not preserved.
_STORAGE = {"channels", "chunkCount", "compression", "lineOrder", "tiles", "type", "version"}
#: Attribute that lists the channels of a result, if the noisy colour is in others.
_RESULT = "yester.color"
#: Attribute that says how the matrices of a camera are stored, and its value in files of ours.
_LAYOUT, _OURS = "yester.camera", "row vectors, NDC from 0 to 1, y down"
#: The largest float16.
HALF_MAX = float(np.finfo(np.float16).max)
#: Compressions that keep pixels, or that keep those that they have once stored, by the names that OpenEXR gives them.
_LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "HTJ2K256", "HTJ2K32", "ZSTD")
#: The compressions that can be asked for.
COMPRESSIONS = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab", "htj2k256", "htj2k32")
#: Those that know colour and luminance by the names of channels, and keep them as float16, with loss.
_BY_NAME = ("dwaa", "dwab")
#: worldToNDC to world_to_clip: [0, 1] to [-1, 1], and y up.
_NDC_TO_CLIP = np.array([[2.0, 0, 0, -1], [0, -2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
#: What a view upside down counts beside a middle that is off the screen's: the middle of [-1, 1] is off by 0.25.
_UPSIDE_DOWN = 0.2


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
        Channels of which nothing is known.
    camera : Camera or None
        From the attributes ``worldToCamera`` and ``worldToNDC``.
    jitter : (float, float) or None
        From the attribute ``jitter``.
    missing : dict of str to str
        The buffers (and ``"camera"``) that the file lacks, with the consequences; rarely written buffers are left out.
    notes : dict of str to str
        Remarks on buffers in the file: what is converted, and what is inferred.
    renderer : str
        The one that wrote the file, empty if it is not known.
    evidence : str
        Why it is that one.
    unused : dict of str to str
        Channels that are known but not used, with the reason.
    guesses : dict of str to tuple of str
        For unrecognised layers, what ``--map`` could be, by the nearest known name.
    views : tuple of str
        Names of the views of a stereo file.
    view : str
        The one that is read.
    remarks : tuple of str
        On choices among several layers.
    factors : dict of str to tuple of float
        By buffer, what the stored components are multiplied by.
    corner : (int, int)
        First column and row of the data window.
    display : (int, int)
        Width and height of the display window, of which fractions are those of motion.
    whole : tuple of str
        Buffers of floats that are stored as whole numbers, which `read_exr` refuses.

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
    renderer: str = ""
    evidence: str = ""
    unused: dict[str, str] = field(default_factory=dict)
    guesses: dict[str, tuple[str, ...]] = field(default_factory=dict)
    views: tuple[str, ...] = ()
    view: str = ""
    remarks: tuple[str, ...] = ()
    factors: dict[str, tuple[float, ...]] = field(default_factory=dict)
    corner: tuple[int, int] = (0, 0)
    display: tuple[int, int] = (0, 0)
    whole: tuple[str, ...] = ()


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
    color : tuple of str
        The channels of that part which a result replaces.
    kept : bool, default False
        Whether the frame's colour is in other channels, which a result does not replace. The header of the result then
        says so, and the result is read instead of them.
    factors : tuple of float, default (1.0, 1.0, 1.0)
        What the stored components of colour were multiplied by. A result is divided by it.

    See Also
    --------
    read_plate : Reads a plate.
    write_exr : Writes a frame into a copy of a plate.
    """

    frame: Frame
    parts: tuple[Any, ...]
    main: Any
    color: tuple[str, ...] = CANONICAL["color"]
    kept: bool = False
    factors: tuple[float, ...] = (1.0, 1.0, 1.0)


class UnsuitedError(ValueError):
    """An intact file lacks the view, or the channels of the mapping, that were asked for."""


def read_exr(path: Source, *, mapping: Mapped | None = None, view: str | None = None) -> Frame:
    """Read one frame.

    Parameters
    ----------
    path : path-like
        An EXR file of float16, float32 or uint32 channels, with one part or several. Its data window is the image.
    mapping : path-like or mapping, optional
        What the channels are, where that is not recognised: a TOML file, or what it has. By buffer of a `Frame`, a list
        of channels (``-`` in front turns the sign) or a table: ``channels``; ``unit`` of motion (``"pixels"``,
        ``"uv"``, ``"ndc"``); ``scale``, a factor or one for each component; ``space`` of normals and positions
        (``"world"``, ``"camera"``: x right, y up, z forward); ``kind`` of depth (``"z"``, ``"distance"``), ``near``
        (the distance at which a distance begins to count) and ``miss`` (``"inf"``, ``"zero"``, ``"far"``: 1e9 and
        beyond). Without ``channels``, the table is about the channels that were recognised; an empty list leaves the
        buffer out.
    view : str, optional
        Of a stereo file; by default ``left``, or else the first one.

    Returns
    -------
    Frame
        Whatever is recognised, made canonical (`describe` tells how). Only the channels that are needed are decoded,
        as far as they are in parts of their own.

    Raises
    ------
    OSError
        If the file cannot be opened; FileNotFoundError if it is not there.
    ValueError
        If it is not an EXR file, is truncated or corrupt, has no colour, or has an unusable camera or jitter; if the
        mapping names something that is not there, or the file has no such view.
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
    >>> io.read_exr("frame.exr", mapping={"normal": ["R", "-G", "B"], "depth": []})
    Frame(6x4: color, normal)
    """
    frame, remarks = read_with_remarks(path, mapping=mapping, view=view)
    _warn(remarks)
    return frame


def read_with_remarks(
    path: Source, *, mapping: Mapped | None = None, view: str | None = None
) -> tuple[Frame, list[str]]:
    """A frame, as `read_exr` gives it, and the texts of the warnings that it gives."""
    contents = read_headers(Path(path), mapping, view)
    return _frame(contents, read_pixels(contents, contents.needed()))


def _warn(remarks: Iterable[str]) -> None:
    for remark in remarks:
        warnings.warn(remark, stacklevel=3)


def read_plate(path: Source, *, mapping: Mapped | None = None, view: str | None = None) -> Plate:
    """Read one frame with all other contents of its file.

    Parameters
    ----------
    path : path-like
        As for `read_exr`.
    mapping, view : optional
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
    contents = read_headers(path, mapping, view)
    parts = read_pixels(contents)
    frame, remarks = _frame(contents, parts)
    _warn(remarks)
    color = contents.known.buffers["color"]
    target = [contents.places[name] for name in color.target]
    # A colour whose components are in several parts is written beside them.
    names = CANONICAL["color"] if {part for part, _ in target} - {contents.main} else tuple(name for _, name in target)
    every = tuple(parts[i] for i in range(len(parts)))
    factors = tuple(multipliers("color", color.form, 3, (1.0, 1.0)).tolist())
    return Plate(frame, every, parts[contents.main], names, color.target != color.channels, factors)


def write_exr(
    path: Source,
    frame: Frame | ArrayLike,
    *,
    half: bool | None = None,
    compression: str | None = None,
    like: Plate | None = None,
) -> None:
    """Write one frame, with camera and jitter in the header.

    The file appears when it is complete: it is written beside and then renamed.

    Parameters
    ----------
    path : path-like
        A file in an existing folder; overwritten if it exists.
    frame : Frame or (H, W, 3) array_like of float
        A frame, or just a colour.
    half : bool, optional
        Store colours (albedo, emission and replay among them) and normals as float16, clipped to its largest value,
        65504, or as float32. By default, in the type of the channels that they replace, otherwise as float32. The
        others always have 32 bits.
    compression : str, optional
        ``"none"``, ``"rle"``, ``"zips"``, ``"zip"``, ``"piz"``, ``"pxr24"``, ``"b44"``, ``"b44a"``, ``"dwaa"``,
        ``"dwab"``, ``"htj2k256"`` or ``"htj2k32"``, as the OpenEXR library has them. By default that of `like`, if it
        is lossless: a second lossy compression would change what is copied. Otherwise ``"zip"``. ``"pxr24"`` rounds
        numbers of 32 bits to 24, ``"dwaa"`` and ``"dwab"`` store colour within ±65504 with loss. They are refused
        beside Cryptomatte, whose ids they change, and the latter two where a channel that is no colour is named Y, as
        of normals, positions and motion: they take it for luminance.
    like : Plate, optional
        Everything that `frame` lacks is copied from here, bit for bit and in its own type: channels (alpha, other
        layers), windows, the remaining attributes of the header, and all other parts. Colour replaces the channels that
        it was read from; of a file of Blender, those of the denoised image, which `read_exr` then reads. Other buffers
        replace all channels that files of Yester have for them, in parts of the same view. If `frame` has another size,
        the windows are scaled to it, and the other channels, the other parts and the jitter are left out. Pixels are
        stored as scanlines, whatever the source used.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If there is no such compression, or it would damage a buffer.
    TypeError
        If `like` is no plate.
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
    if compression is not None and compression not in COMPRESSIONS:
        raise ValueError(f"compression: expected one of {', '.join(COMPRESSIONS)}, got {compression!r}")
    halves = compression in _BY_NAME
    if not isinstance(like, Plate | None):
        raise TypeError(f"like: expected what `read_plate` returns, got {type(like).__name__}")
    header: dict[str, Any] = {} if like is None else _attributes(like.main)
    channels: dict[str, Any] = {}
    # All of them: beside motion of two components, a former third one must not stay.
    given = {name for buffer in frame.buffers() if buffer != "color" for name in CANONICAL[buffer]}
    if like is not None and like.frame.shape == frame.shape:
        channels |= {name: channel for name, channel in like.main.channels.items() if name not in given}
    elif like is not None:
        header |= _scaled_windows(header, frame)
        header.pop("jitter", None)
    if frame.camera is not None:
        crop = _crop(header) if like is not None else np.eye(4)
        to_ndc = np.linalg.inv(_NDC_TO_CLIP @ crop) @ frame.camera.world_to_clip
        # The scale is free, and would overflow in single precision. Dividing by a power of two keeps all digits.
        to_ndc = np.ldexp(to_ndc, -round(math.log2(math.hypot(*to_ndc[3, :3]))))
        for name, matrix in {"worldToCamera": frame.camera.world_to_camera, "worldToNDC": to_ndc}.items():
            # For row vectors. OpenEXR copies the memory of an array, whatever its strides.
            header[name] = np.ascontiguousarray(matrix.T, np.float32)
        header[_LAYOUT] = _OURS
    if frame.jitter is not None:
        header["jitter"] = np.array(frame.jitter)
    if like is not None and like.kept:
        header[_RESULT] = [*_results(header), *like.color]
    replaced = {} if like is None else like.main.channels
    for buffer, values in frame.buffers().items():
        names = CANONICAL[buffer]
        if like is not None and buffer == "color":
            names, values = like.color, _unscaled(values, like.factors)
        for name, plane in zip(names, np.moveaxis(np.atleast_3d(values), -1, 0), strict=False):
            former = replaced[name].pixels.dtype if name in replaced else np.float32
            halved = buffer in _HALVED and (former == np.float16 if half is None else half)
            if halved or (buffer in _HALVED and halves):
                plane = held_within_half(plane)
            channels[name] = np.ascontiguousarray(plane, np.float16 if halved else None)
    main = exr.Part(header | _storage(exr, like and like.main, compression), channels, header.get("name", ""))
    parts = [main]
    if like is not None and like.frame.shape == frame.shape:
        parts = [main if part is like.main else _copy(exr, part, compression, given, like.main) for part in like.parts]
        parts = [part for part in parts if part.channels]
    color = CANONICAL["color"] if like is None else like.color
    check_compression(compression, {name for part in parts for name in part.channels} - set(color))
    with beside(path) as temporary:
        try:
            target = _openable(temporary)
            exr.File(parts).write(target)
            if isinstance(target, BytesIO):
                temporary.write_bytes(target.getbuffer())
        except (RuntimeError, TypeError, ValueError) as error:
            raise OSError(f"{path}: cannot be written: {error}") from None


def held_within_half(values: NDArray[Any]) -> NDArray[Any]:
    """Finite values that float16 does not hold become the largest that it does."""
    return np.where(np.isfinite(values), np.clip(values, -HALF_MAX, HALF_MAX), values)


def check_compression(compression: str | None, names: Iterable[str], argument: str = "compression") -> None:
    """Refuse a compression that damages one of these channels, which are no colour."""
    by_name = compression in _BY_NAME
    if by_name or compression == "pxr24":
        lost = {name for name in names if "crypto" in name.lower() or (by_name and name.rpartition(".")[2] == "Y")}
        if lost:
            raise ValueError(f"{argument}: expected one that keeps {few(sorted(lost))}, got {compression}")


def _unscaled(color: NDArray[Any], factors: tuple[float, ...]) -> NDArray[Any]:
    """Colour in the units that its file has. What was multiplied by 0 is lost."""
    if set(factors) <= {0.0, 1.0}:
        return color
    return color / np.array([factor or 1.0 for factor in factors], np.float32)


def sequence_paths(source: Source | Iterable[Source]) -> list[Path]:
    """List the EXR files of a sequence.

    Parameters
    ----------
    source : path-like or iterable of path-like
        A folder (its ``*.exr``, without hidden ones), a pattern such as ``shot/*.exr``, a file, or several of these in
        the order given.

    Returns
    -------
    list of Path
        Within a folder or pattern in natural order: ``frame2`` before ``frame10``.

    Raises
    ------
    FileNotFoundError
        If something named without a pattern is not there.
    PermissionError
        If a folder cannot be read.
    ValueError
        If a folder or pattern has no EXR file, or a name is empty.

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
    if not os.fspath(source):
        raise ValueError("source: expected a folder, file or pattern, got an empty name")
    path = Path(source)
    if path.is_dir():
        # As with a pattern, hidden files do not count, such as those that macOS leaves beside others.
        # Unlike glob, scandir raises where the folder cannot be read.
        with os.scandir(path) as entries:
            names = [entry.name for entry in entries if not entry.name.startswith(".") and not entry.is_dir()]
        found = [path / name for name in names if Path(name).suffix.lower() == ".exr"]
    elif path.exists():
        return [path]
    elif glob.has_magic(str(path)):
        found = [Path(item) for item in glob.glob(str(path), recursive=True)]
    else:
        raise FileNotFoundError(f"{path}: no such file or folder")
    if not found:
        raise ValueError(f"{path}: no EXR files found")
    return sorted(found, key=natural)


def read_sequence(
    source: Source | Iterable[Source], *, mapping: Mapped | None = None, view: str | None = None
) -> Iterator[Frame]:
    """Read the frames of a sequence one by one.

    Parameters
    ----------
    source : path-like or iterable of path-like
        As for `sequence_paths`, which is asked at once.
    mapping, view : optional
        As for `read_exr`.

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
            frame = read_exr(path, mapping=mapping, view=view)
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
        If two names are of one file, or of files outside the folder, or their number is not that of the frames.

    Examples
    --------
    >>> from yester import io
    >>> paths = io.write_sequence("clean", np.ones((2, 4, 6, 3)), half=True)
    >>> [path.name for path in paths]
    ['frame_0000.exr', 'frame_0001.exr']
    """
    folder = Path(folder)
    for name in names or ():
        if not name or Path(name).name != os.path.normpath(name):
            raise ValueError(f"names: expected names of files in the folder, got {name!r}")
    files = None if names is None else [os.path.normpath(name) for name in names]
    if files is not None and len(set(files)) < len(files):
        raise ValueError(f"names: expected each only once, got {sorted({n for n in files if files.count(n) > 1})}")
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


def describe(path: Source, *, mapping: Mapped | None = None, view: str | None = None) -> Description:
    """Describe an EXR file from its header: the buffers that it has and lacks.

    Parameters
    ----------
    path : path-like
        An EXR file.
    mapping, view : optional
        As for `read_exr`.

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
    contents = read_headers(path, mapping, view)
    known, cameras = contents.known, contents.cameras()
    used = {name for one in known.buffers.values() for name in (*one.channels, *one.plus, *one.target)}
    unrecognised = tuple(name for name in contents.places if name not in used and name not in known.unused)
    height, width = _size(contents.header)
    (left, top), _ = _window(contents.header, "dataWindow")
    _, (across, down) = _window(contents.header, "displayWindow")
    display = float(across), float(down)
    return Description(
        path=path,
        width=width,
        height=height,
        channels={buffer: found.channels for buffer, found in known.buffers.items()},
        unrecognised=unrecognised,
        camera=cameras[0][0] if cameras else None,
        jitter=contents.jitter(),
        missing=missing(known.buffers, camera=bool(cameras)),
        notes=notes(known, camera=bool(cameras)),
        renderer=known.renderer,
        evidence=known.evidence,
        unused=known.unused,
        guesses=guesses(unrecognised, color="color" not in known.buffers, renderer=known.renderer),
        views=contents.views,
        view=contents.view,
        remarks=known.remarks,
        factors={
            buffer: tuple(multipliers(buffer, found.form, len(found.channels), display).tolist())
            for buffer, found in known.buffers.items()
        },
        corner=(int(left), int(top)),
        display=(int(across), int(down)),
        whole=tuple(name for name in known.buffers if contents.is_whole(name)),
    )


@dataclass(frozen=True)
class Contents:
    """What the headers of a file say: where channels are, and which buffers they hold."""

    path: Path
    headers: list[dict[str, Any]]
    main: int
    places: dict[str, tuple[int, str]]
    known: Recognised
    views: tuple[str, ...]
    view: str
    #: By part, the type of each channel's samples.
    kinds: list[dict[str, int]]

    @property
    def header(self) -> dict[str, Any]:
        return self.headers[self.main]

    def attributes(self, *names: str) -> dict[str, Any]:
        """The header that has the first one of some attributes: that of the main part, or else another one's."""
        others = {part: self.headers[part] for part, _ in self.places.values()}
        return next((header for header in (self.header, *others.values()) if names[0] in header), self.header)

    def needed(self) -> set[int]:
        """The parts that hold the buffers."""
        channels = (name for one in self.known.buffers.values() for name in (*one.channels, *one.plus))
        return {self.places[name][0] for name in channels}

    def is_whole(self, buffer: str) -> bool:
        """Whether a buffer would be read as whole numbers, where a frame has floats."""
        # Ids are whole numbers, and these are converted, which makes floats of them.
        converted = buffer in ("normal", "depth") or set(self.known.buffers[buffer].form.scale) - {1.0}
        if buffer == "ids" or converted:
            return False
        places = [self.places[name] for name in self.known.buffers[buffer].channels]
        return all(self.kinds[part].get(own) == layout.UINT for part, own in places)

    def cameras(self) -> list[View]:
        attributes = self.attributes("worldToNDC", "worldToCamera")
        given = {name: attributes[name] for name in ("worldToNDC", "worldToCamera", _LAYOUT) if name in attributes}
        return _cameras(self.path, self.header | given)

    def jitter(self) -> tuple[float, float] | None:
        return _jitter(self.path, self.attributes("jitter"))


def read_headers(path: Path, mapping: Mapped | None, view: str | None) -> Contents:
    """Read the headers of a file, and recognise what it has."""
    kinds = layout.check(path)
    exr = _openexr()
    with _decoding(path):
        headers = [part.header for part in _opened(exr, _openable(path), header_only=True).parts]
        if len(headers) != len(kinds) or not headers:
            raise ValueError(f"the header of one of {len(kinds)} parts cannot be read")
    views = _views(headers)
    if view is not None and view not in views:
        raise UnsuitedError(
            f"{path}: view: expected {' or '.join(views) or 'none, as the file has no views'}, got {view!r}"
        )
    chosen = view or ("left" if "left" in views else next(iter(views), ""))
    # Parts that are of a view say so themselves.
    default = str(next(iter(_named_views(headers[0])), chosen))
    parts = [i for i, header in enumerate(headers) if str(header.get("view", chosen)) in (chosen, "")] or [0]
    main, *undecided = _coloured(headers, parts, views, default, chosen) if len(headers) > 1 else [0]
    places = _places(headers, [main, *(i for i in parts if i != main)], main)
    others = [i for i in range(len(headers)) if i not in parts]
    bare = _viewless(places, headers, views, default, chosen)
    skipped = [i for i in parts if i not in {part for part, _ in places.values()}]
    elsewhere = dict.fromkeys(_places(headers, skipped), "a part with another data window than the colour: not read")
    half = {name for name, (part, own) in places.items() if kinds[part].get(own) == layout.HALF}
    results = {name for name, (part, own) in places.items() if own in _results(headers[part])}
    attributes = {name: value for i in reversed(range(len(headers))) for name, value in headers[i].items()}
    known = recognise(bare, attributes, half, results)
    given = load(mapping)
    if undecided and "channels" not in given.get("color", {}):
        used, *left = (headers[i].get("name", i) for i in (main, *undecided))
        remark = f"part {used} is used as colour, not {few(left)}; --map color= chooses"
        known = replace(known, remarks=(*known.remarks, remark))
    try:
        known = apply(given, known, places)
    except ValueError as error:
        raise UnsuitedError(f"{path}: {error}") from None
    known = replace(known, unused=known.unused | elsewhere)
    if known.buffers.get("color"):
        target = places[known.buffers["color"].target[0]][0]
        main = target
    every = places | {f"{headers[i].get('name', i)}:{own}": (i, own) for i in others for own in _names(headers[i])}
    return Contents(path, headers, main, every, known, views, chosen if views else "", kinds)


def _views(headers: list[dict[str, Any]]) -> tuple[str, ...]:
    """The names of the views of a stereo file, the default one first."""
    named = [str(view) for header in headers for view in _named_views(header)]
    return tuple(dict.fromkeys([*named, *(str(header["view"]) for header in headers if header.get("view"))]))


def _named_views(header: dict[str, Any]) -> list[str]:
    """The views that a header names; none if the attribute is of another type."""
    named = header.get("multiView")
    return named if isinstance(named, list) else []


def _coloured(
    headers: list[dict[str, Any]], parts: list[int], views: tuple[str, ...], default: str, view: str
) -> list[int]:
    """The parts that may have the colour, by the names of layers and parts. The first one is used."""
    places = _places(headers, parts)
    attributes = {name: value for i in reversed(parts) for name, value in headers[i].items()}
    bare = _viewless(places, headers, views, default, view)
    known = recognise(bare, attributes)
    if "color" in known.buffers:
        return [places[known.buffers["color"].target[0]][0]]
    coloured = [i for i in parts if "color" in recognise(_names(headers[i])).buffers]
    # A part such as "albedo" has these components as well.
    other = {places[name][0] for buffer in known.buffers.values() for name in buffer.channels}
    may = [i for i in coloured if i not in other]
    # The name of a part stands before components without a layer.
    layers = {places[name][0]: layer for name, layer in bare.items() if "." not in places[name][1]}
    named = [i for i in may if layers.get(i, "").rpartition(".")[0].rpartition(".")[2].lower() in COLOR_NAMES]
    return named or may or [*coloured, *parts][:1]


def _results(header: dict[str, Any]) -> list[str]:
    """The channels of a part that hold a result."""
    given = header.get(_RESULT)
    return given if isinstance(given, list) else []


def _names(header: dict[str, Any]) -> list[str]:
    return [channel.name for channel in header["channels"]]


def _places(headers: list[dict[str, Any]], parts: list[int], main: int | None = None) -> dict[str, tuple[int, str]]:
    """The channels of parts that cover the same window as the main one, by name: part and name there.

    In files of several parts, components without a layer have that of their part's name, except in the main part.
    """
    places: dict[str, tuple[int, str]] = {}
    for i in parts:
        name = str(headers[i].get("name", ""))
        if main is not None and not np.array_equal(headers[i]["dataWindow"], headers[main]["dataWindow"]):
            continue
        for own in _names(headers[i]):
            bare = "." not in own and name and len(headers) > 1 and i != main
            unique = f"{name}.{own}" if bare or own in places else own
            places.setdefault(unique, (i, own))
    return places


def _viewless(
    places: dict[str, tuple[int, str]], headers: list[dict[str, Any]], views: tuple[str, ...], default: str, view: str
) -> dict[str, str]:
    """Channels of a view, and those of none, by their names without that of the view.

    The view's name is that of the innermost layer ("Storing Multi-View Images in OpenEXR Files", openexr.com).
    Other channels belong to the view of their part, or, without a layer, to the default view. Channels of the view come
    first, as they count where others have the same names.
    """
    bare: dict[str, dict[str, str]] = {view: {}, "": {}}
    for channel, (part, _) in places.items():
        layer, _, component = channel.rpartition(".")
        outer, _, inner = layer.rpartition(".")
        own = inner if inner in views else str(headers[part].get("view") or ("" if layer else default))
        if own in bare:
            kept = outer if inner in views else layer
            bare[own][channel] = f"{kept}.{component}" if kept else component
    return bare[view] | bare[""]


def without_colour(path: Path, names: Sequence[str]) -> ValueError:
    """The error of a file without colour. It lists the channels, and says which layer may be colour."""
    got = ", ".join(names) or "none"
    near = [(name, one) for name, (one, *_) in guesses(names, color=True).items() if one.startswith("color=")]
    hint = "; {} may be it: --map '{}'".format(*near[0]) if near else " (a mapping can name others)"
    return ValueError(f"{path}: no colour: expected channels R, G and B, got {got}{hint}")


def _frame(contents: Contents, parts: dict[int, Any]) -> tuple[Frame, list[str]]:
    """The frame that the pixels of a file make, and remarks, which name no file, so that they can be told once."""
    path, known = contents.path, contents.known
    if "color" not in known.buffers:
        raise without_colour(path, [*contents.places])

    def pixels(channel: str) -> NDArray[Any]:
        part, name = contents.places[channel]
        found: NDArray[Any] = parts[part].channels[name].pixels
        return found

    _, (width, height) = _window(contents.header, "displayWindow")
    cameras, jitter = contents.cameras(), contents.jitter()
    try:
        to_camera = _to_camera(contents.attributes("worldToCamera"))
        buffers, camera = canonical(known, pixels, cameras, (float(width), float(height)), to_camera)
        frame = Frame(**buffers, camera=camera, jitter=jitter)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None
    remarks = []
    if cameras and camera is None:
        remarks.append("worldToNDC: not used, as it puts positions elsewhere on the screen")
    if "depth" in known.buffers and "depth" not in buffers:
        remarks.append("depth: not used, as it is from positions, some of which lie behind the camera")
    return frame, remarks


def _openexr() -> Any:
    try:
        return import_module("OpenEXR")
    except ImportError as error:
        raise ImportError("EXR files need the OpenEXR package: pip install 'yester[exr]'") from error


def _openable(path: Path) -> str | BytesIO:
    """A file as OpenEXR takes it: a name in UTF-8, or else a stream of what is in it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return BytesIO(path.read_bytes())
    return str(path)


def _opened(exr: Any, source: str | BytesIO, **how: bool) -> Any:
    """A file that OpenEXR reads, whose Python module takes no text in other encodings than UTF-8."""
    try:
        return exr.File(source, **how)
    except UnicodeDecodeError:
        data = Path(source).read_bytes() if isinstance(source, str) else source.getvalue()
        return exr.File(BytesIO(layout.legible(data)), **how)


@contextmanager
def _decoding(path: Path) -> Iterator[None]:
    """Raise whatever OpenEXR raises as ValueError that names the file."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"{path}: truncated or corrupt: {' '.join(str(error).split())}") from None


def read_pixels(contents: Contents, keep: set[int] | None = None) -> dict[int, Any]:
    """Parts of a file with their pixels, or all; OpenEXR skips a part that it cannot decode and only prints why."""
    exr, path, count = _openexr(), contents.path, len(contents.headers)
    numbers = sorted(keep) if keep and len(keep) < count else list(range(count))
    with _decoding(path):
        source = _openable(path) if len(numbers) == count else BytesIO(layout.subset(path, numbers))
        with kept_output() as said:
            parts = _opened(exr, source, separate_channels=True).parts
        if len(parts) < len(numbers):
            raise ValueError(" ".join("".join(said).split()))
    return dict(zip(numbers, parts, strict=True))


def _storage(exr: Any, part: Any = None, compression: str | None = None) -> dict[str, Any]:
    """The storage attributes of a written part: in a lossless compression, what it was."""
    lossless = [getattr(exr, f"{name}_COMPRESSION") for name in _LOSSLESS if hasattr(exr, f"{name}_COMPRESSION")]
    chosen = exr.ZIP_COMPRESSION
    if compression is not None:
        chosen = getattr(exr, f"{'NO' if compression == 'none' else compression.upper()}_COMPRESSION")
    elif part is not None and part.header.get("compression") in lossless:
        chosen = part.header["compression"]
    return {"compression": chosen, "type": exr.scanlineimage}


def _copy(exr: Any, part: Any, compression: str | None, given: set[str], main: Any) -> Any:
    """A part without the channels, of the main part's view, that are given anew."""
    given = given if part.header.get("view") == main.header.get("view") else set()
    kept = {own: one for own, one in part.channels.items() if given.isdisjoint((own, f"{part.name()}.{own}"))}
    return exr.Part(_attributes(part) | _storage(exr, part, compression), kept, part.name())


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


def _window(header: dict[str, Any], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corner and size of a window, (x, y)."""
    low, high = (np.asarray(corner, np.float64) for corner in header[name])
    return low, high - low + 1


def _size(header: dict[str, Any]) -> tuple[int, int]:
    width, height = _window(header, "dataWindow")[1]
    return int(height), int(width)


def _cameras(path: Path, header: dict[str, Any]) -> list[View]:
    """The cameras that a header may mean, the likeliest one first; none if it has none, or an orthographic one."""
    if "worldToNDC" not in header:
        return []
    given = [header[name] for name in ("worldToNDC", "worldToCamera") if name in header]
    with np.errstate(invalid="ignore"):  # of signalling NaN
        stored = [np.asarray(matrix, np.float64) for matrix in given if isinstance(matrix, np.ndarray)]
    if len(stored) < len(given) or any(one.shape != (4, 4) or not np.isfinite(one).all() for one in stored):
        raise ValueError(f"{path}: worldToNDC, worldToCamera: expected finite (4, 4) matrices")
    ours = str(header.get(_LAYOUT)) == _OURS
    if not ours and any(not row[:3].any() and row[3] for row in (stored[0][3], stored[0].T[3])):
        return []
    height, width = _size(header)
    views: list[View] = []
    # Imath uses row vectors, and so does Houdini, but from -1 to 1 with y up. pbrt writes matrices for column vectors
    # into the same attributes. So did Yester 0.2, but for the usual NDC.
    rows, usual = [matrix.T for matrix in stored], np.eye(4)
    layouts = [(rows, usual), (rows, np.linalg.inv(_NDC_TO_CLIP)), (stored, usual), (stored, _pbrt_to_ndc(header))]
    if ours:
        layouts = layouts[:1]
    elif "renderTimeSeconds" in header:
        layouts.reverse()
    candidates = [(screen @ to_ndc, *to_camera) for (to_ndc, *to_camera), screen in layouts]
    for to_ndc, *to_camera in sorted(candidates, key=_implausibility):
        try:
            camera = Camera(_NDC_TO_CLIP @ _crop(header) @ to_ndc, width, height)
        except ValueError as error:
            if not views:
                raise ValueError(f"{path}: worldToNDC: {error}") from None
            continue
        matrix = to_camera[0] if to_camera and np.linalg.det(to_camera[0][:3, :3]) else camera.world_to_camera
        # The camera space of some renderers, as of Houdini, has z backward.
        forward = np.diag([1, 1, np.copysign(1, matrix[2, :3] @ camera.forward), 1])
        views.append((camera, forward @ matrix))
    return views


def _to_camera(header: dict[str, Any]) -> NDArray[np.float64] | None:
    """The attribute worldToCamera as it is stored, if it is a matrix."""
    matrix = header.get("worldToCamera")
    if not isinstance(matrix, np.ndarray) or matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        return None
    return matrix.astype(np.float64)


def _crop(header: dict[str, Any]) -> NDArray[np.float64]:
    """The matrix from NDC of the display window to NDC of the data window, which is the image."""
    (display, display_size), (data, data_size) = _window(header, "displayWindow"), _window(header, "dataWindow")
    crop = np.eye(4)
    crop[[0, 1], [0, 1]], crop[:2, 3] = display_size / data_size, (display - data) / data_size
    return crop


def _pbrt_to_ndc(header: dict[str, Any]) -> NDArray[np.float64]:
    """The matrix to NDC from what pbrt calls so, where the shorter side of the display spans 0 to 1, with y up."""
    size = _window(header, "displayWindow")[1]
    usual = np.eye(4)
    for axis, scale in enumerate(np.array([1, -1]) * size.min() / size):
        usual[axis, axis], usual[axis, 3] = scale, 0.5 - 0.5 * scale
    return usual


def _jitter(path: Path, header: dict[str, Any]) -> tuple[float, float] | None:
    """The header's jitter."""
    if "jitter" not in header:
        return None
    given = np.asarray(header["jitter"])
    if given.dtype.kind not in "fiu" or given.shape != (2,) or not (np.abs(given) <= 0.5).all():
        raise ValueError(f"{path}: jitter: expected two offsets from -0.5 to 0.5, got {header['jitter']!r}")
    return float(given[0]), float(given[1])


def _implausibility(matrices: Sequence[NDArray[np.float64]]) -> float:
    """How far matrices for column vectors, worldToNDC and maybe worldToCamera, are from those of one camera.

    The homogeneous coordinate of one is the depth of the other or its negative, and the middle of the view is on the
    screen, whose y is down. Without worldToCamera, the world is taken to be right-handed.
    """
    to_ndc, *to_camera = matrices
    length = np.linalg.norm(to_ndc[3, :3])
    if length == 0:
        return np.inf
    axis = to_ndc[3] / length
    ahead = to_ndc[[0, 1, 3], :3] @ axis[:3]
    middle = np.abs(ahead[:2] / ahead[2] - 0.5).max()
    up = to_camera[0][1, :3] if to_camera else np.cross(to_ndc[0, :3], axis[:3])
    return float(
        middle
        + _UPSIDE_DOWN * (up @ to_ndc[1, :3] > 0)
        + sum(min(np.abs(matrix[2] - z).max() for z in (axis, -axis)) for matrix in to_camera)
    )
