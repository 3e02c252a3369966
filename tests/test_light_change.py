from dataclasses import replace

import composed
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, colors, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_svgf import frames_of

BUFFERS = "albedo", "emission", "normal", "depth", "motion", "ids", "position", "camera"


def image(height: int, width: int, seed=0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.5, 1, (height, width, 3)).astype(np.float32)


def check(color, history, coverage=None) -> float:
    got = yester.light_change(color, history, coverage)
    known = None if coverage is None else tensor(coverage)
    assert got == pytest.approx(reference.light_change(tensor(color), tensor(history), known), rel=1e-5)
    return got


@each("size", SIZES + TAILS)
def test_reference(size):
    """With holes and partial coverage; blocks of few pixels, and none at all in small images."""
    rng = np.random.default_rng(size[1])
    history = image(*size)
    color = history * 0.7
    color[rng.random(size) < 0.1] = np.nan
    check(color, history, rng.random(size).astype(np.float32) + 0.5)
    check(colors(rng, *size), history)


@pytest.mark.parametrize("size", [(96, 128), (127, 40), (128, 40), (255, 40), (256, 33), (300, 40), (640, 24)])
def test_reference_by_rows(size):
    """Rows that are not looked at do not matter."""
    history = image(*size)
    color = history * 1.3
    assert check(color, history) == pytest.approx(1.3)
    color[np.arange(size[0]) % (size[0] // 128 | 1) > 0] = 9
    assert check(color, history) == pytest.approx(1.3)


@given(factor=st.floats(0.01, 100), scale=st.floats(1e-6, 1e6))
def test_finds_the_factor_at_every_scale(factor, scale):
    history = image(40, 48) * np.float32(scale)
    found = yester.light_change(history * np.float32(factor), history)
    assert found == pytest.approx(factor if abs(np.log(factor)) > 1e-6 else 1, rel=1e-4)


def test_changes_of_a_part_are_none():
    history = image(64, 64)
    for side in (16, 28, 40):
        color = history.copy()
        color[:, :side] *= 2
        assert check(color, history) == 1
    noisy = history * np.random.default_rng(1).exponential(1, (64, 64, 1)).astype(np.float32) ** 3
    assert check(0.9 * noisy, history) == 1, "noise could have done that"


def test_a_few_blocks_do_not_matter():
    """A lamp with a change of its own, outliers, and what is not known."""
    history = image(64, 64)
    color = 0.5 * history
    color[:16, :24] *= 8
    color[40, ::17] = 1e6
    coverage = np.ones((64, 64), np.float32)
    coverage[32:40] = 0.9
    color[32:40] = 1e9
    assert check(color, history, coverage) == pytest.approx(0.5)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_without_light_it_is_one(value):
    history = image(40, 40)
    assert check(np.full_like(history, value), history) == 1
    assert check(history, np.full_like(history, value)) == 1
    assert check(history, history, np.full((40, 40), 0.9, np.float32)) == 1


def test_no_factor_beyond_a_million():
    history = image(40, 40)
    assert check(history * np.float32(9e5), history) == pytest.approx(9e5)
    assert check(history * np.float32(2e6), history) == 1
    assert check(history * np.float32(1e30), history * np.float32(1e-30)) == 1


@pytest.mark.parametrize("name", ["history", "coverage"])
def test_bad_input(name):
    given = {"color": image(9, 9), "history": image(9, 9), "coverage": np.ones((9, 9), np.float32)}
    with pytest.raises(ValueError, match=f"^{name}"):
        yester.light_change(**given | {name: given[name][:-1]})


#: Blocks of so many pixels tell changes of a fifth from noise.
AT_REST = {"moving": False, "holes": False, "size": (160, 120)}


def faded(frames, *factors) -> list[yester.Frame]:
    """The frames with their light times a factor, each."""
    return [
        replace(frame, color=frame.color * np.float32(f), emission=frame.emission * np.float32(f))
        for frame, f in zip(frames, factors, strict=True)
    ]


@pytest.mark.parametrize("named", [{}, {"gradient": False}, {"fireflies": True}, {"antialias": False}], ids=str)
@pytest.mark.parametrize("make", ["SVGF", "HalfRes", "BMFR"])
def test_pipelines_follow_it_bit_for_bit(make, named):
    """All light falls to a third and returns; of a scene at rest, as that of the moving one changes on its own."""
    if make == "HalfRes" and "gradient" in named:
        named = {"by_confidence": True}
    frames = faded(frames_of(BUFFERS, 6, **AT_REST), 1, 1, 0.3, 0.3, 1, 1.5)
    pipeline, other = getattr(yester, make)(**named), getattr(composed, make)(**named)
    for frame in frames:
        got, want = pipeline.step(frame), other.step(frame)
        for name in ("color", "history_length", "confidence", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))
    assert got.history_length.mean() > 4


@pytest.mark.parametrize("make", ["SVGF", "BMFR"])
def test_a_fade_is_as_clean_as_without(make):
    """Exposure that changes from frame to frame costs neither samples nor sharpness."""
    frames = frames_of(BUFFERS, 8, **AT_REST)
    factors = 1, 0.8, 1.2, 0.5, 0.6, 1.1, 0.7, 0.9
    errors = []
    for images in (frames, faded(frames, *factors)):
        pipeline = getattr(yester, make)()
        outs = [pipeline.step(frame) for frame in images]
        truth = np.mean([frame.color for frame in frames], 0)
        shown = outs[-1].color / (factors[-1] if images is not frames else 1)
        errors.append(np.abs(shown - truth).mean())
        length = outs[-1].history_length.mean()
    assert errors[1] < 1.1 * errors[0]
    assert length > 4


def test_the_mix_of_many_samples_follows_it():
    """The luminances by which samples are mixed in are those of before, too."""
    rng = np.random.default_rng(0)
    light = image(64, 64, 3)
    frames = [
        yester.Frame(f * light * rng.gamma(200, 1 / 200, (64, 64, 1)), motion=np.zeros((64, 64, 2)), albedo=light)
        for f in (1, 1, 1, 1, 0.4, 0.4, 1, 1, 1)
    ]
    svgf, other = yester.SVGF(), composed.SVGF()
    mixed = 0
    for frame in frames:
        got, want = svgf.step(frame), other.step(frame)
        assert_same_bits(got.color, want.color)
        mixed += other.mixing.evidence is not None
    assert mixed
