"""A page that compares two or three folders of EXR frames: split, flip and difference, with exposure, losslessly."""

from __future__ import annotations

import base64
import os
import re
import warnings
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from yester.io import read_exr, sequence_paths
from yester.io.files import beside

from .report import write_page

__all__ = ["FRAMES", "write_comparison"]

Source = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]

#: Frames that are shown unless told otherwise: a page of two folders of 1280×720 has about 70 MB then.
FRAMES = 8


def write_comparison(
    path: str | os.PathLike[str],
    sources: dict[str, Source],
    *,
    frames: int = FRAMES,
    half: bool = False,
    title: str = "Yester: comparison",
) -> list[str]:
    """Write a page with the colours of several sequences, side by side.

    Parameters
    ----------
    path : path-like
        Of the HTML file, which needs nothing else, no network either. It appears when it is complete.
    sources : dict of str to path-like or iterable of path-like
        By name, the EXR files of each sequence, as for `yester.io.sequence_paths`; the first two are shown at first.
        Files of the same names belong together; if there are none, there must be equally many in all, in order.
    frames : int, default 8
        Number of frames in the page, evenly spread over the sequence.
    half : bool, default False
        Round values to float16. Otherwise they are those of the files, bit for bit, in float16 where it holds all of
        an image's, else in float32.
    title : str
        Its heading.

    Returns
    -------
    list of str
        The names of the frames in the page: the numbers at the ends of the first sequence's file names.

    Raises
    ------
    ValueError
        If there are fewer than two sequences, frames do not match, differ in size, or their number is below 1; if the
        page would overwrite a frame; and as `yester.io.read_exr`.
    OSError
        If a file cannot be read or written.
    """
    if len(sources) < 2:
        raise ValueError(f"sources: expected at least two sequences, got {len(sources)}")
    if frames < 1:
        raise ValueError(f"frames: expected at least 1, got {frames}")
    matched = _matched({name: sequence_paths(source) for name, source in sources.items()})
    chosen = sorted({round(i) for i in np.linspace(0, len(matched) - 1, min(frames, len(matched)))})
    path = Path(path)
    if path.resolve() in {file.resolve() for files in matched for file in files}:
        raise ValueError(f"{path}: the page would overwrite this input")
    path.parent.mkdir(parents=True, exist_ok=True)
    views: dict[str, list[int]] = {name: [] for name in sources}
    images: list[dict[str, int]] = []
    elements: list[str] = []
    for index in tqdm(chosen, "compare", unit="frame", disable=None):
        shape = None
        for name, file in zip(sources, matched[index], strict=True):
            color = read_exr(file).color
            if shape not in (None, color.shape):
                expected = f"expected height and width {shape[:2]} as in {matched[index][0]}"
                raise ValueError(f"{file}: {expected}, got {color.shape[:2]}")
            shape = color.shape
            bytes_each, packed = _packed(color, half=half)
            views[name].append(len(images))
            elements.append(f'<script type="text/plain" id="pixels{len(images)}">{packed}</script>\n')
            images.append({"bytes": bytes_each, "width": shape[1], "height": shape[0]})
    kept = [
        {"name": name, "views": {"color": numbers}, "family": None, "default": number == 1}
        for number, (name, numbers) in enumerate(views.items())
    ]
    names = _numbered([matched[index][0].stem for index in chosen])
    data = {
        "linear": True,
        "metrics": [],
        "scenes": [],
        "sequences": [{"name": " | ".join(sources), "frames": names, "sources": kept}],
        "maps": {},
        "rejections": [],
        "images": images,
    }
    about = f"{len(chosen)} of {len(matched)} frames: linear colours, shown in sRGB."
    precision = "Values are rounded to float16." if half else "Values are those of the files, bit for bit."
    with beside(path) as temporary:
        write_page(temporary, data, title=title, about=about, precision=precision, pixels=elements)
    return names


def _numbered(stems: list[str]) -> list[str]:
    """The numbers at the ends of names, if these tell the names apart."""
    numbers = [_number(stem) or stem for stem in stems]
    return numbers if len({*numbers}) == len(stems) else stems


def _number(stem: str) -> str:
    """The number at the end of a name; empty if there is none."""
    found = re.search(r"\d+$", stem)
    return found[0] if found else ""


def _matched(paths: dict[str, list[Path]]) -> list[tuple[Path, ...]]:
    """The files of each frame."""
    first, *others = paths.values()
    named = [{path.name: path for path in files} for files in paths.values()]
    common = [path.name for path in first if all(path.name in other for other in named[1:])]
    if common:
        for name, files in paths.items():
            if len(files) > len(common):
                lone = next(path for path in files if path.name not in common)
                left = f"{len(files) - len(common)} files of {name}, such as {lone.name}"
                warnings.warn(f"sources: {left}, are left out, as not all have one of that name", stacklevel=4)
        return [tuple(each[name] for each in named) for name in common]
    for name, files in paths.items():
        if len(files) != len(first):
            counts = f"{len(first)} in {next(iter(paths))}, {len(files)} in {name}"
            raise ValueError(f"sources: expected files of the same names, or equally many, got {counts}")
    frames = [*zip(first, *others, strict=True)]
    for frame in frames:
        numbers = [_number(path.stem) for path in frame]
        if all(numbers) and len({*map(int, numbers)}) > 1:
            shown = " beside ".join(str(path) for path in frame)
            warnings.warn(f"sources: files are paired by their order, with other numbers: {shown}", stacklevel=4)
            break
    return frames


def _packed(color: NDArray[np.float32], *, half: bool) -> tuple[int, str]:
    """Bytes of each value, and the image as the page decodes it."""
    with np.errstate(over="ignore", invalid="ignore"):
        small = color.astype(np.float16)
        exact = np.array_equal(small.astype(np.float32), color, equal_nan=True)
    values: NDArray[Any] = small if half or exact else color
    planar = np.ascontiguousarray(np.moveaxis(values, -1, 0))
    kind = planar.dtype.newbyteorder("<")
    planes = np.ascontiguousarray(planar.astype(kind).reshape(-1, 1).view(np.uint8).T).ravel()
    # Neighbours are alike, and so are their high bytes.
    steps = np.diff(planes, prepend=planes.dtype.type(0))
    return kind.itemsize, base64.b64encode(zlib.compress(steps.tobytes(), 6)).decode()


def names_of(folders: Sequence[Path]) -> Iterator[str]:
    """A short name for each folder, no two alike."""
    parts = [folder.resolve().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len({*names}) == len(names):
            return iter(names)
    return iter([f"{number}: {'/'.join(part[-1:])}" for number, part in enumerate(parts, 1)])
