"""Exposure that changes: ``python -m yester.study.compare.faded``.

Sequences are denoised as they are; with all light times a factor that differs from frame to frame, as of a lamp that
flickers; and with one that falls by a tenth from frame to frame, as in a fade. What is denoised is divided by the
factor before it is compared, so that the rows of a method would be the same if it followed the light. Printed are the
means over the sequences.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from yester import BMFR, OIDN, SVGF, Frame, denoise

from ..rendered.recording import record
from ..rendered.sequences import expand, parser
from . import harm
from .repeated import SEQUENCES
from .samples import COLUMNS, Images, Method, cells, compare, steps

__all__ = ["FACTORS", "METHODS", "main"]

_FRAMES = 12
#: By kind, the factor of each frame.
FACTORS = {
    "constant": np.ones(_FRAMES),
    "flicker": np.random.default_rng(0).uniform(0.6, 1.4, _FRAMES),
    "fade": 0.9 ** np.arange(_FRAMES),
}
#: By name, what takes frames and yields images.
METHODS = {
    "as rendered": lambda frames: (frame.color for frame in frames),
    "SVGF(innovation=False)": steps(lambda: SVGF(innovation=False)),
    "SVGF": steps(SVGF),
    "SVGF, both sides": lambda frames: (output.color for output in denoise(frames, SVGF())),
    "BMFR": steps(BMFR),
    "OIDN high": steps(lambda: OIDN("high")),
    "OIDN high, temporal": steps(lambda: OIDN("high", temporal=True)),
}


def _faded(frame: Frame, factor: np.float32) -> Frame:
    emission = None if frame.emission is None else frame.emission * factor
    return replace(frame, color=frame.color * factor, emission=emission)


def _through(factors: Sequence[np.float32], method: Method) -> Method:
    """The method on faded frames, whose images are brought back."""

    def run(frames: Iterable[Frame]) -> Images:
        faded = [_faded(frame, factor) for frame, factor in zip(frames, factors, strict=True)]
        return (image / factor for image, factor in zip(method(faded), factors, strict=True))

    return run


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each kind of exposure."""
    options = parser("yester.study.compare.faded", __doc__, SEQUENCES).parse_args(arguments)
    names = expand(options.sequences)
    rows = [["exposure", "", *COLUMNS.values()]]
    for kind, factors in FACTORS.items():
        each = [np.float32(factor) for factor in factors]
        methods = {name: _through(each, method) for name, method in METHODS.items()}
        measured = []
        for name in names:
            recording = record(name, options.cache, frames=_FRAMES, width=128, height=96, reference_spp=256)
            frames = [recording.frame(i) for i in range(_FRAMES)]
            references = {i: recording.reference(i) for i in recording.references}
            measured.append(compare(frames, references, methods))
        rows += [[kind, method, *cells(found[method] for found in measured)] for method in METHODS]
    print(harm.aligned(rows))


if __name__ == "__main__":
    main()
