import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, colors, each, tensor


@each("size", SIZES + TAILS)
def test_reference(size):
    """With holes and negative colours."""
    rng = np.random.default_rng(size[1])
    color = colors(rng, *size)
    color[rng.random(size) < 0.1] *= -1
    assert yester.exposure(color) == pytest.approx(reference.exposure(tensor(color)), rel=1e-5)


def test_by_hand():
    grey = np.full((3, 5, 3), 0.25, np.float32)
    assert yester.exposure(grey) == pytest.approx(2.0)
    grey[:, :2] = 0
    assert yester.exposure(grey) == pytest.approx(2.0 * 0.6**2)
    grey[:, :2] = np.nan
    assert yester.exposure(grey) == pytest.approx(2.0)


@pytest.mark.parametrize("scale", [1e-30, 1e-6, 1e6, 1e30])
def test_goes_with_radiance(scale):
    color = np.random.default_rng(0).exponential(1, (31, 33, 3)).astype(np.float32)
    assert yester.exposure(color * np.float32(scale)) / scale == pytest.approx(yester.exposure(color), rel=1e-4)


def test_a_lamp_moves_it_little():
    """A lamp in a thousandth of the pixels, a hundred thousand times as bright as the rest."""
    color = np.full((50, 80, 3), 0.1, np.float32)
    before = yester.exposure(color)
    color[20, 10:14] *= 1e5
    assert before < yester.exposure(color) < 2 * before


@pytest.mark.parametrize("missing", [0, 3])
def test_a_broken_pixel_does_not_decide(missing):
    """Its row counts for 4096 times the row that is brighter than nine tenths of them."""
    color = np.random.default_rng(0).random((50, 80, 3)).astype(np.float32)
    color[:missing] = np.nan
    color[20, 10] = 1e30
    found = yester.exposure(color)
    assert found == pytest.approx(reference.exposure(tensor(color)), rel=1e-5)
    assert found < 1e5
    color[20, 10] = 1e38
    assert yester.exposure(color) == found


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, 1e-45])
def test_without_light_it_is_one(value):
    assert yester.exposure(np.full((4, 5, 3), value, np.float32)) == 1
