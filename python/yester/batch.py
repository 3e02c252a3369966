"""Denoises or upscales EXR files: reads their headers, splits them into shots, and writes a file for each.

Every shot is processed on its own. Results have the names of their inputs, and everything in them but the colour is
that of the inputs. A run can go on where an earlier one stopped, and damaged files can be left out.
"""

from __future__ import annotations

import os
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from glob import escape
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .frame import Frame
from .io import Description, Plate, describe, layout, read_plate, write_exr
from .io.ahead import ahead
from .io.exr import HALF_MAX, UnsuitedError
from .io.files import in_use
from .io.headers import same_albedo, suit
from .io.shots import breaks
from .messages import SHOWN, few, told
from .outputs import keep_inputs, spare, targets_of, writable
from .plan import LARGEST

#: Makes results of the frames of a shot, in order, each with the names of the buffers that it used. If there are
#: several shots, or behind a damaged frame, the text says which one it is: `` from FILE on``.
Run: TypeAlias = Callable[[Iterator[Frame], str], Iterable[tuple[Frame, Iterable[str]]]]

_Plates: TypeAlias = Iterator[Plate | Exception]
#: The index of a frame, and its plate, if that is not read again.
_Held: TypeAlias = deque[tuple[int, Plate | None]]
_Result: TypeAlias = tuple[int, Frame, Plate | None]


class Batch:
    """EXR files to process, in the order of frames, after a look at their headers.

    `files` are the headers of the intact files; `damaged` has a line for each of the others, which are an error unless
    `keep_going`; `shots` are the indices of the files of each shot. `reading` has arguments of `read_exr`, `others` are
    further files that must not be overwritten, and `sparse` says that most samples are expected to be missing. `tell`
    is called, in another thread, with a line for each file whose pixels turn out to be damaged.

    ValueError if a result would overwrite an input or another result, or if files lack colour or do not suit each
    other.
    """

    def __init__(
        self,
        inputs: list[Path],
        output: Path,
        reading: dict[str, Any],
        *,
        keep_going: bool = False,
        sparse: bool = False,
        others: Iterable[Path] = (),
        tell: Callable[[str], None] = print,
    ) -> None:
        keep_inputs(targets_of(inputs, output), [*inputs, *others])
        self.files, self.damaged = _headers(inputs, reading, keep_going=keep_going)
        self._paths = [known.path for known in self.files]
        self._targets = targets_of(self._paths, output)
        self._breaks = breaks(self._paths)
        self.shots = [range(*ends) for ends in pairwise([0, *sorted(self._breaks), len(self._paths)])]
        for shot in self.shots:
            for index in shot:
                same_albedo(self.files[index], self.files[shot.start])
        self._reading, self._keep_going, self._tell = reading, keep_going, tell
        self._there: set[int] = set()
        #: The results that this run may replace.
        self._found: set[Path] = set()
        self._odd = _Odd(sparse)
        self._used: dict[str, None] = {}

    def prepare(self, *, resume: bool, overwrite: bool) -> list[str]:
        """Make the output folders; returns lines for the user.

        With `resume`, complete shots are left out, and results of the others that are there will be compared.
        Otherwise results that are there are an error, unless they may be overwritten.
        """
        lines: list[str] = []
        self._found = {target for target in self._targets if overwrite or os.path.lexists(target)}
        if resume:
            self._there, lines = _there(self._targets)
            # History begins with a shot: those that lack a frame are computed from there.
            self.shots = [shot for shot in self.shots if not self._there.issuperset(shot)]
        else:
            remedy = "--resume goes on where a run stopped, --overwrite replaces"
            spare(self._targets, overwrite=overwrite, remedy=remedy)
        for folder in {target.parent for target in self._targets}:
            writable(folder)
        lines += [f"warning: {about}" for about in self._breaks.values()]
        if resume:
            _remove_unfinished(self._targets)
            lines.append(f"resumed: {len(self._there)} of {len(self._paths)} frames are there")
        return lines

    def process(
        self, run: Run, half: bool | None = None, compression: str | None = None
    ) -> Generator[Path, None, None]:
        """Run a method on the frames of each shot; yields every result when it is written."""
        # Reading, denoising and writing overlap, each in its own thread; OpenEXR and step() release the interpreter's
        # lock. Writing stays in the caller's thread, which receives interrupts.
        read = ahead(map(self._load, chain(*self.shots)))
        made = ahead(self._results(run, read))
        with closing(read), closing(made):
            for index, frame, plate in made:
                path, target = self._paths[index], self._targets[index]
                if half and max(frame.color.max(), -frame.color.min()) > HALF_MAX:
                    self._odd.clipped.append(path)
                like = plate or read_plate(path, **self._reading)
                if target not in self._found and os.path.lexists(target):
                    raise FileExistsError(f"{target}: another run wrote this file while this one was running")
                with _compared(target) if index in self._there else nullcontext(target) as at:
                    write_exr(at, frame, half=half, compression=compression, like=like)
                yield target

    def remarks(self) -> list[str]:
        """Warnings of odd frames and results, and the buffers that were used."""
        used = [f"used: {', '.join(self._used) or 'colour alone'}"] if self.shots else []
        return [*self._odd.lines(), *used]

    def _load(self, index: int) -> Plate | Exception:
        try:
            return read_plate(self._paths[index], **self._reading)
        except (OSError, ValueError) as error:
            if self._keep_going:
                return error
            if isinstance(error, OSError):
                raise
            raise ValueError(f"{error} (--keep-going leaves it out, --resume goes on once it is repaired)") from None

    def _results(self, run: Run, plates: _Plates) -> Iterator[_Result]:
        for shot in self.shots:
            coming = iter(shot)
            for first in coming:  # once, unless a frame is damaged: history begins anew behind it
                held: _Held = deque()
                frames = self._frames(shot, chain([first], coming), plates, held)
                if (frame := next(frames, None)) is not None:
                    several = len(self.shots) > 1 or first > shot.start
                    where = f" from {self._paths[first]} on" if several else ""
                    for result, used in run(chain([frame], frames), where):
                        self._used.update(dict.fromkeys(used))
                        index, plate = held.popleft()
                        yield index, result, plate

    def _frames(self, shot: range, numbers: Iterator[int], plates: _Plates, held: _Held) -> Iterator[Frame]:
        """The frames up to a damaged one; those whose results are to come are in `held`."""
        for index in numbers:
            plate = next(plates)
            if not isinstance(plate, Plate):
                self.damaged.append(f"damaged, left out: {told(plate)}")
                self._tell(self.damaged[-1])
                return
            self._odd.note(self._paths[index], plate.frame, index - shot.start)
            # To save memory, only the first waiting frame keeps its other layers; the rest are read again.
            held.append((index, None if held else plate))
            yield plate.frame


