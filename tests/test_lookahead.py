"""Sequences denoised from both sides: the average of two runs, in order, holding no more frames than it says."""

import copy
import warnings
from itertools import islice
from types import SimpleNamespace

import composed
import numpy as np
import pytest
import yester
from compare import assert_close, assert_same_bits
from yester import Frame

NAMES = ("color", "variance", "choice", "history_length", "confidence", "rejection")
PIPELINES = {
    "svgf": yester.SVGF,
    "textbook": lambda: yester.SVGF(choice=False, innovation=False, gradient=False, antialias=False),
    "bmfr": yester.BMFR,
    "half res": yester.HalfRes,
    "taa": yester.TAA,
    "recirculation": yester.Recirculation,
    "upscaler": lambda: yester.Upscaler(1.5),
    "oidn": lambda: yester.OIDN("fast", temporal=True),
}


def frames(count, **named) -> list[Frame]:
    return [Frame(**buffers) for buffers in composed.sequence(count, **named)]


def still(count) -> list[Frame]:
    """Frames of a scene at rest, whose motion the cameras alone tell."""
    names = ("motion", "replay", "jitter", "object_normal")  # object normals turn from frame to frame
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


def backwards(given: list[Frame], pipeline) -> list:
    """One chunk by hand: every frame with the motion to the one after it, from the last to the first."""
    results, following = [], None
    for frame in reversed(given):
        motion = None
        if following is not None:
            there = yester.motion_vectors(frame.position, frame.camera, following.camera)
            motion = there if following.motion is None else None
            if motion is None:
                motion = yester.invert_motion(following.motion, following.depth, still=there)
        buffers = without(frame, "motion", "replay").buffers()
        results.append(pipeline.step(Frame(**buffers, motion=motion, camera=frame.camera, jitter=frame.jitter)))
        following = frame
    return results[::-1]


def average(one, other) -> SimpleNamespace:
    """By history length; a side that knows the frame alone does not count."""
    if not (one.confidence.any() and other.confidence.any()):
        return one if one.confidence.any() or not other.confidence.any() else other
    ahead, behind = one.history_length, other.history_length
    total = ahead + behind
    with np.errstate(invalid="ignore"):
        share = np.where(total > 0, ahead / total, np.float32(0.5))
    return SimpleNamespace(
        color=yester.blend(one.color, other.color, share),
        variance=None if one.variance is None else share**2 * one.variance + (1 - share) ** 2 * other.variance,
        choice=None if one.choice is None else other.choice + share * (one.choice - other.choice),
        history_length=np.where((ahead > 0) & (behind > 0), total - 1, total),
        confidence=np.maximum(one.confidence, other.confidence),
        rejection=one.rejection & other.rejection,
    )


@pytest.mark.parametrize("name", PIPELINES)
def test_zero_is_the_pipeline(name):
    given, pipeline = frames(4), PIPELINES[name]()
    for got, frame in zip(yester.denoise(given, PIPELINES[name](), 0), given, strict=True):
        same(got, pipeline.step(frame))


@pytest.mark.parametrize("name", PIPELINES)
def test_it_is_the_average_of_both_directions(name):
    given, pipeline = frames(5), PIPELINES[name]()
    later = backwards(given, copy.copy(pipeline))
    for got, frame, other in zip(yester.denoise(given, PIPELINES[name]()), given, later, strict=True):
        same(got, average(pipeline.step(frame), other))


def test_the_pipeline_is_svgf_and_goes_on():
    given = frames(3)
    pipeline, other = yester.SVGF(), yester.SVGF()
    for got, want in zip(yester.denoise(given), yester.denoise(given, pipeline), strict=True):
        same(got, want)
    for frame in given:
        other.step(frame)
    (following,) = frames(4)[3:]
    same(pipeline.step(following), other.step(following))


def test_chunks_begin_behind_their_end():
    """With a lookahead of 1, five frames are worked on at a time, from the sixth to the first."""
    given, pipeline = still(12), yester.SVGF()
    later = []
    for first in range(0, 12, 5):
        later += backwards(given[first : first + 6], yester.SVGF())[: min(5, 12 - first)]
    for got, frame, other in zip(yester.denoise(given, lookahead=1), given, later, strict=True):
        same(got, average(pipeline.step(frame), other))


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
        # No more are held than it says.
        assert len(taken) <= (number // 5 + 1) * 5 + 1
    assert len(taken) == count


def test_the_reversed_sequence_has_the_reversed_result():
    given = still(6)
    there = [output.color for output in yester.denoise(given)]
    back = [output.color for output in yester.denoise(given[::-1])][::-1]
    for one, other in zip(there, back, strict=True):
        assert_close("reversed", one, other, rtol=1e-5)


def test_what_comes_into_view_is_known_from_later_on():
    """A cut to another view, seen from the frame behind it: the frames before know nothing."""
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
    """Instead of what can be computed: here, motion out of the image, so that nothing is known from later on."""
    given = still(4)
    away = np.full((*given[0].shape, 2), 1e4, np.float32)
    told = [Frame(**frame.buffers(), motion_next=away, camera=frame.camera) for frame in given]
    lengths = [np.mean([output.history_length.mean() for output in yester.denoise(each)]) for each in (given, told)]
    assert lengths[0] > lengths[1] + 1


def test_what_a_cut_separates_stays_apart():
    """Both sides of a cut are as if there were no other."""
    first, second = still(3), [without(frame, "ids") for frame in still(6)[3:]]
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


def test_without_motion_and_cameras_it_says_so_once_and_goes_forward_only():
    given = [without(frame, "motion", "camera", "jitter") for frame in frames(9)]
    pipeline = yester.SVGF()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        got = list(yester.denoise(given, lookahead=1))
    said = [str(each.message) for each in caught]
    assert sum("later frames are not used, as there are frames without motion" in each for each in said) == 1
    for output, frame in zip(got, given, strict=True):
        same(output, pipeline.step(frame))


def test_a_hole_in_what_is_known_ends_one_side_only_there():
    given = still(6)
    given[2] = without(given[2], "camera")
    with pytest.warns(UserWarning, match="later frames are not used"):
        outputs = list(yester.denoise(given))
    alone = yester.SVGF()
    want = [alone.step(frame) for frame in given]
    same(outputs[2], want[2])
    for number in (0, 3):
        assert outputs[number].history_length.mean() > want[number].history_length.mean() + 0.9


def test_bad_input():
    with pytest.raises(ValueError, match="lookahead: expected 0 or more frames, got -1"):
        yester.denoise([], lookahead=-1)
    with pytest.raises(TypeError):
        yester.denoise([], lookahead=1.5)
    small = Frame(np.ones((4, 5, 3), np.float32))
    with pytest.raises(
        ValueError, match="frames: expected height 43 and width 61, as in earlier frames, got height 4 and width 5"
    ):
        list(yester.denoise([*frames(2), small]))


def test_frames_are_read_when_they_are_wanted():
    """Nothing is taken before the first result is asked for, and an endless sequence gives results."""
    given = still(2)

    def endless():
        while True:
            yield given[0]

    assert len(list(islice(yester.denoise(endless(), lookahead=1), 7))) == 7
