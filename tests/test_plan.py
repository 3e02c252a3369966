"""The predictive error, which needs no reference, and the plan that it decides."""

import copy
import pickle
import warnings
from dataclasses import replace
from itertools import chain

import flight
import layouts
import numpy as np
import pytest
import yester
from compare import assert_same_bits
from test_cli import refused, run
from yester.io import describe, read_exr, write_exr
from yester.judge import estimate, predictive_error, sums
from yester.plan import _cropped, _reversed, _windows
from yester.study.rendered.recording import record

SIZE = 96, 64


def frames(count=8, *, moving=True, light=lambda t: 1.0, size=SIZE, **changes):
    """Frames of the small scene with noise; `changes` replace buffers, None leaves one out."""
    rng = np.random.default_rng(0)
    result = []
    for t in range(count):
        shot = flight.shoot(t, *size, moving=moving)
        motion = shot.motion if moving else np.zeros((*shot.shape, 3), np.float32)
        named = {name: value(rng, shot) if callable(value) else value for name, value in changes.items()}
        color = flight.noisy(shot, rng) * np.float32(light(t))
        result.append(replace(shot, **{"color": color, "motion": motion, **named}))
    return result


def one_seed():
    """The same noise in every frame, on the screen."""
    return frames(color=lambda _, shot: flight.noisy(shot, np.random.default_rng(7)))


@pytest.fixture(scope="module")
def moving():
    return frames()


@pytest.fixture(scope="module")
def still():
    return frames(moving=False)


# The predictive error


def flat(colors):
    """Static frames of a single surface."""
    shape = colors[0].shape
    return [yester.Frame(color, motion=np.zeros((*shape[:2], 2)), ids=np.ones(shape[:2], int)) for color in colors]


def test_a_tile_by_hand():
    a, b, y = (np.full((8, 12, 3), value, np.float32) for value in (0.5, 0.3, 0.1))
    found = predictive_error([a, a], [b, 1.1 * b], flat([y, y]), tile=4)
    worse = (0.5 - 0.1) ** 2 - (0.3 - 0.1) ** 2
    slope = 1.055 / 2.4 * 0.4 ** (1 / 2.4 - 1)
    for weighting, weight in (("relative", 1 / (0.4**2 + 0.01)), ("display", slope**2)):
        one = found[weighting]
        assert one.difference == pytest.approx(weight * worse, rel=1e-5)
        assert one.error == pytest.approx(0, abs=1e-6)
        assert one.change == pytest.approx(weight * 0.03**2, rel=1e-4)
        np.testing.assert_allclose(one.tiles, np.full((2, 3), weight * worse), rtol=1e-5)


def test_estimates_the_difference_of_errors():
    """Against a known reference: within the standard errors, although noise is much larger than both errors."""
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.2, 0.8, (96, 128, 3)).astype(np.float32)
    a, b = (truth + rng.normal(0, error, truth.shape).astype(np.float32) for error in (0.04, 0.02))
    noisy = [truth * rng.exponential(1, (96, 128, 1)).astype(np.float32) for _ in range(6)]
    found = predictive_error([a] * 6, [b] * 6, flat(noisy))
    mean = 0.5 * (a + b).mean(-1)
    slope = 1.055 / 2.4 * mean ** (1 / 2.4 - 1)
    for weighting, weight in (("relative", 1 / (mean**2 + 0.01)), ("display", slope**2)):
        one = found[weighting]
        want = (((a - truth) ** 2 - (b - truth) ** 2).mean(-1) * weight).mean()
        assert one.difference == pytest.approx(want, abs=3 * one.error)
        assert one.difference > 4 * one.error > 0
        assert one.tiles.shape == (6, 8)
    swapped = predictive_error([b] * 6, [a] * 6, flat(noisy))
    assert swapped["relative"].difference == pytest.approx(-found["relative"].difference, rel=1e-5)


def test_equal_results_do_not_differ(moving):
    same = [frame.color for frame in moving]
    for one in predictive_error(same, same, moving, start=2).values():
        assert (one.difference, one.error) == (0, 0)
        assert one.change > 0


def test_missing_samples_and_edges_do_not_count():
    rng = np.random.default_rng(0)
    a, b, y = rng.random((3, 32, 32, 3)).astype(np.float32)
    holes = y.copy()
    holes[:, 16:] = np.nan
    found = predictive_error([a, a], [b, b], flat([y, holes]))["relative"]
    assert np.isfinite(found.tiles[:, 0]).all()
    assert np.isnan(found.tiles[:, 1]).all()
    ids = [np.ones((32, 32), int), np.ones((32, 32), int)]
    ids[1][:, 16:] = 2
    cut = [yester.Frame(y, motion=np.zeros((32, 32, 2)), ids=each) for each in ids]
    np.testing.assert_array_equal(predictive_error([a, a], [b, b], cut)["relative"].tiles, found.tiles)
    # A single tile tells no error.
    assert np.isnan(predictive_error([a, a], [b, b], flat([y, y]), tile=32)["relative"].error)
    nothing = predictive_error([a, a], [b, b], flat([y, np.full_like(y, np.nan)]))["display"]
    assert np.isnan(nothing.difference)
    assert np.isnan(nothing.change)
    assert np.isnan(nothing.tiles).all()


