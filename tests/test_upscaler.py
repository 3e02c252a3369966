import itertools
from types import SimpleNamespace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, assert_close, assert_same_bits, colors, each, motions, tensor
from composed import sample, sequence, supersampled
from yester.study.synthetic import raycast

NAMES = ("color", "depth", "motion", "position", "camera", "jitter", "reactive")
OVERRIDES = [
    {"scale": 1.3, "alpha": 0.2, "fast_alpha": 0.9, "speed": 0.5},
    {"scale": 3.0, "separation": 0.01, "lifetime": 2.0, "sharpness": 0.7},
    {"scale": 1.0, "alpha": 0.0, "fast_alpha": 0.0, "speed": (0.2, 4.0), "sharpness": 1.0},
    {"fireflies": True},
]


def frames_of(names, count=4, **options) -> list[yester.Frame]:
    rng = np.random.default_rng(1)
    frames = []
    for frame in sequence(count, **options):
        mask = rng.uniform(-0.5, 1.2, frame["color"].shape[:2])
        mask[rng.random(mask.shape) < 0.05] = np.nan
        frames.append(yester.Frame(**{name: (frame | {"reactive": mask})[name] for name in names}))
    return frames


def check_bits(frames, **options) -> None:
    upscaler, other = yester.Upscaler(**options), composed.Upscaler(**options)
    for frame in frames:
        got, want = upscaler.step(frame), other.step(frame)
        for name in ("color", "history_length", "confidence", "rejection"):
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing
        assert got.variance is None
        assert np.isfinite(got.color).all()


@pytest.mark.parametrize("count", range(len(NAMES)))
def test_pipeline_is_its_kernels(count):
    """With any subset of its buffers, bit for bit."""
    for names in itertools.combinations(NAMES[1:], count):
        check_bits(frames_of(("color", *names), 3, size=(37, 23)))


@pytest.mark.parametrize("options", OVERRIDES)
def test_options_are_the_kernels_arguments(options):
    frames = frames_of(NAMES, 6)
    check_bits(frames, **options)
    check_bits(frames_of(("color", "motion"), 4), **options)


@each("size", SIZES)
def test_any_size_and_wild_motion(size):
    rng = np.random.default_rng(0)
    frames = [
        yester.Frame(colors(rng, *size), motion=motions(rng, *size, channels), jitter=jitter)
        for channels, jitter in ((2, (0.5, -0.5)), (3, None), (2, (-0.1, 0.3)), (3, (0, 0)))
    ]
    for scale in (1.3, 2.0, 3.0):
        check_bits(frames, scale=scale)


