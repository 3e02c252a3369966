"""The contents of a file besides a frame, and how the command line treats files: run in this process."""

from fractions import Fraction

import numpy as np
import OpenEXR
import pytest
import yester
from compare import assert_same_bits
from test_cli import noise
from yester import io
from yester.cli import main

DATA = (np.array([-3, 5], np.int32), np.array([12, 16], np.int32))
DISPLAY = (np.array([0, 0], np.int32), np.array([31, 23], np.int32))
HEIGHT, WIDTH = 12, 16
#: One of each type of attribute that OpenEXR's Python module writes.
ATTRIBUTES = {
    "pixelAspectRatio": 1.5,
    "comments": "a comment",
    "owner": "somebody",
    "framesPerSecond": Fraction(24000, 1001),
    "count": 7,
    "gamma": np.array([2.2]),
    "chromaticities": (0.75, 0.25, 0.25, 0.75, 0.125, 0.0625, 0.3125, 0.328125),
    "multiView": ["left", "right"],
    "weights": [0.5, 0.25],
    "v2i": np.array([1, 2], np.int32),
    "v3f": np.array([1, 2, 3], np.float32),
    "m33f": np.arange(9, dtype=np.float32).reshape(3, 3),
    "box": (np.array([1, 2], np.float32), np.array([3, 4], np.float32)),
    "timeCode": OpenEXR.TimeCode(1, 2, 3, 4, False, False, False, False, False, False, 0, 0, 0, 0, 0, 0, 0, 0),
    "screenWindowCenter": np.array([0.25, 0.5], np.float32),
}
STORAGE = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}


def planes(names, kind, seed=0):
    rng = np.random.default_rng(seed)
    return {name: (rng.random((HEIGHT, WIDTH)) * 9).astype(kind) for name in names}


def layers(seed=0):
    return (
        planes("RGB", np.float32, seed)
        | planes(["A", "diffuse.R", "diffuse.G", "diffuse.B"], np.float16)
        | planes(["cryptomatte00.R"], np.float32)
        | planes(["matte.I"], np.uint32)
        | planes(["depth.Z"], np.float32)
    )


def plate(path, *, parts=False, seed=0, **header):
    """A plate as from a compositor: a crop with other layers and attributes."""
    header = STORAGE | {"dataWindow": DATA, "displayWindow": DISPLAY} | ATTRIBUTES | header
    found = [OpenEXR.Part(header, layers(seed), "beauty" if parts else "")]
    if parts:
        shared = {name: header[name] for name in ("displayWindow", "pixelAspectRatio", "timeCode", "chromaticities")}
        small = STORAGE | shared | {"dataWindow": (DATA[0], DATA[0] + np.int32(2))}
        found.insert(0, OpenEXR.Part(small, {"Z": np.ones((3, 3), np.float16)}, "small"))
    OpenEXR.File(found).write(str(path))


def contents(path):
    """Header and pixels of each part, as OpenEXR reads them."""
    parts = OpenEXR.File(str(path), separate_channels=True).parts
    return [(part.header, {name: channel.pixels for name, channel in part.channels.items()}) for part in parts]


def equal(one, other):
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return type(one) is type(other) and (one == other or str(one) == str(other))


def carried(want, got):
    """All but the colour is unchanged: the order of parts, attributes, channels and their types."""
    for (header, channels), (header_got, channels_got) in zip(want, got, strict=True):
        assert header.keys() == header_got.keys()
        for name in header.keys() - {"channels"}:
            assert equal(header[name], header_got[name]), name
        assert channels.keys() == channels_got.keys()
        for name in channels.keys() - set("RGB"):
            assert_same_bits(channels_got[name], channels[name])


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("parts", [False, True])
def test_all_but_the_colour_stays(tmp_path, parts, half):
    """Windows, attributes, alpha, layers of every type, and other parts, bit for bit."""
    plate(tmp_path / "a.exr", parts=parts)
    given = io.read_plate(tmp_path / "a.exr")
    color = np.random.default_rng(1).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    io.write_exr(tmp_path / "b.exr", color, half=half, like=given)
    want, got = contents(tmp_path / "a.exr"), contents(tmp_path / "b.exr")
    assert len(got) == len(want) == 1 + parts
    carried(want, got)
    for i, name in enumerate("RGB"):
        assert_same_bits(got[-1][1][name], color[..., i].astype(np.float16 if half else np.float32))


