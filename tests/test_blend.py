import compare
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st

WEIGHTINGS = ["none", "tone", "local-tone", "luminance"]


def images(rng, height, width):
    """A noisy frame and a history inside and outside its range of luminance; negative colours and holes."""
    color, history = (compare.colors(rng, height, width) for _ in range(2))
    near = rng.random((height, width)) < 0.4
    history[near] = (color * rng.uniform(0.7, 1.4, (height, width, 1)).astype(np.float32))[near]
    color[rng.random((height, width)) < 0.05] *= -1
    history[rng.random((height, width)) < 0.05] *= -1
    return color, history


def shares(rng, height, width):
    """Blend factors of every size, out of range at both ends, and NaN."""
    kind = rng.choice(6, (height, width), p=[0.6, 0.1, 0.1, 0.1, 0.05, 0.05])
    some = rng.uniform(0, 1, kind.shape)
    return np.choose(kind, [some, 0.0, 1.0, -0.5, np.nan, np.inf]).astype(np.float32)


def check(color, history, alpha=0.05, **named):
    got = yester.blend(color, history, alpha, **named)
    want, narrow = reference.blend(tensor(color), tensor(history), tensor(alpha), margin=True, **named)
    assert got.dtype == np.float32
    finite = want[want.isfinite()]
    size = float(finite.square().mean().sqrt()) if len(finite) else 1.0
    assert_close("blend", got, want, scale=size * (1 + 0.3 * BAND / 1e-5 * narrow.numpy()[..., None]))
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    alpha=st.sampled_from([None, 0.0, 0.05, 0.25, 0.8, 1.0]),
    weighting=st.sampled_from(WEIGHTINGS),
    flicker=st.sampled_from([0.0, 0.3, 1.0]),
    exposure=st.sampled_from([1.0, 0.3]),
)
def test_reference(seed, size, alpha, **named):
    rng = np.random.default_rng(seed)
    check(*images(rng, *size), shares(rng, *size) if alpha is None else alpha, **named)


@pytest.mark.parametrize("flicker", [0.25, 1.0])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
@each(("height", "width"), SIZES + TAILS[::2])
def test_sizes(height, width, weighting, flicker):
    rng = np.random.default_rng(width)
    check(*images(rng, height, width), shares(rng, height, width), weighting=weighting, flicker=flicker)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_both_sides_of_the_range_occur(weighting):
    """History well inside its neighbours' range blends as without the test, the more the nearer to the middle."""
    color, history = (np.nan_to_num(image, posinf=1, neginf=1) for image in images(np.random.default_rng(0), 40, 50))
    plain, flickers = (check(color, history, 0.2, weighting=weighting, flicker=flicker) for flicker in (1.0, 0.0))
    moved, less = (np.abs(image - history).sum(-1) for image in (plain, flickers))
    some = moved > 1e-3
    ratio = less[some] / moved[some]
    assert some.mean() > 0.9
    assert (ratio < 1 + 1e-3).all()
    assert 0.1 < (ratio < 0.5).mean() < 0.9
    assert 0.1 < (ratio > 0.7).mean() < 0.9


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("flicker", [0.0, 0.5, 1.0])
def test_constant_stays(weighting, flicker):
    color = np.full((7, 9, 3), (0.7, 0.1, 3.3), np.float32)
    for alpha in (0.0, 0.05, 0.7, 1.0):
        got = yester.blend(color, color, alpha, weighting=weighting, flicker=flicker)
        np.testing.assert_allclose(got, color, rtol=3e-7)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("flicker", [0.0, 0.5, 1.0])
