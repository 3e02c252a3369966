"""Generates the tables of README and documentation: `measure` runs the measurements, `write` inserts the tables.

In a page, ``<!-- table: NAME -->`` and ``<!-- end: NAME -->`` enclose one of `TABLES`; the text between them is
replaced. Measurements are files in a folder, each written by the command of its name in `RUNS`.
"""

from __future__ import annotations

import argparse
import csv
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from yester.io.files import beside

from .compare import ablation as components
from .compare import harm
from .compare.ablation import Effect
from .compare.doors import DOORS, FULL
from .compare.points import ALL
from .rendered.sequences import FRESH, GROUPS, LATE, NAMES

__all__ = ["RUNS", "TABLES", "Source", "main", "measure", "write"]

#: The frames on which accuracy is measured: small, so that all sequences take minutes; three realisations of the noise.
_SIZE = "--size 128x96 --length 12 --reference-spp 256 --seeds 3"
_FRAMES = f"--sequences all late-held-out {_SIZE}"
_METRICS = "--metrics psnr relmse flip temporal_error"


class Source(NamedTuple):
    """The command that makes a measurement.

    Attributes
    ----------
    command : str
        Arguments of ``python -m``.
    made : str
        The file that it writes into the folder given by ``-o``; empty if it prints the result.
    """

    command: str
    made: str


#: By name of the file in the folder of measurements, without its suffix.
RUNS = {
    "accuracy": Source(f"yester chart {_FRAMES} {_METRICS}", "points.csv"),
    "fresh": Source(f"yester chart --sequences fresh-held-out {_SIZE} {_METRICS}", "points.csv"),
    "ablation": Source(f"yester chart --ablate {_FRAMES}", "ablation.csv"),
    "ablation_with_less": Source(f"yester chart --ablate --doors 'motion alone' {_FRAMES}", "ablation.csv"),
    "doors": Source(f"yester chart --doors {_FRAMES}", "doors.csv"),
    "oracle": Source("yester.study.compare.oracle", ""),
    "samples": Source("yester.study.compare.samples --reference-spp 256", ""),
    "larger": Source("yester.study.compare.larger", ""),
    "thin": Source("yester.study.compare.thin", ""),
    "repeated": Source("yester.study.compare.repeated", ""),
    "faded": Source("yester.study.compare.faded", ""),
    "energy": Source("yester.study.compare.energy", ""),
    "trust": Source("yester.study.compare.trust", ""),
    "still": Source("yester.study.compare.still", ""),
    "plans": Source("yester.study.compare.judging --sequences all late-held-out", ""),
    "stein": Source("yester.study.compare.stein --sequences all late-held-out", ""),
    "halves": Source("yester.study.compare.halves --sequences all late-held-out", ""),
    "later_frames": Source(
        "yester.study.compare.lookahead --sequences all late-held-out --size 128x96 --references 8 9 10 11", ""
    ),
    "stress": Source("yester stress --endurance 2000", "stress.csv"),
    "speed": Source("yester bench --sizes 1920x1080 --threads 2 1 --simd avx512", "bench.csv"),
}

#: The methods between which users choose: name in the tables, and in the chart.
_METHODS = {
    "**SVGF, both sides** (`yester denoise --method svgf`)": "SVGF, both sides",
    "**SVGF**": "SVGF",
    "BMFR": "BMFR",
    "TAA": "TAA best",
    "Open Image Denoise, fast": "OIDN fast",
    "Open Image Denoise, high": "OIDN high",
    "Open Image Denoise, high, between temporal stages": "temporal OIDN high",
    "the same, both sides": "temporal OIDN high, both sides",
    "OpenCV, joint bilateral filter": "joint bilateral, 8 px",
    "OpenCV, guided filter": "guided filter, 4 px",
    "OpenCV, non-local means": "non-local means, h 0.2",
    "noisy input": "noisy input",
}
#: Pipelines: name, task of the benchmark, most useful buffers, purpose, failures.
_PIPELINES = (
    (
        "SVGF",
        "SVGF",
        "every buffer; none is required",
        "path-traced sequences",
        "mirrors blur; noisy moving shadows lag",
    ),
    ("HalfRes", "HalfRes", "depth, normals", "one pixel of each 2×2 traced", "highlights that few samples hit"),
    ("BMFR", "BMFR", "normals, depth or position", "diffuse light, few samples", "reflections, edges of shadows"),
    ("OIDN", "OIDN, temporal", "albedo, normals", "stills; with `temporal=True`, sequences", "time; history that lags"),
    ("TAA", "TAA", "motion", "frames without noise", "noise: it darkens and flickers"),
    ("Upscaler", "Upscaler, 2", "jitter, motion", "frames of half the size", "noise; features thinner than a pixel"),
    (
        "Recirculation",
        "Recirculation, of all",
        "camera, and depth or position (required)",
        "a few traced pixels a frame",
        "light that changes",
    ),
)
_LABELS = {"psnr": "PSNR, dB", "relmse": "relMSE", "flip": "FLIP", "temporal_error": "temporal error"}
_BETTER = {"psnr": max, "relmse": min, "flip": min, "temporal_error": min}

