"""Compares readers of EXR files on a large multilayer file: whole, and only what a frame needs.

    python -m yester.study.speed.readers [-o FILE.md] [--size 1920x1080] [--runs 7] [--rust]

The file has the passes that Blender Cycles writes for denoising and compositing, in one part or in one for each pass.
All readers take the file's own numbers of bits, use all threads and are run in turns; the fastest run counts, as other
work on the machine only adds time. ``--rust`` builds a program for the crate `exr` in a temporary folder, which needs
cargo and downloads the crate. OpenImageIO is left out where it is not installed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from yester.io import exr, read_exr
from yester.io.files import beside

__all__ = ["compare", "main", "make"]

#: Passes and their components.
PASSES = {
    **dict.fromkeys(("Combined", "Noisy Image"), "RGBA"),
    **dict.fromkeys(("Denoising Albedo", "DiffDir", "DiffInd", "GlossDir", "GlossInd", "Emit", "Env"), "RGB"),
    **dict.fromkeys(("Denoising Normal", "Normal", "Position"), "XYZ"),
    **dict.fromkeys(("Depth", "Denoising Depth"), "Z"),
    "Vector": "XYZW",
    **dict.fromkeys(("CryptoObject00", "CryptoObject01", "CryptoObject02"), "rgba"),
}
#: Those that a frame needs.
NEEDED = (
    *("Noisy Image", "Denoising Albedo", "Normal", "Depth", "Vector", "Position", "Emit", "Env"),
    *("CryptoObject00", "CryptoObject01", "CryptoObject02"),
)

_RUST = """
use exr::block::reader::ChunksReader;
use exr::prelude::*;
use std::{env, fs::File, io::BufReader, time::Instant};

fn parts(path: &str, wanted: &[&str]) -> usize {
    let reader = exr::block::read(BufReader::new(File::open(path).unwrap()), false).unwrap();
    let has = |name: String| wanted.iter().any(|layer| name.contains(&format!(".{layer}.")));
    let headers = reader.headers().iter();
    let keep: Vec<bool> =
        headers.map(|header| header.channels.list.iter().any(|one| has(one.name.to_string()))).collect();
    let chunks = reader.filter_chunks(false, |_, _, block| keep[block.layer]).unwrap();
    let mut pixels = Vec::new();
    chunks
        .decompress_parallel(false, |file, block| {
            for line in block.lines(&file.headers[block.index.layer].channels) {
                for sample in line.read_samples::<f32>() {
                    pixels.push(sample?);
                }
            }
            Ok(())
        })
        .unwrap();
    pixels.len()
}

