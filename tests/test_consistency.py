import compare
import numpy as np
import pytest
import reference
import yester
from compare import BAND, SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from test_reproject import RAMP, SOFT, TESTS, surface, thresholds
from yester import Rejection


def check(motion, **named):
    rejection, confidence = yester.consistency(motion, **named)
    assert rejection.dtype == np.uint8
    assert confidence.dtype == np.float32
    want, want_confidence, margin, steepness = reference.consistency(
        tensor(motion), margin=True, **{k: tensor(v) for k, v in named.items()}
    )
    sure = margin.numpy() > BAND
    assert (~sure).sum() <= 2 + 0.005 * sure.size
    np.testing.assert_array_equal(rejection[sure], want.numpy()[sure])
    assert_close("consistency", confidence, want_confidence, where=sure, scale=1 + RAMP * steepness.numpy())
    assert not np.signbit(confidence).any()
    return rejection, confidence


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    motion=st.sampled_from([2, 3]),
    tests=st.sets(st.sampled_from(TESTS)),
    **thresholds,
)
def test_reference(seed, size, motion, tests, **thresholds):
    rng = np.random.default_rng(seed)
    motion = compare.motions(rng, *size, 3 if "plane" in tests else motion)
    check(motion, **surface(rng, *size, tests), **thresholds)


@each(("height", "width"), SIZES + TAILS)
def test_sizes(height, width):
    rng = np.random.default_rng(width)
    check(compare.motions(rng, height, width, 3), **surface(rng, height, width, ["plane", "ids"]))
    check(compare.motions(rng, height, width, 3), **surface(rng, height, width, TESTS), **SOFT)


def test_every_bit_occurs_and_does_not():
    rng = np.random.default_rng(0)
    motion = rng.normal(0, 2, (64, 64, 3)).astype(np.float32)
    rejection, confidence = check(motion, plane_distance=0.2, speed=2.5, **surface(rng, 64, 64, TESTS))
    for bit in Rejection:
        assert 0.02 < (rejection & bit != 0).mean() < 0.98
    assert ((rejection == 0) == (confidence > 1 - 1e-6)).all()


def test_the_bits_are_named():
    names = ["OUTSIDE", "DEPTH", "NORMAL", "ID", "VELOCITY", "LUMINANCE", "MOTION"]
    assert [(bit.name, int(bit)) for bit in Rejection] == [(name, 2**i) for i, name in enumerate(names)]


@pytest.mark.parametrize("softness", [{}, SOFT])
def test_confidence_is_the_coverage(softness):
    """Where the history is finite, confidence is the coverage that `reproject` reports without its fallback."""
    rng = np.random.default_rng(0)
    motion = compare.motions(rng, 30, 40, 3)
    named = surface(rng, 30, 40, [*TESTS[:3], *TESTS[4:]]) | softness
    _, confidence = yester.consistency(motion, **named)
    _, coverage = yester.reproject(np.ones((30, 40), np.float32), motion, fallback=False, **named)
    np.testing.assert_array_equal(np.where(confidence < 0.01, 0, confidence), coverage)


def test_identity_rejects_nothing():
    rejection, confidence = yester.consistency(np.zeros((5, 7, 2), np.float32))
    assert not rejection.any()
    assert (confidence == 1).all()


def test_outside_is_only_outside():
    motion = np.zeros((1, 4, 2), np.float32)
    motion[0, :, 0] = [-0.25, np.nan, 9, 0.25]
    ids = np.uint32([[1, 2, 3, 4]])
    rejection, confidence = yester.consistency(motion, ids=ids, previous_ids=ids)
    np.testing.assert_array_equal(rejection, [[1, 1, 1, 1]])
    np.testing.assert_array_equal(confidence, [[0.75, 0, 0, 0.75]])
    rejection, _ = yester.consistency(motion, ids=ids, previous_ids=ids + 1)
    np.testing.assert_array_equal(rejection, [[9, 1, 1, 9]])


def test_only_the_direction_of_normals_counts():
    """For the angle and for the distance from the plane, in either direction."""
    rng = np.random.default_rng(11)
    now = compare.surfaces(rng, 40, 50)
    before = compare.previous(rng, now, turn=0.1)
    # Planes apart by a few hundredths of their depth, so that the distance decides.
    before["previous_depth"] = (now["depth"] * rng.uniform(0.98, 1.02, now["depth"].shape)).astype(np.float32)
    motion = np.zeros((40, 50, 3), np.float32)
    named = {**now, **before, "previous_camera": compare.camera(rng, 50, 40)}
    want = yester.consistency(motion, **named)
    assert 0.1 < (want[0] & yester.Rejection.DEPTH > 0).mean() < 0.9
    for name in ("normal", "previous_normal"):
        for scale in (0.25, 4):
            got = yester.consistency(motion, **{**named, name: named[name] * np.float32(scale)})
            for a, b in zip(got, want, strict=True):
                assert_same_bits(a, b)


