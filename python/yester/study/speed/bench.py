"""Times every kernel and pipeline, beside other libraries and the machine's limits.

Each task of `tasks.TASKS` is run at every size with every setting of threads and SIMD level. Both are fixed when the
core is loaded, so that every setting has its own process, and rivals have one for each number of threads. The processes
run one at a time, in turns whose order rotates, so that disturbances affect all of them alike. Every few tasks, each
setting measures the machine's limits: the bandwidth of copies and the rate of multiply-adds.

A run is the mean of as many calls as fill 20 ms, at least one. Reports median and quartiles after warm-up (the first
run); slow contenders get fewer runs: three, if these take more than `PATIENCE` seconds in all, and one, if the first
alone did. References, which are very slow, are run up to 1920×1080 with the most threads. Beyond that size, rivals also
have the most threads, and ours only the best SIMD level. Outputs are written to the arrays of the previous call, also
by rivals that support it.

The minimal traffic of a kernel is its images, each read or written once. The fraction of its limit is the time for that
traffic at the bandwidth of copies, or for its multiply-adds at their rate if they have been counted and take longer,
divided by its own time. Small images stay in caches, which are faster: their fraction may exceed one. State that
pipelines keep between frames is not counted.

The memory of a pipeline is the growth of its own process, from before it is constructed to the peak of a few steps,
without the output images.
"""

from __future__ import annotations

import math
import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import numpy as np
from tqdm import tqdm

import yester
from yester import _core
from yester.io.files import beside

from ..compare.peers import imports
from ..compare.report import save_figure
from . import rivals
from .tasks import TASKS, Call, Inputs, Task, stage
from .timings import HD, OURS, Limits, Memory, Timing, draw, markdown, write_csv

__all__ = ["CALM", "LEVELS", "PATIENCE", "chosen", "measure", "resident", "run", "settings", "staged"]

#: Instruction sets, each with all before it; neon stands alone.
LEVELS = ("baseline", "avx2", "avx512")
#: Seconds after which a contender gets no further runs beyond the minimum, that minimum, and a run's shortest duration.
PATIENCE, _FEWEST, _SHORTEST = 4.0, 3, 0.02
#: Tasks.
_LIMITS_EVERY = 4
#: Steps over which a pipeline's memory is measured, and steps after which it should not grow any more.
_STEPS, _SETTLED = 12, 3
#: Seconds for which the threads of some rivals keep spinning after their work.
CALM = 0.02


def settings(threads: Sequence[int] | None = None, simd: Sequence[str] | None = None) -> list[tuple[int, str]]:
    """List the settings: all numbers of threads with the best SIMD level, and all levels with the most threads.

    Parameters
    ----------
    threads : sequence of int, optional
        By default one, and all that there are.
    simd : sequence of str, optional
        Levels; by default all that the machine has.

    Returns
    -------
    list of (int, str)
        The most threads with the best level first.

    Raises
    ------
    ValueError
        If this process could not use as many threads, or that level.
    """
    most, best = _core.settings()
    known = LEVELS[: LEVELS.index(best) + 1] if best in LEVELS else (best,)
    for number in threads or ():
        if not 1 <= number <= most:
            raise ValueError(f"threads: expected 1 to {most}, got {number}")
    for level in simd or ():
        if level not in known:
            raise ValueError(f"simd: expected some of {', '.join(known)}, got {level}")
    counts = sorted({*(threads or (1, most))}, reverse=True)
    names = [level for level in reversed(known) if level in (simd or known)]
    return [*((count, names[0]) for count in counts), *((counts[0], level) for level in names[1:])]


def chosen(only: Sequence[str] | None = None) -> list[Task]:
    """Choose tasks by beginnings of their names; by default, all that can be run here.

    Raises
    ------
    ValueError
        If no name begins like that.
    """
    for one in only or ():
        if not any(task.name.startswith(one) for task in TASKS):
            raise ValueError(f"only: expected beginnings of {'; '.join(task.name for task in TASKS)}, got {one}")
    here = [task for task in TASKS if task.function != "OIDN" or imports("pyoidn")]
    return [task for task in here if not only or task.name.startswith(tuple(only))]


