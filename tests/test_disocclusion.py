import compare
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def check(depth, motion, **named):
    got = yester.disocclusion(depth, motion, **named)
    want, slack = reference.disocclusion(tensor(depth), tensor(motion), margin=True, **named)
    clear = slack.numpy() > BAND
    compare.assert_close("disocclusion", got, want, scale=1.0, where=clear)
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    channels=st.sampled_from([2, 3]),
    separation=st.sampled_from([0.0, 0.01, 0.05, 0.3, 1.0]),
)
def test_reference(seed, size, channels, separation):
    rng = np.random.default_rng(seed)
    depth = compare.surfaces(rng, *size)["depth"]
    check(depth, compare.motions(rng, *size, channels), separation=separation)


@each("size", SIZES + TAILS[::3])
def test_sizes(size):
    rng = np.random.default_rng(size[1])
    check(compare.surfaces(rng, *size)["depth"], compare.motions(rng, *size, 3))


def moving_square(step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square in front of a wall, moved `step` pixels to the right; and the mask of newly visible wall."""
    depth, motion = np.full((20, 30), 5, np.float32), np.zeros((20, 30, 2), np.float32)
    depth[6:14, 12:20], motion[6:14, 12:20, 0] = 2, -step
    hidden = np.zeros((20, 30), bool)
    hidden[6:14, 12 - step : 12] = True
    return depth, motion, hidden


def test_newly_visible_surfaces_are_marked():
    for step in (3, 5):
        depth, motion, hidden = moving_square(step)
        share = check(depth, motion)
        # The edge itself, one pixel wide, moves with the square, and so does its mark.
        assert (share[6:14, 12 - step : 11] == 1).all()
        assert (share[7:13, 13:19] == 0).all()
        around = np.pad(hidden, 1)
        near = np.any([around[a : a + 20, b : b + 30] for a in range(3) for b in range(3)], 0)
        assert not share[~near].any()


def test_a_slope_is_no_edge():
    """A floor that recedes by 2 % a pixel, under a camera that moves over it."""
    depth = np.broadcast_to((2 * 1.02 ** np.arange(40, dtype=np.float32))[::-1, None], (40, 30))
    for step in (0.0, 0.3, 1.5):
        motion = np.full((40, 30, 2), step, np.float32)
        assert not yester.disocclusion(depth, motion)[3:-3, 3:-3].any()


def test_standing_still_nothing_is_hidden():
    rng = np.random.default_rng(0)
    depth = compare.surfaces(rng, 30, 40)["depth"]
    assert not yester.disocclusion(depth, np.zeros((30, 40, 2))).any()


def test_outside_and_unknown_motion():
    depth, motion = np.ones((8, 9), np.float32), np.zeros((8, 9, 2), np.float32)
    motion[:, :, 0] = 100
    assert (yester.disocclusion(depth, motion) == 1).all()
    motion[:] = np.nan
    assert (yester.disocclusion(depth, motion) == 1).all()


def test_unknown_change_of_depth_hides_nothing():
    """A pixel whose depth moves nobody knows where is left out, instead of standing at depth 0 before all others."""
    rng = np.random.default_rng(3)
    depth, motion = compare.surfaces(rng, 30, 40)["depth"], compare.motions(rng, 30, 40, 3)
    motion[10:20, 10:30, 2] = np.nan
    check(depth, motion)
    still = np.zeros((30, 40, 3), np.float32)
    still[10:20, 10:30, 2] = np.nan
    share = check(np.ones_like(depth), still)
    assert not share[:9].any()
    assert not share[21:].any()


def test_bad_input():
    depth, motion = np.ones((4, 5), np.float32), np.zeros((4, 5, 2), np.float32)
    for value in (-0.1, 1.1, np.nan):
        with pytest.raises(ValueError, match="separation: expected a fraction from 0 to 1"):
            yester.disocclusion(depth, motion, separation=value)
    with pytest.raises(ValueError, match="motion: expected height 4 and width 5"):
        yester.disocclusion(depth, motion[:3])
    with pytest.raises(ValueError, match="depth: expected shape"):
        yester.disocclusion(motion, motion)
