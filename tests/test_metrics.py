import subprocess
import sys

import flip_evaluator
import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio
from yester import metrics
from yester.metrics import (
    METRICS,
    Picture,
    edge_sharpness,
    flicker,
    flip,
    flip_map,
    ghost,
    lag,
    metric,
    psnr,
    relmse,
    smape,
    srgb,
    ssim,
    temporal_error,
    tpsnr,
    warped_error,
)

OF_PAIRS = [psnr, relmse, smape, ssim, flip, flip_map, edge_sharpness]


def linear(encoded: np.ndarray) -> np.ndarray:
    """Linear values that `srgb` encodes as these."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def grey(encoded: np.ndarray) -> np.ndarray:
    """A linear grey image of encoded values (H, W)."""
    return linear(np.repeat(np.asarray(encoded, float)[..., np.newaxis], 3, axis=2))


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    """An HDR image and its reference: a fifth of the values is above 1, and noise makes some negative."""
    rng = np.random.default_rng(7)
    reference = rng.gamma(1.0, 0.6, (37, 53, 3)).astype(np.float32)
    return reference + rng.normal(0, 0.1, reference.shape).astype(np.float32), reference


def test_srgb_is_the_standard_curve():
    linear = np.array([-1, 0, 0.0031308, 0.18, 0.5, 1, 40])
    expected = [0, 0, 0.04044994, 0.46135613, 0.73535698, 1, 1]
    np.testing.assert_allclose(srgb(linear), expected, atol=1e-7)


def test_srgb_has_no_step_at_its_knee():
    below, above = srgb(0.0031308), srgb(np.nextafter(0.0031308, 1))
    assert abs(above - below) < 1e-6


def test_psnr_agrees_with_scikit_image(pair):
    image, reference = pair
    expected = peak_signal_noise_ratio(srgb(reference), srgb(image), data_range=1.0)
    assert psnr(image, reference) == pytest.approx(expected, abs=1e-9)


def test_psnr_by_hand():
    # Encoded values of 0 and 12.92e-3: the error is their square.
    assert psnr(np.full((2, 2, 3), 1e-3), np.zeros((2, 2, 3))) == pytest.approx(-20 * np.log10(12.92e-3))


def test_psnr_ignores_values_out_of_display_range():
    assert psnr(np.full((1, 1, 3), 5.0), np.full((1, 1, 3), 2.0)) == float("inf")


def test_relmse_by_hand():
    image, reference = np.zeros((1, 2, 3)), np.zeros((1, 2, 3))
    reference[0, 0] = 0.3
    image[0, 1, 2] = 0.1
    # Of six values, three miss 0.3 in one pixel, and one exceeds 0 by 0.1 in the other.
    assert relmse(image, reference) == pytest.approx((3 * 0.09 / 0.10 + 0.01 / 0.01) / 6)


def test_double_precision_counts():
    assert relmse(np.full((1, 1, 3), 1 + 1e-9), np.ones((1, 1, 3))) == pytest.approx(1e-18 / 1.01, rel=1e-6, abs=0)


def test_relmse_is_not_symmetric():
    one, two = np.full((1, 1, 3), 1.0), np.full((1, 1, 3), 2.0)
    assert relmse(one, two) == pytest.approx(1 / 4.01)
    assert relmse(two, one) == pytest.approx(1 / 1.01)


def test_smape_by_hand():
    image, reference = np.zeros((1, 2, 3)), np.zeros((1, 2, 3))
    reference[0, 0] = 0.3
    image[0, 1, 2] = -0.1
    expected = (3 * 0.3 / 0.301 + 0.1 / 0.101) / 6
    assert smape(image, reference) == pytest.approx(expected)
    assert smape(reference, image) == pytest.approx(expected)


def test_smape_counts_a_firefly_once():
    reference, image = np.ones((1, 4, 3)), np.ones((1, 4, 3))
    image[0, 0] = 1e6
    assert smape(image, reference) == pytest.approx(0.25, rel=1e-5)


def test_ssim_by_hand():
    """In 11×11 pixels only one window lies inside, around the centre."""
    rng = np.random.default_rng(5)
    x, y = rng.random((2, 11, 11, 3))
    falloff = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    weight = np.outer(falloff, falloff)[..., np.newaxis] / falloff.sum() ** 2

    def mean(values):
        return (weight * values).sum((0, 1))

    covariance = mean(x * y) - mean(x) * mean(y)
    variances = mean(x * x) - mean(x) ** 2 + mean(y * y) - mean(y) ** 2
    light = (2 * mean(x) * mean(y) + 1e-4) / (mean(x) ** 2 + mean(y) ** 2 + 1e-4)
    expected = np.mean(light * (2 * covariance + 9e-4) / (variances + 9e-4))
    assert ssim(linear(x), linear(y)) == pytest.approx(expected, abs=1e-6)


def test_ssim_of_equal_and_of_opposite_images(pair):
    assert ssim(pair[1], pair[1]) == 1
    black_and_white = np.indices((16, 16)).sum(0) % 2
    assert ssim(grey(black_and_white), grey(1 - black_and_white)) < -0.9


@pytest.mark.parametrize("shape", [(10, 40, 3), (40, 10, 3)])
def test_ssim_names_images_smaller_than_its_window(shape):
    with pytest.raises(ValueError, match=r"^image: SSIM needs at least 11×11 pixels, got shape \(\d0, \d0, 3\)"):
        ssim(np.zeros(shape), np.zeros(shape))


def test_edge_sharpness_by_hand():
    """A step, and the step filtered by a box of three pixels: its two columns are two thirds as steep."""
    step = np.tile([0, 0, 0, 0, 1, 1, 1, 1], (6, 1))
    blurred = np.tile([0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1], (6, 1))
    assert edge_sharpness(grey(blurred), grey(step), 0.3) == pytest.approx(2 / 3)
    assert edge_sharpness(grey(blurred.T), grey(step.T), 0.3) == pytest.approx(2 / 3)


@pytest.mark.parametrize("contrast", [-1, 0, 0.5, 1, 1.5])
def test_edge_sharpness_is_contrast_at_the_edges(contrast):
    reference = np.random.default_rng(2).uniform(0.3, 0.7, (20, 30))
    image = 0.5 + contrast * (reference - 0.5)
    assert edge_sharpness(grey(image), grey(reference)) == pytest.approx(contrast)


def test_edge_sharpness_counts_the_steepest():
    """One half of the image has a weak texture that is lost, the other strong edges that are kept."""
    stripes = np.tile(np.arange(32) // 2 % 2, (16, 1))
    reference = np.where(np.arange(32) < 16, 0.1, 0.8) * stripes
    image = np.where(np.arange(32) < 16, 0, reference)
    assert edge_sharpness(grey(image), grey(reference)) == pytest.approx(1)
    assert edge_sharpness(grey(image), grey(reference), share=1) < 0.99


@pytest.mark.parametrize(("variance", "expected"), [(1, 0.80), (10, 0.29)])
def test_edge_sharpness_under_noise(variance, expected):
    """A sharp edge with noise in proportion to its light looks blurred, as its display values are clipped."""
    rng = np.random.default_rng(0)
    reference = np.tile(np.where(np.arange(96) < 48, 0.08, 0.6), (1024, 1))
    noisy = reference * rng.gamma(1 / variance, variance, reference.shape)
    assert edge_sharpness(*(np.dstack([image] * 3) for image in (noisy, reference))) == pytest.approx(
        expected, abs=0.02
    )


def test_edge_sharpness_of_few_pixels():
    """This fraction of four inner pixels is less than one pixel: the steepest, at the lower right."""
    reference = np.zeros((4, 4))
    reference[3, 2], reference[1, 0] = 0.8, 0.1
    image = np.where(reference > 0.5, 0.4, 0)
    assert edge_sharpness(grey(image), grey(reference)) == pytest.approx(0.5)


def test_edge_sharpness_sees_colour_as_luminance():
    """A green edge is steeper than a blue one: the steepest tenth of the pixels is where green begins."""
    reference = np.zeros((12, 22, 3))
    reference[:, 11:, 1] = reference[:, 16:, 2] = 1
    assert edge_sharpness(reference * (1, 1, 0), reference, 0.1) == pytest.approx(1)
    assert edge_sharpness(reference * (1, 0, 1), reference, 0.1) == pytest.approx(0, abs=1e-12)


def test_edge_sharpness_averages_noise_out():
    rng = np.random.default_rng(4)
    reference = np.tile(0.3 + 0.4 * (np.arange(200) // 4 % 2), (200, 1))
    assert edge_sharpness(grey(reference + rng.normal(0, 0.05, reference.shape)), grey(reference)) == pytest.approx(
        1, abs=0.01
    )


@pytest.mark.parametrize("share", [0, -0.1, 1.1, np.nan])
def test_edge_sharpness_names_a_share_out_of_range(share, pair):
    with pytest.raises(ValueError, match=r"^share: expected above 0 and up to 1, got"):
        edge_sharpness(*pair, share)


def test_edge_sharpness_needs_edges():
    image = np.ones((3, 3, 3))
    with pytest.raises(ValueError, match=r"^reference: expected edges, got the same luminance"):
        edge_sharpness(image, image)
    with pytest.raises(ValueError, match=r"^image: edges need at least 3×3 pixels, got shape \(2, 3, 3\)"):
        edge_sharpness(image[:2], image[:2])


def test_flip_agrees_with_its_evaluator(pair):
    image, reference = (np.ascontiguousarray(srgb(x), np.float32) for x in pair)
    errors, mean, _ = flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)
    np.testing.assert_array_equal(flip_map(*pair), errors[..., 0])
    assert flip(*pair) == pytest.approx(mean, rel=1e-5)


def test_flip_of_black_and_white():
    black, white = np.zeros((16, 16, 3)), np.ones((16, 16, 3))
    assert flip(black, white) > 0.9
    assert flip_map(black, white).shape == (16, 16)


@pytest.mark.parametrize("measure", [relmse, smape, flip])
def test_equal_images_have_no_error(measure, pair):
    assert measure(pair[1], pair[1]) == 0


def test_equal_images_have_infinite_psnr(pair):
    assert psnr(pair[1], pair[1]) == float("inf")


@pytest.mark.parametrize("measure", [psnr, relmse, smape, ssim, flip, edge_sharpness])
def test_layout_and_type_do_not_matter(measure, pair):
    image, reference = pair
    wide = np.repeat(image.astype(np.float64), 2, axis=1)[:, ::2]
    assert measure(wide, np.asfortranarray(reference)) == measure(image, reference)
    assert measure(image.tolist(), reference) == measure(image, reference)


def test_temporal_error_by_hand():
    # Encoded, the image rises by 12.92e-3 in one value of twelve, and its reference falls by as much in another.
    black = np.zeros((2, 2, 3))
    image, reference_before = black.copy(), black.copy()
    image[0, 1, 2] = reference_before[1, 0, 0] = 1e-3
    assert temporal_error(image, black, black, reference_before) == pytest.approx(12.92e-3 * np.sqrt(2 / 12))


def test_temporal_error_of_independent_noise():
    """For a static reference, the noise of each of the two frames adds."""
    rng = np.random.default_rng(3)
    still = np.full((64, 64, 3), 0.5)
    frames = still + rng.normal(0, 0.01, (2, *still.shape))
    expected = np.sqrt(sum(np.mean((srgb(frame) - srgb(still)) ** 2) for frame in frames))
    assert temporal_error(*frames, still, still) == pytest.approx(expected, rel=0.02)


def test_temporal_error_ignores_constant_errors(pair):
    image, reference = pair
    assert temporal_error(image, image, reference, reference) == 0
    assert temporal_error(reference, image, reference, image) == 0


def test_temporal_error_knows_its_arguments(pair):
    """Exchanging images and references, or new and old, changes nothing; exchanging one pair does."""
    image, reference = pair
    images = [image, reference, image**2, np.roll(reference, 1, axis=0)]
    first = temporal_error(*images)
    assert temporal_error(*images[2:], *images[:2]) == pytest.approx(first)
    assert temporal_error(images[1], images[0], images[3], images[2]) == pytest.approx(first)
    assert temporal_error(images[0], images[3], images[2], images[1]) != pytest.approx(first, rel=1e-3)


@pytest.mark.parametrize("position", range(4))
def test_temporal_error_names_bad_input(position):
    name = ["image", "before", "reference", "reference_before"][position]
    images = [np.zeros((4, 5, 3)) for _ in range(4)]
    images[position] = np.zeros((4, 5))
    with pytest.raises(ValueError, match=rf"^{name}: expected shape \(H, W, 3\), got \(4, 5\)"):
        temporal_error(*images)
    images[position] = np.zeros((4, 5, 3))
    images[position][1, 2, 0] = np.nan
    with pytest.raises(ValueError, match=rf"^{name}: 1 of 60 values are not finite"):
        temporal_error(*images)
    images[position] = np.zeros((5, 4, 3))
    odd = "image" if name == "reference" else name
    with pytest.raises(ValueError, match=rf"^{odd}: expected the shape of reference, \("):
        temporal_error(*images)


def test_tpsnr_is_the_psnr_of_differences(pair):
    image, reference = pair
    images = [srgb(x) for x in (image, image**2, reference, np.roll(reference, 1, axis=0))]
    expected = peak_signal_noise_ratio(images[2] - images[3], images[0] - images[1], data_range=1.0)
    assert tpsnr(*(linear(x) for x in images)) == pytest.approx(expected, abs=1e-6)
    assert tpsnr(image, image, reference, reference) == float("inf")


def test_warped_error_follows_motion(pair):
    """After motion by whole pixels the images match, but for pixels that came in from outside."""
    before = pair[1]
    image = np.roll(before, (2, -3), axis=(0, 1))
    motion = np.full((*image.shape[:2], 2), (3, -2), np.float32)
    assert warped_error(image, before, motion) == 0
    assert warped_error(image, before, np.dstack([motion, np.ones(image.shape[:2], np.float32)])) == 0
    assert warped_error(image, before, -motion) > 0.1
    assert warped_error(before, before, motion) > 0.1


def test_warped_error_by_hand():
    """Between two pixels of 0.2 and 0.6 lies 0.4, encoded; only the first of three columns has two such neighbours."""
    before, image = (grey([encoded]) for encoded in ([0.2, 0.6, 0.6], [0.5, 0.6, 1]))
    motion = np.full((1, 3, 2), (0.5, 0))
    assert warped_error(image, before, motion, np.array([[True, False, True]])) == pytest.approx(0.1, abs=1e-6)
    assert warped_error(image, before, motion) == pytest.approx(np.sqrt(0.01 / 2), abs=1e-6)


def test_warped_error_counts_whole_footprints_whatever_their_rounding():
    """For every fraction of a pixel: one fraction differs from those of all other inner pixels."""
    before, inner = np.zeros((40, 50, 3)), np.zeros((40, 50), bool)
    inner[1:-1, 1:-1] = True
    image = before.copy()
    image[20, 20] = 1
    motion = np.random.default_rng(8).uniform(-1, 1, (40, 50, 2))
    assert warped_error(image, before, motion, inner) == pytest.approx(np.sqrt(1 / inner.sum()))


def test_warped_error_leaves_out_pixels_without_motion(pair):
    image, before = pair
    motion = np.zeros((*image.shape[:2], 2))
    assert warped_error(image, before, motion) == pytest.approx(10 ** (-psnr(image, before) / 20), rel=1e-6)
    unlike = np.any(image != before, axis=-1)
    motion[unlike] = np.nan
    image[0, 0] = before[0, 0]
    motion[0, 0] = 0
    assert warped_error(image, before, motion) == 0


def test_warped_error_names_bad_input(pair):
    image, before = pair
    shape = image.shape[:2]
    motion = np.zeros((*shape, 2))
    with pytest.raises(ValueError, match=r"^motion: expected shape \(37, 53, 2\) or \(37, 53, 3\), got \(53, 37, 2\)"):
        warped_error(image, before, motion.swapaxes(0, 1))
    with pytest.raises(ValueError, match=r"^before: expected the shape of image, \(37, 53, 3\), got \(36, 53, 3\)"):
        warped_error(image, before[1:], motion)
    with pytest.raises(TypeError, match=r"^valid: expected bool, got float64"):
        warped_error(image, before, motion, np.ones(shape))
    with pytest.raises(ValueError, match=r"^valid: expected shape \(37, 53\), got \(53, 37\)"):
        warped_error(image, before, motion, np.ones(shape[::-1], bool))
    with pytest.raises(ValueError, match=r"^valid: expected at least one true pixel"):
        warped_error(image, before, motion, np.zeros(shape, bool))
    with pytest.raises(ValueError, match=r"^valid: expected a pixel whose previous position"):
        warped_error(image, before, motion + 100)


def test_flicker_by_hand():
    """One value of twelve is 0.1, 0.4 and 0.4: squares of 0.2, 0.1 and 0.1, with two degrees of freedom."""
    images = np.zeros((3, 2, 2, 3))
    images[:, 1, 0, 2] = linear(np.array([0.1, 0.4, 0.4]))
    assert flicker(images) == pytest.approx(np.sqrt(0.06 / 2 / 12))
    assert flicker(image for image in images) == flicker(images)
    assert flicker(images, np.array([[False, False], [True, False]])) == pytest.approx(np.sqrt(0.06 / 2 / 3))
    assert flicker(images, np.array([[True, True], [False, True]])) == 0


def test_flicker_is_the_noise_at_every_length():
    images = (
        grey(np.random.default_rng(6).normal(0.5, 0.02, (40 * 40, 12))).reshape(40, 40, 12, 3).transpose(2, 0, 1, 3)
    )
    assert flicker(images) == pytest.approx(0.02, rel=0.03)
    assert flicker(images[:2]) == pytest.approx(0.02, rel=0.03)


def test_flicker_ignores_constant_errors(pair):
    assert flicker([pair[0]] * 5) == 0


def test_flicker_names_bad_input(pair):
    image, other = pair
    with pytest.raises(ValueError, match=r"^images: expected at least 2, got 1"):
        flicker([image])
    with pytest.raises(ValueError, match=r"^images: expected at least 2, got 0"):
        flicker([])
    with pytest.raises(ValueError, match=r"^images\[2\]: expected the shape of images\[0\], \(37, 53, 3\), got"):
        flicker([image, other, other[1:]])
    with pytest.raises(ValueError, match=r"^images\[1\]: 1 of 5883 values are not finite"):
        flicker([image, np.where(np.arange(other.size).reshape(other.shape) == 5, np.nan, other)])
    with pytest.raises(ValueError, match=r"^images\[0\]: expected shape \(H, W, 3\), got \(53, 3\)"):
        flicker(image)
    with pytest.raises(ValueError, match=r"^mask: expected shape \(37, 53\), got \(37, 53, 3\)"):
        flicker([image, other], np.ones(image.shape, bool))
    with pytest.raises(TypeError, match=r"^mask: expected bool, got uint8"):
        flicker([image, other], np.ones(image.shape[:2], np.uint8))
    with pytest.raises(ValueError, match=r"^mask: expected at least one true pixel"):
        flicker([image, other], np.zeros(image.shape[:2], bool))


@pytest.fixture
def event() -> tuple[np.ndarray, np.ndarray]:
    """Encoded reference and former reference, which differ in a quarter of the image."""
    rng = np.random.default_rng(9)
    truth, former = rng.uniform(0.2, 0.8, (2, 40, 40, 3))
    former[20:] = truth[20:]
    former[:, 20:] = truth[:, 20:]
    return truth, former


@pytest.mark.parametrize("share", [-0.2, 0, 0.3, 1])
def test_ghost_is_the_fraction_of_the_former_image(share, event):
    truth, former = event
    image = truth + share * (former - truth)
    assert ghost(linear(image), linear(truth), linear(former)) == pytest.approx(share)
    # An error elsewhere is no ghost.
    image[30:] = 0
    assert ghost(linear(image), linear(truth), linear(former)) == pytest.approx(share)


def test_ghost_weighs_pixels_by_their_change(event):
    """A ghost in a part of the event counts as the part's fraction of the squared change."""
    truth, former = event
    image = truth.copy()
    image[:5] = former[:5]
    change = ((former - truth) ** 2).sum((1, 2))
    images = [linear(x) for x in (image, truth, former)]
    assert ghost(*images) == pytest.approx(change[:5].sum() / change.sum())
    upper = np.arange(40)[:, np.newaxis] < np.full(40, 5)
    assert ghost(*images, upper) == pytest.approx(1)
    assert ghost(*images, ~upper) == pytest.approx(0, abs=1e-12)


