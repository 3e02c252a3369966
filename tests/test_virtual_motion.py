import compare
import flight
import numpy as np
import pytest
import reference
import yester
from compare import SIZES, TAILS, assert_close, assert_same_bits, each, tensor
from yester.study.synthetic import raycast


def distances(rng, height, width):
    """Hit distances of all magnitudes; zero, infinite, missing and invalid ones."""
    hit = rng.exponential(2, (height, width)) * rng.choice([0.01, 1, 100, 1e6], (height, width))
    special = rng.random((height, width)) < 0.3
    hit[special] = rng.choice([0, np.inf, np.nan, -1, -np.inf, 1e30], int(special.sum()))
    return hit.astype(np.float32)


def check(geometry, hit, *cameras):
    got = yester.virtual_motion(geometry, hit, *cameras)
    want = reference.virtual_motion(*tensor([geometry, hit]), *cameras).numpy()
    assert got.dtype == np.float32
    # Stored in float32: each value to its own rounding, plus the rounding of float64 pixel coordinates.
    assert_close("virtual_motion", got, want, rtol=1e-6, scale=1e-3)
    return got


@each("size", SIZES + TAILS)
def test_reference(size):
    rng = np.random.default_rng(size[1])
    cameras = [compare.camera(rng, *size[::-1]) for _ in range(2)]
    check(compare.surfaces(rng, *size)["depth"], distances(rng, *size), *cameras)
    position = (rng.normal(0, 2, (*size, 3)) - [0, 0, 6]).astype(np.float32)
    position[rng.random(size) < 0.1] = np.nan
    check(position, distances(rng, *size), *cameras)


def test_both_sides_of_the_cameras():
    """NaN in both channels or in none, and both occur; a camera that looked the other way saw nothing."""
    rng = np.random.default_rng(0)
    cameras = [compare.camera(rng, 32, 32) for _ in range(2)]
    missing = np.isnan(check(rng.normal(0, 3, (32, 32, 3)).astype(np.float32), distances(rng, 32, 32), *cameras))
    assert 0.1 < missing.mean() < 0.9
    np.testing.assert_array_equal(missing.all(-1), missing.any(-1))
    now = yester.Camera.from_look_at([0, 0, 0], [0, 0, -1], [0, 1, 0], 60, 8, 6)
    back = yester.Camera.from_look_at([0, 0, -3], [0, 0, 1], [0, 1, 0], 60, 8, 6)
    depth = np.ones((6, 8), np.float32)
    for hit, seen in ((0, True), (1.5, True), (4, False), (np.inf, False)):  # twice in front of it
        got = yester.virtual_motion(depth, np.full((6, 8), hit, np.float32), now, back)
        assert np.isfinite(got).all() == seen
        assert np.isnan(got).all() != seen


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_no_distance_is_the_surface(buffer):
    """Bit for bit the surface's own motion, background included."""
    now, before = flight.shoot(5, 33, 21), flight.camera(4, 33, 21)
    geometry = getattr(now, buffer)
    assert not np.isfinite(geometry).all()
    got = yester.virtual_motion(geometry, np.zeros((21, 33), np.float32), now.camera, before)
    assert_same_bits(got, yester.motion_vectors(geometry, now.camera, before)[..., :2].copy())


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_the_sky_in_a_mirror_moves_as_the_sky(buffer):
    """At infinite distance only rotation counts; a very large distance is close to that."""
    now, before = flight.shoot(5, 33, 21), flight.camera(4, 33, 21)
    sky = yester.motion_vectors(np.full((21, 33), np.inf, np.float32), now.camera, before)[..., :2]
    geometry = getattr(now, buffer)
    got = yester.virtual_motion(geometry, np.full((21, 33), np.inf, np.float32), now.camera, before)
    np.testing.assert_allclose(got, sky, atol=1e-5)
    far = yester.virtual_motion(geometry, np.full((21, 33), 1e8, np.float32), now.camera, before)
    np.testing.assert_allclose(far, sky, atol=1e-5)
    own = yester.virtual_motion(geometry, np.zeros((21, 33), np.float32), now.camera, before)
    assert np.abs(own - sky).max() > 0.1


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_nothing_moves(buffer):
    """With the same camera twice, the mirror's image does not move, up to rounding."""
    shot = flight.shoot(3, 33, 21)
    hit = np.random.default_rng(0).exponential(2, (21, 33)).astype(np.float32)
    got = yester.virtual_motion(getattr(shot, buffer), hit, shot.camera, shot.camera)
    np.testing.assert_allclose(got, 0, atol=2e-5)


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_a_mirror_shows_the_same_point(buffer):
    """A tilted plane mirror before a wall: along the motion, the previous camera's reflected ray hits the same point.

    Both rays are reflected by the law of reflection; the test does not use virtual images.
    """
    width, height = 48, 32
    normal = np.array([0.2, 0.1, 1]) / np.linalg.norm([0.2, 0.1, 1])
    on_mirror, wall = np.array([0, 0, -5.0]), (np.array([0.1, -0.3, 1]) / np.linalg.norm([0.1, -0.3, 1]), 4.0)

    def reflect(camera, pixels):
        """Where rays meet the mirror, and then the wall (points x with w·x = d)."""
        origin, direction = camera.rays(pixels)
        t = ((on_mirror - origin) @ normal) / (direction @ normal)
        hit = origin + t[..., None] * direction
        mirrored = direction - 2 * (direction @ normal)[..., None] * normal
        s = (wall[1] - hit @ wall[0]) / (mirrored @ wall[0])
        assert (t > 0).all()
        assert (s > 0).all()
        return hit, hit + s[..., None] * mirrored

    views = [([0, 0, 0], [0.1, 0, -5]), ([0.5, -0.2, 0.6], [0, 0.2, -5])]
    now, before = (yester.Camera.from_look_at(origin, target, [0, 1, 0], 40, width, height) for origin, target in views)
    hit, seen = reflect(now, raycast.centres(now))
    position = hit.astype(np.float32)
    distance = np.linalg.norm(seen - hit, axis=-1).astype(np.float32)
    depth = now.project(hit)[1].astype(np.float32)
    got = yester.virtual_motion(position if buffer == "position" else depth, distance, now, before)
    assert np.abs(got).min() > 0.1
    _, there = reflect(before, raycast.centres(now) + got)
    np.testing.assert_allclose(there, seen, atol=2e-5)
    # The surface's own motion does not.
    own = yester.motion_vectors(depth, now, before)[..., :2]
    assert np.linalg.norm(reflect(before, raycast.centres(now) + own)[1] - seen, axis=-1).min() > 0.05


