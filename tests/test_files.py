"""Files in, files out: what the command line makes of renderers' sequences, of interruptions and of damage."""

import os
import re
import resource
import subprocess
import sys
import time

import layouts
import numpy as np
import OpenEXR
import pytest
import yester
from compare import assert_same_bits
from test_cli import noise
from yester import io
from yester.cli import main
from yester.io.shots import breaks


def run(*arguments, code=0):
    assert main([str(argument) for argument in arguments]) == code


STILL = {"depth": np.full((12, 16), 2.0), "motion": np.zeros((12, 16, 2))}


def short(folder, *names, **buffers):
    """Small frames of a shot that stands still."""
    folder.mkdir()
    for i, name in enumerate(names or ("a1", "a2", "a3", "a4")):
        named = {"color": noise(12, 16, seed=i).color} | STILL | buffers
        io.write_exr(folder / f"{name}.exr", yester.Frame(**named))
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def shots(tmp_path):
    """Two shots, of eight frames and of three."""
    folder = tmp_path / "in"
    folder.mkdir()
    for i, name in enumerate([*(f"a{i}" for i in range(1, 9)), "b1", "b2", "b3"]):
        io.write_exr(folder / f"{name}.exr", noise(seed=i, depth=np.full((24, 32), 2.0), motion=np.zeros((24, 32, 2))))
    return folder


# Resuming


def test_resumed_bytes_are_those_of_a_whole_run(shots, tmp_path, capsys):
    """Wherever the run has stopped: history begins with the shot, and files that are there stay untouched."""
    run("denoise", shots, "-o", tmp_path / "whole")
    whole = contents(tmp_path / "whole")
    for kept in (
        [],
        ["a1"],
        ["a1", "a2", "a3", "a4"],
        [f"a{i}" for i in range(1, 9)],
        ["a3", "b2"],
        [n[:-4] for n in whole],
    ):
        out = tmp_path / "_".join(["out", *kept])
        out.mkdir()
        for name in kept:
            (out / f"{name}.exr").write_bytes(whole[f"{name}.exr"])
        before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
        capsys.readouterr()
        run("denoise", shots, "-o", out, "--resume")
        assert f"resumed: {len(kept)} of 11 frames are there" in capsys.readouterr().err
        assert contents(out) == whole
        assert before.items() <= {path.name: path.stat().st_mtime_ns for path in out.iterdir()}.items()


@pytest.mark.slow
def test_resume_after_a_kill(shots, tmp_path):
    """Killed at once, not asked to stop: what it left half-written goes."""
    for i in range(9, 80):
        (shots / f"a{i}.exr").hardlink_to(shots / "a1.exr")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "yester", "denoise", str(shots / "a*.exr"), "-o", str(out)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        while not (out.exists() and list(out.glob("a?.exr"))):
            time.sleep(0.01)
        process.kill()
    assert 0 < len(list(out.glob("*.exr"))) < 79
    (out / ".a50.exr.123.tmp").write_text("half of a file")
    run("denoise", shots / "a*.exr", "-o", out, "--resume")
    run("denoise", shots / "a*.exr", "-o", tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")


@pytest.mark.slow
def test_resume_of_another_run(shots, tmp_path, capsys):
    run("denoise", shots, "-o", tmp_path / "out", "--alpha", 0.5)
    (tmp_path / "out" / "a5.exr").unlink()
    before = contents(tmp_path / "out")
    run("denoise", shots, "-o", tmp_path / "out", "--resume", code=2)
    assert "a1.exr: is of a run with other inputs or options" in capsys.readouterr().err
    assert contents(tmp_path / "out") == before
    run("denoise", shots, "-o", tmp_path / "out", "--resume", "--alpha", 0.5)
    assert len(contents(tmp_path / "out")) == 11


@pytest.mark.parametrize(
    ("change", "lookahead", "first"), [("options", 0, "a2"), ("a frame", 0, "a3"), ("a further frame", 1, "a6")]
)
def test_resume_notices_any_change(tmp_path, capsys, change, lookahead, first):
    """Every frame that is there is compared: the first ones may be the same."""
    frames = short(tmp_path / "in", *(f"a{i}" for i in range(1, 7)))
    given = "denoise", frames, "-o", tmp_path / "out", "--method", "taa", "--lookahead", lookahead, "--alpha"
    run(*given, 0.05)
    if change == "a further frame":
        io.write_exr(frames / "a7.exr", noise(12, 16, seed=7, **STILL))
    else:
        (tmp_path / "out" / "a6.exr").unlink()
    if change == "a frame":
        io.write_exr(frames / "a3.exr", noise(12, 16, seed=7, **STILL))
    before = contents(tmp_path / "out")
    capsys.readouterr()
    run(*given, 0.9 if change == "options" else 0.05, "--resume", code=2)
    want = f"{tmp_path / 'out' / first}.exr: is of a run with other inputs or options: --overwrite replaces"
    assert want in capsys.readouterr().err
    assert contents(tmp_path / "out") == before


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:400]])
def test_damaged_outputs_are_written_again(tmp_path, capsys, damage):
    given = "denoise", short(tmp_path / "in"), "-o", tmp_path / "out"
    run(*given)
    whole = contents(tmp_path / "out")
    broken = tmp_path / "out" / "a3.exr"
    broken.write_bytes(damage(whole["a3.exr"]))
    capsys.readouterr()
    run(*given, "--resume")
    said = capsys.readouterr().err
    assert f"damaged, written again: {broken}: " in said
    assert "resumed: 3 of 4 frames are there" in said
    assert contents(tmp_path / "out") == whole


