"""`yester demo`, `chart`, `stress` and `bench`: accuracy, failures and speed."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from .. import __version__
from .._core import settings
from ..argtypes import count, extent, filename
from ..io.shots import breaks
from ..outputs import spare, writable
from .parsing import OUTPUT, Command, add_channels, files_of, how_to_read, need, parameter

__all__ = ["add_bench", "add_chart", "add_demo", "add_stress"]


def add_demo(command: Command) -> None:
    parser = command(_demo, "demo", "render a short noisy sequence with Mitsuba, denoise it and measure the result")
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, default=Path("yester-demo"), help=OUTPUT)
    parser.add_argument("--frames", metavar="N", type=count, default=24, help="number of frames (default: %(default)s)")
    parser.add_argument(
        "--size", metavar="WxH", type=extent, default=(320, 240), help="size of the frames (default: 320x240)"
    )


def _demo(options: argparse.Namespace) -> None:
    need("demo", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "mitsuba", "tqdm")
    from ..study import demo

    folder = writable(options.output)
    width, height = options.size
    print(demo.run(folder, frames=options.frames, width=width, height=height))
    for name in demo.WRITTEN:
        print(folder / name)


def add_chart(command: Command) -> None:
    parser = command(
        _chart, "chart", "chart the error of every method over its time, on rendered or your own sequences"
    )
    parser.add_argument("frames", metavar="FRAMES", nargs="*", help="noisy EXR files: a folder, files or a pattern")
    add_channels(parser)
    parser.add_argument("--references", metavar="REF", nargs="+", help="noise-free files of the same names")
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, default=Path("yester-chart"), help=OUTPUT)
    parser.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    parser.add_argument("--metrics", metavar="METRIC", nargs="+", help="metrics; by default, all")
    parser.add_argument("--methods", metavar="METHOD", nargs="+", help="prefixes of methods' names; by default, all")
    parser.add_argument("--no-peers", action="store_true", help="leave out Open Image Denoise, OpenCV and torch")
    parser.add_argument("--ablate", action="store_true", help="ablation: switch off each component in turn")
    doors = "measure the loss from dropped or degraded buffers, in these ways (by default all); also with --ablate"
    parser.add_argument("--doors", metavar="DOOR", nargs="*", help=doors)
    parser.add_argument(
        "--time-size", metavar="WxH", type=extent, default=(1280, 720), help="size of timed frames; 1280x720"
    )
    render = parser.add_argument_group("sequences to render", "if no FRAMES are given").add_argument
    groups = (
        "names, or tuning, held-out, unkind-tuning, unkind-held-out, late-held-out, fresh-held-out, thin; "
        "default: all but the last three"
    )
    render("--sequences", metavar="NAME", nargs="+", help=groups)
    render("--length", metavar="N", type=count, help="number of frames; 16")
    render("--size", metavar="WxH", type=extent, help="size of the frames; 256x192")
    render("--reference-spp", metavar="N", type=count, help="samples per pixel of references; by default, 256 or 512")
    render("--seeds", metavar="N", type=count, help="number of realisations of the noise; 1")
    render("--cache", metavar="DIR", type=filename, help="folder for rendered frames; by default in the user's cache")


def _chart(options: argparse.Namespace) -> None:
    need("study", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "platformdirs", "skimage", "tqdm")
    from ..study.compare.peers import peers

    metrics, doors = _chart_arguments(options)
    found, absent = ([], {}) if options.no_peers or options.ablate else peers()
    methods = _chart_methods(options, found, absent)
    points = not options.ablate and options.doors is None
    written = ["report.html", "points.csv"] if points else ["ablation.csv" if options.ablate else "doors.csv"]
    spare([options.output / name for name in written], overwrite=options.overwrite)
    given = _recordings(options)
    if points:
        _spare_figures(options, [*given], metrics)
    writable(options.output)
    for name, remedy in absent.items():
        print(f"not installed: {name}: {remedy}", file=sys.stderr)
    if options.frames and not options.references:
        print("no references: only speed and the change along motion are measured", file=sys.stderr)
    recordings = [make() for make in given.values()]
    if points:
        _chart_points(options, recordings, metrics, methods)
    elif options.ablate:
        _chart_ablation(options, recordings, metrics, doors)
    else:
        _chart_doors(options, recordings, metrics, doors, methods)
    for name in written:
        print(options.output / name)


def _chart_arguments(options: argparse.Namespace) -> tuple[list[str], list[Any]]:
    """The metrics and the doors; ValueError for arguments that are unknown or contradict each other."""
    from ..metrics import METRICS
    from ..study.compare.doors import DOORS
    from ..study.compare.harm import LIMITS

    if options.references and not options.frames:
        raise ValueError("--references: expected FRAMES as well, got none")
    if (options.map or options.view) and not options.frames:
        raise ValueError("--map, --view: expected FRAMES that they are about, got none")
    for option in ("--sequences", "--length", "--size", "--reference-spp", "--seeds", "--cache"):
        if options.frames and getattr(options, parameter(option)) is not None:
            raise ValueError(f"{option}: expected no FRAMES beside it, as it is for sequences to render")
    if options.ablate and options.methods:
        raise ValueError("--methods: expected none with --ablate, which chooses the methods itself")
    metrics = _known("--metrics", options.metrics or [], METRICS)
    if options.frames and not options.references:
        metrics = [key for key in metrics or METRICS if METRICS[key].needs == "none"]
        if not metrics:
            got = ", ".join(options.metrics)
            raise ValueError(f"--metrics: expected metrics without a reference, or --references, got {got}")
    if options.doors is None:
        return metrics or [*(LIMITS if options.ablate else METRICS)], [*DOORS[:1]]
    names = _known("--doors", options.doors, [door.name for door in DOORS])
    raw = [door.name for door in DOORS if door.raw and door.name in names]
    if options.frames and raw:
        raise ValueError(f"--doors: expected none of raw albedo with FRAMES, which have one albedo, got {raw[0]}")
    return metrics or [*LIMITS], [door for door in DOORS if not names or door.name in names]


def _chart_methods(options: argparse.Namespace, found: list[Any], absent: dict[str, str]) -> list[Any]:
    """The methods asked for, by default all, of this package and of the peers that were found."""
    from ..study.compare.doors import METHODS as DEFAULTS
    from ..study.compare.doors import NETWORK
    from ..study.compare.methods import METHODS, current_name

    if options.doors is not None and not options.methods:
        return [*DEFAULTS, *(method for method in found if method.name == NETWORK)]
    every = [*METHODS, *found]
    wanted = tuple(current_name(name) for name in options.methods or [""])
    for one in wanted:
        if not any(method.name.startswith(one) for method in every):
            known = "; ".join([*(method.name for method in every), *(f"(not installed) {name}" for name in absent)])
            raise ValueError(f"--methods: expected prefixes of {known}, got {one}")
    return [method for method in every if method.name.startswith(wanted)]


def _spare_figures(options: argparse.Namespace, names: list[str], metrics: list[str]) -> None:
    """Refuse to replace the figures of sequences unless that is asked for."""
    from ..study.compare.points import ALL
    from ..study.compare.report import figure_paths

    scenes = [*names, ALL] if len(names) > 1 else names
    figures = [path for name in scenes for key in metrics for path in figure_paths(options.output, key, name)]
    spare(figures, overwrite=options.overwrite)


def _chart_points(options: argparse.Namespace, recordings: list[Any], metrics: list[str], methods: list[Any]) -> None:
    from ..study.compare.chart import chart
    from ..study.compare.points import table

    threads, instructions = settings()
    about = f"yester {__version__}, {threads} threads, {instructions}"
    points = chart(recordings, methods, options.output, metrics=metrics, size=options.time_size, about=about)
    print(table([point for point in points if point.scene == points[-1].scene]))


def _chart_ablation(options: argparse.Namespace, recordings: list[Any], metrics: list[str], doors: list[Any]) -> None:
    from ..study.compare.ablation import ABLATIONS, ablate, harmful, table

    own = [one for one in ABLATIONS if not (options.no_peers and one.whole.peer)]
    effects = ablate(recordings, options.output, metrics=metrics, doors=doors, ablations=own, size=options.time_size)
    _tell_harm(table(effects), harmful(effects), metrics)


def _chart_doors(
    options: argparse.Namespace, recordings: list[Any], metrics: list[str], doors: list[Any], methods: list[Any]
) -> None:
    from ..study.compare.doors import harmful, measure_doors, table

    worth = measure_doors(recordings, methods, options.output, metrics=metrics, doors=doors)
    _tell_harm(table(worth), harmful(worth), metrics)


def _tell_harm(table: str, harmful: list[str], metrics: list[str]) -> None:
    from ..study.compare.harm import LIMITS

    print(table)
    if LIMITS.keys() & metrics:
        print("", f"cases of harm: {len(harmful)}", *harmful, sep="\n")


def _recordings(options: argparse.Namespace) -> dict[str, Callable[[], Any]]:
    """The sequences to chart, each made when it is called: the user's files, or rendered (and cached) ones."""
    from ..study.rendered.recording import open_recording, record

    if options.frames:
        references = options.references and files_of(options.references)
        paths = files_of(options.frames)
        found = open_recording(paths, references, **how_to_read(options))
        if anew := breaks(paths):  # methods would carry history on
            where = anew[min(anew)].rpartition(": ")[0]
            raise ValueError(f"{where}; expected consecutive frames of one shot")
        return {found.name: lambda: found}
    need("study", "mitsuba")
    from ..study.rendered.sequences import GROUPS, KNOWN, expand

    asked = _known("--sequences", options.sequences or ["all"], [*GROUPS, *KNOWN])
    if options.cache:
        writable(options.cache)
    width, height = options.size or (256, 192)
    shape = {"frames": options.length or 16, "width": width, "height": height, "reference_spp": options.reference_spp}
    shape["variants"] = (options.seeds or 1) - 1
    shape["raw_albedo"] = options.doors is not None
    return {name: partial(record, name, options.cache, **shape) for name in expand(asked)}


