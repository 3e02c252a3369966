"""The candidate that each tile shows: the kernels against their references and by hand, and within `SVGF`."""

import compare
import composed
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from reference.choice import around, costs, relative, together, weights, whole
from test_innovation import motions
from test_svgf import gallery, speckled

SIDE = 8


def parts(side: int, *size: int) -> tuple[int, ...]:
    return tuple(-(-n // side) for n in size)


def evidence_of(rng, height, width, count, *, holes=0.05):
    """Evidence as earlier frames may leave it, in part of fewer than 16 samples."""
    shape = parts(SIDE, height, width)
    n = rng.uniform(0, 120, (*shape, 1)) * rng.integers(0, 2, (*shape, 1))
    weight = n * rng.exponential(1, n.shape)
    gains, squares = (
        draw * weight for draw in (rng.normal(0, 0.3, (*shape, count - 1)), rng.exponential(2, (*shape, count - 1)))
    )
    evidence = np.concatenate([gains, squares, weight, n], -1).astype(np.float32)
    evidence[rng.random(evidence.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    return evidence


def images(rng, height, width, count, *, holes=0.05) -> dict:
    """Samples and candidates of about the same light at increasing distance, some of them black or negative."""
    base = rng.exponential(1, (height, width, 1)) * rng.choice([0, 1e-3, 1, 30], (height, width, 1))
    candidates = (base * (1 + np.cumsum(rng.normal(0, 0.5, (height, width, count)), -1))).astype(np.float32)
    candidates[rng.random(candidates.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    color = compare.colors(rng, height, width, holes=holes) * rng.choice(np.float32([0.1, 1, 1e4]))
    return {"color": color, "candidates": candidates}


def carried(rng, height, width, count, *, holes=0.05, channels=2) -> dict:
    """Evidence and motion: from inside the image, from outside, and unknown."""
    return {
        "evidence": evidence_of(rng, height, width, count, holes=holes),
        "motion": motions(rng, height, width, channels),
        "coverage": rng.choice(np.float32([0, 0.3, 1, np.nan]), (height, width), p=[0.1, 0.4, 0.45, 0.05]),
    }


def largest(evidence):
    """For each of its numbers, the largest magnitude over all tiles."""
    return np.where(np.isfinite(evidence), np.abs(evidence), 0).max((0, 1))


def compare_check(color, candidates, evidence=None, *, exposure=1.0, usual=0):
    """Compare evidence with the reference, relative to the magnitude of the summed terms, which may cancel."""
    got = yester.compare_candidates(color, candidates, evidence, exposure=exposure, usual=usual)
    given, named = tensor([color, candidates, evidence]), {"exposure": exposure, "usual": usual}
    want = reference.compare_candidates(*given, **named).numpy()
    assert got.dtype == np.float32
    shown, sample, known = relative(*given[:2], **named)
    # Each larger by 1, as candidates are differences from a mean.
    ends = shown[..., 1:].abs() + shown[..., :-1].abs() + 2
    term = ends * (ends + 2 * sample.abs() + 2) * known[..., None]  # (H, W, K - 1)
    step = (shown[..., 1:] - shown[..., :-1]) * (shown[..., 1:] + shown[..., :-1] - 2 * sample) * known[..., None]
    terms, squares, seen, n = (together(image) for image in (term, term**2, step**2, known[..., None].to(term)))
    weight = weights(seen, n)  # as large as the reference has it; its rounding is that of the squares
    scale = np.concatenate([weight * terms, weight**2 * squares, weight * n, n], -1)
    if evidence is not None:
        scale = scale + largest(evidence)
    assert_close("compare_candidates", got, want, rtol=1e-6, scale=scale)
    return got


def choice_check(evidence, motion, coverage, *, usual=0, strictness=0.5, frame_strictness=3.0, share=0.3):
    """Compare evidence with the reference; the choice must cost as little, by the reference, as its own."""
    named = {"usual": usual, "strictness": strictness, "frame_strictness": frame_strictness, "share": share}
    got, left = yester.choice(evidence, motion, coverage, **named)
    want, known = (image.numpy() for image in reference.choice(*tensor([evidence, motion, coverage]), **named))
    steps = evidence.shape[-1] // 2 - 1
    assert got.dtype == left.dtype == np.float32
    assert_close("choice evidence", left, known, rtol=1e-6, scale=largest(evidence))
    assert ((got >= 0) & (got <= steps) & (got == np.rint(got))).all()
    # Decisions that float32 may turn: costs that differ by roundings, and numbers of samples at the bound.
    errors = 1e-6 * largest(evidence)[:steps].sum()
    parts = known.copy()
    parts[..., :steps] = np.abs(parts[..., :steps])
    terms = whole(tensor(parts)).numpy()[0, 0]
    of_frame = costs(whole(tensor(known)), usual, frame_strictness, tiles=1).numpy().ravel()
    finite = min(frame_strictness, 1e6) * np.sqrt(terms[steps:-2].sum())
    rounding = 1e-5 * (terms[:steps].sum() + finite) / max(terms[-1], 1)
    defaults = np.flatnonzero(of_frame - of_frame.min() <= rounding)

    def follows(default: int) -> bool:
        cost = costs(around(tensor(known)), default, strictness).numpy()
        mine, least = np.take_along_axis(cost, got.astype(int)[..., None], -1)[..., 0], cost.min(-1)
        weight, n = (averaged(known[..., i]) for i in (-2, -1))
        rounding = errors * (1 + strictness) / np.maximum(weight, 1e-6)
        with np.errstate(invalid="ignore"):
            return bool(((mine - least <= rounding) | (np.abs(n - 16) < 1e-4)).all())

    assert any(map(follows, defaults)) or (got == want).all()
    return got, left


def averaged(image):
    """{1, 2, 1}/4 along both axes of tiles, borders replicated."""
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if i == axis else (0, 0) for i in range(image.ndim)], mode="edge")
        count = image.shape[axis]
        one, two, three = (np.take(padded, np.arange(i, i + count), axis) for i in range(3))
        image = (one + 2 * two + three) / 4
    return image


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    count=st.integers(2, 6),
    exposure=st.sampled_from([1e-2, 1.0, 30.0]),
    end=st.sampled_from([0, 0.5, 1]),
    known=st.booleans(),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference_of_comparisons(seed, size, count, exposure, end, known, holes):
    """With missing samples and candidates, invalid evidence, and none."""
    rng = np.random.default_rng(seed)
    given = images(rng, *size, count, holes=holes)
    evidence = evidence_of(rng, *size, count, holes=holes) if known else None
    compare_check(**given, evidence=evidence, exposure=exposure, usual=round(end * (count - 1)))


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 80), st.integers(1, 80)),
    count=st.integers(2, 6),
    end=st.sampled_from([0, 0.5, 1]),
    strictness=st.sampled_from([0.0, 0.5, 3.0]),
    frame_strictness=st.sampled_from([0.0, 0.5, 3.0, np.inf]),
    share=st.sampled_from([0.0, 0.1, 1.0]),
    channels=st.sampled_from([2, 3]),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference_of_choices(seed, size, count, end, channels, holes, **named):
    """With motion inside the image, out of it, and unknown; invalid evidence."""
    rng = np.random.default_rng(seed)
    given = carried(rng, *size, count, holes=holes, channels=channels)
    choice_check(**given, usual=round(end * (count - 1)), **named)


@each("size", [*SIZES, *TAILS, (3, 160), (4, 161), (2, 319), (5, 322), (33, 47)])
def test_sizes(size):
    rng = np.random.default_rng(size[1])
    given = carried(rng, *size, 5)
    _, evidence = choice_check(**given, usual=3)
    compare_check(**images(rng, *size, 5), evidence=evidence, usual=3)


@pytest.mark.parametrize("size", [(1, 1), (8, 8), (9, 17), (30, 71)])
def test_every_pixel_counts_in_its_tile(size):
    evidence = compare_check(*steady([5, 1], np.ones(size)))
    down, across = (np.minimum(np.arange(8, n + 8, 8), n) - np.arange(0, n, 8) for n in size)
    np.testing.assert_array_equal(evidence[..., -1], down[:, None] * across)


def steady(candidates, color) -> tuple:
    """Samples (H, W), and candidates (K,) that are constant over the image."""
    return np.repeat(np.float32(color)[..., None], 3, -1), np.tile(np.float32(candidates), (*color.shape, 1))


def at_rest(evidence, *, frame_strictness=np.inf, **named):
    """The choice without motion, with history everywhere; by the tiles alone."""
    height, width = SIDE * evidence.shape[0], SIDE * evidence.shape[1]
    motion, coverage = np.zeros((height, width, 2), np.float32), np.ones((height, width), np.float32)
    return choice_check(np.float32(evidence), motion, coverage, frame_strictness=frame_strictness, **named)


@pytest.mark.parametrize("truth", [0, 1, 2, 3])
@pytest.mark.parametrize("usual", [0, 1, 2, 3])
def test_the_nearest_to_the_truth_wins(truth, usual):
    """For any usual candidate, in strong noise, after enough samples."""
    rng = np.random.default_rng(truth)
    candidates, evidence = np.float32([0.4, 0.8, 1.2, 1.6]), None
    for _ in range(6):
        if evidence is not None:
            _, evidence = at_rest(evidence, usual=usual)
        color = candidates[truth] * rng.gamma(2, 1 / 2, (64, 80))
        evidence = compare_check(*steady(candidates, color), evidence, usual=usual)
    chosen, _ = at_rest(evidence, usual=usual)
    assert (chosen == truth).mean() > 0.97


def test_fifteen_samples_decide_nothing():
    """However clear they are, until another frame adds samples."""
    color, candidates = steady([5, 1], np.ones((32, 48)))
    for count in (16, 15):
        seen = np.zeros((SIDE, SIDE), bool)
        seen.ravel()[3 : 3 + count] = True
        color[~np.tile(seen, (4, 6))] = np.nan
        evidence = compare_check(color, candidates)
        assert (evidence[..., -1] == count).all()
        chosen, left = at_rest(evidence, share=0.0)
        assert (chosen == (count == 16)).all()
    evidence = compare_check(color, candidates, left)
    assert (evidence[..., -1] == 30).all()
    assert (at_rest(evidence)[0] == 1).all()


def test_no_evidence_gives_the_usual_candidate():
    """Without coverage or motion there is no evidence, and without candidates or samples none is added."""
    rng = np.random.default_rng(0)
    given = carried(rng, 21, 43, 3, holes=0)
    given["motion"], given["coverage"] = np.zeros((21, 43, 2), np.float32), np.ones((21, 43), np.float32)
    for change in (
        {"coverage": np.zeros((21, 43), np.float32)},
        {"coverage": np.full((21, 43), np.nan, np.float32)},
        {"motion": np.full((21, 43, 2), np.nan, np.float32)},
        {"motion": given["motion"] + np.float32([np.inf, 0])},
    ):
        for usual in range(3):
            chosen, evidence = choice_check(**given | change, usual=usual)
            assert (chosen == usual).all()
            assert not evidence.any()
    color, candidates = steady([5, 1, 0], rng.exponential(1, (21, 43)))
    for nothing in ((color, np.full_like(candidates, np.nan)), (np.full_like(color, np.inf), candidates)):
        assert not compare_check(*nothing).any()
        np.testing.assert_array_equal(compare_check(*nothing, given["evidence"]), given["evidence"])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_missing_channel_is_a_missing_sample(value):
    """In the new image, or in any candidate."""
    for broken in range(2):
        for channel in range(3):
            given = steady([5, 1, 0], np.ones((16, 16)))
            given[broken][4, 9, channel] = value
            np.testing.assert_array_equal(compare_check(*given)[..., -1], [[64, 63], [64, 64]])


@pytest.mark.parametrize("power", [-20, -1, 1, 20])
def test_brightness_changes_no_bit(power):
    """Colours, candidates and exposure scale together."""
    given = images(np.random.default_rng(3), 37, 41, 4)
    want = yester.compare_candidates(**given, exposure=0.75, usual=2)
    factor = np.float32(2.0**power)
    bright = {name: image * factor for name, image in given.items()}
    assert_same_bits(yester.compare_candidates(**bright, exposure=0.75 * float(factor), usual=2), want)


def test_frames_add_up():
    """The comparison in one frame does not depend on earlier frames."""
    rng = np.random.default_rng(0)
    given, evidence = images(rng, 37, 41, 4), evidence_of(rng, 37, 41, 4, holes=0)
    alone = yester.compare_candidates(**given, usual=2)
    both = yester.compare_candidates(**given, evidence=evidence, usual=2)
    np.testing.assert_allclose(both, alone + evidence, rtol=1e-5, atol=1e-5 * np.abs(alone).max())


@pytest.mark.parametrize("strictness", [0.0, 0.5])
@pytest.mark.parametrize("usual", range(5))
def test_equal_candidates(usual, strictness):
    """Nothing is better than the usual one."""
    evidence = compare_check(*steady([0.7] * 5, np.random.default_rng(0).exponential(1, (32, 32))), usual=usual)
    assert not evidence[..., :-2].any()
    assert (evidence[..., -1] == 64).all()
    chosen, _ = at_rest(evidence, usual=usual, strictness=strictness)
    assert (chosen == usual).all()


@pytest.mark.parametrize("noise", ["exponential", "gamma", "normal"])
def test_gains_are_unbiased(noise):
    """For noise below the bound, their mean is the difference of the true relative squared errors."""
    rng = np.random.default_rng(0)
    truth, exposure, usual = np.float32([2, 1.5, 3]), 8.0, 1
    candidates = np.float32([0.9, 1.3, 1.6])
    errors = ((candidates - truth @ [0.2126, 0.7152, 0.0722]) / (candidates[usual] + exposure / 16)) ** 2
    draw = {
        "exponential": lambda shape: rng.exponential(1, shape),
        "gamma": lambda shape: rng.gamma(8, 1 / 8, shape),
        "normal": lambda shape: 1 + 0.5 * rng.normal(0, 1, shape),
    }[noise]
    means = []
    for _ in range(100):
        color = (truth * draw((32, 32, 3))).astype(np.float32)
        known = np.tile(candidates, (32, 32, 1))
        evidence = yester.compare_candidates(color, known, exposure=exposure, usual=usual)
        gains = evidence[..., :2] * (evidence[..., -1] / evidence[..., -2])[..., None]  # without weights
        means.append(gains.sum((0, 1)) / evidence[..., -1].sum())
    spread = np.std(means, 0) / np.sqrt(len(means))
    assert (spread < 0.1 * np.abs(np.diff(errors))).all(), "noise leaves something to see"
    assert (np.abs(np.mean(means, 0) - np.diff(errors)) < 4 * spread).all()


def test_samples_are_bounded():
    """However bright, a sample differs from the prediction by at most eight times the sum of prediction and black."""
    for color, r in ((1e6, 8), (-1e6, -8), (1, 0)):
        evidence = compare_check(*steady([1, 3], np.full((8, 8), color)), exposure=16.0)
        d = 1 - 2 * r  # for candidates of 0 and 1, relative to the usual one
        w = 1 / np.sqrt(d**2 + 1e-6)
        np.testing.assert_allclose(evidence[0, 0], [64 * w * d, 64 * w**2 * d**2, 64 * w, 64], rtol=1e-5)


def test_black_counts_as_a_sixteenth_of_exposure():
    evidence = compare_check(*steady([0, 0.5], np.zeros((8, 8))), exposure=4.0)
    np.testing.assert_allclose(evidence[0, 0], [64, 64, 64 / 4, 64], rtol=1e-6)
    # A usual candidate below black is black.
    evidence = compare_check(*steady([-1, 0.5], np.zeros((8, 8))), exposure=4.0)
    gain, _, weight, _ = evidence[0, 0]
    assert gain / weight == pytest.approx(2**2 - 4**2, rel=1e-6)


def test_numbers_too_large_decide_nothing_and_are_forgotten():
    def chosen(evidence, **named):
        motion, coverage = np.zeros((40, 40, 2), np.float32), np.ones((40, 40), np.float32)
        return yester.choice(evidence, motion, coverage, **named)

    for exposure in (1e-38, 1.0, 3e38):
        evidence = yester.compare_candidates(
            *steady([1, 3e38, -3e38], np.full((40, 40), 3e38)), exposure=exposure, usual=1
        )
        assert np.isin(chosen(evidence, usual=1)[0], (0, 1, 2)).all()
    evidence = yester.compare_candidates(*steady([1, 3e38, -3e38], np.ones((40, 40))))
    assert not np.isfinite(evidence).all()
    best, evidence = chosen(evidence)
    assert (best == 0).all()
    assert not evidence.any()
    evidence = yester.compare_candidates(*steady([3, 1, 0], np.ones((40, 40))), evidence)
    assert (chosen(evidence)[0] == 1).all()


def decide(evidence, **named) -> int:
    """The choice of one tile, from evidence alone."""
    evidence = np.float32(evidence)[None, None]
    chosen, left = at_rest(evidence, share=0.0, **named)
    assert_same_bits(left, evidence)
    return int(chosen[0, 0])


def test_decisions_by_hand():
    """Costs of mean gains, and standard errors of 64/9 times as many samples."""
    # -10/20 against √(50 / (64/9 · 20²)) = 0.13258.
    assert decide([-10, 50, 20, 20], strictness=3.7) == 1
    assert decide([-10, 50, 20, 20], strictness=3.8) == 0
    assert decide([10, 50, 20, 20], strictness=3.7, usual=1) == 0
    assert decide([10, 50, 20, 20], strictness=3.8, usual=1) == 1
    assert decide([-10, 50, 16, 16], strictness=0.5) == 1
    assert decide([-10, 50, 16, 15.9], strictness=0.5) == 0
    # The same in other units of weight: -10/20 against √(50 / (64/9 · 20²)).
    assert decide([-1, 0.5, 2, 20], strictness=3.7) == 1
    assert decide([-1, 0.5, 2, 20], strictness=3.8) == 0
    # Across a step without gain to one with more; variances add up, here to 0.1569².
    steps = [4, -10, 30, 40, 20, 20]
    assert decide(steps, strictness=1.9) == 2
    assert decide(steps, strictness=2.0) == 0
    # The better of both neighbouring candidates; without a difference, the usual one.
    assert decide([3, -2, 0, 0, 20, 20], strictness=0, usual=1) == 0
    assert decide([2, -3, 0, 0, 20, 20], strictness=0, usual=1) == 2
    assert decide([0, 0, 0, 0, 20, 20], strictness=0, usual=1) == 1


def test_decisions_of_the_frame_by_hand():
    """By standard errors of the frame's mean; a tile decides against what the frame does."""
    # -10/20 against √(50 / 20²) = 0.35355; the tile itself would need 50 standard errors.
    assert decide([-10, 50, 20, 20], strictness=50, frame_strictness=1.41) == 1
    assert decide([-10, 50, 20, 20], strictness=50, frame_strictness=1.42) == 0
    assert decide([-10, 50, 20, 15.9], strictness=0, frame_strictness=0) == 0
    # The frame takes the last candidate, the first tile the one before it, which is a little better there.
    steps = [-10, -10, 20, 20, 20, 20], [-10, 1, 20, 20, 20, 20]
    evidence = np.tile(np.float32(steps[0]), (1, 12, 1))
    evidence[:, :2] = steps[1]
    for frame_strictness in (3, np.inf):
        chosen, _ = at_rest(evidence, share=0.0, frame_strictness=frame_strictness)
        np.testing.assert_array_equal(chosen, [[1, *[2] * 11]])
    chosen, _ = at_rest(evidence, share=0.0, strictness=9.0, frame_strictness=3)
    assert (chosen == 2).all()


def test_every_pixel_counts_as_much_in_the_frame():
    """Tiles of eight times the weight, and less cost a pixel, do not outvote others."""
    evidence = np.zeros((3, 9, 4), np.float32)
    evidence[:, 0], evidence[:, -1] = [-6, 0, 4, 40], [8, 0, 32, 40]
    # By the sum of gains the frame would take the first.
    chosen, _ = at_rest(evidence, share=0.0, frame_strictness=0)
    assert (chosen[:, :-2] == 1).all()
    assert (chosen[:, -1] == 0).all()


def test_tiles_that_know_nothing_do_as_the_frame_does():
    evidence = np.tile(np.float32([-50, 250, 100, 100]), (9, 9, 1))
    evidence[3:, 3:] = 0
    known = np.ones((9, 9), bool)
    known[4:, 4:] = False
    for frame_strictness, want in ((3, 1), (np.inf, 0)):
        chosen, _ = at_rest(evidence, share=0.0, frame_strictness=frame_strictness)
        assert (chosen[known] == 1).all()
        assert (chosen[~known] == want).all()


def test_no_frame_decides_alone():
    """Nine frames speak for the second candidate, and one, with samples ten times as bright, for the first."""
    evidence, pooled = None, 0.0
    for number in range(10):
        bright = number == 4
        given = steady([1, 0.8], np.full((8, 8), 10 if bright else 0.8))
        if evidence is not None:
            _, evidence = at_rest(evidence, share=0.0)
        alone = compare_check(*given)[0, 0]
        pooled += alone[0] / alone[2]
        evidence = compare_check(*given, evidence)
    assert pooled > 0, "the mean of all frames speaks for the first"
    assert (at_rest(evidence, share=0.0)[0] == 1).all()


def test_neighbours_have_a_say():
    """A tile's own weight in its average is a quarter; its eight neighbours have the rest."""
    for own, want in ((-2.9, 0), (-3.1, 1)):
        evidence = np.zeros((5, 7, 4), np.float32)
        evidence[..., 0], evidence[..., 2:] = 1, 20
        evidence[2, 3, 0] = own
        chosen, _ = at_rest(evidence, share=0.0)
        assert chosen[2, 3] == chosen.sum() == want


@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 1.0])
def test_evidence_fades(share):
    evidence, wanted = np.zeros((1, 1, 4), np.float32), 0.0
    for _ in range(9):
        wanted = 64 + (1 - share) * wanted
        _, left = at_rest(evidence, share=share)
        evidence = compare_check(*steady([5, 1], np.ones((8, 8))), left)
        np.testing.assert_allclose(evidence[0, 0, -1], wanted, rtol=1e-5)