@pytest.mark.parametrize("frame", range(3))
@pytest.mark.parametrize("result", range(2))
def test_results_with_holes(frame, result):
    rng = np.random.default_rng(0)
    results = rng.random((2, 3, 32, 32, 3)).astype(np.float32)
    samples = flat(rng.random((3, 32, 32, 3)).astype(np.float32))
    whole = predictive_error(*results, samples)["relative"]
    results[result, frame, 9, 9] = np.nan
    found = estimate(*sums(results[:1], results[1], samples))["relative"]
    assert abs(found.difference - whole.difference) < whole.error
    np.testing.assert_allclose([found.error, found.change], [whole.error, whole.change], rtol=0.2)


def test_bad_input_of_the_judge(moving):
    images = [frame.color for frame in moving]
    with pytest.raises(ValueError, match="frames: expected as many as results, got 7 results and 8 frames"):
        predictive_error(images[:7], images, moving)
    with pytest.raises(ValueError, match="frames: expected at least two from `start` on, got 8 and start 7"):
        predictive_error(images, images, moving, start=7)
    with pytest.raises(ValueError, match=r"^tile: expected at least 1, got 0"):
        predictive_error(images, images, moving, tile=0)
    for name, number in (("tile", 16.0), ("tile", np.inf), ("start", 1.0)):
        with pytest.raises(TypeError, match=f"^{name}: expected an integer, got float"):
            predictive_error(images, images, moving, **{name: number})
    with pytest.raises(ValueError, match=r"^second\[1\]: expected shape"):
        predictive_error(images, [images[0], images[1][1:], *images[2:]], moving)
    with pytest.raises(TypeError, match=r"^first\[0\]: expected an array without a mask"):
        predictive_error([np.ma.masked_less(images[0], 1), *images[1:]], images, moving)
    with pytest.raises(TypeError, match=r"^first\[0\]: expected floats, got uint8"):
        predictive_error([images[0].astype(np.uint8), *images[1:]], images, moving)
    with pytest.raises(ValueError, match=r"^second\[1\]: \d+ of \d+ values are not finite"):
        predictive_error(images, [images[0], np.full_like(images[1], np.nan), *images[2:]], moving)


# The plan


def test_a_plan_has_evidence(moving):
    """For every stage and every given buffer; decisions are deterministic."""
    found = yester.plan(moving)
    names = ["position", "albedo", "normal", "depth", "ids", "motion", "camera", "choice"]
    assert [stage.name for stage in found.stages] == [*names, "gradient", "innovation", "reflections"]
    assert not found.static
    assert found.reason == ""
    assert set(found.buffers) == {"color", "albedo", "normal", "depth", "motion", "ids", "position", "camera"}
    by_name = {stage.name: stage for stage in found.stages}
    assert all(by_name[name].used for name in ("depth", "motion", "gradient", "innovation", "reflections"))
    assert by_name["choice"].loss > 2 * by_name["choice"].error > 0
    assert all(stage.error >= 0 for stage in found.stages)
    again = yester.plan(iter(moving))
    assert [replace(stage, ms=0) for stage in again.stages] == [replace(stage, ms=0) for stage in found.stages]
    assert (again.options, again.without) == (found.options, found.without)


def test_filters_of_warnings_stay(moving, monkeypatch):
    """They belong to all threads."""
    with monkeypatch.context() as patch:
        patch.setattr(warnings, "catch_warnings", None)
        assert yester.plan(moving).stages


def test_the_table(moving):
    found = yester.plan(moving)
    head, *lines = str(found).splitlines()
    assert head == found.summary()
    assert [line.split("  ")[0] for line in lines] == [stage.name for stage in found.stages]
    assert all("%" in line and "±" in line and line.endswith("ms") for line in lines)


