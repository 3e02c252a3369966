"""Prepares sequences: one task each, in this process, in several, or on the workers of a Dask cluster."""

from __future__ import annotations

import errno
import hashlib
import json
import multiprocessing
import operator
import os
import platform
import re
import shutil
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path, PurePosixPath
from queue import SimpleQueue
from typing import Any, Literal
from uuid import uuid4

import numpy as np

from .. import Frame, __version__
from ..io.ahead import ahead
from ..io.files import beside, in_use
from ..io.mapping import Mapped, load
from ..messages import few
from .buffers import CHANNELS, DERIVED, derive, filled, halve, needs
from .sources import MANIFEST, Damaged, Known, Source, find_sequences
from .store import EXRFiles, Writer, ZarrStore, checksums, clipped, stored

__all__ = ["Parameters", "Prepared", "prepare"]

_WRITERS: dict[str, type[Writer]] = {"zarr": ZarrStore, "exr": EXRFiles}
#: Times that a sequence is tried while the process that works on it dies.
_ATTEMPTS = 3
#: Seconds to wait for a scheduler.
_PATIENCE = 10
#: In a folder until all is written. One that was removed meanwhile, and made again by a writer, lacks it.
_BEGUN = ".begun"
#: What a file takes at least, in bytes.
_BLOCK = 4096
#: What runs that were killed leave in a set's folder: sequences and manifests that are half-written.
_HALF = re.compile(r"\..+\.[0-9a-f]{32}\.tmp|\.manifest\.json\.\d+\.tmp", re.DOTALL)
#: A file that is there while a process, whose number it has, uses the folder.
_LOCK = re.compile(r"\.run\.\d+\.tmp")
#: Folders that runs of this process use, and what is held to change them.
_IN_USE: set[Path] = set()
_CHANGING = threading.Lock()

_Path = str | os.PathLike[str]