def test_ghost_is_blind_to_noise_and_grey(event):
    truth, former = event
    noise = np.random.default_rng(1).normal(0, 0.05, truth.shape)
    assert ghost(linear(truth + noise), linear(truth), linear(former)) == pytest.approx(0, abs=0.02)


def test_ghost_needs_an_event(event, pair):
    truth, former = (linear(x) for x in event)
    with pytest.raises(ValueError, match=r"^former: expected an image other than the reference"):
        ghost(truth, truth, truth)
    with pytest.raises(ValueError, match=r"^former: expected an image other than the reference"):
        ghost(truth, truth, former, np.arange(40)[:, np.newaxis] >= np.full(40, 20))
    with pytest.raises(ValueError, match=r"^former: expected the shape of reference, \(40, 40, 3\), got \(37, 53, 3\)"):
        ghost(truth, truth, pair[0])


@pytest.mark.parametrize(
    ("ghosts", "expected"),
    [
        ([0, 0, 0], 0),
        ([1, 0.5, 0.1, 0.05], 2),
        ([1, -0.5, 0.05, 0], 2),
        ([0, 0.05, 0.2, 0], 3),
        ([1, 0.5, 0.2], 3),
        ([], 0),
    ],
)
def test_lag(ghosts, expected):
    assert lag(ghosts) == expected
    assert lag(np.array(ghosts, np.float32) * 2, threshold=0.201) == expected