@pytest.mark.parametrize("options", [{}, {"scale": 1.5, "sharpness": 0.5, "lifetime": 4.0}, {"fireflies": True}])
@pytest.mark.parametrize("names", [NAMES, ("color", "position", "camera"), ("color", "motion", "jitter")])
def test_reference(options, names):
    """The pipeline against its float64 composition, in which decisions may flip in a few pixels."""
    upscaler, other = yester.Upscaler(**options), reference.Upscaler(**options)
    absent = dict.fromkeys(NAMES)
    for frame in frames_of(names, 5):
        got = upscaler.step(frame)
        given = tensor(frame.buffers()) | {"camera": frame.camera, "jitter": frame.jitter}
        want = other.step(SimpleNamespace(**absent | given))
        assert got.missing == want.missing
        named = {"where": np.ones(got.confidence.shape, bool), "flips": got.confidence.size // 200}
        assert_close("Upscaler", got.color, want.color, rtol=1e-4, **named)
        assert_close("Upscaler history_length", got.history_length, want.history_length, rtol=1e-4, **named)
        assert_close("Upscaler confidence", got.confidence, want.confidence, rtol=1e-4, **named)
        assert (got.rejection != np.asarray(want.rejection)).sum() <= got.confidence.size // 200


def test_everything_is_used_that_is_there():
    for names, used in (
        (("color",), ()),
        (("color", "jitter"), ("jitter",)),
        (("color", "depth", "motion"), ("motion", "depth")),
        (("color", "position", "camera"), ("camera", "position")),
        (NAMES, ("motion", "depth", "jitter", "reactive")),
    ):
        upscaler = yester.Upscaler()
        for frame in frames_of(names, 2):
            out = upscaler.step(frame)
        assert sorted(out.used) == sorted(used)


@pytest.mark.parametrize(("scale", "size"), [(1.3, (56, 79)), (1.5, (64, 92)), (2.0, (86, 122)), (3.0, (129, 183))])
def test_sizes_are_rounded(scale, size):
    out = yester.Upscaler(scale).step(yester.Frame(np.ones((43, 61, 3))))
    assert out.color.shape == (*size, 3)
    for name in ("history_length", "confidence", "rejection"):
        assert getattr(out, name).shape == size


def error(image, truth) -> float:
    return float(np.mean((image - truth) ** 2))


def camera(scale: float) -> yester.Camera:
    return flight.camera(0, round(96 * scale), round(64 * scale))


@pytest.mark.parametrize(("scale", "factor"), [(1.5, 8.0), (2.0, 10.0), (3.0, 15.0)])
def test_a_still_image_converges_to_its_own_resolution(scale, factor):
    """The error of a Lanczos reconstruction of one frame divided by this factor, that of a native frame by 4.

    Below the horizon: where that line lies within its row of pixels decides on most of a native frame's error.
    """
    small, large = camera(1), camera(scale)
    truth, upscaler = supersampled(large), yester.Upscaler(scale)
    for offset in yester.jitter(int(8 * scale**2)):
        frame = sample(small, offset)
        out = upscaler.step(yester.Frame(frame["color"], depth=frame["depth"], jitter=offset))
    alone, _ = yester.resample(frame["color"], out.color.shape[:2], offset=offset)
    own, alone, native = (
        error(image[round(14 * scale) :], truth[round(14 * scale) :])
        for image in (out.color, alone, sample(large)["color"])
    )
    assert factor * own < alone
    assert 4 * own < native


@pytest.mark.parametrize("scale", [1.0, 1.5, 2.0])
def test_locks_open_when_all_light_changes(scale):
    """A line a sample wide that is locked follows light that falls to a fiftieth, within two frames."""
    upscaler, shift = yester.Upscaler(scale), yester.jitter(64)
    for i in range(44):
        x = np.arange(48) + 0.5 + shift[i % 64][0]
        row = np.where(np.abs(x - 24.3) < 0.5, 1.0, 0.1) * (1 if i < 40 else 0.02)
        color = np.broadcast_to(row[:, None], (48, 48, 3))
        out = upscaler.step(yester.Frame(color, jitter=shift[i % 64], motion=np.zeros((48, 48, 2))))
        at = int(24.3 * scale)
        line = out.color[int(24 * scale), at - 1 : at + 2].max()
        if i == 39:
            assert line > 0.75
        if i >= 42:
            assert line < 0.04


def test_without_jitter_it_is_lanczos():
    """Zero jitter is allowed: the output is the Lanczos reconstruction, but for clipped overshoots."""
    color = sample(camera(1))["color"]
    want, _ = yester.resample(color, (128, 192))
    upscaler = yester.Upscaler()
    for _ in range(6):
        out = upscaler.step(yester.Frame(color))
    np.testing.assert_allclose(out.color, want, atol=0.02)
    assert np.mean(np.abs(out.color - want)) < 1e-5
    assert "jitter" not in out.used
    zero = yester.Upscaler()
    for _ in range(6):
        told = zero.step(yester.Frame(color, jitter=(0, 0)))
    assert_same_bits(told.color, out.color)


def test_a_locked_line_does_not_vanish():
    """A drifting line, a third of a pixel wide: in most frames, samples miss most of it."""

    def draw(offset, drift):
        y, x = np.mgrid[:24, :48] + 0.5
        on = np.abs(y + offset[1] - 10.3 - 0.13 * (x + offset[0] - drift)) < 0.17
        return np.where(on, 1, 0.1)[..., None].repeat(3, -1).astype(np.float32)

    left = {}
    for lifetime in (16.0, 0.5):
        upscaler, offsets, light = yester.Upscaler(lifetime=lifetime), yester.jitter(32), []
        for number in range(64):
            offset, motion = offsets[number % 32], np.broadcast_to(np.float32([-0.4, 0]), (24, 48, 2))
            image = upscaler.step(yester.Frame(draw(offset, 0.4 * number), motion=motion, jitter=offset)).color
            light.append(np.sum(image[:, 16:-16] - 0.1))
        left[lifetime] = np.mean(light[32:])
    places = (np.arange(8) + 0.5) / 8 - 0.5
    drawn = np.mean([4 * np.sum(draw((x, y), 20)[:, 8:-8] - 0.1) for x in places for y in places])
    assert left[16.0] > 1.03 * left[0.5]
    assert left[16.0] > 0.3 * drawn


def moving_sphere(number: int, width: int, height: int) -> raycast.Scene:
    eye = yester.Camera.from_look_at([0, 0.6, 4], [0, 0.5, 0], [0, 1, 0], 40, width, height)
    things = (
        raycast.Thing(
            raycast.Rectangle(8, 8), raycast.translate(0, 0, -2), raycast.checker((0.9,) * 3, (0.1,) * 3, 0.3)
        ),
        raycast.Thing(raycast.Sphere(0.5), raycast.translate(-1.2 + 0.25 * number, 0.5, 0), (0.8, 0.1, 0.1)),
    )
    return raycast.Scene(things, eye, ambient=(0.7, 0.7, 0.7))


def test_disocclusions_leave_no_ghost():
    """The wall that the sphere uncovers is in the mask from its first frame on, without the sphere's red."""
    rng, offsets, upscaler = np.random.default_rng(0), yester.jitter(32), yester.Upscaler()
    for number in range(10):
        now, before = (moving_sphere(n, 64, 48) for n in (number, max(number - 1, 0)))
        out = upscaler.step(raycast.shoot(now, before, rng, jitter=offsets[number]))
    large = [moving_sphere(n, 128, 96) for n in (9, 8)]
    here, there = (raycast.cast(s, raycast.centres(s.camera)).ids for s in large)
    uncovered = (here == 1) & (there == 2)
    truth = raycast.truth(large[0])
    red = out.color[..., 0] - out.color[..., 1] - (truth[..., 0] - truth[..., 1])
    assert uncovered.sum() > 60
    assert (out.rejection[uncovered] & yester.Rejection.DEPTH > 0).mean() > 0.6
    assert np.median(np.abs(red[uncovered])) < 0.02
    kept = (here == 1) & (there == 1)
    assert (out.rejection[kept] & yester.Rejection.DEPTH > 0).mean() < 0.05


def test_a_reactive_mask_forgets():
    color, upscaler = np.full((8, 9, 3), 0.4, np.float32), yester.Upscaler()
    for offset in yester.jitter(8):
        out = upscaler.step(yester.Frame(color, jitter=offset))
    assert (out.confidence == 1).all()
    mask = np.zeros((8, 9), np.float32)
    mask[2:5, 3:6] = 1
    mask[6, 6] = 0.5
    out = upscaler.step(yester.Frame(2 * color, jitter=offset, reactive=mask))
    np.testing.assert_allclose(out.color[5:9, 7:11], 0.8, rtol=1e-6)
    assert (out.confidence[5:9, 7:11] == 0).all()
    assert (out.confidence[:2] == 1).all()
    assert out.confidence[10:, 12:].min() == 0.5


def test_constant_stays():
    color, rng = np.full((16, 17, 3), np.float32([0.7, 0.2, 3])), np.random.default_rng(0)
    upscaler = yester.Upscaler(1.7, sharpness=0.5)
    for offset in yester.jitter(12):
        out = upscaler.step(yester.Frame(color, motion=rng.normal(0, 0.7, (16, 17, 2)), jitter=offset))
        np.testing.assert_allclose(out.color, np.broadcast_to(color[0, 0], out.color.shape), rtol=5e-6)
    assert out.missing == 0


def test_length_counts_samples():
    """Samples per pixel of the output over all frames, until alpha bounds them."""
    color, upscaler = np.full((20, 30, 3), 0.5, np.float32), yester.Upscaler(alpha=0.2)
    lengths = [upscaler.step(yester.Frame(color, jitter=o)).history_length[4:-4, 4:-4] for o in yester.jitter(64)]
    np.testing.assert_allclose(lengths[7].mean(), 8 / 4, rtol=0.1)
    assert lengths[-1].max() <= 1 / 0.2 - 1 + 1.5
    assert lengths[-1].mean() > 4


def test_missing_samples_are_survived():
    good, upscaler = np.full((8, 9, 3), 0.6, np.float32), yester.Upscaler()
    lost = yester.Frame(np.full_like(good, np.nan), jitter=(0.2, 0.1))
    out = upscaler.step(lost)
    assert out.missing == 72
    assert not out.color.any()
    assert not out.history_length.any()
    out = upscaler.step(yester.Frame(good, jitter=(0.1, -0.3)))
    np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)
    length = out.history_length
    out = upscaler.step(lost)
    np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)
    np.testing.assert_array_equal(out.history_length, length)
    holes = good.copy()
    holes[2:5, 3, 1], holes[7, 8, 0] = np.inf, np.nan
    out = upscaler.step(yester.Frame(holes))
    assert out.missing == 4
    np.testing.assert_allclose(out.color, 0.6, rtol=1e-6)


