"""Tables of README and documentation are written from measurements, and match the stored ones."""

import csv
from itertools import product
from pathlib import Path
from statistics import mean

import pytest
from yester.study import pages
from yester.study.compare import ablation, harm, judging
from yester.study.compare.doors import FULL
from yester.study.rendered.sequences import FRESH, LATE, NAMES

ROOT = Path(__file__).parents[1]
DATA = ROOT / "docs" / "results" / "data"
METRICS = ("psnr", "relmse", "flip", "temporal_error")


def write_csv(path, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]], restval="")
        writer.writeheader()
        writer.writerows(rows)


def values(psnr, rest=0.1):
    return {"psnr": psnr, "relmse": rest, "flip": rest, "temporal_error": rest}


@pytest.fixture
def data(tmp_path):
    """Small measurements of every kind."""
    folder = tmp_path / "data"
    folder.mkdir()
    methods = {"noisy input": 10, "SVGF": 30, "SVGF, both sides": 32, "OIDN high": 29}
    points = [
        {
            "scene": scene,
            "method": name,
            "ms": 0 if name == "noisy input" else 5 + i,
            **values(psnr + i / 10),
            "timed": "",
        }
        for i, scene in enumerate((*NAMES, *LATE, "all"))
        for name, psnr in methods.items()
    ]
    write_csv(
        folder / "accuracy.csv", [p | {"timed": "" if p["method"] == "noisy input" else "1280x720"} for p in points]
    )
    between = "temporal OIDN high, both sides"
    scores = [
        {"scene": scene, "method": name, **values(psnr)}
        for scene in (*FRESH, "all")
        for name, psnr in ({**methods, between: 31}).items()
    ]
    write_csv(folder / "fresh.csv", scores)
    effects = []
    cases = [("grass", 1.0, 0.01), ("cut", -0.5, 0.01), ("mist", -0.5, 0.4), ("all", 0, "")]
    components = [("SVGF", "clip"), ("SVGF", "innovation"), ("TAA", "dilation")]
    for (pipeline, component), (scene, gain, error) in product(components, cases):
        case = {
            "scene": scene,
            "pipeline": pipeline,
            "component": component,
            "added": 0,
            "ms": 7.2,
            **values(gain),
            "door": FULL,
        }
        effects.append(case | {f"{key}_error": error for key in METRICS})
    write_csv(folder / "ablation.csv", effects)
    write_csv(folder / "ablation_with_less.csv", [effect | {"door": "no albedo"} for effect in effects])
    doors = [
        {"scene": scene, "method": "SVGF", "door": door, **values(psnr)}
        for scene, drop in (("grass", 1), ("cut", 3))
        for door, psnr in ((FULL, 30), ("no ids", 30 - drop), ("no normals", 29 + drop / 2))
    ]
    write_csv(folder / "doors.csv", doors)
    cases = [("still", "holds", ""), ("mirror", "fails", "blur 0.60"), ("light", "degrades", "lag 2")]
    trials = [
        {
            "part": "failures",
            "failure": "light that moves" if case == "light" else "others",
            "case": case,
            "method": method,
            "verdict": verdict,
            "reason": reason,
        }
        for case, verdict, reason in cases
        for method in ("SVGF", "TAA best")
    ]
    write_csv(folder / "stress.csv", trials)
    tasks = [task for _, task, *_ in pages._PIPELINES]
    times = [
        {"task": task, "contender": "yester", "threads": threads, "simd": "avx2", "ms": 20 / threads, "held_mb": 99.6}
        for task in tasks
        for threads in (2, 1)
    ]
    times += [{**times[0], "contender": "OIDN fast", "simd": "", "ms": 80, "held_mb": ""}]
    times += [{**times[0], "task": "splat", "held_mb": "", "copy_gb_per_s": 50.04, "giga_multiply_adds_per_s": 116.2}]
    write_csv(folder / "speed.csv", [{"copy_gb_per_s": "", "giga_multiply_adds_per_s": "", **one} for one in times])
    for name, source in pages.RUNS.items():
        if not source.made:
            (folder / f"{name}.txt").write_text(f"what {name} prints\n")
    return folder


