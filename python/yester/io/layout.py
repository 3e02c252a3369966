"""Validation of the layout of EXR files, before OpenEXR decodes them.

OpenEXR does not notice missing pixel data when it reads a header, and its Python module writes the pixels of deep and
subsampled channels to addresses computed from a possibly damaged header. The layout is that of "OpenEXR File
Layout", openexr.com: a magic number and a version, a header per part, a table of chunk offsets per part, chunks.
"""

from __future__ import annotations

import math
import mmap
import struct
from collections.abc import Collection
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

_MAGIC = b"\x76\x2f\x31\x01"
_TILED, _LONG_NAMES, _DEEP, _SEVERAL = 0x200, 0x400, 0x800, 0x1000
#: Attributes that every header must have: type and, where it is fixed, size in bytes.
_REQUIRED = {
    "channels": ("chlist", None),
    "compression": ("compression", 1),
    "dataWindow": ("box2i", 16),
    "displayWindow": ("box2i", 16),
    "lineOrder": ("lineOrder", 1),
    "pixelAspectRatio": ("float", 4),
    "screenWindowCenter": ("v2f", 8),
    "screenWindowWidth": ("float", 4),
}
#: Compressions of OpenEXR 3.5, which treats unknown ones as ZIP.
_COMPRESSIONS = 14
#: Windows beyond these cannot be images: corners are added and multiplied in 32 bits.
_CORNER_MAX = 2**30
_PIXELS_MAX = 2**31
#: Pixels of a tile that is larger than its image: OpenEXR decodes tiles as a whole.
_TILE_MAX = 2**22
#: Types of samples: unsigned integer, half, float.
_SAMPLES = 3
UINT, HALF = 0, 1


@dataclass(frozen=True)
class Attribute:
    """An attribute of a header: its type, and where its value lies in the file."""

    type: str
    start: int
    size: int


def check(path: Path) -> list[dict[str, int]]:
    """Raise ValueError, naming the file, unless it is laid out as an EXR file of flat images and has all its chunks.

    Chunks are not decoded. OSError if the file cannot be opened. Returns, by part, the type of each channel's samples,
    which OpenEXR's Python module does not tell without pixels.
    """
    with path.open("rb") as file:
        magic = file.read(len(_MAGIC))
        if magic != _MAGIC:
            raise ValueError(f"{path}: {'not an EXR file' if magic else 'an empty file'}")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            try:
                return _check(data)
            except _UnsupportedError as error:
                raise ValueError(f"{path}: {error}") from None
            except (IndexError, struct.error):
                raise ValueError(f"{path}: truncated or corrupt: the header ends early") from None
            except ValueError as error:
                raise ValueError(f"{path}: truncated or corrupt: {error}") from None


def headers(data: bytes | mmap.mmap) -> tuple[list[dict[str, Attribute]], int]:
    """The headers of all parts, and where the tables of offsets begin.

    Raises ValueError, IndexError or struct.error if they do not end within the data.
    """
    at = 8
    found: list[dict[str, Attribute]] = []
    several = bool(struct.unpack_from("<I", data, 4)[0] & _SEVERAL)
    while True:
        header: dict[str, Attribute] = {}
        while data[at]:
            name, at = _text(data, at)
            kind, at = _text(data, at)
            (size,) = struct.unpack_from("<i", data, at)
            if not 0 <= size <= len(data) - at - 4:
                raise ValueError(f"attribute {name!r}: a size of {size} bytes")
            header[name] = Attribute(kind, at + 4, size)
            at += 4 + size
        at += 1
        found.append(header)
        if not several:
            return found, at
        if not data[at]:
            return found, at + 1


