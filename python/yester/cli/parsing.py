"""Arguments that several commands have, and what they say."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from ..argtypes import filename
from ..io import mapping, sequence_paths
from ..io.shots import by_shots

__all__ = ["OUTPUT", "Command", "add_channels", "add_files", "files_of", "how_to_read", "need", "parameter"]


#: Adds a command: what runs it, its name, and what it is for.
Command: TypeAlias = Callable[[Callable[[argparse.Namespace], Any], str, str], argparse.ArgumentParser]
#: Help of an output folder.
OUTPUT = "output folder (default: %(default)s)"


def add_channels(parser: argparse.ArgumentParser) -> None:
    """How channels are read: for `how_to_read`."""
    about = "what channels are: BUFFER=CHANNEL,..., BUFFER.PROPERTY=VALUE or a TOML file; may be repeated"
    parser.add_argument("--map", metavar="MAP", action="append", default=[], help=about)
    parser.add_argument("--view", metavar="NAME", help="of a stereo file; by default left, or the first one")


def add_files(parser: argparse.ArgumentParser) -> None:
    """Inputs, outputs, and what becomes of those that are there."""
    parser.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    about = "output folder; files keep their names. For a single input, also a file name that ends in .exr"
    parser.add_argument("-o", "--output", metavar="OUT", type=filename, required=True, help=about)
    about = "write float16, or float32; by default, as the colour that is replaced"
    parser.add_argument("--half", action=argparse.BooleanOptionalAction, help=about)
    about = "of the OpenEXR library, such as zip, piz or dwaa; by default that of the input if it is lossless, else zip"
    parser.add_argument("--compression", metavar="NAME", help=about)
    there = parser.add_mutually_exclusive_group()
    about = "go on where a run with the same inputs and options has stopped; the bytes are those of a whole run"
    there.add_argument("--resume", action="store_true", help=about)
    there.add_argument("--overwrite", action="store_true", help="replace files that exist")
    about = "leave damaged files out, name them, and treat them as missing frames"
    parser.add_argument("--keep-going", action="store_true", help=about)
    add_channels(parser)


def parameter(option: str) -> str:
    """The parameter name of an option."""
    return option.removeprefix("--").replace("-", "_")


def files_of(inputs: Iterable[str]) -> list[Path]:
    """The files of a sequence; those of a folder by shots, in natural order, which is not that of a shell's pattern."""
    paths = sequence_paths(inputs)
    first: dict[str, int] = {}
    for number, path in enumerate(paths):
        first.setdefault(os.path.abspath(path.parent), number)
    return sorted(by_shots(paths), key=lambda path: first[os.path.abspath(path.parent)])


def how_to_read(options: argparse.Namespace) -> dict[str, Any]:
    """How files are read: the arguments of `read_exr`."""
    return {"mapping": mapping.parse(options.map), "view": options.view}


def need(extra: str, *modules: str) -> None:
    absent = [name for name in modules if find_spec(name) is None]
    if absent:
        raise ImportError(f"{', '.join(absent)} not installed: pip install 'yester[{extra}]'")
