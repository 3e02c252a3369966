import pickle
from dataclasses import replace

import compare
import flight
import numpy as np
import pytest
import torch
import yester


def buffers(height=4, width=6):
    rng = np.random.default_rng(0)
    vector = lambda: rng.normal(0, 1, (height, width, 3)).astype(np.float32)  # noqa: E731
    named = {name: vector() for name in ("color", "albedo", "normal", "position", "emission")}
    named |= {"object_normal": vector(), "replay": vector()}
    named["hit_distance"] = rng.exponential(1, (height, width)).astype(np.float32)
    named |= compare.surfaces(rng, height, width) | {"motion": compare.motions(rng, height, width)}
    return named


def test_keeps_canonical_arrays():
    """Without a copy, in canonical order, with its sizes as attributes."""
    given = buffers()
    frame = yester.Frame(**given, camera=flight.camera(0, 6, 4))
    order = ["color", "albedo", "normal", "depth", "motion", "ids", "position", "emission"]
    order += ["object_normal", "replay", "hit_distance"]
    assert list(frame.buffers()) == order
    for name, buffer in frame.buffers().items():
        np.testing.assert_array_equal(buffer, given[name])
        assert np.shares_memory(buffer, given[name])
        assert getattr(frame, name) is buffer
    assert (frame.height, frame.width, frame.shape) == (4, 6, (4, 6))
    assert frame.camera == flight.camera(0, 6, 4)


def test_everything_but_colour_is_optional():
    frame = yester.Frame(buffers()["color"])
    assert list(frame.buffers()) == ["color"]
    assert frame.depth is frame.camera is frame.jitter is None
    for name, buffer in buffers().items():
        assert set(yester.Frame(**{"color": buffers()["color"], name: buffer}).buffers()) == {"color", name}
    motion = compare.motions(np.random.default_rng(0), 4, 6, 3)
    assert yester.Frame(buffers()["color"], motion=motion).motion.shape == (4, 6, 3)


@pytest.mark.parametrize(
    "convert",
    [
        np.asfortranarray,
        lambda a: a.astype(np.float64),
        lambda a: a[::-1].copy()[::-1],
        lambda a: torch.from_numpy(a.copy()),
        lambda a: torch.from_numpy(a.astype(np.float64)),
    ],
    ids=["fortran", "float64", "negative", "torch", "torch64"],
)
def test_converts_once(convert):
    given = buffers()
    converted = {name: convert(value) if value.dtype == np.float32 else value for name, value in given.items()}
    for name, buffer in yester.Frame(**converted).buffers().items():
        assert type(buffer) is np.ndarray
        assert buffer.flags.c_contiguous
        assert buffer.dtype == (np.uint32 if name == "ids" else np.float32)
        np.testing.assert_array_equal(buffer, given[name])


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int32, np.int64, np.uint64])
def test_ids_of_any_integers(dtype):
    ids = np.arange(24).reshape(4, 6)
    got = yester.Frame(buffers()["color"], ids=ids.astype(dtype)).ids
    assert got.dtype == np.uint32
    np.testing.assert_array_equal(got, ids)


@pytest.mark.parametrize("ids", [-1, 2**32])
def test_ids_out_of_range(ids):
    with pytest.raises(ValueError, match="ids"):
        yester.Frame(buffers()["color"], ids=np.full((4, 6), ids, np.int64))


def test_subclasses_of_arrays():
    """A matrix multiplies in another way."""
    color, depth = np.ones((4, 5, 3), np.float32), np.ones((4, 5), np.float32)
    frame = yester.Frame(color, depth=depth.view(np.matrix))
    assert type(frame.depth) is np.ndarray
    assert np.shares_memory(frame.depth, depth)
    with pytest.raises(TypeError, match=r"^color: expected an array without a mask, got a masked one"):
        yester.Frame(np.ma.masked_greater(color, 2))
    with pytest.raises(TypeError, match=r"^jitter: expected an array without a mask, got a masked one"):
        yester.Frame(color, jitter=np.ma.masked_array([0.1, 0.2], True))


def test_read_only():
    frame = yester.Frame(buffers()["color"])
    with pytest.raises(AttributeError):
        frame.color = None
    with pytest.raises(AttributeError):
        frame.other = 1


def test_replace_makes_another_without_copies():
    frame = yester.Frame(**buffers(), camera=flight.camera(0, 6, 4), jitter=(0.25, -0.5))
    other = replace(frame, depth=None)
    assert other.depth is None
    assert other.color is frame.color
    assert (other.camera, other.jitter) == (frame.camera, frame.jitter)
    with pytest.raises(ValueError, match="albedo"):
        replace(frame, albedo=np.zeros((2, 2, 3), np.float32))


def test_pickles():
    frame = yester.Frame(**buffers(), camera=flight.camera(0, 6, 4), jitter=(0.25, -0.5))
    again = pickle.loads(pickle.dumps(frame))
    assert again.camera == frame.camera
    assert again.jitter == frame.jitter
    for (name, got), (want_name, want) in zip(again.buffers().items(), frame.buffers().items(), strict=True):
        assert name == want_name
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("name", sorted(buffers()))
def test_bad_buffers(name):
    given = buffers()
    for wrong, error in [
        (given[name][:-1], ValueError),
        (given[name][:, 1:], ValueError),
        (given[name][0], ValueError),
        (np.moveaxis(given[name], -1, 0), ValueError),
        (np.zeros((4, 6, 5), given[name].dtype), ValueError),
        (given[name].astype(bool), TypeError),
        (given[name].astype(np.complex64), TypeError),
        (given[name].astype(object), TypeError),
        (np.ones_like(given[name], np.float32 if name == "ids" else np.int32), TypeError),
    ]:
        if name == "color" and np.shape(wrong)[-1] == 3 and np.ndim(wrong) == 3 and error is ValueError:
            continue  # another size of colour is reported for the other buffers
        with pytest.raises(error, match=name):
            yester.Frame(**{**given, name: wrong})


@pytest.mark.parametrize("shape", [(0, 6, 3), (4, 0, 3), (4, 6, 0), (4, 6), (4, 6, 4)])
def test_bad_colour(shape):
    with pytest.raises(ValueError, match="color"):
        yester.Frame(np.zeros(shape, np.float32))


def test_bad_camera():
    with pytest.raises(ValueError, match="camera"):
        yester.Frame(buffers()["color"], camera=flight.camera(0, 5, 4))
    with pytest.raises(TypeError, match="camera"):
        yester.Frame(buffers()["color"], camera=np.eye(4))


def test_jitter():
    for jitter in yester.jitter(8):
        got = yester.Frame(buffers()["color"], jitter=jitter).jitter
        assert got == tuple(jitter)
        assert [type(value) for value in got] == [float, float]
    frame = yester.Frame(buffers()["color"], jitter=[-0.5, 0.5])
    assert frame.jitter == (-0.5, 0.5)
    assert repr(frame) == "Frame(6x4: color, jitter)"


@pytest.mark.parametrize("jitter", [0.1, (0.1, 0.2, 0.3), np.zeros((1, 2)), (0, 0.51), (-8, 0), (np.nan, 0)])
def test_bad_jitter(jitter):
    with pytest.raises(ValueError, match="jitter: expected"):
        yester.Frame(buffers()["color"], jitter=jitter)
    with pytest.raises(TypeError, match="jitter: expected floats"):
        yester.Frame(buffers()["color"], jitter=["left", "up"])


def test_channels_first_is_explained():
    """The most common mistake: the message names the argument and both shapes."""
    with pytest.raises(ValueError, match=r"motion.*\(2, 4, 6\)") as error:
        yester.Frame(buffers()["color"], motion=np.zeros((2, 4, 6), np.float32))
    assert "4" in str(error.value)
