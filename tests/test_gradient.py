import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def images(rng, height, width, *, holes=0.05):
    """A noisy frame and a noisy previous one, half of it in other light; in places black or negative."""
    color = compare.colors(rng, height, width, holes=holes)
    previous = compare.colors(rng, height, width, holes=holes)
    previous[:, width // 2 :] *= rng.choice([0.1, 1, 3])
    black, sign = rng.choice([0, 1]), rng.choice([-1, 1])
    with np.errstate(invalid="ignore"):
        for image in (color, previous):
            image[height // 3 :, : width // 4] *= black
            image[:, -width // 5 :] *= sign
    return color, previous


def check(color, previous, **named):
    got = yester.temporal_gradient(color, previous, **named)
    want, lost = reference.temporal_gradient(*tensor([color, previous]), margin=True, **named)
    assert got.dtype == np.float32
    # A variance is a difference of squares, and only as precise as they are.
    assert_close("temporal_gradient", got, want, scale=lost.numpy())
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    noise=st.sampled_from([0.0, 0.5, 1.0, 3.0]),
    passes=st.integers(1, 8),
    wider=st.integers(0, 3),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference(seed, size, passes, wider, holes, **named):
    widest = min(passes + wider, 8)
    check(*images(np.random.default_rng(seed), *size, holes=holes), passes=passes, widest=widest, **named)


@pytest.mark.parametrize("noise", [0.0, 1.0])
@each("size", SIZES + TAILS)
def test_sizes(size, noise):
    check(*images(np.random.default_rng(size[1]), *size), noise=noise)


def test_everything_between_none_and_all_occurs():
    rng = np.random.default_rng(1)
    color, previous = (compare.colors(rng, 64, 64) for _ in range(2))
    got = check(color * np.linspace(0.01, 1, 64, dtype=np.float32)[:, None], previous, noise=1.0)
    assert (got == 0).mean() > 0.05
    assert ((got > 0.1) & (got < 0.9)).mean() > 0.5
    dark = np.zeros((5, 5, 3), np.float32)
    np.testing.assert_array_equal(yester.temporal_gradient(dark, dark + 1), 1)
    np.testing.assert_array_equal(yester.temporal_gradient(dark, dark), 0)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_the_same_light_has_no_gradient(noise):
    color, _ = images(np.random.default_rng(0), 20, 21)
    np.testing.assert_array_equal(yester.temporal_gradient(color, color, noise=noise), 0)


@pytest.mark.parametrize("passes", [1, 2, 3, 8])
def test_half_the_light_is_a_half(passes):
    """For any texture; bit for bit, as all sums halve."""
    color, _ = images(np.random.default_rng(0), 30, 31, holes=0.1)
    color = np.abs(color)
    for now, before in ((color, color / 2), (color / 2, color)):
        got = yester.temporal_gradient(now, before, noise=0.0, passes=passes, widest=max(passes, 3))
        assert set(np.unique(got)) <= {0, 0.5}
        assert (got == 0.5).mean() > 0.5


def test_noise_is_no_gradient():
    """Frames of equal mean rarely differ by three standard errors, and hardly more; a margin of 0 shows all noise."""
    rng = np.random.default_rng(0)
    color, previous = (compare.colors(rng, 640, 640, holes=0.0) for _ in range(2))
    got = yester.temporal_gradient(color, previous, noise=3.0)
    assert (got > 0).mean() < 0.01
    assert got.mean() < 1e-3
    assert yester.temporal_gradient(color, previous, noise=0.0).mean() > 0.03
    within = [(yester.temporal_gradient(color, previous, noise=k) > 0).mean() for k in (1.0, 2.0)]
    np.testing.assert_allclose(within, [0.3173, 0.0455], rtol=0.2)  # the errors are standard errors


def test_a_step_is_found_where_it_is():
    """The left half dims to a fifth, in strong noise: there 0.8 less three standard errors, nothing on the right."""
    rng = np.random.default_rng(0)
    color, previous = (compare.colors(rng, 64, 96, holes=0.02) for _ in range(2))
    color[:, :48] /= 5
    got = yester.temporal_gradient(color, previous, noise=3.0)
    left, right = got[:, :36], got[:, 60:]
    assert left.min() > 0.3
    assert left.mean() == pytest.approx(0.6, abs=0.1)
    assert right.mean() < 1e-3


def test_the_largest_counts():
    """The largest gradient of all blurs, from the smallest to the widest, is returned."""
    color, previous = images(np.random.default_rng(2), 50, 60)
    got = yester.temporal_gradient(color, previous, passes=2, widest=5)
    single = [yester.temporal_gradient(color, previous, passes=n, widest=n) for n in range(2, 6)]
    assert_same_bits(got, np.max(single, 0))
    assert all((got > one).any() for one in single)


def test_wide_blurs_detect_faint_changes():
    """A tenth less light everywhere is lost in the noise of a few pixels, but not of many."""
    rng = np.random.default_rng(5)
    color, previous = (compare.colors(rng, 96, 96, holes=0.0) for _ in range(2))
    narrow, wide = (yester.temporal_gradient(0.9 * color, previous, widest=widest) for widest in (3, 6))
    assert (narrow > 0.03).mean() < 0.3
    assert (wide > 0.03).mean() > 0.9


def test_signs_and_scales_do_not_matter():
    """Brighter or darker, and in any unit: the same bits."""
    color, previous = images(np.random.default_rng(3), 30, 33)
    got = yester.temporal_gradient(color, previous, noise=1.0)
    assert got.any()
    assert_same_bits(yester.temporal_gradient(previous, color, noise=1.0), got)
    for k in (-10, 7):
        assert_same_bits(yester.temporal_gradient(np.ldexp(color, k), np.ldexp(previous, k), noise=1.0), got)


def test_missing_pixels():
    """A pixel that is not finite in either frame counts in neither; without valid neighbours the gradient is 0."""
    rng = np.random.default_rng(4)
    color, previous = images(rng, 30, 40, holes=0)
    holes = rng.random((30, 40)) < 0.4
    holes[:, :20] |= np.arange(20) < 12
    color[holes] = np.nan
    got = check(color, previous, noise=0.0, passes=2, widest=2)
    assert np.isfinite(got).all()
    assert not got[:, :10].any()
    assert got[:, 10:].all()
    other = previous.copy()
    other[holes, 1] = -np.inf
    assert_same_bits(yester.temporal_gradient(color, other, noise=0.0, passes=2, widest=2), got)


def test_bad_input():
    image = np.ones((4, 5, 3), np.float32)
    for name, values in {"noise": (-1, np.nan, np.inf), "passes": (-1, 0, 9), "widest": (-1, 2, 9)}.items():
        for value in values:
            with pytest.raises(ValueError, match=name):
                yester.temporal_gradient(image, image, **{name: value})
    with pytest.raises(ValueError, match="previous: expected height 4 and width 5"):
        yester.temporal_gradient(image, image[1:])
    with pytest.raises(ValueError, match="color"):
        yester.temporal_gradient(image[..., 0], image)