@pytest.mark.slow
def test_resume_of_an_upscaled_and_an_automatic_run(shots, tmp_path):
    for given in (("upscale",), ("denoise", "--method", "auto")):
        out = tmp_path / given[-1]
        run(given[0], shots, "-o", out, *given[1:])
        whole = contents(out)
        for name in ("a6.exr", "a7.exr", "b1.exr"):
            (out / name).unlink()
        run(given[0], shots, "-o", out, *given[1:], "--resume")
        assert contents(out) == whole


@pytest.mark.slow
def test_outputs_that_exist(shots, tmp_path, capsys):
    """Neither replaced nor computed, unless told so."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a2.exr").write_text("mine")
    (tmp_path / "out" / "b3.exr").write_text("mine")
    for command in ("denoise", "upscale"):
        run(command, shots, "-o", tmp_path / "out", code=2)
        said = capsys.readouterr().err
        there = ", ".join(str(tmp_path / "out" / name) for name in ("a2.exr", "b3.exr"))
        assert said.startswith(f"yester: error: {there}: exists already: --resume")
    assert contents(tmp_path / "out") == {"a2.exr": b"mine", "b3.exr": b"mine"}
    run("denoise", shots, "-o", tmp_path / "out", "--overwrite")
    assert len(contents(tmp_path / "out")) == 11
    assert io.read_exr(tmp_path / "out" / "a2.exr").shape == (24, 32)
    with pytest.raises(SystemExit):
        main(["denoise", str(shots), "-o", str(tmp_path / "out"), "--overwrite", "--resume"])


@pytest.mark.slow
def test_a_full_disk_and_then_room(shots, tmp_path, capsys):
    """The file is named, those before are whole, and the rest comes when there is room."""
    run("denoise", shots, "-o", tmp_path / "whole")
    largest = max(len(data) for data in contents(tmp_path / "whole").values())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest - 500, limits[1]))
    try:
        run("denoise", shots, "-o", tmp_path / "out", code=2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert re.search(r"yester: error: .*out/\w\d\.exr: cannot be written", capsys.readouterr().err)
    assert all(contents(tmp_path / "whole")[name] == data for name, data in contents(tmp_path / "out").items())
    run("denoise", shots, "-o", tmp_path / "out", "--resume")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_names_that_are_no_folders(tmp_path, capsys):
    """A name that means a picture or a film is no folder's."""
    frames = short(tmp_path / "in")
    for given in (
        ("denoise", frames, "-o", tmp_path / "clean.tif"),
        ("upscale", frames / "a1.exr", "-o", tmp_path / "single.PNG"),
        ("picture", frames, "-o", tmp_path / "film.gif"),
    ):
        run(*given, code=2)
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"yester: error: -o {given[-1]}: expected a folder, or a name that ends in .")
    assert line.endswith(".png or .webp or .mp4")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


# Damage


def test_damaged_files_are_all_named(shots, tmp_path, capsys):
    for name in ("a3", "b2"):
        (shots / f"{name}.exr").write_bytes((shots / f"{name}.exr").read_bytes()[:500])
    run("denoise", shots, "-o", tmp_path / "out", code=2)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"yester: error: {shots / 'a3.exr'}: truncated or corrupt")
    assert f"so are 1 more: {shots / 'b2.exr'}" in line
    assert "--keep-going" in line
    assert not (tmp_path / "out").exists()


def test_damaged_pixels_are_noticed_when_they_are_read(tmp_path, capsys):
    """Frames before are written; the message says how to go on."""
    frames = short(tmp_path / "in", color=np.ones((12, 16, 3)))
    damaged = frames / "a3.exr"
    damaged.write_bytes(damaged.read_bytes()[:-16] + bytes(16))
    run("denoise", frames, "-o", tmp_path / "out", "--method", "svgf", "--lookahead", 0, code=2)
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"yester: error: {damaged}: truncated or corrupt: ")
    assert line.endswith("(--keep-going leaves it out, --resume goes on once it is repaired)")
    assert contents(tmp_path / "out").keys() == {"a1.exr", "a2.exr"}


