import compare
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor

FILTERS = ["box", "tent", "blackman-harris", "mitchell"]


@pytest.mark.parametrize("filter", FILTERS)
@each("size", SIZES + TAILS[::8])
@pytest.mark.parametrize("channels", [None, 1, 3])
def test_reference(filter, size, channels):
    rng = np.random.default_rng(size[1])
    samples = [compare.colors(rng, *size, channels or 1) for _ in range(5)]
    samples = samples if channels else [image[..., 0] for image in samples]
    offsets = yester.jitter(5, sequence="r2")
    want = reference.resolve(tensor(samples), offsets, filter=filter).numpy()
    # Where negative lobes nearly cancel the other weights, precision is lost.
    got = yester.resolve(samples, offsets, filter=filter)
    assert_close("resolve", got, want, scale=np.abs(want[np.isfinite(want)]).max(initial=1))


def test_box_is_the_mean():
    rng = np.random.default_rng(0)
    samples = rng.random((8, 9, 11, 3), np.float32)
    got = yester.resolve(samples, yester.jitter(8), filter="box")
    np.testing.assert_allclose(got, samples.mean(0), rtol=1e-6)


@pytest.mark.parametrize("filter", FILTERS)
def test_constant_in_constant_out(filter):
    samples = np.full((4, 6, 7, 3), 0.75, np.float32)
    got = yester.resolve(samples, yester.jitter(4), filter=filter)
    np.testing.assert_allclose(got, samples[0], rtol=1e-6)


@pytest.mark.parametrize("filter", FILTERS)
def test_samples_of_a_ramp_reproduce_it_at_the_centres(filter):
    """Offsets and their signs: samples of a linear ramp reproduce the ramp."""
    offsets = yester.jitter(64, sequence="rotated-grid")
    y, x = np.mgrid[:12, :14] + 0.5
    samples = [(x + dx + 3 * (y + dy)).astype(np.float32) for dx, dy in offsets]
    got = yester.resolve(samples, offsets, filter=filter)
    np.testing.assert_allclose(got[2:-2, 2:-2], (x + 3 * y)[2:-2, 2:-2], atol=0.05)


def test_a_jittered_camera_is_antialiased():
    """Albedo through jittered cameras: less error against many samples than any single one has."""
    camera = flight.camera(0, 48, 36)

    def albedo(offset):
        return flight.sample(flight.scene(0, camera.jittered(offset))).albedo

    truth = np.mean([albedo(offset) for offset in yester.jitter(256, sequence="r2")], 0)
    offsets = yester.jitter(8)
    samples = [albedo(offset) for offset in offsets]
    error = np.mean((yester.resolve(samples, offsets, filter="box") - truth) ** 2)
    assert error < 0.25 * min(np.mean((sample - truth) ** 2) for sample in samples)


def test_missing_samples():
    samples = np.ones((2, 3, 3, 3), np.float32)
    samples[0, 1, 1, 2] = np.nan
    samples[1] = 3
    got = yester.resolve(samples, yester.jitter(2), filter="box")
    np.testing.assert_array_equal(got[1, 1], 3)
    np.testing.assert_array_equal(got[0, 0], 2)
    samples[1, 1, 1] = np.inf
    assert np.isnan(yester.resolve(samples, yester.jitter(2), filter="box")[1, 1]).all()
    assert np.isfinite(yester.resolve(samples, yester.jitter(2), filter="mitchell")).all()


def test_an_array_is_a_sequence():
    samples = np.random.default_rng(1).random((3, 5, 6, 3), np.float32)
    assert_same_bits(yester.resolve(samples, yester.jitter(3)), yester.resolve(list(samples), yester.jitter(3)))


def test_bad_input():
    image, offsets = np.ones((4, 5, 3), np.float32), yester.jitter(2)
    with pytest.raises(ValueError, match="samples: expected as many images as offsets, 2, and at least one, got 1"):
        yester.resolve([image], offsets)
    with pytest.raises(ValueError, match="samples"):
        yester.resolve([], np.zeros((0, 2)))
    with pytest.raises(ValueError, match=r"samples\[1\]: expected the shape of the first"):
        yester.resolve([image, image[1:]], offsets)
    with pytest.raises(ValueError, match=r"offsets: expected pixels from -0\.5 to 0\.5"):
        yester.resolve([image, image], offsets + 1)
    with pytest.raises(ValueError, match=r"offsets: expected shape \(N, 2\)"):
        yester.resolve([image, image], offsets[None])
    with pytest.raises(ValueError, match='filter: expected one of "box"'):
        yester.resolve([image, image], offsets, filter="gauss")
