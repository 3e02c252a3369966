import itertools
from dataclasses import replace
from types import SimpleNamespace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, assert_close, assert_same_bits, colors, each, motions, tensor
from composed import sample, sequence, supersampled
from reference.taa import PRESETS
from yester import metrics
from yester.study.synthetic import raycast

WIDTH, HEIGHT = 61, 43
SURFACE = ("color", "depth", "normal", "object_normal", "ids", "motion", "position", "camera")
NAMES = ("color", "depth", "motion", "position", "camera", "jitter")
OVERRIDES = [
    {"dilate": "none", "filter": "nearest", "alpha": 0.3},
    {"filter": "lanczos-2", "box": "hull", "response": "current", "weighting": "luminance"},
    {
        "dilate": "cross",
        "dilate_margin": 0.3,
        "dilate_movers": False,
        "window": "5x5",
        "gamma": 1.5,
        "box": "variance",
        "response": "ellipsoid",
        "flicker": 0.5,
    },
    {"filter": "bilinear", "box": "chroma-hull", "space": "ycocg", "response": "current", "speed": 0.5},
    {"alpha": 0.0, "fast_alpha": 1.0, "speed": (0.1, 4.0), "box": "intersection", "space": "rgb", "response": "clamp"},
    {"innovation": True},
    {"fireflies": True, "innovation": True},
]


DOUBTS = [
    {"relative_depth": 0.1, "ids": True},
    {"plane_distance": 0.01, "filter": "bilinear"},
    {"plane_distance": (0.005, 0.02), "relative_depth": (0.05, 0.2), "normal_angle": (15, 30), "dilate": "none"},
    {"normal_angle": 25.0, "filter": "nearest"},
    {"gradient": True},
    {"anti_lag": 1.0},
    {"gradient": True, "anti_lag": 3.0, "ids": True, "dilate": "cross", "dilate_margin": 0.0},
    {"alternation": True, "ids": True},
    {"alternation": True, "gradient": True, "anti_lag": 1.0},
    {"innovation": True, "ids": True},
]


