from itertools import pairwise

import mitsuba as mi
import numpy as np
import pytest
from compare import assert_same_bits
from yester.io.mitsuba import render_sequence
from yester.study import scenes

NAMES = [name for name in scenes.__all__ if name != "Sequence"]


def render(sequence, **options):
    return list(
        render_sequence(
            sequence.scene,
            sequence.cameras,
            transforms=sequence.transforms,
            parameters=sequence.parameters,
            **options,
        )
    )


@pytest.mark.parametrize("name", NAMES)
def test_sequence(name):
    """It renders, shows something that moves at about the exposure of a photograph, and is the same every time."""
    first, again = (getattr(scenes, name)(2, 24, 18) for _ in range(2))
    assert len(first.cameras) == len(first.transforms) == len(first.parameters) == 2
    frames = render(first, gradient=True)
    for frame, other in zip(frames, render(again, gradient=True), strict=True):
        assert frame.shape == (18, 24)
        assert np.isfinite(frame.color).all()
        assert np.isfinite(frame.depth).mean() > 0.3
        assert len(np.unique(frame.ids)) > 2
        assert 0 < np.median(frame.albedo) <= 1
        for buffer, array in frame.buffers().items():
            assert_same_bits(array, other.buffers()[buffer])
    assert not frames[0].motion.any()
    assert np.isfinite(frames[1].motion[frames[1].ids > 0]).all()
    assert np.median(np.abs(frames[1].motion[..., :2])) > 0.1


@pytest.mark.parametrize("name", NAMES)
def test_pace(name):
    """A few pixels a frame, at the size and length that were meant."""
    whole = getattr(scenes, name)()
    assert {(camera.width, camera.height) for camera in whole.cameras} == {(320, 240)}
    assert len(whole.cameras) == len(whole.transforms) == len(whole.parameters) == 24
    moving = (whole.cameras, whole.transforms, whole.parameters)
    frames = render(scenes.Sequence(whole.scene, *(each[11:13] for each in moving)))
    speed = np.linalg.norm(frames[1].motion[..., :2], axis=-1)
    assert 0.5 < np.median(speed) < 3
    assert 1 < np.percentile(speed, 95) < 7


def test_switched_light():
    """Three frames: the ceiling's light, the ball alone, and then the lamp."""
    sequence = scenes.switched_light(3, 24, 18)
    bright, dim, red = (frame.color for frame in render(sequence, spp=32, buffers=False))
    light = [np.percentile(color, 75) for color in (bright, dim, red)]
    assert light[1] < 0.5 * min(light[0], light[2])
    tint = [np.median(color[..., 0] / color[..., 2].clip(1e-3)) for color in (bright, dim, red)]
    assert tint[1] < tint[0] < tint[2]
    frames = render(sequence, gradient=True)
    for before, frame in pairwise(frames):
        assert np.isfinite(frame.replay).all()
        assert (frame.replay != before.color).any(-1).mean() > 0.1
    moments = scenes.switched_light().parameters
    switched = [i for i in range(1, 24) if moments[i] != moments[i - 1]]
    assert switched == [8, 16]


def test_thicket_is_finer_than_pixels():
    """Neighbours are different things, and samples of one pixel too."""
    sequence = scenes.thicket(1)
    one, other = (render(sequence, seed=seed)[0].ids for seed in (0, 1))
    names = [shape.id() for shape in mi.load_dict(sequence.scene, parallel=False, optimize=False).shapes()]
    leaves = 1 + names.index("leaves")
    assert (one == leaves).mean() > 0.1
    assert (other[one == leaves] != leaves).mean() > 0.2
