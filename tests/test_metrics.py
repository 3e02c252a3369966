import subprocess
import sys

import flip_evaluator
import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio
from yester.study.metrics import flip, flip_map, psnr, relmse, srgb, temporal_error

METRICS = [psnr, relmse, flip, flip_map]


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    """An image and its reference, HDR: a fifth of the values is above 1, and some noise falls below 0."""
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


def test_psnr_ignores_what_a_display_cannot_show():
    assert psnr(np.full((1, 1, 3), 5.0), np.full((1, 1, 3), 2.0)) == float("inf")


def test_relmse_by_hand():
    image, reference = np.zeros((1, 2, 3)), np.zeros((1, 2, 3))
    reference[0, 0] = 0.3
    image[0, 1, 2] = 0.1
    # One pixel misses 0.3 in three channels, the other exceeds 0 by 0.1 in one: six values.
    assert relmse(image, reference) == pytest.approx((3 * 0.09 / 0.10 + 0.01 / 0.01) / 6)


def test_relmse_is_not_symmetric():
    one, two = np.full((1, 1, 3), 1.0), np.full((1, 1, 3), 2.0)
    assert relmse(one, two) == pytest.approx(1 / 4.01)
    assert relmse(two, one) == pytest.approx(1 / 1.01)


def test_flip_agrees_with_its_evaluator(pair):
    image, reference = (np.ascontiguousarray(srgb(x), np.float32) for x in pair)
    errors, mean, _ = flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)
    np.testing.assert_array_equal(flip_map(*pair), errors[..., 0])
    assert flip(*pair) == pytest.approx(mean, rel=1e-5)


def test_flip_of_black_and_white():
    black, white = np.zeros((16, 16, 3)), np.ones((16, 16, 3))
    assert flip(black, white) > 0.9
    assert flip_map(black, white).shape == (16, 16)


@pytest.mark.parametrize("metric", [relmse, flip])
def test_equal_images_have_no_error(metric, pair):
    assert metric(pair[1], pair[1]) == 0


def test_equal_images_have_infinite_psnr(pair):
    assert psnr(pair[1], pair[1]) == float("inf")


@pytest.mark.parametrize("metric", [psnr, relmse, flip])
def test_layout_and_type_do_not_matter(metric, pair):
    image, reference = pair
    wide = np.repeat(image.astype(np.float64), 2, axis=1)[:, ::2]
    assert metric(wide, np.asfortranarray(reference)) == metric(image, reference)
    assert metric(image.tolist(), reference) == metric(image, reference)


def test_temporal_error_by_hand():
    # Encoded, the image rises by 12.92e-3 in one value of twelve, and its reference falls by as much in another.
    black = np.zeros((2, 2, 3))
    image, reference_before = black.copy(), black.copy()
    image[0, 1, 2] = reference_before[1, 0, 0] = 1e-3
    assert temporal_error(image, black, black, reference_before) == pytest.approx(12.92e-3 * np.sqrt(2 / 12))


def test_temporal_error_of_independent_noise():
    """Of an image that ought to stand still: the noise of one frame, once for each of two."""
    rng = np.random.default_rng(3)
    still = np.full((64, 64, 3), 0.5)
    frames = still + rng.normal(0, 0.01, (2, *still.shape))
    expected = np.sqrt(sum(np.mean((srgb(frame) - srgb(still)) ** 2) for frame in frames))
    assert temporal_error(*frames, still, still) == pytest.approx(expected, rel=0.02)


def test_temporal_error_ignores_what_stays_wrong(pair):
    image, reference = pair
    assert temporal_error(image, image, reference, reference) == 0
    assert temporal_error(reference, image, reference, image) == 0


def test_temporal_error_knows_its_arguments(pair):
    """To exchange the images with the references, or the new with the old, changes nothing; one pair alone does."""
    image, reference = pair
    images = [image, reference, image**2, np.roll(reference, 1, axis=0)]
    first = temporal_error(*images)
    assert temporal_error(*images[2:], *images[:2]) == pytest.approx(first)
    assert temporal_error(images[1], images[0], images[3], images[2]) == pytest.approx(first)
    assert temporal_error(images[0], images[3], images[2], images[1]) != pytest.approx(first, rel=1e-3)


@pytest.mark.parametrize("position", range(4))
def test_temporal_error_names_what_is_wrong(position):
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
    with pytest.raises(ValueError, match=rf"^{odd}: expected the shape of the reference, \("):
        temporal_error(*images)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("shape", [(4, 3), (4, 5, 4), (4, 5, 1), (0, 5, 3), (2, 4, 5, 3)])
def test_wrong_shape_is_named(metric, shape):
    with pytest.raises(ValueError, match=r"^image: expected shape \(H, W, 3\), got"):
        metric(np.zeros(shape), np.zeros((4, 5, 3)))
    with pytest.raises(ValueError, match=r"^reference: expected shape \(H, W, 3\), got"):
        metric(np.zeros((4, 5, 3)), np.zeros(shape))


@pytest.mark.parametrize("metric", METRICS)
def test_different_sizes_are_named(metric):
    with pytest.raises(ValueError, match=r"image: expected the shape of the reference, \(4, 5, 3\), got \(5, 4, 3\)"):
        metric(np.zeros((5, 4, 3)), np.zeros((4, 5, 3)))


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_counted(metric, value):
    bad = np.zeros((4, 5, 3))
    bad[1, 2, 0] = bad[3, 4, 2] = value
    with pytest.raises(ValueError, match=r"^reference: 2 of 60 values are not finite"):
        metric(np.zeros((4, 5, 3)), bad)


def test_flip_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[demo\]'"):
        flip(np.zeros((4, 5, 3)), np.zeros((4, 5, 3)))


def test_import_needs_nothing_but_numpy():
    code = "import sys, yester.study.metrics; print({'flip_evaluator', 'matplotlib', 'PIL'} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "set()"