def check_bits(frames, preset="best", **overrides) -> None:
    taa, other = yester.TAA(preset, **overrides), composed.TAA(preset, **overrides)
    for frame in frames:
        got, want = taa.step(frame), other.step(frame)
        for name in ("color", "history_length", "confidence", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing
        assert got.variance is None
        assert np.isfinite(got.color).all()


def frames_of(names, count=4, **options) -> list[yester.Frame]:
    return [yester.Frame(**{name: frame[name] for name in names}) for frame in sequence(count, **options)]


def test_frames_without_guides_have_a_share_of_their_own():
    """Albedo, normals and ids are guides. Depth, motion and cameras are none."""
    share = {"alpha": 0.6, "fast_alpha": 0.6}
    for guides in ((), *((name,) for name in ("albedo", "depth", "normal", "ids")), ("depth", "ids")):
        known = ("color", "motion", "camera", *guides)
        made = yester.TAA("denoised", unguided_alpha=0.6)
        guided = guides not in ((), ("depth",))
        same = yester.TAA("denoised") if guided else yester.TAA("denoised", weighting="tone", **share)
        for frame in frames_of(known, 3):
            assert_same_bits(made.step(frame).color, same.step(frame).color)
        check_bits(frames_of(known, 3), "best", unguided_alpha=0.15)


def test_frames_with_guides_are_weighted_by_tone():
    """Albedo, normals and ids are guides."""
    tone = {"guided_exposure": 0, "weighting": "local-tone"}
    for guides in ((), *((name,) for name in ("albedo", "depth", "normal", "ids"))):
        frames = frames_of(("color", "motion", "camera", *guides), 3)
        made, same, plain = (
            yester.TAA("best", **named) for named in ({"guided_exposure": 1}, tone, {"guided_exposure": 0})
        )
        guided = guides not in ((), ("depth",))
        for frame in frames:
            color = made.step(frame).color
            weighted, unweighted = same.step(frame).color, plain.step(frame).color
        assert np.array_equal(color, weighted if guided else unweighted)
        assert not np.array_equal(weighted, unweighted)
        check_bits(frames, "best", guided_exposure=4)


def test_thin_geometry_has_no_share_of_its_own():
    """Where depth alone guides, and differs in more than an eighth of the pairs of neighbours."""
    for columns, thin in ((3, False), (4, True)):  # every one of them differs from both of its neighbours
        frames = frames_of(("color", "motion", "depth"), 3, size=(32, 16))
        for frame in frames:
            frame.depth[:] = 5
            frame.depth[:, 1 : 2 * columns : 2] = np.inf
        made, same = (yester.TAA("denoised", **share) for share in ({"unguided_alpha": 0.6}, {}))
        alike = [np.array_equal(made.step(frame).color, same.step(frame).color) for frame in frames]
        assert alike[-1] == thin
        check_bits(frames, "best", unguided_alpha=0.15)


@pytest.mark.parametrize("preset", PRESETS)
def test_pipeline_is_its_kernels(preset):
    """With any subset of its buffers, bit for bit."""
    for count in range(len(NAMES)):
        for names in itertools.combinations(NAMES[1:], count):
            check_bits(frames_of(("color", *names), 3), preset)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("overrides", OVERRIDES)
def test_overrides_are_the_kernels_arguments(preset, overrides):
    frames = frames_of(NAMES, 6)
    check_bits(frames, preset, **overrides)
    check_bits(frames_of(("color", "motion"), 4), preset, **overrides)
    plain, other = yester.TAA(preset), yester.TAA(preset, **overrides)
    images = [(plain.step(frame).color, other.step(frame).color) for frame in frames]
    assert not np.array_equal(*images[-1])


@pytest.mark.parametrize("preset", ["best", "karis"])
@pytest.mark.parametrize("doubts", DOUBTS)
def test_doubts_are_the_kernels_arguments(preset, doubts):
    """Also where buffers are missing or appear late. Without validation, history is trusted more."""
    frames = frames_of(SURFACE, 5)
    check_bits(frames, preset, **doubts)
    late = [yester.Frame(frame.color, motion=frame.motion) for frame in frames[:2]] + frames[2:]
    check_bits(late, preset, **doubts)
    for names in (("color", "motion", "depth"), ("color", "camera", "position", "normal"), ("color",)):
        check_bits(frames_of(names, 3), preset, **doubts)
    still = [yester.Frame(**{n: frame[n] for n in SURFACE if n != "motion"}) for frame in sequence(3, moving=False)]
    check_bits(still, preset, **doubts)
    lengths = [[taa.step(frame) for frame in frames][-1] for taa in (yester.TAA(preset), yester.TAA(preset, **doubts))]
    plain, other = (out.history_length for out in lengths)
    assert (other < plain - 1e-4).mean() > 0.02


@pytest.mark.parametrize(
    "doubts", [*(doubts for doubts in DOUBTS if doubts.get("filter") != "nearest"), {"fireflies": True}]
)
def test_doubts_are_as_the_reference_has_them(doubts):
    """With the rejection of the 2×2 footprint in any case."""
    taa, other = yester.TAA(**doubts), reference.TAA(**doubts)
    absent = dict.fromkeys((*NAMES, *SURFACE, "albedo"))
    for frame in sequence(5):
        given = {name: frame[name] for name in SURFACE}
        got = taa.step(yester.Frame(**given))
        want = other.step(SimpleNamespace(**{**absent, **tensor(given)}))
        named = {"where": np.ones((HEIGHT, WIDTH), bool), "flips": WIDTH * HEIGHT // 100}
        assert_close("TAA with doubts", got.color, want.color, rtol=1e-4, **named)
        assert_close("TAA with doubts, history_length", got.history_length, want.history_length, rtol=1e-4, **named)
        assert_close("TAA with doubts, confidence", got.confidence, want.confidence, **named)
        assert int((got.rejection != np.asarray(want.rejection)).sum()) <= WIDTH * HEIGHT // 100


@pytest.mark.parametrize(
    ("doubts", "bits"),
    [
        ({"relative_depth": 0.1}, yester.Rejection.DEPTH),
        ({"plane_distance": 0.01}, yester.Rejection.DEPTH),
        ({"normal_angle": 25.0}, yester.Rejection.NORMAL),
        ({"ids": True}, yester.Rejection.ID),
    ],
)
def test_history_of_another_surface_is_rejected(doubts, bits):
    """With equal colours, clipping does not remove the old surface's history; validation does."""
    rng = np.random.default_rng(0)
    size = (12, 16)
    camera = flight.camera(0.0, size[1], size[0])

    def frame(changed: bool) -> yester.Frame:
        there = (np.arange(size[1]) >= 8) & changed
        return yester.Frame(
            rng.uniform(0.4, 0.6, (*size, 3)).astype(np.float32),
            depth=np.where(there, 6, 4).repeat(size[0]).reshape(size[::-1]).T.astype(np.float32),
            normal=np.where(there[None, :, None], [1.0, 0, 0], [0.0, 0, 1]) * np.ones((*size, 1)),
            ids=np.where(there, 2, 1) * np.ones(size, np.uint32),
            motion=np.zeros((*size, 3), np.float32),
            camera=camera,
        )

    for preset in PRESETS:
        taa, plain = yester.TAA(preset, **doubts, smooth_edges=False), yester.TAA(preset)
        for changed in (False, False, False, True):
            now = frame(changed)
            out, without = taa.step(now), plain.step(now)
        assert (without.history_length == 4).all()
        assert not without.rejection.any()
        assert (out.history_length[:, :8] == 4).all()
        assert (out.history_length[:, 8:] == 1).all()
        assert (out.rejection[:, 8:] & bits).all()
        assert not out.rejection[:, :8].any()
        np.testing.assert_array_equal(out.color[:, 8:], now.color[:, 8:])


def test_light_that_goes_shortens_history():
    """When all light changes at once, the gradient detects it; so does anti-lag where history was clipped far."""
    rng = np.random.default_rng(0)
    for doubts in ({"gradient": True}, {"anti_lag": 1.0}):
        taa, plain = yester.TAA(**doubts), yester.TAA()
        for light in (1, 1, 1, 1, 1, 1, 0.1):
            color = np.float32(light) * rng.uniform(0.9, 1.1, (24, 32, 3)).astype(np.float32)
            out, without = taa.step(yester.Frame(color)), plain.step(yester.Frame(color))
        assert (without.history_length == 7).all()
        assert (out.history_length < 3).mean() > 0.95
        assert np.abs(out.color - color).mean() < 0.7 * np.abs(without.color - color).mean()


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("scale", [3.0, 0.25])
def test_innovation_follows_a_light_that_changes(preset, scale):
    """In noise, the error of mean light is a fifth less in the first frame after a change, two fifths in the next.

    Steady light before it is not harmed, and history lengths are the same.
    """
    rng, shot = np.random.default_rng(0), flight.shoot(0, 96, 64, moving=False)
    seen, errors, light_errors = shot.ids > 0, [], []
    taa, plain = yester.TAA(preset, innovation=True), yester.TAA(preset)
    for number in range(14):
        light = np.float32(scale if number >= 10 else 1)
        frame, truth = yester.Frame(flight.noisy(shot, rng) * light), shot.color * light
        outs = taa.step(frame), plain.step(frame)
        np.testing.assert_array_equal(outs[0].history_length, outs[1].history_length)
        errors.append([np.sqrt(error(out.color[seen], truth[seen])) for out in outs])
        light_errors.append([abs(out.color[seen].mean() / truth[seen].mean() - 1) for out in outs])
    (own, other), (own_light, other_light) = np.transpose(errors), np.transpose(light_errors)
    assert (own[10:12] < [0.85, 0.95] * other[10:12]).all()
    assert (own_light[10:12] < [0.8, 0.6] * other_light[10:12]).all()
    assert own[9] < 1.02 * other[9]


def flicker(colors, preset, **options):
    """Mean variation of the last 16 images of a uniform sequence."""
    taa = yester.TAA(preset, **options)
    images = [taa.step(yester.Frame(np.broadcast_to(color, (12, 17, 3)).astype(np.float32))).color for color in colors]
    return np.std(images[-16:], 0).mean(), images


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("length", [1, 2, 3])
def test_red_and_green_that_fill_the_neighbourhood_are_mixed(preset, length):
    """Clipping alone shows the newest frame."""
    red, green = np.float32([0.8, 0.15, 0.1]), np.float32([0.1, 0.7, 0.15])
    colors = ([red] * length + [green] * length) * (48 // length)
    full, _ = flicker(colors, preset)
    calm, images = flicker(colors, preset, alternation=True)
    assert full > 0.12
    assert calm < 0.25 * full
    np.testing.assert_allclose(np.mean(images[-24:], 0)[5, 5], (red + green) / 2, rtol=0.15)
    # Once one of them stays, the output follows within a few frames.
    _, images = flicker(colors + [green] * 12, preset, alternation=True)
    np.testing.assert_allclose(images[-1][5, 5], green, atol=0.02)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_change_of_light_is_no_alternation(preset):
    colors = [np.float32([0.8, 0.6, 0.4])] * 8 + [np.float32([0.1, 0.1, 0.2])] * 8
    (_, plain), (_, other) = (flicker(colors, preset, alternation=on) for on in (False, True))
    np.testing.assert_array_equal(plain, other)


@each("size", SIZES)
def test_any_size_and_wild_motion(size):
    rng = np.random.default_rng(0)
    frames = [
        yester.Frame(colors(rng, *size), motion=motions(rng, *size, channels), jitter=jitter)
        for channels, jitter in ((2, (0.5, -0.5)), (3, None), (2, (-0.1, 0.3)), (3, (0, 0)))
    ]
    for preset in PRESETS:
        check_bits(frames, preset)
        check_bits(frames, preset, innovation=True)


def test_everything_is_used_that_is_there():
    for names, used in (
        (("color",), ()),
        (("color", "jitter"), ("jitter",)),
        (("color", "depth", "motion"), ("motion", "depth")),
        (("color", "position", "camera"), ("camera", "position")),
        (NAMES, ("jitter", "motion", "depth")),
    ):
        taa = yester.TAA()
        for frame in frames_of(names, 2):
            out = taa.step(frame)
        assert sorted(out.used) == sorted(used)
    taa = yester.TAA("textbook")
    out = [taa.step(frame) for frame in frames_of(NAMES, 2)][-1]
    assert out.used == ("motion",), "it neither reconstructs nor dilates"
    for doubts, used in (
        ({"relative_depth": 0.1}, {"depth"}),
        ({"plane_distance": 0.01}, {"depth", "plane", "normal"}),
        ({"normal_angle": 25, "ids": True}, {"normal", "object_normal", "ids"}),
    ):
        taa = yester.TAA("textbook", **doubts)
        first, second = (taa.step(frame).used for frame in frames_of(SURFACE, 2))
        assert first == ("motion",), "nothing is known of the frame before"
        assert len(second) == len(set(second))
        assert set(second) == {"motion", *used}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("names", [NAMES, ("color", "position", "camera"), ("color", "motion", "jitter")])
def test_reference(preset, names):
    """The pipeline against its float64 composition, in which decisions may flip in a few pixels."""
    taa, other = yester.TAA(preset), reference.TAA(preset)
    absent = dict.fromkeys((*NAMES, *SURFACE, "albedo"))
    for frame in sequence(6):
        given = {name: frame[name] for name in names}
        got = taa.step(yester.Frame(**given))
        want = other.step(SimpleNamespace(**{**absent, **tensor(given)}))
        assert got.missing == want.missing
        named = {"where": np.ones((HEIGHT, WIDTH), bool), "flips": WIDTH * HEIGHT // 200}
        assert_close("TAA", got.color, want.color, rtol=1e-4, **named)
        assert_close("TAA history_length", got.history_length, want.history_length, **named)
        assert_close("TAA confidence", got.confidence, want.confidence, **named)
        flips = int((got.rejection != np.asarray(want.rejection)).sum())
        assert flips <= WIDTH * HEIGHT // 200


def error(image, truth) -> float:
    return float(np.mean((image - truth) ** 2))


def view(number: int) -> yester.Camera:
    """About half a pixel a frame."""
    return flight.camera(0.25 * number, 96, 64)


@pytest.mark.parametrize(
    ("preset", "factor"), [("best", 20), ("denoised", 12), ("textbook", 35), ("karis", 15), ("filament", 14)]
)
def test_a_still_image_converges_to_the_supersampled(preset, factor):
    """From the sixteenth frame on: the error of samples at the centres divided by this factor, and never above it."""
    camera, taa = view(0), yester.TAA(preset)
    truth, alone, errors = supersampled(camera), sample(camera)["color"], []
    for offset in (*yester.jitter(16), *yester.jitter(32)):
        frame = sample(camera, offset)
        errors.append(error(taa.step(yester.Frame(frame["color"], depth=frame["depth"], jitter=offset)).color, truth))
    assert factor * np.mean(errors[16:]) < error(alone, truth)
    assert 1.2 * np.max(errors[16:]) < error(alone, truth)
    assert 1.5 * np.mean(errors[16:]) < errors[0]


@pytest.mark.parametrize(
    ("preset", "factors"), [("best", (1.9, 1.5)), ("denoised", (2.3, 1.8)), ("filament", (2.1, 1.7))]
)
def test_a_moving_camera_comes_closer_to_the_supersampled(preset, factors):
    """The errors of jittered samples, and of samples at the centres, divided by these factors."""
    errors, taa = [], yester.TAA(preset)
    for number, offset in enumerate(yester.jitter(24)):
        camera = view(number)
        frame = sample(camera, offset)
        names = ("color", "depth", "position", "camera")
        image = taa.step(yester.Frame(**{name: frame[name] for name in names}, jitter=offset)).color
        if number >= 8 and number % 3 == 0:
            truth = supersampled(camera, 6)
            errors.append([error(shown, truth) for shown in (image, frame["color"], sample(camera)["color"])])
    own, *others = np.mean(errors, 0)
    assert (own * np.array(factors) < others).all()


@pytest.mark.parametrize("preset", ["best", "karis", "filament"])
def test_a_thin_line_does_not_vanish(preset):
    """0.7 pixels wide: single samples miss it in some columns; it must stay visible there."""

    def draw(offset):
        y, x = np.mgrid[:48, :64] + 0.5
        on = np.abs(y + offset[1] - 20.3 - 0.13 * (x + offset[0])) < 0.35
        return np.where(on, 1, 0.1)[..., None].repeat(3, -1).astype(np.float32)

    def columns(image):
        return image[:, 8:-8, 1].max(0) - 0.1

    places = (np.arange(16) + 0.5) / 16 - 0.5
    truth = np.mean([draw((x, y)) for x in places for y in places], 0, np.float64)
    taa, offsets = yester.TAA(preset), yester.jitter(32)
    assert min(columns(draw(offset)).min() for offset in offsets) < 1e-6
    for number in range(64):
        offset = offsets[number % 32]
        image = taa.step(yester.Frame(draw(offset), jitter=offset)).color
        if number >= 16:
            assert (columns(image) > 0.03 * columns(truth)).all()
            assert np.sum(image - 0.1) > 0.45 * np.sum(truth - 0.1)


@pytest.mark.parametrize("preset", PRESETS)
def test_constant_stays(preset):
    color, taa = np.full((16, 17, 3), np.float32([0.7, 0.2, 3])), yester.TAA(preset)
    rng = np.random.default_rng(0)
    for offset in yester.jitter(12):
        motion = rng.normal(0, 0.7, (16, 17, 2))
        out = taa.step(yester.Frame(color, motion=motion, jitter=offset))
        np.testing.assert_allclose(out.color, color, rtol=2e-6)
    assert out.missing == 0


def test_length_counts_samples():
    """Equal weights at first, then at least alpha: the mean of the first ten samples, where nothing is clipped."""
    rng = np.random.default_rng(0)
    samples = rng.uniform(0.4, 0.6, (14, 8, 9, 3)).astype(np.float32)
    taa = yester.TAA("textbook", alpha=0.1, fast_alpha=0.1, gamma=1e6, box="variance")
    for number, color in enumerate(samples, 1):
        out = taa.step(yester.Frame(color))
        assert (out.history_length == min(number, 10)).all()
        assert (out.confidence == (number > 1)).all()
        if number == 10:
            np.testing.assert_allclose(out.color, samples[:10].mean(0), rtol=1e-5)
            mean = out.color
        if number > 10:
            mean = mean + 0.1 * (color - mean)
            np.testing.assert_allclose(out.color, mean, rtol=1e-5)
    assert not out.rejection.any()
    far = yester.Frame(color, motion=np.full((8, 9, 2), 100.0))
    out = taa.step(far)
    assert (out.history_length == 1).all()
    assert (out.rejection == 1).all()
    np.testing.assert_allclose(out.color, color, rtol=1e-6)


@pytest.mark.parametrize("preset", PRESETS)
def test_missing_samples_are_survived(preset):
    """A lost frame shows the history and does not count; at the start it is black, until the next sample."""
    good, taa = np.full((8, 9, 3), 0.6, np.float32), yester.TAA(preset)
    lost = yester.Frame(np.full_like(good, np.nan), jitter=(0.2, 0.1))
    out = taa.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    assert not out.history_length.any()
    for length in (1, 2):
        out = taa.step(yester.Frame(good, jitter=(0.1, -0.3)))
        np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)
        assert (out.history_length == length).all()
    out = taa.step(lost)
    assert out.missing == 72
    np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)
    assert (out.history_length == 2).all()
    holes = good.copy()
    holes[2:5, 3, 1], holes[7, 8, 0] = np.inf, np.nan
    out = taa.step(yester.Frame(holes))
    assert out.missing == 4
    np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)
    assert (out.history_length == np.where(np.isfinite(holes).all(-1), 3, 2)).all()


@pytest.mark.parametrize("innovation", [False, True])
def test_reset_forgets(innovation):
    frames = frames_of(NAMES, 3)
    taa = yester.TAA(innovation=innovation)
    first = [taa.step(frame).color for frame in frames]
    assert taa.reset() is None
    for frame, want in zip(frames, first, strict=True):
        assert_same_bits(taa.step(frame).color, want)


def test_one_size_until_reset():
    small, large = (yester.Frame(np.ones((size, size, 3), np.float32)) for size in (8, 9))
    taa = yester.TAA()
    taa.step(small)
    with pytest.raises(ValueError, match="reset") as refused:
        taa.step(large)
    assert "8" in str(refused.value)
    assert "9" in str(refused.value)
    assert taa.step(small).history_length.max() == 2, "a refused frame leaves the state alone"
    taa.reset()
    assert taa.step(large).history_length.max() == 1


def test_one_pixel():
    taa = yester.TAA()
    for number, value in enumerate((1.0, 3.0), 1):
        out = taa.step(yester.Frame(np.full((1, 1, 3), value, np.float32), jitter=(0.4, 0.4)))
        assert out.color.shape == (1, 1, 3)
        assert out.history_length == number
        # Its neighbourhood is the pixel itself.
        np.testing.assert_allclose(out.color, value, rtol=1e-6)


@pytest.mark.parametrize("argument", ["preset", "dilate", "filter", "box", "window", "space", "response", "weighting"])
def test_unknown_modes_list_the_known(argument):
    known = {preset[argument] for preset in PRESETS.values()} if argument != "preset" else set(PRESETS)
    with pytest.raises(ValueError, match=argument) as refused:
        yester.TAA(**{argument: "nonsense"})
    for mode in (*known, "nonsense"):
        assert mode in str(refused.value)


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("alpha", [-0.1, 1.1, np.nan]),
        ("fast_alpha", [-0.1, 1.1, np.nan]),
        ("unguided_alpha", [-0.1, 1.1, np.nan]),
        ("guided_exposure", [-1, np.inf, np.nan]),
        ("speed", [-1, np.nan, (3, 2)]),
        ("dilate_margin", [-0.1, 1.0, np.nan]),
        ("gamma", [-1, np.nan]),
        ("flicker", [-0.1, 1.1, np.nan]),
        ("relative_depth", [0, -1, np.nan, (0.2, 0.1)]),
        ("plane_distance", [0, -1, np.nan, (0.2, 0.1)]),
        ("normal_angle", [-1, 181, np.nan]),
        ("anti_lag", [-1, np.nan, np.inf]),
    ],
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=argument):
            yester.TAA(**{argument: value})