@pytest.mark.parametrize(
    ("given", "summary"),
    [
        ({"without": ("ids", "albedo")}, "without ids, albedo"),
        ({"options": {"average_still": True}}, "without forgetting; all samples are averaged while nothing moves"),
        ({"options": {"average_still": False}, "static": True}, "the default: nothing is superfluous"),
        ({"options": {"reflections": (), "alpha": 0.1}}, "without reflections; alpha = 0.1"),
        ({"without": ("ids",), "reason": "no frames"}, "without ids; not judged: no frames"),
        ({"reason": "no frames"}, "the default: no frames"),
    ],
)
def test_the_summary_is_what_the_pipeline_does(given, summary):
    """Also of plans that were edited, whatever the evidence says."""
    stages = (yester.Stage("position", False, -1.0, 0.1, 1.0), yester.Stage("ids", True, 1.0, 0.1, 1.0))
    head, *lines = str(yester.Plan(**given, stages=stages)).splitlines()
    assert head == summary
    assert [line.split()[1] for line in lines] == ["used", "left" if "ids" in summary else "used"]


def test_a_broken_buffer_is_left_out(moving):
    """Albedo of pure noise: the plan improves the result."""
    broken = frames(albedo=lambda rng, shot: rng.uniform(0.02, 1, shot.color.shape))
    found = yester.plan(broken)
    assert "albedo" in found.without
    assert f"without {', '.join(found.without)}" in found.summary()
    truth = flight.shoot(7, *SIZE).color
    results = []
    for pipeline in (found.pipeline(), yester.SVGF()):
        images = [pipeline.step(frame).color for frame in broken]
        results.append(float(((images[-1] - truth) ** 2).mean()))
    assert results[0] < 0.7 * results[1]


def unit(rng, shot):
    vectors = rng.normal(size=shot.color.shape)
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "broken"),
    [
        ("ids", lambda rng, shot: rng.integers(1, 1000, shot.ids.shape).astype(np.uint32)),
        ("normal", unit),
        ("normal", lambda rng, shot: np.full_like(shot.normal, np.nan)),
        ("depth", lambda rng, shot: np.full_like(shot.depth, np.nan)),
        ("depth", lambda rng, shot: rng.uniform(0.5, 5, shot.depth.shape).astype(np.float32)),
    ],
)
def test_what_finds_no_surface_again_is_left_out(name, broken):
    """The result is that of frames without the buffer, although no pixel passes the buffer's own test."""
    given = frames(**{name: broken})
    assert name in yester.plan(given).without
    pipeline, other = yester.plan(given).pipeline(), yester.SVGF()
    absent = dict.fromkeys((name, "position") if name == "depth" else (name,))
    for frame in given:
        np.testing.assert_array_equal(pipeline.step(frame).color, other.step(replace(frame, **absent)).color)


def test_static_sequences_are_averaged(still):
    """Under constant light, or if history follows its jumps: over 32 frames the error is smaller."""
    found = yester.plan(still)
    assert found.static
    assert found.options == {"average_still": True}
    assert found.summary() == "without forgetting; all samples are averaged while nothing moves"
    truth, errors = flight.shoot(0, *SIZE, moving=False).color, []
    long = frames(32, moving=False)
    for pipeline in (found.pipeline(), yester.SVGF()):
        images = [pipeline.step(frame).color for frame in long]
        errors.append(float((((images[-1] - truth) ** 2) / (truth**2 + 0.01)).mean()))
    assert errors[0] < 0.9 * errors[1]
    assert yester.plan([replace(frame, motion=None) for frame in still]).static
    assert yester.plan(frames(moving=False, light=lambda t: 1 + 2 * (t > 3))).static
    assert not yester.plan(frames(moving=False, light=lambda t: 0.8**t)).static


def test_nothing_is_judged_without_motion(still):
    """In place, results would be compared with samples of other surfaces, which favours the most blurred."""
    for lacking in ({"camera": None}, {"depth": None, "position": None}):
        with pytest.warns(UserWarning, match="no motion, and no camera with depth or position"):
            found = yester.plan([replace(frame, motion=None, **lacking) for frame in still])
        assert not found.static
        assert not found.without
        assert found.reason.startswith("no motion")


def test_time_runs_backwards(moving):
    """With the inverse motion, which cameras go on telling if they do: a trial may be without them."""
    turned = _reversed(moving)
    assert [frame.motion is None for frame in turned] == [True] + 7 * [False]
    for frame, before in zip(turned[1:], moving[-2::-1], strict=True):
        assert_same_bits(frame.color, before.color)
    inside = np.isfinite(turned[1].motion).all(-1) & np.isfinite(moving[-1].motion).all(-1)
    assert np.median((turned[1].motion + moving[-1].motion)[inside][:, :2]) == pytest.approx(0, abs=0.1)
    assert all(frame.motion is None for frame in _reversed([replace(frame, motion=None) for frame in moving]))


