import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_variance import surface

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def image(rng, height, width, *, holes=0.05, brightest=100.0):
    """Noise with a firefly in every thirtieth pixel."""
    color = compare.colors(rng, height, width, holes=holes)
    color[rng.random((height, width)) < 1 / 30] *= rng.uniform(1, brightest)
    return color


def luminance(color):
    """(H, W) in double precision, 0 where missing."""
    present = np.isfinite(color).all(-1, keepdims=True)
    return np.where(present, color, 0).astype(np.float64) @ LUMINANCE


def check(color, rtol=1e-5, **named):
    got, removed = yester.suppress_fireflies(color, **named)
    want, want_removed, scale = reference.suppress_fireflies(tensor(color), margin=True, **tensor(named))
    assert got.dtype == removed.dtype == np.float32
    scale = scale.numpy()
    assert_close("suppress_fireflies", got, want, rtol=rtol, scale=scale[..., None])
    assert_close("suppress_fireflies removed", removed, want_removed, rtol=rtol, scale=scale)
    return got, removed


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 30), st.integers(1, 40)),
    threshold=st.sampled_from([0.0, 1.0, 2.0, 4.0]),
    radius=st.sampled_from([1, 2, 4, 7]),
    redistribute=st.booleans(),
    holes=st.sampled_from([0.0, 0.05, 0.7]),
)
def test_reference(seed, size, holes, **named):
    check(image(np.random.default_rng(seed), *size, holes=holes), **named)


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    buffers=st.sets(st.sampled_from(["depth", "normal", "ids"])),
    predicted=st.booleans(),
    radius=st.sampled_from([1, 4]),
    sigma_normal=st.sampled_from([0.0, 10.0]),
    sigma_depth=st.sampled_from([0.5, 3.0]),
    sigma_plane=st.sampled_from([0.03, 0.3]),
)
def test_surfaces_and_history_reference(seed, size, buffers, predicted, **named):
    rng = np.random.default_rng(seed)
    color = image(rng, *size)
    if predicted:
        named["expected"] = compare.colors(rng, *size)
    check(color, rtol=1e-4, **surface(rng, *size, buffers), **named)


@pytest.mark.parametrize("redistribute", [True, False])
@each("size", SIZES + TAILS)
def test_sizes(size, redistribute):
    check(image(np.random.default_rng(size[1]), *size), radius=2, redistribute=redistribute)


def test_negative_light():
    """Negative light is no firefly, and limits are not negative."""
    rng = np.random.default_rng(0)
    color = rng.normal(-0.5, 1, (30, 31, 3)).astype(np.float32)
    got, _ = check(color, threshold=0.5, radius=2)
    dark = luminance(color) < 0
    assert dark.mean() > 0.5
    assert (luminance(got) >= luminance(color) - 1e-6)[dark].all()


@pytest.mark.parametrize("value", [0.0, 0.7, 1e-6, 3e4, -0.7])
@pytest.mark.parametrize("threshold", [0.0, 2.0])
def test_constant_stays_to_the_bit(value, threshold):
    color = np.full((21, 34, 3), value, np.float32)
    color[3, 4] = np.nan
    got, removed = yester.suppress_fireflies(color, threshold=threshold)
    assert_same_bits(got, color)
    assert not removed.any()


def test_pixels_below_their_limit_and_far_from_fireflies_keep_their_bits():
    rng = np.random.default_rng(0)
    color = rng.uniform(1, 1.5, (40, 40, 3)).astype(np.float32)
    color[20, 20] = 30
    got, _ = yester.suppress_fireflies(color, radius=3, threshold=4.0)
    touched = np.zeros((40, 40), bool)
    touched[17:24, 17:24] = True
    assert_same_bits(got[~touched], color[~touched])
    assert (got != color).any(-1)[touched].all()


def test_a_firefly_gives_its_light_away():
    """All its excess goes to its window, in its own hue and in equal parts."""
    rng = np.random.default_rng(0)
    color = rng.uniform(0.9, 1.1, (21, 21, 3)).astype(np.float32)
    color[10, 10] = (9, 6, 3)
    got, removed = yester.suppress_fireflies(color, threshold=4.0)
    assert np.argwhere(removed).tolist() == [[10, 10]]
    np.testing.assert_allclose(got.sum((0, 1), np.float64), color.sum((0, 1), np.float64), rtol=1e-6)
    gain = np.delete((got - color)[6:15, 6:15].reshape(81, 3), 40, 0)
    share = color[10, 10] * removed[10, 10] / luminance(color)[10, 10] / 81
    np.testing.assert_allclose(gain, np.broadcast_to(share, gain.shape), atol=1e-6)


