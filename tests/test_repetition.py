import warnings
from contextlib import nullcontext as nothing

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from calls import calls
from compare import SIZES, TAILS, each, tensor
from hypothesis import given
from hypothesis import strategies as st

SIZE = 96, 72  # 9 rows of 95 pairs are looked at


def shots(count: int, *, seeds, size=SIZE, step=1):
    """Frames with multiplied noise of these seeds, on the screen."""
    for number, seed in enumerate(seeds[:count]):
        now, before = (flight.scene(n, flight.camera(n, *size)) for n in (number * step, (number - 1) * step))
        shot = flight.sample(now, before)
        color = shot.color * np.random.default_rng(seed).gamma(2, 0.5, (*shot.shape, 1))
        yield yester.Frame(**{**shot.buffers(), "color": color.astype(np.float32)}, camera=shot.camera)


def repetitions(frames) -> list[float]:
    found, before, deviation = [], None, None
    for frame in frames:
        if before is not None:
            share, deviation = yester.repetition(frame.color, before, frame.motion, deviation)
            found.append(share)
        before = frame.color
    return found


def check(color, previous, motion, deviation):
    got, found = yester.repetition(color, previous, motion, deviation)
    given = None if deviation is None else tensor(deviation)
    want, expected = reference.repetition(tensor(color), tensor(previous), tensor(motion), given)
    assert got == pytest.approx(want, abs=1e-5)
    np.testing.assert_allclose(found, expected.numpy(), rtol=0, atol=1e-5)
    assert 0 <= got <= 1


@each(("height", "width"), SIZES + TAILS)
def test_reference(height, width):
    check(**calls(height, width)["repetition"][1])


@given(
    seed=st.integers(0, 2**32),
    sticks=st.floats(0, 1),
    grain=st.floats(0.01, 1),
    moves=st.floats(0, 3),
    bare=st.booleans(),
)
def test_reference_by_noise(seed, sticks, grain, moves, bare):
    rng = np.random.default_rng(seed)
    size = 41, 70
    noise = rng.normal(size=(4, *size, 1))
    light = rng.uniform(0.5, 1, (*size, 3))
    color, previous = (light * np.exp(grain * (sticks * noise[0] + (1 - sticks) * noise[k])) for k in (1, 2))
    color[rng.random(size) < 0.05] = np.nan
    same = rng.random(size) < sticks**4
    color[same] = previous[same]
    deviation = None if bare else np.tanh(grain * (sticks * noise[0] + noise[3]))[:12, :, 0]
    check(*(np.float32(each) for each in (color, previous, rng.normal(0, moves, (*size, 2)))), deviation)


def test_independent_noise():
    assert max(repetitions(shots(6, seeds=range(6)))) < 0.16


@pytest.mark.parametrize("motion", [(1, 0), (-1, 0), (0, 1), (1, 1), (0.75, 0.75), (1.5, 0)])
def test_independent_noise_that_moves_by_a_pixel(motion):
    """Neighbours in a row then share a sample with those of the frame before, with the same sign."""
    rng = np.random.default_rng(0)
    moved = np.float32(motion) * np.ones((96, 160, 1), np.float32)
    noise = rng.gamma(1, 1, (12, 96, 160, 1)).repeat(3, -1).astype(np.float32)
    assert max(repetitions([yester.Frame(color, motion=moved) for color in noise])) < 0.16


@pytest.mark.parametrize("step", [1, 3])
def test_noise_of_one_seed(step):
    """Known at the third frame, since two deviations are compared."""
    assert min(repetitions(shots(6, seeds=[7] * 6, step=step))[1:]) > 0.39


def test_one_frame_again():
    frame = next(shots(1, seeds=[0]))
    share, _ = yester.repetition(frame.color, frame.color, np.zeros_like(frame.motion))
    assert share > 0.6


def test_still_light_is_no_noise():
    """Renders without noise: what fetching loses of their texture repeats, and all of it does where nothing moves."""
    frames = [flight.shoot(number, *SIZE) for number in range(5)]
    assert max(repetitions(frames)) < 0.3
    color = frames[0].color
    share, _ = yester.repetition(color, color, np.zeros((*color.shape[:2], 2)))
    assert share < 0.3


@pytest.mark.parametrize("power", [-40, -3, 3, 40])
def test_brightness_changes_nothing(power):
    color, previous = (frame.color for frame in shots(2, seeds=[3, 3]))
    known = np.zeros((*color.shape[:2], 2)), np.full((18, SIZE[0]), 0.5, np.float32)
    wants = yester.repetition(color, previous, *known)
    scale = np.float32(2.0**power)
    gots = yester.repetition(color * scale, previous * scale, *known)
    assert gots[0] == wants[0]
    np.testing.assert_array_equal(gots[1], wants[1])