Row = dict[str, str]


def methods(folder: Path) -> str:
    """The methods between which users choose: means over all sequences, and time per frame."""
    points = {row["method"]: row for row in _rows(folder / "accuracy.csv") if row["scene"] == ALL}
    rows = []
    for label, name in _METHODS.items():
        if point := points.get(name):
            time = "" if float(point["ms"]) == 0 else f"{float(point['ms']):.0f}"
            rows.append([label, time, *(_value(key, float(point[key])) for key in _LABELS)])
    timed = next(row["timed"] for row in points.values() if row["timed"])
    return _table(["", f"ms at {timed.replace('x', '×')}", *_LABELS.values()], _best(rows, 2))


def variants(folder: Path) -> str:
    """Every method and parameter: means over all sequences, and time per frame."""
    points = [row for row in _rows(folder / "accuracy.csv") if row["scene"] == ALL]
    rows = [
        [row["method"], f"{float(row['ms']):.0f}", *(_value(key, float(row[key])) for key in _LABELS)]
        for row in points
        if row["timed"]
    ]
    return _table(["", "ms", *_LABELS.values()], _best(rows, 2))


def groups(folder: Path) -> str:
    """Means over each group of sequences."""
    rows = []
    for group, scenes in GROUPS.items():
        if group != ALL and {*scenes} <= {*NAMES, *LATE}:
            for label in ("SVGF, both sides", "SVGF", "OIDN high"):
                rows.append(
                    [
                        f"`{group}`" if label == "SVGF, both sides" else "",
                        label,
                        *_means(folder / "accuracy.csv", label, scenes),
                    ]
                )
    return _table(["sequences", "", *_LABELS.values()], rows)


def sequences(folder: Path) -> str:
    """Every sequence: PSNR, relMSE, FLIP and temporal error of three methods."""
    return _each(folder / "accuracy.csv", (*NAMES, *LATE), ("SVGF, both sides", "SVGF", "OIDN high"))


def fresh(folder: Path) -> str:
    """The same of the sequences made last, with Open Image Denoise between temporal stages beside."""
    names = ("SVGF, both sides", "SVGF", "OIDN high", "temporal OIDN high, both sides")
    return _each(folder / "fresh.csv", (*FRESH, ALL), names)


def _each(file: Path, scenes: Iterable[str], names: Sequence[str]) -> str:
    rows = []
    for scene in scenes:
        cells = [_means(file, name, [scene]) for name in names]
        best = [_BETTER[key]((row[i] for row in cells), key=float) for i, key in enumerate(_LABELS)]
        marked = [[f"**{c}**" if c == b else c for c, b in zip(row, best, strict=True)] for row in cells]
        rows.append([f"`{scene}`" if scene != ALL else "mean", *(" / ".join(row) for row in marked)])
    return _table([" / ".join(_LABELS.values()), *names], rows)


def ablation(folder: Path, pipeline: str = "SVGF") -> str:
    """The components of SVGF: mean gain, worst case and cost."""
    found: dict[str, dict[str, Row]] = {}
    for row in _rows(folder / "ablation.csv"):
        if row["scene"] != ALL and row["door"] == FULL and row["pipeline"] == pipeline:
            found.setdefault(_component(row), {})[row["scene"]] = row
    rows = []
    for name, cases in found.items():
        cells = []
        gained = {scene: {key: float(row[key]) for key in _LABELS} for scene, row in cases.items()}
        cells += [_mean_and_worst(key, gained) for key in _LABELS]
        ms = next(iter(cases.values()))["ms"]
        cells.append(ms and f"{float(ms):.0f}")
        rows.append([name, *cells])
    return _table(["", *_LABELS.values(), "ms at 1280×720"], rows)


