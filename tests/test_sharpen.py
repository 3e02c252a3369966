import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor


@each("size", SIZES + TAILS[::4])
@pytest.mark.parametrize(("strength", "exposure"), [(0.0, 1.0), (0.3, 1.0), (0.5, 0.2), (1.0, 3.0)])
def test_reference(size, strength, exposure):
    rng = np.random.default_rng(size[1])
    color = compare.colors(rng, *size)
    color[rng.random(size) < 0.05] *= -1
    got = yester.sharpen(color, strength=strength, exposure=exposure)
    want = reference.sharpen(tensor(color), strength=strength, exposure=exposure).numpy()
    # Tone curves cost bright colours one digit of precision.
    bright = np.where(np.isfinite(color).all(-1), np.abs(np.nan_to_num(color)).max(-1), 0)
    scale = (1 + np.max(bright, initial=0) / exposure) * np.max(bright, initial=1)
    compare.assert_close("sharpen", got, want, scale=scale)


def test_off_is_the_image():
    color = compare.colors(np.random.default_rng(0), 20, 30)
    assert_same_bits(yester.sharpen(color, strength=0.0), color)
    plain = np.full((6, 7, 3), 0.4, np.float32)
    np.testing.assert_allclose(yester.sharpen(plain, strength=1.0), plain, rtol=1e-6)


def test_edges_become_steeper_without_halos():
    ramp = np.float32([0.1, 0.1, 0.15, 0.3, 0.6, 0.75, 0.8, 0.8])
    color = np.broadcast_to(ramp[None, :, None], (5, 8, 3))
    slopes = [np.abs(np.diff(yester.sharpen(color, strength=s)[2, :, 0])).max() for s in (0.0, 0.5, 1.0)]
    assert slopes[0] < slopes[1] < slopes[2]
    sharp = yester.sharpen(color, strength=1.0)
    assert sharp.min() >= np.float32(0.1) * (1 - 1e-6)
    assert sharp.max() <= np.float32(0.8) * (1 + 1e-6)


def test_range_of_the_five_and_missing_pixels():
    rng = np.random.default_rng(1)
    color = rng.exponential(1, (30, 40, 3)).astype(np.float32)
    color[4, 7] = np.nan
    color[9, 9] = 3e38
    got = yester.sharpen(color, strength=1.0)
    assert np.isnan(got[4, 7]).all()
    assert np.isfinite(np.delete(got.reshape(-1, 3), 4 * 40 + 7, 0)).all()


def test_bad_input():
    color = np.ones((4, 5, 3), np.float32)
    for value in (-0.1, 1.1, np.nan):
        with pytest.raises(ValueError, match="strength: expected a fraction from 0 to 1"):
            yester.sharpen(color, strength=value)
    for value in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="exposure: expected a finite number above 0"):
            yester.sharpen(color, exposure=value)
    with pytest.raises(ValueError, match="color: expected shape"):
        yester.sharpen(color[..., :2])
