"""`yester picture`, `compare` and `live`: what is to be seen."""

from __future__ import annotations

import argparse
import sys
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ..argtypes import count, extent, filename, whole
from ..io import Description, describe, headers, read_exr
from ..io.ahead import ahead
from ..messages import told
from ..outputs import FILMS, keep_inputs, spare, targets_of, writable
from .parsing import Command, files_of, need

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["add_compare", "add_live", "add_picture"]


def add_picture(command: Command) -> None:
    parser = command(_picture, "picture", "turn EXR frames into PNG files or an animation")
    parser.add_argument("inputs", metavar="IN", nargs="+", help="a folder, files or a pattern; in natural order")
    about = "folder for PNG files of the same names; for one file, also a name that ends in .png; an animation, if the "
    about += "name ends in .webp or .mp4"
    parser.add_argument("-o", "--output", metavar="OUT", type=filename, required=True, help=about)
    about = "exposure in stops (default: %(default)s)"
    parser.add_argument("--exposure", metavar="STOPS", type=float, default=0.0, help=about)
    about = "tone curve: clip (default), reinhard or aces"
    parser.add_argument("--curve", choices=("clip", "reinhard", "aces"), default="clip", help=about)
    parser.add_argument("--fps", type=float, default=24.0, help="of animations; %(default)s")
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")


def _picture(options: argparse.Namespace) -> int:
    need("picture", "OpenEXR", "PIL", "tqdm")
    from tqdm import tqdm

    from ..io.pictures import check_rate, displayed, write_animation, write_png

    paths = files_of(options.inputs)
    look = {"exposure": options.exposure, "curve": options.curve}
    # Raises for an exposure that is not finite.
    displayed([[[0, 0, 0]]], **look)
    film = options.output.suffix.lower() in FILMS
    targets = [options.output] if film else targets_of(paths, options.output, ".png", *FILMS)
    keep_inputs(targets, paths)
    spare(targets, overwrite=options.overwrite)
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


def add_compare(command: Command) -> None:
    parser = command(
        _compare, "compare", "write a page that compares the frames of two or three folders, with exposure"
    )
    for name, about in (("a", "EXR frames: a folder or a file"), ("b", "frames of the same names, to compare with A")):
        parser.add_argument(name, metavar=name.upper(), type=filename, help=about)
    about = "frames of the same names without noise"
    parser.add_argument("reference", metavar="REFERENCE", nargs="?", type=filename, help=about)
    about = "output page (default: %(default)s)"
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=filename, default=Path("yester-compare.html"), help=about
    )
    parser.add_argument("--frames", metavar="N", type=count, default=8, help="evenly spread; %(default)s")
    parser.add_argument("--half", action="store_true", help="round to float16: a smaller page")
    parser.add_argument("--overwrite", action="store_true", help="replace a page that exists")
    parser.add_argument("--open", action="store_true", help="open it in a browser")


def _compare(options: argparse.Namespace) -> None:
    need("exr", "OpenEXR", "tqdm")
    from ..study.compare.viewer import names_of, write_comparison

    spare([options.output], overwrite=options.overwrite)
    writable(options.output.parent)
    paths = [path for path in (options.a, options.b, options.reference) if path is not None]
    sources = dict(zip(names_of(paths), paths, strict=True))
    write_comparison(options.output, sources, frames=options.frames, half=options.half)
    print(options.output)
    if options.open:
        import webbrowser

        webbrowser.open(options.output.resolve().as_uri())


def add_live(command: Command) -> None:
    parser = command(_live, "live", "turn the camera of a scene in a browser, and watch it being denoised")
    about = "a Mitsuba scene; by default, the Cornell box of the demo"
    parser.add_argument("scene", metavar="SCENE.xml", nargs="?", type=filename, help=about)
    about = "largest size, from which the resolution adapts; by default that of the scene, or 640x480"
    parser.add_argument("--size", metavar="WxH", type=extent, help=about)
    parser.add_argument("--port", metavar="N", type=whole, default=0, help="by default, any that is free")
    parser.add_argument("--no-open", action="store_true", help="print the address, but open no browser")
    about = "where recordings go; by default the current folder"
    parser.add_argument("-o", "--output", metavar="DIR", type=filename, default=Path(), help=about)


def _live(options: argparse.Namespace) -> None:
    need("live", "aiohttp", "mitsuba", "OpenEXR", "matplotlib")
    from .. import live

    if options.port > 65535:
        raise ValueError(f"--port: expected 0 to 65535, got {options.port}")
    if options.scene is not None and not options.scene.is_file():
        raise ValueError(f"{options.scene}: no such file")
    writable(options.output)
    named = {"size": options.size, "port": options.port, "folder": options.output}
    live.run(options.scene, browser=not options.no_open, **named)
