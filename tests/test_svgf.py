import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import reference
import scene
import yester
from compare import assert_close, assert_same_bits, tensor
from pipelines import sequence

WIDTH, HEIGHT = 61, 43
SIGMAS = {"sigma_normal": 100.0, "sigma_depth": 1.5, "sigma_plane": 0.02}
LIMITS = {"relative_depth": 0.08, "plane_distance": 0.02, "normal_angle": 20.0}
SETTINGS = {"alpha": 0.08, "moments_alpha": 0.25, "iterations": 4, "sigma_luminance": 3.0, "min_length": 3.0}


def pipeline(**named) -> yester.SVGF:
    return yester.SVGF(**{**SETTINGS, **SIGMAS, **LIMITS, **named})


def check_bits(frames, **named) -> None:
    svgf, composed = pipeline(**named), Composed(**named)
    for frame in frames:
        got, want = svgf.step(frame), composed.step(frame)
        for name in ("color", "variance", "history_length", "confidence"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        if want.rejection is not None:
            assert_same_bits(got.rejection, want.rejection)
        assert got.missing == want.missing
        assert np.isfinite(got.color).all()
        assert np.isfinite(got.variance).all()


@pytest.mark.parametrize("feedback", [False, True])
def test_pipeline_is_its_kernels(feedback):
    frames = [yester.Frame(**frame) for frame in sequence(6)]
    check_bits(frames, feedback=feedback)


NAMES = ("albedo", "emission", "normal", "depth", "motion", "ids", "position", "camera")


@pytest.mark.parametrize("count", range(len(NAMES) + 1))
def test_every_subset_of_buffers(count):
    """Whatever is absent, the rest does its part, bit for bit what the kernels do with it."""
    frames = sequence(3)
    for names in itertools.combinations(NAMES, count):
        check_bits([yester.Frame(**{name: frame[name] for name in ("color", *names)}) for frame in frames])


def test_flat_motion():
    """Motion without its depth: no plane test of the history, the depths stand for themselves."""
    frames = [{**frame, "motion": frame["motion"][..., :2].copy()} for frame in sequence(4)]
    check_bits([yester.Frame(**frame) for frame in frames])


def test_buffers_may_come_and_go():
    """Except for albedo: what both frames have is tested, what one lacks is not."""
    frames = sequence(8)
    for number, name in enumerate(("normal", "depth", "motion", "ids", "position", "camera")):
        del frames[number + 1][name]
    check_bits([yester.Frame(**frame) for frame in frames])


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ([], set()),
        (["albedo"], {"albedo"}),
        (["albedo", "emission"], {"albedo", "emission"}),
        (["depth", "motion"], {"depth", "motion"}),
        (["normal", "ids"], {"normal", "ids"}),
        (["depth", "camera"], {"depth", "camera"}),
        (["depth", "normal", "camera"], {"depth", "normal", "camera", "plane"}),
        (["depth", "normal", "motion", "camera"], {"depth", "normal", "motion", "plane"}),
        (["position", "camera"], {"camera"}),
        (["camera"], set()),
        (["position"], set()),
    ],
)
def test_used(names, used):
    svgf = yester.SVGF()
    for frame in sequence(3):
        out = svgf.step(yester.Frame(**{name: frame[name] for name in ("color", *names)}))
    assert isinstance(out.used, tuple)
    assert set(out.used) == used


