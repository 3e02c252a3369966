import itertools
from dataclasses import replace
from types import SimpleNamespace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, assert_close, assert_same_bits, colors, each, tensor
from composed import sequence, with_highlight, with_white

NAMES = ("albedo", "emission", "normal", "depth", "motion", "ids", "position", "camera")
NEWER = ("object_normal", "replay", "jitter")
PLAIN = {"gradient": False, "fireflies": False, "antialias": False}
SETTINGS = {
    "alpha": 0.2,
    "fitted_alpha": 0.3,
    "block": 7,
    "features": "all",
    "relative_depth": 0.02,
    "plane_distance": (0.001, 0.1),
    "normal_angle": 5.0,
}


def frames_of(names, count, **options) -> list[yester.Frame]:
    return [yester.Frame(**{name: frame[name] for name in ("color", *names)}) for frame in sequence(count, **options)]


def check_bits(frames, **named) -> None:
    bmfr, other = yester.BMFR(**named), composed.BMFR(**named)
    for frame in frames:
        got, want = bmfr.step(frame), other.step(frame)
        for name in ("color", "history_length", "confidence", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing
        assert got.variance is None
        assert np.isfinite(got.color).all()


@pytest.mark.parametrize("newer", [(), NEWER])
@pytest.mark.parametrize(
    "named",
    [
        {},
        SETTINGS,
        PLAIN,
        {**SETTINGS, **PLAIN},
        {"fitted_alpha": 1.0},
        {"alpha": 0.0, "fitted_alpha": 0.0},
        {"innovation": False},
        {"by_light": False},
        {"restore": False},
        {"motion_difference": np.inf},
    ],
    ids=str,
)
def test_pipeline_is_its_kernels(named, newer):
    """Over more frames than there are block displacements."""
    check_bits(frames_of((*NAMES, *newer), 10 if named == {} else 4), **named)


def test_blocks_are_smaller_without_albedo():
    """Half as large: light has texture then, which no feature tells."""
    usual, other = yester.BMFR(), yester.BMFR(block=8)
    for frame in frames_of(("normal", "depth"), 10):
        assert_same_bits(usual.step(frame).color, other.step(frame).color)
    check_bits(frames_of(("normal", "depth"), 10))


@pytest.mark.parametrize(("lacking", "rtol"), [("albedo", 0.5), ("emission", 2.0), ("ids", 2.0)])
def test_bright_light_weighs_less(lacking, rtol):
    """A lamp shines less far into its block; the reference says so as well."""
    light = np.full((24, 24, 3), 0.1, np.float32)
    light[8:10, 8:10] = 100
    albedo, black = np.full_like(light, 0.5), np.zeros_like(light)
    frame = yester.Frame(light, **{"albedo": albedo, "emission": black, lacking: None})
    named = {"block": 8, "antialias": False}
    usual, uniform = (yester.BMFR(**named, by_light=by_light).step(frame).color for by_light in (True, False))
    far = np.s_[14:16, 14:16]
    assert uniform[far].mean() > 5
    assert np.allclose(usual[far], 0.1, rtol=rtol)
    check_bits([frame, frame])
    names = [name for name in ("color", "albedo", "emission") if getattr(frame, name) is not None]
    buffers = {name: tensor(getattr(frame, name)) for name in names}
    want = reference.BMFR(**named).step(
        SimpleNamespace(**dict.fromkeys((*yester.frame.BUFFERS, "jitter", "camera")) | buffers)
    )
    assert_close("BMFR by light", usual, want.color, rtol=1e-5)


def test_dark_surfaces_weigh_less():
    """What a sign on a dark surface sends out, divided by its albedo, leaks less into the wall around it."""
    light = np.full((16, 16, 3), 1.0, np.float32)
    sign = np.s_[4:8, 4:8]
    light[sign] = 8
    shown, frames = [], []
    for reflectance in (0.05, 0.5):
        albedo = np.full_like(light, 0.5)
        albedo[sign] = reflectance
        frame = yester.Frame(light * albedo, albedo=albedo)
        frames.append(frame)
        shown.append(yester.BMFR(by_light=False, antialias=False).step(frame).color)
    dark, bright = (color[10:].mean() / 0.5 - 1 for color in shown)
    assert 0 < dark < 0.2 * bright
    check_bits(frames)
    check_bits(frames, by_light=False)


@pytest.mark.parametrize("shines", [None, False, True])
def test_emitters_are_left_out(shines):
    """Of black surfaces, those that are known to shine, or that have no noise; glass and mirrors have some."""
    rng, black = np.random.default_rng(0), np.s_[:, 20:]
    albedo = np.full((40, 40, 3), 0.5, np.float32)
    albedo[black] = 0
    emission = None if shines is None else np.zeros_like(albedo)
    if shines:
        emission[black] = 0.01
    noisy = [rng.gamma(1, 0.5, albedo.shape).astype(np.float32) for _ in range(8)]
    still = [np.where(albedo > 0, color, np.float32(0.5)) for color in noisy]
    named = {"restore": False, "innovation": False, "antialias": False}
    shown = {}
    for name, samples in (("noisy", noisy), ("still", still)):
        frames = [yester.Frame(color, albedo=albedo, emission=emission) for color in samples]
        check_bits(frames)
        bmfr = yester.BMFR(**named)
        shown[name] = [bmfr.step(frame).color for frame in frames][-1][:, 24:]
    assert (shown["noisy"].std() < 0.6 * np.mean(noisy, 0)[:, 24:].std()) == (not shines)
    assert np.allclose(shown["still"], 0.5, rtol=1e-4)


def test_albedo_that_is_no_reflectance():
    frames = with_highlight(frames_of(NAMES, 6))
    check_bits(frames)
    check_bits([replace(frame, ids=None) for frame in frames])
    check_bits(with_white(frames_of(NAMES, 7)))


@pytest.mark.slow
@pytest.mark.parametrize("count", range(len(NAMES) + 1))
def test_every_subset_of_buffers(count):
    for names in itertools.combinations(NAMES, count):
        check_bits(frames_of(names, 2))


@each("size", SIZES)
def test_any_size(size):
    rng = np.random.default_rng(0)
    normal = rng.normal(0, 1, (*size, 3))
    check_bits([yester.Frame(colors(rng, *size), normal=normal) for _ in range(3)])


@pytest.mark.parametrize("newer", [pytest.param((), marks=pytest.mark.slow), ("object_normal", "replay")])
@pytest.mark.parametrize(
    "named",
    [{}, *(pytest.param(n, marks=pytest.mark.slow) for n in (PLAIN, {"features": "all", "antialias": False}))],
    ids=str,
)
def test_reference(named, newer):
    """The pipeline against its float64 composition, in which decisions may flip in a few blocks."""
    names = (*NAMES, *newer)
    bmfr, other = yester.BMFR(**named), reference.BMFR(**named)
    absent = dict.fromkeys((*yester.frame.BUFFERS, "jitter", "camera"))
    # One noise in six brings a decision about a whole region within rounding of its threshold; this one does not.
    for frame in sequence(5, seed=11):
        given = {name: frame[name] for name in ("color", *names)}
        got = bmfr.step(yester.Frame(**given))
        want = other.step(SimpleNamespace(**{**absent, **tensor(given)}))
        assert got.missing == want.missing
        everywhere = {"where": np.ones(got.rejection.shape, bool), "flips": got.rejection.size // 25}
        assert_close("BMFR", got.color, want.color, rtol=1e-4, **everywhere)
        assert_close("BMFR history_length", got.history_length, want.history_length, **everywhere)


@pytest.mark.parametrize(
    ("names", "used"),
    [
        ((), ()),
        (("albedo", "emission", "normal"), ("albedo", "emission", "normal")),
        (("emission", "position"), ("emission", "position")),
        (("depth", "camera"), ("camera", "depth")),
        (("depth", "position", "camera", "motion"), ("motion", "depth", "position")),
        (("ids", "object_normal", "replay"), ("ids", "object_normal", "replay")),
    ],
)
def test_used(names, used):
    bmfr = yester.BMFR()
    for frame in frames_of(names, 2):
        out = bmfr.step(frame)
    assert sorted(out.used) == sorted(used)


def test_reset_forgets():
    frames = frames_of(NAMES, 3)
    bmfr = yester.BMFR()
    first = [bmfr.step(frame).color for frame in frames]
    bmfr.reset()
    for frame, want in zip(frames, first, strict=True):
        assert_same_bits(bmfr.step(frame).color, want)


def test_one_size_and_albedo_always_or_never_until_reset():
    color = np.ones((20, 30, 3), np.float32)
    bmfr = yester.BMFR()
    bmfr.step(yester.Frame(color))
    for wrong, name in ((yester.Frame(color[:-1]), "frame"), (yester.Frame(color, albedo=color), "albedo")):
        with pytest.raises(ValueError, match=rf"^{name}: .*reset"):
            bmfr.step(wrong)
    bmfr.reset()
    bmfr.step(yester.Frame(color[:-1]))


def test_a_lamp_without_emission_lights_nothing():
    """Division by black albedo gives enormous light, which is not fitted."""
    rng = np.random.default_rng(0)
    bmfr = yester.BMFR(**PLAIN, innovation=False)
    albedo = np.full((48, 48, 3), 0.5, np.float32)
    albedo[20:24, 20:24] = 0
    for _ in range(8):
        color = rng.uniform(0, 1, (48, 48, 3)).astype(np.float32)
        color[20:24, 20:24] = 100
        out = bmfr.step(yester.Frame(color, albedo=albedo))
    lamp = albedo[..., 0] == 0
    np.testing.assert_allclose(out.color[lamp], 100, rtol=1e-4)
    assert out.color[~lamp].max() < 1


def test_a_lost_frame_is_survived():
    good = np.ones((8, 9, 3), np.float32)
    lost = yester.Frame(np.full_like(good, np.nan))
    bmfr = yester.BMFR()
    out = bmfr.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    for frame in (yester.Frame(good), lost):
        out = bmfr.step(frame)
        np.testing.assert_allclose(out.color, 1, rtol=1e-6)


def test_error_falls_when_everything_moves():
    rng = np.random.default_rng(0)
    bmfr, errors, raw = yester.BMFR(antialias=False), [], []
    for number in range(16):
        now = flight.shoot(number, 96, 64)
        color = flight.noisy(now, rng)
        out = bmfr.step(replace(now, color=color))
        seen = now.ids > 0
        errors.append(np.mean((out.color[seen] - now.color[seen]) ** 2))
        raw.append(np.mean((color[seen] - now.color[seen]) ** 2))
    assert np.mean(errors[8:]) < 0.6 * errors[0]
    assert np.mean(errors[8:]) < 0.04 * np.mean(raw)


@pytest.mark.parametrize(
    ("argument", "values"),
    {
        "alpha": [-0.1, 1.1, np.nan],
        "fitted_alpha": [-0.1, 1.1, np.nan],
        "block": [3, 257],
        "features": ["some"],
        "relative_depth": [0, np.nan],
        "plane_distance": [-1],
        "normal_angle": [181],
    }.items(),
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=rf"\b{argument}\b"):
            yester.BMFR(**{argument: value})


def test_not_a_frame():
    with pytest.raises(TypeError, match="frame"):
        yester.BMFR().step(np.ones((8, 9, 3)))