def test_all_or_nothing(weighting, flicker):
    """A blend factor of one gives the sample, zero gives history, bit for bit."""
    color, history = (compare.colors(np.random.default_rng(seed), 20, 30, holes=0) for seed in (1, 2))
    named = {"weighting": weighting, "flicker": flicker}
    np.testing.assert_allclose(yester.blend(color, history, 1.0, **named), color, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(yester.blend(color, history, 0.0, **named), history, rtol=3e-7)
    if weighting != "tone":
        assert_same_bits(yester.blend(color, history, 0.0, **named), history)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("flicker", [0.0, 0.5, 1.0])
def test_between(weighting, flicker):
    """Weights are within [0, 1]: every channel lies between history and sample."""
    rng = np.random.default_rng(3)
    color, history = (np.nan_to_num(image, posinf=1, neginf=1) for image in images(rng, 40, 50))
    got = yester.blend(color, history, shares(rng, 40, 50), weighting=weighting, flicker=flicker)
    room = 1e-6 * np.maximum(np.abs(color), np.abs(history))
    assert (got >= np.minimum(color, history) - room).all()
    assert (got <= np.maximum(color, history) + room).all()


def test_missing_values_are_not_blended():
    good, nothing = np.float32([1, 2, 3]), np.float32([1, np.nan, 3])
    color = np.stack([good, nothing, good, nothing])[None]
    history = np.stack([2 * good, 2 * good, nothing, np.float32([np.inf, 1, 1])])[None]
    for weighting in WEIGHTINGS:
        for flicker in (0.5, 1.0):
            got = yester.blend(color, history, 0.25, weighting=weighting, flicker=flicker)
            assert np.isfinite(got[0, 0]).all()
            assert_same_bits(got[0, 1], history[0, 1])
            assert_same_bits(got[0, 2], color[0, 2])
            assert np.isnan(got[0, 3]).all()


def test_maps_are_numbers_per_pixel():
    rng = np.random.default_rng(4)
    color, history = images(rng, 20, 30)
    for weighting in WEIGHTINGS:
        for flicker in (0.5, 1.0):
            named = {"weighting": weighting, "flicker": flicker}
            for alpha in (0.0, 0.05, 1.0):
                number = yester.blend(color, history, alpha, **named)
                assert_same_bits(yester.blend(color, history, np.full((20, 30), alpha), **named), number)
            for beyond, alpha in ((-1, 0), (-np.inf, 0), (3, 1), (np.inf, 1), (np.nan, 1)):
                number = yester.blend(color, history, float(alpha), **named)
                assert_same_bits(yester.blend(color, history, np.full((20, 30), beyond, np.float32), **named), number)


def test_weightings_by_hand():
    """Grey, so that luminance is the colour."""
    color = np.broadcast_to(np.float32([3, 1.0, 0.1, 1, -1, 0])[None, :, None], (1, 6, 3))
    history = np.broadcast_to(np.float32([1, 0.5, 0.0, 1, 1, 0])[None, :, None], (1, 6, 3))
    got = yester.blend(color, history, 0.2)[0, :, 0]
    np.testing.assert_allclose(got, [1.4, 0.6, 0.02, 1, 0.6, 0], rtol=1e-5)
    got = yester.blend(color, history, 0.2, weighting="tone")[0, :, 0]
    # Weights of 0.2/(1 + c) and 0.8/(1 + h), with negative light as 0.
    want = [
        (0.05 * 3 + 0.4) / 0.45,
        (0.1 + 0.8 / 3) / (0.1 + 0.8 / 1.5),
        0.02 / 1.1 / (0.2 / 1.1 + 0.8),
        1,
        0.2 / 0.6,
        0,
    ]
    np.testing.assert_allclose(got, want, rtol=1e-5)
    around = np.array([4 / 2, 4.1 / 3, 2.1 / 3, 1.1 / 3, 1 / 3, 0])  # sums and counts of lights from 0
    weights = np.maximum(4 * around, 1) + np.maximum([color[0, :, 0], history[0, :, 0]], 0)
    new, old = np.array([[0.2], [0.8]]) / weights
    got = yester.blend(color, history, 0.2, weighting="local-tone")[0, :, 0]
    np.testing.assert_allclose(got, (new * color[0, :, 0] + old * history[0, :, 0]) / (new + old), rtol=1e-5)
    got = yester.blend(color, history, 0.2, weighting="luminance")[0, :, 0]
    # Up to 0.8, with similarities of 1/3, 1/2, 1/2 (of the least light, 0.2), 1, 0 and 1.
    shares = 0.8 - 0.6 * np.array([1 / 3, 1 / 2, 1 / 2, 1, 0, 1]) ** 2
    np.testing.assert_allclose(got, history[0, :, 0] + shares * (color - history)[0, :, 0], rtol=1e-5)


def test_flicker_by_hand():
    """Neighbours from 0 to 4; history on the border, inside, in the middle and outside of the range."""
    color = np.broadcast_to(np.float32([0, 4, 0]).repeat(3).reshape(3, 3, 1), (3, 3, 3)).copy()
    color[0, 1] = np.nan  # not counted
    for light, inside in ((0, 0), (1, 0.5), (2, 1), (3.5, 0.25), (4, 0), (9, 0), (-1, 0)):
        history = np.full((3, 3, 3), light, np.float32)
        got = yester.blend(color, history, 0.1, flicker=0.2)[1, 1, 0]
        keep = 0.2 + 0.8 * inside
        share = 0.1 * (keep + 0.1 * (1 - keep))
        assert got == pytest.approx(light + share * (4 - light), rel=1e-5)
    # Without a range there is no border.
    plain = np.full((3, 3, 3), 2, np.float32)
    assert_same_bits(yester.blend(plain, 3 * plain, 0.1, flicker=0.0), yester.blend(plain, 3 * plain, 0.1))


def test_a_firefly_weighs_little():
    color, history = np.full((1, 1, 3), 1000, np.float32), np.ones((1, 1, 3), np.float32)
    plain, tone = (yester.blend(color, history, 0.1, weighting=weighting)[0, 0, 0] for weighting in ("none", "tone"))
    assert plain > 100
    assert tone < 1.5


def test_the_edge_of_a_lamp_is_not_darkened():
    """Half of its samples hit the lamp: their mean by tone is far too dark."""
    rng, errors = np.random.default_rng(0), {}
    x = np.arange(16)
    samples = [np.where(x[:, None] + rng.uniform(size=(16, 16)) < 8.5, 20, 0.1) for _ in range(40)]
    for weighting in ("none", "tone", "local-tone"):
        shown = np.broadcast_to(samples[0][..., None], (16, 16, 3)).astype(np.float32)
        for sample in samples[1:]:
            shown = yester.blend(np.repeat(sample[..., None], 3, -1), shown, 0.1, weighting=weighting)
        errors[weighting] = shown[8].mean() / np.mean(samples, 0)[8].mean()
    assert errors["tone"] < 0.2
    assert errors["local-tone"] > 0.6


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_the_brightest_stay_finite(weighting):
    most = np.full((3, 4, 3), np.finfo(np.float32).max, np.float32)
    for color, history in ((most, most), (most, 0 * most), (0 * most, most)):
        assert np.isfinite(yester.blend(color, history, 0.2, weighting=weighting)).all()


def test_bad_input():
    image = np.ones((2, 3, 3), np.float32)
    with pytest.raises(ValueError, match=r'^weighting: .*"none", "tone", "local-tone", "luminance".*got "Tone"'):
        yester.blend(image, image, weighting="Tone")
    for name in ("alpha", "flicker"):
        for value in (-0.1, 1.1, np.nan, np.inf):
            with pytest.raises(ValueError, match=rf"^{name}: expected a fraction from 0 to 1"):
                yester.blend(image, image, **{name: value})
        with pytest.raises(TypeError, match=name):
            yester.blend(image, image, **{name: "much"})
    for wrong in (np.zeros((1, 3)), np.zeros((2, 3, 1)), np.zeros(3), np.zeros((2, 0))):
        with pytest.raises(ValueError, match=r"^alpha: expected"):
            yester.blend(image, image, wrong)
    for wrong in (image[:1], image[..., 0], image[..., :2]):
        with pytest.raises(ValueError, match=r"^history: expected"):
            yester.blend(image, wrong)
    with pytest.raises(ValueError, match=r"^color: expected"):
        yester.blend(image[..., 0], image)