def test_hulls_need_their_response_and_space():
    for named in ({"box": "hull"}, {"box": "exact-hull"}, {"box": "chroma-hull"}):
        with pytest.raises(ValueError, match="response"):
            yester.TAA(**named)
    with pytest.raises(ValueError, match="space"):
        yester.TAA(box="chroma-hull", response="current", space="rgb")


def test_not_a_frame():
    for frame in (np.ones((4, 4, 3), np.float32), None):
        with pytest.raises(TypeError, match="frame"):
            yester.TAA().step(frame)
    with pytest.raises(TypeError):
        yester.TAA("best", 0.05)


@pytest.mark.parametrize("preset", PRESETS)
def test_radiance_has_no_scale(preset):
    """In any unit of radiance, every preset gives the same image, scaled."""

    def last(scale):
        rng, taa = np.random.default_rng(0), yester.TAA(preset)
        for _ in range(6):
            color = rng.gamma(4, 0.25, (20, 24, 3)).astype(np.float32) * np.float32(scale)
            out = taa.step(yester.Frame(color)).color
        return out / scale

    for scale in (2.0**-20, 2.0**20):
        np.testing.assert_allclose(last(scale), last(1), rtol=1e-4)


def test_history_of_another_albedo_is_refused():
    """A texture is swapped on the right half: history restarts only there."""
    taa = yester.TAA(relative_albedo=0.2)
    for number in range(4):
        albedo = np.full((20, 30, 3), 0.5, np.float32)
        albedo[:, 15:] = 0.5 if number < 3 else 0.2
        out = taa.step(yester.Frame(albedo, albedo=albedo))
    assert "albedo" in out.used
    np.testing.assert_array_equal(out.history_length[:, :15], 4)
    np.testing.assert_array_equal(out.history_length[:, 15:], 1)
    assert (out.rejection[:, 15:] == yester.Rejection.LUMINANCE).all()


