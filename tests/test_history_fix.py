import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_variance import surface


def inputs(rng, height, width, holes=0.05):
    """Half of the history has full length, the rest 0 to a few samples, with fractions."""
    length = rng.choice(
        np.float32([0, 0.5, 1, 2, 2.25, 3, 20]), (height, width), p=[0.15, 0.05, 0.1, 0.1, 0.05, 0.05, 0.5]
    )
    return compare.colors(rng, height, width, holes=holes), length


def check(color, length, **named):
    got = yester.fix_history(color, length, **named)
    want, weights = reference.fix_history(*tensor([color, length]), margin=True, **tensor(named))
    assert got.dtype == np.float32
    # With no similar tap, near-zero weights dominate, and are cut to zero at a bound.
    sure = (weights.numpy() > 1e-12) | (weights.numpy() == 0)
    assert (~sure).sum() <= 2 + 0.1 * sure.size
    assert_close("fix_history", got, want, rtol=2e-5, where=sure)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    max_length=st.sampled_from([0.0, 1.0, 3.0, 30.0]),
    stride=st.sampled_from([1.0, 5.0, 14.0, 64.0]),
    sigma_normal=st.sampled_from([0.0, 10.0, 128.0]),
    sigma_depth=st.sampled_from([0.5, 3.0]),
    sigma_plane=st.sampled_from([0.01, 0.3]),
    holes=st.sampled_from([0.0, 0.05, 0.7]),
)
def test_reference(seed, size, buffers, holes, **named):
    rng = np.random.default_rng(seed)
    check(*inputs(rng, *size, holes), **surface(rng, *size, buffers), **named)


@pytest.mark.parametrize("buffers", [[], ["depth", "ids"], ["depth", "normal", "ids"]])
@each("size", SIZES + TAILS)
def test_sizes(size, buffers):
    rng = np.random.default_rng(size[1])
    check(*inputs(rng, *size), stride=4.0, **surface(rng, *size, buffers))


def test_long_history_keeps_its_bits():
    rng = np.random.default_rng(0)
    color, length = inputs(rng, 30, 40)
    for max_length in (0.0, 1.0, 3.0):
        got = yester.fix_history(color, length, max_length=max_length, **surface(rng, 30, 40, ["ids", "depth"]))
        stays = length >= max_length
        assert_same_bits(got[stays], color[stays])
        assert (got != color).any(-1)[~stays].any() == (max_length > 0)


@pytest.mark.parametrize(("length", "step"), [(0, 14), (1, 7), (2, 5)])
def test_taps_are_where_they_should_be(length, step):
    """One short history among long ones: the mean of the 5x5 taps at its stride, with little weight on itself."""
    rng = np.random.default_rng(length)
    color = rng.exponential(1, (61, 61, 3)).astype(np.float32)
    lengths = rng.integers(3, 20, (61, 61)).astype(np.float32)
    lengths[30, 30] = length
    got = yester.fix_history(color, lengths)
    taps = np.s_[30 - 2 * step : 31 + 2 * step : step]
    want = np.average(color[taps, taps].reshape(25, 3), axis=0, weights=lengths[taps, taps].ravel())
    np.testing.assert_allclose(got[30, 30], want, rtol=1e-6)
    got[30, 30] = color[30, 30]
    assert_same_bits(got, color)


def test_nothing_crosses():
    """Neither ids, nor the border to the background, nor steps in depth, nor corners."""
    rng = np.random.default_rng(0)
    color = np.ones((32, 64, 3), np.float32)
    color[:, 32:] = 100
    length = rng.integers(0, 6, (32, 64)).astype(np.float32)
    ids = np.ones((32, 64), np.uint32)
    depth, normal = np.ones((32, 64), np.float32), np.zeros((32, 64, 3), np.float32)
    normal[..., 2] = 1
    sky = depth.copy()
    ids[:, 32:], depth[:, 32:], normal[:, 32:], sky[:, 32:] = 2, 25, [1, 0, 0], np.inf
    assert yester.fix_history(color, length)[length < 3].std() > 1
    assert not np.isin(yester.fix_history(color, length)[length < 3], (1, 100)).all()
    for buffers in (
        {"ids": ids},
        {"depth": depth},
        {"depth": sky},
        {"normal": normal},
    ):
        np.testing.assert_allclose(yester.fix_history(color, length, **buffers), color, rtol=1e-5)


