"""Samples, denoised colour and result, mixed by triple collocation: the kernels and the output stage that uses them."""

from dataclasses import replace

import composed
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st
from reference.choice import around, together
from reference.collocation import PAIRS, details, errors, noise
from test_choice import carried, parts
from test_svgf import NAMES, twin
from torch.nn.functional import max_pool2d
from yester.metrics import relmse
from yester.study.synthetic import raycast

PRODUCTS = len(PAIRS)


def measured(rng, height, width, *, holes=0.0, grain=0.3):
    """Planes of one signal with noise, resampled and mixed in several ways."""
    truth = rng.exponential(1, (height, width)) * rng.choice([0, 1e-3, 1, 30], (height, width), p=[0.1, 0.1, 0.7, 0.1])
    planes = truth[..., None] * (1 + grain * rng.normal(size=(height, width, 5)))
    planes[..., 3] = rng.uniform(0, 1) * planes[..., 3] + rng.uniform(0, 0.5) * planes[..., 1]
    planes[..., 4] = rng.uniform(0, 1) * truth + 0.3 * rng.uniform() * planes[..., 3]
    planes[rng.random(planes.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    return planes.astype(np.float32)


def evidence_of(rng, height, width, *, holes=0.05):
    """Evidence as earlier frames may leave it, in part of fewer than 16 pixels."""
    evidence = yester.collocate(measured(rng, height, width, grain=rng.choice([0.01, 0.3, 2])))
    evidence *= rng.integers(0, 3, (*evidence.shape[:2], 1)).astype(np.float32)
    evidence[rng.random(evidence.shape) < holes / 10] = rng.choice([np.nan, np.inf, -np.inf])
    return evidence


def collocate_check(planes, evidence=None, *, exposure=1.0):
    """Compare with the reference, relative to the magnitude of the summed terms, which may cancel."""
    got = yester.collocate(planes, evidence, exposure=exposure)
    given = tensor([planes, evidence])
    want = reference.collocate(*given, exposure=exposure).numpy()
    assert got.dtype == np.float32
    detail, known = details(given[0])
    # What cancels in a detail: the largest of the nine.
    whole = given[0].abs().nan_to_num(0, posinf=0).movedim(-1, 0)
    size = max_pool2d(whole, 3, stride=1, padding=1).movedim(0, -1).where(known[..., None], 0)
    terms = together(torch_stack([size[..., a] * size[..., b] for a, b in PAIRS]) * known[..., None])
    _, n = together(detail), together(known[..., None].to(detail))
    energy = together(torch_stack([detail[..., a] ** 2 for a in (0, 1)])).sum(-1, keepdim=True)
    weight = (1 / (energy / n + (exposure / 1024) ** 2)).where(n > 0, 0)
    scale = np.concatenate([(weight * terms).numpy(), n.numpy()], -1)
    scale = scale * (1 + (weight * terms[..., [0]] / n).nan_to_num(0).numpy())
    if evidence is not None:
        scale = scale + np.where(np.isfinite(evidence), np.abs(evidence), 0).max((0, 1))
    assert_close("collocate", got, want, rtol=1e-6, scale=scale)
    return got


def torch_stack(images):
    return tensor(np.stack([image.numpy() for image in images], -1))


def shares_check(evidence, motion, coverage, *, share=0.2):
    """Compare evidence with the reference; shares must have as little error, by the reference, as its own."""
    got, left = yester.collocation_shares(evidence, motion, coverage, share=share)
    want, known = reference.collocation_shares(*tensor([evidence, motion, coverage]), share=share)
    assert got.dtype == left.dtype == np.float32
    scale = np.where(np.isfinite(evidence), np.abs(evidence), 0).max((0, 1))
    assert_close("collocation evidence", left, known.numpy(), rtol=1e-6, scale=scale)
    assert ((got >= 0) & (got <= 1)).all()
    mean, mine = around(known), tensor(got)
    n = mean[..., 13]
    decided = (n >= 16 + 1e-3).numpy()
    assert not got[(n < 16 - 1e-3).numpy()].any()
    # A reduction by noise that is of the size of roundings turns everything: signal and noise must be well known.
    energy = mean[..., :PRODUCTS].abs().amax(-1)
    factor = noise(mean)[1].abs()
    slack = (2e-5 * energy * (1 + factor)).numpy()
    alone, mixed = (error.numpy() for error in errors(mean, *mine.unbind(-1)))
    best, _ = (error.numpy() for error in errors(mean, *want.unbind(-1)))
    _, least = (error.numpy() for error in errors(mean, mine[..., 0], second_best(mean, mine[..., 0])))
    assert (alone <= best + slack)[decided].all()
    assert (mixed <= least + slack)[decided].all()
    return got, left


def second_best(mean, first):
    """The share of samples with the least error, of a hundred."""
    shares = tensor(np.linspace(0, 1, 101))
    candidates = [errors(mean, first, share.expand(first.shape))[1] for share in shares]
    return shares[torch_stack(candidates).argmin(-1)]


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    exposure=st.sampled_from([1e-2, 1.0, 30.0]),
    known=st.booleans(),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference_of_products(seed, size, exposure, known, holes):
    rng = np.random.default_rng(seed)
    evidence = evidence_of(rng, *size, holes=holes) if known else None
    collocate_check(measured(rng, *size, holes=holes), evidence, exposure=exposure)


@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    share=st.sampled_from([0.0, 0.2, 1.0]),
    channels=st.sampled_from([2, 3]),
    holes=st.sampled_from([0.0, 0.05, 0.8]),
)
def test_reference_of_shares(seed, size, share, channels, holes):
    rng = np.random.default_rng(seed)
    given = carried(rng, *size, 3, channels=channels) | {"evidence": evidence_of(rng, *size, holes=holes)}
    shares_check(**given, share=share)


def test_shares_of_anything():
    rng = np.random.default_rng(0)
    shares = at_rest(rng.normal(0, 30, (40, 40, 14)).astype(np.float32), (320, 320))
    assert ((shares >= 0) & (shares <= 1)).all()


@each("size", [*SIZES, *TAILS, (3, 160), (4, 161), (2, 319), (5, 322), (33, 47)])
def test_sizes(size):
    rng = np.random.default_rng(size[1])
    evidence = collocate_check(measured(rng, *size))
    assert evidence.shape == (*parts(8, *size), 14)
    shares_check(evidence, np.zeros((*size, 2), np.float32), np.ones(size, np.float32))


def at_rest(evidence, size=(64, 64)):
    return yester.collocation_shares(evidence, np.zeros((*size, 2)), np.ones(size))[0]


def still(rng, grain, *results, frames=8):
    """Shares after some frames of an image with noise that does not move, and of results of it."""
    truth, evidence = np.exp(rng.normal(0, 0.5, (64, 64))), None
    for _ in range(frames):
        noisy = [truth + grain * rng.normal(size=truth.shape) for _ in range(3)]
        evidence = yester.collocate(np.dstack([*noisy, *(result(truth, noisy[1]) for result in results)]), evidence)
    return at_rest(evidence), evidence


def blurred(truth, _):
    return (truth + sum(np.roll(truth, by, axis) for by in (-1, 1) for axis in (0, 1))) / 5


@pytest.mark.parametrize("grain", [0.02, 0.1, 0.5])
def test_noise_is_told_from_detail(grain):
    """However much detail there is."""
    _, evidence = still(np.random.default_rng(0), grain, blurred, blurred, frames=30)
    found, _ = noise(around(tensor(evidence)))
    # The detail of white noise is 8/9 of it; the products are relative to those of two frames.
    truth = np.random.default_rng(0).normal(0, 0.5, (64, 64))
    unit = (evidence[..., 3] / evidence[..., 13]).mean()
    detail, _ = details(tensor(np.dstack([np.exp(truth)] * 5)))
    share = (grain**2 * 8 / 9) / (grain**2 * 8 / 9 + float((detail[..., 0] ** 2).mean()))
    assert (found / tensor(evidence[..., 13])).mean() / unit == pytest.approx(share, rel=0.15)


def test_the_better_result_is_shown():
    """The truth before a blurred image, in either place; the mean of two equal errors."""
    rng = np.random.default_rng(1)
    known = lambda truth, _: truth  # noqa: E731
    assert still(rng, 0.1, known, blurred)[0][..., 0].min() > 0.9
    assert still(rng, 0.1, blurred, known)[0][..., 0].max() < 0.1
    noises = [rng.normal(0, 0.2, (64, 64)) for _ in range(2)]
    apart = [lambda truth, _, more=more: truth + more for more in noises]
    assert still(rng, 0.1, *apart)[0][..., 0].mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("grain", [0.01, 0.1, 0.3])
def test_samples_are_shown_where_the_result_is_worse(grain):
    """Wiener's share: the result's error against that of the samples."""
    rng = np.random.default_rng(2)
    for wrong in (0.02, 0.1, 0.5):
        more = rng.normal(0, wrong, (64, 64))
        shares, _ = still(rng, grain, *[lambda truth, _, more=more: truth + more] * 2)
        assert shares[..., 1].mean() == pytest.approx(wrong**2 / (wrong**2 + grain**2), abs=0.12)


def test_a_result_made_of_the_samples():
    """Half of the samples' noise is the result's own; with as much of its own, neither is better than the samples."""
    rng = np.random.default_rng(3)
    more = rng.normal(0, 0.1, (64, 64))
    shares, _ = still(rng, 0.1, *[lambda truth, noisy: 0.5 * (truth + noisy) + more] * 2)
    # Errors: of the result 1.25, of the samples 1, shared 0.5, in units of the noise.
    assert shares[..., 1].mean() == pytest.approx(0.75 / 1.25, abs=0.12)


@pytest.mark.parametrize("power", [-20, -1, 1, 20])
def test_brightness_changes_no_bit(power):
    planes = measured(np.random.default_rng(0), 40, 56)
    scale = np.float32(2.0**power)
    assert_same_bits(yester.collocate(planes * scale, exposure=float(scale)), yester.collocate(planes))


def test_frames_add_up():
    one, two = (measured(np.random.default_rng(seed), 40, 56) for seed in (0, 1))
    together = yester.collocate(two, yester.collocate(one))
    np.testing.assert_allclose(together, yester.collocate(one) + yester.collocate(two), rtol=1e-5, atol=1e-4)


def test_pixels_whose_neighbours_are_known_count():
    planes = measured(np.random.default_rng(0), 24, 24)
    whole = yester.collocate(planes)
    np.testing.assert_array_equal(whole[..., 13], [[49, 56, 49], [56, 64, 56], [49, 56, 49]])
    for plane in range(5):
        for value in (np.nan, np.inf, -np.inf):
            broken = planes.copy()
            broken[11, 11, plane] = value
            found = yester.collocate(broken)
            assert found[1, 1, 13] == 55
            found[1, 1] = whole[1, 1]
            assert_same_bits(found, whole)


def test_black_says_nothing():
    evidence = yester.collocate(np.zeros((24, 24, 5)))
    assert not evidence[..., :PRODUCTS].any()
    assert not at_rest(evidence, (24, 24)).any()


def test_flat_planes_with_noise_show_the_result():
    rng = np.random.default_rng(4)
    evidence = None
    for _ in range(8):
        noisy = 1 + 0.3 * rng.normal(size=(64, 64, 3))
        evidence = yester.collocate(np.dstack([noisy, np.ones((64, 64, 2))]), evidence)
    assert at_rest(evidence)[..., 1].mean() < 0.05


def test_a_tile_that_keeps_a_lamp_does_not_decide():
    """A result that is right but for a lamp that has left one tile is not the worse one for all tiles together."""
    rng = np.random.default_rng(2)
    truth = rng.random((64, 64)).astype(np.float32)
    samples = truth[..., None] + rng.normal(size=(64, 64, 3))
    worse, better = truth + rng.normal(size=truth.shape) / 2, truth.copy()
    better[12, 20] += 1e3
    evidence = yester.collocate(np.dstack([samples, worse, better]))
    assert composed.share_of_all(evidence)[0] < 0.25


@pytest.mark.parametrize("plane", range(5))
@pytest.mark.parametrize("bright", [1e4, 1e18, 1e25])
def test_a_flash_does_not_decide_for_long(plane, bright):
    """Once it is in samples, once in those before, and once in a result: each time, it weighs as one frame."""
    rng = np.random.default_rng(3)
    truth = rng.random((64, 64, 1))
    evidence = None
    for t in range(40):
        noisy = truth + rng.normal(size=(64, 64, 3))
        planes = np.dstack([noisy, truth, truth + rng.normal(size=truth.shape) / 2])
        if t == 4:
            planes[..., plane] += bright * rng.normal(size=(64, 64))
        _, evidence = yester.collocation_shares(
            yester.collocate(planes, evidence), np.zeros((64, 64, 2)), np.ones((64, 64))
        )
    first, samples = np.moveaxis(at_rest(evidence), -1, 0)
    assert first.mean() > 0.8
    assert samples.mean() < 0.1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_evidence_that_is_not_finite_is_none(value):
    evidence = yester.collocate(measured(np.random.default_rng(0), 40, 56))
    for channel in range(14):
        broken = evidence.copy()
        broken[2, 3, channel] = value
        shares, left = yester.collocation_shares(broken, np.zeros((40, 56, 2)), np.ones((40, 56)), share=0.0)
        assert not left[2, 3].any()
        assert np.isfinite(left).all()
        assert np.isfinite(shares).all()


def test_fifteen_pixels_decide_nothing():
    evidence = np.ones((1, 1, 14), np.float32)
    evidence[..., [8, 11]] = 4
    for n, decides in ((15.9, False), (16.1, True)):
        evidence[..., 13] = n
        shares, _ = yester.collocation_shares(evidence, np.zeros((8, 8, 2)), np.ones((8, 8)), share=0.0)
        assert bool(shares.any()) == decides


def put(**change):
    return lambda _: change


@pytest.mark.parametrize(
    ("match", "change"),
    [
        (r"^planes: expected", lambda given: {"planes": given["planes"][..., :4]}),
        (r"^evidence: expected", lambda given: {"evidence": given["evidence"][:-1]}),
        (r"^evidence: expected", lambda given: {"evidence": given["evidence"][..., :13]}),
        *((r"^exposure: expected", put(exposure=value)) for value in (0, -1, np.nan, np.inf)),
    ],
)
def test_wrong_arguments_of_products(match, change):
    planes = measured(np.random.default_rng(0), 21, 35)
    given = {"planes": planes, "evidence": yester.collocate(planes)}
    with pytest.raises(ValueError, match=match):
        yester.collocate(**given | change(given))


@pytest.mark.parametrize(
    ("match", "change"),
    [
        (r"^evidence: expected", lambda given: {"evidence": given["evidence"][:-1]}),
        (r"^evidence: expected", lambda given: {"evidence": given["evidence"][..., :13]}),
        (r"^motion: expected", lambda given: {"motion": given["motion"][..., :1]}),
        (r"^coverage: expected", lambda given: {"coverage": given["coverage"][:, :-1]}),
        *((r"^share: expected", put(share=value)) for value in (-0.1, 1.1, np.nan)),
    ],
)
def test_wrong_arguments_of_shares(match, change):
    rng = np.random.default_rng(0)
    given = carried(rng, 21, 35, 3) | {"evidence": evidence_of(rng, 21, 35)}
    with pytest.raises(ValueError, match=match):
        yester.collocation_shares(**given | change(given))


# Within the output stage.


def sampled(count: int, *, grain=0.05, size=(96, 72)):
    """Antialiased frames with noise, and what they would be without."""
    rng = np.random.default_rng(3)
    for number in range(count):
        shot = flight.shoot(number, *size)
        clean = raycast.truth(flight.scene(number, shot.camera), 4)
        color = clean * (1 + grain * rng.standard_normal((*shot.shape, 1)))
        yield replace(shot, color=color.astype(np.float32)), clean


def with_fireflies(frame, number, *, share=0.002, factor=1e4):
    color, rng = frame.color.copy(), np.random.default_rng(number)
    color[rng.random(frame.shape) < share] *= factor
    return replace(frame, color=color)


def test_fireflies_among_many_samples_are_their_kernels():
    """No sample is mixed in, or judges, for more than eight times the result."""
    svgf, other = yester.SVGF(), composed.SVGF()
    for number, (frame, _) in enumerate(sampled(9)):
        spoiled = with_fireflies(frame, number)
        assert_same_bits(svgf.step(spoiled).color, other.step(spoiled).color)


def test_frames_of_known_jitter_are_their_kernels():
    """However little noise they have, tiles must ask before they show it."""
    svgf, other, plain = yester.SVGF(), composed.SVGF(), yester.SVGF()
    differs = 0
    for frame, _ in sampled(9):
        got = svgf.step(replace(frame, jitter=(0.25, -0.125))).color
        assert_same_bits(got, other.step(replace(frame, jitter=(0.25, -0.125))).color)
        differs += (got != plain.step(frame).color).any()
    assert differs > 0


def test_frames_of_many_samples_are_their_kernels():
    svgf, other = yester.SVGF(), composed.SVGF()
    plain = composed.SVGF(choice=True)
    plain.stage = plain.stage | {"choice": False}
    asked = 0
    for frame, _ in sampled(9):
        got, want = svgf.step(frame).color, other.step(frame).color
        assert_same_bits(got, want)
        asked += (want != plain.step(frame).color).mean() > 0.5
    assert asked >= 5


def test_missing_samples_show_the_denoised_share():
    """Where a tile mixes three images and the sample is missing, the other two are still mixed."""
    mixing, plain, other = yester.SVGF(), yester.SVGF(), composed.SVGF()
    plain = (plain.split()[0], yester.TAA("denoised", innovation=True, choice=False))
    found = 0
    for number, (frame, _) in enumerate(sampled(9)):
        color = frame.color.copy()
        missing = np.random.default_rng(number).random(frame.shape) < 0.02
        color[missing] = np.nan
        frame = replace(frame, color=color)
        got = mixing.step(frame).color
        assert_same_bits(got, other.step(frame).color)
        smooth = replace(frame, color=plain[0].step(frame).color)
        found += (got != plain[1].step(smooth, samples=color).color).any(-1)[missing].sum()
    assert found > 100


@pytest.mark.parametrize(("share", "rtol"), [(0, 1e-4), (0.03, 1e-3)])
def test_frames_of_many_samples_against_the_reference(share, rtol):
    """Samples that are 30 times too bright are shown, and judge, with less."""
    svgf, other = yester.SVGF(reflections=()), reference.SVGF()
    for number, (clean, _) in enumerate(sampled(7, size=(48, 40))):
        frame = with_fireflies(clean, number, share=share, factor=30)
        given = {name: getattr(frame, name) for name in ("color", *NAMES)}
        got, want = svgf.step(yester.Frame(**given)).color, other.step(twin(given)).color
        where = {"where": np.ones(frame.shape, bool), "flips": 48 * 40 // 200}
        assert_close("frames of many samples", got, want, rtol=rtol, **where)


@pytest.mark.parametrize("method", [yester.SVGF, yester.BMFR])
def test_frames_of_many_samples_keep_what_they_have(method):
    """Antialiased frames with little noise: the output stage alone makes them worse than they came."""
    errors = []
    whole = method()
    denoiser, _ = whole.split() if method is yester.SVGF else (method(antialias=False), None)
    stages = {"mixed": whole, "not mixed": (denoiser, yester.TAA("denoised", innovation=True, choice=False))}
    for frame, clean in sampled(12):
        shown = {"noisy": frame.color, "mixed": stages["mixed"].step(frame).color}
        denoiser, stage = stages["not mixed"]
        smooth = replace(frame, color=denoiser.step(frame).color)
        shown["not mixed"] = stage.step(smooth, samples=frame.color).color
        errors.append({name: relmse(image, clean) for name, image in shown.items()})
    mean = {name: np.mean([error[name] for error in errors[6:]]) for name in errors[0]}
    assert mean["not mixed"] > mean["noisy"], "the stage harms these frames"
    assert mean["mixed"] < 0.6 * mean["not mixed"]


def test_tiles_without_samples_show_denoised_colour():
    """Where one tile in eight shows samples, frames have little noise, and each tile's own evidence decides."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:96, :192]
    left, edge = (x < 152)[..., None], x[0] >= 176
    motion = np.broadcast_to(np.float32([0.5, 0]), (96, 192, 2))
    mixing, *plain = [
        yester.TAA("denoised", choice=choice, smooth_edges=smooth_edges)
        for choice, smooth_edges in ((True, True), (False, True), (False, False))
    ]
    other = composed.Mixing()
    errors = []
    for number in range(14):
        truth = 2 + np.sin(1.9 * (x + 0.5 * number))[..., None] * np.cos(1.7 * y)[..., None] * np.ones(3)
        noise = rng.standard_normal((96, 192, 3))
        # To the left, denoised detail is inverted, and samples show it; to the right, denoised colour is right.
        samples = (truth + np.where(left, 0.02, 1.0) * noise).astype(np.float32)
        smooth = np.where(left, 4 - truth, truth).astype(np.float32)
        frame = yester.Frame(smooth, motion=motion)
        shown, smoothed, result = (stage.step(frame, samples=samples).color for stage in (mixing, *plain))
        given = {"exposure": yester.exposure(smooth), "repeats": False, "aliased": False}
        assert_same_bits(shown, other.mix(samples, smooth, motion, result, smoothed, **given))
        errors.append([relmse(image[:, edge], truth[:, edge]) for image in (shown, smoothed)])
    mixed, alone = np.mean(errors[7:], 0)
    assert mixed < 0.2 * alone


def test_noise_keeps_the_output_stage():
    """In frames of one sample, all tiles show the output stage's result."""
    mixing, plain = yester.SVGF().split()[1], yester.TAA("denoised", innovation=True, choice=False)
    denoiser = yester.SVGF(antialias=False)
    for buffers in composed.sequence(10, holes=False):
        frame = yester.Frame(**buffers)
        smooth = replace(frame, color=denoiser.step(frame).color)
        images = [stage.step(smooth, samples=frame.color).color for stage in (mixing, plain)]
        assert_same_bits(*images)
