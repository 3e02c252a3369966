import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def inputs(rng, height, width):
    """Moments of one to a few samples, and history lengths on both sides of every bound."""
    light = rng.exponential(1, (height, width))
    moments = np.stack([light, light**2 * rng.uniform(0.9, 2, light.shape)], -1).astype(np.float32)
    length = rng.choice(np.float32([1, 1, 2, 3, 3.5, 4, 5, 20]), (height, width))
    unseen = rng.random((height, width)) < 0.1
    moments[unseen], length[unseen] = np.nan, 0
    moments[rng.random((height, width)) < 0.01, 1] = np.inf
    return moments, length


def surface(rng, height, width, names) -> dict:
    now = compare.surfaces(rng, height, width)
    return {name: now[name] for name in sorted(names)}


def check(moments, length, **named):
    got = yester.estimate_variance(moments, length, **named)
    want, weights = reference.estimate_variance(*tensor([moments, length]), margin=True, **tensor(named))
    assert got.dtype == np.float32
    # Where the pixel itself is missing, near-zero weights of neighbours dominate, and are cut to zero at a bound.
    sure = weights.numpy() > 1e-12
    assert (sure | ~np.isfinite(moments).all(-1)).all()
    # A difference of second moments is only as precise as they are.
    seen = np.where(np.isfinite(moments).all(-1), moments[..., 1], 0)
    scale = 4 * np.maximum(seen, seen.max(initial=1e-30) * (length < named.get("min_length", 3.5)))
    assert_close("estimate_variance", got, want, scale=scale, where=sure)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 36), st.integers(1, 36)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    min_length=st.sampled_from([1.0, 3.5, 10.5]),
    radius=st.sampled_from([0, 1, 3, 5]),
    sigma_normal=st.sampled_from([0.0, 10.0, 128.0]),
    sigma_depth=st.sampled_from([0.5, 3.0]),
    sigma_plane=st.sampled_from([0.01, 0.3]),
)
def test_reference(seed, size, buffers, **named):
    rng = np.random.default_rng(seed)
    check(*inputs(rng, *size), **surface(rng, *size, buffers), **named)


@pytest.mark.parametrize("buffers", [[], ["depth", "ids"], ["depth", "normal", "ids"]])
@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width, buffers):
    rng = np.random.default_rng(width)
    check(*inputs(rng, height, width), **surface(rng, height, width, buffers))


def test_long_history_speaks_for_itself():
    rng = np.random.default_rng(0)
    moments, _ = inputs(rng, 9, 11)
    moments = np.nan_to_num(moments, nan=1, posinf=1)
    got = yester.estimate_variance(moments, np.full((9, 11), 4, np.float32))
    np.testing.assert_allclose(got, np.maximum(0, moments[..., 1] - moments[..., 0] ** 2), rtol=1e-4, atol=1e-6)
    assert (got == 0).any()
    assert (got > 0).any()


def test_short_history_uses_its_neighbours():
    """Without buffers all weights are equal: the variance of the 7x7, scaled up for short history."""
    light = np.random.default_rng(0).exponential(1, (7, 7)).astype(np.float32)
    moments = np.stack([light, light**2], -1)
    for length, factor in ((0, 3.5), (1, 3.5), (2, 1.75), (3, 3.5 / 3)):
        got = yester.estimate_variance(moments, np.full((7, 7), length, np.float32))
        assert got[3, 3] == pytest.approx(light.var() * factor, rel=1e-5)


def test_nothing_seen_is_zero():
    moments = np.full((5, 6, 2), np.nan, np.float32)
    got = yester.estimate_variance(moments, np.zeros((5, 6), np.float32))
    assert_same_bits(got, np.zeros((5, 6), np.float32))


def test_constant_has_none():
    ones = np.full((8, 9, 2), 0.25, np.float32)
    ones[..., 1] **= 2
    for length in (1, 4):
        np.testing.assert_allclose(yester.estimate_variance(ones, np.full((8, 9), length, np.float32)), 0, atol=1e-7)


def test_holes_never_spread():
    rng = np.random.default_rng(0)
    moments, length = inputs(rng, 20, 30)
    moments[rng.random((20, 30)) < 0.5] = np.nan
    buffers = surface(rng, 20, 30, ["depth", "normal", "ids"])
    assert np.isfinite(yester.estimate_variance(moments, length, **buffers)).all()


def test_no_denormals():
    moments = np.zeros((4, 5, 2), np.float32)
    moments[..., 1] = 1e-35
    assert not yester.estimate_variance(moments, np.full((4, 5), 9, np.float32)).any()
    moments[..., 1] = 1e-29
    assert yester.estimate_variance(moments, np.full((4, 5), 9, np.float32)).all()


def test_samples_converge_to_their_variance():
    """Temporal moments of many frames estimate the variance of one sample."""
    frames = np.random.default_rng(0).exponential(1, (400, 16, 16)).astype(np.float32)
    moments = np.stack([frames.mean(0), (frames**2).mean(0)], -1)
    got = yester.estimate_variance(moments, np.full((16, 16), 400, np.float32))
    np.testing.assert_allclose(got, frames.var(0), rtol=1e-4)
    assert got.mean() == pytest.approx(1, rel=0.05)
