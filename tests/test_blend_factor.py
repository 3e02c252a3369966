import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def confidences(rng, height, width):
    """Zero, fractions and one, out of range at both ends, and NaN."""
    kind = rng.choice(7, (height, width), p=[0.2, 0.4, 0.25, 0.05, 0.04, 0.03, 0.03])
    some = rng.uniform(0, 1, kind.shape)
    return np.choose(kind, [0.0, some, 1.0, 1.5, -0.5, np.nan, np.inf]).astype(np.float32)


def check(confidence, motion=None, **named):
    got = yester.blend_factor(confidence, motion, **named)
    want = reference.blend_factor(tensor(confidence), tensor(motion), **named)
    assert got.dtype == np.float32
    assert_close("blend_factor", got, want)
    assert ((got >= 0) & (got <= 1)).all()
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    channels=st.sampled_from([None, 2, 3]),
    alpha=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
    fast_alpha=st.sampled_from([0.0, 0.05, 0.2, 1.0]),
    speed=st.sampled_from([(2.0, 16.0), (0.0, 3.0), (0.0, 0.0), (1.5, 1.5), 2.0, 0.0, (0.5, 2.5)]),
)
def test_reference(seed, size, channels, **named):
    rng = np.random.default_rng(seed)
    motion = compare.motions(rng, *size, channels) if channels else None
    check(confidences(rng, *size), motion, **named)


@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    rng = np.random.default_rng(width)
    confidence = confidences(rng, height, width)
    for motion in (None, compare.motions(rng, height, width), compare.motions(rng, height, width, 3)):
        check(confidence, motion, speed=(0.5, 4.0))


def test_by_hand():
    confidence = np.float32([[0, 0.5, 1, 2, -1, np.nan]])
    np.testing.assert_allclose(check(confidence, alpha=0.2), [[1, 0.6, 0.2, 0.2, 1, 1]], rtol=1e-6)
    motion = np.zeros((1, 6, 3), np.float32)
    motion[0, :, 1] = [0, 2, -9, 16, 99, 0]
    motion[0, :, 2] = [9, 9, 9, 9, 9, np.nan]
    got = check(np.ones((1, 6), np.float32), motion, alpha=0.1, fast_alpha=0.3, speed=(2.0, 16.0))
    np.testing.assert_allclose(got, [[0.1, 0.1, 0.2, 0.3, 0.3, 1]], rtol=1e-6)
    got = check(np.ones((1, 6), np.float32), motion, alpha=0.1, fast_alpha=0.3, speed=(9.0, 9.0))
    np.testing.assert_allclose(got, [[0.1, 0.1, 0.1, 0.3, 0.3, 1]], rtol=1e-6)


def test_both_sides_of_both_speeds_occur():
    motion = compare.motions(np.random.default_rng(0), 40, 50)
    got = check(np.ones((40, 50), np.float32), motion, speed=(0.7, 2.5))
    for low, high in ((0.0499, 0.0501), (0.06, 0.19), (0.1999, 0.2001), (0.999, 1)):
        assert 0.02 < ((got >= low) & (got <= high)).mean() < 0.9


def test_motion_without_haste_is_none():
    """Bit for bit at rest, or where fast motion has the same blend factor as slow; otherwise factors only grow."""
    rng = np.random.default_rng(1)
    confidence, motion = confidences(rng, 30, 40), np.nan_to_num(compare.motions(rng, 30, 40), nan=9, posinf=9)
    want = yester.blend_factor(confidence)
    assert_same_bits(yester.blend_factor(confidence, 0 * motion), want)
    for fast_alpha in (0.0, 0.05):
        assert_same_bits(yester.blend_factor(confidence, motion, fast_alpha=fast_alpha), want)
    got = yester.blend_factor(confidence, motion)
    assert (got >= want - 1e-7).all()
    assert (got > want).mean() > 0.05


def test_a_pair_of_equals_is_the_number():
    rng = np.random.default_rng(1)
    confidence, motion = confidences(rng, 30, 40), compare.motions(rng, 30, 40)
    got, want = (yester.blend_factor(confidence, motion, speed=speed) for speed in ((1.5, 1.5), 1.5))
    assert_same_bits(got, want)


def test_without_motion_there_is_no_history():
    motion = np.zeros((2, 4, 2), np.float32)
    motion[0, :, 0] = [np.nan, np.inf, -np.inf, 0]
    motion[1, :, 1] = [np.nan, np.inf, -np.inf, 3e38]
    got = yester.blend_factor(np.ones((2, 4), np.float32), motion)
    np.testing.assert_allclose(got, [[1, 1, 1, 0.05], [1, 1, 1, 0.2]], rtol=1e-6)


def test_bad_input():
    ones, motion = np.ones((2, 3), np.float32), np.zeros((2, 3, 2), np.float32)
    bad = {
        "alpha": [-0.1, 1.1, np.nan, np.inf],
        "fast_alpha": [-0.1, 1.1, np.nan, np.inf],
        "speed": [(2.0, 1.0), (-1.0, 1.0), (1.0, np.nan), -1.0, np.nan],
    }
    for name, values in bad.items():
        for value in values:
            with pytest.raises(ValueError, match=rf"^{name}: expected"):
                yester.blend_factor(ones, motion, **{name: value})
        with pytest.raises(TypeError, match=name):
            yester.blend_factor(ones, motion, **{name: "slow"})
    for wrong in (motion[:1], motion[..., :1], motion[..., 0], np.zeros((2, 3, 4))):
        with pytest.raises(ValueError, match=r"^motion: expected"):
            yester.blend_factor(ones, wrong)
    for wrong in (motion, ones[0], ones[:0]):
        with pytest.raises(ValueError, match=r"^confidence: expected"):
            yester.blend_factor(wrong)
