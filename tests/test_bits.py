"""The same bits on every machine, at every thread count and SIMD level; the values of the two environment variables."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import bits
import pytest


def python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_same_bits_on_every_machine():
    """A line that differs in its first hash is about numpy, one that differs in the second alone about the kernel."""
    want = Path(__file__).with_name("bits.txt").read_text(encoding="utf-8")
    assert bits.digest().splitlines() == want.splitlines()


@pytest.mark.slow
def test_same_bits_everywhere():
    want = bits.digest()
    # A level that the machine lacks becomes the best that it has.
    for threads, simd in itertools.product(("1", "2"), ("baseline", "avx2", "avx512")):
        result = python(bits.__file__, YESTER_THREADS=threads, YESTER_SIMD=simd)
        assert result.returncode == 0, result.stderr
        assert result.stdout.strip() == want, f"{threads} threads, {simd}"


@pytest.mark.slow
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
    result = python("-c", "import yester; yester.exposure([[[1.0, 1, 1]]])", **{variable: value})
    assert result.returncode == 1
    last = result.stderr.strip().splitlines()[-1]
    assert last.startswith(f"ValueError: {variable}: expected")
    assert last.endswith(f"got {value}")
    # The command line says it in one line.
    result = python("-m", "yester", "--version", **{variable: value})
    assert result.returncode == 2
    assert result.stderr == f"yester: error: {last.removeprefix('ValueError: ')}\n"


@pytest.mark.slow
def test_more_threads_than_there_are_is_no_error():
    result = python("-c", "import yester", YESTER_THREADS="4096")
    assert result.returncode == 0, result.stderr
