"""Times every kernel and pipeline, other libraries, and the machine's limits.

Each task of `tasks.TASKS` runs at every size in every setting of threads and SIMD level. Both are fixed when the core
is loaded, so that every setting has its own process; rivals have one for each number of threads. The processes run one
at a time in rotating order, so that disturbances affect all of them alike. Every few tasks, each setting measures the
machine's limits: the bandwidth of copies and the rate of multiply-adds.

A run is the mean of as many calls as fill 20 ms, at least one. Reports median and quartiles after warm-up (the first
run). Slow contenders get fewer runs: three if these take more than `PATIENCE` seconds in total, one if the first alone
takes that long. The torch references, which are very slow, run up to 1920×1080 with the most threads. Above that size,
rivals have the most threads only, and this package the best SIMD level only. Outputs overwrite the arrays of the
previous call, also those of rivals that support it.

The minimal traffic of a kernel is its images, each read or written once. Its time at the limit is the time for that
traffic at the bandwidth of copies or, if counted and longer, the time for its multiply-adds at their rate. The fraction
of the limit is this time divided by the measured one. Small images stay in caches, which are faster, so that their
fraction may exceed one. State that pipelines keep between frames is not counted.

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

#: SIMD levels; each includes those before it. "neon", on other machines, is the only level there.
LEVELS = ("baseline", "avx2", "avx512")
#: Seconds after which a contender gets no runs beyond the minimum; this minimum; shortest duration of a run in seconds.
PATIENCE, _FEWEST, _SHORTEST = 4.0, 3, 0.02
#: Number of tasks between measurements of the machine's limits.
_LIMITS_EVERY = 4
#: Steps over which a pipeline's memory is measured, and steps after which it should no longer grow.
_STEPS, _SETTLED = 12, 3
#: Pause after each run in seconds: the threads of some rivals keep spinning after their work.
CALM = 0.02


def settings(threads: Sequence[int] | None = None, simd: Sequence[str] | None = None) -> list[tuple[int, str]]:
    """List the settings: all numbers of threads with the best SIMD level, and all levels with the most threads.

    Parameters
    ----------
    threads : sequence of int, optional
        By default one, and all threads.
    simd : sequence of str, optional
        Levels; by default all levels of the machine.

    Returns
    -------
    list of (int, str)
        The most threads with the best level come first.

    Raises
    ------
    ValueError
        If this process cannot use as many threads, or a level.
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
    """Choose tasks by prefixes of their names; by default, all tasks whose libraries are installed.

    Raises
    ------
    ValueError
        If no name has one of the prefixes.
    """
    for one in only or ():
        if not any(task.name.startswith(one) for task in TASKS):
            raise ValueError(f"only: expected prefixes of {'; '.join(task.name for task in TASKS)}, got {one}")
    here = [task for task in TASKS if task.function != "OIDN" or imports("mitsuba_oidn")]
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
        Output folder, created if missing.
    tasks, sizes, settings, repetitions
        As for `measure`.
    compare : bool, default True
        Whether to time rivals as well.

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
    """The processor's model and the number of cores; Linux tells the model in a file only."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


@dataclass
class _Entrant:
    """A contender in one setting, and its runs so far."""

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
    """Time tasks and their rivals, interleaved.

    Parameters
    ----------
    tasks : sequence of Task
    sizes : sequence of (int, int)
        Width and height.
    settings : sequence of (int, str)
        Numbers of threads and SIMD levels: the most threads with the best level first.
    repetitions : int, default 7
        Maximum number of runs of each contender.
    absent : iterable of str, default none
        Libraries whose rivals are left out; None leaves out all rivals.

    Returns
    -------
    list of Timing
        Ordered by size, task and contender; this package comes before its rivals.

    Raises
    ------
    ValueError
        If repetitions is below 1.
    OSError
        If a process ends unexpectedly, for example for lack of memory.
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
    """This package in every setting; above 1920×1080 only with the best level."""
    best = next(iter(workers))[1]
    for setting, worker in workers.items():
        if math.prod(size) <= math.prod(HD) or setting[1] == best:
            yield _Entrant(OURS, setting, worker)


def _rivals(
    workers: Mapping[int, _Worker], task: Task, size: tuple[int, int], absent: Iterable[str]
) -> Iterator[_Entrant]:
    """The rivals of a task with every number of threads; above 1920×1080 only with the most.

    The torch reference runs with the most threads, up to 1920×1080.
    """
    small = math.prod(size) <= math.prod(HD)
    for threads, worker in workers.items():
        most = threads == max(workers)
        for name in (*task.rivals, *([rivals.REFERENCE] if task.reference else [])):
            runs = small and most if name == rivals.REFERENCE else small or most
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
        # The worker ignores Ctrl-C from its start: the main process handles it and ends the workers.
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
            raise OSError(f"a process of the benchmark ended with code {code}, perhaps for lack of memory") from None
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
    """Write the images of one size to a temporary folder, which is removed even after Ctrl-C during its creation."""
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
    """Replace the handler of Ctrl-C. Processes that start meanwhile inherit SIG_IGN."""
    if threading.current_thread() is not threading.main_thread():
        # Signals reach the main thread only, and only it may set handlers.
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _serve(pipe: Connection) -> None:
    """Answer requests until the pipe is closed."""
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
    """Mean time of a call in milliseconds, over calls that fill `_SHORTEST` seconds."""
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
    """Current and peak resident memory of this process in MB; OSError on systems other than Linux.

    psutil has no peak on Linux, and that of `resource.getrusage` includes the process that started this one.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    known = {name: text.split() for name, _, text in (line.partition(":") for line in lines)}
    now, most = (1.024e-3 * int(known[name][0]) for name in ("VmRSS", "VmHWM"))
    return now, most
