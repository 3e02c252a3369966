"""`yester prepare`: training sets."""

from __future__ import annotations

import argparse
import sys

from ..argtypes import count, extent, filename
from .parsing import Command, add_channels, how_to_read, need

__all__ = ["add_prepare"]


def add_prepare(command: Command) -> None:
    parser = command(_prepare, "prepare", "prepare a training set from rendered sequences")
    about = "folders of EXR sequences, which may lie in folders, and Noisebase stores"
    parser.add_argument("inputs", metavar="IN", nargs="+", type=filename, help=about)
    about = "output folder; absent or empty, unless --resume"
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, required=True, help=about)
    about = "images of each frame, such as color history validity difference variance denoised demodulated reference"
    about += "; by default, all that the first sequence allows"
    parser.add_argument("--buffers", metavar="NAME", nargs="+", help=about)
    about = "sizes to write: full, half, or full half for both (default: full)"
    parser.add_argument("--sizes", metavar="SIZE", nargs="+", choices=("full", "half"), default=["full"], help=about)
    parser.add_argument("--crop", metavar="WxH", type=extent, help="cut windows of this size from each sequence")
    parser.add_argument("--crops", metavar="N", type=count, default=1, help="windows per sequence; %(default)s")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the windows' places; %(default)s")
    parser.add_argument("--half", action="store_true", help="store colours, normals and validity as float16")
    about = "a Zarr store for each sequence, or EXR files; %(default)s"
    parser.add_argument("--format", choices=("zarr", "exr"), default="zarr", help=about)
    about = "folder with the same EXR files without noise, for reference"
    parser.add_argument("--references", metavar="DIR", type=filename, help=about)
    parser.add_argument("--jobs", metavar="N", type=count, help="processes; by default, one per core")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="let the workers of this Dask scheduler do it")
    parser.add_argument("--resume", action="store_true", help="go on where an earlier run stopped")
    add_channels(parser)


def _prepare(options: argparse.Namespace) -> int:
    need("data", *(("zarr",) if options.format == "zarr" else ("OpenEXR",)), "tqdm")
    from ..prepare import prepare

    names = "buffers", "sizes", "crop", "crops", "seed", "half", "format", "references", "jobs", "scheduler", "resume"
    named = {name: getattr(options, name) for name in names}
    done = prepare(options.inputs, options.output, **named, **how_to_read(options))
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
