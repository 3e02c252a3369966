import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor

NEAREST, LONGEST = {"choose": "nearest"}, {"choose": "longest"}


@each("size", SIZES + TAILS[::6])
@pytest.mark.parametrize("window", ["3x3", "cross"])
@pytest.mark.parametrize("choose", ["nearest", "longest"])
@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("margin", [0.0, 0.1, 0.6])
def test_reference(size, window, choose, channels, margin):
    """It only selects: bit for bit, ties included."""
    rng = np.random.default_rng([*size, channels])
    motion = compare.motions(rng, *size, channels)
    depth = compare.surfaces(rng, *size)["depth"].round(1)  # so that there are ties
    want = reference.dilate_motion(tensor(motion), tensor(depth), choose=choose, window=window, margin=margin)
    got = yester.dilate_motion(motion, depth, choose=choose, window=window, margin=margin)
    assert_same_bits(got, want.numpy().astype(np.float32))


def test_an_edge_grows_by_a_pixel():
    depth = np.full((7, 7), 5, np.float32)
    motion = np.zeros((7, 7, 2), np.float32)
    depth[3, 3], motion[3, 3] = 2, (4, -1)
    grown = (yester.dilate_motion(motion, depth)[..., 0] == 4).nonzero()
    np.testing.assert_array_equal(grown, np.mgrid[2:5, 2:5].reshape(2, -1))
    cross = yester.dilate_motion(motion, depth, window="cross")[..., 0] == 4
    assert cross.sum() == 5
    assert_same_bits(yester.dilate_motion(motion, choose="longest"), yester.dilate_motion(motion, depth))


def test_a_slope_keeps_its_motion_and_an_edge_grows():
    """A plane that turns, and before it a column that is nearer than the margin."""
    depth = np.tile(np.linspace(5, 4, 16, dtype=np.float32), (4, 1))
    motion = np.stack([depth, np.zeros_like(depth)], -1)
    assert_same_bits(yester.dilate_motion(motion, depth, margin=0.1), motion)
    assert_same_bits(yester.dilate_motion(motion, choose="longest", margin=0.1), motion)
    depth[:, 8], motion[:, 8] = 3, (9, 9)
    grown = (yester.dilate_motion(motion, depth, margin=0.1)[..., 1] == 9).any(0).nonzero()[0]
    np.testing.assert_array_equal(grown, [7, 8, 9])


def test_uniform_motion_stays():
    motion = np.full((9, 11, 3), 0.25, np.float32)
    depth = np.random.default_rng(0).uniform(1, 2, (9, 11)).astype(np.float32)
    for named in (NEAREST, LONGEST):
        assert_same_bits(yester.dilate_motion(motion, depth, **named), motion)


def test_unknown_motion_is_chosen_last():
    motion = np.full((1, 3, 2), np.nan, np.float32)
    motion[0, 2] = 7
    depth = np.float32([[1, 2, np.inf]])
    np.testing.assert_array_equal(yester.dilate_motion(motion, depth)[0], [[np.nan] * 2, [7, 7], [7, 7]])


def test_bad_modes():
    motion = np.zeros((4, 4, 2), np.float32)
    with pytest.raises(ValueError, match=r"nearest.*needs depth"):
        yester.dilate_motion(motion)
    with pytest.raises(ValueError, match=r'choose: expected one of "nearest", "longest"'):
        yester.dilate_motion(motion, choose="widest")
    with pytest.raises(ValueError, match=r'window: expected one of "3x3", "cross"'):
        yester.dilate_motion(motion, choose="longest", window="5x5")
    with pytest.raises(ValueError, match="depth"):
        yester.dilate_motion(motion, np.ones((4, 5), np.float32))
    for margin in (-0.1, 1, np.nan):
        with pytest.raises(ValueError, match="margin: expected a number from 0 to below 1"):
            yester.dilate_motion(motion, choose="longest", margin=margin)