def table(name, data):
    """The cells of a table."""
    lines = pages.TABLES[name](data).splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if not line.startswith("| ---")]


@pytest.mark.parametrize("name", pages.TABLES)
def test_tables(data, name):
    """Each table can be written; rows have as many cells as the head."""
    text = pages.TABLES[name](data)
    if text.startswith("|"):
        assert len({line.count("|") for line in text.splitlines()}) == 1
    else:
        assert text.startswith("```")


def test_contents_of_tables(data):
    assert table("methods", data)[1] == [
        *("**SVGF, both sides** (`yester denoise --method svgf`)", "31", "**34.60**", *["**0.1000**"] * 3)
    ]
    assert table("methods", data)[-1][:3] == ["noisy input", "", "12.60"]
    assert table("groups", data)[1][:3] == ["`tuning`", "SVGF, both sides", "32.20"]
    assert table("sequences", data)[1][1].startswith("**32.00** / **0.1000**")
    (_, row, _) = table("ablation", data)
    assert row[:2] == ["− clip", "+0.00 dB (−0.50 dB, `cut`)"]
    assert [row[0] for row in table("antialiasing", data)[1:]] == ["− dilation"]
    assert [row[:2] for row in table("innovation", data)[2:]] == [
        *(["`cut`", "−0.50 dB"], ["`mist`", "−0.50 dB"], ["mean", "+0.00 dB"])
    ]
    assert table("harms", data)[1:] == [[name, "`cut` (psnr -0.50 dB)"] for name in ("clip", "innovation")]
    assert table("harms_with_less", data)[1] == ["clip", "`cut` (psnr -0.50 dB)"]
    assert table("doors", data)[1] == ["no ids", "−2.00 dB (−3.00 dB, `cut`)", *["+0.0 % (+0.0 %, `grass`)"] * 3]
    assert table("methods_through_doors", data)[1] == ["no ids", "−2.00 dB (−3.00 dB, `cut`)"]
    assert table("harmful_buffers", data)[1:] == [["no normals", FULL, "`cut` (psnr -0.50 dB)"]]
    assert table("harmful_by_method", data)[1] == ["SVGF", "1", f"−0.50 dB (`cut`, {FULL})", "", "", ""]
    assert table("families", data)[1:] == [
        ["others", "0 / 0 / 0", "1 / 0 / 1", "0 / 0 / 0"],
        ["light that moves", "0 / 0 / 0", "0 / 1 / 0", "0 / 0 / 0"],
    ]
    assert table("stress", data)[1:] == [["SVGF", "1 / 1 / 1"], ["TAA best", "1 / 1 / 1"]]
    assert table("failures", data)[1:] == [["mirror", "fails: blur 0.60", "–"]]
    assert table("speed", data)[1] == ["SVGF", "10.0", "20.0", "", "100"]
    assert ["— OIDN fast", "80.0", "", "8.00", ""] in table("speed", data)
    assert table("machine", data)[1] == ["2 threads, avx2", "50.0", "116"]
    assert pages.TABLES["oracle"](data) == "```\nwhat oracle prints\n```"
    assert "yester chart --ablate" in pages.TABLES["command ablation"](data)


def test_the_best_is_chosen_by_value(tmp_path):
    """10 dB is more than 9 dB, and 2 less than 10, though as text they are not."""
    rows = [
        {"scene": "cut", "method": "one", **values(9.5, 2.0)},
        {"scene": "cut", "method": "other", **values(10.5, 10.0)},
    ]
    write_csv(tmp_path / "points.csv", rows)
    row = pages._each(tmp_path / "points.csv", ["cut"], ["one", "other"]).splitlines()[-1]
    better = " / ".join(["**2.0000**"] * 3)
    assert row == f"| `cut` | 9.50 / {better} | **10.50** / {' / '.join(['10.0000'] * 3)} |"


