import itertools
from dataclasses import replace

import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from reference.innovation import around


def images(rng, height, width, *, holes=0.05) -> dict:
    """New samples and a prediction, half of it in other light; in places black or negative."""
    prediction = compare.colors(rng, height, width, holes=holes)
    with np.errstate(invalid="ignore"):
        color = prediction * rng.gamma(rng.choice([1, 16]), 1, (height, width, 1)).astype(np.float32)
        color[rng.random((height, width)) < holes] = np.nan
        color[:, width // 2 :] *= rng.choice([0.1, 1, 3])
        prediction[height // 3 :, : width // 4] *= rng.choice([0, 1])
        prediction[:, -width // 5 :] *= rng.choice([-1, 1])
    length = rng.choice(np.float32([0, 0.5, 1, 1.7, 2, 9, 1e3, np.inf, np.nan]), (height, width))
    return {"color": color, "prediction": prediction, "history_length": length}


def evidence_of(rng, height, width, *, holes=0.05):
    """Evidence as an earlier frame may leave it, per block of 2×2 pixels."""
    evidence = rng.normal(0, 0.5, (-(-height // 2), -(-width // 2), 4)).astype(np.float32)
    evidence[..., 3] = rng.exponential(0.1, evidence.shape[:2])
    evidence[rng.random(evidence.shape) < holes / 4] = rng.choice([np.nan, np.inf, -np.inf])
    return evidence


def motions(rng, height, width, channels=2):
    """In 64ths of a pixel, so that both precisions find the same nearest block."""
    return (np.rint(compare.motions(rng, height, width, channels) * 64) / 64).astype(np.float32)


def rms(values) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def check(given, **named):
    got = yester.innovation(**given, **named)
    want = reference.innovation(**tensor(given), **named)
    black = max(named.get("exposure", 1.0) / 16, float(np.finfo(np.float32).tiny))
    color, prediction = (np.float64(given[name]) for name in ("color", "prediction"))
    with np.errstate(invalid="ignore"):
        light = np.maximum(np.nan_to_num(prediction, nan=0, posinf=0), 0) + black
        present = (np.isfinite(color) & np.isfinite(prediction)).all(-1)
        unit = black + around(tensor(prediction)).numpy() if named.get("sparse") else light
        seen = rms(((color - prediction) / unit).clip(-50, 50)[present])
    # The remainder of a subtraction is as precise as the differences that were averaged.
    target = np.float64(given.get("target", prediction))
    light = np.maximum(np.nan_to_num(target, nan=0, posinf=0), 0) + black
    seen = max(seen, rms(given["evidence"][..., :3]) if given.get("evidence") is not None else 0)
    assert all(image.dtype == np.float32 for image in got)
    assert_close("innovation", got[0], want[0], scale=seen * light)
    assert_close("innovation evidence", got[1][..., :3], want[1][..., :3], scale=seen)
    assert_close("innovation evidence", got[1][..., 3], want[1][..., 3])
    return got


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    exposure=st.sampled_from([1e-3, 1.0, 30.0]),
    strictness=st.sampled_from([0.0, 0.5, 3.0, 10.0]),
    share=st.sampled_from([0.2, 0.5, 1.0]),
    levels=st.integers(1, 8),
    fed_back=st.booleans(),
    sparse=st.booleans(),
    carried=st.booleans(),
    channels=st.sampled_from([0, 2, 3]),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
    other=st.booleans(),
)
def test_reference(seed, size, carried, channels, holes, other, **named):
    """With motion inside the image, out of it, and unknown."""
    rng = np.random.default_rng(seed)
    given = images(rng, *size, holes=holes)
    if carried:
        given["evidence"] = evidence_of(rng, *size, holes=holes)
    if channels:
        given["motion"] = motions(rng, *size, channels)
    if other:
        given["target"] = images(rng, *size, holes=holes)["prediction"]
    check(given, **named)


@each("carried", [False, True])
@each("size", [*SIZES, *TAILS, (3, 160), (4, 161), (2, 319), (5, 322)])
def test_sizes(size, carried):
    rng = np.random.default_rng(size[1])
    given = images(rng, *size)
    if carried:
        given |= {"evidence": evidence_of(rng, *size), "motion": motions(rng, *size)}
    check(given)


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (1, 5), (17, 3)])
@pytest.mark.parametrize("levels", [1, 4, 8])
def test_images_smaller_than_the_coarsest_block(size, levels):
    rng = np.random.default_rng(0)
    for strictness in (0.0, 3.0):
        given = images(rng, *size, holes=0) | {"evidence": evidence_of(rng, *size, holes=0)}
        found, evidence = check(given, levels=levels, strictness=strictness)
        assert np.isfinite(found).all()
        assert np.isfinite(evidence).all()


def test_everything_between_none_and_all_is_kept():
    """For a change that grows from left to right, in noise, and blocks far smaller than the image."""
    rng = np.random.default_rng(1)
    given = steady(64, 512, rng.gamma(4, 1 / 4, (64, 512, 1)) * (1 + np.linspace(0, 1, 512)[:, None] ** 2))
    found, _ = check(given, levels=4)
    columns = found.mean((0, 2))
    assert (found == 0).any()
    assert abs(columns[:100]).max() < 0.1
    assert columns[-100:].min() > 0.5


def steady(height, width, color, length=32.0) -> dict:
    """New samples, with a prediction of 1."""
    prediction = np.ones((height, width, 3), np.float32)
    color = (color * prediction).astype(np.float32)
    return {"color": color, "prediction": prediction, "history_length": np.full((height, width), length, np.float32)}


@pytest.mark.parametrize("strictness", [0.0, 3.0])
@pytest.mark.parametrize("size", [(1, 1), (37, 41), (20, 330)])
def test_predicted_light_is_no_innovation(size, strictness):
    rng = np.random.default_rng(0)
    color = compare.colors(rng, *size)
    length = np.full(size, 9, np.float32)
    found, evidence = yester.innovation(color, color, length, strictness=strictness)
    np.testing.assert_array_equal(found[np.isfinite(color)], 0)
    np.testing.assert_array_equal(evidence[np.isfinite(evidence)], 0)
    assert np.isfinite(evidence[..., :3]).all()


@pytest.mark.parametrize("change", [-0.9, -0.1, 0.01, 0.2, 5.0])
@pytest.mark.parametrize(("length", "rtol"), [(1.0, 0.025), (32.0, 0.005)])
def test_a_change_of_all_light_is_found_at_once(change, length, rtol):
    """Without noise nearly all of it is found, least in corners, where few blocks contribute."""
    given = steady(96, 128, 1 + change, length)
    found, evidence = check(given)
    np.testing.assert_allclose(found, change, rtol=rtol)
    assert abs(evidence[..., :3]).max() < rtol * abs(change)


def test_a_change_below_the_noise_of_small_blocks_is_found():
    """Of 256×256 pixels, the mean tells 3 % of the light in noise of 50 %; of blocks of 16×16, not all of them do."""
    found = []
    for seed in range(4):
        noise = 0.5 * np.random.default_rng(seed).normal(size=(256, 256, 1))
        given = steady(256, 256, 1.03 + noise)
        found.append([yester.innovation(**given, **levels)[0].mean() / 0.03 for levels in ({}, {"levels": 4})])
    deep, shallow = np.mean(found, 0)
    assert shallow < 0.7 < 0.85 < deep < 1.1


def test_differences_are_bounded():
    """Of a light that comes on, the first frame finds fifty times the sum of prediction and black."""
    found, _ = check(steady(64, 64, 1e6), exposure=16.0)
    np.testing.assert_allclose(found, 50 * 2, rtol=0.01)
    dark = {**steady(64, 64, 1e6), "prediction": np.zeros((64, 64, 3), np.float32)}
    found, _ = check(dark, exposure=16.0)
    np.testing.assert_allclose(found, 50, rtol=0.01)


@pytest.mark.parametrize("value", [1.5, 30.0, 1e30])
@pytest.mark.parametrize("levels", [1, 4, 8])
@pytest.mark.parametrize("size", [(48, 96), (47, 95), (33, 41), (5, 7), (1, 5), (9, 1)])
def test_one_bright_sample_is_no_innovation(size, value, levels):
    """Its squared mean does not exceed its variance at any level, so a strictness of 1.01 keeps nothing of it.

    Inside, in corners, and in the last blocks of odd sizes; nor in later frames, which are exact.
    """
    rng = np.random.default_rng(0)
    rows, columns = ([0, side // 2, side - 2, side - 1] for side in size)
    inside = [(rng.integers(size[0]), rng.integers(size[1])) for _ in range(6)]
    for y, x in {(max(y, 0), max(x, 0)) for y in rows for x in columns} | set(inside):
        given = steady(*size, 1.0)
        given["color"][y, x] = value
        found, evidence = yester.innovation(**given, strictness=1.01, levels=levels)
        np.testing.assert_array_equal(found, 0)
        assert (evidence[y // 2, x // 2, :3] > 0.1).all(), "though it is remembered"
        assert np.count_nonzero(evidence[..., 0]) == 1
        given["color"] = given["prediction"]
        given["motion"] = np.full((*size, 2), rng.integers(-3, 4), np.float32)
        for _ in range(4):
            found, evidence = yester.innovation(**given, evidence=evidence, strictness=1.01, levels=levels)
            np.testing.assert_array_equal(found, 0)


@pytest.mark.parametrize(
    ("noise", "bounds"),
    [
        # Twice the measured values: of noise of 1, 0.25 and 0.3 of the light, 0.039, 0.009 and 0.01 of it.
        ("exponential", (0.08, 0.01)),
        ("gamma", (0.018, 0.001)),
        ("normal", (0.02, 0.001)),
    ],
)
def test_noise_is_hardly_innovation(noise, bounds):
    """Unbiased samples: less is added than by blocks of 2×2 alone, and the stricter, the less."""
    rng = np.random.default_rng(0)
    samples = {"exponential": rng.exponential(1, (128, 128, 1)), "gamma": rng.gamma(16, 1 / 16, (128, 128, 1))}
    given = steady(128, 128, samples.get(noise, 1 + 0.3 * rng.normal(0, 1, (128, 128, 1))))
    none, loose, default, strict = (rms(yester.innovation(**given, strictness=c)[0]) for c in (0, 1, 3, 10))
    assert strict < default / 2 < loose / 2 < none / 2
    assert default < bounds[0]
    assert strict < bounds[1]
    assert abs(yester.innovation(**given)[0].mean()) < bounds[0] / 2


def test_own_samples_prove_nothing():
    """A prediction from N samples that include the new ones is doubted less: 1 + 4/N² times the noise."""
    rng = np.random.default_rng(0)
    color = rng.gamma(4, 1 / 4, (64, 64, 1))
    found = [rms(check(steady(64, 64, color, length))[0]) for length in (0, 1, 2, 4, np.inf)]
    assert found[0] == found[1] < found[2] < found[3] < found[4]
    given = steady(64, 64, color, np.nan)
    assert rms(check(given)[0]) == found[0]


def test_persistent_changes_are_found_sooner():
    """A twentieth more light in a square, in noise of a half: no single frame shows it, several together do."""
    rng = np.random.default_rng(0)
    truth = np.ones((128, 128, 1))
    truth[40:88, 40:88] = 1.05
    given, evidence, variances = steady(128, 128, 1.0), None, []
    for _ in range(12):
        given["color"][:] = truth * rng.gamma(4, 1 / 4, truth.shape)
        alone, _ = yester.innovation(**{**given, "prediction": np.ones_like(given["color"])}, strictness=30.0)
        assert not alone.any()
        found, evidence = yester.innovation(**given, evidence=evidence, strictness=30.0, share=0.2)
        given["prediction"] = given["prediction"] + found
        variances.append(evidence[..., 3].mean())
    assert variances[-1] == pytest.approx(variances[0] / 9, rel=0.1), "what averaging leaves of the variance"
    change = given["prediction"] - 1
    assert change[48:80, 48:80].mean() > 0.3 * 0.05
    assert abs(change[:30]).max() < 0.005


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_evidence_by_hand(share):
    """E, a mean over frames, and its variance; so strict that no correction is made. A lost frame changes neither.

    Each sample's difference is 1 in three channels, or 2 in every second frame, and a prediction of 4 samples adds a
    quarter to its square. The last blocks of odd sizes have fewer samples, whose mean varies more.
    """
    counts, evidence = np.outer([2, 2, 1], [2, 2, 2, 1]), None
    mean, variance = 0.0, np.zeros(counts.shape)
    for frame in range(7):
        size = 1 + frame % 2
        w = 1 - share if frame else 0.0
        if frame == 4:
            given = steady(5, 7, np.nan, length=4)
        else:
            given = steady(5, 7, 1 + (1 + 1 / 16) * size, length=4)
            mean = (1 - w) * size + w * mean
            variance = (1 - w) ** 2 * 3 * size**2 * 1.25 / counts + w**2 * variance
        found, evidence = yester.innovation(**given, evidence=evidence, share=share, strictness=1e9)
        np.testing.assert_array_equal(found, 0)
        np.testing.assert_allclose(evidence[..., :3], mean, rtol=1e-5)
        np.testing.assert_allclose(evidence[..., 3], variance, rtol=1e-5)


@pytest.mark.parametrize(
    ("noise", "bound"),
    # Twice the measured values; the frames before find 0.02 and 0.009 of the light.
    [("exponential", 0.011), ("gamma", 0.005)],
)
def test_a_lost_frame_does_not_believe_the_noise_before(noise, bound):
    """Evidence has a variance: without samples, noise proves no more than before, and fades from frame to frame."""
    rng = np.random.default_rng(0)
    given, evidence, errors = steady(128, 128, 1.0), None, []
    for frame in range(12):
        samples = {"exponential": rng.exponential(1, (128, 128, 1)), "gamma": rng.gamma(4, 1 / 4, (128, 128, 1))}
        given["color"] = np.where(frame < 8, samples[noise], np.nan) * np.ones((128, 128, 3), np.float32)
        found, evidence = yester.innovation(**given, evidence=evidence)
        given["prediction"] = given["prediction"] + found
        errors.append(rms(found))
    sparse, lost = errors[:8], errors[8:]
    assert lost[0] < min(bound, min(sparse) / 2)
    assert all(later < 0.7 * earlier for earlier, later in itertools.pairwise(lost))


def test_evidence_follows_motion():
    """By whole blocks, bit for bit; from outside the image, or where motion is unknown, there is none."""
    rng = np.random.default_rng(2)
    given = images(rng, 24, 30)
    evidence = evidence_of(rng, 24, 30, holes=0)
    motion = np.full((24, 30, 2), np.float32([4, -2]))
    moved, still = np.roll(evidence, (1, -2), (0, 1)), np.zeros_like(motion)
    still[:2], still[:, -4:] = np.nan, np.nan
    got, nothing = yester.innovation(**given, evidence=evidence, motion=motion), yester.innovation(**given)
    for mine, its in zip(got, yester.innovation(**given, evidence=moved, motion=still), strict=True):
        assert_same_bits(mine, its)
    for unknown in (np.nan, np.inf, 1e9, -1e9):
        lost = motion.copy()
        lost[::2, ::2, rng.integers(2)] = unknown  # one pixel of each block
        for mine, its in zip(yester.innovation(**given, evidence=evidence, motion=lost), nothing, strict=True):
            assert_same_bits(mine, its)


def test_evidence_that_is_not_finite_is_none():
    """In any channel: treated as unknown motion."""
    rng = np.random.default_rng(7)
    given, evidence = images(rng, 24, 30), evidence_of(rng, 24, 30, holes=0)
    motion = np.zeros((24, 30, 2), np.float32)
    motion[10:12, 14:16] = np.nan
    want = yester.innovation(**given, evidence=evidence, motion=motion)
    for channel, value in enumerate((np.nan, np.inf, -np.inf, np.nan)):
        broken = evidence.copy()
        broken[5, 7, channel] = value
        for mine, its in zip(yester.innovation(**given, evidence=broken), want, strict=True):
            assert_same_bits(mine, its)


def test_evidence_comes_from_the_nearest_block():
    """E and V, by half the mean motion of a block's pixels; ties go down or right, and give none outside the image."""
    evidence = np.zeros((4, 5, 4), np.float32)
    evidence[..., :3] = np.arange(1, 21).reshape(4, 5, 1)
    evidence[..., 3] = 4 * evidence[..., 0]
    # Every block is right in the mean: nothing is corrected, and half of the evidence remains.
    given = steady(7, 9, np.tile(np.float32([[0.75, 1.25], [1.25, 0.75]]), (4, 5))[:7, :9, None])
    noise = 3 * (0.25 / (1 + 1 / 16)) ** 2 * (1 + 4 / 32**2) / 4
    places = {
        (0, 0): (1, 2),
        (0.98, -0.98): (1, 2),
        (1, 0): (1, 3),
        (-1, -1): (1, 2),
        (-1.02, 0): (1, 1),
        (4, 2): (2, 4),
        (-4.98, -2.98): (0, 0),
        (5, 0): None,
        (0, -3.02): None,
    }
    for motion, place in places.items():
        moved = np.broadcast_to(np.float32(motion), (7, 9, 2)).copy()
        moved[2:4, 4:6] += np.float32([[[8, 0], [-8, 4]], [[0, -2], [0, -2]]])
        _, left = check({**given, "evidence": evidence, "motion": moved}, strictness=1e9)
        np.testing.assert_array_equal(left[1, 2, :3], 0 if place is None else evidence[place][:3] / 2)
        fresh = noise if place is None else noise / 4 + evidence[place][3] / 4
        np.testing.assert_allclose(left[1, 2, 3], fresh, rtol=1e-5)


@pytest.mark.parametrize("length", [0.0, 1.0, -3.0, np.nan])
def test_young_pixels_have_no_evidence(length):
    """A prediction that begins with these samples is not the one that the evidence is about."""
    rng = np.random.default_rng(3)
    given = images(rng, 21, 30)
    given["history_length"][:] = length
    evidence = np.nan_to_num(evidence_of(rng, 21, 30), nan=0, posinf=0, neginf=0)
    for mine, its in zip(yester.innovation(**given, evidence=evidence), yester.innovation(**given), strict=True):
        np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize("power", [-12, 9])
def test_scale_does_not_matter(power):
    """Light in another unit: the same evidence, and the correction in that unit, bit for bit."""
    rng = np.random.default_rng(4)
    given = images(rng, 33, 170) | {"evidence": evidence_of(rng, 33, 170), "motion": motions(rng, 33, 170)}
    found, evidence = yester.innovation(**given, exposure=2.0)
    scaled = {name: np.ldexp(given[name], power) for name in ("color", "prediction")}
    got, same = yester.innovation(**{**given, **scaled}, exposure=2.0 * 2.0**power)
    assert np.count_nonzero(found) > 100
    assert_same_bits(same, evidence)
    assert_same_bits(got, np.ldexp(found, power))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_missing_samples_do_not_count(value):
    """Samples with any channel not finite; their pixels are corrected by their neighbours."""
    rng = np.random.default_rng(5)
    given = steady(40, 50, 1.5 * rng.gamma(16, 1 / 16, (40, 50, 1)))
    holes = rng.random((40, 50)) < 0.5
    holes[:20, :20] = True
    given["color"][holes] = np.nan
    found, evidence = check(given)
    assert np.isfinite(found).all()
    assert found[24:, 24:].min() > 0.2
    assert not evidence[:10, :10, :3].any() or found[:20, :20].any()
    other = {**given, "color": np.where(holes[..., None], np.float32(1e3), given["color"])}
    other["color"][holes, rng.integers(3)] = value
    for mine, its in zip(yester.innovation(**other), (found, evidence), strict=True):
        assert_same_bits(mine, its)


@pytest.mark.parametrize("sparse", [False, True])
def test_missing_blocks_do_not_count(sparse):
    """Where whole blocks are missing, others find the same error: in a checkerboard of them, and beside a half."""
    prediction, length = np.ones((64, 64, 3)), np.full((64, 64), 20.0)
    y, x = np.indices((64, 64)) // 2
    for known in ((x + y) % 2 == 0, (x % 2 == 0) & (y % 2 == 0), x >= 16):
        color = np.where(known[..., None], 1.5 * prediction, np.nan)
        found, evidence = yester.innovation(color, prediction, length, sparse=sparse)
        np.testing.assert_allclose(found[known], 0.5, rtol=0.01)
        assert_same_bits(np.isnan(evidence[..., 3]), ~known[::2, ::2])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_missing_predictions_learn_nothing(value):
    """As if there were no samples; other pixels' corrections are unchanged."""
    rng = np.random.default_rng(6)
    given = steady(40, 50, 1.5 * rng.gamma(16, 1 / 16, (40, 50, 1)))
    holes = rng.random((40, 50)) < 0.3
    missing = {**given, "color": np.where(holes[..., None], np.float32(np.nan), given["color"])}
    want, evidence = yester.innovation(**missing)
    given["prediction"][holes, rng.integers(3)] = value
    found, left = yester.innovation(**given)
    assert_same_bits(left, evidence)
    assert_same_bits(found[~holes], want[~holes])
    assert np.isfinite(found).all(), "a missing channel counts as black"
    black = {**given, "prediction": np.where(np.isfinite(given["prediction"]), given["prediction"], np.float32(0))}
    black["color"] = missing["color"]
    assert_same_bits(found, yester.innovation(**black)[0])


def test_nothing_is_there():
    """Neither samples nor evidence: no correction, and no new evidence."""
    given = steady(9, 11, np.nan)
    found, evidence = yester.innovation(**given)
    np.testing.assert_array_equal(found, 0)
    np.testing.assert_array_equal(evidence[..., :3], 0)
    assert np.isnan(evidence[..., 3]).all()


@pytest.mark.parametrize("exposure", [1.0, 1e-44])
def test_all_black(exposure):
    """Black stays black; light in it is found relative to a fraction of the exposure, however small that is."""
    black = np.zeros((20, 30, 3), np.float32)
    length = np.full((20, 30), 9, np.float32)
    found, evidence = yester.innovation(black, black, length, exposure=exposure)
    np.testing.assert_array_equal(found, 0)
    np.testing.assert_array_equal(evidence[..., :3], 0)
    lit = np.full_like(black, max(exposure / 16, np.finfo(np.float32).tiny))
    found, _ = check({"color": lit, "prediction": black, "history_length": length}, exposure=exposure)
    np.testing.assert_allclose(found, lit, rtol=0.02)


def test_bad_input():
    given = images(np.random.default_rng(0), 5, 6)
    wrong = {
        "exposure": (0, -1, np.nan, np.inf),
        "strictness": (-0.1, np.nan, np.inf),
        "share": (0, -0.5, 1.01, np.nan),
        "levels": (0, 9, -1),
    }
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ValueError, match=f"^{name}: expected"):
                yester.innovation(**given, **{name: value})
    evidence, motion = np.zeros((3, 3, 4), np.float32), np.zeros((5, 6, 2), np.float32)
    yester.innovation(**given, evidence=evidence, motion=motion)
    shapes = {
        "color": given["color"][..., :2],
        "prediction": given["prediction"][1:],
        "history_length": given["history_length"][:, 1:],
        "motion": motion[1:],
    }
    for name, value in shapes.items():
        with pytest.raises(ValueError, match=f"^{name}: expected"):
            yester.innovation(**{**given, "evidence": evidence, "motion": motion, name: value})
    for shape in ((2, 3, 4), (3, 4, 4), (5, 6, 4), (3, 3, 3), (3, 3)):
        with pytest.raises(ValueError, match=r"^evidence: expected"):
            yester.innovation(**given, evidence=np.zeros(shape, np.float32))


@pytest.mark.parametrize("fed_back", [True, False])
def test_constant_errors_are_found_whole(fed_back):
    """A constant error is found whole, whether the prediction is corrected or not."""
    wrong = np.full((48, 48, 3), 0.5, np.float32)
    truth, length, evidence = wrong * 1.4, np.full((48, 48), 9, np.float32), None
    shown = wrong
    for _ in range(6):
        found, evidence = yester.innovation(truth, shown, length, evidence, exposure=0.5, fed_back=fed_back)
        result = shown + found
        shown = result if fed_back else wrong
    np.testing.assert_allclose(result, truth, rtol=0.02)


def test_sparse_samples_speak_for_blocks_without():
    """One pixel in 16 is sampled, twice as bright as predicted: one frame finds all of the change, everywhere."""
    given = steady(32, 48, np.full((32, 48, 1), 2.0))
    rows, columns = np.indices((32, 48))
    seen = (rows % 4 == 0) & (columns % 4 == 0)
    given["color"][~seen] = np.nan
    dense, sparse = (yester.innovation(**given, exposure=0.16, sparse=sparse) for sparse in (False, True))
    sampled = seen.reshape(16, 2, 24, 2).any((1, 3))
    for found, evidence in (dense, sparse):
        assert found.mean() > 0.9
        np.testing.assert_array_equal(np.isnan(evidence[..., 3]), ~sampled)
        assert np.isfinite(evidence[..., :3]).all()
    # Without samples, evidence lasts where history is long, and, if samples are sparse, where it is short.
    given["color"] = np.full_like(given["color"], np.nan)
    for length, lasts in ((8, True), (1.5, False)):
        given["history_length"][:] = length
        rest = [
            yester.innovation(**given, evidence=sparse[1], exposure=0.16, sparse=sparse_)[1]
            for sparse_ in (True, False)
        ]
        np.testing.assert_array_equal(np.isnan(rest[0][..., 3]), ~sampled)
        np.testing.assert_array_equal(rest[0][sampled][:, 3], sparse[1][sampled][:, 3])
        assert (rest[1][sampled][:, 3] == sparse[1][sampled][:, 3]).all() == lasts


def test_noise_of_a_sparse_prediction_is_no_light():
    """The prediction is as noisy as the samples: the light seems to grow relative to it, not to its surroundings."""
    rng = np.random.default_rng(0)
    color, prediction = rng.gamma(3, 1 / 3, (2, 128, 128, 1)).astype(np.float32).repeat(3, -1)
    given = {"color": color, "prediction": prediction, "history_length": np.full((128, 128), 8, np.float32)}
    dense, sparse = (yester.innovation(**given, exposure=0.16, sparse=sparse)[0].mean() for sparse in (False, True))
    assert dense > 0.2
    assert abs(sparse) < 0.02


# In the pipelines that correct by it.

PIPELINES = {
    "SVGF": yester.SVGF,
    "BMFR": yester.BMFR,
    "HalfRes": yester.HalfRes,
    "TAA": lambda: yester.TAA(innovation=True),
    "Recirculation": yester.Recirculation,
}
PIPELINE = pytest.mark.parametrize("make", PIPELINES.values(), ids=PIPELINES)


def flat(color) -> yester.Frame:
    """A wall that stands still before a camera."""
    height, width = color.shape[:2]
    camera = yester.Camera.from_look_at([0, 0, 4], [0, 0, 0], [0, 1, 0], 40, width, height)
    normal = np.broadcast_to(np.float32([0, 0, 1]), color.shape)
    return yester.Frame(color, depth=np.full((height, width), 4.0, np.float32), normal=normal, camera=camera)


def noisy(rng, height=24, width=40):
    return rng.gamma(1, 1, (height, width, 1)).astype(np.float32).repeat(3, -1)


@PIPELINE
@pytest.mark.parametrize("what", ["black", "one infinite sample", "NaN"])
def test_frames_that_tell_nothing(make, what):
    """In between others, they leave nothing behind that is not finite, nor light from nowhere."""
    rng, pipeline = np.random.default_rng(0), make()
    for number in range(9):
        color = noisy(rng)
        if number in (3, 4):
            match what:
                case "black":
                    color[:] = 0
                case "NaN":
                    color[:] = np.nan
                case _:
                    color[5, 7] = np.inf
        shown = pipeline.step(flat(color)).color
        assert np.isfinite(shown).all()
    assert 0.5 < shown.mean() < 1.6


@PIPELINE
@each("size", [(1, 1), (1, 9), (3, 2), (5, 7)])
def test_pipelines_of_images_smaller_than_the_coarsest_block(make, size):
    rng, pipeline = np.random.default_rng(0), make()
    for _ in range(6):
        assert np.isfinite(pipeline.step(flat(noisy(rng, *size))).color).all()


@pytest.mark.parametrize("antialias", [False, True])
def test_a_cut_has_no_prediction(antialias):
    """Neither has a frame all of whose history is rejected: innovation changes nothing."""
    rng = np.random.default_rng(0)
    frames = [flat(noisy(rng)) for _ in range(8)]
    frames = [replace(f, ids=np.full((24, 40), 1 + (i >= 7), np.uint32)) for i, f in enumerate(frames)]
    given = {"choice": False, "antialias": antialias}
    corrected, plain = yester.SVGF(**given), yester.SVGF(innovation=False, **given)
    for frame in frames:
        shown = [pipeline.step(frame).color for pipeline in (corrected, plain)]
    if antialias:
        # The output stage has a history of its own, of what is denoised, which ids do not end.
        assert np.abs(shown[0] - shown[1]).mean() < 0.1 * shown[1].mean()
    else:
        assert_same_bits(*shown)
