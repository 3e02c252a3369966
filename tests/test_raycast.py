import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester.study.synthetic import raycast
from yester.study.synthetic.raycast import Box, Light, Rectangle, Scene, Sphere, Thing, Wire, translate, turn

SHAPES = {
    "rectangle": (Rectangle(1.2, 0.8), lambda p: np.abs(p[2])),
    "sphere": (Sphere(0.7), lambda p: np.linalg.norm(p, axis=0) - 0.7),
    "box": (Box((1.0, 0.6, 0.8)), lambda p: (np.abs(p) - np.array([[0.5], [0.3], [0.4]])).max(0)),
    "wire": (Wire((-0.4, -0.3, 0.1), (0.5, 0.4, -0.2), 0.2), lambda p: distance(p) - 0.2),
}


def distance(points):
    """Distance from the wire's axis, by search over its points."""
    axis = np.array([-0.4, -0.3, 0.1]) + np.linspace(0, 1, 2001)[:, None] * [0.9, 0.7, -0.3]
    return np.array([np.linalg.norm(axis - p, axis=1).min() for p in points.T])


def camera(width=3, height=3, x=0.0, z=4.0) -> yester.Camera:
    """A camera with a focal length of half the width; the middle pixel of an odd image looks along -z."""
    return yester.Camera.from_look_at([x, 0, z], [x, 0, 0], [0, 1, 0], 90, width, height)


def middle(*things, **options) -> raycast.Hits:
    return raycast.cast(Scene(things, camera(), **options), [1.5, 1.5])


@pytest.mark.parametrize("name", SHAPES)
def test_first_hit(name):
    """Random rays end on the surface, hit nothing before, and miss only if they stay away from it."""
    shape, outside = SHAPES[name]
    rng = np.random.default_rng(1)
    origin = rng.normal(0, 1, (3, 300))
    origin *= 3 / np.linalg.norm(origin, axis=0)
    direction = rng.uniform(-0.6, 0.6, (3, 300)) - origin
    direction /= np.linalg.norm(direction, axis=0)
    t = shape.hit(origin, direction)
    hit = np.isfinite(t)
    assert 50 < hit.sum() < 300
    points = (origin + np.where(hit, t, 0) * direction)[:, hit]
    np.testing.assert_allclose(outside(points), 0, atol=1e-6)
    normal = shape.normal(points)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=0), 1)
    facing = np.sign((normal * direction[:, hit]).sum(0)) * -1
    assert (outside(points + 1e-3 * facing * normal) > 0).all()
    if name != "rectangle":
        assert (outside(points - 1e-3 * facing * normal) < 0).all()
        for share in (0.3, 0.7, 0.95):
            assert (outside((origin + share * np.where(hit, t, 0) * direction)[:, hit]) > 0).all()
        for t in np.linspace(2, 4, 41):
            assert (outside((origin + t * direction)[:, ~hit]) > -1e-3).all()


