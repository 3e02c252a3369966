import pickle

import numpy as np
import pytest
import yester
from compare import camera as random_camera

ORIGIN, TARGET, UP = (1.0, 2.0, 5.0), (0.5, 0.0, -1.0), (0.0, 1.0, 0.0)


def look_at(origin, target, up, fov, width, height, *, fov_axis="x", principal_point=None):
    """world_to_clip of a camera of square pixels, written out: the axes, the field of view, the shifted centre."""
    origin = np.asarray(origin, np.float64)
    forward = np.asarray(target, np.float64) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(up, np.float64))
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    px, py = principal_point or (width / 2, height / 2)
    focal = (width if fov_axis == "x" else height) / 2 / np.tan(np.radians(fov) / 2)  # pixels
    rotation = np.stack([right, above, forward])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = rotation, -rotation @ origin
    clip = np.array(
        [
            [2 * focal / width, 0, 2 * px / width - 1, 0],
            [0, 2 * focal / height, 1 - 2 * py / height, 0],
            [0, 0, 1, -0.1],
            [0, 0, 1, 0],
        ]
    )
    return clip @ view


@pytest.fixture
def camera():
    return yester.Camera.from_look_at(ORIGIN, TARGET, UP, 50, 64, 36)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("principal_point", [None, (30.0, 21.5)])
def test_look_at_is_the_formula(axis, principal_point):
    got = yester.Camera.from_look_at(
        ORIGIN, TARGET, UP, 50, 64, 36, fov_axis=axis, principal_point=principal_point
    ).world_to_clip
    want = look_at(ORIGIN, TARGET, UP, 50, 64, 36, fov_axis=axis, principal_point=principal_point)
    rows = [0, 1, 3]  # the z row is not used
    np.testing.assert_allclose(got[rows] / np.linalg.norm(got[3, :3]), want[rows], rtol=1e-12, atol=1e-14)


def test_attributes(camera):
    assert (camera.width, camera.height) == (64, 36)
    assert camera.world_to_clip.shape == camera.world_to_camera.shape == (4, 4)
    assert camera.world_to_clip.dtype == camera.world_to_camera.dtype == np.float64
    np.testing.assert_allclose(camera.position, ORIGIN, rtol=1e-12)
    forward = np.subtract(TARGET, ORIGIN)
    np.testing.assert_allclose(camera.forward, forward / np.linalg.norm(forward), rtol=1e-12)


