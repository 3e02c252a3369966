"""Kernels in forked workers and in many threads: the same results, no deadlock, and Python runs on meanwhile."""

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
import yester
from calls import arrays, calls
from compare import assert_same_bits

TIMEOUT = 60  # seconds; only a deadlock takes as long
# Forking a process with threads is what is tested here; from 3.12 on Python warns of it.
pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")


def work(seed: int) -> list[np.ndarray]:
    return [array for function, given in calls(40, 50, seed).values() for array in arrays(function(**given))]


def check(got, seed: int) -> None:
    for one, other in zip(got, work(seed), strict=True):
        assert_same_bits(np.asarray(one), other)


def send(queue, seed: int) -> None:
    queue.put(work(seed))


def test_fork_after_use():
    work(0)  # Starts the parent's threads, which a fork does not copy.
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    children = [context.Process(target=send, args=(queue, seed), daemon=True) for seed in (1, 1)]
    for child in children:
        child.start()
    try:
        for _ in children:
            check(queue.get(timeout=TIMEOUT), 1)
    finally:
        for child in children:
            child.kill()


def test_fork_of_a_network():
    """It goes on with the history of its parent, which it shares with none."""
    rng = np.random.default_rng(0)
    first, second = (yester.Frame(rng.random((32, 40, 3)), albedo=np.ones((32, 40, 3))) for _ in range(2))
    oidn, other = (yester.OIDN("fast", temporal=True) for _ in range(2))
    oidn.step(first)
    other.step(first)
    want = other.step(second).color
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=lambda: queue.put(oidn.step(second).color), daemon=True)
    child.start()
    try:
        assert_same_bits(queue.get(timeout=TIMEOUT), want)
        assert_same_bits(oidn.step(second).color, want)
        child.join(TIMEOUT)
        assert child.exitcode == 0
    finally:
        child.kill()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_the_end_of_a_process_forked_beside_a_network():
    """Its interpreter frees what it has, which must not wait for the network's threads."""
    code = """if True:
        import os
        import signal
        import numpy as np
        import yester

        oidn = yester.OIDN("fast")
        oidn.step(yester.Frame(np.ones((32, 32, 3))))
        if child := os.fork():
            assert os.waitpid(child, 0)[1] == 0
        signal.alarm(30)
    """
    run = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    assert done.returncode == 0, done.stderr


class Frames(torch.utils.data.Dataset):
    def __len__(self):
        return 4

    def __getitem__(self, index):
        return [torch.from_numpy(array) for array in work(index)]


def test_data_loader_workers():
    work(0)
    loader = torch.utils.data.DataLoader(
        Frames(), batch_size=None, num_workers=2, timeout=TIMEOUT, multiprocessing_context="fork"
    )
    for seed, result in enumerate(loader):
        check([image.numpy() for image in result], seed)


def test_many_threads_at_once():
    wants = [work(seed) for seed in range(4)]
    with ThreadPoolExecutor(8) as pool:
        jobs = [(seed, pool.submit(work, seed)) for seed in [0, 1, 2, 3] * 4]
        for seed, job in jobs:
            for got, want in zip(job.result(TIMEOUT), wants[seed], strict=True):
                assert_same_bits(got, want)


def test_one_pipeline_in_two_threads():
    """A pipeline has one state: calls from two threads take turns, or are refused; none is lost or mixed up."""
    svgf = yester.SVGF()
    frame = yester.Frame(np.ones((64, 64, 3), np.float32))
    with ThreadPoolExecutor(4) as pool:
        results = [job.exception(TIMEOUT) or job.result() for job in [pool.submit(svgf.step, frame) for _ in range(16)]]
    done = [result for result in results if not isinstance(result, Exception)]
    refused = [result for result in results if isinstance(result, Exception)]
    assert all(isinstance(error, RuntimeError) for error in refused)
    assert sorted(result.history_length.max() for result in done) == list(range(1, len(done) + 1))


@pytest.mark.parametrize("method", [yester.SVGF, yester.HalfRes])
def test_a_pipeline_is_split_while_it_steps(method):
    """Takes turns, or is refused, as well."""
    pipeline, frame = method(), yester.Frame(np.ones((256, 256, 3), np.float32))
    done, refused = threading.Event(), []

    def steps() -> None:
        while not done.is_set():
            pipeline.step(frame)

    with ThreadPoolExecutor(1) as pool:
        job = pool.submit(steps)
        # However long it takes until a call meets a step.
        while not refused and not job.done():
            try:
                assert pipeline.split()[1] is not None
            except RuntimeError as error:
                refused.append(error)
        done.set()
        job.result(TIMEOUT)
    assert refused


def test_python_runs_on_during_a_kernel():
    """Another thread advances while a kernel works: the lock is released. Tests that it advances, not how fast."""
    color, variance = np.ones((1024, 1024, 3), np.float32), np.ones((1024, 1024), np.float32)
    inside, stop, seen = threading.Event(), threading.Event(), []

    def watch() -> None:
        while not stop.is_set():
            if inside.is_set():
                seen.append(time.monotonic())
            time.sleep(0)

    interval = sys.getswitchinterval()
    # With an interval this long the watcher advances only where the lock is released, not where it is taken away.
    sys.setswitchinterval(1000)
    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        for _ in range(20):
            inside.set()
            yester.atrous(color, variance, iterations=5)
            inside.clear()
            if seen:
                break
    finally:
        stop.set()
        sys.setswitchinterval(interval)
        watcher.join(TIMEOUT)
    assert seen
