import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def images(rng, height, width, holes):
    color = compare.colors(rng, height, width, holes=holes)
    quality = rng.uniform(0.1, 3, (height, width)).astype(np.float32)
    broken = rng.random(quality.shape) < 0.05
    quality[broken] = rng.choice([np.nan, 0, -1, np.inf], int(broken.sum()))
    return color, quality


def check(color, quality=None, **named):
    got = yester.pull_push(color, quality, **named)
    want = reference.pull_push(tensor(color), tensor(quality), **named)
    assert all(image.dtype == np.float32 for image in got)
    assert_close("pull_push color", got[0], want[0])
    assert_close("pull_push quality", got[1], want[1])
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    holes=st.sampled_from([0.0, 0.5, 0.9, 0.99]),
    factor=st.sampled_from([2, 3, 4, 16]),
    levels=st.sampled_from([None, 1, 2]),
    weighted=st.booleans(),
)
def test_reference(seed, size, holes, factor, levels, weighted):
    color, quality = images(np.random.default_rng(seed), *size, holes)
    check(color, quality if weighted else None, factor=factor, levels=levels)


@each(("height", "width"), SIZES + TAILS[::4])
def test_sizes(height, width):
    check(*images(np.random.default_rng(width), height, width, 0.8))


@pytest.mark.parametrize("channels", [(), (1,), (2,), (7,)])
def test_images_of_any_channels(channels):
    rng = np.random.default_rng(0)
    color = rng.random((17, 30, *channels)).astype(np.float32)
    color[rng.random((17, 30)) < 0.7] = np.nan
    assert check(color)[0].shape == color.shape


@pytest.mark.parametrize("factor", [2, 4])
def test_valid_pixels_stay(factor):
    color, quality = images(np.random.default_rng(0), 30, 41, 0.5)
    got, known = yester.pull_push(color, quality, factor=factor)
    here = np.isfinite(color).all(-1) & np.isfinite(quality) & (quality > 0)
    assert_same_bits(got[here], color[here])
    assert_same_bits(known[here], quality[here])
    assert np.isfinite(got).all()
    assert (known > 0).all()
    assert (known[~here] < quality[here].max()).all()


def test_constant_stays_constant():
    color = np.full((30, 41, 3), np.float32([0.7, 0.1, 3]))
    color[np.random.default_rng(0).random((30, 41)) < 0.9] = np.nan
    got, _ = yester.pull_push(color)
    np.testing.assert_allclose(got, np.broadcast_to(np.float32([0.7, 0.1, 3]), got.shape), rtol=1e-6)


def test_one_point_fills_all():
    color = np.full((37, 50), np.nan, np.float32)
    color[11, 40] = 5
    got, quality = yester.pull_push(color)
    np.testing.assert_allclose(got, 5, rtol=1e-6)
    assert (quality > 0).all()
    assert (quality < 0.1).sum() == quality.size - 1
    got, quality = yester.pull_push(color, levels=2)
    assert 1 < (quality > 0).sum() < 200
    assert (np.isnan(got) == (quality == 0)).all()


@pytest.mark.parametrize("levels", [None, 1])
def test_all_holes_stay(levels):
    """Without valid pixels on any level: NaN with quality 0, and no error."""
    for color, quality in (
        (np.full((9, 10, 3), np.nan), None),
        (np.ones((9, 10, 3)), np.zeros((9, 10))),
        (np.full((1, 1, 3), np.inf), None),
    ):
        got, known = yester.pull_push(color, quality, levels=levels)
        assert np.isnan(got).all()
        assert not known.any()


def test_the_pyramid_of_the_textbook():
    """Levels 1, 4, 16: holes are filled up to half a block of sixteen plus half a block of four from valid pixels."""
    color = np.full((64, 64), np.nan, np.float32)
    color[:16, :16] = 1
    got, _ = check(color, factor=4, levels=2)
    assert np.isfinite(got[:24, :24]).all()
    assert np.isnan(got[26:]).all()
    assert np.isnan(got[:, 26:]).all()


def test_better_pixels_override():
    """Holes between a good and a poor point resemble the good one; twice the quality counts twice in a block."""
    color, quality = np.full((2, 2), np.nan), np.zeros((2, 2))
    color[0] = 1, 4
    quality[0] = 2, 1
    got, known = yester.pull_push(color, quality)
    np.testing.assert_allclose(got[1], (2 * 1 + 1 * 4) / 3, rtol=1e-6)
    np.testing.assert_allclose(known[1], 3 / 16, rtol=1e-6)
    got, _ = yester.pull_push(color, np.where(quality == 2, 1e6, quality))
    np.testing.assert_allclose(got[1], 1, rtol=1e-5)


@pytest.mark.parametrize(("argument", "values"), [("factor", [1, 0, -2, 17]), ("levels", [0, -1])])
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=argument):
            yester.pull_push(np.ones((4, 4)), **{argument: value})
    with pytest.raises(TypeError, match=argument):
        yester.pull_push(np.ones((4, 4)), **{argument: 2.5})