def test_evidence_follows_motion():
    """By the motion of the tile's centre: whole tiles keep their bits, half a tile mixes two; clamped at the border."""
    evidence = evidence_of(np.random.default_rng(0), 40, 56, 3, holes=0)
    coverage = np.ones((40, 56), np.float32)

    def left(motion):
        return choice_check(evidence, np.float32(motion), coverage, share=0.0)[1]

    everywhere = np.ones((40, 56, 1))
    np.testing.assert_array_equal(left(everywhere * [0, 0]), evidence)
    moved = left(everywhere * [8, -16])
    np.testing.assert_array_equal(moved[2:, :-1], evidence[:-2, 1:])
    np.testing.assert_array_equal(moved[:2, :-1], np.repeat(evidence[:1, 1:], 2, axis=0))
    np.testing.assert_array_equal(moved[2:, -1], evidence[:-2, -1])
    moved = left(everywhere * [4, 0])
    np.testing.assert_allclose(moved[:, :-1], (evidence[:, :-1] + evidence[:, 1:]) / 2, rtol=1e-5, atol=1e-4)
    centres = np.full((40, 56, 2), np.nan)
    centres[4::8, 4::8] = 4, 0
    assert_same_bits(left(centres), moved)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_evidence_that_is_not_finite_is_none(value):
    evidence = evidence_of(np.random.default_rng(0), 40, 56, 3, holes=0)
    for channel in range(6):
        broken = evidence.copy()
        broken[2, 3, channel] = value
        _, left = at_rest(broken, share=0.0)
        assert not left[2, 3].any()
        assert np.isfinite(left).all()


