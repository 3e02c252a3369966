"""The kernel `recirculate` and its pipeline."""

import compare
import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from composed import sample, sequence
from hypothesis import given
from hypothesis import strategies as st
from yester.metrics import psnr

IMAGES = ("color", "history_length", "confidence", "rejection")


# The kernel


def images(rng, height, width) -> tuple:
    pair = []
    for holes in (0.1, 0.3):
        quality = rng.exponential(1, (height, width)).astype(np.float32)
        quality[rng.random(quality.shape) < holes] = 0
        broken = rng.random(quality.shape) < 0.05
        quality[broken] = rng.choice([np.nan, -1, np.inf], int(broken.sum()))
        pair += [compare.colors(rng, height, width), quality]
    return *pair, compare.motions(rng, height, width, int(rng.integers(2, 4)))


def check(given: tuple, **named) -> tuple:
    got = yester.recirculate(*given, **named)
    want = reference.recirculate(*tensor(given), **named)
    assert all(image.dtype == np.float32 for image in got)
    clear = None
    if named.get("fetch"):
        # Means with near-zero total weight are not precise.
        known = (given[3] > 0).astype(np.float32)
        whole = {"fetch": True, "fade": np.inf, "limit": np.inf}
        weight = yester.recirculate(given[0], 0 * known, given[2], known, given[4], **whole)[1]
        clear = (weight == 0) | (weight > 0.05)
    # At the border of known pixels, a near-zero weight decides whether a value is known.
    assert_close("recirculate color", got[0], want[0], rtol=2e-5, where=clear, flips=got[1].size // 500)
    assert_close("recirculate quality", got[1], want[1])
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    blur=st.sampled_from([0.0, 0.25, 1.0]),
    share=st.sampled_from([(0.0, 1.0), (0.1, 0.5), (0.3, 0.3)]),
    fade=st.sampled_from([0.5, 64.0, np.inf]),
    limit=st.sampled_from([0.5, 8.0, np.inf]),
    fetch=st.booleans(),
)
def test_reference(seed, size, **named):
    check(images(np.random.default_rng(seed), *size), **named)


@each(("height", "width"), SIZES + TAILS[::4])
@pytest.mark.parametrize("fetch", [False, True])
def test_sizes(height, width, fetch):
    check(images(np.random.default_rng(width), height, width), fetch=fetch)


def test_weights_and_qualities_by_hand():
    """Weights by quality, within their range; old quality halves after `fade` pixels; sums grow up to the limit."""
    new, old = np.zeros((1, 4, 3), np.float32), np.ones((1, 4, 3), np.float32)
    one, three = np.full((1, 4), 1, np.float32), np.float32([[3, 3, 3, 0]])
    motion = np.zeros((1, 4, 2), np.float32)
    motion[0, 1] = 6, 8
    motion[0, 2] = np.nan
    color, quality = yester.recirculate(new, one, old, three, motion, blur=0, fade=10)
    np.testing.assert_allclose(color[0, :, 0], [0.75, 0.6, 0.75, 0], rtol=1e-6)
    np.testing.assert_allclose(quality, [[4, 2.5, 4, 1]], rtol=1e-6)
    color, quality = yester.recirculate(new, one, old, three, motion, share=(0.3, 1), limit=3)
    np.testing.assert_allclose(color[0, :, 0], [0.7, 0.7, 0.7, 0], rtol=1e-6)
    np.testing.assert_allclose(quality, [[3, 3, 3, 1]], rtol=1e-6)
    color, _ = yester.recirculate(new, one, old, three, motion, share=(0, 0.2))
    np.testing.assert_allclose(color[0, :, 0], [0.8, 0.8, 0.8, 0], rtol=1e-6)


