import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, each, tensor


@each(("height", "width"), SIZES + TAILS)
def test_reference(height, width):
    rng = np.random.default_rng(width)
    color, emission = compare.colors(rng, height, width), compare.colors(rng, height, width)
    albedo = rng.uniform(-0.1, 1.2, (height, width, 3)).astype(np.float32)
    albedo[rng.random((height, width)) < 0.3] *= 0.03
    albedo[rng.random((height, width)) < 0.2] *= 0.003
    albedo[rng.random((height, width)) < 0.1] = rng.choice([0, np.nan, np.inf, 1e-5, 30])
    for name in ("demodulate", "remodulate"):
        for named in ({}, {"emission": emission}):
            got = getattr(yester, name)(color, albedo, **named)
            want = getattr(reference, name)(tensor(color), tensor(albedo), **tensor(named)).numpy()
            assert got.dtype == np.float32
            # Differences of numbers near one, divided by 1/32 or more.
            scale = 32 if name == "demodulate" else 1
            missing = ~np.isfinite(want).all(-1)
            np.testing.assert_array_equal(~np.isfinite(got).all(-1), missing)
            assert_close(name, got, want, scale=scale, where=~missing)


@pytest.mark.parametrize("emission", [False, True])
def test_back_and_forth(emission):
    rng = np.random.default_rng(0)
    color = compare.colors(rng, 20, 30)
    albedo = rng.uniform(0, 1, color.shape).astype(np.float32)
    albedo[3] = 0
    named = {"emission": rng.exponential(0.1, color.shape).astype(np.float32)} if emission else {}
    back = yester.remodulate(yester.demodulate(color, albedo, **named), albedo, **named)
    seen = np.isfinite(color).all(-1)
    np.testing.assert_allclose(back[seen], color[seen], rtol=1e-5, atol=1e-6)
    assert not np.isfinite(back[~seen]).all(-1).any()


def test_white_is_the_identity():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, np.ones_like(color)), color)
    np.testing.assert_array_equal(yester.remodulate(color, np.ones_like(color)), color)


def test_black_albedo_divides_by_one():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, 0 * color), color)
    np.testing.assert_array_equal(yester.remodulate(color, 0 * color), color)


def test_no_reflectance_exceeds_one():
    color = compare.colors(np.random.default_rng(0), 5, 7, holes=0)
    np.testing.assert_array_equal(yester.demodulate(color, np.full_like(color, 30)), color)


def test_light_never_explodes():
    albedo = np.broadcast_to(np.geomspace(1e-6, 10, 1000, dtype=np.float32)[:, None], (1000, 3))[None]
    light = yester.demodulate(np.ones_like(albedo), albedo)
    np.testing.assert_allclose(light, 1 / np.clip(albedo, 1 / 32, 1), rtol=1e-6)


def test_one_channel_of_three_may_be_black():
    """Pure red is a valid reflectance."""
    light = yester.demodulate(np.ones((1, 1, 3), np.float32), np.float32([[[0.5, 0, 0]]]))
    np.testing.assert_array_equal(light, [[[2, 32, 32]]])


def test_broken_albedo_and_emission_count_as_zero():
    color = np.ones((1, 3, 3), np.float32)
    broken = np.full_like(color, np.nan)
    np.testing.assert_array_equal(yester.demodulate(color, broken), yester.demodulate(color, 0 * color))
    np.testing.assert_array_equal(yester.demodulate(color, color, emission=broken), color)
    np.testing.assert_array_equal(yester.remodulate(color, color, emission=broken), color)
