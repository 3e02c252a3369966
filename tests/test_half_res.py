import itertools
from dataclasses import replace
from types import SimpleNamespace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import assert_close, assert_same_bits, tensor
from composed import sequence

NAMES = ("albedo", "emission", "normal", "depth", "motion", "ids", "position", "camera")
PARTS = ("color", "variance", "history_length", "confidence", "rejection")
#: Accumulation alone.
BARE = {"iterations": 0, "reflections": (), "antialias": False}


def traced(color, number):
    """Keep one pixel of each 2×2, a different one in each frame."""
    x, y = yester.HalfRes.offset(number)
    kept = np.full_like(color, np.nan)
    kept[y::2, x::2] = color[y::2, x::2]
    return kept


def frames_of(names, count, *, pattern=traced, **options):
    for number, frame in enumerate(sequence(count, **options)):
        given = {name: frame[name] for name in names}
        yield yester.Frame(pattern(frame["color"], number), **given)


def check_bits(frames, **named):
    half_res, other = yester.HalfRes(**named), composed.HalfRes(**named)
    for frame in frames:
        got, want = half_res.step(frame), other.step(frame)
        for name in PARTS:
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing == (~np.isfinite(frame.color).all(-1)).sum()
        assert np.isfinite(got.color).all()


@pytest.mark.parametrize(
    "named",
    [
        {},
        {"alpha": 0.2, "weight": 1.0, "radius": 1, "iterations": 2, "sigma_luminance": 3.0},
        {"reflections": (1.0,), "antialias": False},
        {"radius": 16, "iterations": 1},
        BARE,
        {**BARE, "innovation": False},
    ],
    ids=str,
)
def test_pipeline_is_its_kernels(named):
    check_bits(frames_of(NAMES, 7), **named)


@pytest.mark.parametrize(
    "names", [(), ("albedo",), ("depth", "ids"), ("normal",), ("depth", "normal", "camera")], ids=str
)
def test_subsets_of_buffers(names):
    check_bits(frames_of(names, 9))


@pytest.mark.parametrize("relative_noise", [0.5, np.inf])
def test_limit_of_noise(relative_noise):
    check_bits(frames_of(("depth",), 7), relative_noise=relative_noise)


def test_a_lamp_does_not_leak_into_the_dark():
    """No buffer marks its edge, which looks like noise."""
    rng, truth = np.random.default_rng(0), np.full((48, 64, 3), 0.05)
    truth[16:32, 20:44] = 5.0
    dark = truth[..., 0] < 1
    pipelines, errors = (yester.HalfRes(), yester.HalfRes(relative_noise=np.inf)), []
    for number in range(12):
        noisy = (truth * rng.exponential(1, truth.shape)).astype(np.float32)
        outs = [pipeline.step(yester.Frame(traced(noisy, number))) for pipeline in pipelines]
        errors.append([np.mean((out.color - truth)[dark] ** 2) for out in outs])
    limited, free = np.mean(errors[6:], 0)
    assert limited < 0.85 * free


def test_passes_are_chosen_where_there_is_no_albedo():
    """There alone by default."""
    check_bits(frames_of(NAMES, 7), choice=True)
    check_bits(frames_of(("depth",), 9), choice=False)
    usual, other = yester.HalfRes(), yester.HalfRes(choice=False)
    for frame in frames_of(NAMES, 7):
        got, want = usual.step(frame), other.step(frame)
        assert (got.choice == 4).all()
        assert_same_bits(got.color, want.color)
    with_albedo = yester.HalfRes(choice=True)
    assert any((with_albedo.step(frame).choice != 4).any() for frame in frames_of(NAMES, 12))


def test_texture_without_albedo_stays_sharp():
    """Stripes that no buffer shows: a fixed number of passes blurs them."""
    rng, truth = np.random.default_rng(0), np.ones((48, 64, 3)) * (0.2 + 0.8 * (np.arange(64)[:, None] // 4 % 2))
    pipelines, errors = (yester.HalfRes(), yester.HalfRes(choice=False)), []
    for number in range(12):
        noisy = (truth * rng.gamma(20, 1 / 20, truth.shape)).astype(np.float32)
        outs = [pipeline.step(yester.Frame(traced(noisy, number))) for pipeline in pipelines]
        errors.append([np.mean((out.color - truth) ** 2) for out in outs])
    chosen, fixed = np.mean(errors[6:], 0)
    assert chosen < 0.5 * fixed


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 9), (17, 33)])
def test_sizes(size):
    check_bits(frames_of(NAMES, 5, size=size))