@pytest.mark.parametrize("value", [0, np.nan, np.inf, -1, 3e38])
def test_frames_without_noise(value):
    color = np.full((72, 96, 3), value, np.float32)
    motion = np.zeros((72, 96, 2))
    share, deviation = yester.repetition(color, color, motion)
    assert share == 0
    assert yester.repetition(color, color, motion, deviation)[0] == 0


def test_few_pixels_tell_nothing():
    color = np.random.default_rng(0).random((16, 128, 3))  # 2 rows of 127 pairs
    assert yester.repetition(color, color, np.zeros((16, 128, 2)))[0] == 0
    color = np.random.default_rng(0).random((18, 128, 3))
    assert yester.repetition(color, color, np.zeros((18, 128, 2)))[0] > 0.6


def test_out():
    given = calls(20, 13)["repetition"][1]
    out = np.empty((6, 13), np.float32)
    share, deviation = yester.repetition(**given, out=out)
    assert deviation is out
    np.testing.assert_array_equal(out, yester.repetition(**given)[1])
    assert isinstance(share, float)


@pytest.mark.parametrize("name", ["color", "previous", "motion", "deviation"])
def test_wrong_sizes(name):
    given = calls(20, 13)["repetition"][1]
    with pytest.raises(ValueError, match=r"(previous|motion|deviation): expected"):
        yester.repetition(**given | {name: given[name][:-1]})


# Within the pipelines.


def errors(pipeline, frames, truths) -> list[float]:
    colors = [pipeline.step(frame).color for frame in frames]
    return [
        float(((color - truth) ** 2 / (truth + 0.1) ** 2).mean()) for color, truth in zip(colors, truths, strict=True)
    ]


def still(count: int):
    """The same frame again and again, and what it shows."""
    (frame,) = shots(1, seeds=[0])
    moving = frame.motion * 0
    frames = [yester.Frame(**{**frame.buffers(), "motion": moving}, camera=frame.camera)] * count
    return frames, [flight.shoot(0, *SIZE).color] * count


@pytest.mark.parametrize("kind", ["still", "moving"])
@pytest.mark.parametrize("method", [yester.SVGF, yester.BMFR])
def test_repeated_noise_is_not_shown(method, kind):
    """A denoiser that takes it for detail shows the samples as they came."""
    if kind == "still":
        frames, truths = still(10)
    else:
        frames = [*shots(10, seeds=[5] * 10)]
        truths = [flight.shoot(number, *SIZE).color for number in range(10)]
    noisy = np.mean([((f.color - t) ** 2 / (t + 0.1) ** 2).mean() for f, t in zip(frames[5:], truths[5:], strict=True)])
    with pytest.warns(UserWarning, match="color: expected new noise in every frame"):
        found = errors(method(), frames, truths)
    assert np.mean(found[5:]) < noisy / 4


def test_samples_of_repeated_noise_are_not_mixed_in():
    """Behind a denoiser of one's own."""
    frames, truths = still(10)
    stage, other = yester.TAA("denoised"), yester.TAA("denoised", choice=False)
    smooth = [yester.Frame(truth, motion=frame.motion) for frame, truth in zip(frames, truths, strict=True)]
    for number, (frame, image) in enumerate(zip(frames, smooth, strict=True)):
        with pytest.warns(UserWarning, match="color: expected") if number > 0 else nothing():
            got = stage.step(image, samples=frame.color).color
        np.testing.assert_array_equal(got, other.step(image, samples=frame.color).color)


def test_choice_tells_the_usual_passes():
    frames, _ = still(3)
    svgf = yester.SVGF()
    svgf.step(frames[0])
    with pytest.warns(UserWarning, match="color: expected"):
        assert (svgf.step(frames[1]).choice == 3).all()


def test_as_composed():
    """The pipelines have the bits of their kernels where noise repeats, and stops to."""
    seeds = [1, 1, 1, 1, 2, 3, 4]
    for ours, theirs in ((yester.SVGF(), composed.SVGF()), (yester.BMFR(), composed.BMFR())):
        flags = []
        for frame in shots(len(seeds), seeds=seeds):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                got = ours.step(frame)
            want = theirs.step(frame)
            flags.append(theirs.repeats)
            np.testing.assert_array_equal(got.color, want.color)
            if got.choice is not None:
                np.testing.assert_array_equal(got.choice, want.choice)
        assert flags == [False, True, True, True, False, False, False]