def _known(argument: str, given: list[str], known: Iterable[str]) -> list[str]:
    for one in given:
        if one not in known:
            raise ValueError(f"{argument}: expected some of {', '.join(known)}, got {one}")
    return given


def add_stress(command: Command) -> None:
    parser = command(_stress, "stress", "run every pipeline on known failure cases with exact references")
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, default=Path("yester-stress"), help=OUTPUT)
    parser.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    parser.add_argument("--scenarios", metavar="NAME", nargs="+", help="scenarios; by default, all")
    parser.add_argument("--methods", metavar="NAME", nargs="+", help="methods; by default, all pipelines and presets")
    parser.add_argument("--endurance", metavar="N", type=int, default=10_000, help="frames of long runs; %(default)s")
    parser.add_argument("--quick", action="store_true", help="16 frames of each scenario; no strains, no long runs")


def _stress(options: argparse.Namespace) -> None:
    need("study", "PIL", "psutil", "tqdm")
    from ..study.synthetic import stress

    pictures = sorted((options.output / "worst").glob("*.png"))
    spare([options.output / "stress.md", options.output / "stress.csv", *pictures], overwrite=options.overwrite)
    named = {"endurance": options.endurance, "quick": options.quick}
    print(stress.run(options.output, options.scenarios, options.methods, **named))
    for name in ("stress.md", "stress.csv", "worst"):
        print(options.output / name)


