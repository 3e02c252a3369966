import resource
import sys
from pathlib import Path

import compare
import mitsuba
import numpy as np
import OpenEXR
import pytest
import yester
from compare import assert_same_bits
from hypothesis import given
from hypothesis import strategies as st
from yester import io
from yester.io import layout
from yester.io import mitsuba as door

COMMON = ("albedo", "normal", "depth", "motion", "ids", "position", "emission")
BUFFERS = (*COMMON, "object_normal", "replay", "hit_distance")
#: From clip space, for column vectors.
TO_NDC = np.array([[0.5, 0, 0, 0.5], [0, -0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])


def buffers(rng, height, width, *, motion=3):
    """One buffer of each kind, with infinities and NaN in it."""
    names = ("color", "albedo", "normal", "position", "emission", "object_normal", "replay")
    arrays = {name: compare.colors(rng, height, width) for name in names}
    arrays["color"] *= 1e5  # outside the range of float16
    arrays["motion"] = compare.motions(rng, height, width, motion)
    arrays["depth"] = compare.surfaces(rng, height, width)["depth"]
    arrays["hit_distance"] = np.where(rng.random((height, width)) < 0.1, np.inf, arrays["depth"]).astype(np.float32)
    arrays["ids"] = rng.integers(0, 2**32, (height, width)).astype(np.uint32)
    return arrays


def store(path, header, channels):
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **header}
    OpenEXR.File(header, dict(channels)).write(str(path))  # as OpenEXR replaces its values


def rgb(height, width):
    return {name: np.full((height, width), 0.5, np.float32) for name in "RGB"}


@given(
    height=st.integers(1, 20),
    width=st.integers(1, 70),
    motion=st.sampled_from([2, 3]),
    half=st.booleans(),
    names=st.sets(st.sampled_from(BUFFERS)),
)
def test_round_trip(tmp_path_factory, height, width, motion, half, names):
    path = tmp_path_factory.mktemp("exr") / "frame.exr"
    arrays = buffers(np.random.default_rng(width), height, width, motion=motion)
    frame = yester.Frame(**{name: arrays[name] for name in ("color", *names)})
    io.write_exr(path, frame, half=half)
    back = io.read_exr(path)
    assert back.buffers().keys() == frame.buffers().keys()
    for name, got in back.buffers().items():
        want = arrays[name]
        if half and name in ("color", "albedo", "normal", "emission", "object_normal", "replay"):
            limited = np.where(np.isfinite(want), np.clip(want, -65504, 65504), want)
            want = limited.astype(np.float16).astype(np.float32)
        assert_same_bits(got, want)
    assert back.camera is None
    assert list(path.parent.iterdir()) == [path]


def test_colour_alone(tmp_path):
    color = np.random.default_rng(0).random((3, 4, 3))
    io.write_exr(tmp_path / "a.exr", color)
    assert_same_bits(io.read_exr(str(tmp_path / "a.exr")).color, color.astype(np.float32))


# Cameras


def same_camera(got, want):
    """Points in view project to the same pixels, to single precision."""
    assert (got.width, got.height) == (want.width, want.height)
    y, x = np.mgrid[: want.height, : want.width] + 0.5
    points = want.unproject(np.stack([x, y], -1), 1 + x)
    pixels, depth = got.project(points)
    np.testing.assert_allclose(pixels, np.stack([x, y], -1), atol=1e-6 * max(want.width, want.height) * 10)
    np.testing.assert_allclose(depth, 1 + x, rtol=1e-5)


def cameras():
    rng = np.random.default_rng(7)
    views = [compare.camera(rng, 31, 17, spread=spread) for spread in (0.3, 3, 3, 3)]
    # A matrix that resembles its transpose: at the origin, along an axis.
    views.append(yester.Camera.from_look_at([0, 0, 0], [0, 0, -1], [0, 1, 0], 60, 31, 17))
    views.append(yester.Camera.from_look_at([0, 0, 0], [1, 0, 0], [0, 1, 0], 60, 31, 17, principal_point=(9, 5)))
    views.append(yester.Camera.from_look_at([5, 0, 0], [0, 0, 0], [0, 1, 0], 60, 31, 17))
    return views