def cut(name, where):
    return lambda given: {name: given[name][where].copy()}


def put(**change):
    return lambda _: change


@pytest.mark.parametrize(
    ("match", "change"),
    [
        (r"^evidence: expected", cut("evidence", np.s_[:-1])),
        (r"^evidence: expected", cut("evidence", np.s_[:, :-1])),
        (r"^evidence: expected 4, 6, 8, .*got 5", cut("evidence", np.s_[..., :5])),
        (r"^evidence: expected 4, 6, 8, .*got 1", cut("evidence", np.s_[..., :1])),
        (r"^motion: expected", cut("motion", np.s_[..., :1])),
        (r"^coverage: expected", cut("motion", np.s_[:-1])),
        (r"^coverage: expected", cut("coverage", np.s_[:, :-1])),
        (r"^usual: expected a candidate, 0 to 2, got 3", put(usual=3)),
        (r"^usual: expected a candidate, 0 to 2, got -1", put(usual=-1)),
        *((r"^strictness: expected", put(strictness=value)) for value in (-0.1, np.nan, np.inf)),
        *((r"^frame_strictness: expected", put(frame_strictness=value)) for value in (-0.1, np.nan)),
        *((r"^share: expected", put(share=value)) for value in (-0.1, 1.1, np.nan)),
    ],
)
def test_wrong_arguments_of_choice(match, change):
    given = carried(np.random.default_rng(0), 21, 35, 3)
    with pytest.raises(ValueError, match=match):
        yester.choice(**given | change(given))


