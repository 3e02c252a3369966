import subprocess
import sys
from types import SimpleNamespace

import drjit
import mitsuba as mi
import numpy as np
import pytest
import yester
from compare import assert_same_bits
from yester.io import mitsuba as door
from yester.io.mitsuba import render_sequence
from yester.study.rendered.scenes import cornell_box

pytestmark = pytest.mark.slow

if mi.variant() is None:
    mi.set_variant("scalar_rgb")
T = mi.ScalarTransform4f
WIDTH, HEIGHT = 32, 24
VIEW = T().look_at([0.5, 1, 5], [0, 0.5, 0], [0, 1, 0])
RADIANCE = 3.0


def sensor(kind="perspective", film=None, **named):
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, **(film or {})}
    return {"type": kind, "fov": 40, "to_world": VIEW, "film": film, **named}


def scene(poses=None, **named):
    """A sphere, a cube, a rectangular light, a disk and an instance, on a floor, under a sky."""
    poses = {name: T(np.asarray(matrix)) for name, matrix in (poses or {}).items()}

    def at(name, transform):
        return poses.get(name, T()) @ transform

    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": sensor(near_clip=0.5),
        "sky": {"type": "constant", "radiance": 0.25},
        "ball": {"type": "sphere", "to_world": at("ball", T().translate([0, 0.5, 0]).scale(0.5))},
        "cube": {"type": "cube", "to_world": at("cube", T().translate([-1, 0.5, 0]).scale(0.3))},
        "lamp": {
            "type": "rectangle",
            "to_world": at("lamp", T().translate([0, 1.4, 0]).rotate([1, 0, 0], 30)),
            "emitter": {"type": "area", "radiance": RADIANCE},
        },
        "disk": {"type": "disk", "to_world": at("disk", T().translate([1.3, 0.5, 0]).scale(0.3))},
        "group": {"type": "shapegroup", "part": {"type": "sphere", "radius": 0.25}},
        "copy": {
            "type": "instance",
            "group": {"type": "ref", "id": "group"},
            "to_world": at("copy", T().translate([1, 0.5, 1])),
        },
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(1.6)},
        **named,
    }


SHAPES = ["ball", "cube", "lamp", "disk", "copy", "floor"]


def flight(count):
    return [T().look_at([0.5 + 0.1 * i, 1, 5 - 0.1 * i], [0.05 * i, 0.5, 0], [0, 1, 0]) for i in range(count)]


def matrix(transform):
    return np.array(transform.matrix, np.float64)


def dance(count):
    """Everything but the floor moves, each thing differently; the disk only in the second half."""
    for i in range(count):
        poses = {
            "ball": T().translate([0.05 * i, 0.02 * i, 0]),
            "cube": T().translate([-1, 0.5, 0]).rotate([0, 1, 0.3], 12 * i).translate([1, -0.5, 0.04 * i]),
            "lamp": T().rotate([0, 1, 0], 3 * i),
            "copy": T().translate([0, 0.05 * i, 0]),
        }
        if i >= count / 2:
            poses["disk"] = T().translate([0, 0.06, 0]).rotate([0, 0, 1], 5)
        yield {name: matrix(pose) for name, pose in poses.items()}


def cells():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([x, y], -1)


def inside_pixels(pixels, where):
    """Samples lie inside their pixels and spread over them."""
    offset = (pixels - np.stack(np.mgrid[: pixels.shape[0], : pixels.shape[1]][::-1], -1))[where]
    assert where.sum() > 50
    assert offset.min() > -5e-3
    assert offset.max() < 1 + 5e-3
    assert np.abs(offset.mean(0) - 0.5).max() < 0.15


def assert_same_frames(got, want):
    for a, b in zip(got, want, strict=True):
        assert a.buffers().keys() == b.buffers().keys()
        assert a.camera == b.camera
        for name, array in a.buffers().items():
            assert_same_bits(array, b.buffers()[name])


# Cameras

CROP = {"width": 50, "height": 40, "crop_width": 32, "crop_height": 24, "crop_offset_x": 11, "crop_offset_y": 5}
SENSORS = [
    sensor(),
    sensor(fov_axis="y"),
    sensor(fov_axis="diagonal"),
    sensor(fov_axis="larger", film={"width": 24, "height": 32}),
    sensor(principal_point_offset_x=0.1, principal_point_offset_y=-0.07),
    sensor(film=CROP),
    sensor(film=CROP, principal_point_offset_x=0.1, principal_point_offset_y=-0.07),
    sensor("thinlens", aperture_radius=0.05, focus_distance=4.0, film=CROP),
]


@pytest.mark.parametrize("description", SENSORS)
def test_camera(description):
    """The camera's rays are those of Mitsuba, and Mitsuba's hits project to the sampled positions."""
    source = mi.load_dict(description)
    camera = door.camera(source)
    assert [camera.width, camera.height] == list(source.film().crop_size())
    size = np.array([camera.width, camera.height])
    for place in np.random.default_rng(0).random((20, 2)):
        ray, _ = source.sample_ray(0, 0, mi.Point2f(place), mi.Point2f(0.5))
        origin, direction = camera.rays(place * size)
        # A thousandth of a pixel.
        assert np.abs(np.cross(direction, np.array(ray.d))).max() < 1e-3 * np.radians(20) / 32
        assert np.linalg.norm(np.cross(direction, np.array(ray.o) - origin)) < 1e-5
        pixel, depth = camera.project(np.array(ray.o + 7 * ray.d))
        np.testing.assert_allclose(pixel, place * size, atol=0.02)
        assert 0 < depth <= 7.1