def test_reference():
    """The whole pipeline against its composition in float64, where decisions may flip in a few pixels."""
    svgf, other = yester.SVGF(), reference.SVGF()
    for frame in sequence(6):
        got = svgf.step(yester.Frame(**frame))
        want = other.step(SimpleNamespace(**{name: tensor(value) for name, value in frame.items()}))
        assert got.missing == want.missing
        named = {"where": np.ones((HEIGHT, WIDTH), bool), "flips": WIDTH * HEIGHT // 200}
        assert_close("SVGF", got.color, want.color, rtol=1e-4, **named)
        assert_close("SVGF variance", got.variance, want.variance, rtol=5e-4, **named)
        assert_close("SVGF history_length", got.history_length, want.history_length, **named)
        assert_close("SVGF confidence", got.confidence, want.confidence, **named)


def test_reset_forgets():
    frames = [yester.Frame(**frame) for frame in sequence(3)]
    svgf = yester.SVGF()
    first = [svgf.step(frame).color for frame in frames]
    assert svgf.reset() is None
    again = svgf.step(frames[0])
    assert (again.history_length <= 1).all()
    assert not again.confidence.any()
    assert_same_bits(again.color, first[0])
    for frame, want in zip(frames[1:], first[1:], strict=True):
        assert_same_bits(svgf.step(frame).color, want)


def test_one_size_until_reset():
    small, large = (yester.Frame(np.ones((size, size, 3), np.float32)) for size in (8, 9))
    svgf = yester.SVGF()
    svgf.step(small)
    with pytest.raises(ValueError, match="reset") as error:
        svgf.step(large)
    assert "8" in str(error.value)
    assert "9" in str(error.value)
    assert svgf.step(small).history_length.max() == 2, "a refused frame leaves the state alone"
    svgf.reset()
    assert svgf.step(large).history_length.max() == 1


def test_albedo_always_or_never():
    """With and without albedo the history means different things."""
    color = np.ones((8, 9, 3), np.float32)
    frames = [yester.Frame(color), yester.Frame(color, albedo=color)]
    for first, second in (frames, frames[::-1]):
        svgf = yester.SVGF()
        svgf.step(first)
        with pytest.raises(ValueError, match="albedo"):
            svgf.step(second)
        svgf.reset()
        svgf.step(second)


def test_a_lost_frame_is_survived():
    """A frame of nothing but NaN shows the history; at the very start it shows black, and heals at the next sample."""
    good = np.ones((8, 9, 3), np.float32)
    lost = yester.Frame(np.full_like(good, np.nan))
    svgf = yester.SVGF()
    out = svgf.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    assert not out.history_length.any()
    for length in (1, 2):
        out = svgf.step(yester.Frame(good))
        assert out.missing == 0
        np.testing.assert_allclose(out.color, 1, rtol=1e-6)
        assert (out.history_length == length).all()
    out = svgf.step(lost)
    assert out.missing == 72
    np.testing.assert_allclose(out.color, 1, rtol=1e-6)
    assert (out.history_length == 2).all()


def error(image, shot) -> float:
    seen = shot.ids > 0
    return float(np.mean((image[seen] - shot.color[seen]) ** 2))


def test_error_falls_when_nothing_moves():
    rng = np.random.default_rng(0)
    svgf, shot = yester.SVGF(), scene.shoot(0, 96, 64)
    errors, raw = [], []
    for _ in range(32):
        color = scene.noisy(shot, rng)
        errors.append(error(svgf.step(yester.Frame(color, **shot.buffers())).color, shot))
        raw.append(error(color, shot))
    assert errors[0] < 0.1 * np.mean(raw)
    assert np.mean(errors[16:]) < 0.5 * errors[0]
    assert np.mean(errors[16:]) < 0.03 * np.mean(raw)


def test_error_falls_when_everything_moves():
    """The camera flies, a sphere travels and turns; the motion tells, and what it uncovers is rejected."""
    rng = np.random.default_rng(0)
    svgf = yester.SVGF()
    errors, raw, lengths = [], [], []
    for number in range(24):
        now = scene.shoot(number, 96, 64)
        motion = yester.motion_vectors(
            now.position, now.camera, scene.camera(number - 1, 96, 64), ids=now.ids, transforms=scene.transforms(number)
        )
        color = scene.noisy(now, rng)
        out = svgf.step(yester.Frame(color, motion=motion, **now.buffers()))
        errors.append(error(out.color, now))
        raw.append(error(color, now))
        lengths.append(out.history_length[now.ids == scene.MOVER].mean())
    assert errors[0] < 0.1 * np.mean(raw)
    assert np.mean(errors[12:]) < 0.6 * errors[0]
    assert np.mean(errors[12:]) < 0.04 * np.mean(raw)
    assert lengths[-1] > 5, "the moving sphere keeps its history"
    assert (out.history_length[now.ids == scene.MOVER] < 5).any(), "and its uncovered rim has none"


def test_constant_stays():
    color = np.full((16, 17, 3), 0.7, np.float32)
    svgf = yester.SVGF()
    for _ in range(5):
        out = svgf.step(yester.Frame(color))
    np.testing.assert_allclose(out.color, 0.7, rtol=1e-6)
    assert (out.confidence == 1).all()
    assert not out.rejection.any()


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("alpha", [-0.1, 1.1, np.nan]),
        ("moments_alpha", [-0.1, 1.1]),
        ("iterations", [-1, 17]),
        ("sigma_luminance", [0, -1, np.nan]),
        ("sigma_normal", [-1, np.nan]),
        ("sigma_depth", [0, -1]),
        ("sigma_plane", [0, -1]),
        ("relative_depth", [0, -1]),
        ("plane_distance", [0, -1]),
        ("normal_angle", [-1, 181]),
        ("min_length", [-1, np.nan]),
    ],
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=argument):
            yester.SVGF(**{argument: value})


def test_not_a_frame():
    for frame in (np.ones((4, 4, 3), np.float32), None, {"color": np.ones((4, 4, 3), np.float32)}):
        with pytest.raises((TypeError, ValueError), match="frame"):
            yester.SVGF().step(frame)
    with pytest.raises(TypeError):
        yester.SVGF(0.05)
