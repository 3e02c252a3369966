"""Motion of another direction or unit is reported at the second frame; valid motion never is."""

import re
import warnings
from dataclasses import replace

import flight
import numpy as np
import pytest
import yester
from yester._core import collect_warnings

HEIGHT, WIDTH = 120, 160
PIPELINES = [yester.SVGF, yester.TAA, yester.BMFR, yester.HalfRes, yester.Upscaler, yester.Recirculation]
#: Factors on the motion, and the advice of the warning.
MISTAKES = {
    "y up": ((1, -1), "y up: multiply x by 1 and y by -1"),
    "negated": ((-1, -1), "from previous to current position: multiply x by -1 and y by -1"),
    "ndc": ((2 / WIDTH, 2 / HEIGHT), f"normalised device coordinates and .* x by {WIDTH // 2} and y by {HEIGHT // 2} "),
    "ndc, y up": ((2 / WIDTH, -2 / HEIGHT), f"y up: multiply x by {WIDTH // 2} and y by -{HEIGHT // 2}"),
    "shares": ((1 / WIDTH, 1 / HEIGHT), f"shares of the image's sides and .* x by {WIDTH} and y by {HEIGHT} "),
}


def texture(shot):
    """Albedo with some detail on the ground and the box, as textures have."""
    x, y, z = np.moveaxis(np.nan_to_num(shot.position), -1, 0)
    pattern = 0.75 + 0.25 * np.sin(9 * x) * np.cos(7 * z + 5 * y)
    return (shot.albedo * pattern[..., None]).astype(np.float32)


def sequence(buffers, factors=(1.0, 1.0), numbers=(0, 1), *, moving=True):
    """Frames of the scene with some buffers and motion that is multiplied by factors."""
    rng, before = np.random.default_rng(0), None
    for number in numbers:
        now = flight.scene(number, flight.camera(number if moving else 0, WIDTH, HEIGHT))
        shot, before = flight.sample(now, before or now), now
        motion = shot.motion.copy()
        motion[..., :2] *= np.float32(factors)
        left_out = {name: None for name in ("albedo", "normal", "depth", "ids", "position", "camera")}
        known = {"albedo": texture(shot), **{name: getattr(shot, name) for name in buffers if name != "albedo"}}
        known = {name: known[name] for name in buffers}
        yield replace(shot, **left_out | known, color=flight.noisy(shot, rng), motion=motion)


CAMERAS, SURFACES = ("depth", "camera"), ("albedo", "normal")


@pytest.mark.parametrize(
    ("buffers", "mistake"),
    [
        *((buffers, mistake) for buffers in (CAMERAS, SURFACES) for mistake in MISTAKES),
        *((("albedo",), mistake) for mistake in ("y up", "negated", "ndc, y up")),
    ],
)
def test_mistakes_are_named(buffers, mistake):
    factors, advice = MISTAKES[mistake]
    steps = yester.TAA()
    first, second = sequence(buffers, factors)
    steps.step(first)
    with pytest.warns(
        UserWarning, match=rf"^motion: expected previous minus current .*{advice}.*\(`yester check` tells more\)$"
    ):
        steps.step(second)
    # Once per sequence.
    steps.step(second)
    steps.reset()
    steps.step(first)
    with pytest.warns(UserWarning, match="^motion: expected"):
        steps.step(second)


def test_y_up_is_found_where_most_motion_is_horizontal():
    """A camera that moves ten times as far to the side as up."""
    color, depth = np.ones((HEIGHT, WIDTH, 3), np.float32), np.full((HEIGHT, WIDTH), 3, np.float32)
    eyes = [0, 0, 0], [0.3, 0.03, 0]
    looks = ([x, y, -1] for x, y, _ in eyes)
    before, now = (
        yester.Camera.from_look_at(eye, look, [0, 1, 0], 60, WIDTH, HEIGHT)
        for eye, look in zip(eyes, looks, strict=True)
    )
    motion = yester.motion_vectors(depth, now, before)
    for sign in (1, -1):
        steps = yester.TAA()
        steps.step(yester.Frame(color, depth=depth, camera=before, motion=np.zeros_like(motion)))
        second = yester.Frame(color, depth=depth, camera=now, motion=motion * np.float32([1, sign, 1]))
        if sign > 0:
            steps.step(second)
        else:
            with pytest.warns(UserWarning, match="y up: multiply x by 1 and y by -1"):
                steps.step(second)


