"""Compares two bindings of Open Image Denoise: ``python -m yester.study.compare.networks``.

Each denoises the same frames of the Cornell box in a process of its own, in quality "high", with albedo and normals.
The table has the size of each package and of the packages that it needs, the fastest frame, the cores that are busy on
average, the peak memory beyond that of the inputs, and the largest difference from the first row's images, relative to
their values plus 0.01. A package that is not installed is left out: ``pip install pyoidn`` adds the second one. Linux
only, as memory is read from ``/proc``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, files
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from yester import Frame
from yester._core import settings
from yester.io.mitsuba import render_sequence
from yester.oidn import Network

from ..rendered.scenes import cornell_box
from ..speed.bench import resident

__all__ = ["PACKAGES", "table"]

#: What is installed with each.
PACKAGES = {
    "mitsuba-oidn": ("mitsuba-oidn", "drjit", "nanobind-backend"),
    "pyoidn": ("pyoidn", "cffi", "pycparser"),
}
_RUNS = 3


def _mitsuba_oidn(frame: Frame) -> Callable[[], NDArray[np.float32]]:
    network = Network("high")
    network.take(frame.color, frame)
    return network.run


def _pyoidn(frame: Frame) -> Callable[[], NDArray[np.float32]]:
    import pyoidn

    device = pyoidn.Device()
    device.set_int("numThreads", settings()[0])
    device.commit()
    filter, output = pyoidn.Filter(device), np.empty_like(frame.color)
    filter.set_bool("hdr", True)
    filter.set_quality(pyoidn.OIDN_QUALITY_HIGH)
    for name, image in (("color", frame.color), ("albedo", frame.albedo), ("normal", frame.normal), ("output", output)):
        filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
    filter.commit()

    def run() -> NDArray[np.float32]:
        filter.execute()
        return output

    return run


def _measure(name: str, frames: Sequence[Frame]) -> tuple[float, float, float, list[NDArray[np.float32]]]:
    """Seconds of the fastest run, busy cores, peak memory in MB, and the images."""
    start = {"mitsuba-oidn": _mitsuba_oidn, "pyoidn": _pyoidn}[name]
    before, _ = resident()
    run = start(frames[0])
    run()
    wall, spent, times = time.perf_counter(), time.process_time(), []
    for _ in range(_RUNS):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    busy = (time.process_time() - spent) / (time.perf_counter() - wall)
    _, most = resident()
    return min(times), busy, most - before, [start(frame)().copy() for frame in frames]


def table(width: int = 1280, height: int = 720) -> str:
    """The comparison of the installed packages, in Markdown."""
    sequence = cornell_box(3, width, height)
    frames = [
        Frame(frame.color.clip(0), albedo=frame.albedo, normal=frame.normal)
        for frame in render_sequence(sequence.scene, sequence.cameras, transforms=sequence.transforms)
    ]
    lines = [
        "| package | MB installed | s a frame | cores | peak MB | largest difference |",
        "|---|---|---|---|---|---|",
    ]
    first: list[NDArray[np.float32]] = []
    for name, parts in PACKAGES.items():
        try:
            size = sum(file.size or 0 for part in parts for file in files(part) or ()) / 1e6
        except PackageNotFoundError:
            continue
        with get_context("spawn").Pool(1) as pool:
            seconds, busy, memory, images = pool.apply(_measure, (name, frames))
        first = first or images
        difference = max(float((np.abs(a - b) / (b + 0.01)).max()) for a, b in zip(images, first, strict=True))
        lines.append(f"| {name} | {size:.0f} | {seconds:.3g} | {busy:.2f} | {memory:.4g} | {difference:.1e} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.networks", description=__doc__)
    parser.add_argument("--size", default="1280x720", help="of the images; %(default)s")
    options = parser.parse_args(arguments)
    print(table(*map(int, options.size.split("x"))))


if __name__ == "__main__":
    main()