@pytest.mark.parametrize("named", [{}, {"weight": 0.5, "antialias": False}], ids=str)
def test_reference(named):
    """The pipeline against its float64 composition, in which decisions may flip in a few pixels."""
    half_res, other = yester.HalfRes(reflections=(), **named), reference.HalfRes(**named)
    absent = dict.fromkeys(("object_normal", "replay", "hit_distance", "jitter"))
    for number, frame in enumerate(sequence(6)):
        given = {name: frame[name] for name in NAMES} | {"color": traced(frame["color"], number)}
        got = half_res.step(yester.Frame(**given))
        want = other.step(SimpleNamespace(**{**absent, **tensor(given)}))
        assert got.missing == want.missing
        where = {"where": np.ones(got.confidence.shape, bool), "flips": got.confidence.size // 200}
        assert_close("HalfRes", got.color, want.color, rtol=1e-4, **where)
        assert_close("HalfRes variance", got.variance, want.variance, rtol=5e-4, **where)
        assert_close("HalfRes history_length", got.history_length, want.history_length, rtol=1e-4, **where)


def test_full_frames_are_not_reconstructed():
    """Where nothing is missing, nothing is reconstructed."""
    pipelines = yester.HalfRes(), yester.HalfRes(weight=1.0, radius=1)
    for frame in frames_of(NAMES, 4, pattern=lambda color, _: color, holes=False):
        got, want = (pipeline.step(frame) for pipeline in pipelines)
        assert got.missing == 0
        for name in PARTS:
            assert_same_bits(getattr(got, name), getattr(want, name))


def test_offsets_take_turns():
    """Any four consecutive frames trace all four pixels; the two of a pair trace diagonal ones."""
    offsets = [yester.HalfRes.offset(number) for number in range(12)]
    assert all(set(offsets[i : i + 4]) == set(itertools.product((0, 1), repeat=2)) for i in range(9))
    for (x, y), (u, v) in zip(offsets[::2], offsets[1::2], strict=True):
        assert (u, v) == (1 - x, 1 - y)
    for wrong in (-1, -4):
        with pytest.raises(ValueError, match=r"^number: expected"):
            yester.HalfRes.offset(wrong)


def test_history_converges_to_the_mean_of_the_pixels_own_samples():
    """However different its neighbours are: their weight vanishes over time."""
    y, x = np.mgrid[:32, :33]
    truth = np.where((x // 2 + y // 3) % 2, np.float32(1.5), np.float32(0.5))[..., None] * np.ones(3, np.float32)
    half_res, errors = yester.HalfRes(alpha=0.0, weight=0.1, innovation=False, **BARE), []
    for number in range(400):
        out = half_res.step(yester.Frame(traced(truth, number)))
        errors.append(np.sqrt(np.mean((out.color - truth) ** 2)))
    assert errors[0] > 0.3, "neighbours alone"
    steps = np.array(errors)[[3, 15, 63, 399]]
    assert (steps < [0.1, 0.06, 0.03, 0.01]).all()
    assert (np.diff(steps) < 0).all()
    assert out.history_length.min() > 100, "of which a hundred were traced"


@pytest.mark.parametrize("share", [1 / 2, 1 / 4, 1 / 16])
def test_any_pattern_and_density(share):
    """Random pixels at any density: no holes in the output, and less error than in the samples."""
    rng = np.random.default_rng(0)
    shot = flight.shoot(0, 96, 64, moving=False)
    half_res = yester.HalfRes(radius=4 if share < 0.1 else 2)
    seen = shot.ids > 0
    errors = []
    for _ in range(12):
        color = flight.noisy(shot, rng)
        raw = np.mean((color - shot.color)[seen] ** 2)
        color[rng.random(seen.shape) > share] = np.nan
        out = half_res.step(replace(shot, color=color))
        assert abs(1 - share - out.missing / seen.size) < 0.03
        errors.append(np.mean((out.color - shot.color)[seen] ** 2))
    assert np.mean(errors[6:]) < (0.02 if share > 0.1 else 0.05) * raw
    assert np.mean(errors[6:]) < 0.8 * errors[0]


def errors_in_motion(step, *, light=lambda number: 1.0):
    """Errors of the flight, per frame."""
    rng = np.random.default_rng(0)
    errors = []
    for number in range(24):
        now = flight.shoot(number, 96, 64)
        color = flight.noisy(now, rng) * np.float32(light(number))
        out = step(number, color, now)
        truth = now.color * light(number)
        errors.append(np.mean((out.color - truth)[now.ids > 0] ** 2))
    return np.array(errors)


def spread(color, number):
    """The naive method: each 2×2 repeats its traced pixel."""
    x, y = yester.HalfRes.offset(number)
    return np.kron(color[y::2, x::2], np.ones((2, 2, 1), np.float32))


def fed(pipeline, pattern):
    return lambda number, color, frame: pipeline.step(replace(frame, color=pattern(color, number)))


def test_it_beats_simpler_methods():
    """From the same samples, less error than from copies of them, and little more than from four times as many."""
    whole = errors_in_motion(fed(yester.SVGF(), lambda color, _: color))[12:].mean()
    half = errors_in_motion(fed(yester.HalfRes(), traced))[12:].mean()
    copies = errors_in_motion(fed(yester.SVGF(), spread))[12:].mean()
    assert half < 0.7 * copies
    assert half < 2 * whole


def test_switched_light_reaches_untraced_pixels():
    """In a frame or two; histories that wait for samples of their own need four for what blocks do not tell."""

    def switch(number):
        return 3.0 if number >= 16 else 1.0

    half = errors_in_motion(fed(yester.HalfRes(), traced), light=switch)
    waiting = errors_in_motion(fed(yester.SVGF(), traced), light=switch)
    assert half[17] < 0.7 * waiting[17]


def test_reset_forgets():
    frames = list(frames_of(NAMES, 3))
    half_res = yester.HalfRes()
    first = [half_res.step(frame).color for frame in frames]
    assert half_res.reset() is None
    for frame, want in zip(frames, first, strict=True):
        assert_same_bits(half_res.step(frame).color, want)


def test_nothing_traced_is_survived():
    """At the start it is black; later, the history."""
    good = np.ones((8, 9, 3), np.float32)
    lost = yester.Frame(np.full_like(good, np.nan))
    half_res = yester.HalfRes()
    out = half_res.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    for number in range(4):
        out = half_res.step(yester.Frame(traced(good, number)))
        np.testing.assert_allclose(out.color, 1, rtol=1e-6)
    out = half_res.step(lost)
    assert out.missing == 72
    np.testing.assert_allclose(out.color, 1, rtol=1e-6)


def test_sizes_that_do_not_fit():
    """Buffers of another resolution than the colour's, and frames of another than before."""
    color, low = np.ones((8, 10, 3), np.float32), np.ones((4, 5, 3), np.float32)
    for name, value in (("depth", color[..., 0]), ("normal", color), ("ids", np.ones((8, 10), np.uint32))):
        with pytest.raises(ValueError, match=rf"^{name}: expected height 4 and width 5"):
            yester.Frame(low, **{name: value})
    half_res = yester.HalfRes()
    half_res.step(yester.Frame(color))
    with pytest.raises(ValueError, match=r"^frame: expected height 8 and width 10.*reset.*got height 4 and width 5"):
        half_res.step(yester.Frame(low))
    with pytest.raises(ValueError, match="albedo"):
        half_res.step(yester.Frame(color, albedo=color))


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("alpha", [-0.1, 1.1, np.nan]),
        ("weight", [0, -0.1, 1.1, np.nan]),
        ("radius", [0, 17]),
        ("iterations", [-1, 17]),
        ("sigma_luminance", [0, -1, np.nan]),
        ("relative_noise", [0, -1, np.nan]),
        ("tap_exposure", [0, -1, np.nan]),
        ("reflections", [[0.0], [np.nan]]),
    ],
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=rf"^{argument}: expected"):
            yester.HalfRes(**{argument: value})


def test_not_a_frame():
    for frame in (np.ones((4, 4, 3), np.float32), None):
        with pytest.raises(TypeError, match="frame"):
            yester.HalfRes().step(frame)
