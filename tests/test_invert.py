import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from yester import Camera


@each("size", SIZES + TAILS[::6])
@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("absent", [(), ("depth",), ("still",), ("depth", "still")])
def test_reference(size, channels, absent):
    """It only selects: bit for bit, ties included."""
    rng = np.random.default_rng([*size, channels])
    motion = compare.motions(rng, *size, channels)
    given = {
        "depth": compare.surfaces(rng, *size)["depth"].round(1),  # so that there are ties
        "still": (rng.normal(0, 0.4, motion.shape) - motion).astype(np.float32),
    }
    given = {name: value for name, value in given.items() if name not in absent}
    want = reference.invert_motion(tensor(motion), **tensor(given))
    assert_same_bits(yester.invert_motion(motion, **given), want.numpy().astype(np.float32))


@given(dx=st.integers(-5, 5), dy=st.integers(-5, 5), size=st.tuples(st.integers(1, 20), st.integers(1, 20)))
def test_whole_pixels_are_inverted_exactly(dx, dy, size):
    """Known where pixels move to, unknown where the image enters."""
    height, width = size
    motion = np.broadcast_to(np.float32([dx, dy]), (height, width, 2))
    got = yester.invert_motion(motion)
    y, x = np.mgrid[:height, :width]
    seen = (x - dx >= 0) & (x - dx < width) & (y - dy >= 0) & (y - dy < height)
    np.testing.assert_array_equal(got, np.where(seen[..., None], np.float32([-dx, -dy]), np.nan))


def test_the_nearest_surface_stays():
    motion = np.float32([[[0, 0], [0, 0], [-1, 0]]])
    assert yester.invert_motion(motion, np.float32([[3, 2, 1]]))[0, 1, 0] == 1
    assert yester.invert_motion(motion, np.float32([[3, 1, 2]]))[0, 1, 0] == 0
    # Depth is of this frame.
    motion = np.float32([[[0, 0, 0], [0, 0, 0], [-1, 0, 3]]])
    np.testing.assert_array_equal(yester.invert_motion(motion, np.float32([[3, 2, 1]]))[0, 1], [0, 0, 0])


def test_without_depth_changes_of_depth_do_not_matter():
    motion = compare.motions(np.random.default_rng(0), 20, 30, 3)
    motion[..., 2] -= 2
    assert_same_bits(yester.invert_motion(motion)[..., :2], yester.invert_motion(motion[..., :2]))


def test_cracks_are_closed_and_holes_stay():
    """Points that move apart by 5 % leave no gap between them; uncovered pixels stay unknown."""
    y, x = np.mgrid[:40, :60].astype(np.float32)
    motion = np.stack([0.05 * (x - 30), 0.05 * (y - 20)], -1)
    assert np.isfinite(yester.invert_motion(motion)).all()
    motion = np.where(x[..., None] < 30, np.float32([-4, 0]), np.float32([4, 0]))
    got = np.isnan(yester.invert_motion(motion)[..., 0])
    np.testing.assert_array_equal(got, (x >= 26) & (x < 34))


def test_it_undoes_the_motion_of_a_turning_plane():
    """Inverted motion differs from the cameras' motion by no more than motion changes within half a pixel."""
    one, two = (Camera.from_look_at([x, 0.3, 5], [0, 0, 0], [0, 1, 0], 50, 64, 48) for x in (0.0, 0.4))
    height = np.linspace(-1, 1, 48, dtype=np.float32)[:, None]
    depth = np.broadcast_to(5 + height, (48, 64))
    motion = yester.motion_vectors(depth, two, one)
    there = yester.motion_vectors(depth, one, two)
    got = yester.invert_motion(motion, depth)
    seen = np.isfinite(got[..., 0])
    assert seen.mean() > 0.9
    assert np.abs(got - there)[seen][:, :2].max() < 0.5
    # With the static scene's motion it is exact wherever nothing else moves.
    assert_same_bits(yester.invert_motion(motion, depth, still=there), there)
    # A moving block keeps its own motion.
    motion[20:30, 20:30, 0] += 6
    got = yester.invert_motion(motion, depth - (motion[..., 0] > motion[0, 0, 0] + 3), still=there)
    assert 80 <= (np.abs(got - there)[..., 0] > 3).sum() <= 120


def test_bad_input():
    motion = np.zeros((4, 5, 3), np.float32)
    with pytest.raises(ValueError, match="depth"):
        yester.invert_motion(motion, np.ones((4, 4), np.float32))
    with pytest.raises(ValueError, match=r"still: expected shape \[4, 5, 3\], got shape \[4, 5, 2\]"):
        yester.invert_motion(motion, still=motion[..., :2])
    with pytest.raises(ValueError, match="motion"):
        yester.invert_motion(motion[..., 0])
