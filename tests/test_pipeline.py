"""Common behaviour of all pipelines: parameters in the repr, copies, pickling, reset."""

import copy
import inspect
import pickle
import threading
from dataclasses import replace

import flight
import numpy as np
import pytest
import yester
from compare import assert_same_bits

CALLS = {
    "SVGF()": yester.SVGF,
    "SVGF(alpha=0.1, reflections=(1.0,), normal_angle=(10, 40))": lambda: yester.SVGF(
        alpha=0.1, reflections=(1.0,), normal_angle=(10, 40)
    ),
    "BMFR(block=8)": lambda: yester.BMFR(block=8),
    "HalfRes(weight=0.2)": lambda: yester.HalfRes(weight=0.2),
    "TAA('karis', alpha=0.2)": lambda: yester.TAA("karis", alpha=0.2),
    "Recirculation(levels=3)": lambda: yester.Recirculation(levels=3),
    "Upscaler(1.5, sharpness=0.5)": lambda: yester.Upscaler(1.5, sharpness=0.5),
    "OIDN('fast', temporal=True, fireflies=False, innovation=True, choice=True)": lambda: yester.OIDN(
        "fast", temporal=True
    ),
}
COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "repr": lambda value: eval(f"yester.{value!r}"),
}
NAMES = ("color", "variance", "choice", "history_length", "confidence", "rejection")


def frames(count=3):
    rng = np.random.default_rng(0)
    camera = yester.Camera.from_look_at([0, 0, 3], [0, 0, 0], [0, 1, 0], 50, 20, 16)
    depth = np.ones((16, 20), np.float32)
    return [yester.Frame(rng.random((16, 20, 3), np.float32), depth=depth, camera=camera) for _ in range(count)]


@pytest.mark.parametrize("call", CALLS)
def test_repr_has_the_parameters(call):
    assert repr(CALLS[call]()) == call


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("call", CALLS)
def test_copies_begin_a_sequence_of_their_own(call, way):
    pipeline = CALLS[call]()
    first, *rest = frames()
    want = pipeline.step(first)
    other = COPIES[way](pipeline)
    assert type(other) is type(pipeline)
    assert repr(other) == call
    got = other.step(first)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    # The original continues with its history.
    again = CALLS[call]()
    again.step(first)
    for frame in rest:
        np.testing.assert_array_equal(pipeline.step(frame).color, again.step(frame).color)


def test_parameters_are_those_of_the_call():
    distances = [0.5, 1.0]
    pipeline = yester.SVGF(reflections=distances)
    distances.append(2.0)
    assert repr(pipeline) == "SVGF(reflections=[0.5, 1.0])"
    assert "alpha=0.2" in str(inspect.signature(yester.SVGF))
    with pytest.raises(TypeError, match="beta"):
        yester.SVGF(beta=1)


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.TAA])
@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
def test_outputs(pipeline, way):
    output = pipeline().step(frames(1)[0])
    other = COPIES[way](output)
    assert (other.used, other.missing, repr(other)) == (output.used, output.missing, repr(output))
    for name in NAMES:
        mine, its = getattr(output, name), getattr(other, name)
        np.testing.assert_array_equal(its, mine)
        assert mine is None or (its is mine) == (way == "copy")


@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
def test_frames_and_cameras(way):
    (frame,) = frames(1)
    other = COPIES[way](frame)
    assert other.camera == frame.camera
    assert COPIES[way](frame.camera) == frame.camera
    for name, buffer in frame.buffers().items():
        np.testing.assert_array_equal(getattr(other, name), buffer)


@pytest.mark.parametrize("pipeline", [yester.SVGF, yester.TAA])
def test_the_largest_numbers_do_not_turn_black(pipeline):
    """Sums of many large colours stay finite."""
    frame = yester.Frame(np.full((16, 20, 3), 1e38, np.float32))
    steps = pipeline()
    for _ in range(3):
        color = steps.step(frame).color
        assert np.isfinite(color).all()
        assert color.min() > 1e36


@pytest.mark.parametrize("brightest", [1e20, 1e38])
@pytest.mark.parametrize("make", [yester.SVGF, yester.BMFR, yester.TAA, lambda: yester.OIDN("fast", temporal=True)])
def test_a_broken_pixel_spoils_its_surroundings_at_most(make, brightest):
    """Pixels far from it are as bright as ever: neither black, nor brighter than the samples."""
    random = np.random.default_rng(0)
    size = (96, 96)
    rest = {"albedo": np.full((*size, 3), 0.5), "normal": np.full((*size, 3), [0.0, 0, 1]), "depth": np.ones(size)}
    steps = make()
    for i in range(6):
        color = random.random((*size, 3)).astype(np.float32)
        if i == 2:
            color[40, 50] = brightest
        seen = steps.step(yester.Frame(color, motion=np.zeros((*size, 2)), **rest)).color
        assert np.isfinite(seen).all()
        far = np.ones(size, bool)
        far[16:72, 24:80] = False
        assert 0.4 < seen[far].mean() < 0.6
        assert seen[far].max() < 2


@pytest.mark.parametrize("make", [yester.TAA, yester.Recirculation])
def test_the_former_name_of_textbook_serves_with_a_warning(make):
    camera = yester.Camera([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1], [0, 0, 1, 0]], 9, 7)
    with pytest.warns(DeprecationWarning, match=r'^preset: "seed" is now "textbook"$'):
        former = make("seed")
    current = make("textbook")
    random = np.random.default_rng(0)
    for _ in range(3):
        frame = yester.Frame(random.random((7, 9, 3)), depth=np.ones((7, 9)), camera=camera)
        assert_same_bits(former.step(frame).color, current.step(frame).color)


def test_no_preset_is_called_so_by_the_error():
    with pytest.raises(ValueError, match="textbook") as error:
        yester.TAA("seeds")
    assert "'seed'" not in str(error.value)
    assert '"seed"' not in str(error.value)


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("make", [yester.SVGF, yester.BMFR, yester.HalfRes, yester.TAA])
def test_depth_of_background(make, channels):
    """Depth of 0 where nothing was hit, and no motion there, are as good as infinite depth."""
    rng, pipelines = np.random.default_rng(0), (make(), make())
    for number in range(4):
        frame = flight.shoot(number, 48, 32)
        missed = np.isposinf(frame.depth)
        assert 0.1 < missed.mean() < 0.9
        motion = np.where(missed[..., None], 0, frame.motion)[..., :channels]
        frame = replace(frame, color=flight.noisy(frame, rng), position=None, motion=motion)
        coded = replace(frame, depth=np.where(missed, np.float32(0), frame.depth))
        got, want = (pipeline.step(given) for pipeline, given in zip(pipelines, (coded, frame), strict=True))
        assert_same_bits(got.color, want.color)
    assert got.confidence[missed].mean() > 0.5


def test_a_second_thread_is_told_so():
    """The interpreter's lock is free during a step, so that another thread may call the same pipeline."""
    pipeline = yester.TAA()
    frame = yester.Frame(np.ones((600, 800, 3), np.float32))
    errors: list[RuntimeError] = []

    def work():
        while not errors:
            try:
                pipeline.step(frame)
            except RuntimeError as error:
                errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert str(errors[0]) == "TAA: expected one thread at a time, got a call while another thread is in a step"
    assert pipeline.step(frame).color.shape == (600, 800, 3)