def test_vectorised_layout():
    """llvm and cuda variants store every matrix as (4, 4, 1) and every number as an array."""
    source = mi.load_dict(SENSORS[6])
    known = mi.traverse(source)
    parameters = {name: np.array([known[name]]) for name in known.keys() if "offset_" in name}  # noqa: SIM118
    wide = SimpleNamespace(
        class_name=source.class_name,
        film=source.film,
        world_transform=lambda: SimpleNamespace(matrix=matrix(source.world_transform())[..., None]),
        projection_transform=lambda: SimpleNamespace(matrix=matrix(source.projection_transform())[..., None]),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mi, "traverse", lambda _: parameters)
        got = door.camera(wide)
    assert got == door.camera(source)


def test_no_camera():
    with pytest.raises(ValueError, match="sensor: expected a perspective or thinlens sensor, got OrthographicCamera"):
        door.camera(mi.load_dict({"type": "orthographic", "film": {"type": "hdrfilm"}}))
    with pytest.raises(ValueError, match="got int"):
        door.camera(3)


@pytest.mark.parametrize("lens", ["perspective", "thinlens"])
def test_any_camera(lens):
    """Cameras of any size, field of view and principal point, independent of the scene's own."""
    point = None if lens == "thinlens" else (12.0, 15.0)
    cameras = [
        yester.Camera.from_look_at([1, 2, 4], [0, 0.3, 0], [0.1, 1, 0], 50, 40, 20, principal_point=point),
        yester.Camera.from_look_at([-2, 1, 4], [0, 0.3, 0], [0, 1, 0], 30, 40, 20, fov_axis="y"),
    ]
    # With the focus at the objects, hits stay near their pixels.
    extra = {"aperture_radius": 1e-4, "focus_distance": 4.0} if lens == "thinlens" else {}
    for frame, camera in zip(render_sequence(scene(sensor=sensor(lens, **extra)), cameras), cameras, strict=True):
        assert frame.camera == camera
        assert frame.shape == (camera.height, camera.width)
        inside_pixels(camera.project(frame.position)[0], frame.ids > 0)


# Buffers


def test_buffers():
    (frame,) = render_sequence(scene(), [VIEW])
    hit = frame.ids > 0
    assert 0 < hit.sum() < hit.size
    assert set(np.unique(frame.ids)) == {0, *range(1, 7)}
    pixels, depth = frame.camera.project(frame.position)
    inside_pixels(pixels, hit)
    own = door.camera(mi.load_dict(sensor()))
    np.testing.assert_allclose(frame.camera.world_to_clip[[0, 1, 3]], own.world_to_clip[[0, 1, 3]], atol=1e-5)
    # depth along the axis: neither the distance, nor measured from the near plane
    assert_same_bits(frame.depth[hit], depth[hit].astype(np.float32))
    assert (frame.depth[~hit] == np.inf).all()
    np.testing.assert_array_equal(np.isnan(frame.position).all(-1), ~hit)
    np.testing.assert_allclose(np.linalg.norm(frame.normal, axis=-1), hit, atol=1e-5)
    ball = frame.ids == 1 + SHAPES.index("ball")
    np.testing.assert_allclose(frame.normal[ball], (frame.position[ball] - [0, 0.5, 0]) / 0.5, atol=1e-4)
    np.testing.assert_allclose(frame.position[frame.ids == 1 + SHAPES.index("floor")][:, 1], 0, atol=1e-5)
    # Lights are black unless they are given a material.
    grey = hit & (frame.ids != 1 + SHAPES.index("lamp"))
    np.testing.assert_array_equal(frame.albedo, np.where(grey, 0.5, 0)[..., None].repeat(3, -1))
    assert_same_bits(frame.motion, np.zeros((HEIGHT, WIDTH, 3), np.float32))


def test_metals_are_not_demodulated():
    """Mitsuba's albedo of gold changes with the view, from 0 to above 6."""
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.2}
    shapes = scene()
    shapes["ball"]["bsdf"] = {"type": "twosided", "nested": gold}
    (frame,) = render_sequence(shapes, [VIEW])
    ball = frame.ids == 1 + SHAPES.index("ball")
    assert ball.any()
    assert (frame.albedo[ball] == 1).all()
    assert set(np.unique(frame.albedo[~ball])) == {0, 0.5}


def test_emission():
    """The sky and the lamp's front, exactly; the rest of the colour is reflected light."""
    (frame,) = render_sequence(scene(), [VIEW])
    lamp = frame.ids == 1 + SHAPES.index("lamp")
    front = lamp & (((frame.camera.position - frame.position) * frame.normal).sum(-1) > 0)
    assert front.any()
    want = np.where(front, RADIANCE, np.where(frame.ids == 0, 0.25, 0))
    np.testing.assert_array_equal(frame.emission, want[..., None].repeat(3, -1))
    assert (frame.color >= frame.emission).all()
    assert_same_bits(frame.color[frame.ids == 0], frame.emission[frame.ids == 0])


def test_no_emission():
    # Not with the path integrator: Mitsuba 3.9.1 aborts the process when it is set to hide lights.
    (frame,) = render_sequence(scene(integrator={"type": "direct", "hide_emitters": True}), [VIEW])
    assert frame.color.max() > 0
    np.testing.assert_array_equal(frame.emission, 0)
    (frame,) = render_sequence(scene(integrator={"type": "volpath"}), [VIEW])
    assert frame.emission is None


def test_samples():
    """Colours are means over all samples; the other buffers are of one sample."""
    one, many = (next(render_sequence(scene(), [VIEW], spp=spp)) for spp in (1, 64))
    for name in ("normal", "depth", "motion", "ids", "position"):
        assert_same_bits(many.buffers()[name], one.buffers()[name])
    assert abs(many.color.mean() - one.color.mean()) < 0.1 * many.color.mean()
    floor = many.ids == 1 + SHAPES.index("floor")
    assert many.color[floor].std() < 0.7 * one.color[floor].std()
    assert len(np.unique(many.albedo)) > 2 == len(np.unique(one.albedo))
    assert (many.color >= many.emission).all()


def test_colour_alone():
    """For references: the same image, without other buffers."""
    for poses in (None, dance(2)):
        full, alone = (
            list(render_sequence(scene(), flight(2), spp=32, transforms=poses and dance(2), buffers=buffers))
            for buffers in (True, False)
        )
        for a, b in zip(full, alone, strict=True):
            assert set(b.buffers()) == {"color"}
            assert b.camera == a.camera
            assert np.abs(a.color - b.color).mean() < 0.1 * a.color.mean()


def test_seeds():
    first, again, other = (list(render_sequence(scene(), flight(2), seed=s)) for s in (3, 3, 4))
    assert_same_frames(first, again)
    assert (first[0].color != other[0].color).any()
    still = list(render_sequence(scene(), [VIEW, VIEW], seed=3))
    assert (still[0].color != still[1].color).any()
    (late,) = render_sequence(scene(), [VIEW], seed=4)
    assert_same_bits(still[1].color, late.color)
    for options in ({}, {"spp": 2, "halves": True}, {"spp": 2, "buffers": False}):
        largest = 2**32 // (4 if "halves" in options else 1) - 2
        assert len(list(render_sequence(scene(), [VIEW, VIEW], seed=largest, **options))) == 2


# Motion


@pytest.mark.parametrize("step", [1, 2, 3])
def test_motion(step):
    """Traced back: the ray of the previous camera along the motion meets the same point of the same shape.

    The previous scene is built anew, with every shape at its previous place, and hit by Mitsuba's own rays.
    """
    poses, views = list(dance(4)), flight(4)
    frames = list(render_sequence(scene(), views, transforms=poses))
    then, now = frames[step - 1], frames[step]
    former = mi.load_dict(
        scene(poses[step - 1], sensor=sensor(near_clip=0.5, to_world=views[step - 1])), parallel=False, optimize=False
    )
    own = former.sensors()[0]
    target = now.camera.project(now.position)[0] + now.motion[..., :2]
    met = dict.fromkeys(SHAPES, 0)
    for y, x in np.argwhere(now.ids > 0):
        place = target[y, x] / [WIDTH, HEIGHT]
        if not ((place > 0) & (place < 1)).all():
            continue
        name = SHAPES[now.ids[y, x] - 1]
        here, back = (np.asarray(p.get(name, np.eye(4))) for p in (poses[step], poses[step - 1]))
        point = back @ np.linalg.inv(here) @ [*now.position[y, x].astype(np.float64), 1]
        ray, _ = own.sample_ray(0, 0, mi.Point2f(place), mi.Point2f(0.5))
        hit = former.ray_intersect(mi.RayDifferential3f(ray))
        reach = np.linalg.norm(point[:3] - np.array(ray.o))
        if hit.t < reach - 0.02:
            continue  # hidden in the previous frame
        pixel, depth = then.camera.project(point[:3])
        np.testing.assert_allclose(target[y, x], pixel, atol=2e-3)
        assert abs(now.depth[y, x] + now.motion[y, x, 2] - depth) < 1e-4
        # At grazing angles a thousandth of a pixel is far along the surface.
        slant = abs(np.dot(np.array(hit.n), np.array(ray.d))) if hit.is_valid() else 0
        if slant > 0.2:
            assert hit.t == pytest.approx(reach, abs=2e-3)
            met[name] += 1
    assert min(met.values()) >= 3, met
    assert sum(met.values()) > 0.75 * (now.ids > 0).sum()
    # The sky turns with the camera, so all of it has motion.
    assert np.isfinite(now.motion[now.ids == 0]).all()
    np.testing.assert_array_equal(now.motion[now.ids == 0][:, 2], 0)


def test_motion_to_the_next_frame():
    """Equal to the motion of the reversed sequence: the same cameras, shapes and samples."""
    there = list(render_sequence(scene(), flight(3), transforms=dance(3), next=True))
    back = list(render_sequence(scene(), flight(3)[::-1], transforms=[*dance(3)][::-1], next=True))[::-1]
    # The middle frame has the same seed in both directions.
    np.testing.assert_array_equal(there[1].motion_next, back[1].motion)
    np.testing.assert_array_equal(there[1].motion, back[1].motion_next)
    assert not there[2].motion_next.any()
    assert next(render_sequence(scene(), flight(1))).motion_next is None


def test_motion_by_the_buffers():
    """Reprojected positions of the previous frame match this frame's, moved back, within half a pixel."""
    poses, views = list(dance(2)), flight(2)
    then, now = render_sequence(scene(), views, transforms=poses)
    moved = now.position.astype(np.float64)
    for name, pose in poses[1].items():
        back = poses[0].get(name, np.eye(4)) @ np.linalg.inv(pose)
        here = now.ids == 1 + SHAPES.index(name)
        moved[here] = moved[here] @ back[:3, :3].T + back[:3, 3]
    target = np.nan_to_num(now.camera.project(now.position)[0] + now.motion[..., :2], nan=-1)
    x, y = np.floor(target).astype(int).transpose(2, 0, 1)
    inside = (x >= 0) & (y >= 0) & (x < WIDTH) & (y < HEIGHT) & (now.ids > 0)
    x, y = x * inside, y * inside
    same = inside & (then.ids[y, x] == now.ids)
    # Two points of one pixel are close, up to the slant of the surface.
    distance = np.linalg.norm(then.position[y, x] - moved, axis=-1)
    footprint = 2 * np.tan(np.radians(20)) / WIDTH * now.depth
    slant = np.abs((now.normal * (now.camera.position - now.position)).sum(-1)) / now.depth
    checked = same & (slant > 0.3)
    assert checked.sum() > 0.5 * inside.sum()
    assert (distance < footprint * 1.5 / slant)[checked].mean() > 0.97


def test_poses():
    """A transformed scene renders like one that was built so, normals included; at the end it is restored."""
    loaded = mi.load_dict(scene(), parallel=False, optimize=False)
    before = {name: np.array(getattr(v, "matrix", v)) for name, v in mi.traverse(loaded) if is_pose(name)}
    assert len(before) >= len(SHAPES)
    frames = list(render_sequence(loaded, flight(3), transforms=dance(3), seed=8))
    poses = list(dance(3))
    for index, (view, frame) in enumerate(zip(flight(3), frames, strict=True)):
        (want,) = render_sequence(scene(poses[index]), [view], seed=8 + index)
        agree = frame.ids == want.ids
        assert agree.mean() > 0.99
        for name in ("normal", "depth", "position", "albedo", "emission"):
            a, b = frame.buffers()[name][agree], want.buffers()[name][agree]
            np.testing.assert_allclose(a, b, atol=2e-3)
        close = np.isclose(frame.color, want.color, atol=1e-2).all(-1)
        assert close.mean() > 0.97
    interrupted = render_sequence(loaded, flight(3), transforms=dance(3))
    next(interrupted), next(interrupted)
    interrupted.close()
    after = mi.traverse(loaded)
    for name, value in before.items():
        np.testing.assert_array_equal(np.array(getattr(after[name], "matrix", after[name])), value)
    assert_same_frames(render_sequence(loaded, flight(3), transforms=dance(3), seed=8), frames)


def is_pose(name):
    return name.endswith((".to_world", ".vertex_positions", ".vertex_normals"))


def test_smooth_mesh(tmp_path):
    """Interpolated normals turn with the mesh."""
    mesh = mi.Mesh("bent", 3, 1, has_vertex_normals=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = [-1.0, -1, 0, 1, -1, 0, 0, 1, 0]
    parameters["vertex_normals"] = [-0.6, 0, 0.8, 0.6, 0, 0.8, 0, 0.6, 0.8]
    parameters["faces"] = [0, 1, 2]
    parameters.update()
    mesh.write_ply(str(tmp_path / "bent.ply"))
    bent = {"type": "ply", "filename": str(tmp_path / "bent.ply")}
    turn = T().rotate([0, 1, 0], 25)
    stage = {"type": "scene", "sensor": sensor(), "bent": bent, "integrator": {"type": "path"}}
    (got,) = render_sequence(stage, [VIEW], transforms=[{"bent": turn}])
    (want,) = render_sequence({**stage, "bent": {**bent, "to_world": turn}}, [VIEW])
    np.testing.assert_array_equal(got.ids, want.ids)
    assert 0 < got.ids.sum() < got.ids.size
    np.testing.assert_allclose(got.normal, want.normal, atol=1e-5)
    assert np.ptp(got.normal[got.ids > 0], axis=0).min() > 0.1


def test_object_normals():
    """They do not turn: moving shapes keep the normals of the given scene, other shapes have world normals."""
    views = [VIEW] * 3
    frames = list(render_sequence(scene(), views, transforms=dance(3)))
    for frame, poses in zip(frames, dance(3), strict=True):
        want = frame.normal.astype(np.float64)
        for name, pose in poses.items():
            here = frame.ids == 1 + SHAPES.index(name)
            assert here.any()
            want[here] = want[here] @ pose[:3, :3]
        want /= np.maximum(np.linalg.norm(want, axis=-1, keepdims=True), 1e-9)  # the cube's are skewed
        np.testing.assert_allclose(frame.object_normal, want, atol=1e-5)
        cube = frame.object_normal[frame.ids == 1 + SHAPES.index("cube")]
        np.testing.assert_allclose(np.abs(cube).max(-1), 1, atol=1e-5)  # its faces are along the axes
        others = ~np.isin(frame.ids, [1 + SHAPES.index(name) for name in poses])
        assert_same_bits(frame.object_normal[others], frame.normal[others])
    assert np.abs(frames[2].normal - frames[2].object_normal).max() > 0.1
    squashed = {"cube": T().scale([1, 0.6, 1]).rotate([1, 0, 0.5], 25)}
    (frame,) = render_sequence(scene(), [VIEW], transforms=[squashed])
    cube = frame.ids == 1 + SHAPES.index("cube")
    np.testing.assert_allclose(np.abs(frame.object_normal[cube]).max(-1), 1, atol=1e-5)
    assert np.abs(frame.normal[cube]).max() < 0.99
    (still,) = render_sequence(scene(), [VIEW])
    assert still.object_normal is None


# Changes other than motion

LAMP, SKY = "lamp.emitter.radiance.value", "sky.radiance.value"


def test_parameters():
    """Each frame equals that of a scene built with its values; at the end the values are restored."""
    picture = np.random.default_rng(0).random((4, 4, 3)).astype(np.float32)
    bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True}

    def built(radiance=RADIANCE, sky=0.25, alpha=0.3):
        plan = scene(sky={"type": "constant", "radiance": {"type": "rgb", "value": sky}})
        plan["lamp"]["emitter"]["radiance"] = {"type": "rgb", "value": radiance}
        plan["ball"]["bsdf"] = {"type": "roughconductor", "alpha": alpha}
        plan["disk"]["bsdf"] = {"type": "diffuse", "reflectance": bitmap}
        return plan

    loaded = mi.load_dict(built(), parallel=False, optimize=False)
    names = [LAMP, SKY, "ball.bsdf.alpha.value", "disk.bsdf.reflectance.data"]
    names = [name if name in mi.traverse(loaded) else name.removesuffix(".value") for name in names]
    before = {name: np.array(mi.traverse(loaded)[name]) for name in names}
    values = [{}, {LAMP: 0, SKY: [0.1, 0.2, 0.3]}, {names[2]: 0.05}, {names[3]: np.ones((4, 4, 3))}, {}]
    views = [VIEW] * len(values)
    frames = list(render_sequence(loaded, views, parameters=values, seed=5))
    for name, value in before.items():
        np.testing.assert_array_equal(np.array(mi.traverse(loaded)[name]), value)
    plans = [built(), built(radiance=0, sky=[0.1, 0.2, 0.3]), built(alpha=0.05), built(), built()]
    for index, (plan, frame) in enumerate(zip(plans, frames, strict=True)):
        (want,) = render_sequence(plan, [VIEW], seed=5 + index)
        assert_same_bits(frame.ids, want.ids)
        if index == 3:  # the picture is white
            disk = frame.ids == 1 + SHAPES.index("disk")
            assert (frame.albedo[disk] == 1).all()
        else:
            np.testing.assert_allclose(frame.color, want.color, rtol=1e-4, atol=1e-5)
            np.testing.assert_allclose(frame.emission, want.emission, rtol=1e-6)
    interrupted = render_sequence(loaded, views, parameters=values)
    next(interrupted), next(interrupted)
    interrupted.close()
    for name, value in before.items():
        np.testing.assert_array_equal(np.array(mi.traverse(loaded)[name]), value)
    assert_same_frames(render_sequence(loaded, views, parameters=values, seed=5), frames)


# Vertices that move


def sheared(i):
    """A linear map that is not rigid: it bends the corners' angles, and stretches."""
    return np.array([[1 + 0.06 * i, 0.1 * i, 0], [0.02 * i * i, 1 - 0.03 * i, 0.05 * i], [0, 0.04 * i, 1]])


def test_motion_of_vertices():
    """Points of triangles go where their corners go: of a linear map, exactly where it takes them."""
    cube = mi.load_dict(scene(), parallel=False, optimize=False).shapes()[SHAPES.index("cube")]
    corners = np.array(mi.traverse(cube)["vertex_positions"])
    centre = np.array([-1, 0.5, 0])

    def mapped(points, i):
        return (points - centre) @ sheared(i).T + centre

    values = [{"cube.vertex_positions": mapped(corners.reshape(-1, 3), i).ravel()} for i in range(3)]
    lift = [{"ball": T().translate([0.05 * i, 0, 0])} for i in range(3)]
    options = {"parameters": values, "transforms": lift, "next": True}
    frames = list(render_sequence(scene(), flight(3), **options))
    for i in (1, 2):
        frame, before = frames[i], frames[i - 1]
        cube = frame.ids == 1 + SHAPES.index("cube")
        assert cube.sum() > 15
        point = frame.position[cube].astype(np.float64)
        former = mapped((point - centre) @ np.linalg.inv(sheared(i)).T + centre, i - 1)
        pixels, depth = before.camera.project(former)
        here, now = frame.camera.project(point)
        want = np.concatenate([pixels - here, (depth - now)[:, None]], -1)
        np.testing.assert_allclose(frame.motion[cube], want, atol=1e-3)
        # It is another motion than that of a cube that stands still.
        still = before.camera.project(point)[0] - here
        assert np.abs(frame.motion[cube][:, :2] - still).max() > 0.3
        # There and back.
        ahead = before.ids == 1 + SHAPES.index("cube")
        point = before.position[ahead].astype(np.float64)
        later = mapped((point - centre) @ np.linalg.inv(sheared(i - 1)).T + centre, i)
        want = frame.camera.project(later)[0] - before.camera.project(point)[0]
        np.testing.assert_allclose(before.motion_next[ahead][:, :2], want, atol=1e-3)
    # Everything else is as it is without.
    plain = list(render_sequence(scene(), flight(3), transforms=lift))
    for frame, other in zip(frames, plain, strict=True):
        same = (frame.ids == other.ids) & (frame.ids != 1 + SHAPES.index("cube"))
        assert_same_bits(frame.motion[same], other.motion[same])


@pytest.mark.slow
def test_motion_of_a_waving_sheet():
    """A fine mesh follows a wave that is not linear; where its points were is known by their texture coordinates."""
    side = 65
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.2, 1.2, side)]), -1).reshape(-1, 2)
    corner = np.arange(side * side).reshape(side, side)
    a, b, c, d = (corner[i : side - 1 + i, j : side - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])

    def height(x, y, i):
        return 0.15 * np.sin(3 * x + 0.7 * i) * np.cos(2 * y - 0.5 * i)

    def waved(i):
        x, y = grid.T
        return np.stack([x, 0.5 + y / 2, height(x, y, i)], -1).astype(np.float32)

    mesh = mi.Mesh("sheet", side * side, len(faces))
    known = mi.traverse(mesh)
    known["vertex_positions"], known["faces"] = waved(0).ravel(), faces.astype(np.uint32).ravel()
    known.update()
    plan = {"type": "scene", "sensor": sensor(), "sky": {"type": "constant"}, "sheet": mesh}
    values = [{"sheet.vertex_positions": waved(i).ravel()} for i in range(3)]
    frames = list(render_sequence(plan, flight(3), parameters=values))
    for i in (1, 2):
        frame, before = frames[i], frames[i - 1]
        hit = frame.ids > 0
        assert hit.sum() > 100
        x, y, z = frame.position[hit].astype(np.float64).T
        np.testing.assert_allclose(z, height(x, 2 * y - 1, i), atol=2e-3)  # of triangles this small
        former = np.stack([x, y, z - height(x, 2 * y - 1, i) + height(x, 2 * y - 1, i - 1)], -1)
        want = before.camera.project(former)[0] - frame.camera.project(frame.position[hit])[0]
        np.testing.assert_allclose(frame.motion[hit][:, :2], want, atol=0.02)
        assert np.abs(frame.motion[hit][:, :2] - frame.motion[hit][:, :2].mean(0)).max() > 0.1


# Cameras without a centre


def test_orthographic():
    """Hits lie in their pixels, and motion leads back to what was seen there."""
    plan = scene(sensor=sensor("orthographic", near_clip=0.5, to_world=VIEW))
    del plan["sensor"]["fov"]
    poses = [
        T().look_at([0.5 + 0.1 * i, 1, 5], [0.05 * i, 0.5, 0], [0, 1, 0]).scale([1.8 - 0.1 * i, 1.8 - 0.1 * i, 1])
        for i in range(3)
    ]
    frames = list(render_sequence(plan, poses, transforms=list(dance(3))))
    assert set(np.unique(frames[0].ids)) == {0, *range(1, 7)}
    moves = list(dance(3))
    for i, frame in enumerate(frames):
        assert frame.camera is None
        hit = frame.ids > 0
        # What Mitsuba's own rays meet, in pixels.
        own = mi.load_dict({**plan["sensor"], "to_world": poses[i]})
        to_uv = np.array(own.projection_transform().matrix) @ np.linalg.inv(matrix(poses[i]))
        pixels = (frame.position @ to_uv[:2, :3].T + to_uv[:2, 3]) * [WIDTH, HEIGHT]
        inside_pixels(pixels, hit)
        pose = matrix(poses[i])
        depth = (frame.position - pose[:3, 3]) @ pose[:3, 2]
        np.testing.assert_allclose(frame.depth[hit], depth[hit], atol=1e-5)
        assert (frame.depth[~hit] == np.inf).all()
        if not i:
            continue
        np.testing.assert_array_equal(frame.motion[~hit], 0)
        former = frame.position.astype(np.float64)
        for name, here in moves[i].items():
            back = moves[i - 1].get(name, np.eye(4)) @ np.linalg.inv(here)
            own_pixels = frame.ids == 1 + SHAPES.index(name)
            former[own_pixels] = former[own_pixels] @ back[:3, :3].T + back[:3, 3]
        then = np.array(own.projection_transform().matrix) @ np.linalg.inv(matrix(poses[i - 1]))
        want = (former @ then[:2, :3].T + then[:2, 3]) * [WIDTH, HEIGHT] - pixels
        np.testing.assert_allclose(frame.motion[hit][:, :2], want[hit], atol=1e-4)
    with pytest.raises(ValueError, match=r"cameras: expected poses, as the sensor is orthographic, got yester\.Camera"):
        render_sequence(plan, [yester.Camera.from_look_at([0, 1, 5], [0, 0, 0], [0, 1, 0], 40, WIDTH, HEIGHT)])


# Two halves


@pytest.mark.parametrize("spp", [1, 2])
def test_halves(spp):
    """Independent, and together a frame of twice the samples."""
    options = {"transforms": list(dance(3)), "gradient": True}
    pairs = list(render_sequence(scene(), flight(3), spp=spp, halves=True, **options))
    whole = list(render_sequence(scene(), flight(3), spp=2 * spp, **options))
    assert len(pairs) == 3
    for (one, other), both in zip(pairs, whole, strict=True):
        np.testing.assert_allclose((one.color + other.color) / 2, both.color, rtol=1e-5)
        np.testing.assert_allclose((one.albedo + other.albedo) / 2, both.albedo, rtol=1e-5)
        assert (one.color != other.color).any()
        assert_same_bits(one.position, both.position)
        assert one.camera == other.camera == both.camera
    # Each half asks its own first sample whether the surface is still there.
    replay = (one.replay + other.replay) / 2
    known = np.isfinite(replay)
    assert known.mean() > 0.5
    np.testing.assert_allclose(replay[known], both.replay[known], rtol=1e-5)


def test_halves_of_colour_alone():
    ((one, other),) = render_sequence(scene(), [VIEW], spp=16, halves=True, buffers=False)
    assert set(one.buffers()) == set(other.buffers()) == {"color"}
    difference = one.color - other.color
    assert (difference != 0).mean() > 0.4  # the sky has no noise
    assert abs(difference.mean()) < 0.1 * one.color.mean()


def test_halves_that_are_not_used_up():
    """The scene is left as it was."""
    loaded = mi.load_dict(scene(), parallel=False, optimize=False)
    before = np.array(mi.traverse(loaded)["cube.vertex_positions"])
    pairs = render_sequence(loaded, flight(3), transforms=list(dance(3)), halves=True)
    next(pairs), next(pairs)
    pairs.close()
    np.testing.assert_array_equal(np.array(mi.traverse(loaded)["cube.vertex_positions"]), before)


# Replay


@pytest.mark.parametrize("spp", [1, 3])
def test_replay_of_a_still_scene(spp):
    """Bit for bit the previous frame, for any camera motion."""
    first, *frames = render_sequence(scene(), flight(4), spp=spp, gradient=True)
    assert first.replay is None
    for before, frame in zip([first, *frames], frames, strict=False):
        assert_same_bits(frame.replay, before.color)
        assert (frame.color != before.color).any()
    plain = list(render_sequence(scene(), flight(4), spp=spp))
    assert all(frame.replay is None for frame in plain)
    for a, b in zip(plain, [first, *frames], strict=True):
        assert_same_bits(a.color, b.color)


def test_replay_of_a_switched_light():
    """Where its light fell, the replay is darker by exactly that; elsewhere, and before, it has the old bits."""
    values = [{}, {}, {LAMP: 0}, {LAMP: 0}]
    frames = list(render_sequence(scene(), flight(4), parameters=values, gradient=True))
    for index in (1, 3):
        assert_same_bits(frames[index].replay, frames[index - 1].color)
    before, replay = frames[1].color, frames[2].replay
    assert np.isfinite(replay).all()
    changed = (replay != before).any(-1)
    assert 0.3 < changed.mean() < 1
    assert (replay <= before).all()
    np.testing.assert_array_equal(changed[frames[1].ids == 0], False)
    (dark,) = render_sequence(scene(), flight(4)[1:2], seed=1, parameters=[{LAMP: 0}])
    assert_same_bits(replay, dark.color)


def test_replay_of_moving_shapes():
    """Missing where a moving shape was or is; surfaces in its shadow change, all others keep their bits."""
    lift = [{"ball": T().translate([0.2 * i, 0, 0])} for i in (0, 0, 1, 2)]
    frames = list(render_sequence(scene(), [VIEW] * 4, transforms=lift, gradient=True))
    assert_same_bits(frames[1].replay, frames[0].color)
    for index in (2, 3):
        then, now = frames[index - 1], frames[index]
        # Samples are those of the previous frame, so the ball's new place is known but for its edge.
        ball = [frame.ids == 1 + SHAPES.index("ball") for frame in (then, now)]
        gone = np.isnan(now.replay)
        np.testing.assert_array_equal(gone.any(-1), gone.all(-1))
        gone = gone[..., 0]
        assert gone[ball[0]].all()
        assert gone[ball[1]].mean() > 0.8
        assert gone[~(ball[0] | ball[1])].mean() < 0.05
        kept = (now.replay == then.color).all(-1)
        assert kept[then.ids == 0][~gone[then.ids == 0]].all()
        assert 0.2 < kept[~gone].mean() < 1


def test_replay_of_a_bent_mesh():
    """Vertices moved by parameters make pixels missing, too; an invisible displacement does not."""
    cube = mi.load_dict(scene(), parallel=False, optimize=False).shapes()[SHAPES.index("cube")]
    corners = np.array(mi.traverse(cube)["vertex_positions"])
    values = [{"cube.vertex_positions": corners + push} for push in (0, 0.02, 0.02 + 1e-6)]
    _, pushed, same = render_sequence(scene(), [VIEW] * 3, parameters=values, gradient=True)
    inside = pushed.ids == 1 + SHAPES.index("cube")
    gone = np.isnan(pushed.replay[..., 0])
    assert gone[inside].mean() > 0.8
    assert gone[~inside].mean() < 0.05
    assert np.isnan(same.replay).mean() < 0.01


# Sources

XML = """<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
  </sensor>
  <bsdf type="diffuse" id="grey"/>
  <shape type="cube" id="left">
    <transform name="to_world"><translate x="-1.5"/></transform><ref id="grey"/>
  </shape>
  <shape type="cube" id="right">
    <transform name="to_world"><translate x="1.5"/></transform><ref id="grey"/>
  </shape>
  <emitter type="constant"/>
</scene>
"""


def test_sources(tmp_path):
    """A file, its path as a string, and the scene loaded from it; shapes of one material stay apart."""
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    lift = [{}, {"left": T().translate([0, 0.2, 0])}]
    views = [T().look_at([0, 1, 5], [0, 0, 0], [0, 1, 0])] * 2
    loaded = mi.load_file(str(path), optimize=False, parallel=False)
    first, *others = (list(render_sequence(s, views, transforms=lift)) for s in (path, str(path), loaded))
    for other in others:
        assert_same_frames(other, first)
    frame = first[1]
    assert set(np.unique(frame.ids)) == {0, 1, 2}
    assert frame.shape == (HEIGHT, WIDTH)
    assert frame.motion[frame.ids == 1][:, 1].min() > 0.5  # it was lower before, and y points down
    np.testing.assert_array_equal(frame.motion[frame.ids != 1], 0)


def test_without_sensor_and_integrator():
    bare = {"type": "scene", "ball": {"type": "sphere"}, "sky": {"type": "constant"}}
    camera = yester.Camera.from_look_at([0, 1, 5], [0, 0, 0], [0, 1, 0], 40, WIDTH, HEIGHT)
    (frame,) = render_sequence(bare, [camera])
    inside_pixels(camera.project(frame.position)[0], frame.ids > 0)
    assert frame.color[frame.ids > 0].mean() == pytest.approx(0.5, rel=0.1)
    with pytest.raises(ValueError, match=r"cameras: expected yester\.Camera, as the scene has no sensor"):
        render_sequence(bare, [VIEW])


def test_default_variant():
    code = "from yester.io.mitsuba import render_sequence as r; import mitsuba as m; list(r({'type': 'scene'}, []))"
    code += "; assert m.variant() == 'scalar_rgb', m.variant()"
    subprocess.run([sys.executable, "-c", code], check=True)


# Bad input


BROAD = yester.Camera.from_look_at([1, 2, 4], [0, 0, 0], [0, 1, 0], 50, 2 * WIDTH, HEIGHT)
SQUEEZED = yester.Camera(np.eye(4)[[0, 1, 3, 2]], 20, 10)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"spp": 0}, "spp: expected at least 1, got 0"),
        ({"seed": -1}, "seed: expected at least 0, got -1"),
        ({"seed": 2**32}, "seed: expected at most 4294967294 for 2 frames of 1 samples, got 4294967296"),
        ({"seed": 2**29 - 1, "spp": 4, "halves": True}, "seed: expected at most 536870910 for 2 frames of 4 samples"),
        ({"seed": 2**32 - 1, "spp": 4, "buffers": False}, "seed: expected at most 4294967294"),
        ({"transforms": [{}]}, "transforms: expected one for each of 2 cameras, got 1"),
        ({"transforms": [{}, {"bal": np.eye(4)}]}, r"transforms: expected ids of shapes \(ball, cube, .*got 'bal'"),
        ({"transforms": [{}, {"ball": np.eye(3)}]}, r"transforms\['ball'\]: expected an invertible \(4, 4\) matrix"),
        ({"transforms": [{}, {"ball": np.full((4, 4), np.nan)}]}, r"transforms\['ball'\]: expected an invertible"),
        ({"transforms": [{}, {"ball": np.zeros((4, 4))}]}, r"transforms\['ball'\]: expected an invertible"),
        ({"parameters": [{}]}, "parameters: expected one for each of 2 cameras, got 1"),
        (
            {"parameters": [{}, {"lamp.emiter.radiance": 1}]},
            r"parameters: expected names that .* has \(lamp\.emitter\.radiance\.value, .*got 'lamp\.emiter\.radiance'",
        ),
        ({"parameters": [{}, {"?": 1}]}, r"parameters: expected names that mitsuba\.traverse\(scene\) has, got '\?'"),
        ({"parameters": [{}, {LAMP: [1, 2]}]}, r"parameters\['lamp\.emitter.*: expected Color3f, got \[1, 2\]"),
        (
            {"parameters": [{}, {"ball.to_world": T()}], "transforms": [{"ball": T()}, {}]},
            r"parameters: 'ball\.to_world' is what transforms change",
        ),
        ({"gradient": True, "buffers": False}, "gradient: expected False without buffers"),
        ({"next": True, "buffers": False}, "next: expected False without buffers"),
        ({"cameras": [VIEW, BROAD]}, "cameras: expected all of the same size"),
        ({"cameras": [VIEW, np.eye(3)]}, "cameras: expected an invertible"),
        ({"cameras": [SQUEEZED]}, "cameras: expected square pixels"),
        ({"scene": {"type": "sphere"}}, "scene: expected a scene"),
        (
            {"scene": scene(sensor=SENSORS[7])},
            "cameras: expected the principal point of a thin lens in the centre",
        ),
    ],
)
def test_bad_input(arguments, complaint):
    """Refused at the call, before the first frame."""
    given = {"scene": scene(), "cameras": [VIEW, VIEW], **arguments}
    with pytest.raises(ValueError, match=complaint):
        render_sequence(**given)


def test_without_mitsuba(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[mitsuba\]'"):
        render_sequence(scene(), [VIEW])


def test_threads_do_not_change_bits():
    """More threads than the image has blocks."""
    sequence = cornell_box(2, 48, 36)
    before = drjit.thread_count()

    def render(threads):
        drjit.set_thread_count(threads)
        return list(render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms))

    try:
        for few, many in zip(render(1), render(16), strict=True):
            for name, array in few.buffers().items():
                assert_same_bits(array, many.buffers()[name])
    finally:
        drjit.set_thread_count(before)