@pytest.mark.parametrize("factor", [2.0**-4, 2.0**8, 2.0**40])
def test_brightness_changes_nothing(factor):
    """Noise instead of albedo is found in frames of any exposure."""
    given = frames(albedo=lambda rng, shot: rng.uniform(0.05, 1, shot.albedo.shape).astype(np.float32))
    brighter = [replace(frame, color=frame.color * np.float32(factor)) for frame in given]
    assert yester.plan(brighter).without == yester.plan(given).without == ("albedo",)


@pytest.mark.slow
def test_light_that_moves_leaves_normals_in(tmp_path):
    """Without them, results are blurred in the direction in which the light moves: as the next frame has it."""
    rendered = record("passing_day", tmp_path, frames=12, width=128, height=96, reference_spp=1)
    assert yester.plan([rendered.frame(number) for number in range(8)]).without == ()


def test_cameras_at_rest_are_used_if_nothing_else_tells_motion(still, moving):
    """They alone tell that nothing moves, and how they move later."""
    bare = {name: [replace(f, motion=None) for f in given] for name, given in (("still", still), ("moving", moving))}
    for given in (still, moving, bare["moving"]):
        assert "camera" in {stage.name for stage in yester.plan(given).stages}
    found = yester.plan(bare["still"])
    assert "camera" not in {stage.name for stage in found.stages} | {*found.without}


def test_the_pipeline_is_svgf(moving):
    """SVGF with the plan's options, on the buffers that it uses."""
    chosen = yester.Plan({"iterations": 2}, yester.plan(moving).buffers, ("ids", "camera"))
    planned, svgf = chosen.pipeline(), yester.SVGF(iterations=2)
    for frame in (*moving[:3], *moving[:2]):
        kept = {name: buffer for name, buffer in frame.buffers().items() if name != "ids"}
        assert_same_bits(planned.step(frame).color, svgf.step(yester.Frame(**kept)).color)
    planned.reset()
    assert_same_bits(planned.step(frame).color, yester.SVGF(iterations=2).step(yester.Frame(**kept)).color)


def test_planning_does_not_judge_motion(moving):
    """Parts of frames may move otherwise than the camera; the pipeline warns of whole ones."""
    wrong = [replace(frame, motion=-frame.motion) for frame in moving]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pipeline = yester.plan(wrong).pipeline()
    pipeline.step(wrong[0])
    with pytest.warns(UserWarning, match="motion: expected previous minus current"):
        pipeline.step(wrong[1])


def test_motion_to_the_next_frame_is_left_out_with_motion(still):
    """Otherwise `denoise` would compute the one from the other."""
    rng = np.random.default_rng(0)
    noise = [rng.uniform(-3, 3, frame.motion.shape).astype(np.float32) for frame in still]
    broken = [replace(frame, motion=each, motion_next=-each) for frame, each in zip(still, noise, strict=True)]
    assert {"motion", "motion_next"} <= {*yester.plan(broken).without}


def test_saved_and_loaded(still, moving, tmp_path):
    path = tmp_path / "plan.toml"
    for found in (yester.plan(still), yester.plan(moving), yester.Plan(reason='a "reason"\n')):
        found.save(path)
        assert yester.Plan.load(path) == found
        assert str(yester.Plan.load(path)) == str(found)
    odd = yester.Plan(stages=(replace(yester.plan(still).stages[0], loss=float("-inf"), error=float("inf")),))
    odd.save(path)
    assert yester.Plan.load(path) == odd
    given = {"relative_depth": (0.1, 0.2), "reflections": (), "alpha": np.float32(0.25), "choice": np.bool_(False)}
    whole = yester.Stage("ids", used=True, loss=0, error=np.float32(0.5), ms=1)
    saved = yester.Plan(options=given, stages=(whole,), reason="für 😀")
    saved.save(path)
    assert yester.Plan.load(path) == saved
    for options, message in (
        ({"relative_albedo": None}, "relative_albedo: expected a value that TOML has, got None"),
        ({"reflections": np.array([0.5])}, "reflections: expected a value that TOML has, got array"),
        ({"alpha": 3.0}, "alpha: expected"),
        ({"alpha": "x"}, "alpha: must be real number"),
    ):
        with pytest.raises(ValueError, match=rf"^options\.{message}"):
            yester.Plan(options=options).save(path)
    for value in ("0", True, 0.5j):
        with pytest.raises(ValueError, match=r"^stages\.loss: expected"):
            yester.Plan(stages=(replace(whole, loss=value),)).save(path)
    assert yester.Plan.load(path) == saved
    assert [each.name for each in tmp_path.iterdir()] == ["plan.toml"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("version = 1", "version = 2", "version: expected 1, got 2"),
        ("version = 1", "", "version: expected 1, got None"),
        ("static = ", "statics = true\nstatic = ", "statics: unknown key; expected some of options, buffers"),
        ("static = true", "", "static: missing key"),
        ("static = true", "static = 1", "static: expected bool, got int"),
        ("ms = ", "msec = 1.0\nms = ", "stages.msec: unknown key"),
        ("used = false", 'used = "no"', "stages.used: expected bool, got str"),
        ("average_still = ", "averages_still = ", "options.averages_still: "),
        ("average_still = true", "alpha = 3.0", "options.alpha: expected"),
        ("average_still = true", 'alpha = "x"', "options.alpha: must be real number"),
        ("average_still = true", 'relative_depth = [1, "x"]', "options.relative_depth: expected a number or a pair"),
        ('"ids"', '"idols"', "buffers: expected names of buffers, got 'idols'"),
        ("version = 1", "version = ", "not a plan: "),
    ],
)
def test_bad_files(still, tmp_path, old, new, message):
    path = tmp_path / "plan.toml"
    yester.plan(still).save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=r"plan\.toml: ") as caught:
        yester.Plan.load(path)
    assert message in str(caught.value)