def test_lag_names_bad_input():
    with pytest.raises(ValueError, match=r"^ghosts: expected shape \(T,\), got \(\)"):
        lag(0.5)
    with pytest.raises(ValueError, match=r"^ghosts: 1 of 2 values are not finite"):
        lag([0.5, np.nan])
    with pytest.raises(ValueError, match=r"^threshold: expected a weight from 0, got -0.1"):
        lag([0.5], -0.1)


def test_registry_is_of_this_module():
    for key, one in METRICS.items():
        assert one.key == key
        assert one.measure is getattr(metrics, key)
        assert metric(key) is one


def test_registry_names_the_unknown():
    with pytest.raises(ValueError, match=r"^metric: expected one of psnr, relmse, .*, got 'mse'"):
        metric("mse")


@pytest.mark.parametrize("key", METRICS)
def test_registry_knows_directions_and_arguments(key):
    """For a static image in weak and in strong noise, with the arguments that the metric declares."""
    one = metric(key)
    rng = np.random.default_rng(20)
    reference = rng.uniform(0.2, 0.8, (24, 24, 3))

    def score(noise):
        # For a flickering denoiser that also blurs.
        images = 0.5 + (1 - noise) * (reference - 0.5) + rng.normal(0, noise / 5, (2, *reference.shape))
        match one.needs:
            case "reference":
                return one.measure(linear(images[0]), linear(reference))
            case "references":
                return one.measure(*linear(images), linear(reference), linear(reference))
            case "none":
                return one.measure(*linear(images), np.zeros((24, 24, 2)), np.ones((24, 24), bool))

    assert (score(0.1) > score(0.6)) == one.higher_is_better


