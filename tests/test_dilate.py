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


@each("size", SIZES)
@pytest.mark.parametrize("window", ["3x3", "cross"])
@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_reference_beside_movers(size, window, channels, margin):
    """Bit for bit, where a third of the pixels moves by itself, and some motion is unknown."""
    rng = np.random.default_rng([*size, channels])
    motion, still = compare.motions(rng, *size, channels), compare.motions(rng, *size, 3)
    rests = rng.random(motion.shape[:2]) < 2 / 3
    still[rests, :2] = motion[rests, :2] + rng.uniform(-0.4, 0.4, (rests.sum(), 2)).astype(np.float32)
    depth = compare.surfaces(rng, *size)["depth"].round(1)
    among = {"window": window, "margin": margin}
    want = reference.dilate_motion(tensor(motion), tensor(depth), still=tensor(still), **among)
    got = yester.dilate_motion(motion, depth, still=still, **among)
    assert_same_bits(got, want.numpy().astype(np.float32))
    assert min(size) < 20 or not np.array_equal(got, yester.dilate_motion(motion, depth, **among), equal_nan=True)


def test_the_background_beside_a_mover_keeps_its_motion():
    """Of two posts before a wall, past which the camera moves, one moves by itself."""
    still = np.ones((3, 9, 2), np.float32)
    depth = np.full((3, 9), 5, np.float32)
    depth[:, 2] = depth[:, 6] = 2
    still[:, 2] = still[:, 6] = 2
    motion = still.copy()
    motion[:, 6, 1] += 0.6
    moved = yester.dilate_motion(motion, depth, still=still)
    np.testing.assert_array_equal(moved[1, :, 0], [1, 2, 2, 2, 1, 1, 2, 1, 1])
    np.testing.assert_array_equal(yester.dilate_motion(motion, depth)[1, :, 0], [1, 2, 2, 2, 1, 2, 2, 2, 1])
    # Only those that move by more than half a pixel.
    motion[:, 6, 1] = still[:, 6, 1] + 0.4
    assert_same_bits(yester.dilate_motion(motion, depth, still=still), yester.dilate_motion(motion, depth))


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
    with pytest.raises(ValueError, match=r"still.*needs choose"):
        yester.dilate_motion(motion, choose="longest", still=motion)
    with pytest.raises(ValueError, match="still"):
        yester.dilate_motion(motion, np.ones((4, 4), np.float32), still=motion[:3])
    for margin in (-0.1, 1, np.nan):
        with pytest.raises(ValueError, match="margin: expected a number from 0 to below 1"):
            yester.dilate_motion(motion, choose="longest", margin=margin)