def antialiasing(folder: Path) -> str:
    """The components of TAA, on noisy frames."""
    return ablation(folder, "TAA")


def innovation(folder: Path) -> str:
    """What innovation gives SVGF on each sequence."""
    rows = [
        [f"`{row['scene']}`" if row["scene"] != ALL else "mean", *(_amount(key, float(row[key])) for key in _LABELS)]
        for row in _rows(folder / "ablation.csv")
        if (row["pipeline"], row["component"], row["door"]) == ("SVGF", "innovation", FULL)
    ]
    return _table(["", *_LABELS.values()], rows)


def harms(folder: Path) -> str:
    """Components that are on by default and do harm, beyond the limits and two standard errors, with the sequences.

    Marked are losses that are made good in another metric. Left out are exceptions, and `TAA`, which is not meant for
    such frames.
    """
    return _harms(folder / "ablation.csv")


def harms_with_less(folder: Path) -> str:
    """The same for frames with fewer buffers."""
    return _harms(folder / "ablation_with_less.csv")


def _effects(file: Path) -> list[Effect]:
    """The gains of components on single sequences, except those of `TAA`."""
    return [
        Effect(
            row["scene"],
            row["pipeline"],
            row["component"],
            row["added"] == "1",
            {key: float(row[key]) for key in _LABELS},
            0.0,
            row["door"],
            errors={key: float(row[f"{key}_error"]) for key in _LABELS if row[f"{key}_error"]},
        )
        for row in _rows(file)
        if row["pipeline"] != "TAA" and row["scene"] != ALL
    ]


def _harms(file: Path) -> str:
    found: dict[str, list[str]] = {}
    for effect, losses, made_good in components.harms(_effects(file)):
        name = effect.name.removeprefix("SVGF - ").replace(" - ", ": ")
        found.setdefault(name, []).append(f"`{effect.scene}` ({losses}{', made good' if made_good else ''})")
    return _table(["component", "sequences"], [[name, "; ".join(found[name])] for name in sorted(found)])


def _through_doors(folder: Path) -> dict[str, dict[str, dict[str, list[dict[str, float]]]]]:
    """The metrics by method, door and sequence, for each realisation of the noise."""
    values: dict[str, dict[str, dict[str, list[dict[str, float]]]]] = {}
    for row in _rows(folder / "doors.csv"):
        known = {key: float(row[key]) for key in _LABELS}
        values.setdefault(row["method"], {}).setdefault(row["door"], {}).setdefault(row["scene"], []).append(known)
    return values


def _mean_and_worst(key: str, gained: Mapping[str, Mapping[str, float]]) -> str:
    """The mean gain in a metric over sequences, and the least with its sequence."""
    values = {scene: one[key] for scene, one in gained.items()}
    worst = min(values, key=lambda scene: values[scene])
    mean = float(np.mean([*values.values()]))
    return f"{_amount(key, mean)} ({_amount(key, values[worst])}, `{worst}`)"


def doors(folder: Path) -> str:
    """The loss of SVGF through poor doors: mean over sequences, and the worst case of each metric."""
    values, rows = _through_doors(folder)["SVGF"], []
    for door, scenes in values.items():
        if door != FULL:
            gained = {scene: harm.mean_gains(runs, values[FULL][scene])[0] for scene, runs in scenes.items()}
            rows.append([door, *(_mean_and_worst(key, gained) for key in _LABELS)])
    return _table(["", *_LABELS.values()], rows)


def methods_through_doors(folder: Path) -> str:
    """The loss in PSNR of each method through poor doors: mean over sequences, and the worst case."""
    values = _through_doors(folder)
    names = [door.name for door in DOORS[1:] if all(door.name in known for known in values.values())]
    rows = []
    for name in names:
        cells = []
        for known in values.values():
            gained = {scene: harm.mean_gains(runs, known[FULL][scene])[0] for scene, runs in known[name].items()}
            cells.append(_mean_and_worst("psnr", gained))
        rows.append([name, *cells])
    return _table(["", *values], rows)


