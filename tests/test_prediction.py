import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def images(rng, height, width, *, holes=0.05):
    """Two predictions of a noisy frame, one of them better in places; some dark pixels, one negative."""
    candidate, base, color = (compare.colors(rng, height, width, holes=holes) for _ in range(3))
    with np.errstate(invalid="ignore"):
        candidate[height // 2 :] = color[height // 2 :] * rng.choice([1, 1.1])
        base[:, : width // 3] *= 1e-3
        color[0, 0] *= -1
    return candidate, base, color


def check(*frames, **named):
    got = yester.prediction_gain(*frames, **named)
    assert got.dtype == np.float32
    # The variance of a few large terms that are nearly equal is lost to rounding.
    loose = {"rtol": 1e-4, "flips": got.size // 200} if named.get("standardized") else {}
    assert_close("prediction_gain", got, reference.prediction_gain(*tensor(frames), **tensor(named)), **loose)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    with_ids=st.booleans(),
    radius=st.sampled_from([0, 1, 3, 7, 16]),
    standardized=st.booleans(),
    holes=st.sampled_from([0.0, 0.05, 0.7]),
)
def test_reference(seed, size, with_ids, radius, standardized, holes):
    rng = np.random.default_rng(seed)
    ids = {"ids": compare.surfaces(rng, *size)["ids"]} if with_ids else {}
    check(*images(rng, *size, holes=holes), radius=radius, standardized=standardized, **ids)


@pytest.mark.parametrize("with_ids", [False, True])
@each("size", SIZES + TAILS)
def test_sizes(size, with_ids):
    rng = np.random.default_rng(size[1])
    ids = {"ids": compare.surfaces(rng, *size)["ids"]} if with_ids else {}
    check(*images(rng, *size), **ids)


def test_the_difference_of_squared_errors():
    """Without a window: one pixel by hand, then every pixel."""
    k, h, c = (np.full((1, 1, 3), value, np.float32) for value in ((1, 2, 3), (2, 2, 1), (1, 1, 1)))
    want = (0 + 1 + 4 - 1 - 1 - 0) / (4 + 4 + 1 + 0.01)
    assert yester.prediction_gain(k, h, c, radius=0)[0, 0] == pytest.approx(want, rel=1e-6)
    k, h, c = images(np.random.default_rng(0), 20, 21, holes=0)
    good = np.isfinite(k + h + c).all(-1)
    want = (((k - c) ** 2).sum(-1) - ((h - c) ** 2).sum(-1)) / ((h**2).sum(-1) + 0.01)
    got = yester.prediction_gain(k, h, c, radius=0)
    np.testing.assert_allclose(got[good], want[good], rtol=1e-3, atol=1e-4)
    assert (got[good] < 0).any()
    assert (got[good] > 0).any()


def test_equal_predictions_gain_nothing():
    k, _, c = images(np.random.default_rng(0), 20, 21)
    np.testing.assert_array_equal(yester.prediction_gain(k, k, c), 0)


def test_unbiased_by_noise():
    """The mean over many noisy frames is the gain against the reference, as the noise cancels."""
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.5, 1.5, (12, 13, 3)).astype(np.float32)
    base = truth * rng.uniform(0.8, 1.2, truth.shape).astype(np.float32)
    candidate = truth * rng.uniform(0.9, 1.3, truth.shape).astype(np.float32)
    want = (((candidate - truth) ** 2 - (base - truth) ** 2).sum(-1)) / ((base**2).sum(-1) + 0.01)
    noise = rng.exponential(1, (3000, *truth.shape)).astype(np.float32)  # the noise's variance is far above both errors
    frames = np.stack([yester.prediction_gain(candidate, base, truth * factor, radius=0) for factor in noise])
    error = frames.std(0) / np.sqrt(len(frames))
    assert np.abs((frames.mean(0) - want) / error).mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.2)
    assert np.abs((frames.mean(0) - want) / error).max() < 5
    assert np.abs(want / error).mean() > 3 * np.sqrt(2 / np.pi)  # a biased mean would be wrong by as much
    window = np.stack([yester.prediction_gain(candidate, base, truth * factor)[6, 6] for factor in noise[:1000]])
    assert window.mean() == pytest.approx(want[3:10, 3:10].mean(), abs=4 * window.std() / np.sqrt(1000))


def test_sees_which_is_better():
    """Half of the image changes its light: there the candidate with new light is better, elsewhere worse."""
    rng = np.random.default_rng(0)
    stays, changed = np.ones((32, 64, 3), np.float32), np.full((32, 64, 3), 1.5, np.float32)
    color = stays.copy()
    color[:, 32:] = 1.5
    noisy = color * rng.gamma(4, 1 / 4, (32, 64, 1)).astype(np.float32)
    got = yester.prediction_gain(changed, stays, noisy)
    assert (got[:, 36:] < 0).mean() > 0.99
    assert (got[:, :28] > 0).mean() > 0.99


