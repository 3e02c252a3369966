import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

RED, GREEN, BLUE = np.float32([[0.8, 0.15, 0.1], [0.1, 0.7, 0.15], [0.1, 0.2, 0.9]])


def inputs(rng, height, width):
    """Colours that stay or jump, in either direction, with little or much noise; memories of them, and invalid ones."""
    kinds = np.float32([RED, GREEN, BLUE])
    coarse = rng.integers(0, 3, (height // 6 + 1, width // 6 + 1))
    color = kinds[coarse.repeat(6, 0).repeat(6, 1)[:height, :width]]
    color = (color * rng.uniform(0.95, 1.05, color.shape)).astype(np.float32)
    color[rng.random((height, width)) < 0.05] = np.nan
    others = [kinds[rng.integers(0, 3, (height, width))] * rng.uniform(0.9, 1.1, color.shape) for _ in range(2)]
    means = [yester.alternation(other.astype(np.float32))[..., :3] for other in others]
    near = [yester.alternation(np.broadcast_to(kind, color.shape).copy())[..., :3] for kind in kinds]
    pick = rng.integers(0, 4, (2, height, width, 1))
    means = [np.choose(choice, [mean, *near]) for choice, mean in zip(pick, means, strict=True)]
    count = rng.choice(np.float32([0, 0.3, 1, 2.6, 3]), (height, width, 1))
    memory = np.concatenate([*means, count], -1).astype(np.float32)
    memory[rng.random((height, width)) < 0.05, rng.integers(0, 7)] = rng.choice([np.nan, np.inf])
    return color, memory


def check(color, memory, **named):
    got = yester.alternation(color, memory, **named)
    given = None if memory is None else tensor(memory)
    want, margin = reference.alternation(tensor(color), given, margin=True, **named)
    assert_close("alternation", got, want, where=np.stack([margin.numpy() > 1e-5] * 7, -1))
    return got


@given(seed=st.integers(0, 2**32), size=st.tuples(st.integers(1, 30), st.integers(1, 40)))
def test_reference(seed, size):
    check(*inputs(np.random.default_rng(seed), *size))


@each("size", SIZES + TAILS[::4])
def test_sizes(size):
    color, memory = inputs(np.random.default_rng(size[1]), *size)
    check(color, memory, exposure=0.3)
    check(compare.colors(np.random.default_rng(0), *size), None)


def test_every_case_occurs():
    color, memory = inputs(np.random.default_rng(0), 60, 70)
    got = check(color, memory)
    known = np.isfinite(memory).all(-1)
    before, after = memory[known, 6], got[known, 6]
    assert (after > before).mean() > 0.02, "returns"
    assert ((after == 0) & (before > 0)).mean() > 0.1, "other jumps"
    assert (after == before * np.float32(0.875)).mean() > 0.1, "no jump"


def run(colors):
    """The counts in the middle of uniform images, one per colour."""
    memory, counts = None, []
    for color in colors:
        memory = yester.alternation(np.broadcast_to(color, (5, 6, 3)).astype(np.float32), memory)
        counts.append(float(memory[2, 2, 6]))
    return counts


def test_returns_are_counted():
    assert run([RED, GREEN] * 4) == [0, 0, 1, 2, 3, 3, 3, 3]
    assert run([RED] * 6) == [0] * 6
    assert run([RED, RED, GREEN, GREEN, GREEN, RED]) == [0, 0, 0, 0, 0, 1]
    # Neither three colours in turn nor a monotonic series return from the last jump.
    assert run([RED, GREEN, BLUE] * 4) == [0] * 12
    assert run([RED * np.float32(0.7**i) for i in range(10)]) == [0] * 10
    # A light that goes out is no return; neither is one that comes back after a long time.
    assert run([RED] * 4 + [RED / 9] * 4) == [0] * 8
    assert run([RED, GREEN, GREEN, GREEN, GREEN, GREEN, RED])[-1] == 1
    assert run([RED] + [GREEN] * 7 + [RED])[-1] == 0
    # A past alternation is soon forgotten.
    fading = run([RED, GREEN] * 4 + [GREEN] * 9)
    assert max(fading) == 3
    assert fading[-1] < 1


def test_noise_does_not_alternate():
    """However strong the noise, the means of 3×3 pixels stay within their ranges."""
    rng = np.random.default_rng(0)
    memory, counted = None, 0.0
    for _ in range(16):
        memory = yester.alternation(rng.gamma(1, 1, (30, 40, 3)).astype(np.float32), memory)
        counted = max(counted, (memory[..., 6] > 1).mean())
    assert counted < 0.001


def test_missing_pixels():
    color = np.full((4, 5, 3), np.nan, np.float32)
    assert np.isnan(yester.alternation(color)).all()
    memory = np.random.default_rng(0).random((4, 5, 7), np.float32)
    assert_same_bits(yester.alternation(color, memory), memory)
    color[0, 0] = RED
    got = yester.alternation(color, memory)
    assert_same_bits(got[2:], memory[2:])
    assert (got[:2, :2, :3] == got[0, 0, :3]).all()
    lost = memory.copy()
    lost[..., 4] = np.inf
    assert (yester.alternation(color, lost)[0, 0, 6]) == 0


def test_light_has_no_unit():
    color, memory = inputs(np.random.default_rng(2), 20, 30)
    want = yester.alternation(color, memory)
    for scale in (2.0**-20, 2.0**20):
        got = yester.alternation(color * np.float32(scale), memory, exposure=scale)
        np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-6)


def test_bad_input():
    color = np.ones((4, 5, 3), np.float32)
    for value in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="exposure: expected a finite number above 0"):
            yester.alternation(color, exposure=value)
    with pytest.raises(ValueError, match="color: expected shape"):
        yester.alternation(color[..., 0])
    with pytest.raises(ValueError, match=r"memory: expected shape \(H, W, 7\)"):
        yester.alternation(color, color)
    with pytest.raises(ValueError, match="memory: expected height 4 and width 5"):
        yester.alternation(color, np.ones((5, 5, 7)))
