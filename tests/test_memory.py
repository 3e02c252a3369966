"""Sizes, memory and threads: what is unavailable is an error, or done without, before anything is written."""

import ctypes
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import yester
from compare import assert_same_bits

MATRIX = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1], [0, 0, 1, 0]]


def run(code: str) -> None:
    """Run in a process of its own, so that its limits do not affect other tests."""
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("width", "height"), [(2**40, 1), (2**23, 1), (1, 2**23)])
def test_cameras_of_absurd_size(width, height):
    with pytest.raises(ValueError, match=r"^(width|height): expected .* got \d+"):
        yester.Camera(MATRIX, width, height)


def test_cameras_of_too_many_pixels():
    with pytest.raises(ValueError, match=r"^width, height: expected .* at most 2³¹ pixels"):
        yester.Camera(MATRIX, 2**16, 2**16)
    with pytest.raises(MemoryError):
        yester.Camera(MATRIX, 2**16, 2**15).rays()


@pytest.mark.parametrize("shape", [(2**23, 1), (1, 2**23), (9_000_000, 1)])
def test_sides_whose_pixels_cannot_be_told_apart(shape):
    """Zero pages that are never written take no memory."""
    with pytest.raises(ValueError, match=r"^color: expected sides below 2²³"):
        yester.Frame(np.zeros((*shape, 3), np.float32))
    with pytest.raises(ValueError, match=r"^depth: expected sides below 2²³"):
        yester.disocclusion(np.zeros(shape, np.float32), np.zeros((*shape, 2), np.float32))


def test_results_of_absurd_size():
    with pytest.raises(ValueError, match=r"^size: expected"):
        yester.resample(np.zeros((2, 2), np.float32), (65536, 65536))
    with pytest.raises(ValueError, match=r"^frame: expected sides below 2²³"):
        yester.Upscaler(4).step(yester.Frame(np.zeros((2**21, 1, 3), np.float32)))


@pytest.mark.slow
def test_out_of_memory():
    """A MemoryError in the middle of a step leaves the pipeline as after `reset`, and usable."""
    run("""
        import resource
        import numpy as np
        import psutil
        import yester

        pipeline, fresh = yester.SVGF(), yester.SVGF()
        small = yester.Frame(np.random.default_rng(0).random((20, 30, 3), np.float32))
        want = fresh.step(small)
        used = psutil.Process().memory_info().vms
        large = yester.Frame(np.ones((200000, 1, 3), np.float32))
        resource.setrlimit(resource.RLIMIT_AS, (used + (100 << 20), used + (100 << 20)))
        for _ in range(3):
            try:
                pipeline.step(large)
            except MemoryError as error:
                assert "cannot be allocated" in str(error), error
            else:
                raise AssertionError("expected a MemoryError")
        for name in ("color", "variance", "history_length", "confidence", "rejection"):
            np.testing.assert_array_equal(getattr(pipeline.step(small), name), getattr(want, name))
            pipeline.reset()
    """)


@pytest.mark.slow
def test_threads_that_cannot_be_started():
    run("""
        import resource
        import numpy as np
        import psutil
        import yester

        image = np.random.default_rng(0).random((200, 30, 3), np.float32)
        used = psutil.Process().memory_info().vms
        resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 20), used + (1 << 20)))
        assert np.isfinite(yester.suppress_fireflies(image)[0]).all()
    """)


def aliases(shape, memory):
    """Two arrays of this shape in the same memory, without a common base."""
    count = int(np.prod(shape))
    yield np.frombuffer(memory, np.float32, count).reshape(shape)
    yield np.ctypeslib.as_array(ctypes.cast(memory, ctypes.POINTER(ctypes.c_float)), (count,)).reshape(shape)


def test_inputs_and_outputs_of_one_buffer():
    rng = np.random.default_rng(0)
    color = rng.random((40, 50, 3), np.float32)
    want = yester.clip_history(color[::-1].copy(), color)
    for offset in (0, 300):
        memory = ctypes.create_string_buffer(4 * (color.size + offset))
        given, _ = aliases(color.shape, memory)
        _, out = aliases((color.size + offset,), memory)
        given[:] = color
        out = out[offset:].reshape(color.shape)
        assert yester.clip_history(color[::-1].copy(), given, out=out) is out
        assert_same_bits(out, want)


def test_frames_and_outputs_of_one_buffer():
    rng = np.random.default_rng(0)
    color = rng.random((20, 30, 3), np.float32)
    want = yester.TAA().step(yester.Frame(color))
    memory = ctypes.create_string_buffer(4 * color.size)
    given, out = aliases(color.shape, memory)
    given[:] = color
    flat = [np.empty(color.shape[:2], dtype) for dtype in (np.float32, np.float32, np.uint8)]
    assert_same_bits(yester.TAA().step(yester.Frame(given), out=yester.Output(out, *flat)).color, want.color)


def test_outputs_of_one_buffer():
    rng = np.random.default_rng(0)
    color, flat = rng.random((20, 30, 3), np.float32), rng.random((20, 30), np.float32)
    memory = ctypes.create_string_buffer(4 * color.size)
    first, _ = aliases(color.shape, memory)
    _, second = aliases(flat.shape, memory)
    with pytest.raises(ValueError, match=r"^out: expected arrays that share no memory"):
        yester.atrous(color, flat, out=(first, second))
    assert not first.any()
    both = np.zeros(color.size + 5, np.float32)
    with pytest.raises(ValueError, match=r"^out: expected arrays that share no memory"):
        yester.suppress_fireflies(
            color, out=(both[: color.size].reshape(color.shape), both[5:][: flat.size].reshape(20, 30))
        )
    output = yester.TAA().step(yester.Frame(color))
    twice = yester.Output(output.color, flat, flat, output.rejection)
    with pytest.raises(ValueError, match=r"^out: expected arrays that share no memory"):
        yester.TAA().step(yester.Frame(color), out=twice)
    # Adjacent arrays share no memory.
    both = np.empty(color.size + flat.size, np.float32)
    parts = both[: color.size].reshape(color.shape), both[color.size :].reshape(flat.shape)
    for got, want in zip(yester.atrous(color, flat, out=parts), yester.atrous(color, flat), strict=True):
        assert_same_bits(got, want)


def test_many_phases_can_be_interrupted():
    points = yester.jitter(4096, sequence="blue-noise")
    np.testing.assert_array_equal(np.sort(points, 0), np.sort(yester.jitter(4096, sequence="rotated-grid"), 0))

    def ring(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(TimeoutError):
            points = yester.jitter(65536, sequence="blue-noise")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(points) == 4096


@pytest.mark.parametrize("deep", [False, True])
def test_the_last_ids_are_told_apart(deep):
    ids = np.full((8, 12), 2**32 - 2, np.uint32)
    ids[:, 4:] = 2**32 - 1
    ids[:, 8:] = 1
    color = np.where(ids == 1, 0.5, np.where(ids == 2**32 - 1, 1, 0))[..., None].repeat(3, -1).astype(np.float32)
    surface = {"depth": np.ones(ids.shape, np.float32)} if deep else {}
    filtered, _ = yester.atrous(color, np.ones(ids.shape, np.float32), ids=ids, **surface)
    np.testing.assert_allclose(filtered, color, rtol=1e-6)
