import copy
import pickle

import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import assume, given
from hypothesis import strategies as st


def inputs(rng, height, width):
    light = compare.colors(rng, height, width, 2)
    length = rng.choice(np.float32([0, 1, 2, 3.5, 17, 1000, -1, np.nan, np.inf]), (height, width))
    return [compare.colors(rng, height, width), compare.colors(rng, height, width), light, length]


def gradients(rng, color):
    """Mostly 0, some of every size, 1, and invalid values: out of range or not finite.

    A gradient of 1 without a sample has a test of its own.
    """
    kind = rng.choice(8, color.shape[:2], p=[0.4, 0.2, 0.2, 0.1, 0.025, 0.025, 0.025, 0.025])
    many = rng.uniform(0, 1, (2, *kind.shape))
    found = np.choose(kind, [0.0, many[0], 0.1 * many[1], 1.0, -0.5, 1.5, np.nan, np.inf])
    return np.where(np.isfinite(color).all(-1), found, np.minimum(found, 0.9)).astype(np.float32)


def weights(rng, color):
    """Mostly 1, some fractions, 0, and invalid values: out of range or not finite."""
    kind = rng.choice(6, color.shape[:2], p=[0.5, 0.3, 0.05, 0.05, 0.05, 0.05])
    return np.choose(kind, [1.0, rng.uniform(0.01, 1, kind.shape), 0.0, -0.5, 1.5, np.nan]).astype(np.float32)


def check(*images, **named):
    got = yester.accumulate(*images, **named)
    want = reference.accumulate(*tensor(images), **tensor(named))
    assert got.missing == want.missing
    assert isinstance(got.missing, int)
    assert_close("accumulate color", got.color, want.color)
    assert_close("accumulate moments", got.moments, want.moments)
    assert_close("accumulate history_length", got.history_length, want.history_length, rtol=2e-6)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    alpha=st.sampled_from([0.01, 0.05, 0.3, 1.0]),
    moments_alpha=st.sampled_from([0.0, 0.2, 1.0]),
    warmup=st.booleans(),
    parts=st.booleans(),
    changes=st.booleans(),
)
def test_reference(seed, size, parts, changes, **named):
    assume(named["warmup"] or named["moments_alpha"] > 0)
    rng = np.random.default_rng(seed)
    images = inputs(rng, *size)
    weight = weights(rng, images[0]) if parts else None
    seen = images[0] if weight is None else np.where(weight[..., None] > 0, images[0], np.float32(np.nan))
    check(*images, weight=weight, gradient=gradients(rng, seen) if changes else None, **named)


@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    rng = np.random.default_rng(width)
    images = inputs(rng, height, width)
    check(*images, alpha=0.0)
    check(*images, alpha=0.0, gradient=gradients(rng, images[0]))


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


def test_results_can_be_copied_and_pickled():
    rng = np.random.default_rng(0)
    color = rng.random((5, 7, 3), np.float32)
    color[2, 3] = np.nan
    result = yester.accumulate(color, color, color[..., :2], color[..., 0])
    for again in (copy.copy(result), copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
        for name in ("color", "moments", "history_length"):
            assert_same_bits(getattr(again, name), getattr(result, name))
        assert again.missing == result.missing == 1


@pytest.mark.parametrize("name", ["color", "moments", "history_length"])
def test_results_of_wrong_shapes_are_refused(name):
    parts = {"color": np.ones((4, 5, 3)), "moments": np.ones((4, 5, 2)), "history_length": np.ones((4, 5))}
    with pytest.raises(ValueError, match=rf"^{name}: expected"):
        yester.Accumulated(**parts | {name: parts[name][:-1, ..., None]}, missing=0)


def test_nothing_of_the_arguments_changes():
    images = inputs(np.random.default_rng(0), 4, 5)
    copies = [image.copy() for image in images]
    yester.accumulate(*images)
    for image, copied in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copied)


