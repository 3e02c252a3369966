from itertools import pairwise

import numpy as np
import pytest
import yester
from test_scenes import ids, render
from yester.study.rendered import fresh, scenes

pytestmark = pytest.mark.slow


def lit_by(sequence, frame, depth):
    """A frame's light of so many segments, without noise to speak of."""
    scene = sequence.scene | {"integrator": {"type": "path", "max_depth": depth}}
    states = (sequence.cameras, sequence.transforms, sequence.parameters)
    some = scenes.Sequence(scene, *([each[frame]] for each in states))
    (found,) = render(some, spp=64, buffers=False)
    return found.color


def test_handheld():
    """Every frame is a few pixels from the one before, in any direction, and rolled."""
    cameras = fresh.handheld(24, 320, 240).cameras
    moved = [
        yester.motion_vectors(np.full((240, 320), 4.0), now, before)[120, 160, :2] for before, now in pairwise(cameras)
    ]
    length = np.linalg.norm(moved, axis=-1)
    assert 0.5 < np.median(length) < 20
    assert np.abs(np.mean(moved, 0)).max() < np.median(length)
    assert np.ptp([np.arctan2(*camera.world_to_clip[1, :2]) for camera in cameras]) > 0.05


def test_confetti():
    """Scraps fall and turn, each for itself, and cover some of the image; all else stands still."""
    sequence = fresh.confetti(3, 160, 120)
    frames = render(sequence)
    scraps = {number for name, number in ids(sequence).items() if name.startswith("scrap")}
    for frame in frames[1:]:
        falls = np.isin(frame.ids, [*scraps])
        assert 0.02 < falls.mean() < 0.3
        assert (np.abs(frame.motion[~falls][:, :2]) < 1e-3).all()
        assert np.median(np.linalg.norm(frame.motion[falls][:, :2], axis=-1)) > 1


def test_television():
    """It is the only light. Its picture is another one from every fifth of 24 frames on, and moves in between."""
    sequence = fresh.television()
    # Of black pictures, Mitsuba cannot sample a place.
    dark = {"screen.emitter.radiance.data": np.full((32, 48, 3), 1e-9, np.float32)}
    (frame,) = render(scenes.Sequence(sequence.scene, sequence.cameras[:1], sequence.transforms[:1], [dark]))
    assert frame.color.max() < 1e-7
    shown = [keys["screen.emitter.radiance.data"] for keys in sequence.parameters]
    changes = [np.abs(now - before).mean() / before.mean() for before, now in pairwise(shown)]
    cuts = [i for i, change in enumerate(changes, 1) if change > 0.25]
    assert cuts == [5, 10, 15, 20]
    assert all(change > 0.001 for change in changes)


def test_leaves():
    """Masks are cut out of rectangles: colour shows what lies behind their holes, but guides show the rectangles."""
    sequence = fresh.leaves(1, 160, 120)
    (frame,) = render(sequence, spp=64)
    cut = {
        name: {"type": "rectangle", "to_world": shape["to_world"], "bsdf": shape["bsdf"]["nested"]}
        for name, shape in sequence.scene.items()
        if name.startswith("leaf")
    }
    (whole,) = render(scenes.Sequence(sequence.scene | cut, sequence.cameras, [{}], [{}]), spp=64)
    np.testing.assert_array_equal(frame.ids, whole.ids)
    leaf = np.isin(frame.ids, [number for name, number in ids(sequence).items() if name.startswith("leaf")])
    apart = np.abs(frame.color - whole.color).mean(-1) > 0.3 * whole.color.mean(-1)
    assert 0.2 < apart[leaf].mean() < 0.8


def test_pool():
    """Water covers much of the image; by its waves, the light on the floor is uneven."""
    sequence = fresh.pool(1, 96, 72)
    (frame,) = render(sequence)
    assert 0.3 < (frame.ids == ids(sequence)["water"]).mean() < 0.9
    light = lit_by(sequence, 0, 8)[40:, 20:80].mean(-1)
    assert light.std() > 0.1 * light.mean()


def test_spotlights():
    """Each lamp goes its own way, and changes the light of the stage."""
    sequence = fresh.spotlights(3, 48, 36)
    places = np.array([[pose[f"lamp {i}"][:3, 3] for i in range(3)] for pose in sequence.transforms])
    assert np.linalg.norm(np.diff(places, axis=0), axis=-1).min() > 0.2
    steps = np.diff(places, axis=0)[0]
    assert np.abs(steps[:, None] - steps).max(-1)[~np.eye(3, dtype=bool)].min() > 0.1
    first, last = (lit_by(sequence, i, 4) for i in (0, 2))
    assert np.median(np.abs(first - last)) > 0.1 * np.median(first)


def test_attic():
    """Most of the image is lit indirectly alone, and half of the light is indirect."""
    sequence = fresh.attic(1, 64, 48)
    direct, all_light = (lit_by(sequence, 0, depth) for depth in (2, 8))
    assert np.median(direct) < 0.02 * np.median(all_light)
    assert direct.mean() < 0.6 * all_light.mean()
