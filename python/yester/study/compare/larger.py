"""Frames of the size that people render: ``python -m yester.study.compare.larger``.

The same sequences as everywhere, in 36 times as many pixels: objects cover more of them, so that a filter within one
frame has more samples of each surface, while there are no more frames to accumulate. Printed are the metrics of
Yester's denoisers and of Open Image Denoise for each sequence, and their means.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from yester import BMFR, OIDN, SVGF

from ..rendered.recording import record
from ..rendered.sequences import expand, parser
from . import harm, samples
from .samples import COLUMNS, Method, cells, errors, steps

__all__ = ["METHODS", "SEQUENCES", "main"]

#: By name, what takes frames and yields images.
METHODS: Mapping[str, Method] = {
    "SVGF, both sides": samples.METHODS["SVGF, both sides"],
    "SVGF": steps(SVGF),
    "BMFR": steps(BMFR),
    "OIDN high": steps(lambda: OIDN("high")),
    "OIDN high, temporal": steps(lambda: OIDN("high", temporal=True)),
}
#: Of every group.
SEQUENCES = (
    "cornell_box",
    "glossy_plates",
    "mirror_room",
    "tapestry",
    "moving_light",
    "black_plastic",
    "glassware",
    "grass",
    "caustics",
    "opening_door",
    "neon_corridor",
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each sequence, then their means."""
    options = parser("yester.study.compare.larger", __doc__, SEQUENCES).parse_args(arguments)
    rows, found = [["sequence", "", *COLUMNS.values()]], {}
    for name in expand(options.sequences):
        recording = record(name, options.cache, frames=12, width=768, height=576, reference_spp=64)
        found[name] = errors(recording, METHODS)
        rows += [[name, method, *cells([found[name][method]])] for method in METHODS]
    rows += [["mean", method, *cells(each[method] for each in found.values())] for method in METHODS]
    print(harm.aligned(rows))


if __name__ == "__main__":
    main()
