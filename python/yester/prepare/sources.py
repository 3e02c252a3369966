"""Finds the sequences in folders of EXR files and of Noisebase stores, and reads them frame by frame."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..io import describe, read_exr, sequence_paths
from ..io.noisebase import layout, read_noisebase
from ..io.shots import breaks

__all__ = ["Damaged", "Known", "Source", "find_sequences"]

Read = tuple[Frame, NDArray[np.float32] | None]


class Damaged(Exception):
    """Inputs of one sequence cannot be used; the others can. One message for each file."""


@dataclass(frozen=True)
class Known:
    """What the headers of a sequence tell."""

    frames: int
    height: int
    width: int
    buffers: frozenset[str]


@dataclass(frozen=True)
class Source:
    """A sequence of frames.

    Attributes
    ----------
    name : str
        Its folder in the output; parts are separated by slashes.
    files : tuple of Path
        EXR files, one a frame; or a store of the sequence, or stores of its frames.
    references : tuple of Path
        EXR files without noise, one a frame, or none.
    """

    name: str
    files: tuple[Path, ...]
    references: tuple[Path, ...] = ()

    @property
    def stores(self) -> bool:
        """Whether the files are Noisebase stores."""
        return self.files[0].suffix.lower() == ".zip"

    def look(self) -> Known:
        """Read the first file's header; of each, if frames have stores of their own.

        Raises
        ------
        Damaged
            If it cannot be read.
        """
        try:
            if self.stores:
                found = layout(self.files[0])
                names = {"color", "albedo", "normal", "depth", "position", "motion", "camera"}
                names |= {"reference"} if found.reference else set()
                count = found.frames if len(self.files) == 1 else len(self.files)
                return Known(count, found.height, found.width, frozenset(names))
            known = describe(self.files[0])
            names = {
                *known.channels,
                *(("camera",) if known.camera else ()),
                *(("reference",) if self.references else ()),
            }
            return Known(len(self.files), known.height, known.width, frozenset(names))
        except (OSError, ValueError) as error:
            raise Damaged(str(error)) from None

    def read(self) -> Iterator[Read]:
        """Read the frames, each with its reference if there is one.

        Raises
        ------
        Damaged
            Naming every file of the sequence that cannot be read.
        """
        try:
            if self.stores:
                yield from read_noisebase(self.files)
            else:
                for index, path in enumerate(self.files):
                    yield read_exr(path), self._reference(index)
        except (OSError, ValueError) as error:
            raise Damaged(*dict.fromkeys([str(error), *self._damaged()])) from None

    def _reference(self, index: int) -> NDArray[np.float32] | None:
        return read_exr(self.references[index]).color if self.references else None

    def _damaged(self) -> Iterator[str]:
        """The files that cannot be read."""
        for path in (*self.files, *self.references):
            try:
                for _ in read_noisebase(path) if self.stores else (read_exr(path),):
                    pass
            except (OSError, ValueError) as error:
                yield str(error)


def find_sequences(
    inputs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]], references: str | os.PathLike[str] | None = None
) -> tuple[list[Source], dict[str, list[str]]]:
    """Find the sequences in folders.

    Parameters
    ----------
    inputs : path-like or iterable of path-like
        Folders, searched with all folders in them, and Noisebase stores. The EXR files of a folder are a sequence, or
        several where their numbers jump; so are zip files whose arrays have no axis of frames. Every other zip file is
        a sequence of its own.
    references : path-like, optional
        A folder in which EXR files have the paths that they have in `inputs`, and no noise.

    Returns
    -------
    sequences : list of Source
        In natural order, no two of the same name.
    set_aside : dict of str to list of str
        Sequences that cannot be used, and why.

    Raises
    ------
    FileNotFoundError
        If an input is not there.
    ValueError
        If two sequences would have the same name, or there are none.
    """
    given = [inputs] if isinstance(inputs, str | os.PathLike) else [*inputs]
    found: list[Source] = []
    aside: dict[str, list[str]] = {}
    for root in map(Path, given):
        if not root.exists():
            raise FileNotFoundError(f"{root}: no such file or folder")
        if root.is_file():
            found += _stores([root], root.stem, aside)
            continue
        for folder, inner, names in os.walk(root):
            inner.sort(key=lambda name: _natural(name))
            path = Path(folder)
            name = path.relative_to(root).as_posix() if path != root else root.resolve().name
            if any(each.lower().endswith(".exr") for each in names):
                found += _shots(path, name, root, references, aside)
            zips = sorted(
                (path / each for each in names if each.lower().endswith(".zip")), key=lambda p: _natural(p.name)
            )
            if zips:
                found += _stores(zips, name, aside, inside=path != root)
    seen: dict[str, Source] = {}
    for source in found:
        if source.name in seen:
            both = f"{seen[source.name].files[0]} and {source.files[0]}"
            raise ValueError(f"two sequences would have the name {source.name}: {both}; prepare them into two folders")
        seen[source.name] = source
    if not found and not aside:
        raise ValueError(f"{', '.join(map(str, given))}: no EXR files and no Noisebase stores found")
    return found, aside


def _natural(name: str) -> tuple[int, str]:
    digits = "".join(filter(str.isdigit, name))
    return (int(digits) if digits else -1, name)


def _shots(
    folder: Path, name: str, root: Path, references: str | os.PathLike[str] | None, aside: dict[str, list[str]]
) -> Iterator[Source]:
    paths = sequence_paths(folder)
    ends = [0, *sorted(breaks(paths)), len(paths)]
    for number, (first, end) in enumerate(pairwise(ends), 1):
        files = tuple(paths[first:end])
        own = name if number == 1 else f"{name}-{number}"
        clean: tuple[Path, ...] = ()
        if references is not None:
            clean = tuple(Path(references) / path.relative_to(root) for path in files)
            if absent := [f"{path}: no such reference" for path in clean if not path.is_file()]:
                aside[own] = absent
                continue
        yield Source(own, files, clean)


def _stores(paths: list[Path], name: str, aside: dict[str, list[str]], *, inside: bool = False) -> Iterator[Source]:
    frames: list[Path] = []
    for path in paths:
        own = f"{name}/{path.stem}" if inside else path.stem
        try:
            single = layout(path).single
        except (OSError, ValueError) as error:
            aside[own] = [str(error)]
            continue
        if single:
            frames.append(path)
        else:
            yield Source(own, (path,))
    if frames:
        yield Source(name, tuple(frames))
