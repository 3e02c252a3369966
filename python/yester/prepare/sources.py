"""Finds the sequences in folders of EXR files and of Noisebase stores, and reads them frame by frame."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..io import Description, describe, sequence_paths
from ..io.exr import read_with_remarks, without_colour
from ..io.headers import MOVED, layers, moved
from ..io.noisebase import layout, read_noisebase
from ..io.shots import breaks, by_shots, natural
from ..messages import few, told
from .buffers import MOVING, needs

__all__ = ["MANIFEST", "Damaged", "Known", "Source", "find_sequences"]

#: The file that says what a set or a sequence has.
MANIFEST = "manifest.json"

#: A frame, its reference, and remarks on its file.
Read = tuple[Frame, NDArray[np.float32] | None, list[str]]


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
    reading : dict
        Arguments of `read_exr`; references are read without the mapping.
    part : int
        From 2 on, the name has been made from that of a folder whose numbers jump.
    jump : str
        The warning that says where they do, before this part.
    """

    name: str
    files: tuple[Path, ...]
    references: tuple[Path, ...] = ()
    reading: dict[str, Any] = field(default_factory=dict)
    part: int = 1
    jump: str = ""

    @property
    def stores(self) -> bool:
        """Whether the files are Noisebase stores."""
        return self.files[0].suffix.lower() == ".zip"

    def look(self) -> Known:
        """Read the first file's header, and that of the second file if the first one has no motion.

        Raises
        ------
        Damaged
            If it cannot be read, or the name of a file is not UTF-8, which OpenEXR needs.
        """
        for path in (*self.files, *self.references):
            try:
                str(path).encode()
            except UnicodeEncodeError:
                raise Damaged(f"{path}: expected a name in UTF-8") from None
        try:
            if self.stores:
                found = layout(self.files[0])
                names = {"color", "albedo", "normal", "depth", "position", "motion", "camera"}
                names |= {"reference"} if found.reference else set()
                count = found.frames if len(self.files) == 1 else len(self.files)
                return Known(count, found.height, found.width, frozenset(names))
            known = _describe(self.files[0], self.reading)
            names = {
                *known.channels,
                *(("camera",) if known.camera else ()),
                *(("reference",) if self.references else ()),
            }
            # The first frame of a sequence may lack motion, as there is no frame before it.
            if "motion" not in names and len(self.files) > 1:
                names |= _describe(self.files[1], self.reading).channels.keys() & {"motion"}
            return Known(len(self.files), known.height, known.width, frozenset(names))
        except (OSError, ValueError) as error:
            raise Damaged(told(error)) from None

    def inspect(self, buffers: Collection[str]) -> list[str]:
        """Read the headers of all files, which takes far less time than their pixels.

        Parameters
        ----------
        buffers : collection of str
            The images to make, of which `look` has found that the first frames have them.

        Returns
        -------
        list of str
            Warnings.

        Raises
        ------
        Damaged
            Naming the files that cannot be read, have another size than the first one, or lack what others have.
        """
        try:
            if self.stores:
                stores = {path: layout(path) for path in self.files}
                sizes = [(path, one.width, one.height) for path, one in stores.items()]
                bare = [path for path, one in stores.items() if "reference" in buffers and not one.reference]
                unlike = [(path, "no reference; other frames have one") for path in bare]
                known = []
            else:
                known = [_describe(path, self.reading) for path in self.files]
                clean = [_describe(path, self._plain) for path in self.references]
                sizes = [(one.path, one.width, one.height) for one in [*known, *clean]]
                unlike = [*_unlike(known, buffers)]
        except (OSError, ValueError) as error:
            raise Damaged(*(list(self._damaged()) or [told(error)])) from None
        first, *size = sizes[0]
        wrong: dict[str, list[Path]] = {}
        for path, width, height in sizes:
            if [width, height] != size:
                wrong.setdefault(f"{width} x {height}, but {first} is {size[0]} x {size[1]}", []).append(path)
        for path, what in unlike:
            wrong.setdefault(what, []).append(path)
        if wrong:
            raise Damaged(*(f"{few(paths)}: {what}" for what, paths in wrong.items()))
        found = [self.jump] if self.jump else []
        shifted = [here.path.name for before, here in pairwise(known) if moved(before, here)]
        if shifted and MOVING.intersection(buffers):
            found.append(f"{few(shifted)}: {MOVED}")
        return found

    def read(self) -> Iterator[Read]:
        """Read the frames, each with its reference if there is one, and with what is to be said of its file.

        Raises
        ------
        Damaged
            Naming every file of the sequence that cannot be read.
        """
        try:
            if self.stores:
                for frame, reference in read_noisebase(self.files):
                    yield frame, reference, []
            else:
                for index, path in enumerate(self.files):
                    frame, remarks = _read(path, self.reading)
                    yield frame, self._reference(index), remarks
        except (OSError, ValueError) as error:
            raise Damaged(*dict.fromkeys([told(error), *self._damaged()])) from None

    def _reference(self, index: int) -> NDArray[np.float32] | None:
        if not self.references:
            return None
        frame, _ = _read(self.references[index], self._plain)
        return frame.color

    @property
    def _plain(self) -> dict[str, Any]:
        """Arguments of `read_exr` for references."""
        return {**self.reading, "mapping": None}

    def _damaged(self) -> Iterator[str]:
        """The files that cannot be read."""
        files = [(path, self.reading) for path in self.files] + [(path, self._plain) for path in self.references]
        for path, reading in files:
            try:
                for _ in read_noisebase(path) if self.stores else (_read(path, reading),):
                    pass
            except (OSError, ValueError) as error:
                yield told(error)


