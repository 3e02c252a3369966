import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from hypothesis import assume, given
from hypothesis import strategies as st
from reference.morphological import brightness


def coverage(height, width, slope, offset) -> np.ndarray:
    """The exact coverage of each pixel by the half plane above the line y = slope · x + offset; slope > 0."""

    def below_zero_or_one(v):  # the antiderivative of v clamped to [0, 1]
        return np.where(v < 1, np.maximum(v, 0) ** 2 / 2, v - 0.5)

    y, x = np.mgrid[:height, :width]
    start = slope * x + offset - y
    return (below_zero_or_one(start + slope) - below_zero_or_one(start)) / slope


def jagged(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """Half planes, thin lines and blocks in a few colours, and holes."""
    palette = rng.exponential(1, (6, 3)).astype(np.float32)
    palette[0] = 0
    y, x = np.mgrid[:height, :width]
    which = np.zeros((height, width), int)
    for _ in range(int(rng.integers(1, 6))):
        angle, kind, color = rng.uniform(0, 2 * np.pi), rng.integers(4), rng.integers(6)
        side = (x - rng.uniform(0, width)) * np.cos(angle) + (y - rng.uniform(0, height)) * np.sin(angle)
        top, left = rng.integers(0, height), rng.integers(0, width)
        block = (y >= top) & (y < top + rng.integers(1, 9)) & (x >= left) & (x < left + rng.integers(1, 9))
        which[[side > 0, np.abs(side) < 0.5, block, rng.random(which.shape) < 0.05][kind]] = color
    image = palette[which]
    image[rng.random(which.shape) < rng.choice([0, 0.02])] = np.nan
    image[rng.random(image.shape) < rng.choice([0, 0.005])] = np.inf
    return image


def assert_as_reference(image, **parameters):
    want = reference.morphological_aa(tensor(image), **parameters).numpy()
    assert_close("morphological_aa", yester.morphological_aa(image, **parameters), want, rtol=1e-6)


def is_clear(image, threshold) -> bool:
    """Whether no edge is near the threshold, where one flip would change a whole line."""
    light = brightness(tensor(image)).numpy()
    differences = [np.abs(np.diff(light, axis=axis)) for axis in (0, 1)]
    return not any(((np.abs(d - threshold) < compare.BAND) & (d > 0)).any() for d in differences)


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.integers(1, 40), st.integers(1, 60)) | st.sampled_from(SIZES + TAILS),
    threshold=st.sampled_from([0.0, 0.02, 0.1, 0.4, 2.0]),
    max_length=st.integers(1, 20) | st.sampled_from([128]),
)
def test_reference(seed, size, threshold, max_length):
    image = jagged(np.random.default_rng(seed), *size)
    assume(is_clear(image, threshold))
    assert_as_reference(image, threshold=threshold, max_length=max_length)


@each("size", SIZES)
def test_reference_on_noise(size):
    image = compare.colors(np.random.default_rng(size), *size)
    assert is_clear(image, 0.1)
    assert_as_reference(image)


@pytest.mark.parametrize("max_length", [1, 3, 8, 128])
@pytest.mark.parametrize("run", [1, 2, 7, 16, 17, 300])
def test_reference_at_the_end_of_the_search(run, max_length):
    """Stairs of one length in both directions, the last step cut off by the image."""
    stairs = np.repeat(np.arange(4), run)[None, : 4 * run - run // 2]
    image = np.where(np.arange(6)[:, None, None] > stairs[..., None], 1, [0.1, 0.2, 0.3]).astype(np.float32)
    for turned in (image, image[:, ::-1].copy(), image.swapaxes(0, 1).copy()):
        assert_as_reference(turned, max_length=max_length)


def row(*values):
    return np.repeat(np.float32(values)[..., None], 3, -1)


def test_shapes():
    """L, Z, U and a lone pixel, by hand."""
    ell = yester.morphological_aa(row([0, 1, 1, 1], [1, 1, 1, 1]))
    # A line of length one that ends at the left border: the triangle under half of it, in rows and columns alike.
    np.testing.assert_allclose(ell, row([1 / 8, 1, 1, 1], [1, 1, 1, 1]))
    zed = yester.morphological_aa(row([1, 0, 0, 0, 0, 0], [1, 1, 1, 1, 1, 0]))
    want = row([1, 3 / 8, 1 / 8, 0, 0, 0], [1, 1, 1, 7 / 8, 5 / 8, 0])
    np.testing.assert_allclose(zed, want)
    you = yester.morphological_aa(row([0, 0, 0, 0, 0], [0, 1, 1, 1, 0], [1, 1, 1, 1, 1]))
    np.testing.assert_allclose(you, row([0, 0, 0, 0, 0], [1 / 8, 2 / 3, 11 / 12, 2 / 3, 1 / 8], [1, 1, 1, 1, 1]))
    lone = np.zeros((3, 3, 3), np.float32)
    lone[1, 1] = 1
    np.testing.assert_allclose(yester.morphological_aa(lone)[1, 1], 0.5)


@given(seed=st.integers(0, 2**32 - 1), max_length=st.integers(1, 20))
def test_mirrored_and_turned(seed, max_length):
    image = jagged(np.random.default_rng(seed), 23, 31)
    smooth = yester.morphological_aa(image, max_length=max_length)
    for turn in (lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.swapaxes(0, 1)):
        turned = yester.morphological_aa(turn(image).copy(), max_length=max_length)
        assert_same_bits(turned, turn(smooth).copy())


@given(seed=st.integers(0, 2**32 - 1), threshold=st.sampled_from([0.0, 0.1]))
def test_within_the_neighborhood(seed, threshold):
    image = jagged(np.random.default_rng(seed), 19, 37)
    image -= np.float32(0.2)  # negative light as well
    smooth = yester.morphological_aa(image, threshold=threshold)
    there = np.isfinite(image).all(-1, keepdims=True)
    assert_same_bits(smooth[~there[..., 0]], image[~there[..., 0]])
    low, high = (
        pick(
            [
                np.roll(np.pad(np.where(there, image, fill), ((1, 1), (1, 1), (0, 0)), constant_values=fill), d, (0, 1))
                for d in np.ndindex(3, 3)
            ],
            axis=0,
        )[2:, 2:]
        for pick, fill in ((np.min, np.inf), (np.max, -np.inf))
    )
    there = there[..., 0]
    assert (smooth >= low - 1e-6 * (1 + np.abs(low)))[there].all()
    assert (smooth <= high + 1e-6 * (1 + np.abs(high)))[there].all()


@each("size", SIZES)
def test_without_edges_the_bits_stay(size):
    for value in (0, -0.0, 0.3, -7, 3e38, np.nan, np.inf, -np.inf):
        image = np.full((*size, 3), value, np.float32)
        assert_same_bits(yester.morphological_aa(image, threshold=0), image)
    ramp = np.linspace(0.4, 0.6, size[1], dtype=np.float32)
    image = np.broadcast_to(ramp[:, None], (*size, 3)).copy()
    assert_same_bits(yester.morphological_aa(image, threshold=0.2), image)
    noise = compare.colors(np.random.default_rng(0), *size)
    assert_same_bits(yester.morphological_aa(noise, threshold=1), noise)


def test_straight_edges_stay():
    image = np.zeros((20, 30, 3), np.float32)
    image[:, 11:] = 1
    image[7:, :, 1] += 2
    assert_same_bits(yester.morphological_aa(image), image)


def test_the_largest_floats():
    image = jagged(np.random.default_rng(3), 40, 40)
    image = np.where(image > 0.5, np.finfo(np.float32).max, -np.finfo(np.float32).max).astype(np.float32)
    smooth = yester.morphological_aa(image)
    assert np.isfinite(smooth).all()
    assert (smooth != image).any()


@pytest.mark.parametrize(
    ("slope", "times"), [(0.07, 18), (0.13, 10), (0.2, 5), (0.31, 4), (0.45, 2.9), (0.618, 2.5), (1.0, 1.4)]
)
def test_slanted_edges_come_closer_to_the_reference(slope, times):
    """The reference is the area under the line; a mean over several lines, as some have equal stairs."""
    before = after = 0
    inner = np.s_[:, 20:-20]  # without lines that end at the border
    for offset in 10 + (np.arange(8) + 0.5) / 8:
        want = coverage(200, 160, slope, offset)
        y, x = np.mgrid[:200, :160] + 0.5
        aliased = np.repeat((y < slope * x + offset)[..., None], 3, -1).astype(np.float32)
        smooth = yester.morphological_aa(aliased)
        before += np.mean((aliased[..., 0] - want)[inner] ** 2)
        after += np.mean((smooth[..., 0] - want)[inner] ** 2)
    assert np.sqrt(before / after) > times


def test_bad_parameters():
    image = np.zeros((4, 5, 3), np.float32)
    for threshold in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="threshold: expected a finite number from 0"):
            yester.morphological_aa(image, threshold=threshold)
    for length in (0, -1, 129, 2**40):
        with pytest.raises(ValueError, match="max_length: expected 1 to 128"):
            yester.morphological_aa(image, max_length=length)
    with pytest.raises(TypeError, match="max_length"):
        yester.morphological_aa(image, max_length=1.5)
    for wrong in (image[..., 0], image[..., :2], image[None]):
        with pytest.raises(ValueError, match="color"):
            yester.morphological_aa(wrong)