def test_no_noise_from_short_history():
    """A tap's weight is its length: pixels without history lend nothing, however many they are."""
    rng = np.random.default_rng(0)
    color = np.full((40, 40, 3), 0.5, np.float32)
    length = rng.choice(np.float32([0, 8]), (40, 40), p=[0.8, 0.2])
    color[length == 0] = rng.exponential(1, (int((length == 0).sum()), 3))
    got = yester.fix_history(color, length, stride=4.0)
    fixed = np.isclose(got, 0.5, rtol=1e-6).all(-1)
    assert fixed[length == 8].all()
    assert 0.95 < fixed[length == 0].mean() < 1  # a few have no tap with history
    alone = (length == 0) & ~fixed
    assert_same_bits(got[alone], color[alone])


def test_constant_stays():
    rng = np.random.default_rng(0)
    color = np.full((21, 34, 3), 0.7, np.float32)
    length = rng.integers(0, 6, (21, 34)).astype(np.float32)
    got = yester.fix_history(color, length, **surface(rng, 21, 34, ["depth", "normal", "ids"]))
    np.testing.assert_allclose(got, color, rtol=1e-6)


def test_scale_passes_to_the_bit():
    """Scaled light has the same weights; by powers of two, the same bits."""
    rng = np.random.default_rng(0)
    color, length = inputs(rng, 24, 33)
    buffers = surface(rng, 24, 33, ["depth", "normal", "ids"])
    got = yester.fix_history(color, length, **buffers)
    for k in (-9, 6):
        assert_same_bits(yester.fix_history(np.ldexp(color, k), length, **buffers), np.ldexp(got, k))


def test_holes_are_filled_and_never_spread():
    """Missing pixels of short history are filled where a tap is present; infinities and NaN lengths do not spread."""
    rng = np.random.default_rng(0)
    color = compare.colors(rng, 40, 50, holes=0.3)
    length = rng.integers(0, 6, (40, 50)).astype(np.float32)
    present = np.isfinite(color).all(-1)
    got = yester.fix_history(color, length, stride=5.0)
    short = length < 3
    assert np.isfinite(got[short]).all()
    assert_same_bits(got[~short], color[~short])
    assert (short & ~present).any()
    length[rng.random((40, 50)) < 0.1] = np.nan
    got = yester.fix_history(color, length, stride=5.0)
    assert np.isfinite(got[length < 3]).all()


def test_no_similar_tap_changes_nothing():
    color = compare.colors(np.random.default_rng(0), 9, 10, holes=0.2)
    assert_same_bits(yester.fix_history(color, np.zeros((9, 10), np.float32)), color)


def test_bad_input():
    color, length = np.ones((4, 5, 3), np.float32), np.ones((4, 5), np.float32)
    ranges = {
        "max_length": (-1, np.nan),
        "stride": (0.5, 65, np.nan),
        "sigma_normal": (-1, np.nan),
        "sigma_depth": (0, -1, np.nan),
        "sigma_plane": (0, -1, np.nan),
    }
    for name, values in ranges.items():
        for value in values:
            with pytest.raises(ValueError, match=name):
                yester.fix_history(color, length, **{name: value})
    with pytest.raises(ValueError, match="history_length: expected height 4 and width 5"):
        yester.fix_history(color, length[1:])
    with pytest.raises(ValueError, match="ids"):
        yester.fix_history(color, length, ids=np.ones((4, 6), np.uint32))
    with pytest.raises(ValueError, match="color"):
        yester.fix_history(length, length)