def _headers(paths: list[Path], reading: dict[str, Any], *, keep_going: bool) -> tuple[list[Description], list[str]]:
    """Check the headers for problems that would stop the work half-way; a line for each damaged file that is left out.

    Without `keep_going`, damaged files are an error, which names all of them.
    """
    files: list[Description] = []
    damaged: list[str] = []
    for path in paths:
        try:
            known = describe(path, **reading)
        except UnsuitedError:
            raise
        except FileNotFoundError:  # a link that leads nowhere
            damaged.append(f"{path}: not there")
            continue
        except (OSError, ValueError) as error:
            damaged.append(told(error))
            continue
        files.append(known)
        suit(known, files[0])
    if damaged and not (keep_going and files):
        others = ""
        if len(damaged) > 1:
            others = f"; so are {len(damaged) - 1} more: {'; '.join(each.partition(': ')[0] for each in damaged[1:])}"
        raise ValueError(f"{damaged[0]}{others} (--keep-going leaves them out)")
    return files, [f"damaged, left out: {each}" for each in damaged]


def _there(targets: list[Path]) -> tuple[set[int], list[str]]:
    """The outputs that are there, by index; a line for each damaged one, such as an empty file, which is not."""
    there, broken = set(), []
    for i, target in enumerate(targets):
        if target.is_file():
            try:
                layout.check(target)
                there.add(i)
            except ValueError as error:
                broken.append(f"damaged, written again: {error}")
    return there, broken


@contextmanager
def _compared(target: Path) -> Iterator[Path]:
    """A temporary path for writing a file again; raises if the result differs, as then another run wrote the file."""
    with tempfile.TemporaryDirectory() as folder:
        again = Path(folder) / target.name
        yield again
        if again.read_bytes() != target.read_bytes():
            raise ValueError(f"{target}: is of a run with other inputs or options: --overwrite replaces all frames")


def _remove_unfinished(targets: list[Path]) -> None:
    """Remove the temporary files that a killed run has left, but not those of a run that goes on."""
    for target in targets:
        for path in target.parent.glob(f".{escape(target.name)}.*.tmp"):
            if not in_use(path):
                path.unlink(missing_ok=True)


@dataclass
class _Odd:
    """Files with samples, guide buffers or results that are missing or too large."""

    #: Whether the method expects that most samples are missing.
    sparse: bool
    missing: dict[Path, tuple[int, int]] = field(default_factory=dict)
    large: list[Path] = field(default_factory=list)
    unknown: dict[str, list[Path]] = field(default_factory=dict)
    clipped: list[Path] = field(default_factory=list)

    def note(self, path: Path, frame: Frame, number: int) -> None:
        """Look at a frame; `number` counts from the beginning of its shot."""
        color, every = frame.color, frame.height * frame.width
        largest = max(color.max(), -color.min())
        if not np.isfinite(largest):
            known = np.isfinite(color)
            largest = np.abs(color[known]).max(initial=0)
            count = every - int(known.all(-1).sum())
            if count == every or not self.sparse:
                self.missing[path] = count, every
        if largest > LARGEST:
            self.large.append(path)
        # A shot's first frame needs no motion.
        guides = [name for name in frame.buffers() if name not in ("color", "motion")]
        for name in guides if number == 0 else ["motion"] if number == 1 and frame.motion is not None else []:
            if np.isnan(getattr(frame, name)).reshape(every, -1).any(-1).all():
                self.unknown.setdefault(name, []).append(path)

    def lines(self) -> list[str]:
        """Warnings: of missing samples, the files that lack most come first."""
        worst = sorted(self.missing.items(), key=lambda item: -item[1][0])
        found = [
            f"warning: {path}: {f'all {every}' if count == every else f'{count} of {every}'} samples are missing"
            for path, (count, every) in worst[:SHOWN]
        ]
        if len(worst) > SHOWN:
            found += [f"warning: {len(worst) - SHOWN} more files have missing samples"]
        for name, paths in self.unknown.items():
            found += [f"warning: {few(paths)}: {name} is NaN in all pixels"]
        if self.large:
            why = f"values above {LARGEST:g}, whose squares overflow: results are wrong in the whole frame"
            found += [f"warning: {few(self.large)}: {why}"]
        if self.clipped:
            found += [f"warning: {few(self.clipped)}: results above 65504 are clipped to it, the largest float16"]
        return found