def test_no_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        yester.Plan.load(tmp_path / "none.toml")


def test_a_plan_for_other_buffers(moving):
    """It is noticed in the second frame; the first may lack buffers, such as motion, and so may later ones."""
    found = yester.plan(moving)
    first, second = (yester.Frame(f.color, **{n: getattr(f, n) for n in ("albedo", "normal")}) for f in moving[:2])
    pipeline = found.pipeline()
    pipeline.step(first)
    with pytest.raises(
        ValueError, match=r"frame: depth: expected the buffers of the plan, color, albedo, .* got color"
    ):
        pipeline.step(second)
    pipeline.reset()
    pipeline.step(moving[0])
    with pytest.raises(ValueError, match="frame: emission: expected the buffers of the plan"):
        pipeline.step(replace(moving[1], emission=np.zeros_like(first.color)))
    pipeline.reset()
    for frame in moving[:2]:
        pipeline.step(frame)
    assert np.isfinite(pipeline.step(replace(moving[2], normal=None)).color).all()


@pytest.mark.parametrize("lacking", [(0,), (1,), (0, 1, 2, 3), (5, 6, 7)])
def test_a_plan_is_for_its_own_frames(moving, lacking):
    """Also if a buffer comes or goes among them."""
    given = [replace(frame, ids=None) if number in lacking else frame for number, frame in enumerate(moving)]
    found = yester.plan(given)
    assert "ids" in {stage.name for stage in found.stages}
    assert len([*yester.denoise(given, found.pipeline())]) == len([*map(found.pipeline().step, given)]) == len(given)


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_start_a_new_sequence(moving, again):
    pipeline = yester.plan(moving).pipeline()
    first = replace(moving[0], motion=None)
    want = pipeline.step(first)
    pipeline.step(moving[1])
    got = again(pipeline).step(first)
    assert_same_bits(got.color, want.color)


@pytest.mark.parametrize(
    "changes", [{"motion_next": None}, {"replay": None, "ids": None}, {"hit_distance": np.ones((64, 96))}]
)
def test_later_frames_may_have_other_buffers_from_both_sides(moving, changes):
    """As from one side: a backward run begins with the last frame, and a replay is of no use to it."""
    known = [replace(frame, motion_next=-frame.motion, replay=frame.color) for frame in moving]
    pipeline = yester.plan(known).pipeline()
    known[-1] = replace(known[-1], **changes)
    assert len([*yester.denoise(known, pipeline)]) == len([*map(pipeline.step, known)]) == len(known)
    with pytest.raises(ValueError, match="frame: depth: expected the buffers of the plan"):
        [*yester.denoise([known[0], replace(known[1], depth=None)], pipeline)]


@pytest.mark.parametrize("without", [("camera",), ("depth", "position")])
def test_no_motion_comes_from_buffers_that_are_left_out(moving, without):
    given = [replace(frame, motion=None) for frame in moving]
    bare = [replace(frame, **dict.fromkeys(without)) for frame in given]
    with pytest.warns(UserWarning, match="later frames are not used"):
        wanted = [*yester.denoise(bare)]
    with pytest.warns(UserWarning, match="later frames are not used"):
        planned = [*yester.denoise(given, yester.Plan(without=without).pipeline())]
    for got, want in zip(planned, wanted, strict=True):
        assert_same_bits(got.color, want.color)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (lambda: frames(4), "expected at least 5 frames to judge by, got 4"),
        (lambda: [], "expected at least 5 frames to judge by, got 0"),
        (lambda: [yester.Frame(frame.color) for frame in frames()], "neither depth nor normals nor ids"),
        (lambda: frames(light=lambda t: np.nan), "no frame has finite samples"),
        (lambda: frames(light=lambda t: 1e20), "values too large to judge"),
        (
            lambda: frames(normal=np.full((64, 96, 3), np.nan), depth=np.full((64, 96), np.nan)),
            "no pixel is found again in the next frame",
        ),
        (lambda: frames(light=lambda t: 0), "nothing changes from frame to frame"),
        (lambda: frames(moving=False, color=np.full((64, 96, 3), 0.5)), "nothing changes from frame to frame"),
        (lambda: one_seed(), "frames have the noise of the frame before"),
        (lambda: [frame for frame in frames(4, moving=False) for _ in range(2)], "frames have the noise of the frame"),
    ],
    ids=["few", "none", "no guides", "NaN", "huge", "unknown surfaces", "black", "constant", "one seed", "twice"],
)
def test_nothing_to_judge_by(given, reason):
    """The plan says so and is the default."""
    with pytest.warns(UserWarning, match=f"plan: {reason}") as said:
        found = yester.plan(given())
    assert [warning.filename for warning in said] == [__file__]
    assert reason in found.reason
    assert reason in str(found)
    assert (found.options, found.without, found.stages, found.static) == ({}, (), (), False)
    shown = frames(2)
    default = replace(found, buffers=())
    images = [[pipeline.step(frame).color for frame in shown] for pipeline in (default.pipeline(), yester.SVGF())]
    assert_same_bits(images[0][-1], images[1][-1])


def test_some_frames_of_nan(moving):
    """Such frames do not count; the others are compared."""
    holes = [*moving]
    holes[4] = yester.Frame(
        **moving[4].buffers() | {"color": np.full_like(moving[4].color, np.nan)}, camera=moving[4].camera
    )
    found = yester.plan(holes)
    assert found.reason == ""
    assert all(np.isfinite(stage.loss) for stage in found.stages)


@pytest.mark.parametrize("given", [{"without": ("color",)}, {"without": "ids"}, {"buffers": ("colour",)}])
def test_plans_name_buffers(given, tmp_path):
    (name,) = given
    with pytest.raises(ValueError, match=f"^{name}: expected names of buffers, got"):
        yester.Plan(**given)
    with pytest.raises(TypeError, match=r"^plan: expected yester\.Plan, got int"):
        yester.Planned(3)
    with pytest.raises(TypeError, match=r"^frame: expected a yester\.Frame, got NoneType"):
        yester.Planned(yester.Plan()).step(None)
    assert repr(yester.Planned(yester.Plan())).startswith("Planned(Plan(")


def test_bad_input(moving):
    with pytest.raises(ValueError, match="count: expected at least 5, got 4"):
        yester.plan(moving, count=4)
    with pytest.raises(TypeError, match="count: expected an integer, got float"):
        yester.plan(moving, count=5.5)
    with pytest.raises(TypeError, match=r"frames: expected yester\.Frame, got ndarray at 1"):
        yester.plan([moving[0], moving[1].color])
    with pytest.raises(
        ValueError, match=r"frames: expected height 64 and width 96, .* got height 32 and width 48 at 8"
    ):
        yester.plan([*moving, *frames(1, size=(48, 32))], count=9)


def test_windows():
    """Windows of large images are disjoint and inside; each has a camera with the same rays as the whole image's."""
    assert _windows(64, 96) == [(slice(0, 64), slice(0, 96))]
    for height, width in ((720, 1280), (2160, 3840), (60, 8000), (5000, 40)):
        found = _windows(height, width)
        assert len(found) == 4
        seen = np.zeros((height, width), int)
        for part in found:
            seen[part] += 1
        assert seen.max() == 1
        assert seen.sum() <= 4 * 96 * 128
    frame = frames(1, size=(64, 48))[0]
    part = _cropped(frame, slice(10, 40), slice(30, 62))
    assert part.shape == (30, 32)
    assert_same_bits(part.depth, frame.depth[10:40, 30:62])
    pixels = np.random.default_rng(0).uniform(0, 30, (20, 2))
    want = frame.camera.unproject(pixels + np.array([30, 10]), np.full(20, 3.0))
    np.testing.assert_allclose(part.camera.unproject(pixels, np.full(20, 3.0)), want, rtol=1e-9)


def test_large_images_are_judged_by_parts():
    """Also where some windows have no valid samples, here sky in the first."""

    def sky(rng, shot):
        color = flight.noisy(shot, rng)
        color[:150, :256] = np.nan
        return color

    found = yester.plan(frames(6, size=(512, 300), color=sky))
    assert len(found.stages) == 11
    assert all(np.isfinite(stage.loss) for stage in found.stages)


# Shots


def behind(still):
    """A still shot of the same place, from above."""
    above = yester.Camera.from_look_at([0, 9, 0.1], [0, 0, 0], [0, 1, 0], 55, *SIZE)
    seen = flight.sample(flight.scene(0, above))
    rng = np.random.default_rng(1)
    return [replace(seen, color=flight.noisy(seen, rng), motion=frame.motion) for frame in still]


def lengths(sequence):
    return [len([*shot]) for shot in yester.split_at_cuts(sequence)]


def test_shots(moving, still):
    """A cut is found by guides; one shot stays whole, also where a buffer is broken."""
    assert lengths([]) == []
    assert lengths(moving[:1]) == [1]
    assert lengths(moving) == [8]
    other = behind(still)
    assert lengths([*moving, *other, *moving[:3]]) == [8, 8, 3]
    # Every other frame is of another shot: none is known to begin one.
    assert lengths([one for pair in zip(moving, other, strict=True) for one in pair]) == [16]
    rng = np.random.default_rng(0)
    broken = [replace(one, ids=rng.integers(1, 2**31, one.shape, dtype=np.uint32)) for one in moving]
    assert lengths(broken) == [8]
    alone = [yester.Frame(one.color) for one in (*moving, *other)]
    assert lengths(alone) == [16]
    away = [yester.Frame(one.color, motion=np.full((*one.shape, 2), 200.0 * (i == 3))) for i, one in enumerate(moving)]
    assert lengths(away) == [8], "nothing tells that these pixels show other surfaces than before"
    shots = yester.split_at_cuts([*moving, *other])
    first, second = next(shots), next(shots)
    assert [*first] == []
    assert next(second) is other[0]


def test_shots_by_counting(still):
    """Less than a quarter of what was found before is a cut; nothing is told where less than a tenth was found."""

    def shown(share):
        found = np.zeros(SIZE[::-1], np.float32)
        found.flat[: round(share * found.size)] = 1
        return found

    def sequence(*shares):
        zeros = np.zeros((*SIZE[::-1], 2), np.float32)
        # Of every frame, the part that is asked for has the ids of the frame before.
        ids, result = np.ones(SIZE[::-1], int), [yester.Frame(still[0].color, ids=np.ones(SIZE[::-1], int))]
        for number, share in enumerate(shares, 2):
            ids = np.where(shown(share) > 0, ids, number)
            result.append(yester.Frame(still[0].color, ids=ids, motion=zeros))
        return result

    assert lengths(sequence(0.8, 0.21, 0.8)) == [4]
    assert lengths(sequence(0.8, 0.19, 0.8)) == [2, 2]
    assert lengths(sequence(0.11, 0.02)) == [2, 1]
    assert lengths(sequence(0.09, 0.0)) == [3]


def test_shots_of_what_is_no_frame(moving):
    with pytest.raises(TypeError, match=r"frames: expected yester\.Frame, got ndarray at 1"):
        lengths([moving[0], moving[1].color])
    with pytest.raises(
        ValueError, match=r"frames: expected height 64 and width 96, .* got height 32 and width 48 at 1"
    ):
        lengths([moving[0], *frames(1, size=(48, 32))])


# The command line


@pytest.fixture(scope="module")
def folder(tmp_path_factory, still):
    place = tmp_path_factory.mktemp("frames")
    for i, frame in enumerate(still):
        write_exr(place / f"frame_{i:04}.exr", frame)
    return place


@pytest.mark.slow
def test_commands(folder, tmp_path):
    """The plan is printed and written; `denoise` reads it, or makes its own."""
    path = tmp_path / "plan.toml"
    result = run("plan", folder, "-o", path)
    assert result.stdout.splitlines()[0] == yester.Plan.load(path).summary()
    assert "forgetting   left out" in result.stdout
    run("denoise", folder, "-o", tmp_path / "planned", "--plan", path)
    said = run("denoise", folder, "-o", tmp_path / "auto").stderr
    assert f"plan: {yester.Plan.load(path).summary()}" in said.splitlines()
    paths = [folder / f"frame_{i:04}.exr" for i in range(8)]
    wanted = yester.denoise(map(read_exr, paths), yester.Plan.load(path).pipeline())
    for frame, want in zip(paths, wanted, strict=True):
        for place in ("planned", "auto"):
            assert_same_bits(read_exr(tmp_path / place / frame.name).color, want.color)


@pytest.mark.slow
def test_a_cut_has_another_plan(moving, still, tmp_path):
    """History starts anew behind it; only the shot that stands still averages all samples."""
    (tmp_path / "film").mkdir()
    shots = moving, behind(still)
    for number, frame in enumerate(chain(*shots)):
        write_exr(tmp_path / "film" / f"{number}.exr", frame)
    said = run("denoise", tmp_path / "film", "-o", tmp_path / "out").stderr.splitlines()
    found = [yester.plan(shot) for shot in shots]
    assert [one.static for one in found] == [False, True]
    assert f"plan: {found[0].summary()}" in said
    assert f"plan, behind a cut after 8 frames: {found[1].summary()}" in said
    read = [read_exr(tmp_path / "film" / f"{number}.exr") for number in range(16)]
    parts = zip(found, (read[:8], read[8:]), strict=True)
    wanted = chain(*(yester.denoise(part, one.pipeline()) for one, part in parts))
    for number, want in enumerate(wanted):
        assert_same_bits(read_exr(tmp_path / "out" / f"{number}.exr").color, want.color)
    assert run("plan", tmp_path / "film").stdout.splitlines()[0] == found[0].summary()


@pytest.mark.slow
def test_a_frame_that_lacks_a_buffer(still, tmp_path):
    """It is denoised without, and the others with it."""
    (tmp_path / "frames").mkdir()
    frames = [replace(frame, ids=None) if number == 1 else frame for number, frame in enumerate(still)]
    for number, frame in enumerate(frames):
        write_exr(tmp_path / "frames" / f"{number}.exr", frame)
    run("denoise", tmp_path / "frames", "-o", tmp_path / "out")
    assert len([*(tmp_path / "out").iterdir()]) == len(frames)


@pytest.mark.slow
def test_commands_refuse(folder, tmp_path):
    assert "--plan: expected no --method" in refused(
        "denoise", folder, "-o", tmp_path / "out", "--plan", tmp_path / "x.toml", "--method", "taa"
    )
    assert "--alpha: expected --method svgf" in refused(
        "denoise", folder, "-o", tmp_path / "out", "--method", "auto", "--alpha", "0.1"
    )
    frame = folder / "frame_0000.exr"
    kept = frame.read_bytes()
    assert f"{frame}: the plan would overwrite this input" in refused("plan", folder, "-o", frame)
    assert frame.read_bytes() == kept
    assert "x.toml" in refused("denoise", folder, "-o", tmp_path / "out", "--plan", tmp_path / "x.toml")
    (tmp_path / "bad.toml").write_text("version = 7")
    assert "version: expected 1, got 7" in refused(
        "denoise", folder, "-o", tmp_path / "out", "--plan", tmp_path / "bad.toml"
    )


@pytest.mark.slow
def test_a_plan_for_other_files(still, tmp_path):
    """The second file of every shot is compared before anything is written; later ones may lack a buffer."""
    yester.Plan(buffers=("color", "albedo", "normal", "depth", "motion", "position", "camera", "ids")).save(
        tmp_path / "plan.toml"
    )
    (tmp_path / "in").mkdir()
    given = "denoise", tmp_path / "in", "-o", tmp_path / "out", "--plan", tmp_path / "plan.toml"
    for shot in "ab":
        for number in range(3):
            bare = {"ids": None} if number == 2 else {}
            write_exr(tmp_path / "in" / f"{shot}{number}.exr", replace(still[number], **bare))
    run(*given)
    assert len([*(tmp_path / "out").iterdir()]) == 6
    second = tmp_path / "in" / "b1.exr"
    for name, changes in (("ids", {"ids": None}), ("emission", {"emission": np.zeros_like(still[1].color)})):
        write_exr(second, replace(still[1], **changes))
        said = refused(*given[:3], tmp_path / "none", *given[4:])
        assert f"{second}: {name}: expected the buffers of the plan, color, albedo," in said
        assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_a_plan_of_buffers_that_pixels_deny(tmp_path):
    """Blender's indices, if all are 0, are in the headers alone."""
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(1, 7):
        shot = layouts.frame(number)
        layouts.cycles(frames / f"{number}.exr", replace(shot, ids=0 * shot.ids), denoising=False, crypto=False)
    run("plan", frames, "-o", tmp_path / "plan.toml")
    found = yester.Plan.load(tmp_path / "plan.toml")
    assert found.reason == ""
    assert {*describe(frames / "2.exr").channels} - {*found.buffers} == {"ids"}
    run("denoise", frames, "-o", tmp_path / "out", "--plan", tmp_path / "plan.toml")


@pytest.mark.slow
def test_a_single_file_is_denoised_by_default(folder, tmp_path):
    """The message says why."""
    said = run("denoise", folder / "frame_0000.exr", "-o", tmp_path / "one.exr").stderr
    assert "plan: the default: expected at least 5 frames to judge by, got 1" in said
    assert "Warning" not in said
    want = yester.SVGF().step(read_exr(folder / "frame_0000.exr")).color
    assert_same_bits(read_exr(tmp_path / "one.exr").color, want)