fn main() {
    let given: Vec<String> = env::args().collect();
    let wanted: Vec<&str> = given[2..].iter().map(String::as_str).collect();
    let start = Instant::now();
    if wanted.is_empty() {
        let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
        image.from_file(&given[1]).unwrap();
    } else {
        parts(&given[1], &wanted);
    }
    println!("{}", start.elapsed().as_secs_f64());
}
"""
_CARGO = '[package]\nname = "readers"\nversion = "0.0.0"\nedition = "2021"\n[dependencies]\nexr = "1.74"\n'


def make(path: Path, width: int, height: int, *, parts: bool) -> None:
    """Write a file with smooth and noisy passes, ZIP-compressed: one part, or one for each pass."""
    openexr: Any = import_module("OpenEXR")
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    channels: dict[str, dict[str, Any]] = {}
    for i, (name, components) in enumerate(PASSES.items()):
        for component in components:
            plane = np.sin(x / (17 + i)) * np.cos(y / (23 + i)) + 1
            if name.startswith("Crypto"):
                plane = np.floor(plane * 4)
            elif name not in ("Denoising Albedo", "Normal", "Depth", "Vector", "Position"):
                plane = plane * rng.exponential(1, plane.shape)
            full = f"ViewLayer.{name}.{component}"
            channels.setdefault(name, {})[full] = np.ascontiguousarray(plane, np.float32)
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage, "Software": "Blender 5.0.0"}
    if parts:
        found = [openexr.Part(dict(header), planes, f"ViewLayer.{name}") for name, planes in channels.items()]
    else:
        found = [openexr.Part(header, {name: plane for planes in channels.values() for name, plane in planes.items()})]
    openexr.File(found).write(str(path))


def compare(path: Path, rust: Path | None = None, runs: int = 7) -> dict[str, float]:
    """Seconds that each way to read a file takes, in its fastest run.

    Parameters
    ----------
    path : Path
        A file of `make`.
    rust : Path, optional
        The program for the crate `exr`.
    runs : int, default 7
        Runs of each, in turns, after one that does not count.

    Returns
    -------
    dict of str to float
    """
    openexr: Any = import_module("OpenEXR")
    ways: dict[str, Callable[[], object]] = {
        "OpenEXR, whole": lambda: openexr.File(str(path), separate_channels=True),
        "OpenEXR, needed parts (yester)": lambda: _needed(path),
        "read_exr: needed parts, checked and converted": lambda: read_exr(path),
    }
    if find_spec("OpenImageIO"):
        ways["OpenImageIO, whole"] = lambda: _oiio(path, ())
        ways["OpenImageIO, needed channels"] = lambda: _oiio(path, NEEDED)
    times: dict[str, list[float]] = {}
    for _ in range(runs + 1):
        for name, read in ways.items():
            start = time.perf_counter()
            read()
            times.setdefault(name, []).append(time.perf_counter() - start)
        for name, wanted in (("crate exr, whole", ()), ("crate exr, needed parts", NEEDED)) if rust else ():
            said = subprocess.run([str(rust), str(path), *wanted], capture_output=True, text=True, check=True)
            times.setdefault(name, []).append(float(said.stdout))
    return {name: min(several[1:]) for name, several in times.items()}


def _needed(path: Path) -> object:
    contents = exr.read_headers(path, None, None)
    return exr.read_pixels(contents, contents.needed())


def _oiio(path: Path, wanted: Sequence[str]) -> list[Any]:
    """The pixels of each run of wanted channels, or of all."""
    oiio: Any = import_module("OpenImageIO")
    image = oiio.ImageInput.open(str(path))
    found = []
    part = 0
    while image.seek_subimage(part, 0):
        names = image.spec().channelnames
        if len({name.split(".")[1] for name in names}) > 1 and wanted:
            # One part: chunks have all channels, and decoding them once for each layer would be slower still.
            found.append(image.read_image(part, 0, 0, len(names), "float"))
        elif not wanted or names[0].split(".")[1] in wanted:
            found.append(image.read_image(part, 0, 0, len(names), "float"))
        part += 1
    return found


def _built(folder: Path) -> Path:
    """The program for the crate `exr`."""
    (folder / "src").mkdir()
    (folder / "src" / "main.rs").write_text(_RUST)
    (folder / "Cargo.toml").write_text(_CARGO)
    target = os.environ.get("CARGO_TARGET_DIR", str(folder / "target"))
    subprocess.run(["cargo", "build", "--quiet", "--release"], cwd=folder, check=True)
    return Path(target) / "release" / "readers"


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare, and print a table in Markdown; see the module."""
    parser = argparse.ArgumentParser(prog="python -m yester.study.speed.readers", description=main.__doc__)
    parser.add_argument("-o", "--output", type=Path, help="also write the table there")
    parser.add_argument("--size", default="1920x1080", help="%(default)s")
    parser.add_argument("--runs", type=int, default=7, help="%(default)s")
    parser.add_argument("--rust", action="store_true", help="build a program for the crate exr, too")
    options = parser.parse_args(arguments)
    width, height = map(int, options.size.split("x"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rust = _built(folder) if options.rust else None
        measured = {}
        for kind in (False, True):
            path = folder / f"{'parts' if kind else 'one'}.exr"
            make(path, width, height, parts=kind)
            measured[f"a part for each pass ({path.stat().st_size / 1e6:.0f} MB)" if kind else "one part"] = compare(
                path, rust, options.runs
            )
    heads = list(measured)
    count = sum(map(len, PASSES.values()))
    needed = sum(len(PASSES[name]) for name in NEEDED)
    lines = [
        f"{width}x{height}, {count} float channels in {len(PASSES)} passes, of which {needed} are needed; ZIP. "
        "Milliseconds.",
        "",
        f"| reader | {' | '.join(heads)} |",
        f"|---|{'---|' * len(heads)}",
        *(
            f"| {reader} | {' | '.join(f'{1000 * measured[head][reader]:.0f}' for head in heads)} |"
            for reader in measured[heads[0]]
        ),
    ]
    table = "\n".join(lines) + "\n"
    print(table)
    if options.output:
        with beside(options.output) as temporary:
            temporary.write_text(table)


if __name__ == "__main__":
    main()