def _harmful(
    values: Mapping[str, Mapping[str, list[dict[str, float]]]],
) -> Iterator[tuple[str, str, str, dict[str, float], bool]]:
    """Where one more buffer harms beyond limits and errors: poorer and richer door, sequence, losses, if made good."""
    for door in DOORS:
        for richer in door.richer:
            for scene, poor in values.get(door.name, {}).items():
                gained = harm.sure(*harm.mean_gains(values[richer][scene], poor))
                if bad := harm.harms(gained):
                    made_good = not harm.harms(gained, excused=True)
                    yield door.name, richer, scene, {key: gained[key] for key in bad}, made_good


def harmful_buffers(folder: Path) -> str:
    """Where SVGF is better through a door than with one more buffer."""
    cases: dict[tuple[str, str], list[str]] = {}
    for poorer, richer, scene, lost, made_good in _harmful(_through_doors(folder)["SVGF"]):
        losses = ", ".join(f"{key} {harm.amount(key, loss)}" for key, loss in lost.items())
        cases.setdefault((poorer, richer), []).append(f"`{scene}` ({losses}{', made good' if made_good else ''})")
    return _table(["better", "than", "sequences"], [[*pair, "; ".join(found)] for pair, found in cases.items()])


def harmful_by_method(folder: Path) -> str:
    """How often one more buffer harms each method, and the worst case of each metric."""
    rows = []
    for method, values in _through_doors(folder).items():
        found = [*_harmful(values)]
        row = [method, str(len(found))]
        for key in _LABELS:
            worst = min((case for case in found if key in case[3]), key=lambda case: case[3][key], default=None)
            row.append("" if worst is None else f"{_amount(key, worst[3][key])} (`{worst[2]}`, {worst[1]})")
        rows.append(row)
    return _table(["", "cases", *_LABELS.values()], rows)


