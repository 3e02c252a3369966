"""Files in the layouts of renderers: what is read is the canonical form of what was stored."""

import re
import warnings
from dataclasses import replace

import layouts
import numpy as np
import OpenEXR
import pytest
import yester
from compare import assert_same_bits
from yester import io
from yester.cli import main
from yester.io import channels, exr
from yester.io.mapping import parse

HALF_STEP = 2.0**-10


@pytest.fixture(scope="module")
def shot():
    return layouts.frame(3)


def hit(shot):
    return shot.ids > 0


def same_regions(ids, want):
    """The same pixels belong to the same thing, whatever its number; 0 where nothing was hit."""
    pairs = {*zip(ids.ravel().tolist(), want.ravel().tolist(), strict=True)}
    assert len(pairs) == len({one for one, _ in pairs}) == len({other for _, other in pairs})
    np.testing.assert_array_equal(ids == 0, want == 0)


# Blender Cycles


@pytest.mark.parametrize("new", [False, True])
@pytest.mark.parametrize("denoising", [False, True])
@pytest.mark.parametrize("layer", ["ViewLayer", "Shot 3.Main", "View Layer.001"])
def test_cycles(tmp_path, shot, new, denoising, layer):
    layouts.cycles(tmp_path / "a.exr", shot, new=new, denoising=denoising, layer=layer)
    got = io.read_exr(tmp_path / "a.exr")
    for name in ("color", "albedo", "depth", "motion", "motion_next", "position"):
        assert_same_bits(getattr(got, name), getattr(shot, name))
    np.testing.assert_allclose(got.normal, shot.normal, atol=1e-6)
    same_regions(got.ids, shot.ids)
    assert_same_bits(got.emission, np.where(hit(shot)[..., None], 0, shot.color))
    known = io.describe(tmp_path / "a.exr")
    assert known.renderer == "Blender Cycles"
    assert known.unrecognised == ()
    assert set(known.missing) == {"camera"}
    assert known.notes["depth"] == "1e9 and beyond: nothing was hit"
    assert "y down" in known.notes["motion"]
    assert ("replaces Combined" in known.notes.get("color", "")) == denoising


def test_cycles_in_parts(tmp_path, shot):
    """A part for each pass, of which those that are needed are decoded."""
    layouts.cycles(tmp_path / "one.exr", shot)
    layouts.cycles(tmp_path / "parts.exr", shot, parts=True)
    assert len(OpenEXR.File(str(tmp_path / "parts.exr"), header_only=True).parts) > 10
    want, got = (io.read_exr(tmp_path / name) for name in ("one.exr", "parts.exr"))
    assert got.buffers().keys() == want.buffers().keys()
    for name, value in got.buffers().items():
        assert_same_bits(value, want.buffers()[name])


def test_cycles_without_normals_has_those_of_the_denoiser(tmp_path, shot):
    """In camera space, which is said; without a camera in the header they stay there, with one they are turned."""
    layouts.cycles(tmp_path / "all.exr", shot)
    part = OpenEXR.File(str(tmp_path / "all.exr"), separate_channels=True).parts[0]
    kept = {name: channel.pixels for name, channel in part.channels.items() if ".Normal." not in name}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "Software": "Blender 4.2.1"}
    for camera in (False, True):
        if camera:
            io.write_exr(tmp_path / "camera.exr", yester.Frame(shot.color, camera=shot.camera))
            seen = OpenEXR.File(str(tmp_path / "camera.exr"), header_only=True).header()
            header |= {name: seen[name] for name in ("worldToCamera", "worldToNDC")}
        OpenEXR.File(dict(header), dict(kept)).write(str(tmp_path / "a.exr"))
        rotation = np.eye(3) if camera else shot.camera.world_to_camera[:3, :3]
        np.testing.assert_allclose(io.read_exr(tmp_path / "a.exr").normal, shot.normal @ rotation.T, atol=1e-5)
        note = io.describe(tmp_path / "a.exr").notes["normal"]
        assert ("turned to world space" if camera else "kept in camera space") in note


def test_a_denoised_render_is_not_what_is_denoised(tmp_path, shot):
    """Combined is what the renderer's denoiser made: the result takes its place, and Noisy Image stays."""
    layouts.cycles(tmp_path / "a.exr", shot)
    plate = io.read_plate(tmp_path / "a.exr")
    assert_same_bits(plate.frame.color, shot.color)
    io.write_exr(tmp_path / "b.exr", np.full_like(shot.color, 0.5), like=plate)
    before, after = (
        OpenEXR.File(str(tmp_path / name), separate_channels=True).channels() for name in ("a.exr", "b.exr")
    )
    assert before.keys() == after.keys()
    for name in before:
        if name.startswith("ViewLayer.Combined.") and name[-1] != "A":
            assert (after[name].pixels == 0.5).all()
        else:
            assert_same_bits(after[name].pixels, before[name].pixels)
    assert (io.read_exr(tmp_path / "b.exr").color == 0.5).all()
    assert io.describe(tmp_path / "b.exr").notes["color"] == "a result of Yester"
    # Denoised once more, it is the one that is replaced.
    io.write_exr(tmp_path / "c.exr", np.ones_like(shot.color), like=io.read_plate(tmp_path / "b.exr"))
    assert (io.read_exr(tmp_path / "c.exr").color == 1).all()


