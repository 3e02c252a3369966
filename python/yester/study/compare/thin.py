"""What is thinner than a pixel: ``python -m yester.study.compare.thin``.

Printed are the metrics of `SVGF` with and without its coherence of guides, and of Open Image Denoise, for sequences of
fence, net, fur, grass and thicket, where normals and ids are not found again from frame to frame, and of gravel and a
hedge, where they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from yester import OIDN, SVGF, denoise

from ..rendered.recording import record
from ..rendered.sequences import expand, parser
from . import harm
from .samples import COLUMNS, Method, cells, errors, steps

__all__ = ["METHODS", "main"]

#: By name, what takes frames and yields images.
METHODS: Mapping[str, Method] = {
    "SVGF(coherence=False)": steps(lambda: SVGF(coherence=False)),
    "SVGF": steps(SVGF),
    "SVGF, both sides": lambda frames: (output.color for output in denoise(frames, SVGF())),
    "OIDN high": steps(lambda: OIDN("high")),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each sequence, means over three realisations of the noise."""
    options = parser("yester.study.compare.thin", __doc__, ("thin", "thicket", "grass")).parse_args(arguments)
    rows = [["sequence", "", *COLUMNS.values()]]
    for name in expand(options.sequences):
        recording = record(
            name, options.cache, frames=12, width=128, height=96, reference_spp=256, variants=2, raw_albedo=True
        )
        found = [errors(one, METHODS) for one in (recording, *recording.variants)]
        rows += [[name, method, *cells(each[method] for each in found)] for method in METHODS]
    print(harm.aligned(rows))


if __name__ == "__main__":
    main()
