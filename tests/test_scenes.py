from itertools import pairwise

import mitsuba as mi
import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester.io.mitsuba import render_sequence
from yester.study.rendered import build, scenes

pytestmark = pytest.mark.slow

NAMES = scenes.SEQUENCES


def test_names():
    """Each sequence is either for tuning or held out."""
    assert sorted(NAMES) == sorted(name for name in scenes.__all__ if name.islower())
    assert sorted({*scenes.TUNING, *scenes.HELD_OUT}) == sorted(NAMES) == sorted(scenes.TUNING + scenes.HELD_OUT)
    assert len(NAMES) == 10


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
    """It renders, contains motion, is exposed like a photograph, and is the same every time."""
    first, again = (getattr(scenes, name)(2, 24, 18) for _ in range(2))
    assert len(first.cameras) == len(first.transforms) == len(first.parameters) == 2
    assert first.transforms[0].keys() == first.transforms[1].keys()
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


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_pace(name):
    """A few pixels per frame, at the intended size and length."""
    whole = getattr(scenes, name)()
    assert {(camera.width, camera.height) for camera in whole.cameras} == {(320, 240)}
    assert len(whole.cameras) == len(whole.transforms) == len(whole.parameters) == 24
    moving = (whole.cameras, whole.transforms, whole.parameters)
    frames = render(scenes.Sequence(whole.scene, *(each[11:13] for each in moving)))
    speed = np.linalg.norm(frames[1].motion[..., :2], axis=-1)
    assert 0.5 < np.median(speed) < 3
    assert 1 < np.percentile(speed, 95) < 7


def test_switched_light():
    """Three frames: the ceiling's light, the ball's light alone, the lamp."""
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
    """Neighbouring pixels, and samples of one pixel, show different things."""
    sequence = scenes.thicket(1)
    one, other = (render(sequence, seed=seed)[0].ids for seed in (0, 1))
    names = [shape.id() for shape in mi.load_dict(sequence.scene, parallel=False, optimize=False).shapes()]
    leaves = 1 + names.index("leaves")
    assert (one == leaves).mean() > 0.1
    assert (other[one == leaves] != leaves).mean() > 0.2


def still(sequence, *moments):
    """Moments of the sequence from the first one's camera: replays, and the mask of samples that hit the same point."""
    views = [sequence.cameras[moments[0]]] * len(moments)
    states = [[each[i] for i in moments] for each in (sequence.transforms, sequence.parameters)]
    return render(scenes.Sequence(sequence.scene, views, *states), gradient=True)


def ids(sequence):
    """The id of each shape, by name."""
    shapes = mi.load_dict(sequence.scene, parallel=False, optimize=False).shapes()
    return {shape.id(): number for number, shape in enumerate(shapes, 1)}


def test_mirror_room_reflects_motion():
    """With the same random numbers and a static camera, the mirror's image changes while the mirror stays."""
    sequence = scenes.mirror_room(8, 80, 60)
    before, frame = still(sequence, 3, 4)
    mirror = before.ids == ids(sequence)["mirror"]
    known = mirror & np.isfinite(frame.replay).all(-1)
    changed = (frame.replay != before.color).any(-1)
    assert known.sum() > 500
    assert 0.03 < changed[known].mean() < 0.5
    assert not frame.motion[frame.ids == ids(sequence)["mirror"]].any()
    # It rolls on the floor without sliding.
    for then, now in pairwise(moment["ball"] for moment in sequence.transforms):
        turn = now[:3, :3] @ then[:3, :3].T
        assert now[0, 3] - then[0, 3] == pytest.approx(-0.45 * np.arctan2(turn[1, 0], turn[0, 0]))
        assert now[1, 3] == 0.45 - 1


def test_many_lights():
    """Each sample is lit by a different light, so that the noise is coloured."""
    sequence = scenes.many_lights(1, 48, 36)
    number = ids(sequence)
    lights = [sequence.scene[name]["emitter"]["radiance"]["value"] for name in number if name.startswith("light")]
    assert len(lights) == 30
    assert len({tuple(light) for light in lights}) == 6
    tints = []
    for spp in (1, 32):
        (frame,) = render(sequence, spp=spp)
        lit = frame.color[(frame.ids == number["wall"]) & (frame.color.sum(-1) > 1e-3)]
        tints.append((lit / lit.sum(-1, keepdims=True)).std(0).mean())
    assert tints[0] > max(0.2, 2 * tints[1])


def test_sunlit_teapot():
    """The sun is at the documented place, and lights the table more than all other light."""
    sun = np.array([-0.55, 0.5, 0.45])
    sky = scenes.sunlit_teapot(1).scene["sky"]
    camera = yester.Camera.from_look_at([0, 0, 0], sun, [0, 1, 0], 20, 21, 21)
    (frame,) = render_sequence({"type": "scene", "sky": sky}, [camera], spp=4)
    bright = np.argwhere(frame.emission[..., 0] > 100)
    np.testing.assert_allclose(bright.mean(0), 10, atol=0.5)
    picture = build.sky(sun)
    polar = (np.arange(256)[:, None] + 0.5) / 256 * np.pi
    light = (picture[..., 1] * np.sin(polar) * np.cos(polar))[:128]
    shining = picture[:128, :, 0] > 100
    assert light[shining].sum() > 1.5 * light[~shining].sum()


def test_moving_light_sweeps_over_static_surfaces():
    """Light on static surfaces changes from frame to frame; the lamp is in view in the middle of the sequence."""
    sequence = scenes.moving_light(9, 64, 48)
    number = ids(sequence)
    lamp = [number[name] for name in ("lamp", "shade", "lid")]
    before, frame = still(sequence, 3, 4)
    assert not frame.motion[~np.isin(frame.ids, lamp)].any()
    assert np.isin(frame.ids, lamp).sum() > 20
    known = ~np.isin(before.ids, lamp) & np.isfinite(frame.replay).all(-1)
    assert known.mean() > 0.9
    change = np.abs(frame.replay - before.color).max(-1) > 0.1 * before.color.max(-1)
    assert change[known].mean() > 0.2
    for i in (0, 8):
        (end,) = still(sequence, i)
        assert not np.isin(end.ids, lamp).any()


def test_tapestry_is_as_fine_as_pixels():
    """Two samples of one pixel hit different texture colours, which cause all of the noise."""
    sequence = scenes.tapestry(1)
    one, other = (render(sequence, seed=seed)[0] for seed in (0, 1))
    number = ids(sequence)
    for name in ("tapestry", "carpet", "picture", "left page", "right page"):
        here = (one.ids == number[name]) & (other.ids == number[name])
        assert here.mean() > 0.015, name
        apart = np.abs(one.albedo - other.albedo).max(-1)[here]
        assert (apart > 0.1).mean() > 0.25, name
    wall = (one.ids == number["wall"]) & (other.ids == number["wall"])
    assert_same_bits(one.albedo[wall], other.albedo[wall])
