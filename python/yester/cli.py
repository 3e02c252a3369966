"""The command line: `yester demo`, `denoise` and `info`. It parses, calls and reports; the work is elsewhere."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from . import __version__
from ._core import settings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from . import Frame

# Whatever is slow to import is imported by the command that needs it.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; by default those that the process was started with.

    Returns
    -------
    int
        0; 2 if something given was wrong, after one line on stderr; 130 if interrupted.
    """
    try:
        options = _parser().parse_args(arguments)
        options.run(options)
    except KeyboardInterrupt:
        print("yester: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}" if error.filename and error.strerror else error)
    except (ImportError, ValueError) as error:
        return _failed(error)
    return 0


def _failed(error: object) -> int:
    print(f"yester: error: {error}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SystemExit(_failed(f"{message} ({self.prog} --help tells more)"))


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

    demo = command(_demo, "demo", "render a short noisy sequence with Mitsuba, denoise it and measure the result")
    demo.add_argument("-o", "--output", metavar="DIR", type=Path, default=Path("yester-demo"), help="%(default)s")
    demo.add_argument("--frames", metavar="N", type=_count, default=24, help="%(default)s")
    demo.add_argument("--size", metavar="WxH", type=_size, default=(320, 240), help="320x240")

    denoise = command(_denoise, "denoise", "denoise a sequence of EXR frames with SVGF")
    denoise.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    denoise.add_argument("-o", "--output", metavar="OUT", type=Path, required=True, help="folder for the same names")
    denoise.add_argument("--half", action="store_true", help="write float16")
    svgf = denoise.add_argument_group("filter", "see yester.SVGF for defaults, and for more").add_argument
    svgf("--alpha", type=float, help="least share of the new sample in the history, 0 to 1")
    svgf("--iterations", type=int, help="passes of the spatial filter, 0 to 16")
    svgf("--sigma-luminance", type=float, help="luminance difference that counts, in standard deviations")
    svgf("--feedback", action="store_true", default=None, help="keep the first pass as history: less noise, more bias")

    info = command(_info, "info", "tell what an EXR file holds, what it lacks and what that costs")
    info.add_argument("file", metavar="FILE", type=Path)
    return parser


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, got {value}")
    return value


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = map(_count, text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a size like 320x240, got {text}") from None
    return width, height


def _demo(options: argparse.Namespace) -> None:
    _need("demo", "OpenEXR", "PIL", "flip_evaluator", "matplotlib", "mitsuba", "tqdm")
    from .study import demo

    folder = _writable(options.output)
    width, height = options.size
    print(demo.run(folder, frames=options.frames, width=width, height=height))
    for name in ("contact_sheet.png", "side_by_side.webp", "noisy", "denoised", "reference"):
        print(folder / name)


def _denoise(options: argparse.Namespace) -> None:
    _need("exr", "OpenEXR", "tqdm")
    from tqdm import tqdm

    from . import SVGF
    from .io import sequence_paths, write_sequence

    given = {name: getattr(options, name) for name in ("alpha", "iterations", "sigma_luminance", "feedback")}
    svgf = SVGF(**{name: value for name, value in given.items() if value is not None})
    paths = sequence_paths(options.inputs)
    _check(paths, options.output)
    _writable(options.output)
    names = [path.name for path in paths]
    with tqdm(paths, "denoise", unit="frame", disable=None) as progress:
        write_sequence(options.output, _denoised(svgf, progress), names=names, half=options.half)


def _denoised(svgf: Any, paths: Iterator[Path]) -> Iterator[Frame]:
    from . import Frame
    from .io import read_exr

    for path in paths:
        frame = read_exr(path)
        yield Frame(svgf.step(frame).color, camera=frame.camera)


def _info(options: argparse.Namespace) -> None:
    _need("exr", "OpenEXR")
    from .io import describe

    known = describe(options.file)
    width = max(map(len, [*known.channels, *known.missing, "camera"]))
    print(f"{known.path}: {known.width} x {known.height}")
    for name, channels in known.channels.items():
        print(f"  {name:<{width}} {' '.join(channels)}")
        if name in known.notes:
            print(f"  {'':<{width}} {known.notes[name]}")
    if known.camera:
        print(f"  {'camera':<{width}} at {_vector(known.camera.position)}, looks along {_vector(known.camera.forward)}")
    if known.unrecognised:
        print(f"not recognised: {' '.join(known.unrecognised)}")
    if known.missing:
        print("missing:")
        for name, cost in known.missing.items():
            print(f"  {name:<{width}} {cost}")


def _vector(values: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{round(value, 4) + 0.0:g}' for value in values)})"


def _need(extra: str, *modules: str) -> None:
    absent = [name for name in modules if find_spec(name) is None]
    if absent:
        raise ImportError(f"{', '.join(absent)} not installed: pip install 'yester[{extra}]'")


def _check(paths: list[Path], output: Path) -> None:
    """Find out from the headers what would stop the work half-way."""
    from .io import describe

    first = None
    seen: dict[str, Path] = {}
    for path in paths:
        known = describe(path)
        first = first or known
        if "color" not in known.channels:
            raise ValueError(f"{path}: no colour: expected channels R, G and B, got {' '.join(known.unrecognised)}")
        if (known.width, known.height) != (first.width, first.height):
            raise ValueError(
                f"{path}: {known.width} x {known.height}, but {first.path} is {first.width} x {first.height}"
            )
        if ("albedo" in known.channels) != ("albedo" in first.channels):
            has, lacks = (path, first.path) if "albedo" in known.channels else (first.path, path)
            raise ValueError(f"{lacks}: no albedo, but {has} has one")
        if path.name in seen:
            raise ValueError(f"{path}: the output of {seen[path.name]} would have the same name")
        seen[path.name] = path
        if (output / path.name).resolve() == path.resolve():
            raise ValueError(f"{path}: the output would overwrite this input; choose another folder")


def _writable(folder: Path) -> Path:
    """Make the folder and try it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder
