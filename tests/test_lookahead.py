"""Sequences denoised in both directions: two histories that join before the filter, or the average of two runs."""

import copy
import pickle
import warnings
from dataclasses import replace
from itertools import cycle, islice, pairwise
from types import SimpleNamespace

import composed
import numpy as np
import pytest
import yester
from compare import assert_close, assert_same_bits
from yester import Frame
from yester.metrics import relmse

NAMES = ("color", "variance", "choice", "history_length", "confidence", "rejection")
#: Pipelines that join histories, with their compositions of public kernels.
JOINING = {
    "svgf": (yester.SVGF, composed.SVGF, {}),
    "textbook": (
        yester.SVGF,
        composed.SVGF,
        {"choice": False, "innovation": False, "gradient": False, "reflections": (), "antialias": False},
    ),
    "feedback": (yester.SVGF, composed.SVGF, {"feedback": True, "alpha": 0.1, "fireflies": True}),
    "half res": (yester.HalfRes, composed.HalfRes, {}),
    "half res, choice": (yester.HalfRes, composed.HalfRes, {"choice": True, "antialias": False}),
}
#: Pipelines whose two results are averaged.
AVERAGED = {
    "bmfr": yester.BMFR,
    "taa": yester.TAA,
    "recirculation": yester.Recirculation,
    "upscaler": lambda: yester.Upscaler(1.5),
    "oidn": lambda: yester.OIDN("fast", temporal=True),
}


def frames(count, **named) -> list[Frame]:
    return [Frame(**buffers) for buffers in composed.sequence(count, **named)]


def still(count) -> list[Frame]:
    """Frames of a static scene, with motion from the cameras alone."""
    names = ("motion", "replay", "jitter", "object_normal")  # these object normals turn from frame to frame
    return [without(frame, *names) for frame in frames(count, moving=False)]


def without(frame: Frame, *names: str) -> Frame:
    kept = {name: buffer for name, buffer in frame.buffers().items() if name not in names}
    others = {name: getattr(frame, name) for name in ("camera", "jitter") if name not in names}
    return Frame(**kept, **others)


def same(got, want, names=NAMES):
    for name in names:
        one, other = getattr(got, name), getattr(want, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert_same_bits(one, other)


def turned(given: list[Frame]) -> list[Frame]:
    """The reversed sequence, the last frame first: each with its motion to the next frame."""
    frames, following = [], None
    for frame in reversed(given):
        motion = None
        if following is not None:
            there = yester.motion_vectors(frame.position, frame.camera, following.camera)
            motion = there if following.motion is None else None
            if motion is None:
                motion = yester.invert_motion(following.motion, following.depth, still=there)
        buffers = without(frame, "motion", "replay").buffers()
        frames.append(Frame(**buffers, motion=motion, camera=frame.camera, jitter=frame.jitter))
        following = frame
    return frames


def backwards(given: list[Frame], look) -> list:
    """The backward pass over one chunk, by hand: from the last frame, without history, to the first."""
    return [look(frame) for frame in turned(given)][::-1]


def averaged(given: list[Frame], pipeline) -> list:
    back = copy.copy(pipeline)
    later = backwards(given, back.step)
    return [average(pipeline.step(frame), other, frame.color) for frame, other in zip(given, later, strict=True)]


def joined(given: list[Frame], forward, back) -> list:
    """For pipelines without output stage: each frame joined with the history of the later ones."""
    *later, _ = backwards(given, back.recall)
    return [join(forward, frame, other) for frame, other in zip(given, [*later, None], strict=True)]


def join(forward, frame: Frame, other):
    """One frame of these, with the confidence of each side and what is known of both."""
    output = forward.step(frame, later=other)
    output.motion_next = None if other is None else other.motion
    output.earlier = output.later = output.confidence
    if other is not None:
        output.later = other.confidence
        output.confidence = np.maximum(output.confidence, other.confidence)
        output.rejection = output.rejection & other.rejection
    return output


def forward(output, frame: Frame):
    """The motion that an output stage follows."""
    return frame.motion if output.motion is None else output.motion


def finish(stage: yester.TAA, output, frame: Frame, motion, confidence=None):
    """The output stage on a denoised frame, with the confidence of the side from which it runs."""
    kept = "depth", "position", "normal", "ids", "albedo", "emission", "camera", "jitter"
    places = {name: getattr(frame, name) for name in kept}
    known = {"samples": frame.color, "confidence": output.confidence if confidence is None else confidence}
    return stage.step(Frame(output.color, motion=motion, **places), **known)


def average(one, other, samples) -> SimpleNamespace:
    """Average weighted by history length; a side that knows only this frame does not count."""
    if not (one.confidence.any() and other.confidence.any()):
        return one if one.confidence.any() or not other.confidence.any() else other
    ahead, behind = one.history_length, other.history_length
    total = ahead + behind
    with np.errstate(invalid="ignore"):
        share = np.where(total > 0, ahead / total, np.float32(0.5))
    shared = np.isfinite(samples).all(-1) if samples.shape == one.color.shape else 1
    return SimpleNamespace(
        color=yester.blend(one.color, other.color, share),
        variance=None if one.variance is None else share**2 * one.variance + (1 - share) ** 2 * other.variance,
        choice=None if one.choice is None else other.choice + share * (one.choice - other.choice),
        history_length=np.maximum(total - shared, np.maximum(ahead, behind)).astype(np.float32),
        confidence=np.maximum(one.confidence, other.confidence),
        rejection=one.rejection & other.rejection,
    )


def pipelines() -> dict:
    return {name: lambda make=make, named=named: make(**named) for name, (make, _, named) in JOINING.items()} | AVERAGED


@pytest.mark.parametrize("name", pipelines())
def test_zero_is_the_pipeline(name):
    given, make = frames(4), pipelines()[name]
    pipeline = make()
    for got, frame in zip(yester.denoise(given, make(), 0), given, strict=True):
        same(got, pipeline.step(frame))


@pytest.mark.parametrize("name", AVERAGED)
def test_it_is_the_average_of_both_directions(name):
    given, make = frames(5), AVERAGED[name]
    for got, want in zip(yester.denoise(given, make()), averaged(given, make()), strict=True):
        same(got, want)


def test_a_sample_counts_once():
    """Where there is one; of an upscaler, no pixel has fewer than from one side."""
    color, lost = np.ones((12, 16, 3), np.float32), np.arange(16) == 5
    given = [Frame(color, motion=np.zeros((12, 16, 2)))] * 3
    given[1] = replace(given[1], color=np.where(lost[:, None], np.nan, color))
    for output in yester.denoise(given, yester.TAA()):
        np.testing.assert_array_equal(output.history_length, np.broadcast_to(3 - lost, (12, 16)))
    upscaler = yester.Upscaler(2.0)
    for output, frame in zip(yester.denoise(given, upscaler), given, strict=True):
        assert (output.history_length >= upscaler.step(frame).history_length).all()


@pytest.mark.parametrize("pipeline", [yester.SVGF(), yester.SVGF(antialias=False), yester.BMFR()], ids=repr)
def test_buffers_that_only_later_frames_use_are_told(pipeline):
    """The first frame has no earlier camera from which motion would be computed."""
    first, *_ = yester.denoise(still(3), pipeline)
    assert "camera" in first.used
    assert len({*first.used}) == len(first.used)


@pytest.mark.parametrize("name", JOINING)
def test_histories_join_before_the_filter(name):
    """Bit for bit as the public kernels; then the output stage runs in both directions."""
    make, compose, named = JOINING[name]
    given, bare = frames(6), {**named, "antialias": False}
    want = joined(given, compose(**bare), compose(**bare))
    if named.get("antialias", True):
        _, stage = make(**named).split(both_sides=True)
        back = copy.copy(stage)
        finished = [
            average(one, other, frame.color)
            for one, other, frame in zip(
                [
                    finish(stage, output, frame, forward(output, frame), output.earlier)
                    for output, frame in zip(want, given, strict=True)
                ],
                [
                    finish(
                        back,
                        output,
                        frame,
                        frame.motion if output.motion_next is None else output.motion_next,
                        output.later,
                    )
                    for output, frame in zip(want[::-1], turned(given), strict=True)
                ][::-1],
                given,
                strict=True,
            )
        ]
        for output, image in zip(want, finished, strict=True):
            output.color = image.color
    for got, its in zip(yester.denoise(given, make(**named)), want, strict=True):
        same(got, its)


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("innovation", [False, True])
@pytest.mark.parametrize("name", ["svgf", "half res"])
def test_the_parts_of_a_pipeline_are_the_pipeline(name, innovation, guided):
    make, _, named = JOINING[name]
    pipeline = make(**named | {"innovation": innovation})
    denoiser, stage = pipeline.split()
    assert repr(denoiser) == repr(make(**named | {"innovation": innovation, "antialias": False}))
    assert denoiser.split()[1] is None
    both = pipeline.split(both_sides=True)[1]
    assert repr(both) == repr(stage).replace(", unguided_alpha=0.5", "")
    for frame in frames(4):
        if not guided:
            frame = yester.Frame(frame.color, motion=frame.motion)
        output, want = denoiser.step(frame), pipeline.step(frame)
        assert_same_bits(finish(stage, output, frame, forward(output, frame)).color, want.color)


def test_the_pipeline_is_svgf_and_stays_as_it_is():
    given = frames(3)
    pipeline, other = yester.SVGF(), yester.SVGF()
    for got, want in zip(yester.denoise(given), yester.denoise(given, pipeline), strict=True):
        same(got, want)
    for frame in given:
        same(pipeline.step(frame), other.step(frame))


def test_recalling_goes_on_as_a_step_does():
    """`recall` returns the history that `step` would merge; the next frame goes on alike from either."""
    given = frames(5)
    pipeline, other = (yester.SVGF(choice=False, antialias=False) for _ in range(2))
    for frame in given:
        expected, output = pipeline.recall(frame), other.step(frame)
        assert_same_bits(expected.confidence, output.confidence)
        assert_same_bits(expected.rejection, output.rejection)
        assert expected.used == output.used
    assert not np.isnan(expected.color).all()
    assert expected.history_length.max() > 3
    same(pipeline.step(given[4]), other.step(given[4]))


def test_a_history_can_be_anybodys():
    """A history that is the reference, with a length of a million samples, gives the reference."""
    frame = yester.Frame(np.random.default_rng(0).exponential(1, (20, 30, 3)).astype(np.float32))
    truth = np.full((20, 30, 3), 0.5, np.float32)
    moments = np.dstack([truth[..., 0], truth[..., 0] ** 2])
    sure, nothing = np.ones((20, 30), np.float32), np.zeros((20, 30), np.uint8)
    known = yester.History(truth, moments, 1e6 * sure, sure, nothing, used=["motion"])
    assert known.used == ("motion",)
    svgf = yester.SVGF(alpha=0.0, antialias=False)
    output = svgf.step(frame, later=known)
    np.testing.assert_allclose(output.color, truth, rtol=1e-5)
    assert_same_bits(output.history_length, 1e6 * sure + 1)
    # It is not passed on to the next frame.
    assert svgf.step(frame).history_length.max() == 2
    for copied in (copy.copy(known), pickle.loads(pickle.dumps(known))):
        assert_same_bits(copied.color, known.color)
        assert copied.used == known.used


def test_histories_of_another_shape_are_refused():
    flat, color = np.ones((4, 5), np.float32), np.ones((4, 5, 3), np.float32)
    given = {"color": color, "moments": color[..., :2], "history_length": flat, "confidence": flat}
    given["rejection"] = flat.astype(np.uint8)
    for name in given:
        with pytest.raises(ValueError, match=rf"^{name}: expected"):
            yester.History(**given | {name: given[name][:, :-1] if name != "color" else color[..., :2]})
    with pytest.raises(ValueError, match=r"^rejection: expected whole numbers .* 0 to 255.* got 256"):
        yester.History(**given | {"rejection": np.full((4, 5), 256)})
    svgf, small = yester.SVGF(), yester.History(**given)
    with pytest.raises(ValueError, match=r"^later: expected height 20 and width 30"):
        svgf.step(yester.Frame(np.ones((20, 30, 3), np.float32)), later=small)


def test_histories_of_other_light_are_refused():
    """Light is divided by albedo if there is one."""
    color, albedo = np.full((8, 9, 3), 0.5, np.float32), np.full((8, 9, 3), 0.25, np.float32)
    bare, textured = yester.Frame(color, depth=color[..., 0]), yester.Frame(color, albedo=albedo)
    for frame, other, expected in ((textured, bare, "with albedo"), (bare, textured, "without albedo")):
        svgf, later = yester.SVGF(), yester.SVGF().recall(other)
        with pytest.raises(ValueError, match=f"^later: expected a history of frames {expected}, as the frame"):
            svgf.step(frame, later=later)
        np.testing.assert_allclose(svgf.step(frame, later=yester.SVGF().recall(frame)).color, 0.5, rtol=1e-5)


def test_chunks_begin_behind_their_end():
    """With a lookahead of 1, chunks are of five frames, processed from the sixth to the first."""
    given = still(12)
    forward, named = composed.SVGF(antialias=False), {"antialias": False}
    want = []
    for first in range(0, 12, 5):
        back, window = composed.SVGF(**named), given[first : first + 6]
        *later, _ = backwards(window, back.recall)
        chunk = zip(window[:5], [*later, None], strict=False)
        want += [join(forward, *each) for each in chunk]
    for got, its in zip(yester.denoise(given, yester.SVGF(**named), 1), want, strict=True):
        same(got, its)


@pytest.mark.parametrize("count", [0, 1, 2, 5, 6, 7, 11, 12])
def test_any_number_of_frames(count):
    given = still(12)[:count]
    taken = []

    def source():
        for number, frame in enumerate(given):
            taken.append(number)
            yield frame

    for number, output in enumerate(yester.denoise(source(), lookahead=1)):
        assert output.color.shape == given[number].color.shape
        # No more frames are held than documented: each of two stages has its own chunks.
        assert len(taken) <= (number // 5 + 2) * 5 + 2
    assert len(taken) == count


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.BMFR])
def test_the_reversed_sequence_has_the_reversed_result(pipeline):
    """Without the components that keep state in one direction.

    Choice, innovation and reflections compare light of both sides, and pass their findings on forward in time; the
    gradient raises the sample's weight relative to the forward history.
    """
    given, named = still(6), {}
    if pipeline is yester.SVGF:
        named = dict.fromkeys(("innovation", "choice", "gradient"), False) | {"reflections": ()}
    there = [output.color for output in yester.denoise(given, pipeline(**named))]
    back = [output.color for output in yester.denoise(given[::-1], pipeline(**named))][::-1]
    for one, other in zip(there, back, strict=True):
        assert_close("reversed", one, other, rtol=1e-4)


def test_the_reversed_sequence_is_as_good():
    """With everything on, the two results differ by far less than from the reference."""
    given = still(12)
    truth = composed.supersampled(given[0].camera)
    there = [output.color for output in yester.denoise(given)]
    back = [output.color for output in yester.denoise(given[::-1])][::-1]
    apart = np.mean([(one - other) ** 2 for one, other in zip(there, back, strict=True)])
    assert apart < 0.1 * np.mean([(one - truth) ** 2 for one in there])


def test_the_mean_of_a_still_scene_is_as_good_as_one_sided():
    """The output stage does not take the noise that a mean keeps for detail.

    Measured: 1.2 times the error of `step`; with an output stage in all frames, 5.6 times.
    """
    rng, camera = np.random.default_rng(1), still(1)[0].camera
    given = []
    for offset in rng.uniform(-0.5, 0.5, (48, 2)):
        buffers = composed.sample(camera, tuple(offset))
        buffers["color"] = buffers["color"] * rng.gamma(1, 1, (*buffers["depth"].shape, 1))
        given.append(without(Frame(**buffers), "motion"))
    pipeline, truth = yester.SVGF(average_still=True), composed.supersampled(camera)
    both, one = (
        np.mean([relmse(output.color, truth) for output in outputs][32:])
        for outputs in (yester.denoise(given, pipeline), map(pipeline.step, given))
    )
    assert both < 1.5 * one


@pytest.mark.parametrize("light", [1000, 10_000])
def test_each_side_holds_the_fireflies_of_the_other(light):
    """One-sided, they stay in the frames after them; both sides had them before. The output stage holds the rest."""
    given = still(12)
    truth, color = composed.supersampled(given[0].camera), given[6].color.copy()
    color[[10, 20, 30], [15, 40, 30]] = light
    given[6] = Frame(**given[6].buffers() | {"color": color}, camera=given[6].camera)
    pipeline = yester.SVGF(antialias=False)
    both = [output.color for output in yester.denoise(given, pipeline)]
    one = [pipeline.step(frame).color for frame in given]
    errors = [np.mean([(image - truth) ** 2 for image in images[3:10]]) for images in (both, one)]
    assert errors[0] < 0.5 * errors[1]
    both = [output.color for output in yester.denoise(given)]
    # In all frames but its own, nothing is left that anyone would take for a firefly.
    assert max(image.max() for number, image in enumerate(both) if number != 6) < 0.1 * light


def test_disocclusions_use_later_frames():
    """A cut to another view: earlier frames have no history for the frame after it, later ones do."""
    given = still(8)
    away = yester.Camera(given[0].camera.world_to_clip @ np.diag([1.0, 1, -1, 1]), 61, 43)
    given = [Frame(**frame.buffers(), camera=away) if i < 3 else frame for i, frame in enumerate(given)]
    pipeline, outputs = yester.SVGF(), list(yester.denoise(given))
    for frame in given[:4]:
        alone = pipeline.step(frame)
    new = alone.confidence == 0
    assert new.mean() > 0.5
    assert (outputs[3].history_length[new] >= 4).mean() > 0.8


def test_given_motion_to_the_next_frame_is_used():
    """Instead of computed motion: here motion out of the image, so that later frames contribute nothing."""
    given = still(4)
    away = np.full((*given[0].shape, 2), 1e4, np.float32)
    told = [Frame(**frame.buffers(), motion_next=away, camera=frame.camera) for frame in given]
    lengths = [np.mean([output.history_length.mean() for output in yester.denoise(each)]) for each in (given, told)]
    assert lengths[0] > lengths[1] + 1


def knowing_next(count) -> list[Frame]:
    given = frames(count, holes=False)
    given[:-1] = [
        replace(frame, motion_next=yester.invert_motion(following.motion, following.depth))
        for frame, following in pairwise(given)
    ]
    return given


@pytest.mark.parametrize("pipeline", [yester.SVGF(), yester.TAA()], ids=["SVGF", "TAA"])
def test_motion_to_the_next_frame_is_enough(pipeline):
    """Of a sequence without cameras. If it seems wrong, that is said once, and frames have no motion."""
    given = [replace(frame, camera=None) for frame in knowing_next(8)]
    alone = [replace(frame, motion=None) for frame in given]
    derived = [
        alone[0],
        *(
            replace(frame, motion=yester.invert_motion(before.motion_next, before.depth))
            for before, frame in pairwise(alone)
        ),
    ]
    for got, want in zip(yester.denoise(alone, pipeline), yester.denoise(derived, pipeline), strict=True):
        same(got, want)
    alone[:-1] = [replace(frame, motion_next=-frame.motion_next) for frame in alone[:-1]]
    with pytest.warns(UserWarning, match="^motion_next: expected next minus") as caught:
        list(yester.denoise(alone, pipeline))
    assert len(caught) == 1


@pytest.mark.parametrize("pipeline", [yester.SVGF(), yester.TAA()], ids=["SVGF", "TAA"])
@pytest.mark.parametrize("wrong", ["motion", "motion_next"])
def test_wrong_motion_is_named_once(pipeline, wrong):
    """Over several chunks, by which of the two it is."""
    given = knowing_next(12)
    given[:-1] = [replace(frame, **{wrong: -getattr(frame, wrong)}) for frame in given[:-1]]
    with pytest.warns(UserWarning, match="motion") as caught:
        list(yester.denoise(given, pipeline, lookahead=1))
    assert [str(each.message).split(" minus")[0] for each in caught] == [
        "motion: expected previous" if wrong == "motion" else "motion_next: expected next"
    ]


@pytest.mark.parametrize("pipeline", [yester.SVGF(), yester.TAA()], ids=["SVGF", "TAA"])
def test_filters_of_warnings_stay(pipeline, monkeypatch):
    """They belong to all threads: two that change them in turn would leave them changed."""
    with monkeypatch.context() as patch:
        patch.setattr(warnings, "catch_warnings", None)
        assert len([*yester.denoise(knowing_next(8), pipeline, lookahead=1)]) == 8


@pytest.mark.parametrize("place", range(1, 6))
def test_a_cut_separates_both_sides(place):
    """Each side of a cut is denoised as if alone."""
    first, second = still(place), [without(frame, "ids") for frame in still(6)[place:]]
    turned = [
        Frame(**{name: np.ascontiguousarray(buffer[:, ::-1]) for name, buffer in frame.buffers().items()})
        for frame in second
    ]
    far = np.full((*turned[0].shape, 2), 1e4, np.float32)
    turned[0] = Frame(**turned[0].buffers(), motion=far)
    turned[1:] = [Frame(**frame.buffers(), motion=0 * far) for frame in turned[1:]]
    whole = list(yester.denoise([*first, *turned], yester.SVGF(antialias=False, innovation=False, choice=False)))
    parts = [
        *yester.denoise(first, yester.SVGF(antialias=False, innovation=False, choice=False)),
        *yester.denoise(turned, yester.SVGF(antialias=False, innovation=False, choice=False)),
    ]
    for one, other in zip(whole, parts, strict=True):
        same(one, other, ("history_length",))


def test_the_output_stage_trusts_no_other_shot():
    """Measured: near a cut, results are within 0.006 of those of separate shots; with trust, within 0.016."""
    motion = np.zeros((*still(1)[0].shape, 2))
    given = [Frame(**without(frame, "camera", "hit_distance").buffers(), motion=motion) for frame in still(12)]
    turned = [
        Frame(**{name: np.ascontiguousarray(buffer[::-1, ::-1]) for name, buffer in frame.buffers().items()})
        for frame in given
    ]
    whole = [*yester.denoise([*given[:6], *turned[6:]])]
    parts = [*yester.denoise(given[:6]), *yester.denoise(turned[6:])]
    apart = [np.abs(one.color - other.color) for one, other in zip(whole, parts, strict=True)]
    assert np.mean(apart[4:8]) < 0.01


@pytest.mark.parametrize("guides", [(), ("albedo",), ("depth", "normal", "ids")])
def test_without_motion_and_cameras_it_warns_once_and_goes_forward_only(guides):
    given = [yester.Frame(frame.color, **{name: getattr(frame, name) for name in guides}) for frame in frames(9)]
    pipeline = yester.SVGF()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        got = list(yester.denoise(given, lookahead=1))
    said = [str(each.message) for each in caught]
    assert sum("later frames are not used, as there are frames without motion" in each for each in said) == 1
    for output, frame in zip(got, given, strict=True):
        same(output, pipeline.step(frame))


@pytest.mark.parametrize(
    "pipeline", [None, yester.SVGF(antialias=False), yester.TAA()], ids=["SVGF", "no stage", "TAA"]
)
def test_the_warning_names_the_line_that_asks_for_results(pipeline):
    with pytest.warns(UserWarning, match="later frames are not used") as caught:
        list(yester.denoise([Frame(np.ones((4, 5, 3)))] * 3, pipeline))
    assert [warning.filename for warning in caught] == [__file__]


def test_frames_that_do_not_help_are_not_waited_for():
    """Nor held: a result comes as soon as it is known that no motion leads to its frame from the next one."""
    given = iter([without(frame, "motion", "camera", "jitter") for frame in frames(9)])
    with pytest.warns(UserWarning, match="later frames are not used"):
        next(yester.denoise(given))
    assert len([*given]) == 7


def test_a_frame_without_camera_separates_both_directions_only_there():
    given = still(6)
    given[2] = without(given[2], "camera")
    with pytest.warns(UserWarning, match="later frames are not used"):
        outputs = list(yester.denoise(given))
    alone = yester.SVGF()
    want = [alone.step(frame) for frame in given]
    same(outputs[2], want[2], ("history_length", "confidence", "rejection"))
    for number in (0, 3):
        assert outputs[number].history_length.mean() > want[number].history_length.mean() + 0.9


@pytest.mark.parametrize("lookahead", [2, 8, 100])
def test_a_lookahead_beyond_the_end(lookahead):
    """A short sequence is one chunk."""
    given = still(4)
    for got, want in zip(yester.denoise(given, lookahead=lookahead), yester.denoise(given), strict=True):
        same(got, want)


def test_bad_input():
    with pytest.raises(ValueError, match="lookahead: expected 0 or more frames, got -1"):
        yester.denoise([], lookahead=-1)
    with pytest.raises(TypeError):
        yester.denoise([], lookahead=1.5)
    with pytest.raises(TypeError, match=r"^pipeline: expected a pipeline, such as SVGF\(\), got its class"):
        yester.denoise([], yester.SVGF)
    with pytest.raises(TypeError, match=r"^pipeline: expected an object with a step, got int"):
        yester.denoise([], 5)
    small = Frame(np.ones((4, 5, 3), np.float32))
    with pytest.raises(
        TypeError, match=r"^frames: expected yester\.Frame, got ndarray at 1: pass yester\.Frame\(color\)"
    ):
        list(yester.denoise([small, small.color]))
    with pytest.raises(
        ValueError, match="frames: expected height 43 and width 61, as in earlier frames, got height 4 and width 5"
    ):
        list(yester.denoise([*frames(2), small]))


def test_frames_are_read_when_they_are_wanted():
    """No frame is read before the first result is requested, and an endless sequence gives results."""
    given = still(2)

    def endless():
        yield from cycle(given)

    assert len(list(islice(yester.denoise(endless(), lookahead=1), 7))) == 7
