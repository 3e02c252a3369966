import numpy as np
import pytest
import reference
import yester
from compare import each

SEQUENCES = ["halton", "r2", "rotated-grid", "blue-noise"]


@pytest.mark.parametrize("sequence", SEQUENCES)
@each("count", [1, 2, 3, 4, 5, 7, 8, 10, 13, 16, 31, 32, 64, 100])
def test_reference(sequence, count):
    got = yester.jitter(count, sequence=sequence)
    assert got.shape == (count, 2)
    np.testing.assert_allclose(got, reference.jitter(count, sequence=sequence), rtol=0, atol=1e-12)
    assert -0.5 <= got.min() <= got.max() < 0.5
    assert len(np.unique(got, axis=0)) == count


def test_known_values():
    np.testing.assert_allclose(
        yester.jitter(4) + 0.5, [[1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9], [1 / 8, 4 / 9]], atol=1e-15
    )
    np.testing.assert_array_equal(
        8 * (yester.jitter(4, sequence="rotated-grid") + 0.5), [[1, 5], [3, 1], [5, 7], [7, 3]]
    )


def test_blue_noise_begins_spread_out():
    """The largest gap of the first points is smaller than that of the same points ordered from left to right."""
    place = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 41)] * 2), -1).reshape(-1, 1, 2)

    def hole(points):
        d = np.abs(place - points)
        return np.hypot(*np.moveaxis(np.minimum(d, 1 - d), -1, 0)).min(1).max()

    for count in (8, 16, 31, 64):
        spread, swept = (yester.jitter(count, sequence=name) for name in ("blue-noise", "rotated-grid"))
        np.testing.assert_array_equal(np.sort(spread, 0), np.sort(swept, 0))
        for first in (count // 4, count // 2):
            assert hole(spread[:first]) < 0.9 * hole(swept[:first])


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_any_phase_count_integrates(sequence):
    """The mean of a smooth function over the pixel has less error than from random offsets."""
    x, y = yester.jitter(64, sequence=sequence).T
    values = np.cos(3 * x) * np.cos(2 * y)
    assert abs(values.mean() - (np.sin(1.5) / 1.5) * np.sin(1)) < 0.5 * values.std() / 8


def test_jittered_camera():
    camera = yester.Camera.from_look_at([1, 2, 5], [0, 0, 0], [0, 1, 0], 50, 64, 48, principal_point=(30, 25))
    offset = np.array([0.3, -0.45])
    jittered = camera.jittered(offset)
    points = np.random.default_rng(0).normal(0, 1, (50, 3))
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(jittered.project(points)[0], pixels - offset, atol=1e-9)
    np.testing.assert_allclose(jittered.project(points)[1], depth, atol=1e-9)
    centres = np.stack(np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5), -1)
    np.testing.assert_allclose(jittered.rays()[1], camera.rays(centres + offset)[1], atol=1e-12)
    np.testing.assert_allclose(jittered.position, camera.position, atol=1e-12)
    assert camera.jittered([0, 0]) == camera


def test_bad_input():
    for count in (0, -1, 65537):
        with pytest.raises(ValueError, match="count: expected 1 to 65536"):
            yester.jitter(count)
    with pytest.raises(ValueError, match='sequence: expected one of "halton"'):
        yester.jitter(4, sequence="sobol")
    camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], 50, 8, 8)
    with pytest.raises(ValueError, match="offset"):
        camera.jittered([np.nan, 0])
    with pytest.raises(ValueError, match=r"offset: expected shape \(2,\)"):
        camera.jittered([0, 0, 0])
