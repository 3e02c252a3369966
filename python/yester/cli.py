"""The command line: parses arguments, calls the library and reports."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, redirect_stderr, suppress
from copy import copy
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from io import StringIO, TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from . import (
    BMFR,
    OIDN,
    SVGF,
    TAA,
    Camera,
    Frame,
    HalfRes,
    Output,
    Plan,
    Recirculation,
    Upscaler,
    __version__,
    check,
    denoise,
    plan,
    split_at_cuts,
)
from ._core import settings
from .argtypes import count, extent, whole
from .batch import Batch, Run
from .io import Description, describe, headers, mapping, read_exr, read_sequence, sequence_paths
from .io.ahead import ahead
from .io.exr import COMPRESSIONS, check_compression
from .io.shots import breaks, by_shots
from .messages import told
from .outputs import FILMS, keep_inputs, spare, targets_of, writable
from .plan import PLANNED
from .sequence import LOOKAHEAD

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


#: The methods of `yester denoise`: constructor and the names of its options.
_METHODS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "svgf": (SVGF, ("alpha", "iterations", "sigma_luminance", "feedback", "fireflies", "choice", "innovation")),
    "taa": (TAA, ("preset", "alpha", "fireflies", "innovation")),
    "bmfr": (BMFR, ("alpha", "block", "features", "fireflies", "innovation")),
    "halfres": (HalfRes, ("alpha", "iterations", "sigma_luminance", "fireflies", "choice", "innovation")),
    "recirculation": (Recirculation, ("fireflies", "innovation")),
    "oidn": (OIDN, ("quality",)),
    "temporal-oidn": (partial(OIDN, temporal=True), ("quality", "fireflies", "innovation", "choice")),
}

# Each command imports its slow dependencies itself, so that the others start quickly.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; by default `sys.argv`.

    Returns
    -------
    int
        Exit status: 0; 1 if damaged files were left out, or a check found something wrong; 2 for invalid input, after
        one line on stderr; 130 if interrupted; 141 if nobody reads the output.
    """
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        # Names of files may have bytes that are no characters.
        sys.stdout.reconfigure(errors="backslashreplace")
    with redirect_stderr(_Lossy(sys.stderr)):
        return _main(arguments)