@pytest.mark.parametrize("key", METRICS)
def test_pictures_measure_as_their_arrays_do(key, pair):
    one = metric(key)
    images = [pair[0], pair[1], pair[0] ** 2, np.roll(pair[1], 1, axis=0)]
    pictures = [Picture(image) for image in images]
    if one.needs == "none":
        motion = np.full((*pair[0].shape[:2], 2), 0.25)
        assert one.measure(*pictures[:2], motion) == one.measure(*images[:2], motion)
    else:
        count = 2 if one.needs == "reference" else 4
        assert one.measure(*pictures[:count]) == one.measure(*images[:count])


def test_pictures_of_sequences(pair):
    images = [*pair, pair[0] ** 2]
    pictures = [Picture(image) for image in images]
    mask = np.random.default_rng(0).random(pair[0].shape[:2]) < 0.5
    assert flicker(pictures, mask) == flicker(images, mask)
    assert ghost(*pictures, mask) == ghost(*images, mask)


def test_picture_is_checked_and_encoded_once(pair):
    picture = Picture(pair[0])
    np.testing.assert_array_equal(picture.linear, pair[0])
    np.testing.assert_array_equal(picture.srgb, srgb(pair[0]))
    assert picture.srgb is picture.srgb
    with pytest.raises(ValueError, match=r"^image: expected shape \(H, W, 3\), got \(53, 3\)"):
        Picture(pair[0][0])
    with pytest.raises(ValueError, match=r"^noisy: 3 of 3 values are not finite"):
        Picture(np.full((1, 1, 3), np.inf), "noisy")


