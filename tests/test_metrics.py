import subprocess
import sys

import flip_evaluator
import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio
from yester.study.metrics import flip, flip_map, psnr, relmse, srgb

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
