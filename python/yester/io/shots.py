"""The numbers in file names: they order frames, and tell shot boundaries and missing frames."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

#: A number. Between a separator and digits, or at the start, a minus is its sign: "shot.-006", but not "shot-006".
_NUMBER = re.compile(r"((?:(?<![^\W_])-)?\d+)")


def natural(path: Path) -> list[tuple[int, str]]:
    """Key for natural sorting: numbers compare as such."""
    return [(int(piece) if i % 2 else -1, piece) for i, piece in enumerate(_NUMBER.split(_spelled(path)))]


def words(path: Path) -> list[str]:
    """The text around the numbers: the files of a shot have it in common, ``1_left.exr`` and ``1_right.exr`` differ."""
    return _pieces(path)[::2]


def by_shots(paths: Iterable[Path]) -> list[Path]:
    """The files of a folder shot by shot, each in natural order."""
    return sorted(paths, key=lambda path: (words(path), natural(path)))


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
    number counts frames and must increase by the shot's step: its most common increase, the smallest of several. If no
    increase comes twice, the step is 1. After two files with the same number, history starts anew, too: nothing tells
    which of them the next one belongs to.
    """
    found: dict[int, str] = {}
    #: By shot: index of the file, number of the file before, and its own.
    shots: list[list[tuple[int, int, int]]] = [[]]
    counter, same = None, False
    for index, (former, path) in enumerate(pairwise(paths), 1):
        before, here = _pieces(former), _pieces(path)
        differ = [i for i, pair in enumerate(zip(before, here, strict=False)) if pair[0] != pair[1]]
        if before == here:
            why = f"the same frame number as {former}, so not the same shot"
        elif same:
            why = f"after {former}, one of two files with the same frame number"
        elif len(before) != len(here) or len(differ) != 1 or differ[0] % 2 == 0 or counter not in (None, differ[0]):
            why = f"not the same shot as {former}"
        else:
            (counter,) = differ
            shots[-1].append((index, int(before[counter]), int(here[counter])))
            continue
        found[index] = f"{path}: {why}: processed as a separate sequence"
        counter, same = None, before == here
        shots.append([])
    for shot in shots:
        step = _step(high - low for _, low, high in shot)
        for index, low, high in shot:
            if high - low != step:
                gap = _gap(low, high, step)
                found[index] = f"{paths[index]}: frame numbers jump after {paths[index - 1]}{gap}: history starts anew"
    return dict(sorted(found.items()))


def _step(increases: Iterable[int]) -> int:
    """The most common increase of a shot's numbers, the smallest of several; 1 if none comes twice."""
    counts = Counter(increase for increase in increases if increase > 0)
    most = max(counts.values(), default=0)
    return min(increase for increase, count in counts.items() if count == most) if most > 1 else 1


def _gap(low: int, high: int, step: int) -> str:
    """The missing numbers between two, for a message; empty where the step does not lead from one to the other."""
    if high <= low or (high - low) % step:
        return ""
    first, last = low + step, high - step
    if first == last:
        return f" ({first} is missing)"
    return f" ({first} to {last} are missing{f', in steps of {step}' if step > 1 else ''})"


def _pieces(path: Path) -> list[str]:
    """Text and numbers in turn. A number with more zeros in front is the same."""
    return [str(int(piece)) if i % 2 else piece for i, piece in enumerate(_NUMBER.split(_spelled(path)))]


def _spelled(path: Path) -> str:
    """The one spelling of a path, which users may give as ``a/1.exr``, ``b/../a/1.EXR`` or from the root."""
    return os.path.abspath(path.with_suffix(path.suffix.lower()))
