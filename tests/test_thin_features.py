import compare
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, each, tensor


@pytest.mark.parametrize("similarity", [1.0, 1.05, 1.5])
@each("size", SIZES + TAILS[::4])
def test_reference(size, similarity):
    rng = np.random.default_rng(size[1])
    color = compare.colors(rng, *size)
    color = np.where(rng.random(size)[..., None] < 0.5, np.round(color), color).astype(np.float32)
    color[rng.random(size) < 0.05] *= -1
    got = yester.thin_features(color, similarity=similarity)
    want, slack = reference.thin_features(tensor(color), similarity=similarity, margin=True)
    # Equal luminances are equal in either precision.
    clear = (slack.numpy() > BAND) | (slack.numpy() == 0)
    compare.assert_close("thin_features", got, want, where=clear)
    assert set(np.unique(got)) <= {0, 1}


def test_lines_are_thin_and_edges_are_not():
    for dark, bright in ((0.1, 1.0), (1.0, 0.1)):
        color = np.full((9, 12, 3), dark, np.float32)
        color[:, 4] = bright
        assert yester.thin_features(color)[1:-1, 4].all()
        assert not np.delete(yester.thin_features(color), 4, 1).any()
        color[:, 5] = bright  # a line of two pixels is not thin
        assert not yester.thin_features(color).any()
        color[:, 4:] = bright
        assert not yester.thin_features(color).any()
        diagonal = np.where(np.eye(9, 12, dtype=bool)[..., None], bright, dark).repeat(3, -1)
        assert (yester.thin_features(diagonal)[np.eye(9, 12, dtype=bool)][1:-1] == 1).all()
    assert not yester.thin_features(np.ones((5, 6, 3))).any()


def test_light_has_no_unit_and_missing_pixels_no_say():
    rng = np.random.default_rng(0)
    color = rng.exponential(1, (20, 30, 3)).astype(np.float32)
    thin = yester.thin_features(color)
    assert 0.05 < thin.mean() < 0.9
    np.testing.assert_array_equal(yester.thin_features(color * np.float32(2**20)), thin)
    color[3, 5, 1] = np.nan
    got = yester.thin_features(color)
    assert got[3, 5] == 0
    assert (got[2:5, 4:7] <= thin[2:5, 4:7]).all()


def test_bad_input():
    color = np.ones((4, 5, 3), np.float32)
    for value in (0.99, np.nan, np.inf):
        with pytest.raises(ValueError, match="similarity: expected a finite ratio from 1"):
            yester.thin_features(color, similarity=value)
    with pytest.raises(ValueError, match="color: expected shape"):
        yester.thin_features(color[..., 0])