@pytest.mark.parametrize("name", ["sphere", "box"])
def test_from_inside(name):
    shape, outside = SHAPES[name]
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(3, 100))
    direction /= np.linalg.norm(direction, axis=0)
    np.testing.assert_allclose(outside(shape.hit(np.zeros((3, 1)), direction) * direction), 0, atol=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_one_origin_or_many(name):
    shape, _ = SHAPES[name]
    rng = np.random.default_rng(3)
    direction = np.add(rng.normal(0, 0.1, (3, 50)), [[0], [0], [-1]])
    direction /= np.linalg.norm(direction, axis=0)
    origin = np.array([[0.1], [0.0], [3.0]])
    assert_same_bits(shape.hit(origin, direction), shape.hit(origin.repeat(50, 1), direction))


def test_sphere_by_hand():
    hits = middle(Thing(Sphere(0.5), translate(0, 0, 1)))
    assert hits.ids == 1
    assert hits.depth == pytest.approx(2.5)
    np.testing.assert_allclose(hits.position, [0, 0, 1.5], atol=1e-12)
    np.testing.assert_allclose(hits.normal, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(hits.local, [0, 0, 0.5], atol=1e-12)


def test_plane_by_hand():
    """The corner's ray of a 90° view: one right and one up for each one ahead."""
    scene = Scene((Thing(Rectangle(), translate(0, 0, 1)),), camera())
    hits = raycast.cast(scene, [[3, 0], [0, 3]])
    np.testing.assert_allclose(hits.position, [[3, 3, 1], [-3, -3, 1]], atol=1e-12)
    np.testing.assert_allclose(hits.depth, 3)  # along the axis, not along the ray


def test_nothing_is_hit():
    hits = middle(background=(0.1, 0.2, 0.3))
    assert (hits.ids, hits.depth) == (0, np.inf)
    assert np.isnan(hits.position).all()
    assert not hits.normal.any()
    assert not hits.albedo.any()
    np.testing.assert_array_equal(hits.color, [0.1, 0.2, 0.3])


def test_the_nearest_counts():
    far, near = Thing(Sphere(0.5)), Thing(Sphere(0.5), translate(0, 0, 2))
    assert middle(far, near).ids == 2
    assert middle(near, far).ids == 1


def test_place_is_rigid_motion():
    """Moving a thing and the camera alike changes directions alone."""
    move = translate(0.3, -0.2, 0.4) @ turn([1, 2, 0.5], 50)
    box = Thing(Box((1, 0.6, 0.8)), turn([0, 1, 0], 30), raycast.checker((1, 0, 0), (0, 1, 0), 0.2))
    moved = Thing(box.shape, move @ box.place, box.albedo)
    view = camera(15, 11, z=2)
    turned = yester.Camera(view.world_to_clip @ np.linalg.inv(move), 15, 11)
    one, other = (raycast.cast(Scene((t,), c), raycast.centres(c)) for t, c in ((box, view), (moved, turned)))
    assert 0.05 < (one.ids == 1).mean() < 0.9
    for name in ("ids", "depth", "local", "object_normal", "albedo"):
        seen = one.ids == 1
        np.testing.assert_allclose(getattr(one, name)[seen], getattr(other, name)[seen], atol=1e-9, err_msg=name)
    np.testing.assert_allclose(one.normal @ move[:3, :3].T, other.normal, atol=1e-12)


def test_turn_is_right_handed():
    np.testing.assert_allclose(turn([0, 0, 2], 90) @ [1, 0, 0, 1], [0, 1, 0, 1], atol=1e-15)
    np.testing.assert_allclose(turn([1, 0, 0], 90) @ [0, 1, 0, 1], [0, 0, 1, 1], atol=1e-15)


def moving(frame: int) -> Scene:
    ball = translate(-0.5 + 0.1 * frame, 0.1, 0.3 * frame) @ turn([0, 1, 0.3], 20 * frame)
    things = (
        Thing(Rectangle(5, 4), translate(0, 0, -2)),
        Thing(Sphere(0.6), ball, raycast.checker((0.9, 0.1, 0.1), (0.1, 0.1, 0.9), 0.3)),
        Thing(Box((0.5, 0.5, 0.5)), translate(1, 0, 0) @ turn([0, 1, 0], 40)),
    )
    view = yester.Camera.from_look_at([0.1 * frame, 0.2, 4], [0.05 * frame, 0, 0], [0, 1, 0], 60, 47, 31)
    return Scene(things, view, (Light((1, 2, 3), (5, 5, 5)),), background=(0.2, 0.3, 0.4))


def test_motion_agrees_with_the_library():
    before, now = moving(0), moving(1)
    frame = raycast.shoot(now, before, np.random.default_rng(0), jitter=(0, 0))
    assert set(np.unique(frame.ids)) == {0, 1, 2, 3}
    ball = before.things[1].place @ np.linalg.inv(now.things[1].place)
    expected = yester.motion_vectors(frame.position, now.camera, before.camera, ids=frame.ids, transforms={2: ball})
    np.testing.assert_allclose(frame.motion, expected, atol=2e-6)
    assert np.abs(frame.motion).max() > 2


def test_motion_by_hand():
    """A point that moved one unit right, 2.5 in front of a camera of focal length 1.5, was 0.6 pixels to the left."""
    now, before = (Scene((Thing(Sphere(0.5), translate(x, 0, 1)),), camera()) for x in (0, -1))
    hits = raycast.cast(now, [1.5, 1.5])
    np.testing.assert_allclose(raycast.motion(hits, before), [-0.6, 0, 0], atol=1e-12)
    nearer = Scene((Thing(Sphere(0.5), translate(0, 0, 0.5)),), camera())
    np.testing.assert_allclose(raycast.motion(hits, nearer), [0, 0, 0.5], atol=1e-12)


def test_motion_from_behind_the_camera():
    now, before = (Scene((Thing(Rectangle(), translate(0, 0, z)),), camera()) for z in (0, 5))
    assert np.isnan(raycast.motion(raycast.cast(now, [1.5, 1.5]), before)).any()


def test_history_shows_the_same_surface():
    """Motion leads to where the previous frame sees the same point, or something in front of it."""
    before, now = moving(0), moving(1)
    hits = raycast.cast(now, raycast.centres(now.camera))
    moved = raycast.motion(hits, before)
    seen = raycast.cast(before, hits.pixels + moved[..., :2])
    same = (seen.ids == hits.ids) & (hits.ids > 0)
    assert same.mean() > 0.5
    visible = same & np.isclose(seen.depth, hits.depth + moved[..., 2], rtol=1e-4)
    assert visible.sum() > 0.9 * same.sum()
    np.testing.assert_allclose(seen.local[visible], hits.local[visible], atol=1e-6)
    np.testing.assert_allclose(seen.object_normal[visible], hits.object_normal[visible], atol=1e-5)


def test_lamp_by_hand():
    """At a distance of 2 and 60° to the normal: a quarter, times one half."""
    floor = Thing(Rectangle(), albedo=(0.5, 0.5, 0.5))
    lamp = Light((2 * np.sin(np.pi / 3), 0, 1), (8, 4, 0))
    hits = middle(floor, lights=(lamp,), ambient=(0.1, 0.1, 0.1))
    np.testing.assert_allclose(hits.light, [1.1, 0.6, 0.1])
    np.testing.assert_allclose(hits.color, [0.55, 0.3, 0.05])


def test_distant_light_by_hand():
    lamp = Light((0, 3, 3), (1, 1, 1), distant=True)
    np.testing.assert_allclose(middle(Thing(Rectangle()), lights=(lamp,), ambient=(0, 0, 0)).light, np.sqrt(0.5))


@pytest.mark.parametrize("distant", [False, True])
def test_shadow(distant):
    floor = Thing(Rectangle())
    lamp = Light((0, 2, 2), (8, 8, 8), distant)
    between, behind = (Thing(Sphere(0.2), translate(0, *place)) for place in ((1, 1), (3, 3)))
    lit = middle(floor, lights=(lamp,)).light
    dark = middle(floor, between, lights=(lamp,)).light
    np.testing.assert_allclose(dark, 0.3)
    assert (lit > 1).all()
    np.testing.assert_array_equal(middle(floor, behind, lights=(lamp,)).light, dark if distant else lit)
    clear = Thing(between.shape, between.place, shadow=False)
    np.testing.assert_array_equal(middle(floor, clear, lights=(lamp,)).light, lit)


def test_light_from_behind():
    lamp = Light((0, 0, -2), (8, 8, 8))
    np.testing.assert_allclose(middle(Thing(Rectangle()), lights=(lamp,)).light, 0.3)


def test_mirror():
    """At 45° it shows the thing to the right with its own light, multiplied by the tint."""
    mirror = Thing(Rectangle(), turn([0, 1, 0], 45), (0.5, 1, 1), mirror=True)
    wall = Thing(Rectangle(), translate(3, 0, 0) @ turn([0, 1, 0], 90), (0.8, 0.4, 0.2), (0, 0, 1))
    hits = middle(mirror, wall, ambient=(1, 1, 1))
    assert hits.ids == 1
    np.testing.assert_allclose(hits.albedo, [0.5, 1, 1])
    np.testing.assert_allclose(hits.light, [0.8, 0.4, 1.2])
    np.testing.assert_allclose(hits.color, [0.4, 0.4, 1.2])


def test_reflection_by_hand():
    """A ray with slope 1/2 to the right meets the mirror at (4, 0, -4) and continues right, with slope 1/2 back."""
    mirror = Thing(Rectangle(), turn([0, 1, 0], 45), (1, 1, 1), mirror=True)
    place = translate(10, 0, 0) @ turn([0, 1, 0], 90)
    wall = Thing(Rectangle(), place, (0, 0, 0), emission=lambda point: point)
    hits = raycast.cast(Scene((mirror, wall), camera()), [2.25, 1.5])
    np.testing.assert_allclose(hits.position, [4, 0, -4], atol=1e-9)
    np.testing.assert_allclose(hits.color, (np.linalg.inv(place) @ [10, 0, -7, 1])[:3], atol=1e-5)


def test_seen_from_behind():
    """Normals face the camera."""
    hits = middle(Thing(Rectangle(), turn([0, 1, 0], 180)))
    np.testing.assert_allclose(hits.normal, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(hits.object_normal, [0, 0, -1], atol=1e-12)


def test_mirror_shows_the_background():
    mirror = Thing(Rectangle(), mirror=True, albedo=(1, 1, 1))
    np.testing.assert_allclose(middle(mirror, background=(0.1, 0.2, 0.3)).color, [0.1, 0.2, 0.3])


def test_textures_by_hand():
    points = np.array([[0.1, 0.1, 0.1], [0.6, 0.1, 0.1], [0.6, 0.6, 0.1], [-0.1, 0.1, 0.1]]).T
    one, other = (1.0, 0, 0), (0, 0, 1.0)
    np.testing.assert_array_equal(raycast.checker(one, other, 0.5)(points)[0], [1, 0, 1, 0])
    np.testing.assert_array_equal(raycast.stripes(one, other, 0.5)(points)[0], [1, 0, 0, 0])
    np.testing.assert_array_equal(raycast.stripes(one, other, 0.5, axis=1)(points)[0], [1, 1, 0, 1])


def test_value_noise():
    """Continuous, between its colours, different by seed; equal to the values at the corners of the lattice."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (3, 2000))
    texture = raycast.value_noise((0.2, 0.2, 0.2), (0.8, 0.4, 0.2), 0.5, seed=1)
    values = texture(points)
    assert values[0].min() >= 0.2
    assert values[0].max() <= 0.8
    assert values[0].std() > 0.05
    assert np.abs(texture(points + 1e-6) - values).max() < 1e-4
    assert np.abs(raycast.value_noise((0.2,) * 3, (0.8,) * 3, 0.5, seed=2)(points)[0] - values[0]).max() > 0.1
    corners = np.random.default_rng(1).random((32, 32, 32))
    assert texture(np.array([[0.5], [1.0], [1.5]]))[0, 0] == pytest.approx(0.2 + 0.6 * corners[1, 2, 3])
    assert texture(np.array([[0.75], [1.25], [1.75]]))[0, 0] == pytest.approx(0.2 + 0.6 * corners[1:3, 2:4, 3:5].mean())


def test_truth_of_an_edge():
    """Four samples per pixel along x, of which a wall from 0.2 to 1.3 hides three, one and none."""
    # Three pixels are 8 units wide at a depth of 4.
    wall = Thing(Rectangle(1.1 * 8 / 3, 20), translate(-2, 0, 0), emission=(1, 1, 1))
    image = raycast.truth(Scene((wall,), camera(), ambient=(0, 0, 0)))
    np.testing.assert_allclose(image[..., 0], [[0.75, 0.25, 0]] * 3, atol=1e-6)


def test_truth_converges():
    fine = raycast.truth(moving(0), 16)
    errors = [np.abs(raycast.truth(moving(0), side) - fine).mean() for side in (1, 2, 4, 8)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < errors[0] / 8


def test_frames_average_to_the_truth():
    scene, rng = moving(0), np.random.default_rng(0)
    frames = [raycast.shoot(scene, None, rng, deviation=0.5, fireflies=0.002).color for _ in range(200)]
    error = np.mean(frames, 0) - raycast.truth(scene, 8)
    assert abs(error.mean()) < 4 * np.std(frames, 0).mean() / np.sqrt(len(frames) * error[..., 0].size)
    assert np.abs(error).mean() < 0.1 * np.std(frames, 0).mean()


def test_frame_has_all_exact_buffers():
    frame = raycast.shoot(moving(1), moving(0), np.random.default_rng(0), deviation=1.0)
    assert set(yester.frame.BUFFERS) - set(frame.buffers()) == {"hit_distance", "motion_next", "reactive", "replay"}
    assert frame.jitter is None
    hit = frame.ids > 0
    assert_same_bits(frame.color[~hit], frame.emission[~hit])  # no noise on the background
    np.testing.assert_allclose(np.linalg.norm(frame.normal[hit], axis=-1), 1, atol=1e-6)
    pixels, depth = frame.camera.project(np.float64(frame.position[hit]))
    np.testing.assert_allclose(depth, frame.depth[hit], rtol=1e-5)
    # Samples are spread over their pixels, and all buffers of a pixel are of the same sample.
    offset = pixels - raycast.centres(frame.camera)[hit]
    assert np.abs(offset).max() < 0.5001
    assert offset.std() == pytest.approx(np.sqrt(1 / 12), rel=0.05)


def test_first_frame_stands_still():
    frame = raycast.shoot(moving(3), None, np.random.default_rng(0))
    assert np.abs(frame.motion).max() < 1e-6


def test_known_jitter():
    frame = raycast.shoot(moving(1), moving(0), np.random.default_rng(0), jitter=(0.25, -0.5))
    assert frame.jitter == (0.25, -0.5)
    hit = frame.ids > 0
    pixels, _ = frame.camera.project(np.float64(frame.position[hit]))
    expected = raycast.centres(frame.camera)[hit] + [0.25, -0.5]
    np.testing.assert_allclose(pixels, expected, atol=1e-4)


def test_same_seed_same_bits():
    one, other, third = (
        raycast.shoot(moving(1), moving(0), np.random.default_rng(seed), deviation=0.5) for seed in (4, 4, 5)
    )
    for name, array in one.buffers().items():
        assert_same_bits(array, other.buffers()[name])
    assert (one.color != third.color).any()


@pytest.mark.parametrize(("deviation", "fireflies"), [(0.3, 0), (1, 0), (2, 0), (0.5, 0.01), (0, 0.005)])
def test_noise_has_mean_one(deviation, fireflies):
    factors = raycast.noise(np.random.default_rng(0), (1000, 1000), deviation, fireflies=fireflies)
    assert factors.dtype == np.float32
    assert factors.min() >= 0
    assert factors.mean(dtype=np.float64) == pytest.approx(1, abs=5e-3 * float(factors.std()))
    bright = factors == 50
    assert bright.mean() == pytest.approx(fireflies, rel=0.05)
    rest = factors[~bright].astype(np.float64)
    assert rest.std() == pytest.approx(deviation * rest.mean(), rel=0.02, abs=1e-6)


def test_no_noise():
    np.testing.assert_array_equal(raycast.noise(np.random.default_rng(0), (4, 5), 0), 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"deviation": -1}, "deviation"),
        ({"deviation": np.nan}, "deviation"),
        ({"deviation": 1, "fireflies": -0.1}, "fireflies"),
        ({"deviation": 1, "fireflies": 0.02}, "fireflies"),
    ],
)
def test_bad_noise(options, message):
    with pytest.raises(ValueError, match=message):
        raycast.noise(np.random.default_rng(0), (2, 2), **options)


@pytest.mark.parametrize("pixels", [1.0, [1, 2, 3], np.zeros((2, 4))])
def test_bad_pixels(pixels):
    with pytest.raises(ValueError, match="pixels"):
        raycast.cast(moving(0), pixels)