@pytest.mark.parametrize("name", SOFT)
def test_a_pair_of_equals_is_the_number(name):
    rng = np.random.default_rng(2)
    motion = compare.motions(rng, 30, 40, 3)
    named = surface(rng, 30, 40, TESTS)
    number = SOFT[name][1]
    for got, want in zip(
        yester.consistency(motion, **named, **{name: (number, number)}),
        yester.consistency(motion, **named, **{name: number}),
        strict=True,
    ):
        assert_same_bits(got, want)


@pytest.mark.parametrize("name", SOFT)
def test_ramps_lie_between_their_ends(name):
    """The first threshold alone trusts less, the second alone more; a tap is rejected where the second rejects it."""
    rng = np.random.default_rng(3)
    motion = rng.normal(0, 1, (40, 50, 3)).astype(np.float32)
    tests = {"relative_depth": ["depth"], "plane_distance": ["plane"], "normal_angle": ["normal"]}
    tests |= {"motion_difference": ["motion"]}
    named = surface(rng, 40, 50, tests.get(name, ["color"]))
    named |= {"normal_angle": 180.0} if name == "plane_distance" else {}
    (_, less), (hard, more), (soft, between) = (
        yester.consistency(motion, **named, **{name: threshold}) for threshold in (*SOFT[name], SOFT[name])
    )
    assert (less <= between + 1e-6).all()
    assert (between <= more + 1e-6).all()
    np.testing.assert_array_equal(soft, hard)
    assert ((less < between - 0.01) & (between < more - 0.01)).mean() > 0.02


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("shake", [0, 1])
def test_motion_tells_what_was_covered(shake, channels):
    """An object moves right before what stands still; then, the camera may move as well."""
    before, motion = np.zeros((2, 3, 20, channels), np.float32)
    before[:, 4:8, 0] = motion[:, 6 - shake : 10 - shake, 0] = -2
    motion[..., 0] += shake
    shown = slice(0, 20 - shake)  # other pixels come from outside
    rejection, confidence = check(motion, previous_motion=before)
    # Now at columns 4 and 5 there is what the object covered.
    uncovered = np.zeros(20, bool)
    uncovered[4 - shake : 6 - shake] = True
    np.testing.assert_array_equal(rejection[:, shown], np.tile(int(Rejection.MOTION) * uncovered, (3, 1))[:, shown])
    np.testing.assert_array_equal(confidence[:, shown], np.tile(~uncovered, (3, 1))[:, shown])
    rejection, _ = yester.consistency(motion, previous_motion=before, motion_difference=np.inf)
    assert not (rejection & Rejection.MOTION).any()


def test_unknown_previous_motion_passes():
    motion, before = np.zeros((2, 3, 5, 2), np.float32)
    before[1, 2] = [np.nan, 0]
    before[1, 3] = [0, np.inf]
    rejection, confidence = check(motion, previous_motion=before)
    assert not rejection.any()
    assert (confidence == 1).all()


def test_every_pixel_has_its_bits():
    """Speed and luminance set their own bits, but none outside the image or without motion."""
    motion = np.zeros((1, 5, 2), np.float32)
    motion[0, :, 0] = [0, 1, -2, 9, np.nan]
    dark, bright = np.full((1, 5, 3), 0.1, np.float32), np.ones((1, 5, 3), np.float32)
    rejection, confidence = yester.consistency(motion, speed=1.5)
    np.testing.assert_array_equal(rejection, [[0, 0, 16, 1, 1]])
    np.testing.assert_array_equal(confidence, [[1, 1, 0, 0, 0]])
    rejection, _ = yester.consistency(motion, speed=1.5, color=dark, previous_color=bright)
    np.testing.assert_array_equal(rejection, [[32, 32, 48, 1, 1]])
    rejection, confidence = yester.consistency(motion, color=dark, previous_color=bright, relative_luminance=(0.8, 1.0))
    np.testing.assert_array_equal(rejection, [[0, 0, 0, 1, 1]])
    np.testing.assert_allclose(confidence, [[0.5, 0.5, 0.5, 0, 0]], atol=1e-6)