def test_nothing_is_written_to(pair):
    """float64 images are used as they are."""
    images = [np.array(x, np.float64) for x in (*pair, pair[0] ** 2, pair[1] / 2)]
    kept = [image.copy() for image in images]
    for one in METRICS.values():
        if one.needs == "none":
            one.measure(*images[:2], np.zeros((*images[0].shape[:2], 2)))
        else:
            one.measure(*images[: 2 if one.needs == "reference" else 4])
    ghost(*images[:3])
    flicker(images)
    for image, copy in zip(images, kept, strict=True):
        np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("measure", OF_PAIRS)
@pytest.mark.parametrize("shape", [(4, 3), (4, 5, 4), (4, 5, 1), (0, 5, 3), (2, 4, 5, 3)])
def test_wrong_shape_is_named(measure, shape):
    with pytest.raises(ValueError, match=r"^image: expected shape \(H, W, 3\), got"):
        measure(np.zeros(shape), np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match=r"^reference: expected shape \(H, W, 3\), got"):
        measure(np.zeros((4, 5, 3)), np.zeros(shape))


@pytest.mark.parametrize("measure", OF_PAIRS)
def test_different_sizes_are_named(measure):
    with pytest.raises(ValueError, match=r"image: expected the shape of reference, \(4, 5, 3\), got \(5, 4, 3\)"):
        measure(np.zeros((5, 4, 3)), np.zeros((4, 5, 3)))


