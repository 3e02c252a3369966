"""The same bits at every thread count and SIMD level; and the values of the two environment variables."""

import hashlib
import itertools
import os
import subprocess
import sys
from dataclasses import replace

import flight
import numpy as np
import pytest
import yester
from calls import arrays, calls
from yester.study.compare.methods import quarter

pytestmark = pytest.mark.slow


def digest() -> str:
    """One line per kernel and size, from less than a vector to more than a band of rows: the hash of its results."""
    lines = []
    for size in ((1, 1), (5, 7), (9, 33), (131, 173)):
        for name, (function, given) in calls(*size).items():
            data = b"".join(array.tobytes() for array in arrays(function(**given)))
            lines.append(f"{name} {size} {hashlib.sha256(data).hexdigest()}")
    pipelines = [yester.SVGF(), yester.SVGF(reflections=(), choice=False), yester.TAA()]
    pipelines += [yester.BMFR(), yester.HalfRes(), yester.Recirculation(), yester.Recirculation("textbook")]
    pipelines += [yester.Upscaler(1.5, sharpness=0.5)]
    rng = np.random.default_rng(0)
    before = None
    for number in range(4):
        shot = flight.shoot(number, 171, 97)
        color = flight.noisy(shot, rng)
        color[number, 5:9] = np.nan
        frame = replace(shot, color=color, motion=None, replay=before, jitter=(0.25, -0.125))
        before = color * np.float32(0.5)
        for pipeline in pipelines:
            out = pipeline.step(quarter(frame, number) if isinstance(pipeline, yester.HalfRes) else frame)
            images = (out.color, out.variance, out.history_length, out.confidence, out.rejection, out.choice)
            data = b"".join(image.tobytes() for image in images if image is not None)
            lines.append(f"{type(pipeline).__name__} {number} {hashlib.sha256(data).hexdigest()}")
    return "\n".join(lines)


def python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_same_bits_everywhere():
    want = digest()
    # A level that the machine lacks becomes the best that it has.
    for threads, simd in itertools.product(("1", "2"), ("baseline", "avx2", "avx512")):
        result = python(__file__, YESTER_THREADS=threads, YESTER_SIMD=simd)
        assert result.returncode == 0, result.stderr
        assert result.stdout.strip() == want, f"{threads} threads, {simd}"


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("YESTER_SIMD", "sse9"),
        ("YESTER_SIMD", "AVX 2"),
        ("YESTER_THREADS", "0"),
        ("YESTER_THREADS", "-1"),
        ("YESTER_THREADS", "two"),
        ("YESTER_THREADS", "1.5"),
    ],
)
def test_nonsense_is_refused_by_name(variable, value):
    result = python("-c", "import yester", **{variable: value})
    assert result.returncode != 0
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith(("ImportError", "ValueError"))
    assert variable in last
    assert value in last


def test_more_threads_than_there_are_is_no_error():
    result = python("-c", "import yester", YESTER_THREADS="4096")
    assert result.returncode == 0, result.stderr


if __name__ == "__main__":
    print(digest())