@pytest.mark.parametrize(
    ("match", "change"),
    [
        (r"^color: expected", cut("color", np.s_[..., :2])),
        (r"^candidates: expected", cut("color", np.s_[:-1])),
        (r"^candidates: expected", cut("candidates", np.s_[:, :-1])),
        (r"^candidates: expected a channel for each of at least 2.*got 1", cut("candidates", np.s_[..., :1])),
        (r"^evidence: expected", cut("evidence", np.s_[:-1])),
        (r"^evidence: expected 6 channels, for 3 .*got 3", cut("evidence", np.s_[..., :3])),
        (r"^usual: expected a candidate, 0 to 2, got 3", put(usual=3)),
        (r"^usual: expected a candidate, 0 to 2, got -1", put(usual=-1)),
        *((r"^exposure: expected", put(exposure=value)) for value in (0, -1, np.nan, np.inf)),
    ],
)
def test_wrong_arguments_of_comparisons(match, change):
    rng = np.random.default_rng(0)
    given = images(rng, 21, 35, 3) | {"evidence": evidence_of(rng, 21, 35, 3)}
    with pytest.raises(ValueError, match=match):
        yester.compare_candidates(**given | change(given))


# Within SVGF.


def still(color, rng, *, shape=16.0):
    """A frame with noise relative to its light: a quarter of it for a shape of 16."""
    return yester.Frame((color * rng.gamma(shape, 1 / shape, color.shape[:2])[..., None]).astype(np.float32))


