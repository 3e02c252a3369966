"""Frames that are hard to demodulate: ``python -m yester.study.compare.trust``.

Sky, glass, metal, black plastic and small bright lamps, with buffers as renderers give them. What is divided by their
albedo becomes very bright, and real highlights look like fireflies. Printed are the means over three realisations of
the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from yester import OIDN, SVGF, denoise

from ..rendered.recording import record
from ..rendered.sequences import expand, parser
from . import harm
from .doors import DOORS, FULL, enter
from .samples import COLUMNS, cells, compare, steps

__all__ = ["CASES", "METHODS", "main"]

#: Sequences, and the doors through which their frames come.
CASES = (
    ("grass", "no emission"),
    ("naked_lamps", "no emission"),
    ("naked_lamps", FULL),
    ("glassware", FULL),
    ("black_plastic", FULL),
    ("glassware", "raw albedo, no emission"),
    ("brushed_metal", "raw albedo, no emission"),
)
#: By name, what takes frames and yields images.
METHODS = {
    "SVGF(fireflies=True)": steps(lambda: SVGF(fireflies=True)),
    "SVGF": steps(SVGF),
    "SVGF, both sides": lambda frames: (output.color for output in denoise(frames, SVGF())),
    "OIDN high": steps(lambda: OIDN("high")),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each case."""
    names = tuple(dict.fromkeys(name for name, _ in CASES))
    options = parser("yester.study.compare.trust", __doc__, names).parse_args(arguments)
    chosen, rows = expand(options.sequences), [["sequence", "frames", "", *COLUMNS.values()]]
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 256}
    for name, entered in CASES:
        if name not in chosen:
            continue
        recording = record(name, options.cache, **shape, variants=2, raw_albedo=True)
        (door,) = (each for each in DOORS if each.name == entered)
        references = {i: recording.reference(i) for i in recording.references}
        measured = []
        for each in (recording, *recording.variants):
            frames = [*enter(door, map(each.frame, range(len(each.frames))), each)]
            measured.append(compare(frames, references, METHODS))
        rows += [[name, entered, method, *cells(found[method] for found in measured)] for method in METHODS]
    print(harm.aligned(rows))


if __name__ == "__main__":
    main()
