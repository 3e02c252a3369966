"""The numbers in file names: they order frames, and tell shot boundaries and missing frames."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

#: A number. Between a separator and digits, or at the start, a minus is its sign: "shot.-006", but not "shot-006".
_NUMBER = re.compile(r"((?:(?<![^\W_])-)?\d+)")


def natural(path: Path) -> list[tuple[int, str]]:
    """Key for natural sorting: numbers compare as such."""
    return [(int(piece) if i % 2 else -1, piece) for i, piece in enumerate(_NUMBER.split(_spelled(path)))]


def breaks(paths: Sequence[Path]) -> dict[int, str]:
    """Where history must not be carried over: at the start of another shot, and after missing frames.

    Parameters
    ----------
    paths : sequence of Path
        The files in their order.

    Returns
    -------
    dict of int to str
        By index of the first file after the break, from 1: a sentence that names both files.

    Notes
    -----
    Consecutive files belong to one shot if their names differ in exactly one number, and always the same one. That
    number counts frames and must increase by one.
    """
    found: dict[int, str] = {}
    counter = None
    for index, (former, path) in enumerate(pairwise(paths), 1):
        before, here = _pieces(former), _pieces(path)
        differ = [i for i, pair in enumerate(zip(before, here, strict=False)) if pair[0] != pair[1]]
        if before == here:
            found[index] = (
                f"{path}: the same frame number as {former}, so not the same shot: processed as a separate sequence"
            )
            counter = None
            continue
        if len(before) != len(here) or len(differ) != 1 or differ[0] % 2 == 0 or counter not in (None, differ[0]):
            found[index] = f"{path}: not the same shot as {former}: processed as a separate sequence"
            counter = None
            continue
        (counter,) = differ
        low, high = int(before[counter]), int(here[counter])
        if high != low + 1:
            gap = (
                f"{low + 1} to {high - 1} are missing"
                if high > low + 2
                else f"{low + 1} is missing"
                if high > low
                else ""
            )
            found[index] = f"{path}: frame numbers jump after {former}{gap and f' ({gap})'}: history starts anew"
    return found


def _pieces(path: Path) -> list[str]:
    """Text and numbers in turn. A number with more zeros in front is the same."""
    return [str(int(piece)) if i % 2 else piece for i, piece in enumerate(_NUMBER.split(_spelled(path)))]


def _spelled(path: Path) -> str:
    """The one spelling of a path, which users may give as ``a/1.exr``, ``b/../a/1.exr`` or from the root."""
    return os.path.abspath(path)
