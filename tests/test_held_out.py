from itertools import pairwise

import numpy as np
import pytest
import yester
from test_scenes import ids, render
from yester.study.rendered import held_out, scenes

pytestmark = pytest.mark.slow


def some(sequence, *moments):
    """The sequence at these moments only."""
    states = (sequence.cameras, sequence.transforms, sequence.parameters)
    return scenes.Sequence(sequence.scene, *([each[i] for i in moments] for each in states))


@pytest.mark.parametrize("name", held_out.NAMES)
def test_pace_and_motion(name):
    """Pixels move at the intended pace, normals face the camera, and forward motion is backward motion, inverted."""
    one, other = render(some(getattr(held_out, name)(24, 80, 60), 11, 12), next=True)
    speed = np.linalg.norm(other.motion[..., :2], axis=-1)
    # At the intended size, 320x240.
    assert 0.25 < 4 * np.median(speed) < 16
    assert one.motion_next[one.ids > 0].any()
    assert not other.motion_next.any()
    ray = one.position - one.camera.position.astype(np.float32)
    facing = (one.normal * ray).sum(-1)[one.ids > 0] < 0
    assert facing.mean() > 0.97
    back = yester.invert_motion(other.motion, other.depth)
    known = np.isfinite(back).all(-1) & np.isfinite(one.motion_next).all(-1) & (one.ids > 0)
    apart = np.linalg.norm(back - one.motion_next, axis=-1)[known]
    assert known.mean() > 0.4
    assert np.median(apart) < 0.1 * (1 + np.median(speed))


def test_opening_door():
    """Static surfaces are lit more and more; the door turns about its hinge, which stays in place."""
    sequence = held_out.opening_door(5, 48, 36)
    still = scenes.Sequence(sequence.scene, sequence.cameras[:1] * 3, sequence.transforms[::2], [{}] * 3)
    light = [np.percentile(frame.color.mean(-1), 60) for frame in render(still, spp=64, buffers=False)]
    assert all(now > 1.15 * then for then, now in pairwise(light))
    for pose in sequence.transforms:
        door = pose["door"]
        np.testing.assert_allclose(door @ [0.15, 0.3, -1.6, 1], [0.15, 0.3, -1.6, 1])
        assert (door @ [0.9, 0, -1.6, 1])[2] < -1.6
        np.testing.assert_array_equal(door, pose["handle"])
    first, last = (render(some(sequence, i))[0].ids == ids(sequence)["hall"] for i in (0, 4))
    assert first.mean() < 0.01 < last.mean()


def test_passing_day():
    """The camera turns in place; the sun is up and never in view, and half of the ground changes its light."""
    sequence = held_out.passing_day(9, 64, 48)
    places = np.array([camera.position for camera in sequence.cameras])
    assert np.ptp(places, axis=0).max() < 1e-6
    suns = np.array([(pose["sun"] @ [0, 0, 40, 1])[:3] for pose in sequence.transforms])
    np.testing.assert_allclose(np.linalg.norm(suns, axis=1), 40)
    assert suns[:, 1].min() > 5
    sun = ids(sequence)["sun"]
    assert not any((frame.ids == sun).any() for frame in render(sequence))
    poses = scenes.Sequence(sequence.scene, sequence.cameras[:1] * 2, sequence.transforms[3:5], [{}, {}])
    before, after = (frame.color.mean(-1) for frame in render(poses, spp=16, buffers=False))
    seen = before + after > 0.05
    assert (np.abs(before - after) > 0.2 * (before + after))[seen].mean() > 0.1


def test_glass_shelf():
    """Glass, metal and paint in small pieces, in about equal amounts."""
    sequence = held_out.glass_shelf(1, 96, 72)
    (frame,) = render(sequence)
    number = ids(sequence)
    things = {name: i for name, i in number.items() if name.startswith("thing")}
    seen = {name: (frame.ids == i).mean() for name, i in things.items()}
    assert len(things) == 39
    assert sum(share > 0 for share in seen.values()) > 30
    assert max(seen.values()) < 0.03
    clear = [name for name in things if "dielectric" in str(sequence.scene[name])]
    assert len(clear) > 12
    assert (frame.albedo[np.isin(frame.ids, [things[name] for name in clear])] == 1).all()


def test_carousel():
    """It turns as a whole, riders rise and sink, and a fixed camera zooms in."""
    sequence = held_out.carousel(7, 48, 36)
    places = np.array([camera.position for camera in sequence.cameras])
    assert np.ptp(places, axis=0).max() < 1e-6
    zooms = [np.linalg.norm(camera.world_to_clip[1, :3]) for camera in sequence.cameras]
    assert zooms == sorted(zooms)
    assert 1.5 < zooms[-1] / zooms[0] < 2
    for pose in sequence.transforms:
        for name, matrix in pose.items():
            np.testing.assert_allclose(matrix[:3, :3], pose["deck"][:3, :3])
            assert matrix[[0, 2], 3].tolist() == [0, 0]
            assert abs(matrix[1, 3]) <= (0.16 if name.startswith("rider") else 0)
    rising = np.array([pose["rider-1"][1, 3] for pose in sequence.transforms])
    assert rising.max() > 0.1
    assert rising.min() < -0.1
    frames = render(some(sequence, 0, 3, 6))
    deck = ids(sequence)["deck"]
    assert [np.mean(frame.ids == deck) for frame in frames] == sorted(np.mean(frame.ids == deck) for frame in frames)


def test_neon_corridor():
    """Its signs are its only lights: textured emission, mirrored in the floor."""
    sequence = held_out.neon_corridor(2, 96, 72)
    frames = render(sequence)
    number = ids(sequence)
    lights = [name for name, shape in sequence.scene.items() if isinstance(shape, dict) and "emitter" in shape]
    assert sorted(lights) == sorted(name for name in number if name.startswith("sign"))
    assert not {"sky", "lamp"} & number.keys()
    for frame in frames:
        sign = np.isin(frame.ids, [number[name] for name in lights])
        assert 0.01 < sign.mean() < 0.2
        assert (frame.emission[~sign] == 0).all()
        bright = frame.emission[sign].max(-1)
        assert bright.max() > 10 * np.median(bright)
    # A pan: its first and last views do not overlap.
    assert np.linalg.norm(frames[1].motion[..., :2], axis=-1).min() > 48