@pytest.mark.parametrize("pipeline", PIPELINES)
def test_every_pipeline_checks_and_computes_the_same(pipeline):
    steps = pipeline()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        outputs = [steps.step(frame) for frame in sequence(CAMERAS, (1, -1), (0, 1, 2))]
    assert [str(warning.message)[:7] for warning in caught] == ["motion:"]
    # Without cameras, and with only one buffer of the surface, there is no clear evidence.
    quiet = pipeline()
    if pipeline is not yester.Recirculation:  # needs cameras
        for frame, output in zip(sequence(("depth",), (1, -1), (0, 1, 2)), outputs, strict=True):
            assert quiet.step(frame).color.shape == output.color.shape


@pytest.mark.parametrize("buffers", [CAMERAS, SURFACES, ("albedo",), ("depth",), ()])
@pytest.mark.parametrize("numbers", [(0, 1), (3, 4), (0, 4), (8, 2), (0, 40)], ids=str)
def test_no_false_alarms(buffers, numbers):
    """Slow and fast flights, forward and back, and a long jump; pytest turns warnings into errors."""
    steps = yester.TAA()
    for frame in sequence(buffers, numbers=numbers):
        steps.step(frame)


@pytest.mark.parametrize("buffers", [CAMERAS, SURFACES, ("albedo",), ()])
@pytest.mark.parametrize("factors", [(1, 1), (0, 0), (1e-3, 1e-3)])
def test_no_false_alarms_when_only_the_ball_moves(buffers, factors):
    steps = yester.TAA()
    for frame in sequence(buffers, factors, (0, 3), moving=False):
        steps.step(frame)


@pytest.mark.parametrize("buffers", [CAMERAS, SURFACES, ("albedo",), ()])
@pytest.mark.parametrize("factors", [(1, 1), (0.5, 0.5), (0, 0)])
def test_no_false_alarms_at_a_cut(buffers, factors):
    """A cut to another view, with the motion of a continuous flight, or none."""
    first, second = sequence(buffers, factors)
    cut = {name: np.roll(buffer[:, ::-1], 31, 0) for name, buffer in first.buffers().items() if name != "motion"}
    steps = yester.TAA()
    steps.step(yester.Frame(**cut, camera=first.camera))
    steps.step(second)


def test_no_false_alarms_from_noise():
    rng = np.random.default_rng(0)
    for scale in (0.01, 1, 5):
        steps = yester.TAA()
        for _ in range(2):
            color = rng.random((HEIGHT, WIDTH, 3), np.float32)
            motion = rng.normal(0, scale, (HEIGHT, WIDTH, 2)).astype(np.float32)
            steps.step(yester.Frame(color, motion=motion, albedo=color, depth=color[..., 0]))


def test_no_false_alarms_from_whole_pixels():
    """A static image with a motion of one pixel: wrong, but none of the known mistakes."""
    rng = np.random.default_rng(0)
    color = rng.random((HEIGHT, WIDTH, 3), np.float32)
    for shift in ([1, 1], [-1, -1], [2, 0], [0, -1]):
        steps = yester.TAA()
        for _ in range(2):
            steps.step(yester.Frame(color, albedo=color, motion=np.full((HEIGHT, WIDTH, 2), shift, np.float32)))


def test_the_advice_is_right():
    """Multiplied by the factors of the warning, motion is right."""
    (_, second), (_, right) = sequence(CAMERAS, (2 / WIDTH, -2 / HEIGHT)), sequence(CAMERAS)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        steps = yester.SVGF()
        for frame in sequence(CAMERAS, (2 / WIDTH, -2 / HEIGHT)):
            steps.step(frame)
    factors = re.findall(r"by (-?[\d.]+)", str(caught[0].message))
    np.testing.assert_allclose(second.motion[..., :2] * np.float32(factors), right.motion[..., :2], rtol=1e-5)


def test_warnings_are_collected_without_a_change_of_filters():
    first, second = sequence(CAMERAS, (1, -1))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        steps = yester.TAA("textbook")
        steps.step(first)
        steps.step(second)
    steps, before = yester.TAA("textbook"), [*warnings.filters]
    assert collect_warnings(steps.step, first)[1] == []
    # Here, pytest makes errors of warnings.
    output, messages = collect_warnings(steps.step, second, out=None)
    assert output.color.shape == second.color.shape
    assert messages == [str(warning.message) for warning in caught]
    assert len(messages) == 1
    assert warnings.filters == before
    with pytest.raises(ZeroDivisionError):
        collect_warnings(divmod, 1, 0)
    steps = yester.TAA("textbook")
    steps.step(first)
    with pytest.warns(UserWarning, match="motion"):
        steps.step(second)
