"""`yester denoise`, `plan` and `upscale`: EXR files in, EXR files out."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from typing import Any

from .. import (
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
    denoise,
    plan,
    split_at_cuts,
)
from ..argtypes import filename, whole
from ..batch import Batch, Run
from ..io import describe, headers, read_exr, read_sequence
from ..io.exr import COMPRESSIONS, check_compression
from ..io.shots import breaks
from ..outputs import keep_inputs, spare, writable
from ..plan import PLANNED, unsuited
from ..sequence import LOOKAHEAD
from .parsing import Command, add_channels, add_files, files_of, how_to_read, need, parameter

__all__ = ["add_denoise", "add_plan", "add_upscale"]


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


def add_denoise(command: Command) -> None:
    parser = command(_denoise, "denoise", "denoise a sequence of EXR frames")
    add_files(parser)
    methods = ("auto", *_METHODS)
    about = "one of %(choices)s (default: auto; svgf with its options). auto: svgf without what harms a shot"
    parser.add_argument("--method", choices=methods, help=about)
    parser.add_argument(
        "--plan", metavar="FILE", type=filename, help="a plan written by yester plan, instead of a method"
    )
    about = "smallest number of later frames available to each frame; 0: earlier frames only, as in real time "
    about += f"(default: {LOOKAHEAD}; oidn: 0)"
    parser.add_argument("--lookahead", metavar="N", type=whole, help=about)
    about = "a part of the parameters of yester.SVGF, TAA, BMFR, HalfRes, Recirculation and OIDN; for all, "
    about += "python -c 'import yester; help(yester.SVGF)'"
    options = parser.add_argument_group("method options", about)

    def option(name: str, about: str, **named: Any) -> None:
        of = ", ".join(method for method, (_, names) in _METHODS.items() if parameter(name) in names)
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


def _denoise(options: argparse.Namespace) -> int:
    need("exr", "OpenEXR", "tqdm")
    from tqdm import tqdm

    if options.plan and options.method:
        raise ValueError(f"--plan: expected no --method beside it, got {options.method}")
    pipeline = _pipeline(options)
    loaded = Plan()
    if options.plan:
        loaded = pipeline.plan
        # `look` has compared the buffers by then; behind a damaged frame, another one is the second.
        pipeline = replace(loaded, buffers=()).pipeline()
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
        _check_plan(loaded, shots, how_to_read(options))
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
            for output in denoise(chain(first, shot), found.pipeline(), lookahead):
                yield output
                done += 1

    named = {"sparse": options.method in ("halfres", "recirculation"), "others": filter(None, [options.plan])}
    return _process(options, "denoise", run, look, **named)


def _check_plan(loaded: Plan, shots: headers.Shots, reading: dict[str, Any]) -> None:
    """Raise ValueError for a shot that a plan is not for; the second file tells, as in `Planned.step`."""

    def misfit(buffers: Iterable[str], camera: Camera | None) -> str:
        return unsuited(loaded, [*buffers, *(["camera"] if camera else [])])

    for known in (shot[1] for shot in shots if len(shot) > 1):
        if misfit(known.channels, known.camera):
            # Pixels may tell that a buffer of the header is none, such as indices that are all 0.
            frame = read_exr(known.path, **reading)
            if found := misfit(frame.buffers(), frame.camera):
                raise ValueError(f"{known.path}: {found}")


def add_plan(command: Command) -> None:
    parser = command(_plan, "plan", "find out which stages of svgf and which buffers a sequence needs")
    parser.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=filename, help="write the plan, for yester denoise --plan"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a plan that exists")
    add_channels(parser)


def _plan(options: argparse.Namespace) -> None:
    need("exr", "OpenEXR", "tqdm")
    reading = how_to_read(options)
    paths = files_of(options.inputs)
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


def add_upscale(command: Command) -> None:
    parser = command(_upscale, "upscale", "temporally upscale a sequence of jittered EXR frames")
    add_files(parser)
    parser.add_argument("--scale", type=float, default=2.0, help="ratio of sizes along each side, 1 to 4; %(default)s")
    parser.add_argument("--sharpness", type=float, default=0.0, help="0 (off, the default) to 1")
    about = "redistribute samples far brighter than their surroundings first"
    parser.add_argument("--fireflies", action="store_true", help=about)
    parser.add_argument("--denoise", action="store_true", help="denoise with SVGF first")


def _upscale(options: argparse.Namespace) -> int:
    need("exr", "OpenEXR", "tqdm")
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


def _process(
    options: argparse.Namespace, what: str, run: Run, look: Callable[[headers.Shots], list[str]], **named: Any
) -> int:
    """Run a method on the frames of each shot; `look` makes lines of their headers, or raises ValueError."""
    from tqdm import tqdm

    if options.compression not in (None, *COMPRESSIONS):
        raise ValueError(f"--compression: expected one of {', '.join(COMPRESSIONS)}, got {options.compression}")
    named |= {"keep_going": options.keep_going, "tell": partial(tqdm.write, file=sys.stderr)}
    reading, paths = how_to_read(options), files_of(options.inputs)
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
