import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor

FILTERS = ["lanczos-2", "catmull-rom", "bilinear", "nearest"]


def check(image, size, offset=(0.0, 0.0), **named):
    got, weight = yester.resample(image, size, offset=offset, **named)
    want, wanted, sums = reference.resample(tensor(image), size, offset=offset, margin=True, **named)
    # Where negative lobes nearly cancel the other weights, precision is lost, and with it the sign of the sum.
    sums = sums.numpy()
    narrow = np.clip(sums, 1e-6, 1)
    narrow = narrow[..., None] if image.ndim == 3 else narrow
    largest = np.abs(np.where(np.isfinite(image), image, 0)).max()
    scale = np.maximum(largest, np.abs(np.nan_to_num(want.numpy()))) / narrow
    clear = np.abs(sums - 1e-6) > 1e-6
    assert_close("resample", got, want, scale=scale, where=clear)
    assert_close("resample weight", weight, wanted, scale=1.0)
    return got, weight


@pytest.mark.parametrize("filter", FILTERS)
@each("size", SIZES + TAILS[::6])
@pytest.mark.parametrize(("grid", "channels"), [((2.0, 2.0), None), ((1.3, 3.0), 3), ((0.5, 0.7), 2)])
def test_reference(filter, size, grid, channels):
    rng = np.random.default_rng(size[1])
    image = compare.colors(rng, *size, channels or 1, holes=0.1)
    image = image if channels else image[..., 0]
    to = tuple(max(1, round(side * factor)) for side, factor in zip(size, grid, strict=True))
    for offset in ((0.0, 0.0), (0.37, -0.21), (-0.45, 0.5), (1.6, -2.3)):
        for dering in (False, True):
            check(image, to, offset, filter=filter, dering=dering)


@pytest.mark.parametrize("filter", FILTERS)
def test_constant_in_constant_out(filter):
    image = np.full((7, 9, 3), 0.75, np.float32)
    for offset in yester.jitter(5):
        got, _ = yester.resample(image, (15, 21), offset=offset, filter=filter)
        np.testing.assert_allclose(got, 0.75, rtol=1e-6)


@pytest.mark.parametrize("filter", FILTERS)
def test_its_own_grid_is_the_image(filter):
    image = compare.colors(np.random.default_rng(0), 8, 11, holes=0)
    image[np.isnan(image).any(-1) | np.isinf(image).any(-1)] = 1
    got, weight = yester.resample(image, (8, 11), filter=filter)
    assert_same_bits(got, image)
    np.testing.assert_allclose(weight[1:-1, 1:-1], weight[1, 1], rtol=1e-6)


@pytest.mark.parametrize("filter", ["lanczos-2", "catmull-rom", "bilinear"])
def test_samples_of_a_ramp_reproduce_it_elsewhere(filter):
    """Offsets, their signs and the grid's position: samples of a linear ramp reproduce the ramp."""
    y, x = np.mgrid[:12, :14] + 0.5
    v, u = np.mgrid[:24, :35] + 0.5
    for dx, dy in yester.jitter(16):
        image = (x + dx + 3 * (y + dy)).astype(np.float32)
        got, _ = yester.resample(image, (24, 35), offset=(dx, dy), filter=filter)
        np.testing.assert_allclose(got[4:-4, 5:-5], (u / 2.5 + 1.5 * v)[4:-4, 5:-5], atol=0.2)


def test_dering_holds_to_the_samples_around():
    image = np.zeros((8, 8), np.float32)
    image[:, 4:] = 1
    free, held = (yester.resample(image, (16, 16), dering=dering)[0] for dering in (False, True))
    assert free.min() < -0.01
    assert free.max() > 1.01
    assert held.min() == 0
    assert held.max() == 1


@pytest.mark.parametrize("scale", [1.3, 2, 3])
def test_weights_count_samples(scale):
    """On average over offsets, weights are the samples per pixel of the grid; largest where one hits a centre."""
    size = tuple(round(scale * side) for side in (20, 30))
    weights = [yester.resample(np.ones((20, 30)), size, offset=o)[1] for o in yester.jitter(256, sequence="r2")]
    mean = np.mean(weights, 0)[5:-5, 5:-5]
    np.testing.assert_allclose(mean, 600 / (size[0] * size[1]), rtol=0.1)
    assert 1.2 < np.max(weights) < 1.6


def test_missing_samples():
    image = np.ones((6, 6, 3), np.float32)
    image[2, 3, 1] = np.nan
    for filter in FILTERS[:3]:
        got, weight = yester.resample(image, (12, 12), filter=filter)
        np.testing.assert_allclose(got, 1, rtol=1e-6)
        assert weight[5, 7] < 0.3 * weight[5, 3]
    got, _ = yester.resample(image, (12, 12), filter="nearest")
    assert np.isnan(got[4:6, 6:8, 1]).all()
    assert np.isfinite(got[..., 0]).all()
    lost, weight = yester.resample(np.full((2, 2), np.nan), (4, 4))
    assert np.isnan(lost).all()
    assert not weight.any()


@pytest.mark.parametrize("filter", FILTERS)
def test_samples_that_are_hit_to_the_last_bit(filter):
    """The distance to the sample before rounds to 1, where the weights of a sinc are 0/0."""
    for width, size, offset in ((2, 5, 0.1), (64, 80, -0.1), (64, 80, 0.1), (160, 400, -0.3)):
        got, weight = yester.resample(np.ones((1, width)), (1, size), offset=(offset, 0.0), filter=filter)
        np.testing.assert_allclose(got, 1, rtol=1e-6)
        assert np.all(weight > 0)


def test_bad_input():
    image = np.ones((4, 5, 3), np.float32)
    for size in ((0, 5), (4, -1), (4, 65537)):
        with pytest.raises(ValueError, match="size: expected sides of 1 to 65536 pixels"):
            yester.resample(image, size)
    with pytest.raises(ValueError, match="size: expected height and width"):
        yester.resample(image, (4, 5, 3))
    for size in ((4.5, 5), 4, "45"):
        with pytest.raises(TypeError, match="size"):
            yester.resample(image, size)
    with pytest.raises(ValueError, match="offset: expected finite pixels"):
        yester.resample(image, (8, 10), offset=(0, np.nan))
    with pytest.raises(ValueError, match=r"offset: expected shape \(2,\)"):
        yester.resample(image, (8, 10), offset=(0, 0, 0))
    with pytest.raises(ValueError, match='filter: expected one of "nearest"'):
        yester.resample(image, (8, 10), filter="cubic")
    with pytest.raises(ValueError, match="image: expected shape"):
        yester.resample(image[0, 0], (8, 10))