@pytest.mark.parametrize("measure", OF_PAIRS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_counted(measure, value):
    bad = np.zeros((4, 5, 3))
    bad[1, 2, 0] = bad[3, 4, 2] = value
    with pytest.raises(ValueError, match=r"^reference: 2 of 60 values are not finite"):
        measure(np.zeros((4, 5, 3)), bad)


@pytest.mark.parametrize("measure", [*OF_PAIRS, Picture, srgb])
def test_values_that_are_no_floats_are_named(measure):
    floats = [np.zeros((11, 11, 3))] * (measure in OF_PAIRS)
    for dtype in (np.uint8, np.uint16, np.int64, bool, complex):
        most = {np.uint8: 255, np.uint16: 65535}.get(dtype)
        advice = rf": colours of whole numbers are gamma-encoded; \(x / {most}\) \*\* 2.2 is linear" if most else ""
        with pytest.raises(TypeError, match=rf"^image: expected floats, got {np.dtype(dtype)}{advice}$"):
            measure(np.ones((11, 11, 3), dtype), *floats)
    assert Picture(np.ones((1, 1, 3), np.float16)).linear.dtype == np.float64
    with pytest.raises(TypeError, match=r"^image: expected an array without a mask"):
        measure(np.ma.masked_less(np.ones((11, 11, 3)), 2), *floats)


def test_a_lag_of_masked_ghosts_is_refused():
    with pytest.raises(TypeError, match=r"^ghosts: expected an array without a mask"):
        lag(np.ma.masked_array([1.0, 0.5], [False, True]))


def test_flip_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[demo\]'"):
        flip(np.zeros((4, 5, 3)), np.zeros((4, 5, 3)))


def test_ssim_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.metrics", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[study\]'"):
        ssim(np.zeros((11, 11, 3)), np.zeros((11, 11, 3)))


@pytest.mark.slow
def test_import_needs_nothing_but_numpy():
    code = "import sys, yester.metrics; print({'flip_evaluator', 'skimage', 'PIL'} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "set()"