def run(
    folder: Path,
    tasks: Sequence[Task],
    sizes: Sequence[tuple[int, int]],
    settings: Sequence[tuple[int, str]],
    *,
    repetitions: int = 7,
    compare: bool = True,
) -> str:
    """Measure, and write ``bench.csv``, ``targets.csv``, ``bench.md`` and ``bench.svg``.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.
    tasks, sizes, settings, repetitions
        As for `measure`.
    compare : bool, default True
        Whether to time rivals, too.

    Returns
    -------
    str
        The contents of ``bench.md``.
    """
    missing = rivals.missing() if compare else {}
    timings = measure(tasks, sizes, settings, repetitions=repetitions, absent=missing if compare else None)
    about = f"yester {yester.__version__} on {_machine()}: medians of up to {repetitions} runs, in turn"
    page = markdown(timings, about=about, missing=[f"{name}: {remedy}" for name, remedy in missing.items()])
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(timings, folder)
    with beside(folder / "bench.md") as temporary:
        temporary.write_text(page, encoding="utf-8")
    with beside(folder / "bench.svg") as temporary, temporary.open("wb") as file:
        save_figure(draw(timings), file, "svg")
    return page


def _machine() -> str:
    """The processor's name, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


@dataclass
class _Entrant:
    """A contender in one setting, and what it has done."""

    name: str
    setting: tuple[int, str]
    worker: _Worker
    bytes: int = 0
    memory: Memory | None = None
    #: Milliseconds of the first run, and of those after it.
    first: float = 0.0
    runs: list[float] = field(default_factory=list)

    def prepare(self, task: Task, inputs: tuple[Path, int, int]) -> None:
        self.bytes, self.first = self.worker.ask("prepare", self.name, task.name, inputs)

    def take_turn(self) -> None:
        patience = 1e3 * PATIENCE
        fewest = _FEWEST if self.first < patience else 1
        if len(self.runs) < fewest or self.first + sum(self.runs) < patience:
            self.runs.append(self.worker.ask("run", self.name))


def measure(
    tasks: Sequence[Task],
    sizes: Sequence[tuple[int, int]],
    settings: Sequence[tuple[int, str]],
    *,
    repetitions: int = 7,
    absent: Iterable[str] | None = (),
) -> list[Timing]:
    """Time tasks, in turn with their rivals.

    Parameters
    ----------
    tasks : sequence of Task
    sizes : sequence of (int, int)
        Width and height.
    settings : sequence of (int, str)
        Numbers of threads and SIMD levels: the most threads with the best level first.
    repetitions : int, default 7
        Runs of each, at most.
    absent : iterable of str, default none
        Libraries of rivals that are to be left out; None leaves out all rivals.

    Returns
    -------
    list of Timing
        Those of one size and task stand together, ours before the rivals'.

    Raises
    ------
    ValueError
        If there are to be no repetitions.
    OSError
        If a process ends, as it does where memory is short.
    """
    if repetitions < 1:
        raise ValueError(f"repetitions: expected at least 1, got {repetitions}")
    measured: list[tuple[Task, tuple[int, int], _Entrant]] = []
    small = [size for size in sizes if math.prod(size) <= math.prod(HD)]
    weighed = max(small, key=math.prod) if small else min(sizes, key=math.prod)
    limits: dict[tuple[int, str], list[tuple[float, float]]] = {setting: [] for setting in settings}
    with ExitStack() as stack:
        ours = {setting: stack.enter_context(_Worker(*setting)) for setting in settings}
        counts = dict.fromkeys(threads for threads, _ in settings)
        others = {} if absent is None else {n: stack.enter_context(_Worker(n)) for n in counts}
        progress = stack.enter_context(tqdm(total=len(sizes) * len(tasks), unit="task", disable=None))
        for size in sizes:
            title = "×".join(map(str, size))
            progress.set_description(f"{title}: images")
            with staged(*size) as folder:
                for number, task in enumerate(tasks):
                    progress.set_description(f"{title}: {task.name}")
                    entrants = [*_ours(ours, size), *_rivals(others, task, size, absent or ())]
                    for entrant in entrants:
                        if entrant.name == OURS and number % _LIMITS_EVERY == 0:
                            limits[entrant.setting].append(entrant.worker.ask("limits"))
                    inputs = (folder, *size)
                    if task.pipeline and size == weighed:
                        with _Worker(*settings[0]) as alone:
                            entrants[0].memory = alone.ask("memory", task.name, inputs)
                    _race(entrants, task, inputs, repetitions)
                    measured += [(task, size, entrant) for entrant in entrants]
                    progress.update()
    # In 10⁹/s.
    allowed = {setting: Limits(*(np.median(found, 0) / 1e9).tolist()) for setting, found in limits.items() if found}
    return [
        Timing(
            *(task.name, entrant.name, size, *entrant.setting, tuple(entrant.runs)),
            *(entrant.bytes, task.multiply_adds, allowed.get(entrant.setting), entrant.memory),
        )
        for task, size, entrant in measured
    ]


def _ours(workers: Mapping[tuple[int, str], _Worker], size: tuple[int, int]) -> Iterator[_Entrant]:
    """In every setting; beyond 1920×1080 with the best level only."""
    best = next(iter(workers))[1]
    for setting, worker in workers.items():
        if math.prod(size) <= math.prod(HD) or setting[1] == best:
            yield _Entrant(OURS, setting, worker)


def _rivals(
    workers: Mapping[int, _Worker], task: Task, size: tuple[int, int], absent: Iterable[str]
) -> Iterator[_Entrant]:
    """With every number of threads; beyond 1920×1080, and references, with the most; there, no references."""
    small = math.prod(size) <= math.prod(HD)
    for threads, worker in workers.items():
        most = threads == max(workers)
        for name in (*task.rivals, rivals.REFERENCE):
            runs = small and most and task.function != "OIDN" if name == rivals.REFERENCE else small or most
            if runs and rivals.library(name) not in absent:
                yield _Entrant(name, (threads, ""), worker)


def _race(entrants: Sequence[_Entrant], task: Task, inputs: tuple[Path, int, int], repetitions: int) -> None:
    for entrant in entrants:
        entrant.prepare(task, inputs)
    for i in range(repetitions):
        for number in (*range(i % len(entrants), len(entrants)), *range(i % len(entrants))):
            entrants[number].take_turn()
    for entrant in entrants:
        entrant.worker.ask("forget")


class _Worker:
    """A worker process with its own setting."""

    def __init__(self, threads: int, simd: str = "") -> None:
        context = get_context("spawn")
        self._pipe, end = context.Pipe()
        self._process = context.Process(target=_serve, args=(end,), daemon=True)
        # Ctrl-C is for the process that asks, from the very beginning of this one.
        with _environment(YESTER_THREADS=str(threads), YESTER_SIMD=simd), _on_interrupt(signal.SIG_IGN):
            self._process.start()
        end.close()

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()
        self._pipe.close()

    def ask(self, *request: Any) -> Any:
        try:
            self._pipe.send(request)
            answer = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            code = self._process.exitcode
            raise OSError(f"a process of the benchmark has ended with code {code}: is memory short?") from None
        if isinstance(answer, Exception):
            raise answer
        return answer


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextmanager
def staged(width: int, height: int) -> Iterator[Path]:
    """The images of one size, in a temporary folder that is removed even if Ctrl-C is pressed while it is created."""
    heard: list[int] = []
    with _on_interrupt(lambda number, _: heard.append(number)):
        made = TemporaryDirectory(prefix="yester-bench-")
    with made as name:
        if heard:
            raise KeyboardInterrupt
        stage(Path(name), width, height)
        yield Path(name)


@contextmanager
def _on_interrupt(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> Iterator[None]:
    """Do something else on Ctrl-C; processes that start meanwhile go on ignoring it if this one does."""
    if threading.current_thread() is not threading.main_thread():
        # Only that one hears it, and may decide.
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(pipe: Connection) -> None:
    """Serve requests until the pipe is closed."""
    tasks = {task.name: task for task in TASKS}
    calls: dict[str, Call] = {}
    while True:
        try:
            request = pipe.recv()
        except EOFError:
            return
        try:
            match request:
                case ("limits",):
                    answer: object = _core.machine_limits()
                case "prepare", contender, name, inputs:
                    task, images = tasks[name], Inputs(*inputs)
                    calls[contender] = (
                        task.start(images) if contender == OURS else rivals.start(contender, task, images)
                    )
                    answer = calls[contender].bytes, _timed(calls[contender].run)
                case "run", contender:
                    answer = _timed(calls[contender].run)
                case "memory", name, inputs:
                    answer = _memory(tasks[name], Inputs(*inputs))
                case ("forget",):
                    calls.clear()
                    answer = None
            pipe.send(answer)
        except Exception as error:
            pipe.send(error)


def _timed(run: Callable[[], object]) -> float:
    """Milliseconds of one call."""
    start, calls, elapsed = time.perf_counter(), 0, 0.0
    while elapsed < _SHORTEST:
        run()
        calls, elapsed = calls + 1, time.perf_counter() - start
    time.sleep(CALM)
    return 1e3 * elapsed / calls


def _memory(task: Task, images: Inputs) -> Memory | None:
    """The memory of a pipeline, if the system reports it."""
    frames = task.frames(images)
    try:
        before, _ = resident()
    except OSError:
        return None
    call = task.start(images, frames)
    held = []
    for _ in range(_STEPS):
        call.run()
        held.append(resident())
    (settled, _), (end, most) = held[_SETTLED - 1], held[-1]
    return Memory(most - before - 1e-6 * call.made, end - settled)


def resident() -> tuple[float, float]:
    """Current and peak resident memory of this process in MB (Linux only: psutil does not tell the peak)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    known = {name: text.split() for name, _, text in (line.partition(":") for line in lines)}
    now, most = (1.024e-3 * int(known[name][0]) for name in ("VmRSS", "VmHWM"))
    return now, most