def test_reset_forgets_and_sizes_stay_until_then():
    frames = frames_of(NAMES, 3)
    upscaler = yester.Upscaler()
    first = [upscaler.step(frame).color for frame in frames]
    with pytest.raises(ValueError, match="reset"):
        upscaler.step(yester.Frame(np.ones((8, 9, 3))))
    assert upscaler.reset() is None
    for frame, want in zip(frames, first, strict=True):
        assert_same_bits(upscaler.step(frame).color, want)
    upscaler.reset()
    assert upscaler.step(yester.Frame(np.ones((8, 9, 3)))).color.shape == (16, 18, 3)


def test_radiance_has_no_scale():
    def last(scale):
        rng, upscaler = np.random.default_rng(0), yester.Upscaler(sharpness=0.3)
        for offset in yester.jitter(6):
            color = rng.gamma(4, 0.25, (20, 24, 3)).astype(np.float32) * np.float32(scale)
            out = upscaler.step(yester.Frame(color, jitter=offset)).color
        return out / scale

    for scale in (2.0**-20, 2.0**20):
        np.testing.assert_allclose(last(scale), last(1), rtol=1e-4)


@pytest.mark.parametrize(
    ("argument", "values"),
    [
        ("scale", [0.99, 4.1, -2, 0, np.nan, np.inf]),
        ("alpha", [-0.1, 1.1, np.nan]),
        ("fast_alpha", [-0.1, 1.1, np.nan]),
        ("speed", [-1, np.nan, (3, 2)]),
        ("separation", [-0.1, 1.1, np.nan]),
        ("lifetime", [0, -1, np.nan]),
        ("sharpness", [-0.1, 1.1, np.nan]),
    ],
)
def test_out_of_range(argument, values):
    for value in values:
        with pytest.raises(ValueError, match=rf"^{argument}: expected"):
            yester.Upscaler(**{argument: value})
    with pytest.raises(TypeError, match=argument):
        yester.Upscaler(**{argument: "much"})


def test_bad_frames_and_outputs():
    upscaler = yester.Upscaler()
    with pytest.raises(TypeError, match="frame"):
        upscaler.step(np.ones((4, 4, 3), np.float32))
    frame = yester.Frame(np.ones((4, 5, 3)))
    with pytest.raises(ValueError, match=r"^out: expected .*\(8, 10, 3\).*\(4, 5, 3\)"):
        upscaler.step(frame, out=yester.TAA().step(frame))
    with pytest.raises(ValueError, match=r"reactive: expected height 4 and width 5"):
        yester.Frame(np.ones((4, 5, 3)), reactive=np.ones((8, 10)))