def add_bench(command: Command) -> None:
    parser = command(_bench, "bench", "time every kernel and pipeline, other libraries and the machine's limits")
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, default=Path("yester-bench"), help=OUTPUT)
    parser.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    sizes = [(256, 256), (1920, 1080), (3840, 2160)]
    shown = " ".join(f"{width}x{height}" for width, height in sizes)
    parser.add_argument(
        "--sizes", metavar="WxH", type=extent, nargs="+", default=sizes, help=f"sizes of images; {shown}"
    )
    parser.add_argument(
        "--threads", metavar="N", type=count, nargs="+", help="numbers of threads; by default, one and all"
    )
    parser.add_argument(
        "--simd", metavar="LEVEL", nargs="+", help="SIMD levels, with the most threads; by default, all"
    )
    parser.add_argument("--repetitions", metavar="N", type=count, default=7, help="maximum number of runs; %(default)s")
    parser.add_argument("--only", metavar="TASK", nargs="+", help="prefixes of tasks' names; by default, all")
    parser.add_argument("--no-rivals", action="store_true", help="leave out torch, OpenCV and Open Image Denoise")


def _bench(options: argparse.Namespace) -> None:
    need("study", "matplotlib", "tqdm")
    from ..study.speed import bench

    settings = bench.settings(options.threads, options.simd)
    tasks = bench.chosen(options.only)
    written = [options.output / name for name in ("bench.md", "bench.csv", "targets.csv", "bench.svg")]
    spare(written, overwrite=options.overwrite)
    writable(options.output)
    named = {"repetitions": options.repetitions, "compare": not options.no_rivals}
    print(bench.run(options.output, tasks, [*dict.fromkeys(options.sizes)], settings, **named))
    print(*written, sep="\n")