@pytest.mark.parametrize("buffer", ["depth", "position"])
def test_invalid_distances_give_nan(buffer):
    camera = flight.camera(0, 4, 4)
    geometry = np.ones((4, 4), np.float32)
    if buffer == "position":
        geometry = np.broadcast_to(np.float32(camera.position + 3 * camera.forward), (4, 4, 3))
    hit = np.ones((4, 4), np.float32)
    hit[0] = np.nan, -1, -np.inf, -1e-30
    got = yester.virtual_motion(geometry, hit, camera, camera)
    assert np.isnan(got[0]).all()
    assert np.isfinite(got[1:]).all()


def test_no_depth_no_motion():
    camera = flight.camera(0, 4, 4)
    geometry = np.ones((4, 4), np.float32)
    geometry[1, 2] = np.nan
    for hit in (0, 1, np.inf):
        motion = yester.virtual_motion(geometry, np.full((4, 4), hit, np.float32), camera, camera)
        np.testing.assert_array_equal(np.isnan(motion).all(-1), geometry != 1)
        np.testing.assert_array_equal(np.isnan(motion).any(-1), geometry != 1)


def test_bad_input():
    depth, camera = np.ones((4, 5), np.float32), flight.camera(0, 5, 4)
    other = flight.camera(0, 5, 5)
    with pytest.raises(ValueError, match="hit_distance: expected height 4 and width 5"):
        yester.virtual_motion(depth, depth[1:], camera, camera)
    with pytest.raises(ValueError, match="hit_distance"):
        yester.virtual_motion(depth, depth[..., None], camera, camera)
    with pytest.raises(ValueError, match="geometry"):
        yester.virtual_motion(np.ones((4, 5, 2), np.float32), depth, camera, camera)
    with pytest.raises(ValueError, match="camera"):
        yester.virtual_motion(depth, depth, other, camera)
    with pytest.raises(ValueError, match="previous_camera"):
        yester.virtual_motion(depth, depth, camera, other)
    with pytest.raises(TypeError, match="camera"):
        yester.virtual_motion(depth, depth, np.eye(4), camera)
