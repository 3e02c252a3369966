"""The command line: in processes of its own, but for what it refuses."""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import combinations
from pathlib import Path

import flight
import numpy as np
import pytest
import yester
from compare import assert_close
from PIL import Image
from yester.batch import Batch
from yester.cli import main
from yester.io import read_exr, write_exr

pytestmark = pytest.mark.slow

# Not ru_maxrss, which starts from the memory of the tests' own process.
PEAK = """
import sys
from pathlib import Path
from yester.cli import main
code = main(sys.argv[1:])
print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
sys.exit(code)
"""


def run(*arguments, code=0, program=("-m", "yester")):
    command = [sys.executable, "-W", "error", *program, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == code, result.stderr
    return result


def refused(*arguments):
    """The command fails with one line on stderr and no other output. In this process, as starting others takes long."""
    with redirect_stdout(StringIO()) as output, redirect_stderr(StringIO()) as errors:
        try:
            code = main([*map(str, arguments)])
        except SystemExit as ended:  # by the parser
            code = ended.code
    assert code == 2
    assert output.getvalue() == ""
    (line,) = errors.getvalue().splitlines()
    assert line.startswith("yester: error: ")
    return line


def test_two_runs_into_one_folder(tmp_path):
    """The second one does not replace what the first one writes meanwhile."""
    paths = [tmp_path / "in" / f"{i}.exr" for i in range(3)]
    (tmp_path / "in").mkdir()
    for path in paths:
        write_exr(path, yester.Frame(np.ones((4, 5, 3))))
    one, other = (Batch(paths, tmp_path / "out", {}) for _ in range(2))
    for each in (one, other):
        each.prepare(resume=False, overwrite=False)
    read = other.process(lambda frames, _: ((frame, ()) for frame in frames))
    next(read)
    with pytest.raises(FileExistsError, match=r"out/0\.exr: another run wrote this file while this one was running"):
        next(one.process(lambda frames, _: ((frame, ()) for frame in frames)))
    assert len([*read]) == 2


def frames_of(folder):
    return [read_exr(path) for path in sorted(folder.iterdir())]


def noise(height=24, width=32, seed=0, **buffers):
    return yester.Frame(np.random.default_rng(seed).exponential(1, (height, width, 3)), **buffers)


@pytest.fixture
def sequence(tmp_path):
    """Twelve frames whose names do not sort alphabetically into their order."""
    folder = tmp_path / "noisy"
    folder.mkdir()
    for i in range(12):
        write_exr(folder / f"shot{i + 1}.exr", noise(seed=i))
    return folder


def test_demo(tmp_path):
    result = run("demo", "-o", tmp_path / "demo", "--frames", 4, "--size", "48x36")
    noisy, denoised = (
        [float(number) for number in re.findall(r"[\d.]+", line.partition(" dB")[0][20:] + line.partition(" dB")[2])]
        for line in result.stdout.splitlines()[1:3]
    )
    assert denoised[0] > noisy[0] + 3
    assert denoised[1] < noisy[1]
    assert denoised[2] < noisy[2]
    for kind in ("noisy", "denoised", "reference"):
        frames = [read_exr(path) for path in sorted((tmp_path / "demo" / kind).iterdir())]
        assert [(frame.height, frame.width) for frame in frames] == [(36, 48)] * 4
        assert all(np.isfinite(frame.color).all() and frame.camera is not None for frame in frames)
    clean, alone = frames_of(tmp_path / "demo" / "denoised"), yester.SVGF()
    given = frames_of(tmp_path / "demo" / "noisy")
    for number, (got, want) in enumerate(zip(clean, yester.denoise(given), strict=True)):
        assert_close("denoised", got.color, want.color, rtol=1e-4)
        # There is no frame after the last one.
        same = np.allclose(got.color, alone.step(given[number]).color, rtol=1e-3, atol=1e-5)
        assert not same or number == len(given) - 1
    with Image.open(tmp_path / "demo" / "contact_sheet.png") as sheet:
        assert np.ptp(np.asarray(sheet)) == 255
    with Image.open(tmp_path / "demo" / "side_by_side.webp") as film:
        assert (film.n_frames, film.size) == (4, (96, 36))
    for path in result.stdout.splitlines()[-5:]:
        assert Path(path).exists()


@pytest.mark.parametrize("name", ["noisy/frame_0000.exr", "denoised/mine.exr", "side_by_side.webp"])
def test_demo_touches_nothing_of_others(tmp_path, name):
    """It neither overwrites nor removes existing files, and writes beside files of other names."""
    mine = tmp_path / name
    mine.parent.mkdir(exist_ok=True)
    mine.write_text("mine")
    (tmp_path / "notes.txt").write_text("mine as well")
    there = sorted(tmp_path.rglob("*"))
    line = refused("demo", "-o", tmp_path, "--frames", 1, "--size", "16x12")
    assert f"{tmp_path / Path(name).parts[0]}: already exists" in line
    assert sorted(tmp_path.rglob("*")) == there
    assert mine.read_text() == "mine"


def test_demo_refuses_before_work_starts(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert "cannot be written" in refused("demo", "-o", tmp_path / "file" / "demo")
    assert "--frames" in refused("demo", "-o", tmp_path / "demo", "--frames", 0)
    assert "48by36" in refused("demo", "-o", tmp_path / "demo", "--size", "48by36")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


@pytest.mark.parametrize("how", ["folder", "pattern", "files"])
def test_denoise_is_the_pipeline(sequence, tmp_path, how):
    paths = [sequence / f"shot{i + 1}.exr" for i in range(12)]
    given = {"folder": [sequence], "pattern": [sequence / "shot*.exr"], "files": paths}[how]
    run("denoise", *given, "-o", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {path.name for path in paths}
    svgf = yester.SVGF()
    for path in paths:
        want = svgf.step(read_exr(path)).color
        np.testing.assert_array_equal(read_exr(tmp_path / "out" / path.name).color, want)


def test_denoise_options(sequence, tmp_path):
    given = "--alpha", 0.5, "--iterations", 2, "--feedback", "--no-choice", "--no-innovation", "--half"
    run("denoise", sequence, "-o", tmp_path / "out", *given)
    svgf = yester.SVGF(alpha=0.5, iterations=2, feedback=True, choice=False, innovation=False)
    for i in range(12):
        want = svgf.step(read_exr(sequence / f"shot{i + 1}.exr")).color.astype(np.float16)
        np.testing.assert_array_equal(read_exr(tmp_path / "out" / f"shot{i + 1}.exr").color, want)


METHODS = {
    "svgf": (yester.SVGF, {"alpha": 0.5}),
    "taa": (yester.TAA, {"preset": "denoised", "alpha": 0.3}),
    "bmfr": (yester.BMFR, {"alpha": 0.3, "block": 8, "features": "all"}),
    "halfres": (yester.HalfRes, {"alpha": 0.3, "iterations": 2}),
    "recirculation": (yester.Recirculation, {"innovation": False}),
    "oidn": (yester.OIDN, {"quality": "fast"}),
    "temporal-oidn": (partial(yester.OIDN, temporal=True), {"quality": "fast"}),
}


@pytest.mark.parametrize("lookahead", [None, 0])
@pytest.mark.parametrize("method", METHODS)
def test_every_method(tmp_path, method, lookahead):
    make, named = METHODS[method]
    given = [] if lookahead is None else ["--lookahead", lookahead]
    given += [text for name, value in named.items() for text in ((f"--{name}", value) if value else (f"--no-{name}",))]
    some = [tmp_path / f"shot{i + 1}.exr" for i in range(3)]
    for i, path in enumerate(some):
        color = noise(seed=i).color
        height, width, _ = color.shape
        camera = yester.Camera.from_look_at((0.1 * i, 0, 0), (0, 0, 1), (0, 1, 0), 60, width, height)
        write_exr(path, yester.Frame(color, depth=np.full((height, width), 2.0), camera=camera))
    run("denoise", *some, "-o", tmp_path / "out", "--method", method, *given)
    # A filter of single images does not use other frames.
    used = 0 if method == "oidn" else 3 if lookahead is None else lookahead
    for path, want in zip(some, yester.denoise(map(read_exr, some), make(**named), used), strict=True):
        np.testing.assert_array_equal(read_exr(tmp_path / "out" / path.name).color, want.color)


def test_shots_do_not_know_each_other(tmp_path):
    """Each shot is denoised from its own earlier and later frames alone."""
    camera = yester.Camera.from_look_at((0, 0, 0), (0, 0, 1), (0, 1, 0), 60, 32, 24)
    shots = [[tmp_path / f"{name}{i}.exr" for i in range(3)] for name in ("a", "b")]
    for seed, path in enumerate([*shots[0], *shots[1]]):
        write_exr(path, yester.Frame(noise(seed=seed).color, depth=np.full((24, 32), 2.0), camera=camera))
    assert "not the same shot" in run("denoise", *shots[0], *shots[1], "-o", tmp_path / "out").stderr
    for shot in shots:
        for path, want in zip(shot, yester.denoise(map(read_exr, shot)), strict=True):
            np.testing.assert_array_equal(read_exr(tmp_path / "out" / path.name).color, want.color)


@pytest.mark.parametrize(
    ("option", "value", "method", "of"),
    [
        ("--iterations", 2, "taa", "svgf, halfres"),
        ("--sigma-luminance", 3, "bmfr", "svgf, halfres"),
        ("--feedback", None, "bmfr", "svgf"),
        ("--choice", None, "bmfr", "svgf, halfres, temporal-oidn"),
        ("--innovation", None, "oidn", "svgf, taa, bmfr, halfres, recirculation, temporal-oidn"),
        ("--preset", "textbook", "svgf", "taa"),
        ("--block", 8, "svgf", "bmfr"),
        ("--features", "all", "taa", "bmfr"),
        ("--fireflies", None, "oidn", "svgf, taa, bmfr, halfres, recirculation, temporal-oidn"),
        ("--quality", "fast", "svgf", "oidn, temporal-oidn"),
        ("--alpha", 0.1, "oidn", "svgf, taa, bmfr, halfres"),
    ],
)
def test_options_of_other_methods_are_refused(sequence, tmp_path, option, value, method, of):
    out = tmp_path / "out"
    given = [option] if value is None else [option, value]
    line = refused("denoise", sequence, "-o", out, "--method", method, *given)
    assert line == f"yester: error: {option}: expected --method {of}, got {method}"
    assert not out.exists()


def test_the_first_option_of_another_method_is_named(sequence, tmp_path):
    """Not another one with every run, as the order of a set would have it."""
    given = [["--preset", "textbook"], ["--block", 8], ["--features", "all"], ["--quality", "fast"]]
    for first, second in combinations(given, 2):
        line = refused("denoise", sequence, "-o", tmp_path / "out", "--method", "svgf", *second, *first)
        assert f"{first[0]}: expected --method" in line


def test_points_need_places(sequence, tmp_path):
    out = tmp_path / "out"
    line = refused("denoise", sequence, "-o", out, "--method", "recirculation")
    assert line.startswith(f"yester: error: {sequence / 'shot1.exr'}: expected a camera, and depth or position")
    assert not out.exists()


def test_methods_refuse_before_work_starts(sequence, tmp_path):
    out = tmp_path / "out"
    line = refused("denoise", sequence, "-o", out, "--method", "svfg")
    assert all(name in line for name in ("--method", "svfg", *METHODS))
    for method, option, value in (
        ("bmfr", "block", 3),
        ("bmfr", "features", "some"),
        ("taa", "preset", "worst"),
        ("oidn", "quality", "best"),
    ):
        assert f"{option}: expected" in refused(
            "denoise", sequence, "-o", out, "--method", method, f"--{option}", value
        )
    bare = "import sys; sys.modules['mitsuba_oidn'] = None; from yester.cli import main; sys.exit(main(sys.argv[1:]))"
    result = run("denoise", sequence, "-o", out, "--method", "oidn", code=2, program=("-c", bare))
    assert "pip install 'yester[oidn]'" in result.stderr
    assert not out.exists()


def test_denoise_stops_at_a_corrupt_frame(sequence, tmp_path):
    """The damage is found only when the frame is decoded: earlier frames are written, and the process ends.

    With a plan, which looks at eight frames first, nothing is written.
    """
    damaged = sequence / "shot7.exr"
    write_exr(damaged, np.ones((24, 32, 3)))  # a constant, which is compressed, unlike noise
    damaged.write_bytes(damaged.read_bytes()[:-16] + bytes(16))
    # OpenEXR prints a message as well.
    given = "denoise", sequence, "-o", tmp_path / "out", "--method", "svgf", "--lookahead", 0
    said = run(*given, code=2).stderr
    assert f"yester: error: {damaged}: truncated or corrupt" in said.splitlines()[-1]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {f"shot{i + 1}.exr" for i in range(6)}
    svgf = yester.SVGF()
    for i in range(6):
        want = svgf.step(read_exr(sequence / f"shot{i + 1}.exr")).color
        np.testing.assert_array_equal(read_exr(tmp_path / "out" / f"shot{i + 1}.exr").color, want)


def test_denoise_stops_at_a_file_that_cannot_be_written(sequence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"

    def write(path, *frame, **named):
        if path.name == "shot3.exr":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        write_exr(path, *frame, **named)

    monkeypatch.setattr("yester.batch.write_exr", write)
    assert main(["denoise", str(sequence), "-o", str(out)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("yester: error: ")
    assert "shot3.exr" in said[-1]
    assert {path.name for path in out.iterdir() if path.is_file()} == {"shot1.exr", "shot2.exr"}
    for name in ("shot1.exr", "shot2.exr"):
        assert read_exr(out / name).shape == (24, 32)


def test_denoise_improves_a_scene_in_motion(tmp_path):
    (tmp_path / "noisy").mkdir()
    rng = np.random.default_rng(0)
    for i in range(10):
        shot = flight.shoot(i, 64, 48)
        noisy = flight.noisy(shot, rng)
        write_exr(tmp_path / "noisy" / f"{i}.exr", replace(shot, color=noisy, motion=None))
    run("denoise", tmp_path / "noisy", "-o", tmp_path / "out")
    denoised = read_exr(tmp_path / "out" / "9.exr").color
    assert np.mean((denoised - shot.color) ** 2) < 0.1 * np.mean((noisy - shot.color) ** 2)


@pytest.mark.long
def test_memory_does_not_grow_with_the_sequence(tmp_path):
    """Holding eight more frames of 10 MB each would show."""
    (tmp_path / "noisy").mkdir()
    frame = noise(480, 640, albedo=np.ones((480, 640, 3)), normal=np.ones((480, 640, 3)), depth=np.ones((480, 640)))
    write_exr(tmp_path / "noisy" / "0.exr", frame)
    # The noise of the frame before would cause a warning.
    write_exr(tmp_path / "noisy" / "1.exr", replace(frame, color=frame.color[::-1, ::-1]))
    for i in range(2, 20):
        os.link(tmp_path / "noisy" / f"{i % 2}.exr", tmp_path / "noisy" / f"{i}.exr")

    def peak(pattern):
        given = "denoise", tmp_path / "noisy" / pattern, "-o", tmp_path / "out", "--overwrite"
        out = run(*given, program=("-c", PEAK)).stdout
        return int(out.split()[-1]) / 1024

    peak("?.exr")
    assert peak("*.exr") < peak("?.exr") + 40


def test_denoise_refuses_before_work_starts(sequence, tmp_path):
    out = tmp_path / "out"
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("in the way")
    assert "empty" in refused("denoise", tmp_path / "empty", "-o", out)
    assert "nowhere" in refused("denoise", tmp_path / "nowhere", "-o", out)
    assert "cannot be written" in refused("denoise", sequence, "-o", tmp_path / "file" / "out")
    assert "overwrite" in refused("denoise", sequence, "-o", sequence)
    assert "alpha" in refused("denoise", sequence, "-o", out, "--alpha", 2)
    assert "iterations" in refused("denoise", sequence, "-o", out, "--iterations", 99)
    write_exr(sequence / "shot13.exr", noise(width=40))
    line = refused("denoise", sequence, "-o", out)
    assert "shot13.exr: 40 x 24" in line
    assert "32 x 24" in line
    write_exr(sequence / "shot13.exr", noise(albedo=np.ones((24, 32, 3))))
    assert "no albedo" in refused("denoise", sequence, "-o", out)
    whole = (sequence / "shot12.exr").read_bytes()
    (sequence / "shot13.exr").write_bytes(whole[: len(whole) // 2])
    assert "shot13.exr" in refused("denoise", sequence, "-o", out)
    (sequence / "shot13.exr").write_text("no image")
    assert "shot13.exr" in refused("denoise", sequence, "-o", out)
    assert not out.exists()


def test_empty_names_are_not_the_current_folder(sequence, tmp_path, monkeypatch):
    """Such as those of variables that are not set."""
    monkeypatch.chdir(sequence)
    before = {path.name: path.read_bytes() for path in sequence.iterdir()}
    assert "expected a name, got an empty one" in refused("denoise", sequence / "shot1.exr", "-o", "", "--overwrite")
    assert "got an empty name" in refused("denoise", "", "-o", tmp_path / "out")
    assert {path.name: path.read_bytes() for path in sequence.iterdir()} == before


def test_hidden_files_and_folders_are_no_frames(sequence, tmp_path):
    (sequence / "._shot1.exr").write_bytes(bytes(64))
    (sequence / "layers.exr").mkdir()
    run("denoise", sequence, "-o", tmp_path / "out")
    assert len(frames_of(tmp_path / "out")) == 12


def test_outputs_that_are_there_in_some_way_are_refused(sequence, tmp_path):
    out = tmp_path / "out"
    (out / "shot2.exr").mkdir(parents=True)
    assert "shot2.exr: is a folder" in refused("denoise", sequence, "-o", out, "--overwrite")
    (out / "shot2.exr").rmdir()
    (out / "shot2.exr").symlink_to(tmp_path / "offline" / "shot2.exr")
    assert "shot2.exr: exists already" in refused("denoise", sequence, "-o", out)
    assert (out / "shot2.exr").is_symlink()


def test_links_that_lead_nowhere_can_be_left_out(sequence, tmp_path):
    (sequence / "shot5.exr").unlink()
    (sequence / "shot5.exr").symlink_to(tmp_path / "offline.exr")
    assert "shot5.exr: not there" in refused("denoise", sequence, "-o", tmp_path / "out")
    run("denoise", sequence, "-o", tmp_path / "out", "--keep-going", code=1)
    assert len(frames_of(tmp_path / "out")) == 11


def test_temporary_files_of_running_processes_stay(sequence, tmp_path):
    """A second run of the same command does not take the first one's files away."""
    out, other = tmp_path / "out", subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    out.mkdir()
    with other:
        (out / f".shot1.exr.{other.pid}.tmp").touch()
        (out / ".shot2.exr.4194305.tmp").touch()  # more than any process has
        run("denoise", sequence, "-o", out, "--resume")
        assert [path.name for path in out.glob(".*")] == [f".shot1.exr.{other.pid}.tmp"]
        other.communicate(b"\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("stderr", [">/dev/full", "&-"])
def test_work_goes_on_when_messages_are_lost(sequence, tmp_path, stderr):
    redirected = f'exec "$@" 2{stderr if stderr.startswith(">") else ">" + stderr}'
    command = ["sh", "-c", redirected, "sh", sys.executable, "-m", "yester", "denoise", str(sequence)]
    assert subprocess.run([*command, "-o", str(tmp_path / "out")], timeout=300).returncode == 0
    assert len(frames_of(tmp_path / "out")) == 12


def test_output_that_nobody_reads(sequence):
    """Is no wrong input, for which the status is 2."""
    command = [sys.executable, "-m", "yester", "info", str(sequence / "shot1.exr")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (141, "")


def test_color_is_written_in_the_units_of_the_file(sequence, tmp_path):
    run("denoise", sequence, "-o", tmp_path / "plain", "--method", "oidn")
    run("denoise", sequence, "-o", tmp_path / "scaled", "--method", "oidn", "--map", "color.scale=2")
    for plain, scaled in zip(frames_of(tmp_path / "plain"), frames_of(tmp_path / "scaled"), strict=True):
        np.testing.assert_allclose(scaled.color, plain.color, rtol=0.05)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--lookahead", "1.5", "expected a whole number of at least 0, got 1.5"),
        ("--lookahead", "-1", "expected a whole number of at least 0, got -1"),
        ("--method=oidn", "--lookahead=3", "expected none with --method oidn"),
    ],
)
def test_wrong_numbers(sequence, tmp_path, option, value, words):
    assert words in refused("denoise", sequence, "-o", tmp_path / "out", option, value)


def test_info(tmp_path):
    camera = yester.Camera.from_look_at([0, 1, 5], [0, 1, 0], [0, 1, 0], 40, 32, 24)
    write_exr(tmp_path / "frame.exr", noise(depth=np.ones((24, 32)), camera=camera))
    text = run("info", tmp_path / "frame.exr").stdout
    assert "32 x 24" in text
    assert "depth.Z" in text
    assert "at (0, 1, 5), looks along (0, 0, -1)" in text
    missing = [line.split()[0] for line in text.partition("missing:")[2].splitlines() if line]
    assert missing == ["albedo", "normal", "motion", "ids", "position", "emission"]
    assert "none.exr" in refused("info", tmp_path / "none.exr")


def test_version_and_usage():
    assert run("--version").stdout.startswith(f"yester {yester.__version__} (")
    assert "demo" in run("--help").stdout
    refused()
    refused("nonsense")


def test_missing_extras_name_their_install_line(sequence, tmp_path):
    """With imports blocked, as where only the core is installed."""
    bare = "import sys; sys.modules['OpenEXR'] = None; from yester.cli import main; sys.exit(main(sys.argv[1:]))"
    result = run("denoise", sequence, "-o", tmp_path / "out", code=2, program=("-c", bare))
    assert "pip install 'yester[exr]'" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupted_run_leaves_whole_files(sequence, tmp_path):
    out = tmp_path / "out"
    for i in range(12, 400):
        os.link(sequence / "shot1.exr", sequence / f"shot{i + 1}.exr")
    command = [sys.executable, "-m", "yester", "denoise", str(sequence), "-o", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not (out.exists() and list(out.glob("*.exr"))):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "yester: interrupted"
    written = list(out.iterdir())
    assert 0 < len(written) < 400
    for path in written:
        assert path.suffix == ".exr"
        assert read_exr(path).shape == (24, 32)