def waves(height, width):
    """Fine detail that no buffer shows."""
    y, x = np.mgrid[:height, :width]
    return np.repeat((1 + 0.8 * np.sin(1.9 * x) * np.sin(1.7 * y))[..., None], 3, -1)


def halves(count):
    """Left, detail that no buffer shows, in weak noise; right, an even wall in strong noise. Reference, and frames."""
    rng = np.random.default_rng(0)
    truth = np.ones((64, 128, 3))
    truth[:, :64] = waves(64, 64)
    frames = []
    for _ in range(count):
        little, much = still(truth, rng, shape=100.0).color, still(truth, rng, shape=1.0).color
        frames.append(yester.Frame(np.where(np.arange(128)[:, None] < 64, little, much)))
    return truth, frames


def steps(frames, **named) -> list:
    svgf = yester.SVGF(**named)
    return [svgf.step(frame) for frame in frames]


@pytest.mark.parametrize("iterations", [0, 3, 16])
def test_the_first_frame_is_as_usual(iterations):
    """It and the first after a reset equal those of a pipeline that does not choose, up to rounding."""
    _, frames = halves(6)
    svgf = yester.SVGF(iterations=iterations)
    bare = yester.SVGF(iterations=iterations, choice=False).step(frames[0])
    for _ in range(2):
        first = svgf.step(frames[0])
        assert (first.choice == iterations).all()
        np.testing.assert_allclose(first.color, bare.color, rtol=1e-5)
        np.testing.assert_allclose(first.variance, bare.variance, rtol=1e-4)
        later = [svgf.step(frame).choice for frame in frames[1:]]
        assert not (later[-1] == iterations).all()
        assert min(image.min() for image in later) >= 0
        assert max(image.max() for image in later) <= min(iterations + 1, 16)
        svgf.reset()