def test_samples_of_a_denoised_frame():
    """Without `choice`, they count with `innovation` alone; missing ones say nothing."""
    rng, clean = np.random.default_rng(0), np.full((40, 60, 3), 0.5, np.float32)
    samples = [rng.gamma(4, 0.25, clean.shape).astype(np.float32) for _ in range(8)]
    stages = (yester.TAA("denoised", innovation=on, choice=False) for on in (True, False, True))
    (with_them, plain, unlit), images = stages, []
    for noisy in samples:
        images.append(with_them.step(yester.Frame(clean), samples=noisy).color)
        assert_same_bits(plain.step(yester.Frame(clean), samples=noisy).color, clean)
        assert_same_bits(unlit.step(yester.Frame(clean), samples=np.full_like(clean, np.nan)).color, clean)
    means = [image.mean() for image in images]
    assert means[0] == pytest.approx(0.5), "a first frame has no history that could lag"
    assert means[-1] > 0.8


def test_history_of_other_surfaces():
    """History that has to be clipped where the denoiser had none is dropped, but not for one sample of a lamp."""
    before, now = np.full((5, 7, 3), 0.9, np.float32), np.full((5, 7, 3), 0.1, np.float32)
    now[2, 1] = 20
    known = np.ones((5, 7), np.float32)
    known[:, :4] = 0
    shown = {}
    for name, confidence in (("all known", np.ones((5, 7))), ("some unknown", known)):
        stage = yester.TAA("denoised", choice=False)
        for image in (before, before, before, now):
            output = stage.step(yester.Frame(image), samples=image, confidence=confidence)
        shown[name] = output
    ages, usual = (shown[name].history_length for name in ("some unknown", "all known"))
    np.testing.assert_array_equal(ages[:, 4:], usual[:, 4:])
    assert (ages[:, 3] < 1.2).all(), "history of 0.9 is clipped to 0.1"
    assert (usual == 4).all()
    assert ages[2, 1] > 3.8