@dataclass(frozen=True)
class Parameters:
    """What is made of every frame. See `prepare`."""

    buffers: tuple[str, ...]
    sizes: tuple[str, ...]
    crop: tuple[int, int] | None
    crops: int
    seed: int
    half: bool
    format: str
    references: bool
    mapping: dict[str, Any] | None
    view: str | None

    def groups(self, source: str, known: Known) -> Iterator[tuple[str, slice, slice]]:
        """The crops of a sequence: name, rows and columns. The same window in every frame, at even places."""
        if self.crop is None:
            yield "", slice(known.height), slice(known.width)
            return
        width, height = self.crop
        if width > known.width or height > known.height:
            raise Damaged(f"{source}: {known.width} x {known.height}, smaller than the crop, {width} x {height}")
        digest = hashlib.sha256(f"{self.seed} {source}".encode()).digest()
        random = np.random.default_rng(np.frombuffer(digest, np.uint32))
        for number in range(self.crops):
            y, x = (
                2 * int(random.integers((room - side) // 2 + 1))
                for room, side in ((known.height, height), (known.width, width))
            )
            yield f"crop{number}", slice(y, y + height), slice(x, x + width)

    def bytes(self, known: Known) -> int:
        """Of a sequence on disk, not compressed: every image of every frame takes whole blocks of the file system."""
        width, height = self.crop or (known.width, known.height)
        pixels = {"full": width * height, "half": -(-width // 2) * -(-height // 2)}
        images = [
            pixels[size] * CHANNELS[name] * stored(name, self.half).itemsize
            for size in self.sizes
            for name in self.buffers
        ]
        # The manifest has a checksum of each file.
        return sum(_BLOCK * (-(-image // _BLOCK) + 1) for image in images) * known.frames * self.crops


@dataclass(frozen=True)
class Prepared:
    """What `prepare` did.

    Attributes
    ----------
    folder : Path
        Where it is.
    sequences : tuple of str
        The names of the sequences in the folder.
    frames : int
        Their frames in all, those of an earlier run among them.
    set_aside : dict of str to tuple of str
        The sequences that could not be prepared, and why: a message for each damaged file. On `resume`, also those of
        the earlier run that are not in the inputs.
    buffers : tuple of str
        The images of each frame.
    first : str
        The sequence that the images were chosen by; empty if they were given, or are those of the earlier run.
    gone : tuple of str
        Those set aside because they are not in the inputs any more.
    """

    folder: Path
    sequences: tuple[str, ...]
    frames: int
    set_aside: dict[str, tuple[str, ...]] = field(default_factory=dict)
    buffers: tuple[str, ...] = ()
    first: str = ""
    gone: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Task:
    source: Source
    known: Known
    folder: Path
    parameters: Parameters

    @property
    def target(self) -> Path:
        """The sequence's folder."""
        return self.folder / self.source.name

    def anywhere(self) -> _Task:
        """The task for a process that may run in another folder."""
        files, references = (
            tuple(path.absolute() for path in paths) for paths in (self.source.files, self.source.references)
        )
        return replace(self, source=replace(self.source, files=files, references=references))

    def inputs(self) -> dict[str, Any]:
        """What the sequence's manifest has about its inputs."""
        return {
            "frames": self.known.frames,
            "height": self.known.height,
            "width": self.known.width,
            "inputs": [path.name for path in self.source.files],
            "input_bytes": [path.stat().st_size for path in self.source.files],
            "references": [path.name for path in self.source.references],
            "reference_bytes": [path.stat().st_size for path in self.source.references],
        }


@dataclass(frozen=True)
class _Done:
    """How a task ended: with frames, or with what was wrong with its inputs, or with what was wrong with the disk."""

    name: str
    frames: int = 0
    warned: tuple[str, ...] = ()
    damaged: tuple[str, ...] = ()
    failed: tuple[int, str, str] | None = None


def prepare(
    inputs: _Path | Iterable[_Path],
    folder: _Path,
    *,
    buffers: Sequence[str] | None = None,
    sizes: Sequence[Literal["full", "half"]] = ("full",),
    crop: tuple[int, int] | None = None,
    crops: int = 1,
    seed: int = 0,
    half: bool = False,
    format: Literal["zarr", "exr"] = "zarr",
    references: _Path | None = None,
    mapping: Mapped | None = None,
    view: str | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
) -> Prepared:
    """Prepare a training set from rendered sequences.

    Parameters
    ----------
    inputs : path-like or iterable of path-like
        Folders of sequences: folders of EXR files, or Noisebase stores (zip files). See `find_sequences`.
    folder : path-like
        Where the set is written; must be absent or empty, unless `resume`.
    buffers : sequence of str, optional
        The images of each frame: buffers of `Frame`, ``"reference"``, and any of ``"demodulated"``, ``"history"``,
        ``"history_length"``, ``"validity"``, ``"difference"``, ``"variance"`` and ``"denoised"``, as `derive` defines
        them. By default all that the first sequence that can be read allows.
    sizes : sequence of {"full", "half"}, default ("full",)
        Half size is made of full size, as `halve` does.
    crop : (int, int), optional
        Width and height of windows that are cut from each sequence. Histories are those of whole frames.
    crops : int, default 1
        Number of windows per sequence. They keep their place in all frames.
    seed : int, default 0
        Of the windows' places, which depend on it and on the sequence's name alone.
    half : bool, default False
        Store colours, normals and validity as float16.
    format : {"zarr", "exr"}, default "zarr"
        A Zarr store with arrays (F, C, H, W) for each sequence, or multi-layer EXR files.
    references : path-like, optional
        For EXR inputs: a folder with files of the paths that they have in their folder of `inputs`, without noise. No
        two sequences may have the same.
    mapping, view : optional
        For EXR inputs: as for `yester.io.read_exr`. References are read without the mapping.
    jobs : int, optional
        Processes, each of which takes one sequence at a time and its share of the cores. By default as many as there
        are cores, but no more than sequences.
    scheduler : str, optional
        Address of a Dask scheduler, such as ``"tcp://node1:8786"``, whose workers do the work instead. They must see
        the inputs and `folder` under the same absolute paths.
    resume : bool, default False
        Go on where an earlier run with the same parameters stopped; its `buffers` are the default then. A sequence
        whose inputs are others by now, in their names, number or size, is prepared again.

    Returns
    -------
    Prepared

    Raises
    ------
    FileNotFoundError
        If an input is not there, or `references` is no folder.
    FileExistsError
        If `folder` has something in it and `resume` is not set.
    OSError
        If there is not enough space, before any work is done; if the disk fills up nevertheless, or cannot be written.
        `resume` goes on from there. If another run on this machine uses `folder`.
    ValueError
        If a parameter is out of range; if the folder lies in the inputs; if there are no sequences, or none that can be
        prepared; if EXR inputs have no `references` for ``"reference"``, or two sequences the same; on `resume`, if the
        parameters or versions are others, or the manifest is damaged.
    TypeError
        If `crop`, `crops`, `seed` or `jobs` are not of integers.
    ImportError
        If zarr, OpenEXR or distributed is needed and not installed.

    Warns
    -----
    UserWarning
        If sequences have buffers that the first one lacks, and `buffers` is not given. With a sequence's name, if its
        motion seems wrong, its data window moves, its references or buffers have missing pixels, or its files are apart
        from others of their folder because their numbers jump or a store between them cannot be read.

    Notes
    -----
    Every sequence is written beside its place and renamed when it is complete, with its ``manifest.json``: the SHA-256
    of every file, the names and sizes of the inputs, the windows' places, the warnings, and the number of missing
    pixels in each frame and in each reference. The one in `folder` has the parameters, the versions, the sequences and
    those set aside; ``complete`` is false until a run has ended and set none aside. Neither depends on the number of
    processes, on interruptions, or on time. A sequence is tried up to three times where the process that works on it
    dies. All headers of a sequence are read before its pixels.

    Missing pixels (NaN, or infinite) of colour, references and other buffers are stored as 0, with a warning where they
    are not those of colour. ``depth`` and ``hit_distance`` are infinite where nothing is hit; ``position`` is not
    finite there, and ``replay`` NaN where another surface is visible.
    """
    folder = Path(folder)
    given = [Path(inputs)] if isinstance(inputs, str | os.PathLike) else [Path(path) for path in inputs]
    crops, seed, jobs = _whole("crops", crops), _whole("seed", seed), None if jobs is None else _whole("jobs", jobs)
    if crop is not None:
        if len(crop) != 2:
            raise ValueError(f"crop: expected width and height, got {len(crop)} numbers")
        crop = _whole("crop", crop[0]), _whole("crop", crop[1])
    _check_arguments(given, folder, sizes, crop, crops, format, jobs)
    former = _earlier(folder, resume)
    reading: dict[str, Any] = {"mapping": load(mapping) or None, "view": view}
    sources, found_aside = find_sequences(given, references)
    _check_links(given, folder, sources)
    sources = [replace(source, reading=reading) for source in sources]
    if references is None and "reference" in (buffers or ()) and not any(source.stores for source in sources):
        raise ValueError("buffers: reference needs --references, a folder of the same EXR files without noise")
    known: dict[str, Known] = {}
    aside = {name: tuple(messages) for name, messages in found_aside.items()}
    for source in sources:
        with _or_aside(source.name, aside):
            known[source.name] = source.look()
    images, first, demand = _chosen(buffers, former, known)
    parameters = Parameters(
        images,
        tuple(size for size in ("full", "half") if size in sizes),
        crop,
        crops,
        seed,
        bool(half),
        format,
        references is not None,
        **reading,
    )
    about = _about(parameters)
    _agree(folder, former, about)
    tasks = []
    for source in sources:
        if source.name in known:
            with _or_aside(source.name, aside):
                _check(source, known[source.name], parameters, demand)
                tasks.append(_Task(source, known[source.name], folder.resolve(), parameters))
    if not tasks and not former:
        (reason, *_), *others = (aside[name] for name in sorted(aside))
        raise ValueError(f"none of {len(aside)} sequences can be prepared: {reason}" if others else reason)
    if first and (left := _left_out(tasks, parameters, first)):
        warnings.warn(left, stacklevel=2)
    with _held(folder):
        # Another run may have used the folder since.
        _agree(folder, _earlier(folder, resume), about)
        done = _finish(tasks, folder, about, aside, jobs, scheduler)
        gone = [name for name in _others(folder, {source.name for source in sources}) if name not in aside]
        why = "of an earlier run, and no sequence of the inputs has its name: give its inputs, or remove it"
        aside |= {name: (f"{folder / name}: {why}",) for name in gone}
        names = [task.source.name for task in tasks if task.source.name in done]
        _sum_up(folder, about, names, aside, complete=not aside)
    return Prepared(
        folder, tuple(names), sum(done.values()), dict(sorted(aside.items())), images, first, tuple(sorted(gone))
    )


def _whole(name: str, value: Any) -> int:
    """A number as Python's own, which manifests can have."""
    try:
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None


def _check_arguments(
    given: list[Path],
    folder: Path,
    sizes: Sequence[str],
    crop: tuple[int, int] | None,
    crops: int,
    format: str,
    jobs: int | None,
) -> None:
    """Raise `ValueError` if one is out of range, or the folder lies in the inputs."""
    if jobs is not None and jobs < 1:
        raise ValueError(f"jobs: expected at least 1, got {jobs}")
    if crops < 1:
        raise ValueError(f"crops: expected at least 1, got {crops}")
    if crop is None and crops > 1:
        raise ValueError(f"crops: expected a size in crop beside it, got {crops} alone")
    if crop is not None and min(crop) < 1:
        raise ValueError(f"crop: expected at least 1 x 1, got {crop[0]} x {crop[1]}")
    if format not in _WRITERS:
        raise ValueError(f"format: expected zarr or exr, got {format}")
    if not sizes or not {*sizes} <= {"full", "half"}:
        raise ValueError(f"sizes: expected full, half or both, got {', '.join(sizes) or 'none'}")
    for path in given:
        if folder.resolve() == path.resolve() or path.resolve() in folder.resolve().parents:
            raise ValueError(f"{folder}: lies in {path}, which is read; choose a folder elsewhere")


def _check_links(given: list[Path], folder: Path, sources: Sequence[Source]) -> None:
    """Raise `ValueError` if the folder lies in one to which a link in the inputs leads: a later run would read it."""
    above = {folder.resolve(), *folder.resolve().parents}
    searched = dict.fromkeys(
        parent
        for source in sources
        for root in given
        for parent in source.files[0].parents
        if parent.is_relative_to(root)
    )
    for path in searched:
        if path.resolve() in above:
            raise ValueError(f"{folder}: lies in {path}, which is read; choose a folder elsewhere")


@contextmanager
def _or_aside(name: str, aside: dict[str, tuple[str, ...]]) -> Iterator[None]:
    """Set a sequence aside if its inputs cannot be used."""
    try:
        yield
    except Damaged as error:
        aside[name] = error.args


def _finish(
    tasks: list[_Task],
    folder: Path,
    about: dict[str, Any],
    aside: dict[str, tuple[str, ...]],
    jobs: int | None,
    scheduler: str | None,
) -> dict[str, int]:
    """Run the tasks that are not done yet: the frames of all that are done; the others are added to those set aside."""
    _clear(folder)
    done = {task.source.name: task.known.frames for task in tasks if _finished(task)}
    waiting = [task for task in tasks if task.source.name not in done]
    _space(folder, sum(task.parameters.bytes(task.known) for task in waiting))
    with _connected(scheduler) if scheduler and waiting else nullcontext() as client:
        # Written after all that can be refused, as a later run is held to these parameters.
        _sum_up(folder, about, done, aside, complete=False)
        try:
            with closing(_run(waiting, jobs, client, done=sum(done.values()))) as results:
                for result in results:
                    if result.failed:
                        raise OSError(*result.failed)
                    if result.damaged:
                        aside[result.name] = result.damaged
                    else:
                        done[result.name] = result.frames
                        for message in result.warned:
                            warnings.warn(f"{result.name}: {message}", stacklevel=3)
        finally:
            _clear(folder)
    return done


def _chosen(
    buffers: Sequence[str] | None, former: dict[str, dict[str, Any]], known: dict[str, Known]
) -> tuple[tuple[str, ...], str, str]:
    """The images to make, in the order of `CHANNELS`; the sequence that chose them, if one did; who demands them."""
    demand = "--buffers asks for it"
    if buffers is None:
        first = next(iter(known), "")
        allowed = known[first].buffers if first else {"color"}
        images = tuple(name for name in CHANNELS if needs(name, allowed) is None)
        buffers = former["parameters"].get("buffers") if former else None
        if buffers is None or list(images) == buffers:
            return images, first, f"{first}, the first sequence, has it; --buffers chooses"
        demand = "the set has it"
    for name in buffers:
        if name not in CHANNELS:
            raise ValueError(f"buffers: expected some of {', '.join(CHANNELS)}, got {name}")
    if not buffers:
        raise ValueError(f"buffers: expected some of {', '.join(CHANNELS)}, got none")
    return tuple(name for name in CHANNELS if name in buffers), "", demand


def _left_out(tasks: list[_Task], parameters: Parameters, first: str) -> str:
    """A warning if sequences have buffers that the set will lack, because the first one does."""
    others = [name for name in CHANNELS if name not in DERIVED and name not in parameters.buffers]
    more = {task.source.name: {name for name in others if not needs(name, task.known.buffers)} for task in tasks}
    left = [name for name in others if any(name in own for own in more.values())]
    where = few([name for name, own in more.items() if own])
    why = f"the images are those that {first}, the first sequence, allows; --buffers chooses"
    return f"{where}: left out: {', '.join(left)}: {why}" if left else ""


def _check(source: Source, known: Known, parameters: Parameters, demand: str) -> None:
    """Raise `Damaged` if a sequence lacks something."""
    # Nothing leads from the first frame, here the only one, to an earlier one.
    names = {*known.buffers, "motion"} if known.frames == 1 else known.buffers
    for name in parameters.buffers:
        if lacks := needs(name, names):
            raise Damaged(f"{source.files[0]}: {lacks}, but {demand}")
    for _ in parameters.groups(source.name, known):
        pass


def _about(parameters: Parameters) -> dict[str, Any]:
    packages = {"zarr": "zarr", "exr": "OpenEXR"}[parameters.format]
    versions = {"yester": __version__, "numpy": np.__version__, packages: metadata.version(packages)}
    # Bits of the history are the same on all processors of one kind.
    versions["machine"] = platform.machine()
    return {"parameters": json.loads(json.dumps(asdict(parameters))), "versions": versions}


def _earlier(folder: Path, resume: bool) -> dict[str, dict[str, Any]]:
    """Parameters and versions of the earlier run; empty if there was none."""
    if not resume:
        if _occupied(folder):
            raise FileExistsError(
                errno.EEXIST, "exists already and is not empty; --resume goes on with it", str(folder)
            )
        return {}
    path = folder / MANIFEST
    if not path.exists():
        if _occupied(folder):
            raise ValueError(f"{folder}: nothing to resume: it has no {MANIFEST}, but other files")
        return {}
    try:
        former = json.loads(path.read_text("utf-8"))
        return {kind: dict(former[kind]) for kind in ("parameters", "versions")}
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: truncated or corrupt: {error}; prepare into another folder") from None


def _agree(folder: Path, former: dict[str, dict[str, Any]], about: dict[str, dict[str, Any]]) -> None:
    """Raise `ValueError` if the earlier run had other parameters or versions."""
    for kind, values in former.items():
        for name, value in about[kind].items():
            if (got := values.get(name)) != value:
                where = folder / MANIFEST
                raise ValueError(f"{where}: expected the same {kind} to resume, got {name} {got}, now {value}")


def _occupied(folder: Path) -> bool:
    """Whether a folder has something other than what a run that was killed at once leaves there."""
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    return not all(_HALF.fullmatch(name) or _LOCK.fullmatch(name) for name in names)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Make the set's folder, and hold it for this run; raise if another one of this machine does."""
    here = folder.resolve()
    with _CHANGING:
        if here in _IN_USE:
            raise OSError(errno.EBUSY, "another run of this process uses it", str(folder))
        _IN_USE.add(here)
    try:
        with _locked(folder):
            yield
    finally:
        _IN_USE.discard(here)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Make the set's folder, and lock it for this process; raise if another one of this machine does.

    A folder that was absent is removed if nothing was written.
    """
    own = folder / f".run.{os.getpid()}.tmp"
    absent = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Open until the end: Windows removes no file that is, and has no other way to tell.
        file = own.open("wb")
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(folder)) from None
    try:
        with file:
            # Of two runs that begin at once, at least one sees the other, as each writes its own lock first.
            for lock in folder.iterdir():
                if lock == own or not _LOCK.fullmatch(lock.name):
                    continue
                used = in_use(lock)
                try:
                    if not used:
                        lock.unlink(missing_ok=True)
                except PermissionError:
                    used = True
                if used:
                    number = lock.name.split(".")[-2]
                    used_by = f"another run, process {number}, uses it; if it does not, remove {lock.name}"
                    raise OSError(errno.EBUSY, used_by, str(folder))
            yield
    finally:
        own.unlink(missing_ok=True)
        if absent:
            with suppress(OSError):  # not empty
                folder.rmdir()


def _others(folder: Path, known: set[str]) -> Iterator[str]:
    """The sequences that a folder has besides the known ones."""
    for where, inner, names in os.walk(folder):
        if where != str(folder) and MANIFEST in names:
            # Arrays have many files, and no sequences.
            inner.clear()
            name = Path(where).relative_to(folder).as_posix()
            if name not in known:
                yield name


def _sum_up(
    folder: Path, about: dict[str, Any], names: Iterable[str], aside: dict[str, tuple[str, ...]], *, complete: bool
) -> None:
    """Write the manifest of a set that has these sequences."""
    sequences = {}
    for name in names:
        path = folder / name / MANIFEST
        known = json.loads(path.read_text("utf-8"))
        sequences[name] = {key: known[key] for key in ("frames", "height", "width")}
        sequences[name]["manifest_sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    # Where inputs lie is no business of the set's: names are enough, and paths would differ from disk to disk.
    _write(
        folder / MANIFEST,
        {**about, "complete": complete, "sequences": sequences, "set_aside": dict(sorted(aside.items()))},
    )


def _write(path: Path, content: dict[str, Any]) -> None:
    with beside(path) as temporary:
        # Of a name that is not UTF-8, the escapes are those of JSON.
        temporary.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", "utf-8", "backslashreplace")


def _finished(task: _Task) -> bool:
    """Whether a sequence is there, made of these inputs, and none of its files is absent or empty."""
    try:
        known = json.loads((task.target / MANIFEST).read_text("utf-8"))
        return task.inputs().items() <= known.items() and all(
            (task.target / path).stat().st_size for path in known["sha256"]
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):  # absent, no JSON, or of another structure
        return False


def _space(folder: Path, needed: int) -> None:
    free = shutil.disk_usage(folder).free
    if needed > free:
        need = f"up to {needed / 1e9:.3g} GB are needed and {free / 1e9:.3g} GB are free"
        raise OSError(errno.ENOSPC, f"{need}: fewer buffers or crops, float16 or another disk", str(folder))


# One sequence


def _work(task: _Task, told: Callable[[], object] = lambda: None) -> _Done:
    """Prepare one sequence: written beside and renamed."""
    name, target = task.source.name, task.target
    if _finished(task):  # by a worker that had been given up
        return _Done(name, task.known.frames)
    temporary, former = (task.folder / f".{_key(name)}.{uuid4().hex}.tmp" for _ in range(2))
    try:
        if found := _in_the_way(task):
            raise Damaged(f"{few(found)}: of an earlier run, and in the way of {name}: to be removed first")
        temporary.mkdir()
        (temporary / _BEGUN).touch()
        warned = _fill(task, temporary, told)
        target.parent.mkdir(parents=True, exist_ok=True)
        if (target / MANIFEST).is_file() and not _finished(task):
            # Made of other inputs, or damaged: moved away first, so that a killed process leaves no half of a folder.
            with suppress(FileNotFoundError):  # by a worker that had been given up
                target.rename(former)
        try:
            temporary.rename(target)
        except OSError as error:
            if not _finished(task):
                if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
                    raise Damaged(f"{target}: has files that are of no run: remove it") from None
                raise OSError(error.errno, error.strerror, str(target)) from None
        return _Done(name, task.known.frames, warned)
    except Damaged as error:
        return _Done(name, damaged=error.args)
    except OSError as error:
        reason = error.strerror or str(error)
        if error.errno == errno.ENAMETOOLONG:  # which other sequences need not be
            return _Done(name, damaged=(f"{target}: {reason}",))
        return _Done(name, failed=(error.errno or errno.EIO, reason, str(error.filename or target)))
    finally:
        for half in (temporary, former):
            shutil.rmtree(half, ignore_errors=True)


def _in_the_way(task: _Task) -> list[Path]:
    """Sequences of earlier runs whose folders have this one's in them, or lie in it."""
    above = (task.folder / folder for folder in PurePosixPath(task.source.name).parents if folder.name)
    found = [folder for folder in above if (folder / MANIFEST).is_file()]
    return found or [task.target / name for name in _others(task.target, set())]


def _key(name: str) -> str:
    """Stands for a sequence in names: one of its own, and short."""
    return hashlib.sha256(os.fsencode(name)).hexdigest()[:32]


def _half_written(folder: Path, name: str | None = None) -> list[Path]:
    """What is half-written: of one sequence, or of all."""
    half = _HALF if name is None else re.compile(rf"\.{_key(name)}\.[0-9a-f]{{32}}\.tmp")
    return [item for item in folder.iterdir() if half.fullmatch(item.name)]


def _clear(folder: Path, name: str | None = None) -> None:
    """Remove what is half-written: of one sequence, or of all."""
    for item in _half_written(folder, name):
        if item.is_dir():
            # All at once, as a worker of another machine may still write into it.
            gone = item.with_name(f"{item.name.rsplit('.', 2)[0]}.{uuid4().hex}.tmp")
            with suppress(OSError):
                item.rename(gone)
            for each in (gone, item):
                shutil.rmtree(each, ignore_errors=True)
        else:
            item.unlink(missing_ok=True)


def _fill(task: _Task, folder: Path, told: Callable[[], object]) -> tuple[str, ...]:
    """Write the images of a sequence and its manifest; the warnings."""
    source, known, parameters = task.source, task.known, task.parameters
    groups = [*parameters.groups(source.name, known)]
    warned = dict.fromkeys(source.inspect(parameters.buffers))
    writer = _WRITERS[parameters.format](folder, known.frames, parameters.half)
    missing: list[int] = []
    untold: list[int] = []
    wanted = {*parameters.buffers}
    if "half" in parameters.sizes:
        wanted |= {"depth", *(("validity",) if "history" in wanted else ())}
    read: list[Frame] = []
    made = derive(iter(read.pop, None), wanted, warned.setdefault)
    with closing(ahead(source.read())) as frames:
        for index, (frame, reference, remarks) in enumerate(frames):
            path = source.files[min(index, len(source.files) - 1)]
            read.append(frame)
            warned |= dict.fromkeys(remarks)
            try:
                images, absent = next(made)
            except (TypeError, ValueError) as error:
                raise Damaged(f"{path}: {error}") from None
            missing.append(absent)
            if "reference" in wanted:
                if reference is None or reference.shape != (known.height, known.width, 3):
                    raise Damaged(f"{source.files[0]}: frame {index}: no reference of the same size")
                images["reference"] = reference
                untold.append(int((~np.isfinite(reference).all(-1)).sum()))
            if lacks := [name for name in parameters.buffers if name not in images]:
                raise Damaged(f"{path}: no {lacks[0]}, which the first frame of the sequence has")
            depth, validity = images.get("depth"), images.get("validity")
            unseen = np.asarray(~np.isfinite(frame.color).all(-1))
            images = {name: images[name] for name in parameters.buffers}
            full, lacking = filled(images)
            warned |= dict.fromkeys([*lacking, *clipped(images, parameters.half)])
            for group, rows, columns in groups:
                if "full" in parameters.sizes:
                    cut = {name: image[rows, columns] for name, image in full.items()}
                    writer.write(index, "/".join(filter(None, (group, "full"))), cut)
                if "half" in parameters.sizes:
                    # Missing pixels are left out of its means.
                    cut = {name: image[rows, columns] for name, image in images.items()}
                    near, carried = (None if one is None else one[rows, columns] for one in (depth, validity))
                    small = halve(cut, near, carried, unseen[rows, columns])
                    writer.write(index, "/".join(filter(None, (group, "half"))), filled(small)[0])
            told()
    if len(missing) < known.frames:
        raise Damaged(f"{source.files[0]}: expected {known.frames} frames, got {len(missing)}")
    try:
        (folder / _BEGUN).unlink()
    except FileNotFoundError:
        raise OSError(errno.ENOENT, "was removed while it was written", str(folder)) from None
    _write(
        folder / MANIFEST,
        {
            **task.inputs(),
            "missing_pixels": missing,
            **({"missing_reference_pixels": untold} if "reference" in wanted else {}),
            "warnings": [*warned],
            "crops": {g: {"x": c.start, "y": r.start} for g, r, c in groups if g},
            "sha256": checksums(folder),
        },
    )
    return tuple(warned)


# Many sequences


def _run(tasks: list[_Task], jobs: int | None, client: Any, *, done: int) -> Generator[_Done, None, None]:
    """Run the tasks, and show progress in frames."""
    from tqdm import tqdm

    total = done + sum(task.known.frames for task in tasks)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    jobs = min(jobs or cores, max(len(tasks), 1))
    with tqdm(desc="prepare", total=total, initial=done, unit="frame", disable=None) as progress:
        if not tasks:
            return
        if client is None and jobs == 1:
            for task in tasks:
                yield _work(task, progress.update)
            return
        frames = {task.source.name: task.known.frames for task in tasks}
        results = _on_cluster(tasks, client) if client else _in_processes(tasks, jobs, cores)
        with closing(results):
            for result in results:
                progress.update(frames[result.name])
                yield result


def _lost(name: str) -> _Done:
    return _Done(name, damaged=(f"{name}: the process that worked on it died {_ATTEMPTS} times",))


def _in_processes(tasks: list[_Task], jobs: int, cores: int) -> Generator[_Done, None, None]:
    context = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    stopped = threading.Event()
    free: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()

    # One pool per process, as a process that dies takes its pool's other tasks with it.
    def start() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, context, _start, (max(1, cores // jobs),))

    def attempt(task: _Task) -> _Done:
        name = task.source.name
        for _ in range(_ATTEMPTS):
            pool = free.get()
            try:
                return pool.submit(_work, task).result()
            except BrokenProcessPool:
                pool = start()
                _clear(task.folder, name)
                if stopped.is_set():
                    break
            finally:
                # Whatever went wrong, other threads wait for it.
                free.put(pool)
        return _lost(name)

    with ThreadPoolExecutor(jobs) as threads:
        for _ in range(jobs):
            free.put(start())
        futures = [threads.submit(attempt, task) for task in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            stopped.set()
            threads.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                if child not in others:
                    child.terminate()
            raise
    while not free.empty():
        free.get().shutdown()


def _start(threads: int) -> None:
    """Begin a process: with its share of the cores, and no longer than the one that started it."""
    os.environ.setdefault("YESTER_THREADS", str(threads))
    # An interrupt is seen to by the one that started it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _connected(address: str) -> Any:
    """A client of a Dask scheduler."""
    try:
        from distributed import Client
        from distributed.comm import resolve_address
    except ImportError as error:
        raise ImportError("a scheduler needs dask and distributed: pip install 'yester[data]'") from error
    try:
        # A client that fails at once, as without a port, blocks for seconds when it is deleted.
        resolve_address(address)
        return Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise OSError(f"{address}: no Dask scheduler can be reached: {error}") from None


def _attempt(task: _Task) -> _Done:
    """Work on a cluster, whose scheduler has its own number of times that a task is tried."""
    # Each worker that died of it has left its half.
    if len(_half_written(task.folder, task.source.name)) >= _ATTEMPTS:
        return _lost(task.source.name)
    return _work(task)


def _on_cluster(tasks: list[_Task], client: Any) -> Generator[_Done, None, None]:
    from distributed import as_completed as completed
    from distributed.scheduler import KilledWorker

    run = uuid4().hex
    # Workers that vanish are seen to by the scheduler; only tasks are told apart here.
    futures = {
        client.submit(
            _attempt, task.anywhere(), key=f"prepare-{_key(task.source.name)}-{run}", pure=False, retries=_ATTEMPTS - 1
        ): task
        for task in tasks
    }
    for future in completed(futures, loop=client.loop):
        task = futures[future]
        try:
            result = future.result()
        except KilledWorker:
            result = _lost(task.source.name)
        if not result.damaged and not result.failed and not _finished(task):
            raise OSError(
                f"{task.target}: not here, though a worker wrote it: the workers and this machine must share the folder"
            )
        yield result
