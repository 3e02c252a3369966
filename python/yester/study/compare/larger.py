"""Frames of the size that people render: ``python -m yester.study.compare.larger``.

The same sequences as everywhere, in 36 times as many pixels: objects cover more of them, so that a filter within one
frame has more samples of each surface, while there are no more frames to accumulate. Printed are the metrics of
Yester's denoisers and of Open Image Denoise for each sequence, with their time relative to that of `SVGF`, and their
means. Then how many passes of its filter the tiles of `SVGF` need: of those from which none is needed, a pass could
leave out the work.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from time import perf_counter

import numpy as np

from yester import BMFR, OIDN, SVGF, Frame

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import harm, samples
from .oracle import PASSES, TILE
from .samples import COLUMNS, Images, Method, cells, errors, steps

__all__ = ["METHODS", "SEQUENCES", "main", "needed"]

#: By name, what takes frames and yields images.
METHODS: Mapping[str, Method] = {
    "SVGF, both sides": samples.METHODS["SVGF, both sides"],
    "SVGF": steps(SVGF),
    "SVGF, no choice": steps(lambda: SVGF(choice=False)),
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


def _timed(method: Method, seconds: list[float]) -> Method:
    def run(frames: Iterable[Frame]) -> Images:
        start = perf_counter()
        images = [*method(frames)]
        seconds.append(perf_counter() - start)
        return iter(images)

    return run


def needed(recording: Recording) -> list[float]:
    """For each pass of the filter, the share of tiles that show any of it, or lie beside one that does.

    What a tile shows is interpolated between its choice and its neighbours', and a pass reads its neighbours' pixels.
    """
    denoiser, shares = SVGF(), []
    for i in range(len(recording.frames)):
        choice = denoiser.step(recording.frame(i)).choice
        if i in recording.references and choice is not None:
            rows, columns = (np.arange(0, side, TILE) for side in choice.shape)
            most = np.maximum.reduceat(np.maximum.reduceat(choice, rows, 0), columns, 1)
            padded = np.pad(most, 1, mode="edge")
            around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).max((-1, -2))
            shares.append([float(np.mean(around > passes)) for passes in PASSES[:-1]])
    return [float(mean) for mean in np.mean(shares, 0)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print two tables: rows of methods for each sequence, then their means; and the tiles that need each pass."""
    options = parser("yester.study.compare.larger", __doc__, SEQUENCES).parse_args(arguments)
    rows, found, relative = [["sequence", "", *COLUMNS.values(), "time"]], {}, {}
    passes = [["tiles that need pass", *map(str, PASSES[1:])]]
    for name in expand(options.sequences):
        recording = record(name, options.cache, frames=12, width=768, height=576, reference_spp=64)
        seconds: dict[str, list[float]] = {method: [] for method in METHODS}
        found[name] = errors(recording, {method: _timed(run, seconds[method]) for method, run in METHODS.items()})
        relative[name] = {method: sum(seconds[method]) / sum(seconds["SVGF"]) for method in METHODS}
        passes.append([name, *(f"{100 * share:.0f} %" for share in needed(recording))])
        for method in METHODS:
            rows.append([name, method, *cells([found[name][method]]), f"{relative[name][method]:.2f}"])
    for method in METHODS:
        time = np.mean([each[method] for each in relative.values()])
        rows.append(["mean", method, *cells(each[method] for each in found.values()), f"{time:.2f}"])
    print(harm.aligned(rows), harm.aligned(passes), sep="\n\n")


if __name__ == "__main__":
    main()