def test_tiles_leave_no_seams():
    """The number of passes changes from pixel to pixel by an eighth of what it changes from tile to tile."""
    _, frames = halves(12)
    chosen = [out.choice for out in steps(frames)[4:]]
    assert max(np.ptp(image) for image in chosen) >= 3
    for axis in (1, 2):
        assert np.abs(np.diff(chosen, axis=axis)).max() <= 4 / 8 + 1e-6


@pytest.mark.parametrize(("alpha", "first"), [(0.2, 4), (0.25, 4), (0.3, None)])
def test_three_samples_predict(alpha, first):
    """The fourth frame's samples are the first to be compared, so the fifth frame is the first that may choose.

    A history of less than two and a half samples never predicts.
    """
    _, frames = halves(8)
    others = [not (out.choice == 3).all() for out in steps(frames, alpha=alpha)]
    assert others == [first is not None and number >= first for number in range(8)]


def test_only_pipelines_that_choose_report_it():
    frame = yester.Frame(np.ones((20, 30, 3), np.float32), depth=np.ones((20, 30), np.float32))
    assert yester.SVGF().step(frame).choice.shape == (20, 30)
    for pipeline in (
        yester.SVGF(choice=False),
        yester.BMFR(),
        yester.HalfRes(choice=False),
        yester.TAA(),
        yester.Upscaler(),
    ):
        assert pipeline.step(frame).choice is None


