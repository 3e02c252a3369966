import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, tensor
from hypothesis import given, settings
from hypothesis import strategies as st

BOXES = ["variance", "minmax", "rounded", "intersection"]
SPACES = ["rgb", "ycocg", "tonemapped-rgb", "tonemapped-ycocg"]
RESPONSES = ["clamp", "center", "current", "ellipsoid"]
MODES = [(box, response) for box in BOXES for response in RESPONSES if response != "ellipsoid" or box == "variance"]


def images(rng, height, width):
    """A noisy frame, and history that lies about half inside its boxes; with holes and negative colours."""
    color = rng.normal(1, 0.4, (height, width, 3))
    history = color + rng.normal(0, 0.5, color.shape) * rng.choice([0, 0.3, 2], (height, width, 1))
    color[rng.random((height, width)) < 0.05] = np.nan
    history[rng.random((height, width)) < 0.02, 1] = np.inf
    return history.astype(np.float32), color.astype(np.float32)


def check(history, color, **named):
    got = yester.clip_history(history, color, **named)
    want = reference.clip_history(tensor(history), tensor(color), **named)
    # Undoing the tone curve multiplies errors where it is steep.
    scale = 30.0 if "tonemapped" in named.get("space", "") else 2.0
    assert_close("clip_history", got, want, scale=scale)
    return got


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32),
    size=st.tuples(st.integers(1, 20), st.integers(1, 40)),
    mode=st.sampled_from(MODES),
    gamma=st.sampled_from([0.0, 0.75, 1.0, 1.5]),
    window=st.sampled_from(["3x3", "5x5"]),
    space=st.sampled_from(["rgb", "ycocg"]),
)
def test_reference(seed, size, mode, **named):
    box, response = mode
    check(*images(np.random.default_rng(seed), *size), box=box, response=response, **named)


@pytest.mark.parametrize(("box", "response"), MODES)
@pytest.mark.parametrize("space", SPACES)
def test_every_mode(box, response, space):
    """Both sides of every box occur."""
    history, color = (np.abs(image) for image in images(np.random.default_rng(3), 33, 41))
    got = check(history, color, box=box, response=response, space=space)
    kept = (got == history).all(-1).mean()
    assert 0.05 < kept < 0.95


@pytest.mark.parametrize("size", SIZES + TAILS[::8])
def test_sizes(size):
    check(*images(np.random.default_rng(size[1]), *size))


@pytest.mark.parametrize(("box", "response"), MODES)
@pytest.mark.parametrize("space", ["rgb", "ycocg"])
def test_inside_keeps_its_bits(box, response, space):
    """Each pixel's own colour is inside its range; the neighbourhood's mean is inside every box."""
    rng = np.random.default_rng(5)
    color = rng.random((8, 9, 3), np.float32)
    color[:, 1::2] = 1 - color[:, :-1:2]  # around grey
    history = np.full_like(color, 0.5) + rng.normal(0, 1e-3, color.shape).astype(np.float32)
    got = yester.clip_history(history, color, box=box, response=response, space=space, gamma=1.5)
    assert_same_bits(got[2:-2, 2:-2], history[2:-2, 2:-2])


@pytest.mark.parametrize(("box", "response"), MODES)
@pytest.mark.parametrize("space", SPACES)
def test_a_uniform_neighbourhood_leaves_one_colour(box, response, space):
    """No variance, no range: history becomes that colour, whatever it was."""
    color = np.full((5, 6, 3), (0.5, 0.25, 0.125), np.float32)
    history = np.random.default_rng(0).exponential(3, color.shape).astype(np.float32)
    got = yester.clip_history(history, color, box=box, response=response, space=space)
    np.testing.assert_allclose(got, color, rtol=1e-5)


@pytest.mark.parametrize("response", ["clamp", "center", "current"])
@pytest.mark.parametrize("box", BOXES)
def test_what_comes_out_is_inside(box, response):
    """Clipping once more changes nothing but rounding."""
    history, color = images(np.random.default_rng(7), 30, 30)
    named = {"box": box, "response": response, "space": "rgb"}
    once = yester.clip_history(history, color, **named)
    np.testing.assert_allclose(yester.clip_history(once, color, **named), once, rtol=1e-5, atol=1e-6)


def test_a_firefly_does_not_save_bad_history():
    """The current colour is outside its own variance box; history that is as bad comes back inside all the same."""
    color = np.full((5, 5, 3), 0.1, np.float32)
    color[2, 2] = 50
    history = np.full_like(color, 50)
    got = yester.clip_history(history, color, response="current", space="rgb")[2, 2]
    deviation = color[1:4, 1:4, 0].std()
    assert (got <= color[1:4, 1:4, 0].mean() + deviation * 1.0001).all()


def test_scale_does_not_matter():
    history, color = images(np.random.default_rng(9), 20, 20)
    for box, response in MODES:
        small = yester.clip_history(history, color, box=box, response=response)
        big = yester.clip_history(history * 1024, color * 1024, box=box, response=response)
        assert_same_bits(big, small * np.float32(1024))


def test_missing_pixels():
    """Holes do not count, nor does history vanish where there is nothing else."""
    color = np.full((4, 4, 3), np.nan, np.float32)
    history = np.ones_like(color)
    assert_same_bits(yester.clip_history(history, color), history)
    color[0, 0] = 0.5
    got = yester.clip_history(history, color)
    np.testing.assert_array_equal(got[:2, :2], 0.5)
    np.testing.assert_array_equal(got[2:], 1)
    history[1, 1, 0] = np.nan
    assert_same_bits(yester.clip_history(history, color)[1, 1], history[1, 1])


def test_bad_input():
    image = np.ones((4, 5, 3), np.float32)
    for name in ("box", "window", "space", "response"):
        with pytest.raises(ValueError, match=rf'{name}: expected one of ".*", got "none"'):
            yester.clip_history(image, image, **{name: "none"})
    for gamma in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="gamma"):
            yester.clip_history(image, image, gamma=gamma)
    with pytest.raises(ValueError, match="ellipsoid"):
        yester.clip_history(image, image, response="ellipsoid", box="minmax")
    with pytest.raises(ValueError, match="color: expected height 4 and width 5"):
        yester.clip_history(image, image[1:])
    with pytest.raises(ValueError, match="history"):
        yester.clip_history(image[..., 0], image)
