"""Which candidate each tile shows: the kernel against its reference and by hand, and what `SVGF` makes of it."""

import compare
import composed
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, tensor
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.choice import costs, relative, together
from test_innovation import motions
from test_svgf import gallery, speckled

SIDE = 8


def parts(side: int, *size: int) -> tuple[int, ...]:
    return tuple(-(-n // side) for n in size)


def evidence_of(rng, height, width, count, *, holes=0.05):
    """As frames before may have left it, some of it of less than 16 samples."""
    shape = parts(SIDE, height, width)
    n = rng.uniform(0, 120, (*shape, 1)) * rng.integers(0, 2, (*shape, 1))
    gains, squares = rng.normal(0, 0.3, (*shape, count - 1)) * n, rng.exponential(2, (*shape, count - 1)) * n
    evidence = np.concatenate([gains, squares, n], -1).astype(np.float32)
    evidence[rng.random(evidence.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    return evidence


def images(rng, height, width, count, *, holes=0.05, carried=True, channels=2) -> dict:
    """Samples and candidates of about the same light, ever further from each other, some of them black or negative."""
    coarse = parts(2, height, width)
    base = rng.exponential(1, (*coarse, 1, 3)) * rng.choice([0, 1e-3, 1, 30], (*coarse, 1, 1))
    candidates = base * (1 + np.cumsum(rng.normal(0, 0.5, (*coarse, count, 3)), -2))
    candidates = candidates.reshape(*coarse, 3 * count).astype(np.float32)
    candidates[rng.random(candidates.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    given = {
        "color": compare.colors(rng, height, width, holes=holes) * rng.choice(np.float32([0.1, 1, 1e4])),
        "candidates": candidates,
        "motion": motions(rng, height, width, channels),
        "coverage": rng.choice(np.float32([0, 0.3, 1, np.nan]), (height, width), p=[0.1, 0.4, 0.45, 0.05]),
    }
    if carried:
        given["evidence"] = evidence_of(rng, height, width, count, holes=holes)
    return given


def sizes(given, *, strictness=0.5, share=0.1, **named):
    """Of each tile, how large the terms are whose sums the evidence is, (h, w, K - 1) each: they may cancel."""
    arrays = tensor({name: image for name, image in given.items() if name != "evidence"})
    shown, sample, known = relative(**arrays, **named)
    # Each by 1 more, as candidates are differences from a mean.
    ends = shown[..., 1:, :].abs() + shown[..., :-1, :].abs() + 2
    term = (ends * (ends + 2 * sample.abs() + 2)).mean(-1) * known[..., None]
    gains, squares = (together(image).numpy() for image in (term, term**2))
    if given.get("evidence") is not None:
        finite = np.where(np.isfinite(given["evidence"]), np.abs(given["evidence"]), 0).max((0, 1))
        gains, squares = (sums + known for sums, known in zip((gains, squares), np.split(finite[:-1], 2), strict=True))
    return gains, squares


def check(given, *, usual=0, strictness=0.5, **named):
    """Evidence as the reference has it; and a choice that by the reference costs as little as its own."""
    got, evidence = yester.choice(**given, usual=usual, strictness=strictness, **named)
    want, known = (
        image.numpy() for image in reference.choice(**tensor(given), usual=usual, strictness=strictness, **named)
    )
    steps = given["candidates"].shape[-1] // 3 - 1
    assert got.dtype == evidence.dtype == np.float32
    gains, squares = sizes(given, usual=usual, **named)
    assert_close("choice evidence", evidence[..., :steps], known[..., :steps], rtol=1e-6, scale=gains)
    assert_close("choice evidence", evidence[..., steps:-1], known[..., steps:-1], rtol=1e-6, scale=squares)
    assert_close("choice evidence", evidence[..., -1], known[..., -1], rtol=1e-6)
    # What float32 may turn: costs that differ by roundings, and numbers of samples at the bound.
    cost = costs(tensor(known), usual, strictness).numpy()
    mine, its = (np.take_along_axis(cost, chosen.astype(int)[..., None], -1)[..., 0] for chosen in (got, want))
    n = averaged(known[..., -1:])
    rounding = 1e-6 * (1 + strictness) * (averaged(gains) / np.maximum(n, 1)).sum(-1)
    with np.errstate(invalid="ignore"):
        assert ((mine - its <= rounding) | (np.abs(n[..., 0] - 16) < 1e-4) | (got == want)).all()
    assert ((got >= 0) & (got <= steps) & (got == np.rint(got))).all()
    return got, evidence


def averaged(image):
    """{1, 2, 1}/4 along both axes of tiles, borders replicated."""
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if i == axis else (0, 0) for i in range(image.ndim)], mode="edge")
        count = image.shape[axis]
        one, two, three = (np.take(padded, np.arange(i, i + count), axis) for i in range(3))
        image = (one + 2 * two + three) / 4
    return image


@settings(max_examples=200)
@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    count=st.integers(2, 6),
    offset=st.tuples(st.integers(0, 1), st.integers(0, 1)),
    exposure=st.sampled_from([1e-2, 1.0, 30.0]),
    end=st.sampled_from([0, 0.5, 1]),
    strictness=st.sampled_from([0.0, 0.5, 3.0]),
    share=st.sampled_from([0.0, 0.1, 1.0]),
    carried=st.booleans(),
    channels=st.sampled_from([2, 3]),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference(seed, size, count, end, carried, channels, holes, **named):
    """Motion within the image, out of it, and unknown; samples and candidates that are missing."""
    rng = np.random.default_rng(seed)
    given = images(rng, *size, count, holes=holes, carried=carried, channels=channels)
    check(given, usual=round(end * (count - 1)), **named)


@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize("size", [*SIZES, *TAILS, (3, 160), (4, 161), (2, 319), (5, 322), (33, 47)])
def test_sizes(size, carried):
    check(images(np.random.default_rng(size[1]), *size, 5, carried=carried), usual=3, offset=(1, 0))


def steady(candidates, color, *, coverage=1.0) -> dict:
    """Nothing moves; candidates (K,), the same everywhere, and the new samples (H, W)."""
    height, width = color.shape
    coarse = parts(2, height, width)
    return {
        "color": np.repeat(np.float32(color)[..., None], 3, -1),
        "candidates": np.tile(np.repeat(np.float32(candidates), 3), (*coarse, 1)),
        "motion": np.zeros((height, width, 2), np.float32),
        "coverage": np.broadcast_to(np.float32(coverage), (height, width)).copy(),
    }


@pytest.mark.parametrize("truth", [0, 1, 2, 3])
@pytest.mark.parametrize("usual", [0, 1, 2, 3])
def test_the_nearest_to_the_truth_wins(truth, usual):
    """Against any usual one, in strong noise, once enough samples came."""
    rng = np.random.default_rng(truth)
    candidates = np.float32([0.4, 0.8, 1.2, 1.6])
    evidence = None
    for number in range(24):
        color = candidates[truth] * rng.gamma(2, 1 / 2, (64, 80))
        given = steady(candidates, color)
        chosen, evidence = check({**given, "evidence": evidence} if number else given, usual=usual)
    assert (chosen == truth).mean() > 0.97


@pytest.mark.parametrize("offset", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_fifteen_samples_decide_nothing(offset):
    """However clear they are; of each tile, the sixteen pixels at the offset are compared."""
    seen = np.ones((SIDE, SIDE), bool)
    given = steady([5, 1], np.ones((32, 48)))
    chosen, evidence = check(given, offset=offset)
    assert (evidence[..., -1] == 16).all()
    assert (chosen == 1).all()
    x, y = offset
    seen[2 + y, 6 + x] = False
    given["coverage"] = np.tile(seen, (4, 6)).astype(np.float32)
    chosen, evidence = check(given, offset=offset)
    assert (evidence[..., -1] == 15).all()
    assert (chosen == 0).all()
    # With what is left of the frame before, they do.
    chosen, evidence = check({**given, "evidence": evidence}, offset=offset)
    np.testing.assert_allclose(evidence[..., -1], 1.9 * 15, rtol=1e-6)
    assert (chosen == 1).all()


def test_nothing_known_is_the_usual_one():
    """Without coverage, candidates, samples or motion, and where that leads out of the image: no evidence either."""
    rng = np.random.default_rng(0)
    given = steady([5, 1, 0], rng.exponential(1, (21, 43)))
    given["evidence"] = evidence_of(rng, 21, 43, 3, holes=0)
    for change in (
        {"coverage": np.zeros((21, 43), np.float32)},
        {"coverage": np.full((21, 43), np.nan, np.float32)},
        {"motion": np.full((21, 43, 2), np.nan, np.float32)},
        {"motion": given["motion"] + np.float32([np.inf, 0])},
        {"motion": given["motion"] + np.float32([43, 0]), "evidence": None},
        {"candidates": np.full_like(given["candidates"], np.nan), "evidence": None},
        {"color": np.full((21, 43, 3), np.inf, np.float32), "evidence": None},
    ):
        for usual in range(3):
            chosen, evidence = check({**given, **change}, usual=usual)
            assert (chosen == usual).all()
            assert not evidence.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_missing_channel_is_a_missing_sample(value):
    """Of the new image, and of any candidate."""
    for name, channels in (("color", 3), ("candidates", 9)):
        for channel in range(channels):
            given = steady([5, 1, 0], np.ones((16, 16)))
            side = 2 if name == "color" else 1
            given[name][4 * side, 6 * side, channel] = value
            _, evidence = check(given)
            np.testing.assert_array_equal(evidence[..., -1], [[16, 16], [16, 15]])


@pytest.mark.parametrize("power", [-20, -1, 1, 20])
def test_brightness_changes_no_bit(power):
    """Colours, candidates and exposure together."""
    given = images(np.random.default_rng(3), 37, 41, 4)
    want = yester.choice(**given, exposure=0.75, usual=2)
    factor = np.float32(2.0**power)
    bright = given | {name: given[name] * factor for name in ("color", "candidates")}
    for got, its in zip(yester.choice(**bright, exposure=0.75 * float(factor), usual=2), want, strict=True):
        assert_same_bits(got, its)


@pytest.mark.parametrize("strictness", [0.0, 0.5])
@pytest.mark.parametrize("usual", range(5))
def test_equal_candidates(usual, strictness):
    """Nothing is better than the usual one."""
    rng = np.random.default_rng(0)
    given = steady([0.7] * 5, rng.exponential(1, (32, 32)))
    chosen, evidence = check(given, usual=usual, strictness=strictness)
    assert (chosen == usual).all()
    assert not evidence[..., :-1].any()
    assert (evidence[..., -1] == 16).all()


@pytest.mark.parametrize("noise", ["exponential", "gamma", "normal"])
def test_gains_are_unbiased(noise):
    """Their mean, of noise that the bound does not reach, is the difference of the true relative squared errors."""
    rng = np.random.default_rng(0)
    truth, exposure, usual = 2.0, 8.0, 1
    candidates = np.float32([[0.9, 1.4, 1.0], [1.2, 1.3, 1.1], [1.5, 1.2, 1.7]])
    errors = (((candidates - truth) / (candidates[usual].mean() + exposure / 16)) ** 2).mean(-1)
    draw = {
        "exponential": lambda shape: rng.exponential(1, shape),
        "gamma": lambda shape: rng.gamma(8, 1 / 8, shape),
        "normal": lambda shape: 1 + 0.5 * rng.normal(0, 1, shape),
    }[noise]
    given, means = steady([0, 0, 0], np.ones((64, 64))), []
    given["candidates"][:] = candidates.ravel()
    for _ in range(100):
        given["color"] = (truth * draw((64, 64, 3))).astype(np.float32)
        _, evidence = yester.choice(**given, exposure=exposure, usual=usual)
        means.append(evidence[..., :2].sum((0, 1)) / evidence[..., -1].sum())
    spread = np.std(means, 0) / np.sqrt(len(means))
    assert (spread < 0.1 * np.abs(np.diff(errors))).all(), "noise leaves something to see"
    assert (np.abs(np.mean(means, 0) - np.diff(errors)) < 4 * spread).all()


def test_samples_are_bounded():
    """However bright, by eight times the sum of prediction and black above the prediction."""
    for color, r in ((1e6, 8), (-1e6, -8), (1, 0)):
        _, evidence = check(steady([1, 3], np.full((8, 8), color)), exposure=16.0)
        d = 1 - 2 * r  # of candidates that are 0 and 1, relatively
        np.testing.assert_allclose(evidence[0, 0], [16 * d, 16 * d**2, 16], rtol=1e-5)


def test_black_counts_as_a_sixteenth_of_exposure():
    _, evidence = check(steady([0, 0.5], np.zeros((8, 8))), exposure=4.0)
    np.testing.assert_allclose(evidence[0, 0], [16 * 4, 16 * 16, 16], rtol=1e-6)
    # A usual candidate below black is black.
    _, evidence = check(steady([-1, 0.5], np.zeros((8, 8))), exposure=4.0)
    np.testing.assert_allclose(evidence[0, 0, 0], 16 * (2**2 - 4**2), rtol=1e-6)


def test_numbers_too_large_decide_nothing_and_are_forgotten():
    given = steady([1, 3e38, -3e38], np.full((40, 40), 3e38))
    for exposure in (1e-38, 1.0, 3e38):
        chosen, _ = yester.choice(**given, exposure=exposure, usual=1)
        assert np.isin(chosen, (0, 1, 2)).all()
    chosen, evidence = yester.choice(**steady([1, 3e38, -3e38], np.ones((40, 40))))
    assert (chosen == 0).all()
    assert not np.isfinite(evidence).all()
    chosen, evidence = yester.choice(**steady([3, 1, 0], np.ones((40, 40))), evidence=evidence)
    assert np.isfinite(evidence).all()
    assert (chosen == 1).all()


def decide(evidence, **named) -> int:
    """Of one tile, from evidence alone."""
    count = (len(evidence) + 1) // 2
    given = steady([0] * count, np.full((8, 8), np.nan))
    evidence = np.float32(evidence)[None, None]
    chosen, left = check({**given, "evidence": evidence}, share=0.0, **named)
    assert_same_bits(left, evidence)
    return int(chosen[0, 0])


def test_decisions_by_hand():
    """Costs of mean gains, and standard errors of 64/9 times as many samples."""
    # -10/20 against √(50/20 / (64/9 · 20)) = 0.13258.
    assert decide([-10, 50, 20], strictness=3.7) == 1
    assert decide([-10, 50, 20], strictness=3.8) == 0
    assert decide([10, 50, 20], strictness=3.7, usual=1) == 0
    assert decide([10, 50, 20], strictness=3.8, usual=1) == 1
    assert decide([-10, 50, 16], strictness=0.5) == 1
    assert decide([-10, 50, 15.9], strictness=0.5) == 0
    # Over a step that is worth nothing, to one that is worth more; variances add up, here to 0.1569².
    steps = [4, -10, 30, 40, 20]
    assert decide(steps, strictness=1.9) == 2
    assert decide(steps, strictness=2.0) == 0
    # The better of both sides; without a difference, the usual one.
    assert decide([3, -2, 0, 0, 20], strictness=0, usual=1) == 0
    assert decide([2, -3, 0, 0, 20], strictness=0, usual=1) == 2
    assert decide([0, 0, 0, 0, 20], strictness=0, usual=1) == 1


def test_neighbours_have_a_say():
    """A tile has a quarter of its average, and its eight neighbours the rest."""
    for own, want in ((-2.9, 0), (-3.1, 1)):
        evidence = np.zeros((5, 7, 3), np.float32)
        evidence[..., 0], evidence[..., 2] = 1, 20
        evidence[2, 3, 0] = own
        given = steady([0, 0], np.full((40, 56), np.nan)) | {"evidence": evidence}
        chosen, _ = check(given, share=0.0)
        assert chosen[2, 3] == chosen.sum() == want


@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 1.0])
def test_evidence_fades(share):
    given, wanted = steady([5, 1], np.ones((8, 8))), 0.0
    for _ in range(9):
        wanted = 16 + (1 - share) * wanted
        _, given["evidence"] = check(given, share=share)
        np.testing.assert_allclose(given["evidence"][0, 0, -1], wanted, rtol=1e-5)


def test_evidence_follows_motion():
    """Of the tile's centre: by whole tiles to the same bits, by a half the mean of two; held at the border."""
    rng = np.random.default_rng(0)
    evidence = evidence_of(rng, 40, 56, 3, holes=0)
    given = steady([0, 0, 0], np.full((40, 56), np.nan)) | {"evidence": evidence}
    np.testing.assert_array_equal(check(given, share=0.0)[1], evidence)
    given["motion"][:] = 8, -16
    _, moved = check(given, share=0.0)
    np.testing.assert_array_equal(moved[2:, :-1], evidence[:-2, 1:])
    np.testing.assert_array_equal(moved[:2, :-1], np.repeat(evidence[:1, 1:], 2, axis=0))
    np.testing.assert_array_equal(moved[2:, -1], evidence[:-2, -1])
    given["motion"][:] = 4, 0
    _, moved = check(given, share=0.0)
    np.testing.assert_allclose(moved[:, :-1], (evidence[:, :-1] + evidence[:, 1:]) / 2, rtol=1e-5, atol=1e-4)
    given["motion"] = np.full_like(given["motion"], np.nan)
    given["motion"][4::8, 4::8] = 4, 0
    assert_same_bits(check(given, share=0.0)[1], moved)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_evidence_that_is_not_finite_is_none(value):
    evidence = evidence_of(np.random.default_rng(0), 40, 56, 3, holes=0)
    for channel in range(5):
        broken = evidence.copy()
        broken[2, 3, channel] = value
        given = steady([0, 0, 0], np.full((40, 56), np.nan)) | {"evidence": broken}
        _, left = check(given, share=0.0)
        assert not left[2, 3].any()
        assert np.isfinite(left).all()


@pytest.mark.parametrize("channels", [2, 3])
def test_candidates_come_along_motion_from_the_nearest_pixel(channels):
    """Where one of four pixels is known, others compare nothing; between two pixels, the one below or to the right."""
    height, width = 19, 26
    rng = np.random.default_rng(1)
    given = steady([0, 0], rng.exponential(1, (height, width)))
    given["candidates"] = rng.exponential(1, given["candidates"].shape).astype(np.float32)
    for dx, dy in ((0, 0), (1, 0), (0.49, -0.51), (0.5, -0.5), (-1.5, 2.25), (-30, 0), (0, 18), (0, 19)):
        given["motion"] = np.broadcast_to(np.float32([dx, dy, 9][:channels]), (height, width, channels)).copy()
        for ox, oy in np.ndindex(2, 2):
            _, evidence = check(given, offset=(ox, oy))
            want = np.zeros((3, 4))
            for y, x in np.ndindex(height, width):
                at_x, at_y = np.floor(x + dx + 0.5), np.floor(y + dy + 0.5)
                inside = 0 <= at_x < width and 0 <= at_y < height
                want[y // 8, x // 8] += inside and at_x % 2 == ox and at_y % 2 == oy
            np.testing.assert_array_equal(evidence[..., -1], want)


def cut(name, where):
    return lambda given: {name: given[name][where].copy()}


def put(**change):
    return lambda _: change


@pytest.mark.parametrize(
    ("match", "change"),
    [
        (r"^color: expected", cut("color", np.s_[..., :2])),
        (r"^candidates: expected", cut("candidates", np.s_[:-1])),
        (r"^candidates: expected", cut("candidates", np.s_[:, :-1])),
        (r"^candidates: expected 3 channels .*got 8", cut("candidates", np.s_[..., :8])),
        (r"^candidates: expected 3 channels .*at least 2.*got 3", cut("candidates", np.s_[..., :3])),
        (r"^motion: expected", cut("motion", np.s_[:-1])),
        (r"^motion: expected", cut("motion", np.s_[..., :1])),
        (r"^coverage: expected", cut("coverage", np.s_[:, :-1])),
        (r"^evidence: expected", cut("evidence", np.s_[:-1])),
        (r"^evidence: expected 5 channels, for 3 .*got 3", cut("evidence", np.s_[..., :3])),
        (r"^offset: expected 0 or 1, got 2", put(offset=(2, 0))),
        (r"^offset: expected 0 or 1, got -1", put(offset=(0, -1))),
        (r"^usual: expected a candidate, 0 to 2, got 3", put(usual=3)),
        (r"^usual: expected a candidate, 0 to 2, got -1", put(usual=-1)),
        *((r"^exposure: expected", put(exposure=value)) for value in (0, -1, np.nan, np.inf)),
        *((r"^strictness: expected", put(strictness=value)) for value in (-0.1, np.nan, np.inf)),
        *((r"^share: expected", put(share=value)) for value in (-0.1, 1.1, np.nan)),
    ],
)
def test_wrong_arguments(match, change):
    given = images(np.random.default_rng(0), 21, 35, 3)
    with pytest.raises(ValueError, match=match):
        yester.choice(**given | change(given))


# What SVGF makes of it.


def still(color, rng, *, shape=16.0):
    """A frame whose noise is relative to its light: of a quarter of it for a shape of 16."""
    return yester.Frame((color * rng.gamma(shape, 1 / shape, color.shape[:2])[..., None]).astype(np.float32))


def waves(height, width):
    """Fine detail that no buffer tells."""
    y, x = np.mgrid[:height, :width]
    return np.repeat((1 + 0.8 * np.sin(1.9 * x) * np.sin(1.7 * y))[..., None], 3, -1)


def halves(count):
    """Left, detail that no buffer tells, in little noise; right, an even wall in much. Truth, and frames."""
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
    """And that after a reset, to the bits of a pipeline that does not choose."""
    _, frames = halves(6)
    svgf = yester.SVGF(iterations=iterations)
    bare = yester.SVGF(iterations=iterations, choice=False).step(frames[0])
    for _ in range(2):
        first = svgf.step(frames[0])
        assert (first.choice == iterations).all()
        assert_same_bits(first.color, bare.color)
        assert_same_bits(first.variance, bare.variance)
        later = [svgf.step(frame).choice for frame in frames[1:]]
        assert not (later[-1] == iterations).all()
        assert min(image.min() for image in later) >= 0
        assert max(image.max() for image in later) <= min(iterations + 1, 16)
        svgf.reset()


def test_only_what_chooses_says_so():
    frame = yester.Frame(np.ones((20, 30, 3), np.float32), depth=np.ones((20, 30), np.float32))
    assert yester.SVGF().step(frame).choice.shape == (20, 30)
    for pipeline in (yester.SVGF(choice=False), yester.BMFR(), yester.HalfRes(), yester.TAA(), yester.Upscaler()):
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
    """Missing, black, and numbers whose squares overflow: what comes out is finite, and passes are in range."""
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


def test_what_is_missing_is_filled_as_usual():
    """A pixel that nobody has seen gets as many passes as without a choice, whatever its tile has chosen."""
    rng = np.random.default_rng(0)
    svgf, mixed = yester.SVGF(), []
    for _ in range(8):
        color = still(waves(40, 56), rng).color.copy()
        color[8:16, 8:24] = np.nan
        out = svgf.step(yester.Frame(color))
        unseen = out.history_length == 0
        assert (out.choice[unseen] == 3).all()
        assert out.color[unseen].all(), "it is filled"
        mixed.append((out.choice[8:16, 8:24][~unseen[8:16, 8:24]] < 2).any() and unseen.any())
    assert any(mixed)


def test_detail_gets_fewer_passes_and_noise_more():
    """Both gain."""
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


def test_mirrors_keep_what_they_show():
    """Candidates come along the motion of what is mirrored, as history does."""

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


def across_borders(images) -> float:
    """Mean step between columns of two tiles, or rows, relative to that between all others."""
    found = []
    for image in images:
        for axis in (0, 1):
            change = np.abs(np.diff(image, axis=axis)).mean((1 - axis, 2))
            border = np.arange(1, len(change) + 1) % SIDE == 0
            found.append([change[border].mean(), change[~border].mean()])
    border, other = np.mean(found, 0)
    return border / other


def test_tiles_do_not_show():
    """On a smooth scene in noise, of which some tiles get other numbers of passes than their neighbours."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:128, :160]
    truth = np.repeat((1 + 0.5 * np.sin(x / 25) * np.sin(y / 19))[..., None], 3, -1)
    outs = steps([still(truth, rng, shape=2.0) for _ in range(16)], antialias=False, innovation=False)[4:]
    assert np.mean([np.ptp(out.choice) for out in outs]) > 1
    assert across_borders([out.color for out in outs]) < 1.01