def test_outputs_of_others_are_refused():
    frame = yester.Frame(np.ones((20, 30, 3), np.float32))
    choosing, plain = yester.SVGF(), yester.SVGF(choice=False)
    having, lacking = choosing.step(frame), plain.step(frame)
    with pytest.raises(ValueError, match=r"^out: expected one with choice, got one of a pipeline without choice$"):
        choosing.step(frame, out=lacking)
    with pytest.raises(ValueError, match=r"^out: expected one of a pipeline without choice, got one with choice$"):
        plain.step(frame, out=having)
    assert choosing.step(frame, out=having).choice is having.choice
    assert plain.step(frame, out=lacking).choice is None


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (3, 2), (7, 7), (8, 8), (9, 17)])
def test_images_smaller_than_a_tile(size):
    rng = np.random.default_rng(0)
    svgf, other = yester.SVGF(), composed.SVGF()
    for _ in range(8):
        frame = still(np.ones((*size, 3)), rng)
        got, want = svgf.step(frame), other.step(frame)
        assert_same_bits(got.color, want.color)
        assert_same_bits(got.choice, want.choice)
        assert np.isfinite(got.color).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0, 1e15, 1e38])
def test_frames_of_nothing(value):
    """Missing, black, and numbers whose squares overflow: the output is finite, and passes are in range."""
    rng = np.random.default_rng(0)
    bad = yester.Frame(np.full((24, 40, 3), value, np.float32))
    good = [still(np.ones((24, 40, 3)), rng) for _ in range(8)]
    svgf = yester.SVGF()
    for frame in [bad] * 3 + good + [bad] * 3 + good:
        out = svgf.step(frame)
        assert np.isfinite(out.color).all()
        assert out.choice.min() >= 0
        assert out.choice.max() <= 4
    if not abs(value) > 1:
        assert out.color.mean() == pytest.approx(1, rel=0.1)


