"""Frames of more than one sample: ``python -m yester.study.compare.samples``.

Eight sequences are rendered with 1 to 64 samples per pixel, and denoised by `SVGF`, by `SVGF` of which all tiles show
the output stage's result (``TAA("denoised", choice=False)``), by `SVGF` with frames on both sides, and by Open Image
Denoise. Printed are the means, beside those of the frames as they were rendered.
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

__all__ = ["METHODS", "SEQUENCES", "errors", "main"]

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
_SAMPLES = (1, 2, 4, 16, 64)
_MEASURED = ("psnr", "relmse", "flip")

Images = Iterator[NDArray[np.float32]]


def _whole_stage(frames: Iterable[Frame]) -> Images:
    denoiser, stage = SVGF(antialias=False), TAA("denoised", innovation=True, choice=False)
    for frame in frames:
        smooth = replace(frame, color=denoiser.step(frame).color)
        yield stage.step(smooth, samples=frame.color).color


def _steps(make: Callable[[], Any]) -> Callable[[Iterable[Frame]], Images]:
    def run(frames: Iterable[Frame]) -> Images:
        pipeline = make()
        return (pipeline.step(frame).color for frame in frames)

    return run


#: By name, what takes frames and yields images.
METHODS: Mapping[str, Callable[[Iterable[Frame]], Images]] = {
    "as rendered": lambda frames: (frame.color for frame in frames),
    "SVGF, stage everywhere": _whole_stage,
    "SVGF": _steps(SVGF),
    "SVGF, both sides": lambda frames: (output.color for output in denoise(frames, SVGF())),
    "OIDN high": _steps(lambda: OIDN("high")),
}


def errors(recording: Recording) -> dict[str, dict[str, float]]:
    """By method and metric, the mean over the frames that have a reference."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    found = {}
    for name, run in METHODS.items():
        images = [*run(frames)]
        pairs = [(Picture(images[i]), Picture(recording.reference(i))) for i in recording.references]
        found[name] = {key: float(np.mean([METRICS[key].measure(*pair) for pair in pairs])) for key in _MEASURED}
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each number of samples."""
    options = parser("yester.study.compare.samples", __doc__, SEQUENCES).parse_args(arguments)
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 1024}
    rows = [["samples", "", "PSNR, dB", "relMSE", "FLIP"]]
    for spp in _SAMPLES:
        found = [errors(record(name, options.cache, spp=spp, **shape)) for name in expand(options.sequences)]
        for method in METHODS:
            psnr, relmse, flip = (np.mean([each[method][key] for each in found]) for key in _MEASURED)
            rows.append([str(spp), method, f"{psnr:.2f}", f"{relmse:.4f}", f"{flip:.4f}"])
    print(harm.aligned(rows))


if __name__ == "__main__":
    main()
