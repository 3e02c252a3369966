import compare
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def inputs(rng, height, width):
    """Lengths, and history before and after clipping: equal, moved a little or far; black, negative and missing."""
    length = rng.choice(np.float32([0, 1, 2.5, 17, 1000, np.nan]), (height, width), p=[0.1, 0.2, 0.2, 0.2, 0.2, 0.1])
    history = compare.colors(rng, height, width)
    kind = rng.choice(5, (height, width, 1), p=[0.4, 0.2, 0.2, 0.1, 0.1])
    other = compare.colors(rng, height, width)
    clipped = np.choose(kind, [history, history * np.float32(0.99), other, np.float32(0), -history])
    history[rng.random((height, width)) < 0.1] = 0
    clipped[rng.random((height, width)) < 0.03] = np.nan
    return length, history, clipped


def check(length, history, clipped, *, strength=1.0):
    got = yester.anti_lag(length, history, clipped, strength=strength)
    want = reference.anti_lag(tensor(length), tensor(history), tensor(clipped), strength=strength).numpy()
    assert got.dtype == np.float32
    # dN'/dd = -strength N'²: the more samples are left, the more a rounding of luminance matters.
    assert_close("anti_lag", got, want, scale=np.nan_to_num(want + 0.3 * BAND / 1e-5 * strength * want**2))
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    strength=st.sampled_from([0.0, 0.1, 1.0, 30.0]),
)
def test_reference(seed, size, strength):
    check(*inputs(np.random.default_rng(seed), *size), strength=strength)


@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    check(*inputs(np.random.default_rng(width), height, width))


def test_both_sides_occur():
    length, *images = inputs(np.random.default_rng(0), 40, 50)
    got = check(length, *images)
    some = length > 0
    assert 0.2 < (got[some] == length[some]).mean() < 0.8
    assert 0.2 < (got[some] < 0.5 * length[some]).mean() < 0.8


def test_by_hand():
    history = np.float32([1, 1, 2, 0, 0, 1, 1, -1])[None, :, None] * np.ones(3, np.float32)
    clipped = np.float32([1, 0.5, 1, 0, 1, np.nan, np.inf, 1])[None, :, None] * np.ones(3, np.float32)
    length = np.full((1, 8), 8, np.float32)
    np.testing.assert_allclose(
        yester.anti_lag(length, history, clipped), [[8, 1.6, 1.6, 8, 8 / 9, 8, 8, 8 / 17]], rtol=1e-6
    )
    got = yester.anti_lag(length, history, clipped, strength=0.5)
    np.testing.assert_allclose(got, [[8, 8 / 3, 8 / 3, 8, 1.6, 8, 8, 8 / 9]], rtol=1e-6)


def test_nothing_moved_keeps_every_bit():
    """So do a strength of 0, missing pixels, and colours that move at constant luminance."""
    length, history, clipped = inputs(np.random.default_rng(1), 20, 30)
    assert_same_bits(yester.anti_lag(length, history, history), length)
    assert_same_bits(yester.anti_lag(length, history, clipped, strength=0.0), length)
    assert_same_bits(yester.anti_lag(length, np.full_like(history, np.nan), clipped), length)
    assert_same_bits(yester.anti_lag(length, np.zeros_like(history), np.zeros_like(clipped)), length)


def test_lengths_only_shrink():
    """The farther the colour moved, in either direction, the shorter; never below 0."""
    rng = np.random.default_rng(2)
    length, history, clipped = inputs(rng, 30, 40)
    length = np.nan_to_num(length)
    once, thrice = (yester.anti_lag(length, history, clipped, strength=strength) for strength in (1.0, 3.0))
    assert ((thrice >= 0) & (thrice <= once) & (once <= length)).all()
    assert (thrice < once).mean() > 0.2
    assert_same_bits(yester.anti_lag(length, clipped, history), once)


def test_scale_does_not_matter():
    length, history, clipped = inputs(np.random.default_rng(3), 20, 30)
    want = yester.anti_lag(length, history, clipped)
    for k in (-20, 3, 40):
        assert_same_bits(yester.anti_lag(length, np.ldexp(history, k), np.ldexp(clipped, k)), want)


def test_bad_input():
    length, image = np.ones((2, 3), np.float32), np.ones((2, 3, 3), np.float32)
    for strength in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"^strength: expected a finite number from 0"):
            yester.anti_lag(length, image, image, strength=strength)
    with pytest.raises(TypeError, match="strength"):
        yester.anti_lag(length, image, image, strength="strong")
    for wrong in (image[:1], image[..., :2], length):
        with pytest.raises(ValueError, match=r"^history: expected"):
            yester.anti_lag(length, wrong, image)
        with pytest.raises(ValueError, match=r"^clipped: expected"):
            yester.anti_lag(length, image, wrong)
    for wrong in (image, length[0], length[:0]):
        with pytest.raises(ValueError, match=r"^history_length: expected"):
            yester.anti_lag(wrong, image, image)