def test_surfaces_are_apart():
    """A firefly's limit comes from its own surface, and its excess stays there."""
    rng = np.random.default_rng(0)
    color = rng.uniform(0.9, 1.1, (20, 20, 3)).astype(np.float32)
    color[:, 10:] *= 20
    color[10, 9] = 15
    ids = np.repeat(np.arange(20) // 10 + 1, 20).reshape(20, 20).T.astype(np.uint32)
    alone, _ = yester.suppress_fireflies(color, threshold=4.0)
    assert_same_bits(alone, color)  # beside pixels that are as bright
    got, removed = yester.suppress_fireflies(color, ids=ids, threshold=4.0)
    assert np.argwhere(removed).tolist() == [[10, 9]]
    assert_same_bits(got[:, 10:], color[:, 10:])
    assert (got[6:15, 5:9] > color[6:15, 5:9]).all()
    np.testing.assert_allclose(got.sum(dtype=np.float64), color.sum(dtype=np.float64), rtol=1e-6)


def test_light_that_history_predicts_is_no_firefly():
    color = np.random.default_rng(0).uniform(0.9, 1.1, (20, 20, 3)).astype(np.float32)
    color[10, 10] = 8
    expected = np.ones_like(color)
    _, removed = yester.suppress_fireflies(color, expected=expected)
    assert removed[10, 10] == pytest.approx(5, abs=0.01)  # above three times the expected light
    expected[10, 10] = 3
    got, removed = yester.suppress_fireflies(color, expected=expected, threshold=4.0)
    assert_same_bits(got, color)
    expected[10, 10] = np.nan
    _, removed = yester.suppress_fireflies(color, expected=expected)
    assert removed[10, 10] == pytest.approx(7, abs=0.5)


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    threshold=st.sampled_from([0.0, 1.0, 2.0]),
    radius=st.sampled_from([1, 4]),
    redistribute=st.booleans(),
)
def test_light_is_kept_or_reported(seed, size, redistribute, **named):
    """Redistribution keeps total luminance, also of fireflies that share a window; otherwise the loss is reported."""
    color = image(np.random.default_rng(seed), *size)
    got, removed = yester.suppress_fireflies(color, redistribute=redistribute, **named)
    assert (removed >= 0).all()
    lost = 0 if redistribute else removed.sum(dtype=np.float64)
    assert luminance(got).sum() + lost == pytest.approx(luminance(color).sum(), rel=1e-5, abs=1e-6)


def test_only_outliers_are_cut():
    """A firefly beside noise: cut to its neighbours' limit; without redistribution the rest keeps its bits."""
    rng = np.random.default_rng(0)
    color = rng.uniform(0.9, 1.1, (30, 30, 3)).astype(np.float32)
    color[10, 12], color[20, 5] = 500, 60
    got, removed = yester.suppress_fireflies(color, threshold=4.0, redistribute=False)
    cut = (got != color).any(-1)
    assert np.argwhere(cut).tolist() == [[10, 12], [20, 5]]
    assert_same_bits(got[~cut], color[~cut])
    assert (luminance(got)[cut] < 1.3).all()
    np.testing.assert_allclose(removed[cut], luminance(color)[cut] - luminance(got)[cut], rtol=1e-5)
    assert not removed[~cut].any()


@pytest.mark.parametrize("brightness", [1e2, 1e4, 1e6, 1e8])
def test_however_bright(brightness):
    """A firefly is cut to its limit, which does not depend on its brightness."""
    rng = np.random.default_rng(0)
    color = rng.uniform(0.5, 1.5, (9, 9, 3)).astype(np.float32)
    light = np.delete(luminance(color).ravel(), 40)
    color[4, 4] = brightness
    got, _ = yester.suppress_fireflies(color, redistribute=False)
    np.testing.assert_allclose(got[4, 4], light.mean() + 2 * light.std(), rtol=1e-4)


def test_too_few_to_judge_by():
    """With one neighbour the deviation is 0; without any there is no limit."""
    for color in (np.float32([[[9, 9, 9]]]), np.float32([[[1, 1, 1], [90, 90, 90]]])):
        got, removed = yester.suppress_fireflies(color, threshold=0.0)
        assert_same_bits(got, color)
        assert not removed.any()


def test_holes_stay_and_never_spread():
    rng = np.random.default_rng(0)
    color = image(rng, 30, 40, holes=0.4)
    present = np.isfinite(color).all(-1)
    got, removed = yester.suppress_fireflies(color)
    assert_same_bits(got[~present], color[~present])
    assert np.isfinite(got[present]).all()
    assert np.isfinite(removed).all()
    assert not removed[~present].any()


def test_scale_does_not_matter():
    color = image(np.random.default_rng(2), 20, 21)
    color[3, 3] = 90
    named = {"threshold": 0.0, "radius": 1}
    got, removed = yester.suppress_fireflies(color, **named)
    assert removed.any()
    for k in (-7, 8):
        scaled, scaled_removed = yester.suppress_fireflies(np.ldexp(color, k), **named)
        assert_same_bits(scaled, np.ldexp(got, k))
        assert_same_bits(scaled_removed, np.ldexp(removed, k))


@pytest.mark.parametrize("brightness", [1e-40, 1e-36, 1e-30, 1e-20])
def test_however_dark(brightness):
    """Squares of such luminances underflow, and some are denormal; fireflies are found all the same."""
    color = (np.random.default_rng(5).random((32, 32, 3)) * brightness).astype(np.float32)
    held, removed = yester.suppress_fireflies(color, redistribute=False)
    assert np.isfinite(held).all()
    lost = reference.luminance(tensor(color)).sum() - reference.luminance(tensor(held)).sum()
    np.testing.assert_allclose(lost, removed.sum(dtype=np.float64), atol=1e-2 * color.sum(dtype=np.float64))


def test_bad_input():
    color = np.ones((4, 5, 3), np.float32)
    for name, values in {"threshold": (-1, np.nan, np.inf), "radius": (-1, 0, 17)}.items():
        for value in values:
            with pytest.raises(ValueError, match=name):
                yester.suppress_fireflies(color, **{name: value})
    for wrong in (color[..., 0], color[..., :2], color[:0]):
        with pytest.raises(ValueError, match="color"):
            yester.suppress_fireflies(wrong)