def test_tiles_and_lossy_compression_are_not_kept(tmp_path):
    """A second lossy compression would change the other channels."""
    tiles = OpenEXR.TileDescription()
    header = {"dataWindow": DATA, "displayWindow": DISPLAY, "tiles": tiles, "lineOrder": OpenEXR.LineOrder.RANDOM_Y}
    header |= {"type": OpenEXR.tiledimage, "compression": OpenEXR.B44_COMPRESSION}
    OpenEXR.File(header, layers()).write(str(tmp_path / "a.exr"))
    io.write_exr(tmp_path / "b.exr", np.zeros((HEIGHT, WIDTH, 3)), like=io.read_plate(tmp_path / "a.exr"))
    ((_, want),) = contents(tmp_path / "a.exr")
    ((header, got),) = contents(tmp_path / "b.exr")
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert header["type"] == OpenEXR.scanlineimage
    assert "tiles" not in header
    for name in want.keys() - set("RGB"):
        assert_same_bits(got[name], want[name])


@pytest.mark.parametrize(("scale", "low", "high"), [(2, (-6, 10), (25, 33)), (1.5, (-4, 8), (19, 25))])
def test_another_size_scales_the_windows(tmp_path, scale, low, high):
    camera = yester.Camera.from_look_at((0, 1, 5), (0, 0, 0), (0, 1, 0), 40, 32, 24)
    ndc = np.array([[0.5, 0, 0, 0.5], [0, -0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]]) @ camera.world_to_clip
    plate(tmp_path / "a.exr", jitter=np.array([0.25, 0.0]), worldToNDC=ndc.T.astype(np.float32))
    given = io.read_plate(tmp_path / "a.exr")
    height, width = int(HEIGHT * scale), int(WIDTH * scale)
    larger = yester.Camera(given.frame.camera.world_to_clip, width, height)
    io.write_exr(tmp_path / "b.exr", yester.Frame(np.ones((height, width, 3)), camera=larger), like=given)
    ((header, channels),) = contents(tmp_path / "b.exr")
    assert channels.keys() == set("RGB")
    assert equal(header["dataWindow"], (np.array(low, np.int32), np.array(high, np.int32)))
    assert equal(header["displayWindow"][1], np.array([32 * scale - 1, 24 * scale - 1], np.int32))
    assert header["pixelAspectRatio"] == 1.5
    assert header["comments"] == "a comment"
    assert "jitter" not in header
    back = io.read_exr(tmp_path / "b.exr").camera
    points = camera.unproject([[7.0, 6.0], [4.5, 3.5]], [3.0, 5.0])
    np.testing.assert_allclose(back.project(points)[0], larger.project(points)[0], atol=1e-3)


def test_motion_of_two_channels_replaces_three(tmp_path):
    """The change of depth of the former motion does not stay."""
    guides = {"depth": np.ones((4, 6)), "motion_next": np.zeros((4, 6, 3))}
    io.write_exr(tmp_path / "a.exr", yester.Frame(np.ones((4, 6, 3)), motion=np.full((4, 6, 3), 7.0), **guides))
    io.write_exr(
        tmp_path / "b.exr",
        yester.Frame(np.ones((4, 6, 3)), motion=np.zeros((4, 6, 2))),
        like=io.read_plate(tmp_path / "a.exr"),
    )
    frame = io.read_exr(tmp_path / "b.exr")
    assert frame.motion.shape == (4, 6, 2)
    assert frame.motion_next.shape == (4, 6, 3)
    assert (frame.depth == 1).all()


@pytest.mark.parametrize("view", [None, "left"])
def test_buffers_replace_those_in_other_parts(tmp_path, view):
    """Those of parts without a view, which may be of both, stay, but the new ones are read."""
    named = {"beauty": "RGB", "albedo": "RGB", "motion": "XYZ", "N": "XYZ"}
    parts = [OpenEXR.Part(dict(STORAGE), planes(own, np.float32), name) for name, own in named.items()]
    if view:
        parts[0].header["view"] = view
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    albedo = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    frame = yester.Frame(np.ones((HEIGHT, WIDTH, 3)), albedo=albedo)
    io.write_exr(tmp_path / "b.exr", frame, like=io.read_plate(tmp_path / "a.exr"))
    assert_same_bits(io.read_exr(tmp_path / "b.exr").albedo, albedo)
    want, got = ({part.name() for part in OpenEXR.File(str(tmp_path / name)).parts} for name in ("a.exr", "b.exr"))
    assert want - got == (set() if view else {"albedo"})
    assert_same_bits(io.read_exr(tmp_path / "b.exr").motion, io.read_exr(tmp_path / "a.exr").motion)


# The command line


def run(*arguments, code=0):
    assert main([str(argument) for argument in arguments]) == code


@pytest.fixture
def shots(tmp_path):
    """Two shots, the second one with a gap."""
    folder = tmp_path / "in"
    folder.mkdir()
    for i, name in enumerate(["a1", "a2", "a3", "b7", "b8", "b10", "b11"]):
        plate(folder / f"{name}.exr", seed=i)
    return folder


@pytest.mark.parametrize("half", [False, True])
def test_denoise_keeps_the_plate(tmp_path, half):
    for i in range(2):
        plate(tmp_path / f"{i}.exr", parts=True, seed=i)
    run("denoise", tmp_path / "0.exr", tmp_path / "1.exr", "-o", tmp_path / "out", *["--half"] * half)
    svgf = yester.SVGF()
    for i in range(2):
        want, got = contents(tmp_path / f"{i}.exr"), contents(tmp_path / "out" / f"{i}.exr")
        carried(want, got)
        color = svgf.step(io.read_exr(tmp_path / f"{i}.exr")).color
        for c, name in enumerate("RGB"):
            assert_same_bits(got[-1][1][name], color[..., c].astype(np.float16 if half else np.float32))


def test_upscale_scales_the_plate(tmp_path, capsys):
    for i in range(2):
        plate(tmp_path / f"{i}.exr", seed=i)
    run("upscale", tmp_path, "-o", tmp_path / "out")
    said = [line for line in capsys.readouterr().err.splitlines() if "left out" in line]
    assert len(said) == 1
    assert all(name in said[0].split() for name in layers().keys() - set("RGB"))
    ((header, channels),) = contents(tmp_path / "out" / "1.exr")
    assert channels.keys() == set("RGB")
    assert equal(header["displayWindow"], (DISPLAY[0], np.array([63, 47], np.int32)))
    assert equal(header["dataWindow"], (np.array([-6, 10], np.int32), np.array([25, 33], np.int32)))
    assert header["comments"] == "a comment"


@pytest.mark.parametrize("command", ["denoise", "upscale"])
def test_history_begins_anew(shots, tmp_path, capsys, command):
    """At another shot and after a gap, with a message."""
    run(command, shots, "-o", tmp_path / "out")
    said = capsys.readouterr().err.splitlines()
    warned = [line for line in said if "shot as" in line or "jump" in line]
    assert len(warned) == 2
    assert all(str(shots / name) in warned[0] for name in ("a3.exr", "b7.exr"))
    assert all(str(shots / name) in warned[1] for name in ("b8.exr", "b10.exr"))
    for group in (["a1", "a2", "a3"], ["b7", "b8"], ["b10", "b11"]):
        pipeline = yester.SVGF() if command == "denoise" else yester.Upscaler()
        for name in group:
            want = pipeline.step(io.read_exr(shots / f"{name}.exr")).color
            assert_same_bits(io.read_exr(tmp_path / "out" / f"{name}.exr").color, want)


def test_upscale_denoised_begins_anew_in_both(shots, tmp_path):
    run("upscale", shots, "-o", tmp_path / "out", "--denoise")
    run("upscale", shots / "b10.exr", shots / "b11.exr", "-o", tmp_path / "alone", "--denoise")
    for name in ("b10.exr", "b11.exr"):
        assert_same_bits(io.read_exr(tmp_path / "out" / name).color, io.read_exr(tmp_path / "alone" / name).color)


def frames(folder, **buffers):
    folder.mkdir()
    for i in range(2):
        io.write_exr(folder / f"{i}.exr", noise(seed=i, **buffers))
    return folder


def test_used_and_missing_buffers_are_printed(tmp_path, capsys):
    """Once; and a warning that history is accumulated in place if there are neither motion nor cameras."""
    run("denoise", frames(tmp_path / "bare", albedo=np.ones((24, 32, 3))), "-o", tmp_path / "out")
    said = capsys.readouterr().err.splitlines()
    (warned,) = [line for line in said if line.startswith("warning: ")]
    assert "history is accumulated in place" in warned
    missing = [line.split(": ")[1] for line in said if line.startswith("missing: ")]
    assert missing == ["normal", "depth", "motion", "ids", "position", "emission", "camera"]
    svgf = yester.SVGF()
    used = [svgf.step(io.read_exr(tmp_path / "bare" / f"{i}.exr")).used for i in range(2)]
    assert said[-1] == f"used: {', '.join(dict.fromkeys(name for names in used for name in names))}"
    assert "albedo" in said[-1]

    run("denoise", frames(tmp_path / "next", motion_next=np.zeros((24, 32, 2))), "-o", tmp_path / "out2")
    said = capsys.readouterr().err
    assert "warning" not in said
    assert "missing: motion: computed from motion_next" in said

    run("denoise", tmp_path / "bare", "-o", tmp_path / "oidn", "--method", "oidn", "--quality", "fast")
    said = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[:2] for line in said] == [["missing", "normal"], ["used", "albedo"]]

    moving = {"motion": np.zeros((24, 32, 2)), "depth": np.ones((24, 32))}
    run("denoise", frames(tmp_path / "moving", **moving), "-o", tmp_path / "out", "--overwrite")
    said = capsys.readouterr().err
    assert "warning" not in said
    assert "motion" in said.splitlines()[-1]

    camera = yester.Camera.from_look_at((0, 0, 0), (0, 0, 1), (0, 1, 0), 60, 32, 24)
    run("denoise", frames(tmp_path / "seen", depth=np.ones((24, 32)), camera=camera), "-o", tmp_path / "out" / "seen")
    assert "warning" not in capsys.readouterr().err


def test_one_file_to_one_file(tmp_path, capsys):
    folder = frames(tmp_path / "in")
    one, two = folder / "0.exr", folder / "1.exr"
    run("denoise", one, "-o", tmp_path / "new" / "out.exr")
    want = yester.SVGF().step(io.read_exr(one)).color
    assert_same_bits(io.read_exr(tmp_path / "new" / "out.exr").color, want)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out.exr"]
    (tmp_path / "folder.exr").mkdir()
    run("upscale", one, two, "-o", tmp_path / "folder.exr")
    assert {path.name for path in (tmp_path / "folder.exr").iterdir()} == {"0.exr", "1.exr"}
    capsys.readouterr()
    there = sorted(tmp_path.rglob("*"))
    for command in ("denoise", "upscale"):
        run(command, one, two, "-o", tmp_path / "out.exr", code=2)
        said = capsys.readouterr().err
        assert said == f"yester: error: -o {tmp_path / 'out.exr'}: expected a folder for 2 files, got a file name\n"
        run(command, one, "-o", one, code=2)
        assert "overwrite this input" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == there