def test_three_places_along_the_motion():
    """A bright pixel spreads a third to a quarter of the motion away on each side; the sum is kept."""
    image, known = np.zeros((9, 30, 3), np.float32), np.ones((9, 30), np.float32)
    image[4, 15] = 3
    motion = np.full((9, 30, 2), np.float32([16, 0]))
    nothing = np.zeros_like(known)
    for case in ((image, known, image * 7, nothing), (image * 7, nothing, image, known)):
        color, _ = yester.recirculate(*case, motion)
        assert_same_bits(color[4, [11, 15, 19]], np.ones((3, 3), np.float32))
        assert color.sum() == 9
    hole = np.where(image > 0, np.float32(np.nan), np.float32(2))
    color, quality = yester.recirculate(hole, known, image, nothing, motion)
    assert np.isnan(color[4, 15]).all()
    assert quality[4, 15] == 0
    assert (np.delete(color[4], 15, 0) == 2).all()


def test_the_old_image_is_fetched_from_where_motion_leads():
    """With its quality; nothing from outside; without offset where motion is unknown."""
    image = np.arange(30, dtype=np.float32)[:, None] * np.ones((9, 30, 3), np.float32)
    nothing, known = np.zeros((9, 30), np.float32), np.float32(1 + np.arange(30)) * np.ones((9, 1), np.float32)
    motion = np.full((9, 30, 2), np.float32([4.5, 0]))
    motion[0] = np.nan
    color, quality = yester.recirculate(image, nothing, image, known, motion, fade=np.inf, limit=np.inf, fetch=True)
    np.testing.assert_allclose(color[1:, :23, 0], image[1:, :23, 0] + 4.5, rtol=1e-6)
    np.testing.assert_allclose(quality[1:, :23], known[1:, :23] + 4.5, rtol=1e-6)
    assert not quality[1:, 26:].any()
    assert np.isnan(color[1:, 26:]).all()
    assert_same_bits(color[0], image[0])
    assert_same_bits(quality[0], known[0])


@pytest.mark.parametrize("fetch", [False, True])
def test_constant_stays_constant(fetch):
    rng = np.random.default_rng(0)
    _, new, _, old, motion = images(rng, 30, 41)
    color = np.full((30, 41, 3), np.float32([0.7, 0.1, 3]))
    got, quality = yester.recirculate(color, new, color, old, motion, fetch=fetch)
    seen = quality > 0
    assert 0.8 < seen.mean() < 1
    np.testing.assert_allclose(got[seen], color[seen], rtol=1e-6)
    assert np.isnan(got[~seen]).all()
    assert (quality >= 0).all()


BAD = [
    ("blur", [-0.1, 1.1, np.nan]),
    ("share", [(-0.1, 1), (0, 1.1), (0.6, 0.5), (np.nan, 1)]),
    ("fade", [0, -1, np.nan]),
    ("limit", [0, -1, np.nan]),
]


@pytest.mark.parametrize(("argument", "values"), BAD)
def test_out_of_range(argument, values):
    flat = np.ones((4, 5), np.float32)
    color, motion = np.dstack([flat] * 3), np.dstack([flat] * 2)
    for value in values:
        for function in (
            lambda **bad: yester.recirculate(color, flat, color, flat, motion, **bad),
            yester.Recirculation,
        ):
            with pytest.raises(ValueError, match=argument):
                function(**{argument: value})
    with pytest.raises(TypeError, match=argument):
        yester.Recirculation(**{argument: "much"})


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("factor", 1),
        ("factor", 17),
        ("levels", 0),
        ("tolerance", 0),
        ("nearness", -1),
        ("nearness", 5),
        ("history", "gather"),
        ("preset", "karis"),
    ],
)
def test_pipelines_refuse_it_too(argument, value):
    with pytest.raises(ValueError, match=argument):
        yester.Recirculation(**{argument: value})


# The pipeline

PATTERN = {2: (0, 3, 1, 2), 4: (0, 10, 2, 8, 5, 15, 7, 13, 1, 11, 3, 9, 4, 14, 6, 12)}