def test_nothing_crosses_ids():
    rng = np.random.default_rng(0)
    k, h, c = images(rng, 16, 32)
    ids = np.ones((16, 32), np.uint32)
    ids[:, 16:] = 2**32 - 1
    got = yester.prediction_gain(k, h, c, ids=ids)
    left, right = (
        yester.prediction_gain(*(np.ascontiguousarray(i[:, half]) for i in (k, h, c)))
        for half in (np.s_[:16], np.s_[16:])
    )
    np.testing.assert_allclose(got, np.concatenate([left, right], 1), rtol=1e-5, atol=1e-4)
    assert not np.allclose(got, yester.prediction_gain(k, h, c))
    # A checkerboard: only every other pixel counts.
    ids = np.indices((16, 32)).sum(0).astype(np.uint32) % 2
    for colour in (0, 1):
        holes = c.copy()
        holes[ids != colour] = np.nan
        here = ids == colour
        masked = yester.prediction_gain(k, h, holes)
        np.testing.assert_allclose(yester.prediction_gain(k, h, c, ids=ids)[here], masked[here], rtol=1e-5, atol=1e-4)


def test_missing_pixels():
    """A pixel missing in any of the three images does not count; without valid pixels the gain is 0."""
    rng = np.random.default_rng(0)
    k, h, c = images(rng, 20, 30, holes=0)
    holes = rng.random((20, 30)) < 0.3
    holes[:, :10] = True
    results = []
    for i, value in ((0, np.nan), (1, np.inf), (2, -np.inf)):
        frames = [k.copy(), h.copy(), c.copy()]
        frames[i][holes, rng.integers(0, 3)] = value
        results.append(yester.prediction_gain(*frames))
    for got in results:
        assert_same_bits(got, results[0])
        assert np.isfinite(got).all()
    assert not results[0][:, :7].any()
    assert (results[0][:, 7:] != 0).mean() > 0.9


def test_standardized():
    """The mean over its standard error, of at least 1 %; a single pixel tells nothing about chance."""
    k, h, c = images(np.random.default_rng(0), 7, 7, holes=0)
    terms = yester.prediction_gain(k, h, c, radius=0).astype(np.float64)
    want = terms.mean() / np.sqrt(terms.var(ddof=1) / 49 + 1e-4)
    assert yester.prediction_gain(k, h, c, standardized=True)[3, 3] == pytest.approx(want, rel=1e-4)
    assert not yester.prediction_gain(k, h, c, radius=0, standardized=True).any()
    # Without noise, the gain is in hundredths.
    k, h, c = (np.full((5, 5, 3), value, np.float32) for value in (1, 1.1, 1))
    gain = yester.prediction_gain(k, h, c)
    np.testing.assert_allclose(yester.prediction_gain(k, h, c, standardized=True), 100 * gain, rtol=1e-3)


def test_a_firefly_is_not_significant():
    """A very bright sample speaks for the brighter prediction, but also makes the error of its window large."""
    rng = np.random.default_rng(0)
    k, h = (np.full((9, 9, 3), value, np.float32) for value in (1.2, 1))
    c = rng.gamma(4, 1 / 4, (9, 9, 1)).astype(np.float32) * np.ones(3, np.float32)
    without = yester.prediction_gain(k, h, c, standardized=True)[4, 4]
    c[4, 4] = 1000
    assert yester.prediction_gain(k, h, c)[4, 4] < -1
    assert -1.5 < yester.prediction_gain(k, h, c, standardized=True)[4, 4] < 0 < without


def test_variances_that_overflow():
    k, h, c = (np.full((5, 5, 3), value, np.float32) for value in (1e15, 1, 1))
    assert np.isfinite(yester.prediction_gain(k, h, c)).all()
    assert not yester.prediction_gain(k, h, c, standardized=True).any()


def test_bad_input():
    image = np.ones((4, 5, 3), np.float32)
    for radius in (-1, 17):
        with pytest.raises(ValueError, match="radius"):
            yester.prediction_gain(image, image, image, radius=radius)
    for name in ("candidate", "base", "color"):
        frames = {"candidate": image, "base": image, "color": image}
        with pytest.raises(ValueError, match="expected"):
            yester.prediction_gain(**{**frames, name: image[1:]})
        with pytest.raises(ValueError, match=name):
            yester.prediction_gain(**{**frames, name: image[..., 0]})
    with pytest.raises(ValueError, match="ids: expected height 4 and width 5"):
        yester.prediction_gain(image, image, image, ids=np.ones((5, 5), np.uint32))