def _main(arguments: Sequence[str] | None) -> int:
    try:
        options = _parser().parse_args(arguments)
        with warnings.catch_warnings():
            # Of one shot, that of motion comes twice, from both directions of time; that of the camera for every frame.
            for about in ("frames: later frames are not used", "motion:", "worldToNDC:"):
                warnings.filterwarnings("once", about)
            warnings.showwarning = _warned
            status = int(options.run(options) or 0)
            if sys.stdout is not None:
                sys.stdout.flush()
            return status
    except KeyboardInterrupt:
        print("yester: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read the output has seen enough; the interpreter must not try to write the rest.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 141
    except OSError as error:
        return _failed(told(error))
    except (ImportError, ValueError) as error:
        return _failed(error)


class _Lossy:
    """Stderr, except that what cannot be written is lost: the work goes on when nobody reads the messages."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = StringIO() if stream is None else stream

    def write(self, text: str) -> int:
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _warned(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _failed(error: object) -> int:
    print(f"yester: error: {error}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        # A command leaves unknown options to the program's parser, which would point to its own help.
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        raise SystemExit(_failed(f"{message} (see {self.prog} --help)"))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="yester", description="Temporal reprojection and denoising of rendered frames.")
    threads, instructions = settings()
    about = f"yester {__version__} ({threads} threads, {instructions})"
    parser.add_argument("--version", action="version", version=about)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(run: Any, name: str, about: str) -> argparse.ArgumentParser:
        result = commands.add_parser(name, help=about, description=f"{about[0].upper()}{about[1:]}.")
        result.set_defaults(run=run)
        return result

    def channels(command: argparse.ArgumentParser) -> None:
        about = "what channels are: BUFFER=CHANNEL,..., BUFFER.PROPERTY=VALUE or a TOML file; may be repeated"
        command.add_argument("--map", metavar="MAP", action="append", default=[], help=about)
        command.add_argument("--view", metavar="NAME", help="of a stereo file; by default left, or the first one")

    def files(command: argparse.ArgumentParser) -> None:
        command.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
        about = "output folder; files keep their names. For a single input, also a file name that ends in .exr"
        command.add_argument("-o", "--output", metavar="OUT", type=_path, required=True, help=about)
        about = "write float16, or float32; by default, as the colour that is replaced"
        command.add_argument("--half", action=argparse.BooleanOptionalAction, help=about)
        about = (
            "of the OpenEXR library, such as zip, piz or dwaa; by default that of the input if it is lossless, else zip"
        )
        command.add_argument("--compression", metavar="NAME", help=about)
        there = command.add_mutually_exclusive_group()
        about = "go on where a run with the same inputs and options has stopped; the bytes are those of a whole run"
        there.add_argument("--resume", action="store_true", help=about)
        there.add_argument("--overwrite", action="store_true", help="replace files that exist")
        about = "leave damaged files out, name them, and treat them as missing frames"
        command.add_argument("--keep-going", action="store_true", help=about)
        channels(command)

    output = "output folder (default: %(default)s)"
    demo = command(_demo, "demo", "render a short noisy sequence with Mitsuba, denoise it and measure the result")
    demo.add_argument("-o", "--output", metavar="DIR", type=_path, default=Path("yester-demo"), help=output)
    demo.add_argument("--frames", metavar="N", type=count, default=24, help="number of frames (default: %(default)s)")
    demo.add_argument(
        "--size", metavar="WxH", type=extent, default=(320, 240), help="size of the frames (default: 320x240)"
    )

    clean = command(_denoise, "denoise", "denoise a sequence of EXR frames")
    files(clean)
    methods = ("auto", *_METHODS)
    about = "one of %(choices)s (default: auto; svgf with its options). auto: svgf without what harms a shot"
    clean.add_argument("--method", choices=methods, help=about)
    clean.add_argument("--plan", metavar="FILE", type=_path, help="a plan written by yester plan, instead of a method")
    about = "smallest number of later frames available to each frame; 0: earlier frames only, as in real time "
    about += f"(default: {LOOKAHEAD}; oidn: 0)"
    clean.add_argument("--lookahead", metavar="N", type=whole, help=about)
    about = "a part of the parameters of yester.SVGF, TAA, BMFR, HalfRes, Recirculation and OIDN; for all, "
    about += "python -c 'import yester; help(yester.SVGF)'"
    options = clean.add_argument_group("method options", about)

    def option(name: str, about: str, **named: Any) -> None:
        of = ", ".join(method for method, (_, names) in _METHODS.items() if _argument(name) in names)
        options.add_argument(name, help=f"{of}: {about}", default=None, **named)

    about = "smallest weight of the new sample in the history, 0 to 1 (default: 0.2; bmfr: 0.05; taa: by preset)"
    option("--alpha", about, type=float)
    about = "passes of the spatial filter, 0 to 16; with --choice, the number used where there is no evidence "
    about += "(default: 3; halfres: 4)"
    option("--iterations", about, type=int)
    about = "scale of luminance differences, in standard deviations; above 0 (default: 3; halfres: 4)"
    option("--sigma-luminance", about, type=float)
    option("--feedback", "use the first pass's output as history: less noise, more bias", action="store_true")
    option("--fireflies", "redistribute samples far brighter than their surroundings", action="store_true")
    about = "choose the number of filter passes per tile; in temporal-oidn, mix in the denoised image of the "
    about += "frame's own samples. On by default, in halfres only without albedo"
    option("--choice", about, action=argparse.BooleanOptionalAction)
    about = "add the error that new samples show to the result; on by default, except in taa"
    option("--innovation", about, action=argparse.BooleanOptionalAction)
    option("--preset", "best, denoised, textbook, karis or filament")
    option("--block", "side of the blocks in pixels, 4 to 256; by default 16, without albedo 8", type=int)
    option("--features", "fewest (as many as a block needs) or all")
    option("--quality", "fast, balanced or high")

    plan = command(_plan, "plan", "find out which stages of svgf and which buffers a sequence needs")
    plan.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    plan.add_argument("-o", "--output", metavar="FILE", type=_path, help="write the plan, for yester denoise --plan")
    plan.add_argument("--overwrite", action="store_true", help="replace a plan that exists")
    channels(plan)

    upscale = command(_upscale, "upscale", "temporally upscale a sequence of jittered EXR frames")
    files(upscale)
    upscale.add_argument("--scale", type=float, default=2.0, help="ratio of sizes along each side, 1 to 4; %(default)s")
    upscale.add_argument("--sharpness", type=float, default=0.0, help="0 (off, the default) to 1")
    about = "redistribute samples far brighter than their surroundings first"
    upscale.add_argument("--fireflies", action="store_true", help=about)
    upscale.add_argument("--denoise", action="store_true", help="denoise with SVGF first")

    screen = command(_picture, "picture", "turn EXR frames into PNG files or an animation")
    screen.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    about = "folder for PNG files of the same names; for one file, also a name that ends in .png; an animation, if the "
    about += "name ends in .webp or .mp4"
    screen.add_argument("-o", "--output", metavar="OUT", type=_path, required=True, help=about)
    about = "exposure in stops (default: %(default)s)"
    screen.add_argument("--exposure", metavar="STOPS", type=float, default=0.0, help=about)
    about = "tone curve: clip (default), reinhard or aces"
    screen.add_argument("--curve", choices=("clip", "reinhard", "aces"), default="clip", help=about)
    screen.add_argument("--fps", type=float, default=24.0, help="of animations; %(default)s")
    screen.add_argument("--overwrite", action="store_true", help="replace files that exist")

    versus = command(
        _compare, "compare", "write a page that compares the frames of two or three folders, with exposure"
    )
    for name, about in (("a", "EXR frames: a folder or a file"), ("b", "frames of the same names, to compare with A")):
        versus.add_argument(name, metavar=name.upper(), type=_path, help=about)
    about = "frames of the same names without noise"
    versus.add_argument("reference", metavar="REFERENCE", nargs="?", type=_path, help=about)
    about = "output page (default: %(default)s)"
    versus.add_argument("-o", "--output", metavar="FILE", type=_path, default=Path("yester-compare.html"), help=about)
    versus.add_argument("--frames", metavar="N", type=count, default=8, help="evenly spread; %(default)s")
    versus.add_argument("--half", action="store_true", help="round to float16: a smaller page")
    versus.add_argument("--overwrite", action="store_true", help="replace a page that exists")
    versus.add_argument("--open", action="store_true", help="open it in a browser")

    look = command(_live, "live", "turn the camera of a scene in a browser, and watch it being denoised")
    about = "a Mitsuba scene; by default, the Cornell box of the demo"
    look.add_argument("scene", metavar="SCENE.xml", nargs="?", type=_path, help=about)
    about = "largest size, from which the resolution adapts; by default that of the scene, or 640x480"
    look.add_argument("--size", metavar="WxH", type=extent, help=about)
    look.add_argument("--port", metavar="N", type=whole, default=0, help="by default, any that is free")
    look.add_argument("--no-open", action="store_true", help="print the address, but open no browser")
    about = "where recordings go; by default the current folder"
    look.add_argument("-o", "--output", metavar="DIR", type=_path, default=Path(), help=about)

    ready = command(_prepare, "prepare", "prepare a training set from rendered sequences")
    about = "folders of EXR sequences, which may lie in folders, and Noisebase stores"
    ready.add_argument("inputs", metavar="IN", nargs="+", type=_path, help=about)
    about = "output folder; absent or empty, unless --resume"
    ready.add_argument("-o", "--output", metavar="DIR", type=_path, required=True, help=about)
    about = "images of each frame, such as color history validity difference variance denoised demodulated reference"
    about += "; by default, all that the first sequence allows"
    ready.add_argument("--buffers", metavar="NAME", nargs="+", help=about)
    about = "sizes to write: full, half, or full half for both (default: full)"
    ready.add_argument("--sizes", metavar="SIZE", nargs="+", choices=("full", "half"), default=["full"], help=about)
    ready.add_argument("--crop", metavar="WxH", type=extent, help="cut windows of this size from each sequence")
    ready.add_argument("--crops", metavar="N", type=count, default=1, help="windows per sequence; %(default)s")
    ready.add_argument("--seed", metavar="N", type=int, default=0, help="of the windows' places; %(default)s")
    ready.add_argument("--half", action="store_true", help="store colours, normals and validity as float16")
    ready.add_argument("--format", choices=("zarr", "exr"), default="zarr", help="%(default)s")
    about = "folder with the same EXR files without noise, for reference"
    ready.add_argument("--references", metavar="DIR", type=_path, help=about)
    ready.add_argument("--jobs", metavar="N", type=count, help="processes; by default, one per core")
    ready.add_argument("--scheduler", metavar="ADDRESS", help="let the workers of this Dask scheduler do it")
    ready.add_argument("--resume", action="store_true", help="go on where an earlier run stopped")
    channels(ready)

    info = command(_info, "info", "list the buffers of an EXR file, and the consequences of each missing one")
    info.add_argument("file", metavar="FILE", type=_path)
    channels(info)

    looked = command(
        _checked, "check", "find wrong conventions of motion, cameras, depth, normals, jitter, albedo and ids"
    )
    looked.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    about = "consecutive frames to look at, from the middle of the first shot; %(default)s"
    looked.add_argument("--frames", metavar="N", type=partial(whole, least=2), default=6, help=about)
    channels(looked)

    chart = command(_chart, "chart", "chart the error of every method over its time, on rendered or your own sequences")
    chart.add_argument("frames", metavar="FRAMES", nargs="*", help="noisy EXR files: a folder, files or a pattern")
    channels(chart)
    chart.add_argument("--references", metavar="REF", nargs="+", help="noise-free files of the same names")
    chart.add_argument("-o", "--output", metavar="DIR", type=_path, default=Path("yester-chart"), help=output)
    chart.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    chart.add_argument("--metrics", metavar="METRIC", nargs="+", help="metrics; by default, all")
    chart.add_argument("--methods", metavar="METHOD", nargs="+", help="prefixes of methods' names; by default, all")
    chart.add_argument("--no-peers", action="store_true", help="leave out Open Image Denoise, OpenCV and torch")
    chart.add_argument("--ablate", action="store_true", help="ablation: switch off each component in turn")
    doors = "measure the loss from dropped or degraded buffers, in these ways (by default all); also with --ablate"
    chart.add_argument("--doors", metavar="DOOR", nargs="*", help=doors)
    chart.add_argument(
        "--time-size", metavar="WxH", type=extent, default=(1280, 720), help="size of timed frames; 1280x720"
    )
    render = chart.add_argument_group("sequences to render", "if no FRAMES are given").add_argument
    groups = (
        "names, or tuning, held-out, unkind-tuning, unkind-held-out, late-held-out, thin; default: all but the last two"
    )
    render("--sequences", metavar="NAME", nargs="+", help=groups)
    render("--length", metavar="N", type=count, help="number of frames; 16")
    render("--size", metavar="WxH", type=extent, help="size of the frames; 256x192")
    render("--reference-spp", metavar="N", type=count, help="samples per pixel of references; by default, 256 or 512")
    render("--seeds", metavar="N", type=count, help="number of realisations of the noise; 1")
    render("--cache", metavar="DIR", type=_path, help="folder for rendered frames; by default in the user's cache")

    stress = command(_stress, "stress", "run every pipeline on known failure cases with exact references")
    stress.add_argument("-o", "--output", metavar="DIR", type=_path, default=Path("yester-stress"), help=output)
    stress.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    stress.add_argument("--scenarios", metavar="NAME", nargs="+", help="scenarios; by default, all")
    stress.add_argument("--methods", metavar="NAME", nargs="+", help="methods; by default, all pipelines and presets")
    stress.add_argument("--endurance", metavar="N", type=int, default=10_000, help="frames of long runs; %(default)s")
    stress.add_argument("--quick", action="store_true", help="16 frames of each scenario; no strains, no long runs")

    bench = command(_bench, "bench", "time every kernel and pipeline, other libraries and the machine's limits")
    bench.add_argument("-o", "--output", metavar="DIR", type=_path, default=Path("yester-bench"), help=output)
    bench.add_argument("--overwrite", action="store_true", help="replace a report that exists")
    sizes = [(256, 256), (1920, 1080), (3840, 2160)]
    shown = " ".join(f"{width}x{height}" for width, height in sizes)
    bench.add_argument(
        "--sizes", metavar="WxH", type=extent, nargs="+", default=sizes, help=f"sizes of images; {shown}"
    )
    bench.add_argument(
        "--threads", metavar="N", type=count, nargs="+", help="numbers of threads; by default, one and all"
    )
    bench.add_argument("--simd", metavar="LEVEL", nargs="+", help="SIMD levels, with the most threads; by default, all")
    bench.add_argument("--repetitions", metavar="N", type=count, default=7, help="maximum number of runs; %(default)s")
    bench.add_argument("--only", metavar="TASK", nargs="+", help="prefixes of tasks' names; by default, all")
    bench.add_argument("--no-rivals", action="store_true", help="leave out torch, OpenCV and Open Image Denoise")
    return parser


def _path(text: str) -> Path:
    if not text:  # such as that of a variable that is not set; it would be the current folder
        raise argparse.ArgumentTypeError("expected a name, got an empty one")
    return Path(text)


def _demo(options: argparse.Namespace) -> None:
    _need("demo", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "mitsuba", "tqdm")
    from .study import demo

    folder = writable(options.output)
    width, height = options.size
    print(demo.run(folder, frames=options.frames, width=width, height=height))
    for name in demo.WRITTEN:
        print(folder / name)


def _argument(option: str) -> str:
    """The parameter name of an option."""
    return option.removeprefix("--").replace("-", "_")


def _pipeline(options: argparse.Namespace) -> Any:
    """Construct the requested method, None for auto; refuse options of other methods."""
    every = dict.fromkeys(name for _, taken in _METHODS.values() for name in taken)
    given = {name: value for name in every if (value := getattr(options, name)) is not None}
    # Whoever sets an option of svgf does not want a plan to decide.
    options.method = options.method or ("svgf" if given else "auto")
    method = "--plan" if options.plan else options.method
    make, names = _METHODS.get(method, (lambda: None, ()))
    for name in (one for one in given if one not in names):
        of = ", ".join(method for method, (_, taken) in _METHODS.items() if name in taken)
        raise ValueError(f"--{name.replace('_', '-')}: expected --method {of}, got {method}")
    return Plan.load(options.plan).pipeline() if options.plan else make(**given)


def _denoise(options: argparse.Namespace) -> int:
    _need("exr", "OpenEXR", "tqdm")
    from tqdm import tqdm

    if options.plan and options.method:
        raise ValueError(f"--plan: expected no --method beside it, got {options.method}")
    pipeline = _pipeline(options)
    lookahead = LOOKAHEAD if options.lookahead is None else options.lookahead
    if options.method == "oidn":
        if options.lookahead:
            raise ValueError(f"--lookahead: expected none with --method oidn, which has no history, got {lookahead}")
        lookahead = 0
    # The files that lack motion are named instead.
    warnings.filterwarnings("ignore", "frames: later frames are not used")

    def look(shots: headers.Shots) -> list[str]:
        for known in chain(*shots):
            check_compression(options.compression, headers.layers(known), f"{known.path}: --compression")
        for known in chain(*shots) if options.method == "recirculation" else ():
            if not known.camera or not known.channels.keys() & {"depth", "position"}:
                raise ValueError(f"{known.path}: expected a camera, and depth or position, for --method recirculation")
        if options.method == "oidn":  # has no history, so that only albedo and normals matter
            return headers.missing(shots, ("albedo", "normal"))
        return [*headers.unmoved(shots), *headers.missing(shots)]

    def run(frames: Iterator[Frame], shot: str) -> Iterator[tuple[Frame, tuple[str, ...]]]:
        outputs = planned(frames, shot) if pipeline is None else denoise(frames, pipeline, lookahead)
        for output in outputs:
            # The header's camera and jitter stay as they are.
            yield Frame(output.color), output.used

    def planned(frames: Iterator[Frame], where: str) -> Iterator[Output]:
        done = 0
        for shot in split_at_cuts(frames):
            first = list(islice(shot, PLANNED))
            found = _planned(first)
            after = f"{where}, behind a cut after {done} frames" if done else where
            tqdm.write(f"plan{after}: {found.summary()}", file=sys.stderr)
            # It is for these very frames, of which some may lack a buffer that others have.
            for output in denoise(chain(first, shot), replace(found, buffers=()).pipeline(), lookahead):
                yield output
                done += 1

    named = {"sparse": options.method in ("halfres", "recirculation"), "others": filter(None, [options.plan])}
    return _process(options, "denoise", run, look, **named)


def _plan(options: argparse.Namespace) -> None:
    _need("exr", "OpenEXR", "tqdm")
    reading = _reading(options)
    paths = _files(options.inputs)
    if options.output:
        keep_inputs([options.output], paths, "plan", "name")
        spare([options.output], overwrite=options.overwrite)
        writable(options.output.parent)
    end, *_ = [*breaks(paths), len(paths)]
    known = [describe(path, **reading) for path in paths[: min(end, PLANNED)]]
    for one in known:
        headers.same_albedo(one, known[0])
    found = _planned(next(split_at_cuts(read_sequence(paths[:end], **reading))))
    if options.output:
        found.save(options.output)
    print(found)


def _planned(frames: Iterable[Frame]) -> Plan:
    with warnings.catch_warnings():
        # The plan itself gives the reason.
        warnings.filterwarnings("ignore", "plan:", UserWarning)
        return plan(frames)


def _upscale(options: argparse.Namespace) -> int:
    _need("exr", "OpenEXR", "tqdm")
    held = options.fireflies and not options.denoise
    upscaler = Upscaler(options.scale, sharpness=options.sharpness, fireflies=held)
    # No antialiasing: it would average out the jitter that the upscaler needs.
    denoiser = SVGF(antialias=False, fireflies=options.fireflies)

    def run(frames: Iterator[Frame], _: str) -> Iterator[tuple[Frame, tuple[str, ...]]]:
        first, second = copy(denoiser), copy(upscaler)
        for frame in frames:
            used: tuple[str, ...] = ()
            if options.denoise:
                clean = first.step(frame)
                frame, used = replace(frame, color=clean.color), clean.used
            output = second.step(frame)
            height, width, _ = output.color.shape
            camera = frame.camera and Camera(frame.camera.world_to_clip, width, height)
            yield Frame(output.color, camera=camera), (*used, *output.used)

    def look(shots: headers.Shots) -> list[str]:
        notes = [*headers.unmoved(shots), *headers.missing(shots)]
        if not any(known.jitter for known in chain(*shots)):
            notes += ["no jitter found in the headers; assuming zero, so no sub-pixel detail can be recovered"]
        if dropped := list(dict.fromkeys(name for known in chain(*shots) for name in headers.layers(known))):
            notes += [f"only colour is upscaled; left out: {' '.join(dropped)}"]
        return notes

    return _process(options, "upscale", run, look)


def _picture(options: argparse.Namespace) -> int:
    _need("picture", "OpenEXR", "PIL", "tqdm")
    from tqdm import tqdm

    from .io.pictures import check_rate, displayed, write_animation, write_png

    paths = _files(options.inputs)
    look = {"exposure": options.exposure, "curve": options.curve}
    # Raises for an exposure that is not finite.
    displayed([[[0, 0, 0]]], **look)
    film = options.output.suffix.lower() in FILMS
    targets = [options.output] if film else targets_of(paths, options.output, ".png", *FILMS)
    keep_inputs(targets, paths)
    spare(targets, overwrite=options.overwrite)
    if film:
        check_rate(options.fps)
    files: list[Description] = []
    for path in paths if film else ():
        with suppress(OSError, ValueError):  # named when the file is left out
            files.append(describe(path))
    for known in files:
        headers.of_one_size(known, files[0])
    for folder in {target.parent for target in targets}:
        writable(folder)
    unread: list[Path] = []

    def color(path: Path) -> NDArray[np.float32] | None:
        try:
            return read_exr(path).color
        except (OSError, ValueError) as error:
            unread.append(path)
            tqdm.write(f"left out: {told(error)}", file=sys.stderr)
            return None

    read = ahead(map(color, paths))
    with closing(read), tqdm(read, "picture", len(paths), unit="frame", disable=None) as images:
        if film:
            some = (image for image in images if image is not None)
            write_animation(options.output, some, fps=options.fps, **look)
        else:
            for target, image in zip(targets, images, strict=True):
                if image is not None:
                    write_png(target, image, **look)
    return int(bool(unread))


def _compare(options: argparse.Namespace) -> None:
    _need("exr", "OpenEXR", "tqdm")
    from .study.compare.viewer import names_of, write_comparison

    spare([options.output], overwrite=options.overwrite)
    writable(options.output.parent)
    paths = [path for path in (options.a, options.b, options.reference) if path is not None]
    sources = dict(zip(names_of(paths), paths, strict=True))
    write_comparison(options.output, sources, frames=options.frames, half=options.half)
    print(options.output)
    if options.open:
        import webbrowser

        webbrowser.open(options.output.resolve().as_uri())


def _live(options: argparse.Namespace) -> None:
    _need("live", "aiohttp", "mitsuba", "OpenEXR", "matplotlib")
    from . import live

    if options.port > 65535:
        raise ValueError(f"--port: expected 0 to 65535, got {options.port}")
    if options.scene is not None and not options.scene.is_file():
        raise ValueError(f"{options.scene}: no such file")
    writable(options.output)
    named = {"size": options.size, "port": options.port, "folder": options.output}
    live.run(options.scene, browser=not options.no_open, **named)


def _prepare(options: argparse.Namespace) -> int:
    _need("data", *(("zarr",) if options.format == "zarr" else ("OpenEXR",)), "tqdm")
    from .prepare import prepare

    names = "buffers", "sizes", "crop", "crops", "seed", "half", "format", "references", "jobs", "scheduler", "resume"
    named = {name: getattr(options, name) for name in names}
    done = prepare(options.inputs, options.output, **named, **_reading(options))
    for message in (message for messages in done.set_aside.values() for message in messages):
        print(f"set aside: {message}", file=sys.stderr)
    print(f"{done.folder}: {len(done.sequences)} sequences, {done.frames} frames")
    chosen = f" (all that {done.first}, the first sequence, allows)" if done.first else ""
    print(f"images: {', '.join(done.buffers)}{chosen}")
    if done.set_aside:
        few = ", ".join(done.set_aside)
        # Nothing can be tried where the inputs are not given.
        again = "" if len(done.gone) == len(done.set_aside) else "; once repaired, --resume tries them again"
        print(f"{len(done.set_aside)} sequences were set aside: {few}{again}", file=sys.stderr)
    return int(bool(done.set_aside))


def _files(inputs: Iterable[str]) -> list[Path]:
    """The files of a sequence; those of a folder by shots, in natural order, which is not that of a shell's pattern."""
    paths = sequence_paths(inputs)
    first: dict[str, int] = {}
    for number, path in enumerate(paths):
        first.setdefault(os.path.abspath(path.parent), number)
    return sorted(by_shots(paths), key=lambda path: first[os.path.abspath(path.parent)])


def _reading(options: argparse.Namespace) -> dict[str, Any]:
    """How files are read: the arguments of `read_exr`."""
    return {"mapping": mapping.parse(options.map), "view": options.view}


def _process(
    options: argparse.Namespace, what: str, run: Run, look: Callable[[headers.Shots], list[str]], **named: Any
) -> int:
    """Run a method on the frames of each shot; `look` makes lines of their headers, or raises ValueError."""
    from tqdm import tqdm

    if options.compression not in (None, *COMPRESSIONS):
        raise ValueError(f"--compression: expected one of {', '.join(COMPRESSIONS)}, got {options.compression}")
    named |= {"keep_going": options.keep_going, "tell": partial(tqdm.write, file=sys.stderr)}
    reading, paths = _reading(options), _files(options.inputs)
    batch = Batch(paths, options.output, reading, **named)
    notes = [*headers.lines(batch.files), *look([[batch.files[i] for i in shot] for shot in batch.shots])]
    notes += batch.prepare(resume=options.resume, overwrite=options.overwrite)
    for note in [*batch.damaged, *notes]:
        print(note, file=sys.stderr)
    results = batch.process(run, options.half, options.compression)
    total = sum(map(len, batch.shots))
    with closing(results), tqdm(results, what, total, unit="frame", disable=None) as written:
        for _ in written:
            pass
    for line in batch.remarks():
        print(line, file=sys.stderr)
    return int(bool(batch.damaged))


def _info(options: argparse.Namespace) -> None:
    _need("exr", "OpenEXR")
    known = describe(options.file, **_reading(options))
    width = max(map(len, [*known.channels, *known.missing, "camera"]))
    print(f"{known.path}: {known.width} x {known.height}")
    print(f"recognised: {known.renderer or 'no renderer'}{f', by {known.evidence}' if known.renderer else ''}")
    if known.views:
        print(f"views: {', '.join(known.views)}; {known.view} is used, --view chooses")
    for remark in known.remarks:
        print(f"note: {remark}")
    for name, channels in known.channels.items():
        print(f"  {name:<{width}} {_grouped(channels, sort=False)}")
        if name in known.notes:
            print(f"  {'':<{width}} {known.notes[name]}")
    if known.camera:
        print(f"  {'camera':<{width}} at {_vector(known.camera.position)}, looks along {_vector(known.camera.forward)}")
    if known.jitter:
        print(f"  {'jitter':<{width}} ({known.jitter[0]:g}, {known.jitter[1]:g}) pixels")
    if known.unused:
        print("not used:")
        reasons: dict[str, list[str]] = {}
        for channel, why in known.unused.items():
            reasons.setdefault(why, []).append(channel)
        for why, several in reasons.items():
            print(f"  {_grouped(several)}: {why}")
    if known.unrecognised:
        print(f"not recognised: {_grouped(known.unrecognised)}")
        for layer, guess in known.guesses.items():
            print(f"  {layer} may be {guess.partition('=')[0]}: --map '{guess}'")
    if known.missing:
        print("missing:")
        for name, cost in known.missing.items():
            print(f"  {name:<{width}} {cost}")


def _checked(options: argparse.Namespace) -> int:
    _need("exr", "OpenEXR")
    reading = _reading(options)
    paths = _files(options.inputs)
    end, *_ = [*breaks(paths), len(paths)]
    start = max(end - options.frames, 0) // 2
    chosen = paths[start : min(start + options.frames, end)]
    if len(chosen) < 2:
        raise ValueError(f"{paths[0]}: expected at least two consecutive frames, got {len(chosen)}")
    known = describe(chosen[-1], **reading)
    if "motion" not in known.channels and (guess := _like_motion(known)):
        print(f"tried: motion={','.join(guess)}")
        reading["mapping"] |= mapping.load({"motion": guess})
        known = describe(chosen[-1], **reading)
    stored = {
        buffer: [*zip(known.factors[buffer], channels, strict=True)]
        for buffer, channels in known.channels.items()
        if buffer in ("motion", "depth", "normal")
    }
    # A shot's first frame needs no motion: without it, the others have it.
    if len(chosen) > 2 and "motion" in known.channels and "motion" not in describe(chosen[0], **reading).channels:
        del chosen[0]
    found = check(read_sequence(chosen, **reading), channels=stored, display=known.display)
    print(f"{known.renderer or 'no renderer'} recognised; looked at {chosen[0].name} to {chosen[-1].name}")
    print(*found, sep="\n")
    if known.renderer.startswith("Mitsuba") and not known.camera:
        how = "yester.io.mitsuba.render_sequence renders with one, and write_exr stores it"
        print(f"note: Mitsuba's files have no camera; {how}")
    return int(any(finding.verdict == "wrong" for finding in found))


def _like_motion(known: Description) -> list[str]:
    """Two channels that may hold motion: of a layer that is known but not used, or one with a similar name."""
    layers: dict[str, list[str]] = {}
    for channel, why in known.unused.items():
        if "motion" in f"{channel} {why}".lower():
            layers.setdefault(channel.rpartition(".")[0], []).append(channel)
    guesses = [guess.partition("=")[2].split(",") for guess in known.guesses.values() if guess.startswith("motion=")]
    several = [sorted(own, key=lambda name: "XYZRGB".find(name[-1])) for own in layers.values() if len(own) > 1]
    return next(([*own[:2]] for own in [*several, *guesses]), [])


def _grouped(channels: Iterable[str], *, sort: bool = True) -> str:
    """Channels by layer: ``N.XYZ`` for N.X, N.Y and N.Z, in the usual order of components or in that given."""
    layers: dict[str, list[str]] = {}
    for channel in channels:
        layer, _, component = channel.rpartition(".")
        layers.setdefault(layer, []).append(component)
    bare = layers.pop("", [])
    shown = list(bare)
    for layer, components in layers.items():
        if sort:
            components.sort(key=lambda component: "RGBAXYZWUV".find(component.upper()))
        shown.append(f"{layer}.{('' if all(len(one) == 1 for one in components) else ',').join(components)}")
    return " ".join(shown)


def _chart(options: argparse.Namespace) -> None:
    _need("study", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "platformdirs", "skimage", "tqdm")
    from .study.compare.peers import peers

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
    from .metrics import METRICS
    from .study.compare.doors import DOORS
    from .study.compare.harm import LIMITS

    if options.references and not options.frames:
        raise ValueError("--references: expected FRAMES as well, got none")
    if (options.map or options.view) and not options.frames:
        raise ValueError("--map, --view: expected FRAMES that they are about, got none")
    for option in ("--sequences", "--length", "--size", "--reference-spp", "--seeds", "--cache"):
        if options.frames and getattr(options, _argument(option)) is not None:
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
    from .study.compare.doors import METHODS as DEFAULTS
    from .study.compare.doors import NETWORK
    from .study.compare.methods import METHODS, current_name

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
    from .study.compare.points import ALL
    from .study.compare.report import figure_paths

    scenes = [*names, ALL] if len(names) > 1 else names
    figures = [path for name in scenes for key in metrics for path in figure_paths(options.output, key, name)]
    spare(figures, overwrite=options.overwrite)


def _chart_points(options: argparse.Namespace, recordings: list[Any], metrics: list[str], methods: list[Any]) -> None:
    from .study.compare.chart import chart
    from .study.compare.points import table

    threads, instructions = settings()
    about = f"yester {__version__}, {threads} threads, {instructions}"
    points = chart(recordings, methods, options.output, metrics=metrics, size=options.time_size, about=about)
    print(table([point for point in points if point.scene == points[-1].scene]))


def _chart_ablation(options: argparse.Namespace, recordings: list[Any], metrics: list[str], doors: list[Any]) -> None:
    from .study.compare.ablation import ABLATIONS, ablate, harmful, table

    own = [one for one in ABLATIONS if not (options.no_peers and one.whole.peer)]
    effects = ablate(recordings, options.output, metrics=metrics, doors=doors, ablations=own, size=options.time_size)
    _tell_harm(table(effects), harmful(effects), metrics)


def _chart_doors(
    options: argparse.Namespace, recordings: list[Any], metrics: list[str], doors: list[Any], methods: list[Any]
) -> None:
    from .study.compare.doors import harmful, measure_doors, table

    worth = measure_doors(recordings, methods, options.output, metrics=metrics, doors=doors)
    _tell_harm(table(worth), harmful(worth), metrics)


def _tell_harm(table: str, harmful: list[str], metrics: list[str]) -> None:
    from .study.compare.harm import LIMITS

    print(table)
    if LIMITS.keys() & metrics:
        print("", f"cases of harm: {len(harmful)}", *harmful, sep="\n")


def _recordings(options: argparse.Namespace) -> dict[str, Callable[[], Any]]:
    """The sequences to chart, each made when it is called: the user's files, or rendered (and cached) ones."""
    from .study.rendered.recording import open_recording, record

    if options.frames:
        references = options.references and _files(options.references)
        paths = _files(options.frames)
        found = open_recording(paths, references, **_reading(options))
        if anew := breaks(paths):  # methods would carry history on
            where = anew[min(anew)].rpartition(": ")[0]
            raise ValueError(f"{where}; expected consecutive frames of one shot")
        return {found.name: lambda: found}
    _need("study", "mitsuba")
    from .study.rendered.sequences import GROUPS, LATE, NAMES, THIN, expand

    asked = _known("--sequences", options.sequences or ["all"], [*GROUPS, *NAMES, *LATE, *THIN])
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


def _stress(options: argparse.Namespace) -> None:
    _need("study", "PIL", "psutil", "tqdm")
    from .study.synthetic import stress

    pictures = sorted((options.output / "worst").glob("*.png"))
    spare([options.output / "stress.md", options.output / "stress.csv", *pictures], overwrite=options.overwrite)
    named = {"endurance": options.endurance, "quick": options.quick}
    print(stress.run(options.output, options.scenarios, options.methods, **named))
    for name in ("stress.md", "stress.csv", "worst"):
        print(options.output / name)


def _bench(options: argparse.Namespace) -> None:
    _need("study", "matplotlib", "tqdm")
    from .study.speed import bench

    settings = bench.settings(options.threads, options.simd)
    tasks = bench.chosen(options.only)
    written = [options.output / name for name in ("bench.md", "bench.csv", "targets.csv", "bench.svg")]
    spare(written, overwrite=options.overwrite)
    writable(options.output)
    named = {"repetitions": options.repetitions, "compare": not options.no_rivals}
    print(bench.run(options.output, tasks, [*dict.fromkeys(options.sizes)], settings, **named))
    print(*written, sep="\n")


def _vector(values: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{round(value, 4) + 0.0:g}' for value in values)})"


def _need(extra: str, *modules: str) -> None:
    absent = [name for name in modules if find_spec(name) is None]
    if absent:
        raise ImportError(f"{', '.join(absent)} not installed: pip install 'yester[{extra}]'")