def stress(folder: Path) -> str:
    """The numbers of cases that hold, degrade and fail, by method."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in _rows(folder / "stress.csv"):
        if row["verdict"]:
            found.setdefault(row["method"], {}).setdefault(row["part"], []).append(row["verdict"])
    parts = list(dict.fromkeys(part for each in found.values() for part in each))
    rows = []
    for method, each in found.items():
        counts = [[each.get(part, []).count(verdict) for verdict in _VERDICTS] for part in parts]
        rows.append([method, *(" / ".join(map(str, count)) if any(count) else "–" for count in counts)])
    return _table([" / ".join(_VERDICTS), *parts], rows)


def families(folder: Path) -> str:
    """The numbers of cases that hold, degrade and fail in each family of failures, with SVGF in three variants."""
    wanted = ("SVGF, no innovation", "SVGF", "SVGF, both sides")
    found: dict[str, dict[str, list[str]]] = {}
    for row in _rows(folder / "stress.csv"):
        if row["part"] == "failures" and row["method"] in wanted:
            found.setdefault(row["failure"], {}).setdefault(row["method"], []).append(row["verdict"])
    rows = [
        [family, *(" / ".join(str(each.get(name, []).count(verdict)) for verdict in _VERDICTS) for name in wanted)]
        for family, each in found.items()
    ]
    return _table([" / ".join(_VERDICTS), *wanted], rows)


def failures(folder: Path) -> str:
    """The cases in which SVGF, or SVGF on both sides, fails."""
    wanted = ("SVGF", "SVGF, both sides")
    cases: dict[str, dict[str, Row]] = {}
    for row in _rows(folder / "stress.csv"):
        if row["method"] in wanted and row["part"] != "endurance":
            cases.setdefault(row["case"], {})[row["method"]] = row
    rows = []
    for case, known in cases.items():
        if any(row["verdict"] == "fails" for row in known.values()):
            cells = [known.get(name) for name in wanted]
            rows.append([case, *("–" if row is None else _verdict(row) for row in cells)])
    return _table(["", *wanted], rows)


def speed(folder: Path) -> str:
    """Pipelines and their rivals: milliseconds at 1080p with two threads and one; memory."""
    return _times(folder, lambda row: row["held_mb"] != "" or row["task"] in _pipelines())


def pipelines(folder: Path) -> str:
    """Which pipeline suits which task, with its time."""
    spent = {
        row["task"]: float(row["ms"]) for row in _rows(folder / "speed.csv") if row["simd"] and row["threads"] == "2"
    }
    rows = [[f"`{name}`", useful, good, f"{spent[task]:.0f}", bad] for name, task, useful, good, bad in _PIPELINES]
    return _table(["", "works best with", "for", "ms at 1080p", "fails"], rows)


def kernels(folder: Path) -> str:
    """Kernels and their rivals: milliseconds at 1080p with two threads and one."""
    return _times(folder, lambda row: row["task"] not in _pipelines())


def machine(folder: Path) -> str:
    """The limits of the machine on which all times were measured."""
    rows = {}
    for row in _rows(folder / "speed.csv"):
        if row["copy_gb_per_s"]:
            limits = f"{float(row['copy_gb_per_s']):.1f}", f"{float(row['giga_multiply_adds_per_s']):.0f}"
            rows[f"{row['threads']} thread{'s' * (row['threads'] != '1')}, {row['simd']}"] = limits
    return _table(["", "copies, GB/s", "multiply-adds, 10⁹/s"], [[name, *limits] for name, limits in rows.items()])


def _text(name: str) -> Callable[[Path], str]:
    return lambda folder: f"```\n{(folder / f'{name}.txt').read_text('utf-8').strip()}\n```"


def _command(name: str) -> Callable[[Path], str]:
    command = RUNS[name].command
    return lambda _: f"```sh\n{command if command.startswith('yester ') else f'python -m {command}'}\n```"


#: By name, the function that makes the table from the folder of measurements.
TABLES: dict[str, Callable[[Path], str]] = {
    **{
        table.__name__: table
        for table in (
            *(methods, variants, groups, sequences, fresh, ablation, antialiasing, innovation, harms, harms_with_less),
            *(doors, methods_through_doors, harmful_buffers, harmful_by_method),
            *(stress, families, failures, speed, pipelines, kernels, machine),
        )
    },
    **{name: _text(name) for name, source in RUNS.items() if not source.made},
    **{f"command {name}": _command(name) for name in RUNS},
}

_VERDICTS = ("holds", "degrades", "fails")


def measure(names: Iterable[str], folder: Path) -> None:
    """Run measurements.

    Parameters
    ----------
    names : iterable of str
        Keys of `RUNS`.
    folder : Path
        Output folder, created if missing.

    Raises
    ------
    subprocess.CalledProcessError
        If a command fails.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        source = RUNS[name]
        command = [sys.executable, "-m", *shlex.split(source.command)]
        with TemporaryDirectory() as made:
            if source.made:
                subprocess.run([*command, "-o", made], check=True)
                shutil.copy(Path(made, source.made), folder / f"{name}{Path(source.made).suffix}")
            else:
                done = subprocess.run(command, check=True, stdout=subprocess.PIPE, encoding="utf-8")
                (folder / f"{name}.txt").write_text(done.stdout, "utf-8")


def write(pages: Iterable[Path], folder: Path, *, check: bool = False) -> list[Path]:
    """Insert tables into pages.

    Parameters
    ----------
    pages : iterable of Path
        Markdown files.
    folder : Path
        The measurements. Tables without a measurement stay unchanged.
    check : bool, default False
        Whether to only compare, without changing a page.

    Returns
    -------
    list of Path
        The pages whose tables differ from the measurements.

    Raises
    ------
    ValueError
        If a table is unknown, or its end is missing.
    """
    different = []
    for page in pages:
        old = page.read_text("utf-8")
        new = _filled(old, page, folder)
        if new != old:
            different.append(page)
            if not check:
                with beside(page) as temporary:
                    temporary.write_text(new, "utf-8")
    return different