def test_world_to_camera_is_left_handed(camera):
    view = camera.world_to_camera
    np.testing.assert_allclose(view[:3, :3] @ view[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view[:3, :3]) == pytest.approx(-1)
    np.testing.assert_allclose(view @ [*ORIGIN, 1], [0, 0, 0, 1], atol=1e-12)
    x, y, z = view[:3, :3] @ np.subtract(TARGET, ORIGIN)
    assert (x, y) == pytest.approx((0, 0), abs=1e-12)
    assert z > 0
    assert (view[:3, :3] @ UP)[1] > 0


def test_axes_of_the_image(camera):
    """The target is in the centre, right of it is right, above it is above: y runs down."""
    (centre, right, above), depth = camera.project(np.add(TARGET, [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]))
    np.testing.assert_allclose(centre, [32, 18], atol=1e-9)
    assert right[0] > centre[0]
    assert above[1] < centre[1]
    assert depth[0] == pytest.approx(np.linalg.norm(np.subtract(TARGET, ORIGIN)))


def test_project_unproject_round_trip():
    rng = np.random.default_rng(0)
    for _ in range(20):
        camera = random_camera(rng, 33, 21, spread=1)
        pixels = rng.uniform(-10, 40, (4, 5, 2))
        depth = rng.uniform(0.01, 100, (4, 5))
        points = camera.unproject(pixels, depth)
        assert points.shape == (4, 5, 3)
        back, back_depth = camera.project(points)
        assert back.dtype == back_depth.dtype == np.float64
        np.testing.assert_allclose(back, pixels, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(back_depth, depth, rtol=1e-9)


def test_project_is_the_formula():
    """Also behind the camera, where depth is defined and pixels are not."""
    rng = np.random.default_rng(1)
    camera = random_camera(rng, 33, 21)
    points = rng.normal(0, 3, (100, 3)) - [0, 0, 5]
    x, y, _, w = camera.world_to_clip @ np.vstack([points.T, np.ones(100)])
    pixels, depth = camera.project(points)
    front = w > 0
    assert 0 < front.sum() < 100
    want = np.stack([(x / w + 1) / 2 * 33, (1 - y / w) / 2 * 21], -1)
    np.testing.assert_allclose(pixels[front], want[front], rtol=1e-9)
    np.testing.assert_allclose(depth, w / np.linalg.norm(camera.world_to_clip[3, :3]), rtol=1e-9, atol=1e-12)
    assert np.isnan(pixels[~front]).all()


def test_rays(camera):
    origin, directions = camera.rays()
    np.testing.assert_allclose(origin, camera.position)
    assert directions.shape == (36, 64, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-12)
    pixels, _ = camera.project(origin + 7 * directions)
    y, x = np.mgrid[:36, :64] + 0.5
    np.testing.assert_allclose(pixels, np.stack([x, y], -1), atol=1e-9)
    _, some = camera.rays(np.array([[0.5, 0.5], [63.5, 35.5]]))
    np.testing.assert_allclose(some, [directions[0, 0], directions[-1, -1]], rtol=1e-12)


def test_scale_of_the_matrix_does_not_matter(camera):
    scaled = yester.Camera(3 * camera.world_to_clip, 64, 36)
    points = np.random.default_rng(2).normal(0, 1, (10, 3))
    for got, want in zip(scaled.project(points), camera.project(points), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-12)


def test_z_row_is_not_used(camera):
    matrix = camera.world_to_clip.copy()
    matrix[2] = [5, -3, 2, 7]
    other = yester.Camera(matrix, 64, 36)
    points = np.random.default_rng(2).normal(0, 1, (10, 3))
    for got, want in zip(other.project(points), camera.project(points), strict=True):
        np.testing.assert_array_equal(got, want)


def test_value_semantics(camera):
    same = yester.Camera(camera.world_to_clip, 64, 36)
    assert camera == same
    assert camera != yester.Camera(camera.world_to_clip, 64, 37)
    assert camera != yester.Camera(2 * camera.world_to_clip, 64, 36)
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert hash(camera) == hash(same)
    negative = np.where(camera.world_to_clip == 0, -0.0, camera.world_to_clip)
    assert {camera: 1}[yester.Camera(negative, 64, 36)] == 1
    with pytest.raises(AttributeError):
        camera.width = 3
    matrix = camera.world_to_clip.copy()
    from_matrix = yester.Camera(matrix, 64, 36)
    matrix[:] = 0
    assert from_matrix == same
    assert "64" in repr(camera)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"world_to_clip": np.full((4, 4), np.nan)}, "world_to_clip"),
        ({"world_to_clip": np.zeros((4, 4))}, "world_to_clip"),
        ({"world_to_clip": np.diag([1.0, 1, 1, 0])}, "world_to_clip"),
        ({"world_to_clip": np.eye(3)}, "world_to_clip"),
        ({"width": 0}, "width"),
        ({"height": 0}, "height"),
    ],
)
def test_bad_matrix_or_size(camera, change, match):
    arguments = {"world_to_clip": camera.world_to_clip, "width": 64, "height": 36} | change
    with pytest.raises(ValueError, match=match):
        yester.Camera(**arguments)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"fov": 0}, "fov"),
        ({"fov": 180}, "fov"),
        ({"fov": 179.9999999}, "fov"),
        ({"width": 2**70}, "width"),
        ({"fov": np.nan}, "fov"),
        ({"target": ORIGIN}, "target"),
        ({"up": np.subtract(TARGET, ORIGIN)}, "up"),
        ({"up": (0, 0, 0)}, "up"),
        ({"origin": (np.nan, 0, 0)}, "origin"),
        ({"fov_axis": "z"}, "fov_axis"),
        ({"width": 0}, "width"),
    ],
)
def test_bad_look_at(change, match):
    arguments = {"origin": ORIGIN, "target": TARGET, "up": UP, "fov": 50, "width": 64, "height": 36} | change
    with pytest.raises(ValueError, match=match):
        yester.Camera.from_look_at(**arguments)


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.zeros(4)])
def test_bad_points(camera, points):
    with pytest.raises(ValueError, match="points"):
        camera.project(points)