def test_no_gradient_changes_nothing():
    """No gradient, zero, a negative one and one that is not finite give the same bits."""
    images = inputs(np.random.default_rng(1), 20, 30)
    want = yester.accumulate(*images)
    for value in (0.0, -1.0, np.nan, -np.inf):
        got = yester.accumulate(*images, gradient=np.full((20, 30), value, np.float32))
        for name in ("color", "moments", "history_length"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing


def test_whole_weights_change_nothing():
    images = inputs(np.random.default_rng(1), 20, 30)
    want = yester.accumulate(*images)
    for value in (1.0, 2.0, np.inf):
        got = yester.accumulate(*images, weight=np.full((20, 30), value, np.float32))
        for name in ("color", "moments", "history_length"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing


def test_no_weight_is_no_sample():
    images = inputs(np.random.default_rng(1), 20, 30)
    want = yester.accumulate(np.full_like(images[0], np.nan), *images[1:])
    for value in (0.0, -1.0, np.nan):
        got = yester.accumulate(*images, weight=np.full((20, 30), value, np.float32))
        for name in ("color", "moments", "history_length"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing == 600


def test_weights_are_those_of_a_mean():
    rng = np.random.default_rng(0)
    frames = rng.exponential(1, (30, 8, 9, 3)).astype(np.float32)
    weight = rng.uniform(0.01, 1, (30, 8, 9)).astype(np.float32)
    history = [np.zeros((8, 9, *c), np.float32) for c in ((3,), (2,), ())]
    for frame, part in zip(frames, weight, strict=True):
        got = yester.accumulate(frame, *history, weight=part, alpha=0.0, moments_alpha=0.0)
        history = [got.color, got.moments, got.history_length]
    many = weight[..., None].astype(np.float64)
    np.testing.assert_allclose(got.color, (frames * many).sum(0) / many.sum(0), rtol=1e-5)
    np.testing.assert_allclose(got.history_length, weight.sum(0), rtol=1e-5)


@pytest.mark.parametrize("value", [1.0, 7.0, np.inf])
@pytest.mark.parametrize("warmup", [True, False])
def test_a_full_gradient_takes_the_sample(value, warmup):
    images = inputs(np.random.default_rng(2), 20, 30)
    images[0] = np.nan_to_num(images[0], nan=3, posinf=3, neginf=3)
    got = yester.accumulate(*images, gradient=np.full((20, 30), value, np.float32), warmup=warmup)
    light = images[0] @ np.array([0.2126, 0.7152, 0.0722])
    size = np.nanmax(np.abs(images[1][np.isfinite(images[1])]))
    np.testing.assert_allclose(got.color, images[0], rtol=1e-6, atol=1e-6 * size)
    np.testing.assert_allclose(got.moments, np.stack([light, light**2], -1), rtol=1e-5, atol=1e-5)
    finite = np.isfinite(images[3])
    np.testing.assert_array_equal(got.history_length[finite], 1)


def test_the_less_confidence_the_more_of_the_sample():
    """The formula of the blend factor: lerp(a, 1, 1 - confidence); the length is unchanged."""
    color, history = np.full((1, 5, 3), 2, np.float32), np.ones((1, 5, 3), np.float32)
    moments, length = np.ones((1, 5, 2), np.float32), np.full((1, 5), 100, np.float32)
    confidence = np.float32([[1, 0.75, 0.3, 0, np.nan]])
    got = yester.accumulate(color, history, moments, length, confidence=confidence)
    np.testing.assert_allclose(got.color[0, :, 0], [1.05, 1.2875, 1.715, 2, 2], rtol=1e-6)
    np.testing.assert_allclose(got.history_length, 20)
    want = reference.accumulate(*map(tensor, (color, history, moments, length)), confidence=tensor(confidence))
    np.testing.assert_allclose(got.moments, want.moments, rtol=1e-6)


def test_a_full_gradient_without_a_sample_leaves_nothing():
    """The shortened length is 0: the same as an empty history."""
    images = inputs(np.random.default_rng(3), 20, 30)
    images[0][...] = np.nan
    got = yester.accumulate(*images, gradient=np.ones((20, 30), np.float32))
    want = yester.accumulate(*images[:3], np.zeros((20, 30), np.float32))
    for name in ("color", "moments", "history_length"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_the_more_gradient_the_more_of_the_sample():
    """By hand: N (1 - g)^10 samples are left, and the blend factor moves by g towards one."""
    gradient = np.linspace(0, 1, 11, dtype=np.float32)[None]
    color, history = np.full((1, 11, 3), 2, np.float32), np.ones((1, 11, 3), np.float32)
    moments, length = np.ones((1, 11, 2), np.float32), np.full((1, 11), 9, np.float32)
    got = yester.accumulate(color, history, moments, length, gradient=gradient, alpha=0.0, moments_alpha=0.5)
    samples = 9 * (1 - gradient.astype(np.float64)) ** 10 + 1
    share, moments_share = (a + gradient * (1 - a) for a in (1 / samples, np.maximum(0.5, 1 / samples)))
    np.testing.assert_allclose(got.history_length, samples, rtol=1e-6)
    np.testing.assert_allclose(got.color[..., 0], 1 + share, rtol=1e-6)
    np.testing.assert_allclose(got.moments, 1 + moments_share[..., None] * [1, 3], rtol=1e-6)
    assert (np.diff(got.color[0, :, 0]) >= 0).all()


@pytest.mark.parametrize("name", ["weight", "gradient"])
def test_weights_of_another_shape(name):
    images = inputs(np.random.default_rng(0), 4, 5)
    for share in (np.zeros((3, 5)), np.zeros((4, 5, 1)), np.zeros(5)):
        with pytest.raises(ValueError, match=rf"^{name}: expected"):
            yester.accumulate(*images, **{name: share})
    with pytest.raises(TypeError, match=name):
        yester.accumulate(*images, **{name: np.zeros((4, 5), int)})
