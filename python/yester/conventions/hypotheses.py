"""What motion vectors may be that are stored, and how to read them as canonical ones."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .findings import Channels, Floats

__all__ = ["Motion", "applied", "mapping", "named", "possible_motions", "remedy", "seen"]

_OPPOSITE = {"previous": "next", "next": "previous"}


@dataclass(frozen=True)
class Motion:
    """A hypothesis of what motion vectors are: canonical = matrix · (stored - zero).

    All hypotheses compare a frame with the one before. Vectors come from the file `file` frames later, belong to the
    pixels of the frame `here` frames later, and lead to the other frame of the pair.
    """

    name: str
    matrix: NDArray[np.float64]
    zero: float = 0.0
    file: int = 0
    here: int = 0

    @property
    def there(self) -> int:
        return -1 - self.here


def named(hypothesis: Motion, buffer: str) -> str:
    """Its name; for motion to the next frame, which is that of the reversed sequence, with directions changed."""
    if buffer == "motion":
        return hypothesis.name
    return re.sub("previous|next", lambda found: _OPPOSITE[found[0]], hypothesis.name)


def applied(hypothesis: Motion, stored: Floats) -> NDArray[np.float32]:
    return np.asarray((stored - hypothesis.zero) @ hypothesis.matrix.T, np.float32)


def seen(hypothesis: Motion, stored: Sequence[Floats], t: int) -> Floats:
    """The vectors of frame t as a hypothesis has them, approximately if they belong to the pixels of another frame."""
    vectors = applied(hypothesis, stored[t + hypothesis.file])
    return -vectors if hypothesis.here else vectors


def possible_motions(width: int, height: int, *, timed: bool, grey: bool) -> Iterator[Motion]:
    """Without repetitions; the simpler ones first."""
    straight, swapped = np.eye(2), np.eye(2)[::-1]
    signs = {
        "": (1, 1),
        "y up": (1, -1),
        "current minus previous position": (-1, -1),
        "current minus previous position, y up": (-1, 1),
    }
    turns = {
        ", ".join(filter(None, (order, name))): np.diag(sign) @ axes
        for order, axes in (("", straight), ("(row, column) order", swapped))
        for name, sign in signs.items()
    }
    units = {
        "": np.eye(2),
        "fractions of the image's sides": np.diag([width, height]),
        "normalised device coordinates": np.diag([width / 2, height / 2]),
    }
    lengths = {"half as long": 2.0, "twice as long": 0.5, "a quarter as long": 4.0, "four times as long": 0.25}
    times = {"to the next frame": (-1, -1), "of the next frame": (-1, 0)} | (
        {"of the previous frame": (1, 0)} if timed else {}
    )
    known: set[tuple[Any, ...]] = set()

    def new(
        name: str, matrix: NDArray[np.float64], zero: float = 0.0, file: int = 0, here: int = 0
    ) -> Iterator[Motion]:
        key = (*matrix.ravel(), zero, file, here)
        if key not in known:
            known.add(key)
            yield Motion(name, matrix, zero, file, here)

    def named(*parts: str) -> str:
        return ", ".join(filter(None, parts))

    yield from new("previous minus current position, in pixels, y down", straight)
    # What no better explanation excludes.
    yield from new("unrelated: history in place agrees better", np.zeros((2, 2)))
    for unit, scale in units.items():
        for turn, matrix in turns.items():
            yield from new(named(unit, turn), scale @ matrix)
    for length, factor in lengths.items():
        for turn, matrix in turns.items():
            yield from new(named(length, turn), factor * matrix)
    for unit, scale in [*units.items()][1:] if grey else ():
        for turn, matrix in turns.items():
            yield from new(named("0.5 is zero", unit, turn), 2 * scale @ matrix, 0.5)
    for time, (file, here) in times.items():
        for unit, scale in units.items():
            for turn, matrix in turns.items():
                # Towards the next frame, the difference that is expected is that to the next frame.
                said = turn.replace("previous", "next") if here else turn
                yield from new(named(time, unit, said), scale @ matrix, file=file, here=here)


def mapping(
    buffer: str,
    matrix: NDArray[np.float64],
    channels: Sequence[tuple[float, str]],
    sides: tuple[int, int] = (1, 1),
    **form: Any,
) -> str:
    """The options of the command line that read a buffer, in that form, as a matrix says: one channel a component."""
    width, height = sides
    terms = [(row[i] * channels[i][0], channels[i][1]) for row in matrix for i in np.flatnonzero(row).tolist()]
    named = ",".join(f"{'-' if factor < 0 else ''}{name}" for factor, name in terms)
    lengths = np.abs([factor for factor, _ in terms])
    units = {"pixels": (1, 1), "uv": (width, height), "ndc": (width / 2, height / 2)}
    if buffer.startswith("motion"):
        unit = next((unit for unit, sides in units.items() if np.allclose(lengths, sides, rtol=1e-6)), "pixels")
        lengths = lengths / units[unit]
        form |= {"unit": unit} if unit != "pixels" else {}
    if not np.allclose(lengths, 1):
        form["scale"] = ",".join(f"{length:g}" for length in lengths)
    return " ".join([f"--map {buffer}={named}", *(f"--map {buffer}.{name}={value}" for name, value in form.items())])


def remedy(hypothesis: Motion, buffer: str, channels: Channels, sides: tuple[int, int]) -> str:
    """What to write for canonical motion, to the previous frame or to the next one."""
    if not hypothesis.matrix.any():
        return "leave the motion vectors out"
    buffers, neighbours = ("motion", "motion_next"), ("previous", "next")
    if buffer == "motion_next":
        buffers, neighbours = buffers[::-1], neighbours[::-1]
    text = mapping(buffers[hypothesis.here], hypothesis.matrix, channels[buffer], sides)
    if hypothesis.zero:
        text += f", after subtracting {hypothesis.zero:g} from what is stored"
    if hypothesis.file != hypothesis.here:
        text += f", from the file of the {neighbours[hypothesis.file > 0]} frame"
    return text
