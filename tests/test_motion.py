import compare
import numpy as np
import pytest
import reference
import scene
import yester
from compare import SIZES, TAILS, assert_close, tensor


def both(geometry, *cameras, **named):
    got = yester.motion_vectors(geometry, *cameras, **named)
    assert got.dtype == np.float32
    want = reference.motion_vectors(tensor(geometry), *cameras, **{k: tensor(v) for k, v in named.items()}).numpy()
    # Stored in float32: each value to its own rounding, however small, and the last digits of float64 pixels.
    assert_close("motion_vectors", got, want, rtol=1e-6, scale=1e-3)
    return got


@pytest.mark.parametrize(("height", "width"), SIZES + TAILS)
def test_reference(height, width):
    rng = np.random.default_rng(width)
    cameras = [compare.camera(rng, width, height) for _ in range(2)]
    both(compare.surfaces(rng, height, width)["depth"], *cameras)
    position = (rng.normal(0, 2, (height, width, 3)) - [0, 0, 6]).astype(np.float32)
    position[rng.random((height, width)) < 0.1] = np.nan
    ids = rng.integers(1, 4, (height, width)).astype(np.uint32)
    transforms = {i: scene.look_at(rng.normal(0, 1, 3), [0, 0, -9], [0, 1, 0], 90, 1, 1) for i in (2, 3, 77)}
    for matrix in transforms.values():
        matrix[3] = [0, 0, 0, 1]
    both(position, *cameras)
    both(position, *cameras, ids=ids, transforms=transforms)


def test_both_sides_of_the_cameras():
    """Points before, behind, and without a place: NaN in all channels or in none, and both occur."""
    rng = np.random.default_rng(0)
    cameras = [compare.camera(rng, 32, 32) for _ in range(2)]
    got = np.isnan(both(rng.normal(0, 3, (32, 32, 3)).astype(np.float32), *cameras))
    assert 0 < got.mean() < 1
    np.testing.assert_array_equal(got.all(-1), got.any(-1))


@pytest.mark.parametrize("depth", [np.nan, 0.0, -1.0, -np.inf])
def test_no_depth_no_motion(depth):
    camera = scene.camera(0, 4, 4)
    geometry = np.ones((4, 4), np.float32)
    geometry[1, 2] = depth
    motion = yester.motion_vectors(geometry, camera, camera)
    np.testing.assert_array_equal(np.isnan(motion).all(-1), geometry != 1)
    np.testing.assert_array_equal(np.isnan(motion).any(-1), geometry != 1)


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_nothing_moves(buffer):
    """The same camera twice is no motion, to the bit: not even a rounding."""
    shot = scene.shoot(3, 33, 21)
    assert not np.isfinite(shot.depth).all()
    motion = yester.motion_vectors(getattr(shot, buffer), shot.camera, shot.camera)
    np.testing.assert_array_equal(motion, np.zeros_like(motion))


def test_infinity_turns_but_does_not_travel():
    matrix = scene.look_at([0, 0, 0], [0, 0, -1], [0, 1, 0], 60, 16, 16)
    aside = scene.look_at([3, 0, 0], [3, 0, -1], [0, 1, 0], 60, 16, 16)
    turned = scene.look_at([0, 0, 0], [0.1, 0, -1], [0, 1, 0], 60, 16, 16)
    now, travelled, turned = (yester.Camera(m, 16, 16) for m in (matrix, aside, turned))
    sky = np.full((16, 16), np.inf, np.float32)
    np.testing.assert_allclose(yester.motion_vectors(sky, now, travelled), 0, atol=1e-6)
    motion = yester.motion_vectors(sky, now, turned)
    assert (motion[..., 0] < -1).all()
    assert (motion[..., 2] == 0).all()


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_lands_on_the_same_point(buffer):
    """Along the motion, yesterday's camera sees the point where it was: exact, cast anew, wherever it was visible."""
    width, height = 96, 64
    now = scene.shoot(5, width, height)
    before = scene.camera(4, width, height)
    moves = scene.transforms(5)
    motion = yester.motion_vectors(getattr(now, buffer), now.camera, before, ids=now.ids, transforms=moves)
    hit = now.ids > 0
    assert (now.ids == scene.MOVER).sum() > 50
    assert np.abs(motion[hit]).max() > 1
    was = np.where((now.ids == scene.MOVER)[..., None], now.position @ moves[scene.MOVER][:3, :3].T, now.position)
    was = was + np.where((now.ids == scene.MOVER)[..., None], moves[scene.MOVER][:3, 3], 0)

    seen, _, ids = scene.cast(4, before, scene.centres(now.camera) + motion[..., :2])
    visible = hit & (ids == now.ids)
    assert visible.sum() > 0.95 * hit.sum()
    far = np.linalg.norm(seen - was, axis=-1)[visible]
    assert np.quantile(far, 0.99) < 1e-3  # the rest lie behind another part of the same surface, or at grazing angles
    assert np.median(far) < 1e-5
    _, depth = before.project(was[hit])
    np.testing.assert_allclose((now.depth + motion[..., 2])[hit], depth, rtol=1e-5)


def test_reprojected_positions_are_the_right_ones():
    """Bilinear positions along the motion equal where the points were, up to the curvature between pixels."""
    now, before = scene.shoot(5, 192, 128), scene.shoot(4, 192, 128)
    moves = scene.transforms(5)
    motion = yester.motion_vectors(now.position, now.camera, before.camera, ids=now.ids, transforms=moves)
    values, coverage = yester.reproject(before.position, motion, ids=now.ids, previous_ids=before.ids, fallback=False)
    m = moves[scene.MOVER]
    was = np.where((now.ids == scene.MOVER)[..., None], now.position @ m[:3, :3].T + m[:3, 3], now.position)
    for name in (scene.GROUND, scene.BOX, scene.BALL, scene.MOVER):
        inside = (now.ids == name) & (coverage == 1)
        assert inside.sum() > 100
        assert np.median(np.linalg.norm((values - was)[inside], axis=-1)) < 2e-3