def _unlike(known: list[Description], buffers: Collection[str]) -> Iterator[tuple[Path, str]]:
    """The frames whose buffers are others than those of earlier frames, where the images are made of them."""
    # The denoiser takes albedo in all frames or in none.
    denoised = "denoised" in buffers
    albedo = "albedo" in known[0].channels
    for before, here in pairwise([None, *known]):
        assert here is not None
        names = {*here.channels, "reference"}
        if before is None:
            names.add("motion")  # nothing leads from the first frame to an earlier one
        elif before.camera and here.camera:
            names.add("camera")
        needed = [*buffers, *(["albedo"] if denoised and albedo else [])]
        if lacks := next(filter(None, (needs(name, names) for name in needed)), None):
            yield here.path, f"{lacks}; earlier frames have it"
        elif denoised and not albedo and "albedo" in names:
            yield here.path, "albedo, which earlier frames lack; denoised is made with it or without it"


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in an error that does not, such as that of a mapping."""
    try:
        yield
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None


def _describe(path: Path, reading: dict[str, Any]) -> Description:
    with _named(path):
        known = describe(path, **reading)
    if "color" not in known.channels:
        raise without_colour(path, layers(known))
    return known


def _read(path: Path, reading: dict[str, Any]) -> tuple[Frame, list[str]]:
    with _named(path):
        return read_with_remarks(path, **reading)


def find_sequences(
    inputs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]], references: str | os.PathLike[str] | None = None
) -> tuple[list[Source], dict[str, list[str]]]:
    """Find the sequences in folders.

    Parameters
    ----------
    inputs : path-like or iterable of path-like
        Folders, searched with all folders in them and all that links lead to, and Noisebase stores. The EXR files of a
        folder are a sequence, or several where their numbers jump; so are zip files whose arrays have no axis of
        frames, also apart where one between them cannot be read. Every other zip file is a sequence of its own.
    references : path-like, optional
        A folder in which EXR files have the paths that they have in their folder of `inputs`, and no noise.

    Returns
    -------
    sequences : list of Source
        In natural order, no two of the same name. Where a folder has a sequence, and others in its folders, the name of
        the first one ends in ``-1``. So does that of a part of a folder whose numbers jump, if another folder has it.
    set_aside : dict of str to list of str
        Sequences that cannot be used, and folders that cannot be read, and why. Names that sequences have end in
        ``-1``, such as that of a damaged zip file beside a folder.

    Raises
    ------
    FileNotFoundError
        If an input is not there, or `references` is no folder.
    ValueError
        If an input is a file of another kind; if two sequences would have the same name, or the same references, or
        there are none.
    """
    given = [inputs] if isinstance(inputs, str | os.PathLike) else [*inputs]
    found: list[Source] = []
    aside: dict[str, list[str]] = {}
    if references is not None and not Path(references).is_dir():
        raise FileNotFoundError(f"{references}: no such folder")
    for root in map(Path, given):
        if not root.exists():
            raise FileNotFoundError(f"{root}: no such file or folder")
        if root.is_file():
            if root.suffix.lower() != ".zip":
                raise ValueError(f"{root}: expected a folder of EXR files or a Noisebase store (zip file), got a file")
            found += _stores([root], root.stem, aside)
            continue
        unread: list[OSError] = []
        for path, names in _folders(root, unread):
            name = _name(path, root)
            names = [each for each in names if not each.startswith(".")]
            if any(each.lower().endswith(".exr") for each in names):
                found += _shots(path, name, root, references, aside)
            if zips := sorted((path / each for each in names if each.lower().endswith(".zip")), key=natural):
                found += _stores(zips, name, aside, inside=path != root)
        aside |= {_name(Path(error.filename), root): [f"{error.filename}: {error.strerror}"] for error in unread}
    # The output of a sequence must not lie in that of another one.
    above = {str(folder) for source in found for folder in PurePosixPath(source.name).parents}
    folders = {source.name for source in found if source.part == 1}
    seen: dict[str, Source] = {}
    for source in found:
        name = source.name
        if PurePosixPath(name).parts[0] == MANIFEST:
            aside[name] = [f"{source.files[0].parent}: has the name of the set's {MANIFEST}: to be renamed"]
            continue
        while name in above or (source.part > 1 and (name in folders or name in seen)):
            name += "-1"
        if name in seen:
            both = f"{seen[name].files[0]} and {source.files[0]}"
            raise ValueError(f"two sequences would have the name {name}: {both}; prepare them into two folders")
        seen[name] = replace(source, name=name)
    for name in [name for name in aside if name in seen]:
        messages = aside.pop(name)
        while name in seen or name in aside:
            name += "-1"
        aside[name] = messages
    of: dict[Path, str] = {}
    for name, source in seen.items():
        for path in source.references:
            if (other := of.setdefault(path, name)) != name:
                instead = "give a folder that has both, and references of the same paths"
                raise ValueError(f"{path}: reference of two sequences, {other} and {name}; {instead}")
    if not found and not aside:
        raise ValueError(f"{', '.join(map(str, given))}: no EXR files and no Noisebase stores found")
    return [*seen.values()], aside


def _name(folder: Path, root: Path) -> str:
    return folder.relative_to(root).as_posix() if folder != root else root.resolve().name


def _folders(root: Path, unread: list[OSError]) -> Iterator[tuple[Path, list[str]]]:
    """A folder and all folders in it, each with the names of its files; links are followed."""
    for folder, inner, names in os.walk(root, onerror=unread.append, followlinks=True):
        path = Path(folder)
        # A link to a folder that it lies in would be followed without end.
        above = {each.resolve() for each in (path, *path.parents[: len(path.relative_to(root).parts)])}
        below = sorted((path / name for name in inner if (path / name).resolve() not in above), key=natural)
        inner[:] = [each.name for each in below]
        yield path, names


def _parts(name: str, files: list[Path], lost: dict[int, str]) -> Iterator[Source]:
    """The frames of a folder, apart where their numbers jump, and where frames are lost: by index, the warning."""
    # Of names alone, as warnings go into the set, where paths would differ from disk to disk.
    jumps = breaks([Path(path.name) for path in files]) | lost
    ends = [0, *sorted(jumps), len(files)]
    for number, (first, end) in enumerate(pairwise(ends), 1):
        own = name if number == 1 else f"{name}-{number}"
        yield Source(own, tuple(files[first:end]), part=number, jump=jumps.get(first, ""))


def _shots(
    folder: Path, name: str, root: Path, references: str | os.PathLike[str] | None, aside: dict[str, list[str]]
) -> Iterator[Source]:
    for source in _parts(name, by_shots(sequence_paths(folder)), {}):
        if references is None:
            yield source
            continue
        clean = tuple(Path(references) / path.relative_to(root) for path in source.files)
        if absent := [path for path in clean if not path.is_file()]:
            aside.setdefault(source.name, []).append(f"{few(absent)}: no such reference")
        else:
            yield replace(source, references=clean)


def _stores(paths: list[Path], name: str, aside: dict[str, list[str]], *, inside: bool = False) -> Iterator[Source]:
    frames: list[Path] = []
    lost: dict[int, str] = {}
    damaged = ""
    for path in paths:
        own = f"{name}/{path.stem}" if inside else path.stem
        try:
            single = layout(path).single
        except (OSError, ValueError) as error:
            aside.setdefault(own, []).append(told(error))
            damaged = path.name
            continue
        if single:
            if damaged and frames:
                # It may hold the frame between.
                lost[len(frames)] = f"{path.name}: {damaged}, before it, cannot be read: history starts anew"
            damaged = ""
            frames.append(path)
        else:
            yield Source(own, (path,))
    if frames:
        yield from _parts(name, frames, lost)