def traced(number: int, side: int, height: int, width: int) -> np.ndarray:
    """Mask of one pixel per block of side × side, a different one in every frame."""
    turn = PATTERN[side][number % side**2]
    mask = np.zeros((height, width), bool)
    mask[turn // side :: side, turn % side :: side] = True
    return mask


def sparse(frame: dict, mask: np.ndarray) -> dict:
    """The frame's buffers, missing where no pixel is traced."""
    some = {}
    for name in ("color", "depth", "position", "motion"):
        if name in frame:
            image = np.asarray(frame[name], np.float32)
            some[name] = np.where(mask.reshape(mask.shape + (1,) * (image.ndim - 2)), image, np.float32(np.nan))
    return {**frame, **some}


def frames_of(names, side=2, count=6) -> list[yester.Frame]:
    frames = [sparse(frame, traced(i, side, 43, 61)) for i, frame in enumerate(sequence(count))]
    return [yester.Frame(**{name: frame[name] for name in (*names, "color", "camera")}) for frame in frames]


CHOICES = [
    {},
    {"factor": 4, "levels": 2, "blur": 0.0, "tolerance": 0.01},
    {"blur": 1.0, "share": (0.1, 0.8), "fade": 2.0, "limit": 3.0, "nearness": 3},
    {"preset": "textbook"},
    {"history": "fetch", "blur": 0.0, "nearness": 0, "innovation": True},
    {"innovation": False},
    {"fireflies": True},
]


@pytest.mark.parametrize("options", CHOICES)
@pytest.mark.parametrize(
    "names", [("depth",), ("position",), ("depth", "motion", "jitter"), ("depth", "position", "motion", "jitter")]
)
def test_bits_are_those_of_the_functions(names, options):
    pipeline, other = yester.Recirculation(**options), composed.Recirculation(**options)
    for frame in frames_of(names, 2 if options else 4):
        got, want = pipeline.step(frame), other.step(frame)
        for name in IMAGES:
            assert_same_bits(getattr(got, name), getattr(want, name))
        assert got.missing == want.missing
        assert got.variance is None
        assert np.isfinite(got.color).all()
    used = {"camera", "position" if "position" in names else "depth", *names} - (
        {"depth"} if "position" in names else set()
    )
    assert set(got.used) == used


@pytest.mark.parametrize("options", [{}, {"nearness": 2}, {"preset": "textbook"}, {"fireflies": True}])
def test_reference_pipeline(options):
    """Equal to the references, but for points on borders between pixels, which accumulate over frames."""
    pipeline, other = yester.Recirculation(**options), reference.Recirculation(**options)
    for frame in frames_of(("depth", "motion"), count=4):
        got = pipeline.step(frame)
        buffers = {name: tensor(getattr(frame, name)) for name in ("color", "depth", "motion", "position")}
        want = other.step(composed.SimpleNamespace(**buffers, camera=frame.camera, jitter=None, normal=None, ids=None))
        for name in IMAGES:
            image, like = getattr(got, name), np.asarray(getattr(want, name))
            assert (np.abs(image - like) > 1e-4 * (1 + np.abs(like))).mean() < 0.02
        assert got.missing == want.missing


def test_the_preset_is_its_parameters():
    given = {"factor": 4, "levels": 2, "nearness": 1, "history": "fetch", "share": (0.1, 0.5), "innovation": False}
    pipeline, other, plain = yester.Recirculation("textbook"), yester.Recirculation(**given), yester.Recirculation()
    for frame in frames_of(("depth", "motion"), count=3):
        textbook, best = pipeline.step(frame).color, plain.step(frame).color
        assert_same_bits(textbook, other.step(frame).color)
    assert np.abs(textbook - best).max() > 0.1


def test_near_samples_override_distant_ones():
    """In filled holes between them, in any unit of depth; everything overrides the background."""
    camera = flight.camera(0.0, 8, 4)
    color, depth = (np.full((4, 8, *channels), np.nan, np.float32) for channels in ((3,), ()))
    color[1, 2], color[1, 5] = 1, 0

    def filled(nearness, near, far):
        depth[1, 2], depth[1, 5] = near, far
        output = yester.Recirculation(nearness=nearness).step(yester.Frame(color, depth=depth, camera=camera))
        assert (output.history_length[[1, 1], [2, 5]] == 1).all()
        return output.color[..., 0], output.history_length

    even, counted = filled(0, 1, 4)
    for unit in (1e-3, 1, 1e5):
        means = [filled(nearness, unit, 4 * unit)[0][3, 4] for nearness in (0, 1, 2)]
        odds = even[3, 4] / (1 - even[3, 4])
        np.testing.assert_allclose(means, [odds * 4**k / (1 + odds * 4**k) for k in (0, 1, 2)], rtol=1e-4)
    image, counts = filled(4, 3, np.inf)
    both = (even > 0) & (even < 1)
    assert both.mean() > 0.25
    np.testing.assert_allclose(image[both], 1, rtol=1e-6)
    assert (counts <= 2 * counted).all()
    # At equal depth all have equal weight, and qualities are unchanged.
    image, counts = filled(2, 3, 3)
    np.testing.assert_allclose(image, even, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(counts, counted, rtol=1e-5)


def test_fetched_history_comes_from_where_motion_leads():
    """A camera moving past a plane finds all of it that was in the previous image."""
    rng, pipeline = np.random.default_rng(0), yester.Recirculation(history="fetch", blur=0)
    cameras = [flight.camera(0.0, 61, 43), flight.camera(5.0, 61, 43)]
    depth, picture = np.full((43, 61), 4, np.float32), rng.random((43, 61, 3), np.float32)
    pipeline.step(yester.Frame(picture, depth=depth, camera=cameras[0]))
    motion = yester.motion_vectors(depth, *cameras[::-1])
    nothing = np.full_like(picture, np.nan)
    one = np.arange(43 * 61).reshape(43, 61) == 900
    frame = yester.Frame(np.where(one[..., None], 0, nothing), depth=np.where(one, depth, np.nan), camera=cameras[1])
    output = pipeline.step(frame)
    want, found = yester.reproject(picture, motion, filter="bilinear", fallback=False)
    inside = output.confidence > 0
    assert 0.5 < inside.mean() < 1
    assert (inside == (found > 0.5 - 1e-6)).mean() > 0.97
    well = (found > 0.999) & (output.history_length > 0.5)
    assert np.abs(output.color - want)[well].mean() < 0.05
    assert ((output.rejection == yester.Rejection.OUTSIDE) == ~inside).all()


def still_frames(count, side, color=None):
    camera = flight.camera(0.0, 61, 43)
    whole = sample(camera)
    whole["color"] = whole["color"] if color is None else color
    for i in range(count):
        some = sparse(whole, traced(i, side, 43, 61))
        yield yester.Frame(some["color"], depth=some["depth"], camera=camera)


@pytest.mark.parametrize("side", [2, 4])
def test_static_scenes_converge_to_the_full_image(side):
    """Once every pixel has been traced the image is nearly complete, and the error keeps falling."""
    whole, pipeline = sample(flight.camera(0.0, 61, 43))["color"], yester.Recirculation()
    found = [psnr(pipeline.step(frame).color, whole) for frame in still_frames(16 * side**2, side)]
    turn = side**2 - 1
    assert found[turn] > found[0] + 3
    assert found[4 * turn + 3] > found[turn] + 2
    assert found[-1] > found[turn] + 5


def test_all_traced_is_shown_as_it_is():
    camera = flight.camera(0.0, 61, 43)
    whole, pipeline = sample(camera), yester.Recirculation()
    for number in range(1, 11):
        output = pipeline.step(yester.Frame(whole["color"], depth=whole["depth"], camera=camera))
        np.testing.assert_allclose(output.color, whole["color"], rtol=1e-6)
        assert (output.history_length == min(number, 8)).all()
        assert (output.confidence == (number > 1)).all()
        assert not output.rejection.any()
        assert output.missing == 0


def test_history_helps_a_moving_camera():
    """At a sixteenth of the pixels and half a pixel of motion: half the squared error of filling alone."""
    errors, pipeline = [], yester.Recirculation()
    for i in range(24):
        frame = sample(flight.camera(0.25 * i, 96, 64))
        some = sparse(frame, traced(i, 4, 64, 96))
        output = pipeline.step(yester.Frame(some["color"], depth=some["depth"], camera=frame["camera"]))
        alone, _ = yester.pull_push(some["color"])
        if i >= 16:
            errors.append([np.mean((image - frame["color"]) ** 2) for image in (output.color, alone)])
    ours, alone = np.mean(errors, 0)
    assert 2 * ours < alone


@pytest.mark.parametrize("speed", [0.1, 0.28, 0.5])
def test_history_keeps_up_with_a_slow_camera(speed):
    """A point that new samples join moves as far as they do; by whole pixels, it would lag by one or two."""
    width, height, pipeline = 48, 32, yester.Recirculation(blur=0.0, innovation=False)
    step = speed * 6 * np.tan(np.radians(30)) / width  # at a distance of 3, in a field of view of 60 degrees
    apart = []
    for i in range(40):
        at = [-step * i, 0, 0]
        camera = yester.Camera.from_look_at(at, [at[0], 0, 1], [0, 1, 0], 60, width, height, fov_axis="x")
        depth = np.full((height, width), 3.0)
        place = camera.unproject(np.stack(np.indices((width, height)), -1).transpose(1, 0, 2) + 0.5, depth)
        color = np.repeat(0.5 + 0.4 * np.sin(3 * place[..., :1] + place[..., 1:2]), 3, -1)
        shown = pipeline.step(yester.Frame(color, depth=depth, camera=camera)).color
        if i >= 30:
            slope = np.gradient(color[..., 0], axis=1)[6:-6, 6:-6]
            apart.append(((shown - color)[6:-6, 6:-6, 0] * slope).sum() / (slope**2).sum())
    assert abs(np.mean(apart)) < 0.1


def test_noise_is_averaged():
    """On a static noisy image, each new sample has less weight, down to a limit."""
    rng, pipeline = np.random.default_rng(0), yester.Recirculation()
    camera, depth = flight.camera(0.0, 61, 43), np.full((43, 61), 4, np.float32)
    for _ in range(30):
        noisy = rng.uniform(0, 2, (43, 61, 3)).astype(np.float32)
        output = pipeline.step(yester.Frame(noisy, depth=depth, camera=camera))
    assert np.std(output.color) < 0.35 * np.std(noisy)
    assert np.mean(output.color) == pytest.approx(1, abs=0.02)


def test_moving_things_go_on_with_motion_and_stay_behind_without():
    """A bright square flies past, a fourth of it traced in each frame: it ghosts only where motion is not supplied."""
    camera = flight.camera(0.0, 61, 43)

    def picture(i):
        square = np.zeros((43, 61), bool)
        square[15:27, 4 + 3 * i : 18 + 3 * i] = True
        return square

    errors = {}
    for told in (True, False):
        pipeline = yester.Recirculation(blur=0)
        for i in range(12):
            square = picture(i)
            motion = np.where(square[..., None], np.float32([-3, 0, 0]), np.float32(0))
            color, depth = np.dstack([square] * 3) + np.float32(0.1), np.where(square, 3, 6)
            frame = sparse({"color": color, "depth": depth, "motion": motion}, traced(i, 2, 43, 61))
            buffers = {"depth": frame["depth"], **({"motion": frame["motion"]} if told else {})}
            output = pipeline.step(yester.Frame(frame["color"], **buffers, camera=camera))
        errors[told] = np.mean((output.color - color) ** 2)
        # The tail's history is dropped, and reported as rejected; that of the square only without its motion.
        rejected = output.rejection == 2
        assert rejected[~square].any()
        assert rejected[square].any() == (not told)
    assert 4 * errors[True] < errors[False]


def test_nothing_traced_at_all():
    """Black at first; later the history, corrected by the last samples' innovation."""
    nothing = np.full((43, 61, 3), np.nan, np.float32)
    frames = list(still_frames(5, 2))
    dark = yester.Frame(nothing, depth=nothing[..., 0], camera=frames[0].camera)
    pipeline = yester.Recirculation()
    output = pipeline.step(dark)
    assert not output.color.any()
    assert not output.history_length.any()
    assert output.missing == 61 * 43
    for frame in frames:
        known = pipeline.step(frame)
    output = pipeline.step(dark)
    assert output.missing == 61 * 43
    np.testing.assert_allclose(output.color, known.color, rtol=1e-6, atol=2e-4)
    assert (output.confidence == 1).all()
    plain = yester.Recirculation(innovation=False)
    for frame in [dark, *frames]:
        known = plain.step(frame)
    np.testing.assert_allclose(plain.step(dark).color, known.color, rtol=1e-6)


def test_cuts_start_anew():
    """Pixels that the camera has not seen before come from this frame alone."""
    pipeline, frames = yester.Recirculation(), list(still_frames(5, 2))
    for frame in frames[:4]:
        pipeline.step(frame)
    away = yester.Camera.from_look_at([0, 0, 100], [0, 0, 200], [0, 1, 0], 50, 61, 43)
    cut = yester.Frame(frames[4].color, depth=frames[4].depth, camera=away)
    output, alone = pipeline.step(cut), yester.Recirculation().step(cut)
    assert (output.rejection == yester.Rejection.OUTSIDE).mean() > 0.6
    new = output.confidence == 0
    np.testing.assert_array_equal(output.color[new], alone.color[new])


def test_required_buffers():
    camera = flight.camera(0.0, 6, 5)
    color, depth = np.ones((5, 6, 3), np.float32), np.ones((5, 6), np.float32)
    pipeline = yester.Recirculation()
    with pytest.raises(ValueError, match="camera"):
        pipeline.step(yester.Frame(color, depth=depth))
    with pytest.raises(ValueError, match="depth or position"):
        pipeline.step(yester.Frame(color, camera=camera))
    with pytest.raises(TypeError, match="frame"):
        pipeline.step(color)
    pipeline.step(yester.Frame(color, depth=depth, camera=camera))
    other = yester.Frame(color[1:], depth=depth[1:], camera=flight.camera(0.0, 6, 4))
    with pytest.raises(ValueError, match="reset"):
        pipeline.step(other)
    assert (pipeline.step(yester.Frame(color, depth=depth, camera=camera)).history_length == 2).all()
    pipeline.reset()
    assert (pipeline.step(other).history_length == 1).all()


def test_reset_forgets():
    frames, pipeline = frames_of(("depth", "motion"), count=3), yester.Recirculation()
    first = [pipeline.step(frame).color for frame in frames]
    assert pipeline.reset() is None
    for frame, want in zip(frames, first, strict=True):
        assert_same_bits(pipeline.step(frame).color, want)


def test_one_pixel():
    camera, pipeline = flight.camera(0.0, 1, 1), yester.Recirculation()
    for number, value in enumerate((1.0, 3.0), 1):
        frame = yester.Frame(np.full((1, 1, 3), value), depth=np.full((1, 1), 4.0), camera=camera)
        output = pipeline.step(frame)
        np.testing.assert_allclose(output.color, number, rtol=1e-6)
        assert output.history_length == number


def test_steps_write_into_an_earlier_output():
    fresh, reusing, out = yester.Recirculation(), yester.Recirculation(), None
    for frame in frames_of(("depth", "motion"), count=3):
        want, before = fresh.step(frame), out
        out = reusing.step(frame, out=out)
        for name in IMAGES:
            assert_same_bits(getattr(out, name), getattr(want, name))
            assert before is None or getattr(out, name) is getattr(before, name)
    with pytest.raises(ValueError, match=r"^out: expected"):
        reusing.step(frame, out=yester.SVGF().step(frame))
    with pytest.raises(ValueError, match=r"^out: expected .*\(43, 61, 3\).*\(5, 7, 3\)"):
        reusing.step(frame, out=yester.TAA().step(yester.Frame(np.ones((5, 7, 3), np.float32))))


LIT = [{}, {"preset": "textbook", "innovation": True}, {"history": "fetch"}]


def lit_frames(side, count, change, *, size=(64, 96), noise=0.3):
    """Partly traced, noisy frames of a static scene whose light changes at frame `change`; and references."""
    rng, whole = np.random.default_rng(0), sample(flight.camera(0.0, size[1], size[0]))
    for number in range(count):
        truth = whole["color"] * np.float32(3 if number >= change else 1)
        noisy = truth * rng.gamma(1 / noise**2, noise**2, (*size, 1)).astype(np.float32)
        frame = sparse({**whole, "color": noisy}, traced(number, side, *size))
        yield yester.Frame(frame["color"], depth=frame["depth"], camera=frame["camera"]), truth


@pytest.mark.parametrize("options", LIT)
@pytest.mark.parametrize(("side", "change", "bound"), [(2, 12, 0.6), (4, 36, 0.9)])
def test_a_changed_light_is_found_sooner(options, side, change, bound):
    """Less error in the frames after the change; before it, no more than without innovation."""
    corrected, plain = yester.Recirculation(**options), yester.Recirculation(**options | {"innovation": False})
    errors = []
    for frame, truth in lit_frames(side, change + 4, change):
        outs = corrected.step(frame), plain.step(frame)
        for name in ("history_length", "confidence", "rejection"):
            assert_same_bits(getattr(outs[0], name), getattr(outs[1], name))
        errors.append([np.sqrt(np.mean((out.color - truth) ** 2)) for out in outs])
    own, other = np.transpose(errors)
    assert (own[change + 1 :] < bound * other[change + 1 :]).all()
    assert (own[change // 2 : change] < 1.02 * other[change // 2 : change]).all()


@pytest.mark.parametrize("options", LIT)
def test_innovation_needs_a_frame_before(options):
    """The first frame, and the first after a reset, are as without innovation."""
    corrected, plain = yester.Recirculation(**options), yester.Recirculation(**options | {"innovation": False})
    frames = [frame for frame, _ in lit_frames(2, 5, 3)]
    for _ in range(2):
        outs = [[pipeline.step(frame).color for frame in frames] for pipeline in (corrected, plain)]
        assert_same_bits(outs[0][0], outs[1][0])
        assert np.abs(outs[0][-1] - outs[1][-1]).max() > 0.1
        corrected.reset()
        plain.reset()


@pytest.mark.parametrize("options", LIT)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 2), (15, 9)])
def test_innovation_of_small_images_and_of_nothing(options, size):
    """Images smaller than the coarsest window, and frames without traced pixels."""
    pipeline, other = yester.Recirculation(**options), composed.Recirculation(**options)
    for number, (frame, _) in enumerate(lit_frames(2, 8, 4, size=size)):
        if number in (0, 5):
            nothing = np.full((*size, 3), np.nan, np.float32)
            frame = yester.Frame(nothing, depth=nothing[..., 0], camera=frame.camera)
        got, want = pipeline.step(frame), other.step(frame)
        assert_same_bits(got.color, want.color)
        assert np.isfinite(got.color).all()