def test_write(data, tmp_path, capsys):
    """The text between the marks is replaced and nothing else; writing again changes nothing."""
    page = tmp_path / "page.md"
    page.write_text("before\n\n<!-- table: machine -->\nold\n<!-- end: machine -->\n\nafter\n")
    arguments = ["write", str(page), "--data", str(data)]
    assert pages.main([*arguments, "--check"]) == 1
    assert "old" in page.read_text()
    assert pages.main(arguments) == 0
    text = page.read_text()
    assert text.startswith("before\n\n<!-- table: machine -->\n| ")
    assert text.endswith(" |\n<!-- end: machine -->\n\nafter\n")
    assert "old" not in text
    assert pages.main([*arguments, "--check"]) == 0
    (data / "speed.csv").unlink()
    assert pages.write([page], data) == []
    capsys.readouterr()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- table: clouds -->\n<!-- end: clouds -->\n", "table: expected one of methods, .*, got clouds"),
        ("<!-- table: machine -->\n", "expected an end for each table"),
    ],
)
def test_bad_pages(data, tmp_path, text, message):
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(ValueError, match=message):
        pages.write([page], data)
    assert page.read_text() == text


def test_measure(tmp_path, monkeypatch, capfd):
    """Commands run, and their files and output are stored."""
    monkeypatch.setitem(pages.RUNS, "oracle", pages.Source("platform", ""))
    # A module that writes its arguments.
    (tmp_path / "staged.py").write_text(
        "import sys; print('case', 'still', sep='\\n', file=open(sys.argv[2] + '/stress.csv', 'w'))"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setitem(pages.RUNS, "stress", pages.Source("staged", "stress.csv"))
    with pytest.raises(SystemExit):
        pages.main(["measure", "clouds"])
    assert "NAME: expected some of accuracy" in capfd.readouterr().err
    assert pages.main(["measure", "oracle", "stress", "--data", str(tmp_path / "new")]) == 0
    assert (tmp_path / "new" / "oracle.txt").read_text().strip()
    assert {row["case"] for row in pages._rows(tmp_path / "new" / "stress.csv")} == {"still"}


def test_pages_are_of_the_measurements_that_are_kept():
    """`python -m yester.study.pages write README.md docs/results/*.md` changes nothing."""
    every = [ROOT / "README.md", *sorted((ROOT / "docs" / "results").glob("*.md"))]
    assert pages.write(every, DATA, check=True) == []


def test_methods_of_one_name_are_the_same():
    """Through the full door, each method has the accuracy that the method of that name has on the other page."""
    known = {(row["method"], row["scene"]): row for row in pages._rows(DATA / "accuracy.csv")}
    compared = set()
    for method, doors in pages._through_doors(DATA).items():
        for scene, runs in doors[FULL].items():
            if row := known.get((method, scene)):
                compared.add(method)
                for key in METRICS:
                    assert mean(run[key] for run in runs) == pytest.approx(float(row[key])), (method, scene)
    assert {"SVGF", "BMFR"} < compared


def test_exceptions_are_the_cases_that_are_made_good(monkeypatch):
    """With every buffer, no such case is without a reason, and no reason without its case."""
    listed = {*harm.EXCEPTIONS}
    monkeypatch.setattr(harm, "EXCEPTIONS", {})
    found = ablation.harms(pages._effects(DATA / "ablation.csv"))
    assert {(effect.name, effect.case) for effect, _, made_good in found if made_good} == listed


@pytest.mark.parametrize("name", ["plans", "stein", "halves"])
def test_every_component_of_svgf_is_judged(name):
    lines = (DATA / f"{name}.txt").read_text("utf-8").splitlines()
    assert {part.component for part in judging.PARTS} <= {line.split("  ")[0] for line in lines}


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 200