def _filled(text: str, page: Path, folder: Path) -> str:
    def fill(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in TABLES:
            raise ValueError(f"{page}: table: expected one of {', '.join(TABLES)}, got {name}")
        try:
            table = TABLES[name](folder)
        except FileNotFoundError:
            return match[0]
        return f"<!-- table: {name} -->\n{table}\n<!-- end: {name} -->"

    pattern = r"<!-- table: (?P<name>.+?) -->\n(?:.*\n)*?<!-- end: (?P=name) -->"
    new, filled = re.subn(pattern, fill, text)
    if filled != text.count("<!-- table: "):
        raise ValueError(f"{page}: expected an end for each table")
    return new


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 1 if ``write --check`` finds differences."""
    parser = argparse.ArgumentParser(prog="python -m yester.study.pages", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    take = commands.add_parser("measure", help="run measurements; all of them take hours")
    take.add_argument("names", metavar="NAME", nargs="*", default=[*RUNS], help=", ".join(RUNS))
    put = commands.add_parser("write", help="insert tables into pages")
    put.add_argument("pages", metavar="PAGE", nargs="+", type=Path)
    put.add_argument("--check", action="store_true", help="change nothing; fail if a page would change")
    for each in (take, put):
        each.add_argument("--data", metavar="DIR", type=Path, default=Path("docs/results/data"), help="%(default)s")
    options = parser.parse_args(arguments)
    if options.command == "measure":
        if unknown := [name for name in options.names if name not in RUNS]:
            parser.error(f"NAME: expected some of {', '.join(RUNS)}, got {unknown[0]}")
        measure(options.names, options.data)
        return 0
    different = write(options.pages, options.data, check=options.check)
    for page in different:
        print(f"{page}: {'differs from its measurements' if options.check else 'written'}")
    return int(options.check and bool(different))


def _rows(path: Path) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _means(file: Path, method: str, scenes: Sequence[str]) -> list[str]:
    rows = [row for row in _rows(file) if row["method"] == method and row["scene"] in scenes]
    return [_value(key, float(np.mean([float(row[key]) for row in rows]))) for key in _LABELS]


def _times(folder: Path, wanted: Callable[[Mapping[str, str]], bool]) -> str:
    rows = [row for row in _rows(folder / "speed.csv") if wanted(row)]
    most = max(int(row["threads"]) for row in rows)
    single = {(row["task"], row["contender"]): row for row in rows if row["threads"] == "1"}
    ours = {row["task"]: row for row in rows if row["simd"] and int(row["threads"]) == most}
    lines = []
    for row in rows:
        if int(row["threads"]) == most:
            key = row["task"], row["contender"]
            ms, own = float(row["ms"]), float(ours[row["task"]]["ms"])
            name = row["task"] if row["simd"] else f"— {row['contender']}"
            one = f"{float(single[key]['ms']):.1f}" if key in single else ""
            held = f"{float(row['held_mb']):.0f}" if row["held_mb"] else ""
            lines.append([name, f"{ms:.1f}", one, "" if row["simd"] else f"{ms / own:.2f}", held])
    head = [f"1920×1080, {most} threads", "ms", "ms, 1 thread", "relative time", "memory, MB"]
    kept = [i for i in range(5) if i < 4 or any(line[4] for line in lines)]
    return _table([head[i] for i in kept], [[line[i] for i in kept] for line in lines])


def _pipelines() -> set[str]:
    from .speed.tasks import TASKS

    return {task.name for task in TASKS if task.pipeline}


def _verdict(row: Row) -> str:
    return f"{row['verdict']}: {row['reason']}" if row["reason"] else row["verdict"]


def _component(row: Row) -> str:
    return f"{'+' if row['added'] == '1' else '−'} {row['component']}"


def _value(key: str, value: float) -> str:
    return f"{value:.2f}" if key == "psnr" else f"{value:.4f}"


def _amount(key: str, gain: float) -> str:
    return harm.amount(key, gain).replace("-", "−")


def _best(rows: Sequence[Sequence[str]], first: int) -> list[list[str]]:
    """Print the best value of each metric in bold; `first` is the first metric's column."""
    result = [[*row] for row in rows]
    for column, better in enumerate(_BETTER.values(), first):
        best = better(float(row[column]) for row in rows)
        for row in result:
            if float(row[column]) == best:
                row[column] = f"**{row[column]}**"
    return result


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    numbers = [all(re.match(r"[*+−–-]*\d|–?$", row[i]) for row in rows) for i in range(1, len(head))]
    rule = ["---", *("--:" if right else "---" for right in numbers)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


if __name__ == "__main__":
    sys.exit(main())