@pytest.mark.parametrize("confidence", [np.ones((4, 5)), np.ones((4, 4, 3))])
def test_bad_confidence(confidence):
    frame = yester.Frame(np.ones((4, 4, 3)))
    with pytest.raises(ValueError, match="confidence: expected"):
        yester.TAA().step(frame, samples=frame.color, confidence=confidence)
    with pytest.raises(ValueError, match="confidence: needs samples as well"):
        yester.TAA().step(frame, confidence=np.ones((4, 4)))


@pytest.mark.parametrize(
    ("samples", "error", "message"),
    [
        (np.ones((4, 5, 3)), ValueError, "samples: expected .* got"),
        (np.ones((4, 4)), ValueError, "samples: expected shape"),
        ("noise", TypeError, "samples"),
    ],
)
def test_bad_samples(samples, error, message):
    taa = yester.TAA(innovation=True)
    with pytest.raises(error, match=message):
        taa.step(yester.Frame(np.ones((4, 4, 3))), samples=samples)
    assert taa.step(yester.Frame(np.ones((4, 4, 3)))).history_length.max() == 1


def bright_ball(number: int, size=(96, 72)):
    """A scene whose moving ball is brighter than all else, from a camera at rest."""
    scene = flight.scene(2 * number, flight.camera(0, *size))
    *others, ball = scene.things
    return replace(scene, things=(*others, replace(ball, albedo=(8.0, 8.0, 8.0))))


def test_edges_of_what_moves_by_itself(monkeypatch):
    """History along a mover's motion is taken where it agrees: better than never, and than always."""
    frames, truths = [], []
    for number, offset in enumerate(yester.jitter(10)):
        now, before = bright_ball(number), bright_ball(number - 1)
        frames.append(replace(flight.sample(now, before), color=flight.sample(now, offset=tuple(offset)).color))
        truths.append(raycast.truth(now, 6))

    def error(stage) -> float:
        images = [stage.step(frame).color for frame in frames]
        pairs = zip(images[4:], truths[4:], strict=True)
        return float(np.mean([np.square(metrics.srgb(image) - metrics.srgb(truth)) for image, truth in pairs]))

    chosen, always = error(yester.TAA("denoised")), error(yester.TAA("denoised", dilate_movers=True))
    monkeypatch.setattr(composed, "follows", lambda color, *_: np.zeros(color.shape[:2], bool))
    never = error(composed.TAA("denoised"))
    assert chosen < always
    assert chosen < 0.9 * never
