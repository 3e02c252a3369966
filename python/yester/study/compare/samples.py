"""Frames of more than one sample: ``python -m yester.study.compare.samples``.

Fourteen sequences are rendered with 1 to 64 samples per pixel, and denoised by `SVGF`, by `SVGF` of which all tiles
show the output stage's result (``TAA("denoised", choice=False)``), by `SVGF` with frames on both sides, and by Open
Image Denoise. Printed are the means over those by which constants were set, then over those first looked at after,
beside those of the frames as they were rendered; then the sequences to which samples in the result do most harm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import OIDN, SVGF, TAA, Frame, denoise
from yester.metrics import METRICS, Picture

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import harm

__all__ = ["COLUMNS", "HELD_OUT", "METHODS", "SEQUENCES", "Method", "cells", "compare", "errors", "main", "steps"]

#: Of every kind: edges, texture, leaves, highlights, mirrors, lamps.
SEQUENCES = (
    "cornell_box",
    "glossy_plates",
    "thicket",
    "sunlit_teapot",
    "tapestry",
    "black_plastic",
    "naked_lamps",
    "grass",
)
#: With more samples, not looked at before the constants were set, but for the share of denoised colour from which all
#: tiles take it.
HELD_OUT = ("glassware", "brushed_metal", "spinning_shapes", "caustics", "opening_door", "fast_dolly")
_SAMPLES = (1, 2, 4, 16, 64)
#: The metrics, with their columns; the last one compares two frames.
COLUMNS = {"psnr": "PSNR", "relmse": "relMSE", "flip": "FLIP", "temporal_error": "temporal"}
_CHANGE = "temporal_error"

Images = Iterator[NDArray[np.float32]]
#: Takes frames and yields images.
Method = Callable[[Iterable[Frame]], Images]


def _whole_stage(frames: Iterable[Frame]) -> Images:
    denoiser, stage = SVGF(antialias=False), TAA("denoised", innovation=True, choice=False)
    for frame in frames:
        smooth = replace(frame, color=denoiser.step(frame).color)
        yield stage.step(smooth, samples=frame.color).color


def steps(make: Callable[[], Any]) -> Method:
    """What yields the images of a pipeline."""

    def run(frames: Iterable[Frame]) -> Images:
        pipeline = make()
        return (pipeline.step(frame).color for frame in frames)

    return run


#: By name, what takes frames and yields images.
METHODS: Mapping[str, Method] = {
    "as rendered": lambda frames: (frame.color for frame in frames),
    "SVGF, stage everywhere": _whole_stage,
    "SVGF": steps(SVGF),
    "SVGF, both sides": lambda frames: (output.color for output in denoise(frames, SVGF())),
    "OIDN high": steps(lambda: OIDN("high")),
}


def errors(recording: Recording, methods: Mapping[str, Method] = METHODS) -> dict[str, dict[str, float]]:
    """By method and metric, the mean over the frames that have a reference."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    return compare(frames, {i: recording.reference(i) for i in recording.references}, methods)


def compare(
    frames: Sequence[Frame], known: Mapping[int, NDArray[np.float32]], methods: Mapping[str, Method]
) -> dict[str, dict[str, float]]:
    """By method and metric, the mean over the frames of known reference, which are given by their numbers."""
    references, found = {i: Picture(reference) for i, reference in known.items()}, {}
    for name, run in methods.items():
        images = [Picture(image) for image in run(frames)]
        values = {
            key: [METRICS[key].measure(images[i], reference) for i, reference in references.items()]
            for key in COLUMNS
            if key != _CHANGE
        }
        values[_CHANGE] = [
            METRICS[_CHANGE].measure(images[i], images[i - 1], reference, references[i - 1])
            for i, reference in references.items()
            if i - 1 in references
        ]
        found[name] = {key: float(np.mean(each)) for key, each in values.items() if each}
    return found


def cells(found: Iterable[Mapping[str, float]]) -> list[str]:
    """Columns of the means over some sequences."""
    known = [*found]
    means = {key: float(np.mean([each[key] for each in known])) for key in COLUMNS}
    return [f"{mean:.2f}" if key == "psnr" else f"{mean:.4f}" for key, mean in means.items()]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each number of samples, columns of metrics for each group of sequences."""
    command = parser("yester.study.compare.samples", __doc__, SEQUENCES + HELD_OUT)
    command.add_argument("--reference-spp", metavar="N", type=int, default=1024, help="of references; 1024")
    options = command.parse_args(arguments)
    names = expand(options.sequences)
    groups = [[name for name in names if (name in HELD_OUT) == late] for late in (False, True)]
    groups = [group for group in groups if group]
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": options.reference_spp}
    rows = [["samples", "", *[*COLUMNS.values()] * len(groups)]]
    worst = [["samples", *[f"worst {name}" for name in COLUMNS.values()]]]
    for spp in _SAMPLES:
        found = {name: errors(record(name, options.cache, spp=spp, **shape)) for name in names}
        for method in METHODS:
            row = [str(spp), method]
            for group in groups:
                row += cells(found[name][method] for name in group)
            rows.append(row)
        gained = {name: harm.gains(each["SVGF"], each["SVGF, stage everywhere"]) for name, each in found.items()}
        losses = []
        for key in COLUMNS:
            gain, name = min((each[key], name) for name, each in gained.items())
            losses.append(f"{harm.amount(key, gain)} {name}")
        worst.append([str(spp), *losses])
    print(harm.aligned(rows), harm.aligned(worst), sep="\n\n")


if __name__ == "__main__":
    main()
