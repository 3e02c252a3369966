"""The command line: parses arguments, calls the library and reports.

Each command imports its slow dependencies itself, so that the others start quickly.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import redirect_stderr, suppress
from io import StringIO, TextIOWrapper
from typing import Any, NoReturn, TextIO

from .. import __version__
from .._core import settings
from ..messages import told
from . import inspecting, sequences, studies, training, viewing

__all__ = ["main"]


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
            # Of one shot, that of motion comes twice, from both directions of time; those of files for every frame.
            for about in ("frames: later frames are not used", "motion:", "worldToNDC:", "depth: not used"):
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


#: In the order in which they are listed.
_COMMANDS = (
    studies.add_demo,
    sequences.add_denoise,
    sequences.add_plan,
    sequences.add_upscale,
    viewing.add_picture,
    viewing.add_compare,
    viewing.add_live,
    training.add_prepare,
    inspecting.add_info,
    inspecting.add_check,
    studies.add_chart,
    studies.add_stress,
    studies.add_bench,
)


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

    for add in _COMMANDS:
        add(command)
    return parser
