import compare
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, each, tensor
from yester.study.synthetic import raycast


def both(geometry, *cameras, **named):
    got = yester.motion_vectors(geometry, *cameras, **named)
    assert got.dtype == np.float32
    want = reference.motion_vectors(tensor(geometry), *cameras, **{k: tensor(v) for k, v in named.items()}).numpy()
    # Stored in float32: each value to its own rounding, plus the rounding of float64 pixel coordinates.
    assert_close("motion_vectors", got, want, rtol=1e-6, scale=1e-3)
    return got


@each(("height", "width"), SIZES + TAILS)
def test_reference(height, width):
    rng = np.random.default_rng(width)
    cameras = [compare.camera(rng, width, height) for _ in range(2)]
    both(compare.surfaces(rng, height, width)["depth"], *cameras)
    position = (rng.normal(0, 2, (height, width, 3)) - [0, 0, 6]).astype(np.float32)
    position[rng.random((height, width)) < 0.1] = np.nan
    ids = rng.integers(1, 4, (height, width)).astype(np.uint32)
    transforms = {i: np.eye(4) + rng.normal(0, 0.3, (4, 4)) for i in (2, 3, 77)}
    for matrix in transforms.values():
        matrix[3] = [0, 0, 0, 1]
    both(position, *cameras)
    both(position, *cameras, ids=ids, transforms=transforms)


def test_both_sides_of_the_cameras():
    """Points in front, behind, and undefined: NaN in all channels or in none, and both occur."""
    rng = np.random.default_rng(0)
    cameras = [compare.camera(rng, 32, 32) for _ in range(2)]
    got = np.isnan(both(rng.normal(0, 3, (32, 32, 3)).astype(np.float32), *cameras))
    assert 0 < got.mean() < 1
    np.testing.assert_array_equal(got.all(-1), got.any(-1))


def test_no_depth_no_motion():
    camera = flight.camera(0, 4, 4)
    geometry = np.ones((4, 4), np.float32)
    geometry[1, 2] = np.nan
    motion = yester.motion_vectors(geometry, camera, camera)
    np.testing.assert_array_equal(np.isnan(motion).all(-1), geometry != 1)
    np.testing.assert_array_equal(np.isnan(motion).any(-1), geometry != 1)


@pytest.mark.parametrize("depth", [0.0, -1.0, -np.inf])
def test_depth_of_background(depth):
    """Renderers store 0 where nothing was hit, too."""
    cameras = flight.camera(1, 4, 4), flight.camera(0, 4, 4)
    geometry = np.ones((4, 4), np.float32)
    geometry[1, 2] = depth
    motion = yester.motion_vectors(geometry, *cameras)
    geometry[1, 2] = np.inf
    np.testing.assert_array_equal(motion, yester.motion_vectors(geometry, *cameras))
    np.testing.assert_array_equal(motion[1, 2, 2], 0)


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_nothing_moves(buffer):
    """With the same camera twice, motion is exactly zero."""
    shot = flight.shoot(3, 33, 21)
    assert not np.isfinite(shot.depth).all()
    motion = yester.motion_vectors(getattr(shot, buffer), shot.camera, shot.camera)
    np.testing.assert_array_equal(motion, np.zeros_like(motion))


def test_infinity_turns_but_does_not_travel():
    places = ([0, 0, 0], [0, 0, -1]), ([3, 0, 0], [3, 0, -1]), ([0, 0, 0], [0.1, 0, -1])
    now, travelled, turned = (yester.Camera.from_look_at(*place, [0, 1, 0], 60, 16, 16) for place in places)
    sky = np.full((16, 16), np.inf, np.float32)
    np.testing.assert_allclose(yester.motion_vectors(sky, now, travelled), 0, atol=1e-6)
    motion = yester.motion_vectors(sky, now, turned)
    assert (motion[..., 0] < -1).all()
    assert (motion[..., 2] == 0).all()


def previous_position(now, number):
    """Where the points of frame `number` of the flight were in the frame before: the moving ball's were elsewhere."""
    matrix = flight.transforms(number)[flight.MOVER]
    moved = now.position @ matrix[:3, :3].T + matrix[:3, 3]
    return np.where((now.ids == flight.MOVER)[..., None], moved, now.position)


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_lands_on_the_same_point(buffer):
    """A ray of the previous camera along the motion meets the point at its previous place, where it was visible."""
    width, height = 96, 64
    now = flight.shoot(5, width, height)
    before = flight.camera(4, width, height)
    motion = yester.motion_vectors(
        getattr(now, buffer), now.camera, before, ids=now.ids, transforms=flight.transforms(5)
    )
    hit = now.ids > 0
    assert (now.ids == flight.MOVER).sum() > 50
    assert np.abs(motion[hit]).max() > 1
    was = previous_position(now, 5)

    seen = raycast.cast(flight.scene(4, before), raycast.centres(now.camera) + motion[..., :2])
    visible = hit & (seen.ids == now.ids)
    assert visible.sum() > 0.95 * hit.sum()
    far = np.linalg.norm(seen.position - was, axis=-1)[visible]
    assert np.quantile(far, 0.99) < 1e-3  # the rest lie behind another part of the same surface, or at grazing angles
    assert np.median(far) < 1e-5
    _, depth = before.project(was[hit])
    np.testing.assert_allclose((now.depth + motion[..., 2])[hit], depth, rtol=1e-5)


def test_reprojected_positions_are_the_right_ones():
    """Positions fetched along the motion are the previous ones, up to the curvature between pixels."""
    now, before = flight.shoot(5, 192, 128), flight.shoot(4, 192, 128)
    moves = flight.transforms(5)
    motion = yester.motion_vectors(now.position, now.camera, before.camera, ids=now.ids, transforms=moves)
    values, coverage = yester.reproject(before.position, motion, ids=now.ids, previous_ids=before.ids, fallback=False)
    was = previous_position(now, 5)
    for name in (flight.GROUND, flight.BOX, flight.BALL, flight.MOVER):
        inside = (now.ids == name) & (coverage == 1)
        assert inside.sum() > 100
        assert np.median(np.linalg.norm((values - was)[inside], axis=-1)) < 2e-3


@pytest.mark.parametrize("number", [-1, 2**32])
def test_ids_of_transforms(number):
    now, before = flight.shoot(1, 8, 6), flight.shoot(0, 8, 6)
    moves = {number: np.eye(4)}
    with pytest.raises(ValueError, match=f"^transforms: expected ids from 0 to 4294967295, got {number}"):
        yester.motion_vectors(now.position, now.camera, before.camera, ids=now.ids, transforms=moves)