def subset(path: Path, keep: Collection[int]) -> bytes:
    """A file with some of the parts of another one that `check` has passed, which has several.

    OpenEXR's Python module reads files as a whole; chunks are copied as they are stored. ValueError if they overlap.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        parts, at = headers(data)
        ends = [max(one.start + one.size for one in header.values()) + 1 for header in parts]
        kept: list[bytes] = []
        chunks: list[bytes] = []
        for number, header in enumerate(parts):
            (count,) = struct.unpack("<i", _value(data, header["chunkCount"]))
            if number in keep:
                head = 20 if _value(data, header["type"]).startswith(b"tiled") else 8
                for (chunk,) in struct.iter_unpack("<Q", data[at : at + 8 * count]):
                    (size,) = struct.unpack_from("<i", data, chunk + head)
                    # Each chunk begins with the number of its part.
                    chunks.append(struct.pack("<i", len(kept)) + data[chunk + 4 : chunk + head + 4 + size])
                kept.append(data[ends[number - 1] if number else 8 : ends[number]])
            at += 8 * count
            if sum(map(len, chunks)) > len(data):
                raise ValueError("chunks overlap")
        front = [data[:8], *kept, b"\0"]
    places = accumulate(map(len, chunks), initial=sum(map(len, front)) + 8 * len(chunks))
    table = b"".join(struct.pack("<Q", place) for place, _ in zip(places, chunks, strict=False))
    return b"".join([*front, table, *chunks])


def legible(data: bytes) -> bytes:
    """A file whose attributes have question marks where their text is not UTF-8."""
    changed = bytearray(data)
    for one in (one for header in headers(data)[0] for one in header.values()):
        at, end = one.start, one.start + one.size
        while at < end and one.type in ("string", "stringvector"):
            size = one.size
            if one.type == "stringvector":  # each text after its length
                (size,) = struct.unpack_from("<i", data, at)
                at += 4
            text = data[at : min(at + max(size, 0), end)].decode(errors="surrogateescape")
            changed[at : at + len(text.encode(errors="surrogateescape"))] = text.encode(errors="replace")
            at += max(size, 0)
    return bytes(changed)


class _UnsupportedError(ValueError):
    """The error for an intact file of an unsupported kind."""


def _check(data: mmap.mmap) -> list[dict[str, int]]:
    (version,) = struct.unpack_from("<I", data, 4)
    if version & 0xFF != 2 or version & ~0xFF & ~(_TILED | _LONG_NAMES | _DEEP | _SEVERAL):
        raise ValueError(f"an unknown version or flags: {version:#x}")
    parts, at = headers(data)
    several, kinds = bool(version & _SEVERAL), []
    if several and version & _TILED:
        raise ValueError("contradictory flags: a single tiled part, and several parts")
    for header in parts:
        for name, (kind, size) in _REQUIRED.items():
            if name not in header:
                raise ValueError(f"no attribute {name}")
            if header[name].type != kind or size not in (None, header[name].size):
                got = f"{header[name].size} bytes of {header[name].type!r}"
                raise ValueError(f"attribute {name!r}: expected {kind}, got {got}")
        if several and not header.keys() >= {"name", "type", "chunkCount"}:
            raise ValueError("a part without name, type or chunkCount")
        kinds.append(_check_image(data, header, deep=bool(version & _DEEP)))
    for header in parts:
        tiled = _value(data, header["type"]).startswith(b"tiled") if several else bool(version & _TILED)
        count = struct.unpack("<i", _value(data, header["chunkCount"]))[0] if several else None
        # Before its size, a chunk has the part's number, in files of several parts, and its coordinates.
        at = _check_chunks(data, at, count, 4 * several + (16 if tiled else 4))
    return kinds


def _check_image(data: mmap.mmap, header: dict[str, Attribute], *, deep: bool) -> dict[str, int]:
    """Check the header of a part; returns the type of each channel's samples."""
    kind = header.get("type")
    if deep or (kind and _value(data, kind).startswith(b"deep")):
        raise _UnsupportedError("a deep image, which cannot be read: flatten it")
    if _value(data, header["compression"])[0] >= _COMPRESSIONS:
        raise ValueError(f"an unknown compression {_value(data, header['compression'])[0]}")
    for name in ("displayWindow", "dataWindow"):
        x0, y0, x1, y1 = struct.unpack_from("<4i", data, header[name].start)
        inside = all(abs(corner) <= _CORNER_MAX for corner in (x0, y0, x1, y1))
        if not (inside and x0 <= x1 and y0 <= y1 and (x1 - x0 + 1) * (y1 - y0 + 1) < _PIXELS_MAX):
            raise ValueError(f"{name}: no image has corners ({x0}, {y0}) and ({x1}, {y1})")
    if "tiles" in header:
        x, y = struct.unpack("<2I", _value(data, header["tiles"])[:8])
        if not 0 < x * y <= max((x1 - x0 + 1) * (y1 - y0 + 1), _TILE_MAX):
            raise ValueError(f"tiles: no tile has {x} x {y} pixels")
    for name in ("pixelAspectRatio", "screenWindowWidth"):
        (value,) = struct.unpack_from("<f", data, header[name].start)
        if not math.isfinite(value):
            raise ValueError(f"{name}: {value}")
    kinds = {}
    at, end = header["channels"].start, header["channels"].start + header["channels"].size
    while at < end - 1:
        name, at = _text(data, at)
        sample, _, *sampling = struct.unpack_from("<4i", data, at)
        if not 0 <= sample < _SAMPLES:
            raise ValueError(f"channel {name!r}: an unknown type of sample, {sample}")
        if sampling != [1, 1]:
            raise _UnsupportedError(
                f"channel {name!r}: subsampled, {sampling[0]} x {sampling[1]}, which cannot be read"
            )
        kinds[name] = sample
        at += 16
    if at != end - 1 or data[at]:
        raise ValueError("channels: the list does not end where its size says")
    return kinds


def _check_chunks(data: mmap.mmap, start: int, count: int | None, head: int) -> int:
    """Check that all chunks of a part's table lie in the file, each with `head` bytes before its size; the table's end.

    Without a count, the table ends where the first chunk begins.
    """
    at, first = start, len(data)
    while at < first if count is None else at < start + 8 * count:
        (chunk,) = struct.unpack_from("<Q", data, at)
        if not start < chunk <= len(data) - head - 4:
            raise ValueError("pixels are missing")
        (size,) = struct.unpack_from("<i", data, chunk + head)
        if not 0 <= size <= len(data) - head - 4 - chunk:
            raise ValueError("pixels are missing")
        at, first = at + 8, min(first, chunk)
    if at == start:
        raise ValueError("pixels are missing")
    return at


def _text(data: bytes | mmap.mmap, at: int) -> tuple[str, int]:
    """Read a zero-terminated name; return it and the position after it."""
    end = data.find(b"\0", at, at + 256)
    if end <= at:
        raise ValueError("a name is empty or does not end")
    return data[at:end].decode(), end + 1


def _value(data: bytes | mmap.mmap, attribute: Attribute) -> bytes:
    return data[attribute.start : attribute.start + attribute.size]
