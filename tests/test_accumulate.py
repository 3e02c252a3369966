import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, tensor
from hypothesis import assume, given, settings
from hypothesis import strategies as st


def inputs(rng, height, width):
    light = compare.colors(rng, height, width, 2)
    length = rng.choice(np.float32([0, 1, 2, 3.5, 17, 1000, -1, np.nan, np.inf]), (height, width))
    return [compare.colors(rng, height, width), compare.colors(rng, height, width), light, length]


def check(*images, **named):
    got = yester.accumulate(*images, **named)
    want = reference.accumulate(*tensor(images), **named)
    assert got.missing == want.missing
    assert isinstance(got.missing, int)
    assert_close("accumulate color", got.color, want.color)
    assert_close("accumulate moments", got.moments, want.moments)
    assert_close("accumulate history_length", got.history_length, want.history_length, rtol=1e-6)
    return got


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    alpha=st.sampled_from([0.01, 0.05, 0.3, 1.0]),
    moments_alpha=st.sampled_from([0.0, 0.2, 1.0]),
    warmup=st.booleans(),
)
def test_reference(seed, size, **named):
    assume(named["warmup"] or named["moments_alpha"] > 0)
    check(*inputs(np.random.default_rng(seed), *size), **named)


@pytest.mark.parametrize(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    check(*inputs(np.random.default_rng(width), height, width), alpha=0.0)


def sequence(frames, **named):
    """Feed frames to a history that starts empty."""
    history = [np.zeros((*frames[0].shape[:2], *c), np.float32) for c in ((3,), (2,), ())]
    for frame in frames:
        result = yester.accumulate(frame, *history, **named)
        history = [result.color, result.moments, result.history_length]
    return result


def test_static_scene_converges_to_the_mean():
    frames = np.random.default_rng(0).exponential(1, (64, 8, 9, 3)).astype(np.float32)
    result = sequence(frames, alpha=0.0, moments_alpha=0.0)
    np.testing.assert_allclose(result.color, frames.mean(0), rtol=1e-5)
    light = frames @ np.array([0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(result.moments, np.stack([light.mean(0), (light**2).mean(0)], -1), rtol=1e-5)
    assert (result.history_length == 64).all()


def test_constant_stays():
    result = sequence([np.full((3, 4, 3), 0.7, np.float32)] * 40)
    assert (result.color == np.float32(0.7)).all()
    np.testing.assert_allclose(result.history_length, 20, rtol=1e-6)


def test_first_sample_is_taken_as_it_is():
    color = compare.colors(np.random.default_rng(0), 5, 6, holes=0)
    for warmup in (True, False):
        result = sequence([color], warmup=warmup)
        assert_same_bits(result.color, color)
        assert (result.history_length == 1).all()


def test_missing_samples_are_counted_and_leave_the_history():
    good = np.ones((2, 3, 3), np.float32)
    bad = good.copy()
    bad[0, 0, 1], bad[1, 2, 0] = np.nan, np.inf
    result = sequence([good, 2 * bad])
    assert result.missing == 2
    holes = ~np.isfinite(bad).all(-1)
    assert (result.color[holes] == 1).all()
    assert (result.history_length[holes] == 1).all()
    assert (result.history_length[~holes] == 2).all()
    assert np.isfinite(result.color).all()


def test_never_seen_is_nan_and_heals():
    good = np.ones((1, 2, 3), np.float32)
    bad = good.copy()
    bad[0, 0] = np.nan
    result = sequence([bad, bad])
    assert np.isnan(result.color[0, 0]).all()
    assert np.isnan(result.moments[0, 0]).all()
    np.testing.assert_array_equal(result.history_length, [[0, 2]])
    result = sequence([bad, bad, good])
    assert (result.color == 1).all()
    np.testing.assert_array_equal(result.history_length, [[1, 3]])


def test_broken_history_is_no_history():
    color = np.full((1, 5, 3), 2, np.float32)
    history, moments, length = (np.ones((1, 5, *c), np.float32) for c in ((3,), (2,), ()))
    length *= 8
    history[0, 0, 2], moments[0, 1, 1], length[0, 2], length[0, 3] = np.nan, np.inf, np.nan, 0
    result = yester.accumulate(color, history, moments, length)
    np.testing.assert_array_equal(result.history_length, [[1, 1, 1, 1, 9]])
    assert (result.color[0, :4] == 2).all()


def test_nothing_of_the_arguments_changes():
    images = inputs(np.random.default_rng(0), 4, 5)
    copies = [image.copy() for image in images]
    yester.accumulate(*images)
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)