@pytest.mark.parametrize("camera", cameras(), ids=str)
def test_camera(tmp_path, camera):
    path = tmp_path / "a.exr"
    io.write_exr(path, yester.Frame(np.zeros((17, 31, 3)), camera=camera))
    same_camera(io.read_exr(path).camera, camera)
    same_camera(io.describe(path).camera, camera)


def test_cameras_are_stored_for_row_vectors(tmp_path):
    """In the bytes of the file, which OpenEXR reads by rows: the translation is in the last one."""
    camera = cameras()[0]
    io.write_exr(tmp_path / "a.exr", yester.Frame(np.zeros((17, 31, 3)), camera=camera))
    data = (tmp_path / "a.exr").read_bytes()
    (header, *_), _ = layout.headers(data)
    matrices = {"worldToCamera": camera.world_to_camera, "worldToNDC": TO_NDC @ camera.world_to_clip}
    for name, matrix in matrices.items():
        stored = np.frombuffer(data, "<f4", 16, header[name].start).reshape(4, 4)
        assert_same_bits(stored, matrix.T.astype(np.float32))


@pytest.mark.parametrize("corner", [(90, 24), (-40, 24), (32, -30), (32, 80), (160, 120), (-100, -80)])
def test_a_principal_point_outside_the_image(tmp_path, corner):
    """As in a crop of a larger image: what other renderers' matrices are recognised by does not hold."""
    camera = yester.Camera.from_look_at([1, 2, 5], [0, 0, 0], [0, 1, 0], 45, 64, 48, principal_point=corner)
    io.write_exr(tmp_path / "a.exr", yester.Frame(np.zeros((48, 64, 3)), camera=camera))
    same_camera(io.read_exr(tmp_path / "a.exr").camera, camera)
    io.write_exr(tmp_path / "b.exr", np.ones((48, 64, 3)), like=io.read_plate(tmp_path / "a.exr"))
    same_camera(io.read_exr(tmp_path / "b.exr").camera, camera)


def test_a_point_at_the_corner_of_the_view_is_no_orthographic_camera(tmp_path):
    """The world's origin has the coordinates 0 0 0 in NDC, as the last column of an orthographic matrix has."""
    clip = [[1, 0, 1, -5], [0, 1, -1, 5], [0, 0, 1, 0], [0, 0, -1, 5]]
    camera = yester.Camera(clip, 64, 48)
    io.write_exr(tmp_path / "a.exr", yester.Frame(np.zeros((48, 64, 3)), camera=camera))
    same_camera(io.read_exr(tmp_path / "a.exr").camera, camera)


@pytest.mark.parametrize("scale", [1e-300, 1e-42, 1e39, 1e300])
def test_scaled_matrices(tmp_path, scale):
    camera = cameras()[0]
    scaled = yester.Camera(scale * camera.world_to_clip, 31, 17)
    io.write_exr(tmp_path / "a.exr", yester.Frame(np.zeros((17, 31, 3)), camera=scaled))
    same_camera(io.read_exr(tmp_path / "a.exr").camera, camera)


@pytest.mark.parametrize("scale", [1.0, -40.0, 1e-3])
@pytest.mark.parametrize("convention", ["imath", "pbrt", "houdini", "right-handed"])
@pytest.mark.parametrize("camera", cameras(), ids=str)
def test_camera_of_others(tmp_path, camera, convention, scale):
    """Any layout, any scale of the projection. Files of version 0.2 and before have that of pbrt, Houdini's -1 to 1."""
    ndc = np.eye(4) if convention == "houdini" else TO_NDC
    backward = np.diag([1, 1, -1, 1]) if convention == "right-handed" else np.eye(4)
    matrices = {
        "worldToCamera": backward @ camera.world_to_camera,
        "worldToNDC": abs(scale) * ndc @ camera.world_to_clip,
    }
    header = {
        name: np.ascontiguousarray(matrix if convention == "pbrt" else matrix.T, np.float32)
        for name, matrix in matrices.items()
    }
    store(tmp_path / "a.exr", header, rgb(17, 31))
    same_camera(io.read_exr(tmp_path / "a.exr").camera, camera)
    del header["worldToCamera"]
    store(tmp_path / "b.exr", header, rgb(17, 31))
    same_camera(io.read_exr(tmp_path / "b.exr").camera, camera)


def test_camera_of_mantra(tmp_path):
    """The header of a file of Houdini (github.com/ynput/ayon-houdini/issues/76): from -1 to 1, along -z."""
    to_camera = [
        [-0.243232, -0.429738, -0.869577, 0],
        [-4.55991e-08, 0.8965, -0.443043, 0],
        [-0.969968, 0.107762, 0.218058, 0],
        [-0.49336, -0.356619, 6.48486, 1],
    ]
    to_ndc = [
        [-0.587216, -1.84441, -8.69577e-05, 0.869577],
        [-1.10086e-07, 3.84773, -4.43043e-05, 0.443043],
        [-2.34172, 0.462509, 2.18058e-05, -0.218058],
        [-1.19108, -1.53059, 0.000648386, -6.48486],
    ]
    header = {"worldToCamera": np.float32(to_camera), "worldToNDC": np.float32(to_ndc)}
    store(
        tmp_path / "a.exr", header, rgb(72, 128) | {f"n.{c}": np.full((72, 128), c == "Z", np.float32) for c in "XYZ"}
    )
    frame = io.read_exr(tmp_path / "a.exr", mapping={"normal": {"channels": ["n.X", "n.Y", "n.Z"], "space": "camera"}})
    np.testing.assert_allclose(frame.camera.position, np.linalg.inv(to_camera)[3, :3], atol=1e-4)
    np.testing.assert_allclose(frame.camera.forward, np.negative(to_camera)[:3, 2], atol=1e-5)
    right, up, backward = np.transpose(to_camera)[:3, :3]
    point = frame.camera.position + right + 0.5 * up - 5 * backward
    np.testing.assert_allclose(frame.camera.project(point)[0], [94.902, 20.549], atol=1e-3)
    np.testing.assert_allclose(frame.normal[0, 0], -backward, atol=1e-5)  # a mapping's z is forward


def test_data_window(tmp_path):
    """The camera spans the display window, the image is the data window."""
    whole = cameras()[0]
    io.write_exr(tmp_path / "whole.exr", yester.Frame(np.zeros((17, 31, 3)), camera=whole))
    header = OpenEXR.File(str(tmp_path / "whole.exr"), header_only=True).header()
    header = {name: header[name] for name in ("worldToCamera", "worldToNDC")}
    windows = {"displayWindow": ([2, 1], [32, 17]), "dataWindow": ([5, 4], [14, 8])}
    for name, (low, high) in windows.items():
        header[name] = (np.array(low, np.int32), np.array(high, np.int32))
    store(tmp_path / "crop.exr", header, rgb(5, 10))
    frame = io.read_exr(tmp_path / "crop.exr")
    assert frame.shape == (5, 10)
    points = whole.unproject([[7.0, 6.0], [4.5, 3.5]], [3.0, 5.0])
    np.testing.assert_allclose(frame.camera.project(points)[0], [[4, 3], [1.5, 0.5]], atol=1e-4)


def test_unusable_cameras(tmp_path):
    path = tmp_path / "a.exr"
    orthographic = np.diag([0.1, 0.1, 1, 1]).astype(np.float32)
    orthographic[3, :3] = 1, 2, 3
    store(path, {"worldToNDC": orthographic, "worldToCamera": orthographic}, rgb(2, 3))
    assert io.read_exr(path).camera is None
    for broken in (np.full((4, 4), np.nan), np.ones((4, 4)), np.zeros((4, 4))):
        store(path, {"worldToNDC": broken.astype(np.float32)}, rgb(2, 3))
        for read in (io.read_exr, io.describe):
            with pytest.raises(ValueError, match=r"a\.exr: worldToNDC"):
                read(path)


# Files of other programs

AOVS = "albedo:albedo,dd.y:depth,nn:sh_normal,pos:position,si:shape_index,pi:prim_index,uv:uv"


def mitsuba_file(path, *, component="float32", spp=1, aovs=AOVS):
    """A small scene rendered and written by Mitsuba: its bitmap's channels and its sensor."""
    if mitsuba.variant() is None:
        mitsuba.set_variant("scalar_rgb")
    transform = mitsuba.ScalarTransform4f
    scene = mitsuba.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "aov", "aovs": aovs, "img": {"type": "path"}},
            "sensor": {
                "type": "perspective",
                "near_clip": 0.7,
                "to_world": transform().look_at([1, 2, 5], [0, 0, 0], [0, 1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": 32,
                    "height": 24,
                    "pixel_format": "rgb",
                    "component_format": component,
                    "rfilter": {"type": "box"},
                },
            },
            "ball": {"type": "sphere"},
            "floor": {"type": "rectangle", "to_world": transform().translate([0, -1, 0]).rotate([1, 0, 0], -90)},
            "light": {"type": "point", "position": [3, 4, 5]},
        }
    )
    sensor = scene.sensors()[0]
    scene.integrator().render(scene, sensor=sensor, spp=spp)
    bitmap = sensor.film().bitmap()
    bitmap.write(str(path))
    pixels = np.array(bitmap).astype(np.float32)
    return {field.name: pixels[..., index] for index, field in enumerate(bitmap.struct_())}, sensor


@pytest.mark.slow
@pytest.mark.parametrize("component", ["float32", "float16"])
def test_mitsuba(tmp_path, component):
    path = tmp_path / "mitsuba.exr"
    wrote, _ = mitsuba_file(path, component=component)
    frame = io.read_exr(path)
    assert set(frame.buffers()) == {"color", "albedo", "normal", "depth", "ids", "position"}

    def layer(name, components):
        return np.stack([wrote[name + c] for c in components], -1)

    miss = wrote["dd.y.T"] == 0
    assert 0 < miss.sum() < miss.size
    assert_same_bits(frame.color, layer("", "RGB"))
    assert_same_bits(frame.albedo, layer("albedo.", "RGB"))
    assert_same_bits(frame.normal, layer("nn.", "XYZ"))
    assert_same_bits(frame.depth, np.where(miss, np.float32(np.inf), wrote["dd.y.T"]))
    assert_same_bits(frame.position, np.where(miss[..., None], np.float32(np.nan), layer("pos.", "XYZ")))
    assert_same_bits(frame.ids, wrote["si.I"].astype(np.uint32))
    np.testing.assert_array_equal(frame.ids == 0, miss)
    assert set(np.unique(frame.ids)) == {0, 1, 2}
    told = io.describe(path)
    assert told.channels["depth"] == ("dd.y.T",)
    assert set(told.unrecognised) == {"img.R", "img.G", "img.B", "img.A", "pi.I", "uv.U", "uv.V"}
    assert "along the ray" in told.notes["depth"]


@pytest.mark.slow
@pytest.mark.parametrize(("aovs", "tolerance"), [("d:depth,pos:position", 1e-6), ("d:depth", 0.02)])
def test_mitsuba_depth(tmp_path, aovs, tolerance):
    """With a camera in the header, a distance along the ray becomes that along the axis."""
    path = tmp_path / "a.exr"
    wrote, sensor = mitsuba_file(path, aovs="truth:position," + aovs)
    camera = door.camera(sensor)
    io.write_exr(tmp_path / "camera.exr", yester.Frame(np.zeros((24, 32, 3)), camera=camera))
    attributes = OpenEXR.File(str(tmp_path / "camera.exr"), header_only=True).header()
    header = {name: attributes[name] for name in ("worldToCamera", "worldToNDC")}
    names = [name for name in wrote if not name.startswith("truth")]
    store(path, header, {name: np.ascontiguousarray(wrote[name]) for name in names})
    _, depth = camera.project(np.stack([wrote["truth." + c] for c in "XYZ"], -1))
    near = 0 if "position" in aovs else 0.7
    frame = io.read_exr(path)
    hit = wrote["d.T"] > 0
    np.testing.assert_allclose(frame.depth[hit] + near, depth[hit], rtol=tolerance)
    np.testing.assert_array_equal(frame.depth[~hit], np.inf)
    assert "camera axis" in io.describe(path).notes["depth"]


@pytest.mark.slow
@pytest.mark.parametrize(("aovs", "layer"), [("si:shape_index,pos:position", "pos."), ("p:position", "p.")])
def test_mitsuba_without_depth(tmp_path, aovs, layer):
    wrote, _ = mitsuba_file(tmp_path / "a.exr", aovs=aovs)
    miss = np.all([wrote[layer + c] == 0 for c in "XYZ"], 0)
    assert 0 < miss.sum() < miss.size
    position = io.read_exr(tmp_path / "a.exr").position
    np.testing.assert_array_equal(np.isnan(position), np.stack([miss] * 3, -1))


@pytest.mark.parametrize("prefix", ["", "ViewLayer.", "Shot 3.Main."])
@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_vector_of_cycles(tmp_path, prefix, kind):
    """A surface that moves from (3, 5) over (10, 4) to (18, 2), rows counted from the top; y points up in the file."""
    value = dict(zip("XYZW", (3 - 10, 4 - 5, 10 - 18, 2 - 4), strict=True))
    vector = {f"{prefix}Vector.{name}": np.full((4, 6), value[name], kind) for name in "XYZW"}
    store(tmp_path / "frame.exr", {}, rgb(4, 6) | vector)
    frame = io.read_exr(tmp_path / "frame.exr")
    assert_same_bits(frame.motion, np.broadcast_to(np.float32([-7, 1]), (4, 6, 2)))
    assert_same_bits(frame.motion_next, np.broadcast_to(np.float32([8, -2]), (4, 6, 2)))
    known = io.describe(tmp_path / "frame.exr")
    assert not known.unrecognised
    assert known.notes.keys() == {"motion", "motion_next"}
    # Layers written by Yester take precedence.
    own = {f"motion.{name}": np.ones((4, 6), np.float32) for name in "XYZ"}
    store(tmp_path / "own.exr", {}, rgb(4, 6) | vector | own)
    assert (io.read_exr(tmp_path / "own.exr").motion == 1).all()
    assert "motion" not in io.describe(tmp_path / "own.exr").notes


@pytest.mark.slow
def test_averaged_ids(tmp_path):
    """Above one sample per pixel Mitsuba averages ids: a fraction yields no object."""
    wrote, _ = mitsuba_file(tmp_path / "a.exr", spp=16)
    ids = io.read_exr(tmp_path / "a.exr").ids
    mixed = wrote["si.I"] % 1 != 0
    assert mixed.any()
    np.testing.assert_array_equal(ids[mixed], 2**32 - 1)
    assert set(np.unique(ids[~mixed])) == {0, 1, 2}


@pytest.mark.parametrize("compression", ["ZIP", "PIZ", "NO", "ZIPS"])
@pytest.mark.parametrize("kind", ["scanlineimage", "tiledimage"])
def test_compressions(tmp_path, compression, kind):
    planes = {name: np.random.default_rng(0).random((70, 70)).astype(np.float16) for name in "RGB"}
    header = {"compression": getattr(OpenEXR, compression + "_COMPRESSION"), "type": getattr(OpenEXR, kind)}
    if kind == "tiledimage":
        header["tiles"] = OpenEXR.TileDescription()
    store(tmp_path / "a.exr", header, planes)
    want = np.stack([planes[c] for c in "RGB"], -1).astype(np.float32)
    assert_same_bits(io.read_exr(tmp_path / "a.exr").color, want)


@pytest.mark.parametrize("compression", ["dwaa", "dwab"])
def test_dwa_keeps_no_guides(tmp_path, compression):
    """It takes every channel named Y for luminance, and luminance and colour for float16."""
    color = np.full((16, 16, 3), 0.5, np.float32)
    color[4, 4] = 1e5
    guided = yester.Frame(color, motion=np.full((16, 16, 2), 1e5, np.float32))
    with pytest.raises(ValueError, match=rf"^compression: expected one that keeps motion\.Y, got {compression}"):
        io.write_exr(tmp_path / "a.exr", guided, compression=compression)
    assert not any(tmp_path.iterdir())
    io.write_exr(tmp_path / "a.exr", color, compression=compression)
    got = io.read_exr(tmp_path / "a.exr").color
    np.testing.assert_allclose(got[4, 4], 65504, rtol=0.02)
    np.testing.assert_allclose(got[12:, 12:], 0.5, rtol=0.02)
    # Of a plate, the other channels count as well.
    io.write_exr(tmp_path / "guided.exr", guided)
    plate = io.read_plate(tmp_path / "guided.exr")
    with pytest.raises(ValueError, match=r"expected one that keeps motion\.Y"):
        io.write_exr(tmp_path / "b.exr", color, compression=compression, like=plate)
    assert not (tmp_path / "b.exr").exists()


@pytest.mark.parametrize("compression", ["pxr24", "dwaa"])
def test_lossy_compressions_keep_no_cryptomatte(tmp_path, compression):
    ids = np.full((4, 5), 0x1C6EF372, np.uint32).view(np.float32)
    planes = {name: np.ones((4, 5), np.float32) for name in "RGB"} | {"CryptoObject00.R": ids}
    store(tmp_path / "a.exr", {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes)
    plate = io.read_plate(tmp_path / "a.exr")
    with pytest.raises(
        ValueError, match=rf"^compression: expected one that keeps CryptoObject00\.R, got {compression}"
    ):
        io.write_exr(tmp_path / "b.exr", plate.frame, compression=compression, like=plate)


def multipart(path, *, depth=(20, 30)):
    rng = np.random.default_rng(0)
    layers = {
        "depth": {"depth.Z": rng.random(depth).astype(np.float32), "R": rng.random(depth).astype(np.float32)},
        "beauty": {name: rng.random((20, 30)).astype(np.float32) for name in "RGB"},
    }
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    header["displayWindow"] = (np.array([0, 0], np.int32), np.array([29, 19], np.int32))
    parts = [OpenEXR.Part(dict(header), dict(channels), name) for name, channels in layers.items()]
    OpenEXR.File(parts).write(str(path))
    return layers


def test_parts(tmp_path):
    layers = multipart(tmp_path / "a.exr")
    frame = io.read_exr(tmp_path / "a.exr")
    assert_same_bits(frame.color, np.stack([layers["beauty"][c] for c in "RGB"], -1))
    assert_same_bits(frame.depth, layers["depth"]["depth.Z"])
    assert io.describe(tmp_path / "a.exr").unrecognised == ("depth.R",)
    multipart(tmp_path / "a.exr", depth=(5, 6))
    assert set(io.read_exr(tmp_path / "a.exr").buffers()) == {"color"}


# Unreadable files


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("share", [0.0001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.9999])
def test_truncated(tmp_path, capfd, parts, share):
    path = tmp_path / "a.exr"
    if parts == 2:
        multipart(path)
    else:
        io.write_exr(path, yester.Frame(**buffers(np.random.default_rng(0), 40, 30), camera=None))
    whole = path.read_bytes()
    path.write_bytes(whole[: max(5, int(share * len(whole)))])
    with pytest.raises(ValueError, match=r"a\.exr: truncated or corrupt: ."):
        io.read_exr(path)
    if parts == 1:
        with pytest.raises(ValueError, match=r"a\.exr: truncated or corrupt: ."):
            io.describe(path)  # `describe` reads no pixels
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(("content", "complaint"), [(b"", "an empty file"), (b"hello", "not an EXR file")])
def test_not_an_exr(tmp_path, content, complaint):
    path = tmp_path / "a.exr"
    path.write_bytes(content)
    for read in (io.read_exr, io.describe):
        with pytest.raises(ValueError, match=rf"a\.exr: {complaint}"):
            read(path)


@pytest.mark.parametrize("several", [False, True])
def test_text_in_another_encoding(tmp_path, several):
    """OpenEXR's Python module takes UTF-8 alone; renderers write names of users and machines as the system has them."""
    several_texts = [200 * "-", "J@rgen"]  # of a length that is no UTF-8, either
    path, header = tmp_path / "frame.exr", {"owner": "J@rgen", "comments": "whole", "users": several_texts}
    if several:
        header |= {"name": "one", "type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
        other = header | {"name": "two", "owner": "anyone"}
        parts = [OpenEXR.Part(header, rgb(4, 5), "one"), OpenEXR.Part(other, {"Z": np.ones((4, 5), np.float32)}, "two")]
        OpenEXR.File(parts).write(str(path))
    else:
        store(path, header, rgb(4, 5))
    want = io.read_exr(path)
    path.write_bytes(path.read_bytes().replace(b"J@rgen", b"J\xfcrgen"))
    assert_same_bits(io.read_exr(path).color, want.color)
    plate = io.read_plate(path)
    io.write_exr(tmp_path / "again.exr", plate.frame, like=plate)
    with pytest.raises(TypeError, match=r"^like: expected what `read_plate` returns, got str"):
        io.write_exr(tmp_path / "again.exr", plate.frame, like="a.exr")
    again = OpenEXR.File(str(tmp_path / "again.exr")).parts[0].header
    assert (again["owner"], again["comments"]) == ("J?rgen", "whole")
    assert again["users"] == [200 * "-", "J?rgen"]


def test_no_such_file(tmp_path):
    for read in (io.read_exr, io.describe):
        with pytest.raises(FileNotFoundError, match=r"none\.exr"):
            read(tmp_path / "none.exr")
        with pytest.raises(IsADirectoryError, match=tmp_path.name):
            read(tmp_path)


def test_no_colour(tmp_path):
    path = tmp_path / "a.exr"
    store(path, {}, {name: np.zeros((2, 3), np.float32) for name in ("R", "G", "depth.Z")})
    with pytest.raises(ValueError, match=r"a\.exr: no colour: expected channels R, G and B, got G, R, depth\.Z"):
        io.read_exr(path)
    assert "nothing to denoise" in io.describe(path).missing["color"]


def test_wrong_type(tmp_path):
    path = tmp_path / "a.exr"
    store(path, {}, {name: np.zeros((2, 3), np.uint32) for name in "RGB"})
    with pytest.raises(ValueError, match=r"a\.exr: color: "):
        io.read_exr(path)


def test_without_openexr(tmp_path, monkeypatch):
    io.write_exr(tmp_path / "a.exr", np.zeros((2, 3, 3)))
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(ImportError, match=r"pip install 'yester\[exr\]'"):
        io.read_exr(tmp_path / "a.exr")
    with pytest.raises(ImportError, match=r"pip install 'yester\[exr\]'"):
        io.write_sequence(tmp_path, [])


# Unwritable files

COLOR = np.full((8, 9, 3), 0.25, np.float32)


def test_no_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none/a\.exr"):
        io.write_exr(tmp_path / "none" / "a.exr", COLOR)
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match=r"file/a\.exr"):
        io.write_exr(tmp_path / "file" / "a.exr", COLOR)


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_interrupted(tmp_path, monkeypatch, error):
    """The old file stays, and no other file is left."""
    io.write_exr(tmp_path / "a.exr", COLOR)

    def interrupt(*_):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", interrupt)
        with pytest.raises(error):
            io.write_exr(tmp_path / "a.exr", 2 * COLOR)
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]
    assert_same_bits(io.read_exr(tmp_path / "a.exr").color, COLOR)


def test_disk_full(tmp_path):
    noise = np.random.default_rng(0).random((100, 100, 3))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"a\.exr: cannot be written"):
            io.write_exr(tmp_path / "a.exr", noise)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


# Sequences


def test_sequence(tmp_path):
    """Streaming: a frame is on disk before the next one is asked for."""
    folder = tmp_path / "new" / "folder"

    def frames():
        for index in range(12):
            assert index == 0 or (folder / f"frame_{index - 1:04}.exr").exists()
            yield yester.Frame(COLOR + index)

    paths = io.write_sequence(folder, frames())
    assert [path.name for path in paths] == [f"frame_{i:04}.exr" for i in range(12)]
    for index, frame in enumerate(io.read_sequence(folder)):
        assert_same_bits(frame.color, COLOR + index)
    assert index == 11
    assert io.write_sequence(folder, [COLOR], names=["b.exr"]) == [folder / "b.exr"]


def test_natural_order(tmp_path):
    for name in ("frame10.exr", "frame2.exr", "frame1.EXR", "notes.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in io.sequence_paths(tmp_path)] == ["frame1.EXR", "frame2.exr", "frame10.exr"]
    assert [path.name for path in io.sequence_paths(f"{tmp_path}/*.exr")] == ["frame2.exr", "frame10.exr"]
    listed = [tmp_path / "frame10.exr", f"{tmp_path}/*1.EXR"]
    assert [path.name for path in io.sequence_paths(listed)] == ["frame10.exr", "frame1.EXR"]
    (tmp_path / "odd[1].exr").touch()
    assert io.sequence_paths(tmp_path / "odd[1].exr") == [tmp_path / "odd[1].exr"]


def test_no_sequence(tmp_path):
    for source in (tmp_path, f"{tmp_path}/*.exr", []):
        with pytest.raises(ValueError, match="EXR file"):
            io.read_sequence(source)
    with pytest.raises(FileNotFoundError, match=r"none\.exr"):
        io.read_sequence(tmp_path / "none.exr")


def test_size_changes(tmp_path):
    io.write_sequence(tmp_path, [COLOR, COLOR, COLOR[:5]])
    frames = io.read_sequence(tmp_path)
    next(frames), next(frames)
    with pytest.raises(ValueError, match=r"frame_0002\.exr: expected height and width \(8, 9\).*got \(5, 9\)"):
        next(frames)


def test_bad_sequence_output(tmp_path):
    """Refused before the first frame is made."""

    def never():
        pytest.fail("asked for a frame")
        yield

    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        io.write_sequence(tmp_path / "file", never())
    with pytest.raises(OSError, match="file"):
        io.write_sequence(tmp_path / "file" / "folder", never())
    with pytest.raises(ValueError, match=r"names: expected each only once, got \['a\.exr'\]"):
        io.write_sequence(tmp_path / "new", never(), names=["a.exr", "b.exr", "a.exr"])
    with pytest.raises(ValueError, match=r"names: expected each only once, got \['a\.exr'\]"):
        io.write_sequence(tmp_path / "new", never(), names=["a.exr", "./a.exr"])
    for name in ("../a.exr", "b/a.exr", ""):
        with pytest.raises(ValueError, match=f"names: expected names of files in the folder, got '{name}'"):
            io.write_sequence(tmp_path / "new", never(), names=[name])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    for count in (1, 3):
        with pytest.raises(ValueError, match="names: expected one per frame"):
            io.write_sequence(tmp_path, [COLOR] * count, names=["a.exr", "b.exr"])


# Descriptions


def test_describe(tmp_path):
    path = tmp_path / "a.exr"
    camera = cameras()[0]
    arrays = buffers(np.random.default_rng(0), 17, 31)
    io.write_exr(path, yester.Frame(**arrays, camera=camera))
    told = io.describe(path)
    assert (told.path, told.width, told.height) == (path, 31, 17)
    assert tuple(told.channels) == ("color", *BUFFERS)
    assert told.channels["motion"] == ("motion.X", "motion.Y", "motion.Z")
    assert (told.unrecognised, told.missing, told.notes) == ((), {}, {})
    io.write_exr(path, yester.Frame(arrays["color"], depth=arrays["depth"], camera=camera))
    missing = io.describe(path).missing
    assert set(missing) == {"albedo", "normal", "motion", "ids", "position", "emission"}
    assert missing["motion"] == "computed from the cameras, for static objects"
    io.write_exr(path, arrays["color"])
    missing = io.describe(path).missing
    assert missing["motion"].startswith("history is accumulated in place")
    assert set(missing) == {*COMMON, "camera"}
    io.write_exr(path, yester.Frame(arrays["color"], motion_next=arrays["motion"]))
    assert io.describe(path).missing["motion"].startswith("computed from motion_next of the frame before")


def test_an_interrupt_leaves_nothing_half_written(tmp_path, monkeypatch):
    """Nor an empty file: the signal comes as soon as a file exists."""
    touch = Path.touch

    def interrupted(path):
        touch(path)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "touch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        io.write_exr(tmp_path / "a.exr", np.zeros((2, 3, 3)))
    assert list(tmp_path.iterdir()) == []
