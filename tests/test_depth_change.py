import re

import composed
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def check(depth, previous, motion) -> float:
    got = yester.depth_change(depth, previous, motion)
    assert got == pytest.approx(reference.depth_change(tensor(depth), tensor(previous), tensor(motion)), rel=1e-5)
    return got


def rolling(height: int, width: int, seed=0) -> tuple[np.ndarray, np.ndarray]:
    """A depth, and a motion of some pixels that leads out of the image here and there."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(4, 6, (height, width)).astype(np.float32)
    return depth, rng.normal(0, 3, (height, width, 2)).astype(np.float32)


def dolly(count: int, step=0.8, height=48, width=64) -> list[yester.Frame]:
    """Noisy frames of a wall that comes closer by so much a frame, without change of depth in their motion."""
    rng, frames = np.random.default_rng(3), []
    y, x = np.mgrid[:height, :width].astype(np.float32)
    from_middle = np.stack([x - (width - 1) / 2, y - (height - 1) / 2], -1)
    for distance in 8 - step * np.arange(count):
        depth = np.full((height, width), distance, np.float32)
        motion = from_middle * np.float32(distance / (distance + step) - 1)
        frames.append(
            yester.Frame(rng.exponential(1, (height, width, 3)).astype(np.float32), depth=depth, motion=motion)
        )
    return frames


@each("size", SIZES + TAILS)
@pytest.mark.parametrize("change", [0.0, 0.2, 1.2, -1.0])
def test_reference(size, change):
    """With missing values, and in images of too few pixels."""
    depth, motion = rolling(*size)
    previous = rolling(*size, seed=1)[0] + np.float32(change)
    depth[::5, ::3], previous[1::4] = np.inf, np.nan
    motion[::7] = np.nan
    check(depth, previous, motion)
    check(depth, previous, np.zeros((*size, 3), np.float32))


@given(change=st.floats(-1, 1.2), scale=st.floats(1e-6, 1e6))
def test_finds_the_change_at_every_scale(change, scale):
    """Where it is large enough to reject the history of some pixels."""
    depth, _ = rolling(40, 48)
    depth *= np.float32(scale)
    found = check(depth, depth + np.float32(change * scale), np.zeros((40, 48, 2), np.float32))
    if abs(abs(change) - 0.4) > 0.02:  # a tenth of the least depth
        assert found == pytest.approx(change * scale if abs(change) > 0.4 else 0, rel=1e-3)


def test_follows_the_motion():
    depth, _ = rolling(64, 64)
    motion = np.full((64, 64, 2), (3, -2), np.float32)
    assert check(depth, np.roll(depth, (-2, 3), (0, 1)) + 1, motion) == pytest.approx(1)
    assert check(depth, np.roll(depth, (2, 3), (0, 1)) + 1, motion) == 0


def test_changes_that_are_not_of_most_surfaces_are_none():
    depth = np.full((64, 64), 5, np.float32)
    motion = np.zeros((64, 64, 2), np.float32)
    previous = depth.copy()
    previous[:, :24] += 1
    assert check(depth, previous, motion) == 0
    # Behind a cut from one wall to another that is much farther away.
    assert check(depth, depth + 2, motion) == 0
    assert check(depth, np.full_like(depth, np.inf), motion) == 0


@pytest.mark.parametrize("pipeline", ["SVGF", "BMFR", "HalfRes"])
def test_a_camera_that_moves_along_its_view_keeps_history(pipeline):
    made, other = getattr(yester, pipeline)(), getattr(composed, pipeline)()
    for i, frame in enumerate(dolly(5)):
        got, want = made.step(frame), other.step(frame)
        for name in ("color", "confidence", "rejection", "history_length"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.confidence.mean() > (0.8 if i else -1)


def test_antialiasing_that_tests_depth_keeps_history():
    taa, plain = yester.TAA("best", relative_depth=0.1), composed.TAA("best", relative_depth=0.1)
    for i, frame in enumerate(dolly(4)):
        got, want = taa.step(frame), plain.step(frame)
        assert_same_bits(got.color, want.color)
        assert got.confidence.mean() > (0.8 if i else -1)


def test_cuts_lose_it():
    """Nothing else tells what a wall is that was much nearer."""
    before, other = dolly(2)
    svgf = yester.SVGF()
    svgf.step(before)
    after = yester.Frame(other.color, depth=before.depth * np.float32(1.5), motion=before.motion)
    assert svgf.step(after).confidence.max() == 0


@pytest.mark.parametrize("name", ["depth", "previous_depth", "motion"])
def test_bad_input(name):
    depth, motion = rolling(9, 10)
    given = {"depth": depth, "previous_depth": depth, "motion": motion}
    with pytest.raises(ValueError, match=re.escape("expected height 9") if name != "depth" else "expected height 8"):
        yester.depth_change(**given | {name: given[name][:-1]})