def test_missing_pixels_are_filled_as_usual():
    """A pixel without any sample gets as many passes as without a choice, whatever its tile has chosen."""
    rng = np.random.default_rng(0)
    svgf, mixed = yester.SVGF(), []
    for _ in range(8):
        color = still(waves(40, 56), rng).color.copy()
        color[8:24, 8:40] = np.nan
        out = svgf.step(yester.Frame(color))
        unseen = out.history_length == 0
        assert (out.choice[unseen] == 3).all()
        assert out.color[unseen].all(), "it is filled"
        mixed.append((out.choice[8:24, 8:40][~unseen[8:24, 8:40]] < 2).any() and unseen.any())
    assert any(mixed)


def test_detail_gets_fewer_passes_and_noise_more():
    """Both reduce the error."""
    truth, frames = halves(16)
    chosen, plain = steps(frames), steps(frames, choice=False)
    levels = np.mean([out.choice for out in chosen[8:]], 0)
    assert levels[8:-8, 8:48].max() < 2
    assert levels[8:-8, 80:-8].mean() > 3.5

    def error(outs, part):
        return np.mean([(out.color - truth)[part] ** 2 for out in outs[8:]])

    left, right = np.s_[:, :56], np.s_[:, 72:]
    assert error(chosen, left) < 0.8 * error(plain, left)
    assert error(chosen, right) < 0.98 * error(plain, right)


def test_mirrors_keep_their_images():
    """Evidence follows the motion of the mirrored surface, as history does."""

    def last(**named):
        rng, svgf, errors, passes = np.random.default_rng(0), yester.SVGF(innovation=False, **named), [], []
        for number in range(16):
            buffers, light, _ = gallery(number, 120, 80)
            out = svgf.step(yester.Frame(speckled(light, rng), **buffers))
            errors.append(np.mean((out.color - light) ** 2))
            passes.append(3 if out.choice is None else out.choice.mean())
        return np.mean(errors[8:]), np.mean(passes[8:])

    (chosen, passes), (plain, _) = last(), last(choice=False)
    assert passes < 1.5
    assert chosen < 0.7 * plain


def test_evidence_is_of_earlier_frames():
    """Where only later frames have seen a surface, there is no evidence: the passes that the frame needs."""
    truth, frames = halves(8)
    svgf, colors = yester.SVGF(), truth.astype(np.float32)
    one, light = np.ones((64, 128), np.float32), colors[..., 0]
    known = colors, np.stack([light, light**2 + np.float32(0.01)], -1), 3 * one, one, np.zeros((64, 128), np.uint8)
    for number, frame in enumerate(frames):
        ids = np.ones((64, 128), np.uint32)
        ids[16:48, 16:48] += number == 7
        out = svgf.step(yester.Frame(frame.color, ids=ids), later=yester.History(*known))
        # Of the newly visible tiles, those whose neighbours are new, too.
        assert number in range(1, 7) or (out.choice[28:36, 28:36] == 3).all()
    assert (out.choice[:8, :48] < 2).all()
    assert np.array_equal(out.confidence == 0, ids == 2), "that of earlier frames"


def across_borders(images) -> float:
    """Mean step between the columns or rows of adjacent tiles, relative to steps inside tiles."""
    found = []
    for image in images:
        for axis in (0, 1):
            change = np.abs(np.diff(image, axis=axis)).mean((1 - axis, 2))
            border = np.arange(1, len(change) + 1) % SIDE == 0
            found.append([change[border].mean(), change[~border].mean()])
    border, other = np.mean(found, 0)
    return border / other


def test_tiles_do_not_show():
    """On a smooth noisy scene, some tiles of which get other numbers of passes than their neighbours."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:128, :160]
    truth = np.repeat((1 + 0.5 * np.sin(x / 25) * np.sin(y / 19))[..., None], 3, -1)
    outs = steps([still(truth, rng, shape=2.0) for _ in range(16)], antialias=False, innovation=False)[4:]
    assert np.mean([np.ptp(out.choice) for out in outs]) > 1
    assert across_borders([out.color for out in outs]) < 1.01
