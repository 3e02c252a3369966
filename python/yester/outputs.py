"""Output files of a command: their names, and what is refused before any work is done."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from .messages import few

#: Endings of animations.
FILMS = (".webp", ".mp4")
#: Endings of names that are meant for a picture or a film, not for a folder.
_PICTURES = {
    *(".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".gif", ".bmp", ".hdr", ".tga", ".dpx"),
    *(*FILMS, ".mov", ".avi", ".mkv", ".webm"),
}


def targets_of(paths: list[Path], output: Path, suffix: str = ".exr", *others: str) -> list[Path]:
    """The output path of each input: in a folder under its own name, or, for a single file, the given name.

    `others` are further endings that the command takes, for the message.
    """
    if not output.is_dir():
        if output.suffix.lower() == suffix:
            if len(paths) > 1:
                raise ValueError(f"-o {output}: expected a folder for {len(paths)} files, got a file name")
            return [output]
        if output.suffix.lower() in _PICTURES:
            known = " or ".join((suffix, *others))
            raise ValueError(f"-o {output}: expected a folder, or a name that ends in {known}")
    targets: dict[Path, Path] = {}
    for path in paths:
        target = output / (path.name if suffix == ".exr" else f"{path.stem}{suffix}")
        if target in targets:
            raise ValueError(f"{path}: its output would overwrite that of {targets[target]}, which has the same name")
        targets[target] = path
    return [*targets]


def keep_inputs(targets: Iterable[Path], inputs: Iterable[Path], what: str = "output", place: str = "folder") -> None:
    """Refuse to replace an input, under whatever name it was given."""
    given = {path.resolve(): path for path in inputs}
    for target in targets:
        if path := given.get(target.resolve()):
            raise ValueError(f"{path}: the {what} would overwrite this input; choose another {place}")


def spare(targets: Iterable[Path], *, overwrite: bool, remedy: str = "--overwrite replaces") -> None:
    """Refuse to replace files unless that is asked for."""
    targets = [*targets]
    for target in targets:
        if target.is_dir():
            raise ValueError(f"{target}: is a folder; choose another name")
    # A link counts even if what it leads to is not there at the moment.
    there = [target for target in targets if os.path.lexists(target)]
    if there and not overwrite:
        raise ValueError(f"{few(there)}: exists already: {remedy}")


def writable(folder: Path) -> Path:
    """Create the folder and check that it is writable."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder
