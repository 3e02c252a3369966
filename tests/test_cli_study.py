"""The commands `chart` and `stress`, run in processes of their own."""

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import flight
import numpy as np
import pytest
import yester
from PIL import Image
from test_cli import noise, refused, run
from yester import cli
from yester.io import read_exr, write_exr
from yester.metrics import METRICS
from yester.study.compare.ablation import ABLATIONS
from yester.study.compare.doors import DOORS
from yester.study.compare.methods import METHODS, PIPELINES
from yester.study.rendered.sequences import GROUPS
from yester.study.synthetic.failures import SCENARIOS

pytestmark = pytest.mark.slow

#: Runs the command line with some modules blocked, as if they were not installed.
BARE = """
import sys
sys.modules.update(dict.fromkeys(sys.argv.pop(1).split(",")))
from yester.cli import main
sys.exit(main(sys.argv[1:]))
"""
TIMED = ("--time-size", "64x48")
LITTLE = ("--length", 4, "--size", "32x24", "--reference-spp", 4, *TIMED)
QUICK = ("--metrics", "psnr", "warped_error", "--methods", "SVGF, 6", "TAA best", "--no-peers", *TIMED)
ALONE = "no references: only speed and the change along motion are measured"


def without(modules, *arguments, code=0):
    return run(modules, *arguments, code=code, program=("-c", BARE))


def interrupted(*arguments, until):
    """Send SIGINT to all processes of the command, as a terminal's Ctrl-C does, once a condition holds."""
    command = [sys.executable, "-m", "yester", *map(str, arguments)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as process:
        while not until():
            assert process.poll() is None, process.communicate()
            time.sleep(1e-3)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "yester: interrupted\n")


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def files(folder):
    """All files, hidden ones too; each is read to see that it is complete."""
    found = {path for path in folder.rglob("*") if path.is_file()}
    for path in found:
        match path.suffix:
            case ".exr":
                read_exr(path)
            case ".png" | ".webp":
                with Image.open(path) as image:
                    image.load()
            case ".json":
                json.loads(path.read_text())
            case suffix:
                assert suffix in (".csv", ".html", ".md", ".svg"), path
                assert path.stat().st_size > 0
    return found


def ages(folder, pattern):
    return {path: path.stat().st_mtime_ns for path in folder.rglob(pattern)}


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Frames and references of the synthetic scene, under a user's own names."""
    folder = tmp_path_factory.mktemp("own")
    rng = np.random.default_rng(0)
    for kind in ("shot", "truth"):
        (folder / kind).mkdir()
    for i in range(4):
        shot = flight.shoot(i, 32, 24)
        write_exr(folder / "shot" / f"frame{i}.exr", replace(shot, color=flight.noisy(shot, rng), motion=None))
        write_exr(folder / "truth" / f"clean{i}.exr", shot.color)
    return folder


# Chart


def test_chart(tmp_path):
    out = tmp_path / "new" / "out"
    arguments = ("--sequences", "cornell_box", *LITTLE, "--cache", tmp_path / "cache", *QUICK)
    result = run("chart", *arguments, "-o", out)
    assert result.stderr == ""
    best = ("TAA best", "TAA best, both sides", *(f"TAA best, alpha {a}" for a in (0.03, 0.1, 0.3)))
    names = ["noisy input", "SVGF, 6 distances", *best]
    rows = table(out / "points.csv")
    assert [row["method"] for row in rows] == names
    assert {row["scene"] for row in rows} == {"cornell_box"}
    for row in rows:
        assert [key for key in METRICS if row[key]] == ["psnr", "warped_error"]
    assert float(rows[1]["psnr"]) > float(rows[0]["psnr"]) + 1
    assert float(rows[1]["warped_error"]) < 0.5 * float(rows[0]["warped_error"])
    head, *lines, report, points = result.stdout.splitlines()
    assert head.split() == ["ms", "psnr", "warped_error"]
    for row, line in zip(rows, lines, strict=True):
        assert line.startswith(row["method"])
        assert f"{float(row['psnr']):.4f}" in line
    assert (report, points) == (str(out / "report.html"), str(out / "points.csv"))
    figures = {f"{key}_cornell_box.{kind}" for key in ("psnr", "warped_error") for kind in ("png", "svg")}
    assert {path.name for path in out.iterdir()} == {"points", "points.csv", "report.html", *figures}
    text = (out / "report.html").read_text()
    assert all(name in text for name in (*names, f"yester {yester.__version__}"))
    assert len(list((tmp_path / "cache").rglob("*.exr"))) == 4 + 2
    files(tmp_path)


def test_chart_of_own_files(own, tmp_path):
    """In any order on the command line, and without the renderer."""
    arguments = ("-o", tmp_path, *QUICK, own / "shot", "--references", own / "truth")
    result = without("mitsuba", "chart", *arguments)
    assert result.stderr == ""
    noisy, svgf, *_ = table(tmp_path / "points.csv")
    assert (noisy["scene"], noisy["ms"], svgf["method"]) == ("shot", "0.0", "SVGF, 6 distances")
    assert float(svgf["psnr"]) > float(noisy["psnr"]) + 1
    files(tmp_path)


def test_chart_without_references(own, tmp_path):
    """Metrics that need a reference are left out, with a message."""
    result = run("chart", own / "shot", "--no-peers", "--methods", "TAA textbook", *TIMED, "-o", tmp_path)
    assert result.stderr.splitlines() == [ALONE]
    for row in table(tmp_path / "points.csv"):
        assert [key for key in METRICS if row[key]] == ["warped_error"]
    assert {path.name for path in tmp_path.glob("*.png")} == {"warped_error_shot.png"}
    files(tmp_path)


def test_chart_of_colour_alone(tmp_path):
    """Only time can be measured."""
    (tmp_path / "plain").mkdir()
    for i in range(2):
        write_exr(tmp_path / "plain" / f"{i}.exr", noise(seed=i))
    result = run("chart", tmp_path / "plain", *QUICK, "-o", tmp_path / "out")
    alone, warning = result.stderr.splitlines()
    assert alone == ALONE
    assert warning.startswith("warning: frames: later frames are not used")
    assert result.stdout.split()[:3] == ["ms", "noisy", "input"]
    rows = table(tmp_path / "out" / "points.csv")
    assert not any(row[key] for row in rows for key in METRICS)
    assert all(float(row["ms"]) > 0 for row in rows[1:])
    files(tmp_path)


@pytest.mark.parametrize("name", ["report.html", "points.csv", "psnr_shot.png", "warped_error_shot.svg"])
def test_a_chart_replaces_nothing(own, tmp_path, name):
    """Unless told so: no figure either."""
    (tmp_path / name).write_text("mine")
    line = refused("chart", own / "shot", "--references", own / "truth", *QUICK, "-o", tmp_path)
    assert line.endswith(f"{tmp_path / name}: exists already: --overwrite replaces")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.long
@pytest.mark.parametrize("bare", [False, True])
def test_ablation(own, tmp_path, bare):
    given = () if bare else ("--references", own / "truth", "--metrics", "psnr", "relmse")
    result = run("chart", own / "shot", *given, "--ablate", *TIMED, "-o", tmp_path)
    keys = ["warped_error"] if bare else ["psnr", "relmse"]
    assert result.stderr.splitlines() == [ALONE] * bare
    head, *lines = result.stdout.splitlines()
    assert head.split() == [*keys, "costs", "ms"]
    names = [each.method.name for each in ABLATIONS]
    assert all(line.startswith(name) for line, name in zip(lines, names, strict=False))
    blank, *judged, written = lines[len(names) :] if not bare else ["", *lines[len(names) :]]
    assert blank == ""
    if bare:
        assert judged == []
    else:
        # A value as the file has it where a component does harm.
        defaults = {(each.whole.name, each.component) for each in ABLATIONS if each.whole.default and not each.added}
        bad = [
            (row["pipeline"], row["component"])
            for row in table(tmp_path / "ablation.csv")
            if float(row["psnr"]) < -0.1 or float(row["relmse"]) < -0.02
        ]
        assert judged[0] == f"cases of harm: {len(defaults.intersection(bad))}"
        assert len(judged) == 1 + len(defaults.intersection(bad))
    assert written == str(tmp_path / "ablation.csv")
    rows = table(tmp_path / "ablation.csv")
    assert list(rows[0])[4:] == ["ms", *keys, "door", *(f"{key}_error" for key in keys)]
    assert [row["component"] for row in rows] == [each.component for each in ABLATIONS]
    assert all(row[key] for row in rows for key in keys)
    assert {path.name for path in tmp_path.iterdir()} == {"ablation", "ablation.csv"}
    files(tmp_path)


@pytest.mark.long
def test_doors(tmp_path):
    """The default pipelines through all doors, or through those named; with --ablate, all components."""
    given = ("--sequences", "grass", "cut", *LITTLE, "--cache", tmp_path / "cache", "--no-peers", "--metrics", "psnr")
    result = run("chart", *given, "--doors", "-o", tmp_path / "all")
    assert result.stderr == ""
    head, *lines = result.stdout.splitlines()
    assert head.split() == ["psnr"]
    poor = [door.name for door in DOORS[1:]]
    entering = ("SVGF", "BMFR", "TAA best", "SVGF, both sides", "HalfRes, a quarter traced")
    names = [f"{method}, {door}" for method in entering for door in poor]
    assert all(line.startswith(name) for line, name in zip(lines, names, strict=False))
    blank, count, *cases, written = lines[len(names) :]
    assert (blank, count, written) == ("", f"cases of harm: {len(cases)}", str(tmp_path / "all" / "doors.csv"))
    rows = table(tmp_path / "all" / "doors.csv")
    assert len(rows) == 2 * len(entering) * len(DOORS)
    assert {row["scene"] for row in rows} == {"grass", "cut"}
    assert all(row["psnr"] for row in rows)
    files(tmp_path)

    result = run("chart", *given, "--doors", "no ids", "--methods", "TAA textbook, alpha 0.1", "-o", tmp_path / "one")
    assert result.stdout.splitlines()[1].startswith("TAA textbook, alpha 0.1, no ids")
    assert len(table(tmp_path / "one" / "doors.csv")) == 2 * 2

    result = run("chart", *given, "--ablate", "--doors", "no ids", "-o", tmp_path / "ablated")
    rows = table(tmp_path / "ablated" / "ablation.csv")
    assert {row["door"] for row in rows} == {"no ids"}
    assert {row["added"] for row in rows} == {"0"}
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("SVGF - id test and weight")]
    assert "+0.00 dB ( 0) +0.00 dB grass" in line
    line = refused("chart", tmp_path, "--doors", "raw albedo", "-o", tmp_path / "bad")
    assert "--doors: expected none of raw albedo with FRAMES" in line
    line = refused("chart", *given, "--doors", "no idols", "-o", tmp_path / "bad")
    assert all(name in line for name in ("--doors", "no idols", *poor))
    assert not (tmp_path / "bad").exists()


def test_groups(tmp_path):
    """Each group of sequences has a name."""
    line = refused("chart", "--sequences", "unkind", "-o", tmp_path / "out")
    assert all(
        f"{group}," in line
        for group in ("tuning", "unkind-tuning", "unkind-held-out", "late-held-out", "fresh-held-out", "thin", "all")
    )
    assert all(name in line for group in GROUPS.values() for name in group)
    some = [group[0] for group in GROUPS.values()]
    options = argparse.Namespace(frames=[], sequences=["unkind-tuning", "cut", "grass", *some], cache=None)
    vars(options).update(size=(8, 6), length=1, reference_spp=1, seeds=1, doors=None, map=None, view=None)
    asked = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yester.study.rendered.recording.record", lambda name, *_, **__: asked.append(name))
        for make in cli.studies._recordings(options).values():
            make()
    assert asked == [*dict.fromkeys([*GROUPS["unkind-tuning"], "cut", *some])]


@pytest.mark.parametrize(
    ("modules", "absent", "there"),
    [
        ("mitsuba_oidn,torch", ["Open Image Denoise", "SVGF in torch"], ["guided filter, 4 px", "guided filter, 8 px"]),
        ("mitsuba_oidn,cv2,torch", ["Open Image Denoise", "OpenCV with ximgproc", "SVGF in torch"], []),
    ],
)
def test_missing_peers_are_named(own, tmp_path, modules, absent, there):
    """The other methods are charted."""
    arguments = ("chart", own / "shot", "--references", own / "truth", "--metrics", "psnr", *TIMED, "-o", tmp_path)
    methods = ("--methods", "TAA textbook, alpha 0.1", *there)
    result = without(modules, *arguments, *methods)
    lines = result.stderr.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [["not installed", name] for name in absent]
    assert all("pip install 'yester[" in line for line in lines)
    assert [row["method"] for row in table(tmp_path / "points.csv")][1:] == list(methods[1:])


def test_chart_refuses_before_work_starts(own, tmp_path, monkeypatch):
    out = tmp_path / "out"
    monkeypatch.setenv("YESTER_CACHE", str(tmp_path / "cache"))
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "empty").mkdir()
    (tmp_path / "wide").mkdir()
    (tmp_path / "few").mkdir()
    for i in range(4):
        write_exr(tmp_path / "wide" / f"{i}.exr", noise(width=40))
    for i in range(3):
        write_exr(tmp_path / "few" / f"{i}.exr", noise())
    there = {path.name for path in tmp_path.iterdir()}

    def chart(*arguments):
        return refused("chart", *arguments, "--no-peers", "-o", out)

    assert all(name in chart("--metrics", "psnr", "pnsr") for name in ("--metrics", "pnsr", "warped_error"))
    line = chart(*LITTLE, "--methods", "SVGF", "svfg")
    assert all(name in line for name in ("--methods", "got svfg", *(method.name for method in METHODS)))
    line = chart(*LITTLE, "--sequences", "tuning", "cornell")
    assert all(name in line for name in ("--sequences", "got cornell", "held-out", "cornell_box"))
    assert "--references: expected FRAMES" in chart("--references", own / "truth")
    assert "--methods" in chart(own / "shot", "--ablate", "--methods", "SVGF")
    assert "--metrics" in chart(own / "shot", "--metrics", "psnr", "relmse")
    assert "--length" in chart("--length", 0)
    assert "32by24" in chart("--size", "32by24")
    assert "--reference-spp" in chart("--reference-spp", "many")
    assert "nowhere" in chart(tmp_path / "nowhere")
    assert "empty: no EXR files" in chart(tmp_path / "empty")
    assert "file: not an EXR file" in chart(tmp_path / "file")
    line = chart(own / "shot", "--references", tmp_path / "wide")
    assert all(part in line for part in (str(tmp_path / "wide" / "0.exr"), "40 x 24", "32 x 24"))
    line = chart(own / "shot", "--references", tmp_path / "few")
    assert "references: expected one for each of 4 frames, got 3" in line
    assert "nowhere" in chart(own / "shot", "--references", tmp_path / "nowhere")
    assert "0.exr: 40 x 24, but " in chart(own / "shot", tmp_path / "wide")
    for option in (
        ("--sequences", "all"),
        ("--length", 4),
        ("--size", "32x24"),
        ("--reference-spp", 4),
        ("--seeds", 1),
    ):
        assert f"{option[0]}: expected no FRAMES beside it" in chart(own / "shot", *option)
    assert "--cache: expected no FRAMES beside it" in chart(own / "shot", "--cache", tmp_path / "cache")
    assert {path.name for path in tmp_path.iterdir()} == there


def test_places_that_cannot_be_written(tmp_path):
    """Refused before anything is rendered or staged."""
    (tmp_path / "file").write_text("in the way")
    place, cache = tmp_path / "file" / "here", tmp_path / "cache"
    assert f"{place}: cannot be written" in refused("chart", *LITTLE, *QUICK, "--cache", cache, "-o", place)
    assert f"{place}: cannot be written" in refused("chart", *LITTLE, *QUICK, "--cache", place, "-o", tmp_path / "out")
    assert f"{place}: cannot be written" in refused("stress", "--quick", "-o", place)
    assert (tmp_path / "file").read_text() == "in the way"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / "file"]


def test_missing_extras_name_their_install_line(tmp_path):
    for modules in ("skimage", "mitsuba"):
        result = without(modules, "chart", "-o", tmp_path / "out", code=2)
        assert result.stderr == f"yester: error: {modules} not installed: pip install 'yester[study]'\n"
    assert "pip install 'yester[study]'" in without("PIL", "stress", "-o", tmp_path / "out", code=2).stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupted_chart_goes_on(tmp_path):
    """Interrupted while it renders, and while it measures; finished work is not repeated."""
    out, cache = tmp_path / "out", tmp_path / "cache"
    arguments = ("chart", "--sequences", "cornell_box", "tapestry", "--length", 8, "--size", "32x24")
    arguments += ("--reference-spp", 16, "--metrics", "psnr", "--methods", "SVGF", "--no-peers", *TIMED)
    arguments += ("--cache", cache, "-o", out)

    interrupted(*arguments, until=lambda: [*cache.rglob("*.exr")])
    files(tmp_path)
    rendered = ages(cache, "*.exr")
    assert 0 < len(rendered) < 2 * (8 + 4)

    interrupted(*arguments, until=(out / "points" / "tapestry").exists)
    files(tmp_path)
    assert {path.name for path in out.iterdir()} == {"points"}
    assert [path.parent.name for path in out.rglob("points.json")] == ["cornell_box"]
    measured = ages(out / "points" / "cornell_box", "*")
    assert ages(cache, "*.exr").items() > rendered.items()
    rendered = ages(cache, "*.exr")
    assert len(rendered) == 2 * (8 + 4)

    text = run(*arguments).stdout
    files(tmp_path)
    assert ages(cache, "*.exr") == rendered
    assert ages(out / "points" / "cornell_box", "*") == measured
    rows = table(out / "points.csv")
    assert list(dict.fromkeys(row["scene"] for row in rows)) == ["cornell_box", "tapestry", "all"]
    # The means are printed.
    assert f"{float(rows[-1]['psnr']):.4f}" in text.splitlines()[-3]


# Stress


def test_stress(tmp_path):
    out = tmp_path / "new" / "out"
    names = ("cut", "light goes off")
    result = run("stress", "--quick", "--scenarios", *names, "--methods", "SVGF", "-o", out)
    assert result.stderr == ""
    head, _, *cells = [line.split("|")[1:-1] for line in result.stdout.splitlines() if line.startswith("|")]
    assert [cell.strip() for cell in head] == ["failures", "input", "SVGF"]
    assert [row[0].strip() for row in cells] == list(names)
    assert all(row[1].strip().endswith(" dB") for row in cells)
    assert result.stdout.splitlines()[-3:] == [str(out / name) for name in ("stress.md", "stress.csv", "worst")]
    rows = table(out / "stress.csv")
    assert [(row["case"], row["method"]) for row in rows] == [(name, by) for name in names for by in ("input", "SVGF")]
    for row, cell in zip(rows[1::2], cells, strict=True):
        assert cell[2].strip().startswith(row["verdict"])
        assert float(row["relmse"]) > 0
    table_of_verdicts = result.stdout.partition("\n\n")[0]
    assert table_of_verdicts in (out / "stress.md").read_text()
    assert {path.name for path in (out / "worst").iterdir()} == {"cut-svgf.png", "light-goes-off-svgf.png"}
    files(tmp_path)


def test_a_stress_report_is_replaced_only_if_told(tmp_path):
    """Then, no picture of the earlier run stays."""
    given = ("stress", "--quick", "--scenarios", "cut", "--methods", "SVGF", "-o", tmp_path)
    stale = tmp_path / "worst" / "cut-taa-best.png"
    stale.parent.mkdir()
    for path in (tmp_path / "stress.csv", stale):
        path.write_text("mine")
        assert f"{path}: exists already: --overwrite replaces" in refused(*given)
        assert path.read_text() == "mine"
    run(*given, "--overwrite")
    assert [path.name for path in stale.parent.iterdir()] == ["cut-svgf.png"]
    files(tmp_path)


def test_stress_refuses_before_work_starts(tmp_path):
    def stress(*arguments):
        return refused("stress", "-o", tmp_path / "out", *arguments)

    line = stress("--scenarios", "cut", "cat")
    assert all(name in line for name in ("scenarios", "'cat'", *(scenario.name for scenario in SCENARIOS)))
    line = stress("--methods", "SVGF", "svfg")
    assert all(name in line for name in ("methods", "'svfg'", *(method.name for method in PIPELINES)))
    assert "endurance: expected 0 or at least 100, got 50" in stress("--endurance", 50)
    assert "--endurance" in stress("--endurance", "long")
    assert not [*tmp_path.iterdir()]


@pytest.mark.usefixtures("ctrl_c")
def test_an_interrupted_stress_leaves_whole_files(tmp_path):
    interrupted("stress", "--quick", "--methods", "SVGF", "-o", tmp_path, until=lambda: [*tmp_path.rglob("*.png")])
    assert 0 < len(files(tmp_path)) < len(SCENARIOS)
    assert [path.name for path in tmp_path.iterdir()] == ["worst"]