@pytest.mark.parametrize("guide", ["Depth", "Position"])
def test_an_index_is_0_unless_it_is_set(tmp_path, shot, guide):
    """Objects without one are not the background; where none is set, there are no ids."""
    kept = {"Depth.Z", "Position.X", "Position.Y", "Position.Z"}
    kept = {name for name in kept if name.startswith(guide)} | {f"Combined.{c}" for c in "RGB"} | {"IndexOB.X"}
    for index in (0 * shot.ids, np.where(shot.ids == layouts.flight.BALL, 7, 0)):
        layouts.cycles(tmp_path / "a.exr", replace(shot, ids=index), denoising=False, crypto=False)
        file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
        planes = {n: c.pixels for n, c in file.channels().items() if n.partition(".")[2] in kept}
        layouts.store(tmp_path / "b.exr", planes, {"Software": "Blender 4.2.0"})
        frame = io.read_exr(tmp_path / "b.exr")
        if guide == "Position":
            np.testing.assert_array_equal(np.isfinite(frame.position).all(-1), hit(shot))
        if not index.any():
            assert frame.ids is None
            continue
        same_regions(frame.ids, np.where(index == 7, 2, hit(shot)))


def test_of_two_view_layers_the_one_with_more_buffers(tmp_path, shot):
    layouts.cycles(tmp_path / "a.exr", shot, denoising=False, crypto=False)
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    planes = {name: channel.pixels for name, channel in channels.items()}
    dark = {name.replace("ViewLayer", "Another"): 0 * plane for name, plane in planes.items() if "Vector" not in name}
    composite = {f"Composite.Combined.{c}": 0 * planes["ViewLayer.Combined.R"] for c in "RGBA"}
    layouts.store(tmp_path / "b.exr", planes | dark | composite, {"BlenderMultiChannel": "Blender V2.55.1 and newer"})
    assert_same_bits(io.read_exr(tmp_path / "b.exr").color, shot.color)
    (remark,) = io.describe(tmp_path / "b.exr").remarks
    assert remark == "layers of ViewLayer are used, not Another"
    # A buffer of another view layer is not that of this one.
    del planes["ViewLayer.Normal.X"]
    layouts.store(tmp_path / "c.exr", planes | dark, {"BlenderMultiChannel": "Blender V2.55.1 and newer"})
    assert io.read_exr(tmp_path / "c.exr").normal is None


def test_half_floats(tmp_path, shot):
    layouts.cycles(tmp_path / "a.exr", shot, half=("Noisy Image", "Combined", "Depth", "Denoising Albedo"))
    frame = io.read_exr(tmp_path / "a.exr")
    np.testing.assert_allclose(frame.color, shot.color, rtol=HALF_STEP, atol=1e-6)
    np.testing.assert_allclose(frame.depth, shot.depth, rtol=HALF_STEP)
    same_regions(frame.ids, shot.ids)
    # An id in half floats is another one.
    layouts.cycles(tmp_path / "a.exr", shot, half=("CryptoObject00",))
    known = io.describe(tmp_path / "a.exr")
    assert known.channels["ids"] == ("ViewLayer.IndexOB.X",)
    assert "half floats" in known.unused["ViewLayer.CryptoObject00.r"]
    assert_same_bits(io.read_exr(tmp_path / "a.exr").ids, shot.ids)


# pbrt


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("space", ["camera", "world"])
@pytest.mark.parametrize("half", [False, True])
def test_pbrt(tmp_path, shot, old, space, half):
    """Positions tell the layout of the matrices and the space, which the header does not."""
    layouts.pbrt(tmp_path / "a.exr", shot, old=old, space=space, half=half)
    frame, seen = io.read_exr(tmp_path / "a.exr"), hit(shot)
    step = HALF_STEP if half else 1e-5
    np.testing.assert_allclose(frame.depth, shot.depth, rtol=3 * step)
    np.testing.assert_allclose(frame.normal, shot.normal, atol=2 * step)
    distance = np.linalg.norm(shot.position[seen], axis=-1)
    assert (np.linalg.norm(frame.position[seen] - shot.position[seen], axis=-1) < step * (5 + distance)).all()
    assert np.isnan(frame.position[~seen]).all()
    assert np.isinf(frame.depth[~seen]).all()
    points = frame.camera.project(shot.position[seen])[0]
    np.testing.assert_allclose(points, np.argwhere(seen)[:, ::-1] + 0.5, atol=1e-2)
    known = io.describe(tmp_path / "a.exr")
    assert known.renderer == "pbrt-v4"
    assert known.unrecognised == ()
    assert any("half floats" in remark for remark in known.remarks) == half
    assert known.missing["motion"] == "computed from the cameras, for static objects"


@pytest.mark.parametrize("size", [(96, 64), (48, 80), (64, 64)])
def test_the_screen_of_pbrt(tmp_path, size):
    """Its NDC span the shorter side, with y up: told by positions, and without these, by the renderer."""
    shot = layouts.frame(3, *size)
    layouts.pbrt(tmp_path / "a.exr", shot, half=False)
    same_view(io.read_exr(tmp_path / "a.exr").camera, shot.camera)
    same_view(io.describe(tmp_path / "a.exr").camera, shot.camera)


def test_a_camera_that_sees_something_else_is_not_used(tmp_path, shot):
    """As with a screen window, which the header does not tell. Positions stay where they are, and are no depth."""
    turned = yester.Camera.from_look_at([3, 9, 2], [5, 5, 5], [0, 1, 0], 20, shot.width, shot.height)
    layouts.pbrt(tmp_path / "a.exr", replace(shot, camera=turned), half=False, space="world")
    with (
        pytest.warns(UserWarning, match="worldToNDC: not used, as it puts positions elsewhere"),
        pytest.warns(UserWarning, match="depth: not used, as it is from positions, some of which lie behind"),
    ):
        frame = io.read_exr(tmp_path / "a.exr")
    assert frame.camera is None
    assert frame.depth is None
    seen = hit(shot)
    np.testing.assert_allclose(frame.position[seen], shot.position[seen])


@pytest.mark.parametrize("space", ["camera", "world"])
@pytest.mark.parametrize("ndc", [None, "screenwindow"])
@pytest.mark.parametrize("away", [0, 100])
def test_depth_of_pbrt_without_a_camera(tmp_path, shot, space, ndc, away):
    """worldToCamera tells the space of positions, also where all have a positive z in world space."""
    shift = np.eye(4)
    shift[2, 3] = away
    moved = shot.camera.world_to_clip @ np.linalg.inv(shift)
    there = replace(
        shot, position=shot.position + np.float32([0, 0, away]), camera=yester.Camera(moved, *shot.shape[::-1])
    )
    layouts.pbrt(tmp_path / "a.exr", there, half=False, space=space)
    file = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True)
    planes = {name: channel.pixels for name, channel in file.channels().items()}
    header = {"worldToCamera": file.header()["worldToCamera"], "renderTimeSeconds": 1.0}
    if ndc:
        header["worldToNDC"] = np.diag(np.float32([3, 1, 1, 1])) @ file.header()["worldToNDC"]
    layouts.store(tmp_path / "b.exr", planes, header)
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        frame = io.read_exr(tmp_path / "b.exr")
    assert frame.camera is None
    np.testing.assert_allclose(frame.depth, shot.depth, rtol=1e-4)


def test_positions_choose_the_camera_of_every_renderer(tmp_path):
    """Off centre, a header from -1 to 1 looks like one from 0 to 1. A camera that sees something else is refused."""
    camera = yester.Camera.from_look_at([3, 2, 5], [0, 0, 0], [0, 1, 0], 40, 96, 64, principal_point=(72, 16))
    y, x = np.mgrid[:64, :96] + 0.5
    position = camera.unproject(np.stack([x, y], -1), 1 + x)
    named = layouts.layers({"RGB": np.ones((64, 96, 3)), "P.XYZ": position})
    for arnold in ({}, {"arnold/version": "7.4"}):
        channels = named if arnold else {name.replace("P.", "position."): plane for name, plane in named.items()}
        header = arnold | {"worldToNDC": np.ascontiguousarray(camera.world_to_clip.T, np.float32)}
        layouts.store(tmp_path / "a.exr", channels, header)
        same_view(io.read_exr(tmp_path / "a.exr").camera, camera)
        header["worldToNDC"] = header["worldToNDC"] @ np.diag(np.float32([3, 1, 1, 1]))
        layouts.store(tmp_path / "a.exr", channels, header)
        with pytest.warns(UserWarning, match="worldToNDC: not used, as it puts positions elsewhere"):
            assert io.read_exr(tmp_path / "a.exr").camera is None


def test_pbrt_without_a_camera(tmp_path, shot):
    layouts.pbrt(tmp_path / "a.exr", shot, half=False)
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    planes = {name: channel.pixels for name, channel in channels.items()}
    layouts.store(tmp_path / "b.exr", planes, {"renderTimeSeconds": 1.0})
    frame = io.read_exr(tmp_path / "b.exr")
    assert frame.camera is None
    np.testing.assert_allclose(frame.depth, shot.depth, rtol=1e-5)  # z of camera space needs no camera
    assert "for want of a camera" in io.describe(tmp_path / "b.exr").notes["position"]


def test_motion_from_pbrt(tmp_path):
    """Two files, nothing from the user: what does not move goes where it went. Half floats cost a little."""
    for half, tolerance in ((False, 1e-3), (True, 0.05)):
        views = []
        for index in (2, 3):
            layouts.pbrt(tmp_path / f"{index}.exr", layouts.frame(index), half=half)
            views.append(io.read_exr(tmp_path / f"{index}.exr"))
        motion = yester.motion_vectors(views[1].position, views[1].camera, views[0].camera)[..., :2]
        shot = layouts.frame(3)
        still = hit(shot) & (shot.ids != layouts.flight.MOVER)
        assert np.abs(shot.motion[still]).max() > 1
        np.testing.assert_allclose(motion[still], shot.motion[still], atol=tolerance)


# Others


def test_arnold(tmp_path, shot):
    layouts.arnold(tmp_path / "a.exr", shot)
    frame = io.read_exr(tmp_path / "a.exr")
    for name in ("color", "albedo", "depth", "position"):
        assert_same_bits(getattr(frame, name), getattr(shot, name))
    same_regions(frame.ids, shot.ids)
    assert frame.motion is None
    known = io.describe(tmp_path / "a.exr")
    assert known.renderer == "Arnold"
    assert "map it" in known.unused["motionvector.R"]
    assert all("inferred" in known.notes[name] for name in ("normal", "depth", "position"))
    mapped = io.read_exr(tmp_path / "a.exr", mapping={"motion": ["motionvector.R", "motionvector.G"]})
    assert_same_bits(mapped.motion, shot.motion)


def test_renderman(tmp_path, shot):
    layouts.renderman(tmp_path / "a.exr", shot)
    frame = io.read_exr(tmp_path / "a.exr")
    for name in ("color", "albedo", "depth"):
        assert_same_bits(getattr(frame, name), getattr(shot, name))
    np.testing.assert_allclose(frame.normal, shot.normal, atol=1e-6)
    assert frame.motion is None
    known = io.describe(tmp_path / "a.exr")
    assert known.renderer == "RenderMan"
    assert all("unit was not found" in known.unused[f"{name}.r"] for name in ("forward", "backward"))
    assert all("variance" in known.unused[name] for name in ("mse.r", "normal_var.r"))
    mapping = {"motion": ["backward.r", "backward.g"], "motion_next": ["-forward.r", "-forward.g"]}
    mapped = io.read_exr(tmp_path / "a.exr", mapping=mapping)
    assert_same_bits(mapped.motion, shot.motion)
    assert_same_bits(mapped.motion_next, shot.motion_next)
    plate = io.read_plate(tmp_path / "a.exr")
    io.write_exr(tmp_path / "b.exr", 2 * shot.color, like=plate)
    assert_same_bits(io.read_exr(tmp_path / "b.exr").color, 2 * shot.color)
    assert "R" not in OpenEXR.File(str(tmp_path / "b.exr"), header_only=True).header()["channels"]


def test_falcor(tmp_path, shot):
    layouts.falcor(tmp_path / "a.exr", shot)
    frame = io.read_exr(tmp_path / "a.exr")
    np.testing.assert_allclose(frame.motion, shot.motion, rtol=1e-6)
    assert_same_bits(frame.normal, shot.normal)
    assert_same_bits(frame.position, shot.position)
    assert io.describe(tmp_path / "a.exr").renderer == "Falcor"


def same_view(found, want):
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3)) * [1, 1, 0.5]
    np.testing.assert_allclose(found.project(points)[0], want.project(points)[0], rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("name", layouts.RENDERERS)
def test_a_window_that_is_not_the_display(tmp_path, shot, name):
    """A crop, and more than what is displayed: the image is the data window, units of motion those of the display."""
    for display, corner in (((200, 100), (40, 20)), ((80, 50), (-8, -7))):
        window = {"window": (display, corner)}
        if name == "falcor":
            shot = layouts.frame(3)
        layouts.RENDERERS[name](tmp_path / "a.exr", shot, **window)
        frame = io.read_exr(tmp_path / "a.exr")
        assert frame.shape == shot.shape
        if name == "falcor":
            np.testing.assert_allclose(frame.motion, shot.motion / shot.shape[::-1] * display, rtol=1e-6)
        if name == "pbrt":
            same_view(frame.camera, shot.camera)


def test_every_renderer_is_told_by_its_layers(tmp_path, shot):
    """Without a header, too."""
    for name, make in layouts.RENDERERS.items():
        make(tmp_path / "a.exr", shot)
        names = [c.name for c in OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).header()["channels"]]
        told = channels.recognise(names)
        assert told.renderer == io.describe(tmp_path / "a.exr").renderer, name
        assert told.evidence.startswith("channels ")


def test_layers_of_a_user_do_not_displace_those_of_the_renderer(tmp_path, shot):
    """In Blender they have the view layer's name in front. Layers without it have been added for us."""
    layouts.cycles(tmp_path / "a.exr", shot)
    planes = {n: c.pixels for n, c in OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels().items()}
    other = np.full(shot.shape, 7, np.float32)
    own = {f"ViewLayer.{name}.{c}": other for name in ("albedo", "emission") for c in "RGB"}
    header = {"BlenderMultiChannel": "Blender V2.55.1 and newer"}
    layouts.store(tmp_path / "b.exr", planes | own, header)
    usual = io.describe(tmp_path / "a.exr").channels
    assert io.describe(tmp_path / "b.exr").channels == usual
    layouts.store(tmp_path / "c.exr", planes | {f"albedo.{c}": other for c in "RGB"}, header)
    assert io.describe(tmp_path / "c.exr").channels == usual | {"albedo": ("albedo.R", "albedo.G", "albedo.B")}
    no_emission = {name: plane for name, plane in planes.items() if ".Emi" not in name and ".Env" not in name}
    layouts.store(tmp_path / "d.exr", no_emission | own, header)
    assert "emission" not in io.describe(tmp_path / "d.exr").channels


def test_what_has_a_prefix_of_its_own_is_something_else():
    """The emission of one lamp, the depth of shadows; but a group of guides may have a name."""
    lone = channels.recognise([*"RGB", "key.emission.R", "key.emission.G", "key.emission.B", "shadow.depth.Z"])
    assert lone.buffers.keys() == {"color"}
    group = channels.recognise([*"RGB", *(f"guides.normal.{c}" for c in "XYZ"), "guides.depth.Z", "shadow.depth.Z"])
    assert group.buffers["normal"].channels == ("guides.normal.X", "guides.normal.Y", "guides.normal.Z")
    assert group.buffers["depth"].channels == ("guides.depth.Z",)


@pytest.mark.parametrize("component", "ZV")
def test_denoising_depth_of_blender(tmp_path, shot, component):
    """The distance along the ray, with 0 where nothing was hit."""
    layouts.cycles(tmp_path / "a.exr", shot)
    planes = {n: c.pixels for n, c in OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels().items()}
    del planes["ViewLayer.Depth.Z"], planes["ViewLayer.Position.X"]
    distance = np.linalg.norm(shot.position - shot.camera.position, axis=-1)
    del planes["ViewLayer.Denoising Depth.Z"]
    planes[f"ViewLayer.Mist.{component}"] = shot.depth
    planes[f"ViewLayer.Denoising Depth.{component}"] = np.where(hit(shot), distance, 0).astype(np.float32)
    header = {"BlenderMultiChannel": "Blender V2.55.1 and newer"}
    layouts.store(tmp_path / "b.exr", planes, header)
    depth = io.read_exr(tmp_path / "b.exr").depth  # a distance, as there is no camera
    np.testing.assert_array_equal(np.isinf(depth), ~hit(shot))
    np.testing.assert_allclose(depth[hit(shot)], distance[hit(shot)], rtol=1e-6)
    known = io.describe(tmp_path / "b.exr")
    assert "the sum of its parts" in known.notes["depth"]
    assert f"ViewLayer.Mist.{component}" in known.unused


def test_parts_with_another_window_are_told(tmp_path):
    color = OpenEXR.Part({}, {c: np.ones((8, 12), np.float32) for c in "RGB"}, "rgba")
    small = {"dataWindow": (np.array([0, 0], np.int32), np.array([11, 5], np.int32))}
    depth = OpenEXR.Part(
        small | {"displayWindow": (np.zeros(2, np.int32), np.array([11, 7], np.int32))},
        {"Z": np.ones((6, 12), np.float32)},
        "depth",
    )
    OpenEXR.File([color, depth]).write(str(tmp_path / "a.exr"))
    known = io.describe(tmp_path / "a.exr")
    assert "depth" in known.missing
    assert known.unused == {"depth.Z": "a part with another data window than the colour: not read"}


def test_layers_of_two_renderers(tmp_path, shot):
    layouts.cycles(tmp_path / "a.exr", shot)
    planes = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    more = {name: planes["ViewLayer.Depth.Z"].pixels for name in ("mvec.X", "mvec.Y")}
    header = {"BlenderMultiChannel": "Blender V2.55.1 and newer"}
    layouts.store(tmp_path / "b.exr", {name: channel.pixels for name, channel in planes.items()} | more, header)
    known = io.describe(tmp_path / "b.exr")
    assert known.renderer == "Blender Cycles"
    assert known.remarks == ("layers of Falcor are there as well, and not used",)
    assert_same_bits(io.read_exr(tmp_path / "b.exr").motion, shot.motion)


# Views


def stereo(path, *, parts=False, listed=False):
    left, right = (np.full((4, 6), value, np.float32) for value in (1, 2))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if parts:
        header |= {"multiView": ["left", "right"]} if listed else {}
        found = []
        for view, plane in (("right", right), ("left", left)):
            named = {**dict.fromkeys("RGB", plane), **dict.fromkeys(("Z",), 10 * plane)}
            found.append(
                OpenEXR.Part({**header, "view": view}, {n: p.copy() for n, p in named.items()}, f"rgba.{view}")
            )
        OpenEXR.File(found).write(str(path))
        return
    planes = dict.fromkeys("RGB", left) | dict.fromkeys([f"right.{c}" for c in "RGB"], right)
    planes |= dict.fromkeys([f"normal.right.{c}" for c in "XYZ"], right)
    planes |= dict.fromkeys([f"normal.left.{c}" for c in "XYZ"], left) | {"depth.Z": left}
    OpenEXR.File(header | {"multiView": ["left", "right"]}, {n: p.copy() for n, p in planes.items()}).write(str(path))


def test_views(tmp_path):
    """The left one unless told otherwise; layers of no view belong to both."""
    path = tmp_path / "a.exr"
    stereo(path)
    for view, value in ((None, 1), ("left", 1), ("right", 2)):
        frame = io.read_exr(path, view=view)
        assert (frame.color == value).all()
        assert (frame.normal == value).all()
        assert (frame.depth == 1).all()
        known = io.describe(path, view=view)
        assert known.views == ("left", "right")
        assert known.view == (view or "left")
    io.write_exr(tmp_path / "b.exr", np.full((4, 6, 3), 7.0), like=io.read_plate(path, view="right"))
    assert (io.read_exr(tmp_path / "b.exr").color == 1).all()
    assert (io.read_exr(tmp_path / "b.exr", view="right").color == 7).all()

    with pytest.raises(ValueError, match=r"a\.exr: view: expected left or right, got 'middle'"):
        io.read_exr(path, view="middle")
    io.write_exr(path, np.ones((4, 6, 3)))
    with pytest.raises(ValueError, match="the file has no views"):
        io.read_exr(path, view="left")


@pytest.mark.parametrize("view", ["left", "right"])
def test_layers_of_the_view_count_before_those_of_none(tmp_path, view):
    right, left = (np.full((4, 6), value, np.float32) for value in (1, 2))
    planes = dict.fromkeys("RGB", right) | dict.fromkeys([f"left.{c}" for c in "RGB"], left)
    planes |= {"depth.Z": right, "depth.left.Z": left}
    header = {"multiView": ["right", "left"]}
    OpenEXR.File(header, {n: p.copy() for n, p in planes.items()}).write(str(tmp_path / "a.exr"))
    frame = io.read_exr(tmp_path / "a.exr", view=view)
    assert (frame.color[..., 0] == frame.depth).all()
    assert (frame.depth == {"right": 1, "left": 2}[view]).all()


@pytest.mark.parametrize("listed", [False, True])
def test_views_in_parts(tmp_path, listed):
    """Each part is of its view, also where all of them list both views."""
    path = tmp_path / "a.exr"
    stereo(path, parts=True, listed=listed)
    for view, value in ((None, 1), ("right", 2)):
        assert (io.read_exr(path, view=view).color == value).all()
    io.write_exr(tmp_path / "b.exr", np.full((4, 6, 3), 7.0), like=io.read_plate(path, view="right"))
    assert (io.read_exr(tmp_path / "b.exr").color == 1).all()
    assert (io.read_exr(tmp_path / "b.exr", view="right").color == 7).all()


def test_parts_named_like_layers(tmp_path):
    """Components without a layer have that of their part; colour is where no part says it is something else."""
    rng = np.random.default_rng(0)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    named = {"albedo": "RGB", "normal": "XYZ", "beauty": "RGBA", "depth": "Z"}
    planes = {name: {c: rng.random((5, 7)).astype(np.float32) for c in own} for name, own in named.items()}
    OpenEXR.File([OpenEXR.Part(dict(header), dict(p), n) for n, p in planes.items()]).write(str(tmp_path / "a.exr"))
    frame = io.read_exr(tmp_path / "a.exr")
    for name, own in (("albedo", "RGB"), ("normal", "XYZ")):
        assert_same_bits(getattr(frame, name), np.stack([planes[name][c] for c in own], -1))
    assert_same_bits(frame.color, np.stack([planes["beauty"][c] for c in "RGB"], -1))
    assert_same_bits(frame.depth, planes["depth"]["Z"])


def parts(path, **values):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: {c: np.full((5, 7), value, np.float32) for c in "RGB"} for name, value in values.items()}
    OpenEXR.File([OpenEXR.Part(dict(header), own, name) for name, own in planes.items()]).write(str(path))


@pytest.mark.parametrize("name", ["rgba", "RGBA", "rgb", "color", "beauty", "shot.Beauty"])
def test_a_part_named_like_colour(tmp_path, name):
    """It is read and replaced, wherever it is among parts with the same components."""
    parts(tmp_path / "a.exr", AO=1, **{name: 2}, diffuse=3)
    assert (io.read_exr(tmp_path / "a.exr").color == 2).all()
    assert io.describe(tmp_path / "a.exr").remarks == ()
    io.write_exr(tmp_path / "b.exr", np.full((5, 7, 3), 4.0), like=io.read_plate(tmp_path / "a.exr"))
    written = OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True).parts
    values = {part.name(): part.channels["R"].pixels[0, 0] for part in written}
    assert values == {"AO": 1, name: 4, "diffuse": 3}


def test_no_part_named_like_colour(tmp_path, capsys):
    """The first one with red, green and blue, and a remark that it is a choice; none if a mapping chooses."""
    parts(tmp_path / "a.exr", albedo=1, AO=2, diffuse=3)
    frame = io.read_exr(tmp_path / "a.exr")
    assert (frame.color == 2).all()
    assert (frame.albedo == 1).all()
    remark = "part AO is used as colour, not diffuse; --map color= chooses"
    assert io.describe(tmp_path / "a.exr").remarks == (remark,)
    assert main(["info", str(tmp_path / "a.exr")]) == 0
    assert remark in capsys.readouterr().out
    mapping = {"color": ["diffuse.R", "diffuse.G", "diffuse.B"]}
    assert (io.read_exr(tmp_path / "a.exr", mapping=mapping).color == 3).all()
    assert io.describe(tmp_path / "a.exr", mapping=mapping).remarks == ()


# Mappings


def test_mapping(tmp_path, shot):
    """Any names, signs, units, spaces and kinds; from a dictionary and from a file."""
    path, height, width = tmp_path / "a.exr", *shot.shape
    matrix = np.asarray(shot.camera.world_to_camera)
    direction = shot.camera.rays()[1]
    distance = shot.depth / (direction @ shot.camera.forward) - 0.25
    named = {
        "RGB": shot.color,
        "Basis.RGB": shot.normal @ (matrix[:3, :3] * [[1], [1], [-1]]).T,  # z backward
        "flow.UV": shot.motion * (-2, 2) / (width, height),
        "far.A": np.where(np.isfinite(distance), distance, 0),
    }
    io.write_exr(tmp_path / "camera.exr", yester.Frame(shot.color, camera=shot.camera))
    seen = OpenEXR.File(str(tmp_path / "camera.exr"), header_only=True).header()
    layouts.store(path, layouts.layers(named), {name: seen[name] for name in ("worldToCamera", "worldToNDC")})
    assert io.read_exr(path).buffers().keys() == {"color"}
    mapping = {
        "normal": {"channels": ["Basis.R", "Basis.G", "-Basis.B"], "space": "camera"},
        "motion": {"channels": ["-flow.U", "flow.V"], "unit": "ndc"},
        "depth": {"channels": ["far.A"], "kind": "distance", "near": 0.25, "miss": "zero"},
    }
    toml = tmp_path / "mapping.toml"
    toml.write_text(
        """
        [normal]
        channels = ["Basis.R", "Basis.G", "-Basis.B"]
        space = "camera"
        [motion]
        channels = ["flow.U", "flow.V"]
        scale = [-1, 1]
        unit = "ndc"
        [depth]
        channels = "far.A"
        kind = "distance"
        near = 0.25
        miss = "zero"
        """
    )
    for given in (mapping, toml, str(toml)):
        frame = io.read_exr(path, mapping=given)
        np.testing.assert_allclose(frame.normal, shot.normal, atol=1e-5)
        np.testing.assert_allclose(frame.motion, shot.motion, rtol=1e-5)
    # The distance along the ray counts from the near plane, which is 0.25 along the axis.
    ray = np.where(np.isfinite(distance), distance, np.inf) * (direction @ shot.camera.forward) + 0.25
    np.testing.assert_allclose(frame.depth, ray, rtol=1e-5)
    assert io.describe(path, mapping=toml).notes["motion"].startswith("as mapped")


def test_mapping_of_depth_from_the_near_plane(tmp_path, shot):
    """Along the axis, too, which needs no camera."""
    layouts.store(tmp_path / "a.exr", layouts.layers({"RGB": shot.color, "far.A": shot.depth - np.float32(0.25)}), {})
    mapping = {"depth": {"channels": ["far.A"], "near": 0.25}}
    np.testing.assert_allclose(io.read_exr(tmp_path / "a.exr", mapping=mapping).depth, shot.depth, rtol=1e-6)
    notes = io.describe(tmp_path / "a.exr", mapping=mapping).notes
    assert notes["depth"] == "as mapped; from the near plane: 0.25 added"


def test_mapping_of_what_is_recognised(tmp_path, shot):
    layouts.cycles(tmp_path / "a.exr", shot)
    mapping = {"motion": {"scale": [2, 2]}, "albedo": [], "depth": {"miss": "inf"}}
    frame = io.read_exr(tmp_path / "a.exr", mapping=mapping)
    assert_same_bits(frame.motion, 2 * shot.motion * np.float32([1, -1]))
    assert frame.albedo is None
    assert (frame.depth[~hit(shot)] == np.float32(1e10)).all()


@pytest.mark.parametrize(
    ("mapping", "complaint"),
    [
        ({"normals": ["a"]}, r"got 'normals' \(perhaps normal\)"),
        ({"normal": ["R", "G", "X"]}, "normal: no channel 'X'"),
        ({"normal": ["R", "G"]}, "normal: expected 3 channels, got 2"),
        ({"motion": ["R"]}, "motion: expected 2 or 3 channels, got 1"),
        ({"motion": {"channels": ["R", "G"], "unit": "px"}}, "motion.unit: expected pixels or uv or ndc, got 'px'"),
        ({"motion": {"units": "uv"}}, r"got 'units' \(perhaps unit\)"),
        ({"motion": {"unit": "uv"}}, "motion: expected channels"),
        (
            {"motion": {"channels": ["R", "G"], "scale": 0}},
            "scale: expected a number other than 0, or 3 of them, got 0",
        ),
        ({"motion": {"channels": ["R", "G"], "scale": [1, 2, 3, 4]}}, "scale: expected a number other than 0, or 3 of"),
        ({"depth": {"channels": ["R"], "near": "here"}}, "near: expected a number"),
        ({"depth": {"channels": ["R"], "near": True}}, "near: expected a number"),
        ({"depth": {"channels": ["R"], "near": 10**400}}, "near: expected a number"),
        ({"motion": {"channels": ["R", "G"], "scale": 10**400}}, "scale: expected a number"),
        ({"depth": {"unit": "ndc"}}, "depth: expected some of channels, kind, miss, near, scale, got 'unit'"),
        ({"motion": {"kind": "distance"}}, "motion: expected some of channels, scale, unit, got 'kind'"),
        ({"color": {"near": 3}}, "color: expected some of channels, scale, got 'near'"),
        ({"object_normal": {"space": "camera"}}, "object_normal: expected some of channels, scale, got 'space'"),
        ({"depth": {"channels": [3]}}, "depth: expected names of channels"),
        ({"color": []}, "no colour"),
    ],
)
def test_bad_mappings(tmp_path, mapping, complaint):
    io.write_exr(tmp_path / "a.exr", np.ones((2, 3, 3)))
    with pytest.raises(ValueError, match=complaint):
        io.read_exr(tmp_path / "a.exr", mapping=mapping)


def test_bad_mapping_files(tmp_path):
    io.write_exr(tmp_path / "a.exr", np.ones((2, 3, 3)))
    (tmp_path / "m.toml").write_text("normal = [")
    with pytest.raises(ValueError, match=r"m\.toml: not a TOML file"):
        io.read_exr(tmp_path / "a.exr", mapping=tmp_path / "m.toml")
    (tmp_path / "m.toml").write_text("normals = []")
    with pytest.raises(ValueError, match=r"m\.toml: expected buffers"):
        io.read_exr(tmp_path / "a.exr", mapping=tmp_path / "m.toml")
    with pytest.raises(FileNotFoundError, match=r"none\.toml"):
        io.read_exr(tmp_path / "a.exr", mapping=tmp_path / "none.toml")


def test_guesses():
    """What an unknown layer may be, with a mapping that can be pasted."""
    names = (
        [f"Normals.{c}" for c in "XYZ"] + [f"beauty.Albedo1.{c}" for c in "RGB"] + ["Depth0.Z", "whatever.R", "mv.X"]
    )
    names += [f"VRayVelocity.{c}" for c in "RGB"]
    found = {
        "Normals": ("normal=Normals.X,Normals.Y,Normals.Z",),
        "beauty.Albedo1": ("albedo=beauty.Albedo1.R,beauty.Albedo1.G,beauty.Albedo1.B",),
        "Depth0": ("depth=Depth0.Z", "depth.miss=far"),
        "VRayVelocity": ("motion_next=VRayVelocity.R,VRayVelocity.G",),
    }
    assert channels.guesses(names, color=False) == found
    others = [f"BG.{name}" for name in ("Vector.X", "Vector.Y", "Depth.Z", "CryptoObject00.R")]
    assert channels.guesses([*names, *others], color=False, renderer="Blender Cycles") == found
    colour = [f"Combned.{c}" for c in "RGBA"]
    assert channels.guesses([*names, *colour], color=False) == found
    assert channels.guesses([*names, *colour], color=True) == {
        **found,
        "Combned": ("color=Combned.R,Combned.G,Combned.B",),
    }


def test_the_guess_of_a_depth_has_its_misses(tmp_path, shot, capsys):
    """As Blender's files of one layer have them; what `yester info` prints can be pasted."""
    z = np.where(hit(shot), shot.depth, 1e10)
    layouts.store(tmp_path / "a.exr", layouts.layers({"RGB": shot.color}) | {"Z": z}, {"Software": "Blender 4.2.0"})
    assert main(["info", str(tmp_path / "a.exr")]) == 0
    assert "Z may be depth: --map 'depth=Z' --map 'depth.miss=far'" in capsys.readouterr().out
    guess = io.describe(tmp_path / "a.exr").guesses["Z"]
    assert_same_bits(io.read_exr(tmp_path / "a.exr", mapping=parse(guess)).depth, shot.depth)


def test_what_may_be_colour_is_told(tmp_path, capsys):
    """By every command, and `--map` with it is understood."""
    pixels = {f"Combned.{c}": np.ones((4, 5), np.float32) for c in "RGB"}
    layouts.store(tmp_path / "a.exr", pixels, {})
    want = "Combned may be it: --map 'color=Combned.R,Combned.G,Combned.B'"
    with pytest.raises(ValueError, match=re.escape(f"got Combned.B, Combned.G, Combned.R; {want}")):
        io.read_exr(tmp_path / "a.exr")
    assert main(["denoise", str(tmp_path / "a.exr"), "-o", str(tmp_path / "out")]) == 2
    assert want in capsys.readouterr().err
    assert main(["info", str(tmp_path / "a.exr")]) == 0
    assert "Combned may be color: --map 'color=Combned.R" in capsys.readouterr().out
    mapping = "color=Combned.R,Combned.G,Combned.B"
    assert main(["denoise", str(tmp_path / "a.exr"), "-o", str(tmp_path / "out"), "--map", mapping]) == 0


# Compression and pixel types


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "HTJ2K32"])
def test_lossless_compressions_are_kept(tmp_path, shot, name):
    compression = getattr(OpenEXR, f"{name}_COMPRESSION")
    layouts.cycles(tmp_path / "a.exr", shot)
    planes = {n: c.pixels for n, c in OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels().items()}
    layouts.store(tmp_path / "b.exr", planes, {"compression": compression, "Software": "Blender 5.0.0"})
    stored = OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True)
    plate = io.read_plate(tmp_path / "b.exr")
    io.write_exr(tmp_path / "c.exr", plate.frame.color * 2, like=plate)
    got = OpenEXR.File(str(tmp_path / "c.exr"), separate_channels=True)
    assert got.header()["compression"] == compression
    for channel, value in got.channels().items():
        if ".Combined." not in channel or channel.endswith("A"):
            assert_same_bits(value.pixels, stored.channels()[channel].pixels)


def test_compression_as_told(tmp_path, shot):
    for name in exr.COMPRESSIONS:
        io.write_exr(tmp_path / "a.exr", shot.color, half=True, compression=name)
        header = OpenEXR.File(str(tmp_path / "a.exr"), header_only=True).header()
        assert header["compression"] == getattr(OpenEXR, f"{'NO' if name == 'none' else name.upper()}_COMPRESSION")
    with pytest.raises(ValueError, match="compression: expected one of none, rle"):
        io.write_exr(tmp_path / "a.exr", shot.color, compression="jpeg")


def test_pixel_types_are_kept(tmp_path, shot):
    layouts.cycles(tmp_path / "a.exr", shot, half=("Combined", "Noisy Image"))
    plate = io.read_plate(tmp_path / "a.exr")
    for half, kind in ((None, np.float16), (True, np.float16), (False, np.float32)):
        io.write_exr(tmp_path / "b.exr", plate.frame.color, half=half, like=plate)
        written = OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True).channels()
        assert written["ViewLayer.Combined.R"].pixels.dtype == kind
        assert written["ViewLayer.Combined.A"].pixels.dtype == np.float16
        assert written["ViewLayer.Depth.Z"].pixels.dtype == np.float32