def test_the_others_go_on(shots, tmp_path, capsys):
    """A frame that is damaged is a missing one, whether its header says so or its pixels do."""
    damaged = {"a3": lambda data: data[:500], "a6": lambda data: data[:-16] + bytes(16), "b1": lambda data: b""}
    flat = noise(depth=np.full((24, 32), 2.0), motion=np.zeros((24, 32, 2)))
    for name, damage in damaged.items():
        io.write_exr(shots / f"{name}.exr", yester.Frame(**flat.buffers() | {"color": np.ones((24, 32, 3))}))
        (shots / f"{name}.exr").write_bytes(damage((shots / f"{name}.exr").read_bytes()))
    run("denoise", shots, "-o", tmp_path / "out", "--keep-going", "--lookahead", 0, code=1)
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("damaged, left out: ")]
    assert sorted(said) == sorted(dict.fromkeys(said))
    assert [re.search(r"(\w\d)\.exr", line)[1] for line in said] == ["a3", "b1", "a6"]
    assert contents(tmp_path / "out").keys() == contents(shots).keys() - {f"{name}.exr" for name in damaged}
    for group in (["a1", "a2"], ["a4", "a5"], ["a7", "a8"], ["b2", "b3"]):
        svgf = yester.SVGF()
        for name in group:
            want = svgf.step(io.read_exr(shots / f"{name}.exr")).color
            assert_same_bits(io.read_exr(tmp_path / "out" / f"{name}.exr").color, want)
    for path in shots.iterdir():
        path.write_text("no image")
    run("denoise", shots, "-o", tmp_path / "none", "--keep-going", code=2)
    assert "so are 10 more" in capsys.readouterr().err


def test_files_of_several_renderers(tmp_path, capsys):
    for i, make in ((1, layouts.cycles), (2, layouts.pbrt)):
        make(tmp_path / f"{i}.exr", layouts.frame(i))
    run("denoise", tmp_path / "1.exr", tmp_path / "2.exr", "-o", tmp_path / "out")
    said = capsys.readouterr().err
    assert f"files of several renderers: {tmp_path / '2.exr'} is by pbrt-v4" in said
    assert f"{tmp_path / '1.exr'} is by Blender Cycles" in said


def test_gaps_and_duplicates_are_named():
    def told(*names):
        return list(breaks([type(layouts.Path())(name) for name in names]).values())

    assert "(3 to 8 are missing)" in told("a.2.exr", "a.9.exr")[0]
    assert "(3 is missing)" in told("a.0002.exr", "a.0004.exr")[0]
    assert "the same frame number as a.1.exr" in told("a.1.exr", "a.01.exr")[0]


def test_spellings_of_one_folder(tmp_path, monkeypatch, capsys):
    """A shot whose files are named in several ways is one shot, in the order of its numbers."""
    whole, mixed = tmp_path / "whole", tmp_path / "mixed"
    short(tmp_path / "still")
    run("denoise", tmp_path / "still", "-o", whole)
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    run(
        "denoise", "still/a3.exr", tmp_path / "still" / "a1.exr", "whole/../still/a4.exr", "./still/a2.exr", "-o", mixed
    )
    assert "separate sequence" not in capsys.readouterr().err
    assert contents(mixed) == contents(whole)


# Renderers' sequences


@pytest.mark.parametrize("parts", [False, True])
def test_cycles_round_trip(tmp_path, capsys, parts):
    """Every layer that was not replaced is bit for bit what it was; the result is where the render was."""
    (tmp_path / "in").mkdir()
    for i in range(1, 4):
        layouts.cycles(tmp_path / "in" / f"frame.{i}.exr", layouts.frame(i), parts=parts, new=True)
    run("denoise", tmp_path / "in", "-o", tmp_path / "out")
    said = capsys.readouterr().err
    assert "recognised: Blender Cycles, by header attribute" in said
    assert "missing: camera" in said
    outputs = yester.denoise(io.read_sequence(tmp_path / "in"))
    for i, output in zip(range(1, 4), outputs, strict=True):
        before, after = (
            OpenEXR.File(str(tmp_path / name / f"frame.{i}.exr"), separate_channels=True).parts
            for name in ("in", "out")
        )
        assert [part.name() for part in before] == [part.name() for part in after]
        replaced = 0
        for one, other in zip(before, after, strict=True):
            # A result says so, since the noisy image stays beside it.
            marked = {"yester.color"} if "ViewLayer.Combined.R" in one.channels else set()
            assert other.header.keys() == one.header.keys() | marked
            assert all(str(one.header[name]) == str(other.header[name]) for name in one.header if name != "channels")
            assert one.channels.keys() == other.channels.keys()
            for name, channel in one.channels.items():
                layer, component = name.split(".")[-2:]
                if layer == "Combined" and component != "A":
                    replaced += 1
                    assert_same_bits(other.channels[name].pixels, output.color[..., "RGB".index(component)])
                else:
                    assert_same_bits(other.channels[name].pixels, channel.pixels)
        assert replaced == 3
        assert_same_bits(io.read_exr(tmp_path / "out" / f"frame.{i}.exr").color, output.color)


@pytest.mark.slow
@pytest.mark.parametrize("name", layouts.RENDERERS)
def test_every_renderer_is_denoised(tmp_path, name):
    """Better than it came, also where motion and camera are not known."""
    (tmp_path / "in").mkdir()
    for i in range(1, 5):
        layouts.RENDERERS[name](tmp_path / "in" / f"frame.{i}.exr", layouts.frame(i))
    given = {"arnold": ["--map", "motion=motionvector.R,motionvector.G"]}
    given["renderman"] = ["--map", "motion=backward.r,backward.g", "--map", "motion_next=-forward.r,-forward.g"]
    run("denoise", tmp_path / "in", "-o", tmp_path / "out", *given.get(name, ()))
    shot = layouts.flight.shoot(3, layouts.WIDTH, layouts.HEIGHT)
    hit = shot.ids > 0
    clean, noisy = (io.read_exr(tmp_path / place / "frame.3.exr").color for place in ("out", "in"))
    error, before = (np.mean((image - shot.color)[hit] ** 2) for image in (clean, noisy))
    assert error < 0.2 * before


def test_two_eyes_in_a_folder(tmp_path, capsys):
    """Their files take turns in natural order, but are two shots."""
    names = [f"{number:03}_{eye}" for number in range(1, 4) for eye in "LR"]
    run("denoise", short(tmp_path / "in", *names), "-o", tmp_path / "out", "--lookahead", "0", "--method", "taa")
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "not the same shot" in line]
    assert "001_R.exr: not the same shot as" in line
    taa = yester.TAA()
    for number in range(1, 4):
        want = taa.step(io.read_exr(tmp_path / "in" / f"{number:03}_R.exr")).color
        np.testing.assert_array_equal(io.read_exr(tmp_path / "out" / f"{number:03}_R.exr").color, want)


def test_a_plan_names_the_file_without_albedo(tmp_path, capsys):
    folder = short(tmp_path / "in", *(f"a{number}" for number in range(1, 7)), albedo=np.ones((12, 16, 3)))
    io.write_exr(folder / "a5.exr", yester.Frame(noise(12, 16, seed=5).color, **STILL))
    run("plan", folder, code=2)
    assert capsys.readouterr().err.endswith(f"{folder / 'a5.exr'}: no albedo, but {folder / 'a1.exr'} has albedo\n")


def test_albedo_in_one_of_two_shots(tmp_path, capsys):
    """Each shot has a history of its own, in which either all frames have it or none has."""
    albedo = np.full((12, 16, 3), 0.5)
    folder = short(tmp_path / "in", "a1", "a2", "b1", "b2")
    for name in ("a1", "a2"):
        frame = io.read_exr(folder / f"{name}.exr")
        io.write_exr(folder / f"{name}.exr", yester.Frame(**frame.buffers(), albedo=albedo))
    run("denoise", folder, "-o", tmp_path / "out", "--method", "svgf", "--lookahead", 0)
    for shot in "ab":
        svgf = yester.SVGF()
        for number in (1, 2):
            want = svgf.step(io.read_exr(folder / f"{shot}{number}.exr")).color
            assert_same_bits(io.read_exr(tmp_path / "out" / f"{shot}{number}.exr").color, want)
    io.write_exr(folder / "b2.exr", yester.Frame(noise(12, 16).color, albedo=albedo, **STILL))
    capsys.readouterr()
    run("denoise", folder, "-o", tmp_path / "none", code=2)
    assert capsys.readouterr().err.endswith(f"{folder / 'b1.exr'}: no albedo, but {folder / 'b2.exr'} has albedo\n")
    assert not (tmp_path / "none").exists()


def test_options_of_storage(tmp_path):
    layouts.pbrt(tmp_path / "a.exr", layouts.frame(1))  # in half floats
    for given, kind, compression in (
        ((), np.float16, OpenEXR.ZIP_COMPRESSION),
        (("--no-half",), np.float32, OpenEXR.ZIP_COMPRESSION),
        (("--half", "--compression", "piz"), np.float16, OpenEXR.PIZ_COMPRESSION),
    ):
        run("denoise", tmp_path / "a.exr", "-o", tmp_path / "out.exr", "--overwrite", *given)
        (part,) = OpenEXR.File(str(tmp_path / "out.exr"), separate_channels=True).parts
        assert part.channels["R"].pixels.dtype == kind
        assert part.channels["P.X"].pixels.dtype == np.float16
        assert part.header["compression"] == compression


def test_bad_options(tmp_path, capsys):
    layouts.arnold(tmp_path / "a.exr", layouts.frame(1))
    for given, complaint in (
        (("--compression", "jpeg"), "--compression: expected one of none, rle"),
        (("--compression", "dwaa"), "a.exr: --compression: expected one that keeps N.Y"),
        (("--map", "normals=N.X,N.Y,N.Z"), "got 'normals' (perhaps normal)"),
        (("--map", "normal=M.X,M.Y,M.Z"), "normal: no channel 'M.X'"),
        (("--map", "depth.near=far"), "--map depth.near: expected numbers"),
        (("--map", "depth.near=nan"), "depth.near: expected a number"),
        (("--map", "motion.scale=nan"), "motion.scale: expected a number"),
        (("--map", "none.toml"), "none.toml: No such file"),
        (("--view", "left"), "the file has no views"),
    ):
        run("denoise", tmp_path / "a.exr", "-o", tmp_path / "out", *given, code=2)
        (line,) = capsys.readouterr().err.splitlines()
        assert complaint in line
    assert not (tmp_path / "out").exists()


def test_info(tmp_path, capsys):
    """What is recognised, converted, not used, not known and missing."""
    planes = layouts.layers({"RGB": layouts.frame(1).color, "Normals.XYZ": layouts.frame(1).normal})
    layouts.store(tmp_path / "unknown.exr", planes, {})
    run("info", tmp_path / "unknown.exr")
    said = capsys.readouterr().out
    assert "recognised: no renderer" in said
    assert "not recognised: Normals.XYZ\n  Normals may be normal: --map 'normal=Normals.X,Normals.Y,Normals.Z'" in said
    run(
        "info",
        tmp_path / "unknown.exr",
        "--map",
        "normal=Normals.X,Normals.Y,-Normals.Z",
        "--map",
        "normal.space=camera",
    )
    said = capsys.readouterr().out
    assert "as mapped; in camera space: kept in camera space, for want of a camera in the header" in said
    assert "not recognised" not in said

    layouts.renderman(tmp_path / "a.exr", layouts.frame(1))
    run("info", tmp_path / "a.exr")
    said = capsys.readouterr().out
    assert "recognised: RenderMan, by channels zfiltered" in said
    assert "forward.rg backward.rg: motion to the next or previous frame; its unit was not found" in said
    assert "inferred: in world space" in said
    assert re.search(r"motion +history is accumulated in place", said)


def test_a_view_of_a_stereo_file(tmp_path, capsys):
    color = np.random.default_rng(0).random((24, 32, 3)).astype(np.float32)
    planes = layouts.layers({"RGB": color, "right.RGB": 2 * color})
    layouts.store(tmp_path / "a.exr", planes, {"multiView": ["left", "right"]})
    run("info", tmp_path / "a.exr")
    assert "views: left, right; left is used, --view chooses" in capsys.readouterr().out
    run("denoise", tmp_path / "a.exr", "-o", tmp_path / "out.exr", "--view", "right")
    assert "note: view right is used, not left" in capsys.readouterr().err
    assert_same_bits(io.read_exr(tmp_path / "out.exr").color, color)
    want = yester.SVGF().step(yester.Frame(2 * color)).color
    assert_same_bits(io.read_exr(tmp_path / "out.exr", view="right").color, want)


@pytest.mark.slow
def test_plan_and_chart_take_mappings(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    for i in range(1, 7):
        shot = layouts.frame(i)
        planes = layouts.layers({"light.RGB": shot.color, "mv.XY": shot.motion, "far.A": shot.depth})
        layouts.store(tmp_path / "in" / f"{i}.exr", planes, {})
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('color = ["light.R", "light.G", "light.B"]\nmotion = ["mv.X", "mv.Y"]\ndepth = "far.A"\n')
    run("plan", tmp_path / "in", code=2)
    assert "no colour" in capsys.readouterr().err
    run("plan", tmp_path / "in", "--map", mapping)
    assert "motion" in capsys.readouterr().out
    given = "--metrics", "warped_error", "--methods", "TAA", "--no-peers", "--time-size", "32x24"
    run("chart", tmp_path / "in", "--map", mapping, "-o", tmp_path / "chart", *given)
    assert (tmp_path / "chart" / "points.csv").exists()
    capsys.readouterr()
    run("chart", tmp_path / "in", "--map", mapping, "-o", tmp_path / "chart", *given, code=2)
    assert "report.html, " in (said := capsys.readouterr().err)
    assert "points.csv: exists already: --overwrite replaces" in said
    run("chart", "-o", tmp_path / "chart", "--map", mapping, code=2)
    assert "expected FRAMES that they are about" in capsys.readouterr().err


def test_chart_takes_one_shot(tmp_path, capsys):
    """Its methods would carry history over a gap."""
    frames = short(tmp_path / "in", "a1", "a2", "a4", "a5")
    run("chart", frames, "--no-peers", "-o", tmp_path / "out", code=2)
    said = f"{frames / 'a4.exr'}: frame numbers jump after {frames / 'a2.exr'} (3 is missing)"
    assert f"{said}; expected consecutive frames of one shot\n" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# Samples


def test_every_second_frame_is_one_shot(tmp_path, capsys):
    frames = short(tmp_path / "in", "a0", "a2", "a4", "a6", "a8")
    run("denoise", frames, "-o", tmp_path / "out", "--method", "svgf")
    assert "warning" not in capsys.readouterr().err
    *_, want = yester.denoise([*io.read_sequence(frames)], yester.SVGF())
    assert_same_bits(io.read_exr(tmp_path / "out" / "a8.exr").color, want.color)


def test_missing_samples_are_named(tmp_path, capsys):
    """The files that lack most come first, and more than three are counted."""
    frames = short(tmp_path / "in", *(f"a{i}" for i in range(1, 7)))
    for i, rows in enumerate((1, 12, 2, 3, 1), 1):
        frame = io.read_exr(frames / f"a{i}.exr")
        color = frame.color.copy()
        color[:rows] = np.nan
        io.write_exr(frames / f"a{i}.exr", yester.Frame(**frame.buffers() | {"color": color}))
    run("denoise", frames, "-o", tmp_path / "out")
    said = [line for line in capsys.readouterr().err.splitlines() if "samples" in line]
    assert said == [
        f"warning: {frames / 'a2.exr'}: all 192 samples are missing",
        f"warning: {frames / 'a4.exr'}: 48 of 192 samples are missing",
        f"warning: {frames / 'a3.exr'}: 32 of 192 samples are missing",
        "warning: 2 more files have missing samples",
    ]
    run("denoise", frames, "-o", tmp_path / "half", "--method", "halfres")
    said = [line for line in capsys.readouterr().err.splitlines() if "samples" in line]
    assert said == [f"warning: {frames / 'a2.exr'}: all 192 samples are missing"]


def test_buffers_of_nan_are_named(tmp_path, capsys):
    normal = np.ones((12, 16, 3), np.float32)
    normal[..., 0] = np.nan
    frames = short(tmp_path / "in", normal=normal, motion=np.full((12, 16, 2), np.nan))
    run("denoise", frames, "-o", tmp_path / "out")
    said = capsys.readouterr().err
    assert f"warning: {frames / 'a1.exr'}: normal is NaN in all pixels\n" in said
    assert f"warning: {frames / 'a2.exr'}: motion is NaN in all pixels\n" in said
    assert said.count("is NaN") == 2


def test_values_that_are_too_large_are_named(tmp_path, capsys):
    frames = short(tmp_path / "in", *(f"a{i}" for i in range(1, 7)))
    run("denoise", frames, "-o", tmp_path / "calm", "--half")
    assert "warning" not in capsys.readouterr().err
    frame = io.read_exr(frames / "a1.exr")
    color = frame.color.copy()
    color[5, 5] = 1e30
    io.write_exr(frames / "a1.exr", yester.Frame(**frame.buffers() | {"color": color}))
    run("denoise", frames, "-o", tmp_path / "out", "--half")
    said = capsys.readouterr().err
    assert f"warning: {frames / 'a1.exr'}: values above 1e+18, whose squares overflow" in said
    assert "results above 65504 are clipped to it" in said
    assert "plan: the default: values too large to judge\n" in said
    run("plan", frames)
    assert capsys.readouterr() == ("the default: values too large to judge\n", "")


def test_whole_numbers_are_no_colour(tmp_path, capsys):
    planes = {name: np.ones((12, 16), np.uint32) for name in "RGB"}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    assert io.describe(tmp_path / "a.exr").whole == ("color",)
    run("denoise", tmp_path / "a.exr", "-o", tmp_path / "out", code=2)
    said = f"yester: error: {tmp_path / 'a.exr'}: color: expected channels of floats, got uint32\n"
    assert capsys.readouterr().err == said
    assert not (tmp_path / "out").exists()


def test_without_colour_the_channels_are_listed(tmp_path, capsys):
    layouts.store(tmp_path / "a.exr", layouts.layers({"depth.Z": np.ones((12, 16))}), {})
    run("denoise", tmp_path / "a.exr", "-o", tmp_path / "out", code=2)
    assert "no colour: expected channels R, G and B, got depth.Z" in capsys.readouterr().err


@pytest.mark.parametrize("option", [("--exposure", "nan"), ("--fps", 0)])
def test_pictures_refuse_before_work_starts(tmp_path, capsys, option):
    frames = short(tmp_path / "in")
    run("picture", frames, "-o", tmp_path / "out" / "film.webp", *option, code=2)
    assert f"{option[0].removeprefix('--')}: expected" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_that_must_not_be_read(shots, tmp_path, capsys, monkeypatch):
    """They are left out like damaged ones. Tests may run as root, who may read everything."""
    locked = shots / "a2.exr"
    whole = type(locked).open

    def opened(path, *arguments, **named):
        if path == locked:
            raise PermissionError(13, "Permission denied", str(path))
        return whole(path, *arguments, **named)

    monkeypatch.setattr(type(locked), "open", opened)
    run("denoise", shots, "-o", tmp_path / "out", code=2)
    assert f"yester: error: {locked}: Permission denied (--keep-going leaves" in capsys.readouterr().err
    run("denoise", shots, "-o", tmp_path / "out", "--keep-going", "--method", "taa", code=1)
    assert f"damaged, left out: {locked}: Permission denied\n" in capsys.readouterr().err
    run("picture", shots, "-o", tmp_path / "png", code=1)
    assert f"left out: {locked}: Permission denied\n" in capsys.readouterr().err


def test_a_folder_that_must_not_be_read(shots, capsys, monkeypatch):
    def scanned(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", scanned)
    run("plan", shots, code=2)
    assert capsys.readouterr().err == f"yester: error: {shots}: Permission denied\n"


# Messages


def test_wrong_options_point_to_the_help_of_their_command(tmp_path, capsys):
    for given, of in (
        (("denoise", tmp_path, "-o", tmp_path / "out", "--bogus"), "yester denoise"),
        (("check", tmp_path, "--frames", 1), "yester check"),
        (("--bogus", "info", tmp_path), "yester"),
    ):
        with pytest.raises(SystemExit):
            main([str(argument) for argument in given])
        assert f"(see {of} --help)" in capsys.readouterr().err


def test_plans_of_several_shots_name_them(shots, tmp_path, capsys):
    run("denoise", shots, "-o", tmp_path / "out")
    plans = [line for line in capsys.readouterr().err.splitlines() if line.startswith("plan")]
    starts = [f"plan from {shots / name}.exr on: " for name in ("a1", "b1")]
    assert [line[: len(start)] for line, start in zip(plans, starts, strict=True)] == starts


def test_a_plan_behind_a_damaged_frame_names_its_first_file(tmp_path, capsys):
    frames = short(tmp_path / "in", color=np.ones((12, 16, 3)))
    damaged = frames / "a2.exr"
    damaged.write_bytes(damaged.read_bytes()[:-16] + bytes(16))
    run("denoise", frames, "-o", tmp_path / "out", "--keep-going", code=1)
    plans = [line.partition(": ")[0] for line in capsys.readouterr().err.splitlines() if line.startswith("plan")]
    assert plans == ["plan", f"plan from {frames / 'a3.exr'} on"]


def test_consequences_are_those_of_what_is_there(tmp_path):
    for buffers, depth, normal in (
        ({}, "are not detected, which leaves ghosts", "creases are not detected"),
        ({"ids": np.ones((12, 16), np.uint32)}, "are detected by ids alone", "creases are not detected"),
        ({"depth": np.ones((12, 16))}, None, "creases are detected by depth alone"),
    ):
        io.write_exr(tmp_path / "a.exr", noise(12, 16, **buffers))
        missing = io.describe(tmp_path / "a.exr").missing
        assert depth is None or missing["depth"].startswith(f"disocclusions {depth}")
        assert missing["normal"].startswith(normal)


def test_check_without_a_camera(tmp_path, capsys):
    """Positions are there. Mitsuba's files never have a camera."""
    for i in (1, 2):
        shot = layouts.frame(i)
        named = {"RGB": shot.color, "position.XYZ": np.nan_to_num(shot.position), "sh_normal.XYZ": shot.normal}
        layouts.store(tmp_path / f"{i}.exr", layouts.layers(named), {"generatedBy": "Mitsuba version 3.6.0"})
    run("check", tmp_path)
    said = capsys.readouterr().out
    assert "no cameras\n" in said
    assert "no positions" not in said
    assert "note: Mitsuba's files have no camera; yester.io.mitsuba.render_sequence" in said


# Motion


@pytest.mark.filterwarnings("ignore:frames. later frames are not used")
def test_the_first_frame_needs_no_motion(tmp_path, capsys):
    """Elsewhere, a file without it is named, and parts two histories: the results are those of `yester.denoise`."""
    frames = short(tmp_path / "in", "a1", "a2", "a3", "b1", "b2", "b3", "b4")
    for i, name in enumerate(("a1", "b3")):
        io.write_exr(frames / f"{name}.exr", noise(12, 16, seed=i, depth=STILL["depth"]))
    run("denoise", frames, "-o", tmp_path / "out")
    said = capsys.readouterr().err.splitlines()
    (warned,) = [line for line in said if line.startswith("warning: ") and "not the same shot" not in line]
    assert warned.startswith(f"warning: {frames / 'b3.exr'}: no motion, and no camera")
    (missing,) = [line for line in said if line.startswith("missing") and ": motion: " in line]
    assert missing.startswith(f"missing in {frames / 'b3.exr'}: motion: history is accumulated in place")
    for shot in ("a?.exr", "b?.exr"):
        paths = io.sequence_paths(frames / shot)
        for path, want in zip(paths, yester.denoise(io.read_sequence(paths)), strict=True):
            assert_same_bits(io.read_exr(tmp_path / "out" / path.name).color, want.color)


def test_check_needs_no_motion_of_the_first_frame(tmp_path, capsys):
    rng = np.random.default_rng(0)
    texture = rng.random((80, 120, 3), np.float32)
    places = [(i * i, 2 * i + i * i) for i in range(4)]
    for i, (down, right) in enumerate(places):
        image = np.roll(texture, (down, right), (0, 1))
        steps = np.subtract(places[i - 1], places[i])
        motion = None if i == 0 else np.full((80, 120, 2), (steps[1], -steps[0]), np.float32)
        io.write_exr(tmp_path / f"{i}.exr", yester.Frame(image, albedo=image, motion=motion))
    run("check", tmp_path, code=1)
    said = capsys.readouterr().out
    assert "looked at 1.exr to 3.exr" in said
    assert "motion      wrong     y up" in said


def test_a_data_window_that_moves(tmp_path, capsys):
    """Motion between such images must have its shift, which the files do not tell."""
    for i in range(1, 4):
        corner = np.array([max(i, 2), 0], np.int32)
        header = {"dataWindow": (corner, corner + np.array([15, 11], np.int32))}
        header["displayWindow"] = (np.array([0, 0], np.int32), np.array([31, 23], np.int32))
        named = {"RGB": noise(12, 16, seed=i).color, "motion.XY": STILL["motion"]}
        layouts.store(tmp_path / f"{i}.exr", layouts.layers(named), header)
    run("denoise", tmp_path, "-o", tmp_path / "out")
    warned = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert warned == [
        f"warning: {tmp_path / '3.exr'}: the data window has moved since the frame before: "
        "motion must contain that shift"
    ]


# Names


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere, names are Unicode")
def test_names_that_are_not_utf8(tmp_path, capsys):
    names = [os.fsdecode(b"caf\xe9.%d" % i) for i in range(2)]
    frames = short(tmp_path / "in", *names)
    run("denoise", frames, "-o", tmp_path / "out")
    for path, want in zip(io.sequence_paths(frames), yester.denoise(io.read_sequence(frames)), strict=True):
        assert_same_bits(io.read_plate(tmp_path / "out" / path.name).frame.color, want.color)
    run("info", frames / f"{names[0]}.exr")
    assert "caf\\udce9.0.exr: 16 x 12" in capsys.readouterr().out


def test_files_as_a_shell_lists_them(tmp_path):
    """In natural order within a folder; folders in the order in which they are given."""
    names = [f"f{i}" for i in range(7, 13)]
    frames, others = short(tmp_path / "a", *names), short(tmp_path / "b", "f1")
    run("denoise", others / "f1.exr", *sorted(frames.iterdir()), "-o", tmp_path / "out", "--lookahead", 0)
    svgf = yester.SVGF()
    for name in names:
        want = svgf.step(io.read_exr(frames / f"{name}.exr")).color
        assert_same_bits(io.read_exr(tmp_path / "out" / f"{name}.exr").color, want)


def test_outputs_of_one_name(tmp_path, capsys):
    one, other = (short(tmp_path / name, "f1") / "f1.exr" for name in "ab")
    for command in ("denoise", "picture"):
        run(command, one, other, "-o", tmp_path / "out", code=2)
        assert f"{other}: its output would overwrite that of {one}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["denoise", "upscale"])
def test_no_input_is_replaced_under_another_name(tmp_path, capsys, command):
    render, links = short(tmp_path / "out", "f0") / "f0.exr", short(tmp_path / "in", "f0")
    (links / "g.exr").symlink_to("../out/f0.exr")
    before = render.read_bytes()
    run(command, links, "-o", render.parent, "--overwrite", code=2)
    said = f"yester: error: {links / 'g.exr'}: the output would overwrite this input; choose another folder\n"
    assert capsys.readouterr().err == said
    assert render.read_bytes() == before


def test_no_picture_replaces_an_input(tmp_path, capsys):
    short(tmp_path / "in", "f0")
    render = (tmp_path / "in" / "f0.exr").rename(tmp_path / "f0.png")
    run("picture", render, "-o", tmp_path, "--overwrite", code=2)
    assert f"{render}: the output would overwrite this input" in capsys.readouterr().err


def test_no_plan_is_replaced_by_a_result(tmp_path, capsys):
    frames, plan = short(tmp_path / "in"), tmp_path / "a.exr"
    run("plan", frames, "-o", plan)
    run("denoise", frames / "a1.exr", "-o", plan, "--plan", plan, "--overwrite", code=2)
    assert f"{plan}: the output would overwrite this input" in capsys.readouterr().err
    assert yester.Plan.load(plan)


def test_a_plan_replaces_nothing(tmp_path, capsys):
    frames, mine = short(tmp_path / "in"), tmp_path / "notes.txt"
    mine.write_text("mine")
    run("plan", frames, "-o", mine, code=2)
    assert f"{mine}: exists already: --overwrite replaces" in capsys.readouterr().err
    assert mine.read_text() == "mine"
    run("plan", frames, "-o", mine, "--overwrite")
    assert yester.Plan.load(mine).reason.startswith("expected at least 5 frames")


# Files that differ


def test_another_size_is_named(tmp_path, capsys):
    frames = short(tmp_path / "in")
    io.write_exr(frames / "a3.exr", noise(12, 18))
    for command in ("check", "plan"):
        run(command, frames, code=2)
        line = capsys.readouterr().err.splitlines()[-1]
        assert line.startswith(f"yester: error: {frames / 'a3.exr'}: expected height and width (12, 16)")
    (frames / "a0.exr").write_text("no image")
    run("picture", frames, "-o", tmp_path / "films" / "film.webp", code=2)
    said = f"yester: error: {frames / 'a3.exr'}: 18 x 12, but {frames / 'a1.exr'} is 16 x 12\n"
    assert capsys.readouterr().err == said
    assert not (tmp_path / "films").exists()


def test_a_buffer_that_some_files_lack(tmp_path, capsys):
    """They are named, and by a mapping of it the first one."""
    frames = short(tmp_path / "in", normal=np.ones((12, 16, 3)))
    io.write_exr(frames / "a3.exr", noise(12, 16, **STILL))
    run("denoise", frames, "-o", tmp_path / "out")
    said = capsys.readouterr().err
    assert f"missing in {frames / 'a3.exr'}: normal: creases" in said
    assert "missing: albedo: " in said
    mapping = "--map", "normal=normal.X,normal.Y,normal.Z"
    for given in (("-o", tmp_path / "mapped"), ("-o", tmp_path / "mapped", "--keep-going")):
        run("denoise", frames, *given, *mapping, code=2)
        line = capsys.readouterr().err
        assert line.startswith(f"yester: error: {frames / 'a3.exr'}: mapping: normal: no channel 'normal.X'")
        assert "leaves" not in line
