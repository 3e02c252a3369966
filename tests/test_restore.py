import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor


def pair(rng, size) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A smooth image, a noisy one with holes, and variances, some of which are unknown."""
    smooth = rng.exponential(1, (*size, 3)).astype(np.float32)
    noisy = compare.colors(rng, *size)
    variance = rng.exponential(0.5, size).astype(np.float32)
    variance[rng.random(size) < 0.1] = np.nan
    variance[rng.random(size) < 0.05] = np.inf
    variance[rng.random(size) < 0.05] = -1
    return smooth, noisy, variance


@each("size", SIZES + TAILS[::4])
@pytest.mark.parametrize(("strictness", "radius"), [(1.0, 1), (0.0, 0), (0.5, 0), (3.0, 2), (0.7, 16)])
def test_reference(size, strictness, radius):
    smooth, noisy, variance = pair(np.random.default_rng(size[1]), size)
    named = {"strictness": strictness, "radius": radius}
    got = yester.restore_detail(smooth, noisy, variance, **named)
    want = reference.restore_detail(*tensor([smooth, noisy, variance]), **named)
    compare.assert_close(
        "restore_detail", got, want, scale=np.nanmax(np.where(np.isfinite(noisy), noisy, 0), initial=1)
    )


def test_noise_stays_out_and_detail_comes_back():
    rng = np.random.default_rng(0)
    truth = np.zeros((64, 64, 3), np.float32)
    truth[:, 32:] = 1
    noisy = truth + rng.normal(0, 0.1, (64, 64, 1)).astype(np.float32)
    smooth, variance = np.full_like(truth, 0.5), np.full((64, 64), 0.01)
    restored = yester.restore_detail(smooth, noisy, variance)
    assert np.abs(restored - truth).mean() < 0.1
    # Where the smooth image is right, the noise of the other hardly comes back.
    assert np.square(yester.restore_detail(truth, noisy, variance, strictness=2.0) - truth).mean() < 0.01 / 20


def test_what_is_unknown_stays_smooth():
    smooth, noisy, variance = pair(np.random.default_rng(1), (20, 30))
    restored = yester.restore_detail(smooth, noisy, variance, strictness=0.0)
    unknown = ~(np.isfinite(noisy).all(-1) & np.isfinite(variance) & (variance >= 0))
    assert unknown.sum() > 20
    assert_same_bits(restored[unknown], smooth[unknown])
    smooth[3, 4] = np.nan
    restored = yester.restore_detail(smooth, noisy, variance)
    assert np.isnan(restored[3, 4]).all()
    assert np.isfinite(np.delete(restored.reshape(-1, 3), 3 * 30 + 4, 0)).all()
    # Differences whose squares overflow exceed any noise.
    huge = np.full((4, 4, 3), 1e30, np.float32)
    assert np.allclose(yester.restore_detail(np.zeros_like(huge), huge, np.ones((4, 4))), huge)


def test_bad_input():
    color, variance = np.ones((4, 5, 3), np.float32), np.ones((4, 5), np.float32)
    for value in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="strictness: expected a finite number from 0"):
            yester.restore_detail(color, color, variance, strictness=value)
    for value in (-1, 17):
        with pytest.raises(ValueError, match="radius: expected 0 to 16"):
            yester.restore_detail(color, color, variance, radius=value)
    with pytest.raises(ValueError, match="noisy: expected height"):
        yester.restore_detail(color, color[1:], variance)
    with pytest.raises(ValueError, match="variance: expected shape"):
        yester.restore_detail(color, color, color)
