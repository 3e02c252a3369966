import compare
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_same_bits, each, tensor
from hypothesis import given
from hypothesis import strategies as st


def halves(angle: float, side: int = 41, *, at: float = 0.3) -> np.ndarray:
    """Coverage of pixels by one side of a straight edge at an angle to the columns, through the image's middle."""
    place = (np.arange(side * 8) + 0.5) / 8 - side / 2 + at
    y, x = np.meshgrid(place, place, indexing="ij")
    inside = x * np.cos(angle) + y * np.sin(angle) > 0
    return inside.reshape(side, 8, side, 8).mean((1, 3)).astype(np.float32)


def drawn(coverage: np.ndarray, rng: np.random.Generator, samples: int = 4) -> np.ndarray:
    """The image of a dark and a bright side, each pixel by so many samples."""
    share = rng.binomial(samples, coverage) / samples
    return np.repeat((0.1 + 0.8 * share)[..., None], 3, -1).astype(np.float32)


@each("size", SIZES + TAILS[::3])
@pytest.mark.parametrize("exposure", [0.1, 1.0, 20.0])
@pytest.mark.parametrize("holes", [0.0, 0.002])
def test_reference(size, exposure, holes):
    rng = np.random.default_rng(size[1])
    color = compare.colors(rng, *size, holes=holes)
    color[..., : size[1] // 2, :] *= np.float32(0.01)  # an edge
    color[rng.random(size) < 0.02] *= -1
    scale = np.max(np.abs(color), where=np.isfinite(color), initial=0)
    known = rng.random(size, np.float32)
    known[rng.random(size) < 0.1] = np.nan
    for beside in ({}, {"newest": compare.colors(rng, *size, holes=0.1)}, {"confidence": known}):
        got = yester.smooth_edges(color, **beside, exposure=exposure)
        given = {name: tensor(image) for name, image in beside.items()}
        want = reference.smooth_edges(tensor(color), **given, exposure=exposure).numpy()
        compare.assert_close("smooth_edges", got, want, scale=scale)


@each("angle", np.linspace(0, np.pi, 13))
def test_straight_edges_lose_their_noise(angle):
    coverage = halves(angle)
    errors = []
    for seed in range(8):
        image = drawn(coverage, np.random.default_rng(seed))
        for one in (image, yester.smooth_edges(image)):
            errors.append(np.mean((one[4:-4, 4:-4, 0] - (0.1 + 0.8 * coverage[4:-4, 4:-4])) ** 2))
    before, after = np.mean(errors[::2]), np.mean(errors[1::2])
    assert after < (0.6 if before > 0 else 1) * before or before == after == 0


def test_straight_edges_show_more_of_the_newest_frame():
    late = np.repeat((0.1 + 0.8 * halves(0.4))[..., None], 3, -1).astype(np.float32)
    plain = yester.smooth_edges(late)
    more = (yester.smooth_edges(late, newest=late + np.float32(0.02)) - plain)[6:-6, 6:-6] / 0.02
    edge = ((late > 0.2) & (late < 0.8))[6:-6, 6:-6]
    np.testing.assert_allclose(more[edge], 0.15, atol=0.02)
    assert (more <= 0.16).all()
    assert_same_bits(yester.smooth_edges(late, newest=np.full_like(late, np.nan)), plain)
    # A lamp that shines into the newest frame is not news of an edge.
    assert yester.smooth_edges(late, newest=np.full_like(late, 1e30)).max() <= late.max()


def test_where_little_is_known_edges_need_not_be_straight():
    rng = np.random.default_rng(2)
    image = np.repeat(rng.uniform(0.2, 0.8, (30, 30, 1)), 3, -1).astype(np.float32)  # no direction
    known = np.broadcast_to(np.linspace(0, 1, 4, dtype=np.float32)[:, None, None], (4, *image.shape[:2]))
    spread = [yester.smooth_edges(image, confidence=each).std() for each in known]
    assert spread == sorted(spread)
    assert spread[0] < 0.8 * spread[-1]
    assert_same_bits(yester.smooth_edges(image, confidence=known[-1]), yester.smooth_edges(image))


def test_what_is_no_edge_keeps_its_bits():
    flat = np.full((20, 30, 3), 0.4, np.float32)
    assert_same_bits(yester.smooth_edges(flat), flat)
    x, y = np.meshgrid(np.arange(30), np.arange(20))
    slow = (0.4 + 1e-3 * (x + 2 * y)[..., None] * np.ones(3)).astype(np.float32)
    assert_same_bits(yester.smooth_edges(slow), slow)
    board = np.repeat(((x + y) % 2)[..., None], 3, -1).astype(np.float32)  # no direction
    assert_same_bits(yester.smooth_edges(board)[4:-4, 4:-4], board[4:-4, 4:-4])


def test_ideal_edges_stay():
    for angle in np.linspace(0, np.pi, 9):
        ideal = np.repeat((0.1 + 0.8 * halves(angle))[..., None], 3, -1).astype(np.float32)
        assert np.abs(yester.smooth_edges(ideal) - ideal)[6:-6, 6:-6].max() < 0.08  # a tenth of their contrast


def test_corners_stay():
    image = np.full((31, 31, 3), 0.1, np.float32)
    image[:16, :16] = 0.9
    assert np.abs(yester.smooth_edges(image) - image).max() < 0.1


def test_lamps_do_not_shine_into_the_dark():
    image = np.full((31, 31, 3), 0.1, np.float32)
    image[:, 15:] = 1000
    image[14, 14] = 1  # a little of the lamp
    dark = yester.smooth_edges(image)[:, :15]
    assert dark.max() < 1.1


@pytest.mark.parametrize("turn", [np.flipud, np.fliplr, lambda image: np.swapaxes(image, 0, 1)])
def test_turns_with_the_image(turn):
    image = drawn(halves(0.7), np.random.default_rng(3))
    got = yester.smooth_edges(np.ascontiguousarray(turn(image)))
    np.testing.assert_allclose(got, turn(yester.smooth_edges(image)), atol=1e-5)


def test_around_missing_pixels_nothing_changes():
    image = drawn(halves(0.3), np.random.default_rng(0))
    image[20, 20, 1] = np.nan
    changed = (yester.smooth_edges(image) != image).any(-1)
    assert not np.delete(changed[16:25, 16:25].ravel(), 40).any()
    assert changed[:16].any()
    assert changed[25:].any()


@given(st.integers(1, 20), st.integers(1, 20), st.integers(0, 99), st.sampled_from([1e-30, 1e-3, 1.0, 1e30]))
def test_stays_in_the_range(height, width, seed, scale):
    rng = np.random.default_rng(seed)
    color = (scale * rng.exponential(1, (height, width, 3)) * rng.choice([0.01, 1], (height, width, 1))).astype(
        np.float32
    )
    got = yester.smooth_edges(color, exposure=scale)
    low, high = color.min((0, 1)), color.max((0, 1))
    assert ((got >= low * (1 - 1e-5)) & (got <= high * (1 + 1e-5))).all()


def test_bad_input():
    color = np.ones((4, 5, 3), np.float32)
    for value in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="exposure: expected a finite number above 0"):
            yester.smooth_edges(color, exposure=value)
    with pytest.raises(ValueError, match="color: expected shape"):
        yester.smooth_edges(color[..., :2])
    with pytest.raises(ValueError, match="newest: expected"):
        yester.smooth_edges(color, newest=color[:3])
    with pytest.raises(ValueError, match="confidence: expected"):
        yester.smooth_edges(color, confidence=color)
