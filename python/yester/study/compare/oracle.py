"""What could be gained by choosing more per tile: oracles that know the references choose between finished results.

For each tile of 8×8 pixels, one oracle takes the result with the least error in this frame, which no method could know,
and which chance flatters; another the one whose error was least so far, as a perfect judge of earlier frames would.
Results are those of SVGF with fixed numbers of passes, and SVGF with one component switched.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import SVGF, Frame
from yester.metrics import METRICS, Picture

from ..rendered.recording import Recording, record
from ..rendered.sequences import LATE, NAMES
from . import harm
from .ablation import ABLATIONS
from .methods import Run, pipeline

__all__ = ["ORACLES", "PASSES", "Gain", "chosen", "gains", "main"]

Image = NDArray[np.float32]

#: Passes between which `SVGF(choice=True)` chooses.
PASSES = range(5)
#: Sides of a tile in pixels.
TILE = 8
#: Which errors of a tile an oracle knows: of this frame, or of the frames before.
ORACLES = ("now", "before")
#: Weight of a frame's error in the mean over the frames before.
_SHARE = 0.3
_MEASURED = tuple(harm.LIMITS)[:3]


@dataclass(frozen=True)
class Gain:
    """The gain of choosing per tile between results, on one sequence.

    Attributes
    ----------
    scene, candidates : str
        Names of the sequence and of what there was to choose from.
    gains : dict of str to dict of str to float
        By oracle, by metric, the improvement over the default, as `harm.gains` has it. Of the candidates "passes" also
        by "none": the default's over a fixed number of passes, the usual one.
    """

    scene: str
    candidates: str
    gains: dict[str, dict[str, float]]


def chosen(results: Sequence[Image], errors: Sequence[NDArray[np.float64]]) -> Image:
    """Put an image together of the tiles with the least error.

    Parameters
    ----------
    results : sequence of (H, W, 3) ndarray
        The images to choose from.
    errors : sequence of ndarray
        Of each image, what `tile_errors` gives.

    Returns
    -------
    (H, W, 3) ndarray
        Of equal errors, the first image's tile.
    """
    best = np.argmin(np.stack(errors), 0)
    height, width, _ = results[0].shape
    which = np.kron(best, np.ones((TILE, TILE), int))[:height, :width, None]
    return np.choose(which, [*results])


def tile_errors(image: Image, reference: Image) -> NDArray[np.float64]:
    """The mean relative squared error of every tile: (⌈H/8⌉, ⌈W/8⌉), those at the border smaller."""
    square = np.mean((image - reference) ** 2, -1, dtype=np.float64) / (np.mean(reference, -1) ** 2 + 0.01)
    rows, columns = (np.arange(0, n, TILE) for n in square.shape)

    def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
        whole: NDArray[np.float64] = np.add.reduceat(np.add.reduceat(values, rows, 0), columns, 1)
        return whole

    return sums(square) / sums(np.ones_like(square))


def gains(recording: Recording) -> Iterator[Gain]:
    """Measure the oracles on a sequence with references, by its frames with a reference but the first of them."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    references = {i: recording.reference(i) for i in sorted(recording.references)}
    default = _results(pipeline(SVGF), frames, references)
    fixed = [_results(pipeline(SVGF, iterations=n, choice=False), frames, references) for n in PASSES]
    usual = _results(pipeline(SVGF, choice=False), frames, references)
    own = _values(default, references)
    found = {oracle: harm.gains(_values(_best(fixed, references, oracle), references), own) for oracle in ORACLES}
    yield Gain(recording.name, "passes", found | {"none": harm.gains(own, _values(usual, references))})
    for each in ABLATIONS:
        if each.whole.name == "SVGF" and each.component not in ("choice", "later frames"):
            pair = default, _results(each.method.run, frames, references)
            values = {oracle: _values(_best(pair, references, oracle), references) for oracle in ORACLES}
            yield Gain(recording.name, each.method.name, {key: harm.gains(value, own) for key, value in values.items()})


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of sequences, then that of components."""
    parser = argparse.ArgumentParser(prog="python -m yester.study.compare.oracle", description=__doc__)
    every = (*NAMES, *LATE)
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder for rendered frames")
    parser.add_argument("--sequences", metavar="NAME", nargs="+", default=every, choices=every, help="by default, all")
    options = parser.parse_args(arguments)
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 256}
    found = [gain for name in options.sequences for gain in gains(record(name, options.cache, **shape))]
    print("gain in PSNR of choosing the number of passes per tile, over the usual number")
    rows = [["", "default", *(f"oracle, {name}" for name in ORACLES)]]
    passes = {gain.scene: gain.gains for gain in found if gain.candidates == "passes"}
    for scene, known in passes.items():
        reached = known["none"]["psnr"]
        rows.append(
            [scene, *(f"{value:+.2f} dB" for value in (reached, *(reached + known[o]["psnr"] for o in ORACLES)))]
        )
    means = [[float(cell.split()[0]) for cell in row[1:]] for row in rows[1:]]
    rows.append(["mean", *(f"{value:+.2f} dB" for value in np.mean(means, 0))])
    print(harm.aligned(rows), end="\n\n")
    for oracle in ORACLES:
        print(f"gain of choosing per tile between the default and another, by the errors of {_KNOWN[oracle]}")
        others: dict[str, dict[str, Mapping[str, float]]] = {}
        for gain in found:
            if gain.candidates != "passes":
                others.setdefault(gain.candidates, {})[gain.scene] = gain.gains[oracle]
        print(harm.table(others), end="\n\n")


_KNOWN = {"now": "this frame", "before": "earlier frames"}


def _results(run: Run, frames: Sequence[Frame], references: Mapping[int, Image]) -> dict[int, Image]:
    return {i: result.color for i, result in enumerate(run(iter(frames))) if i in references}


def _best(candidates: Sequence[Mapping[int, Image]], references: Mapping[int, Image], oracle: str) -> dict[int, Image]:
    """An oracle's choice in every frame; of the first frame, that of the errors themselves."""
    known: list[NDArray[np.float64]] | None = None
    best = {}
    for i, reference in references.items():
        results = [candidate[i] for candidate in candidates]
        errors = [tile_errors(result, reference) for result in results]
        best[i] = chosen(results, errors if oracle == "now" or known is None else known)
        known = (
            errors if known is None else [old + _SHARE * (new - old) for old, new in zip(known, errors, strict=True)]
        )
    return best


def _values(images: Mapping[int, Image], references: Mapping[int, Image]) -> dict[str, float]:
    """By metric, the mean over all frames but the first, in which no oracle knows the past."""
    pairs = [(Picture(images[i]), Picture(references[i])) for i in [*references][1:]]
    return {key: float(np.mean([METRICS[key].measure(*pair) for pair in pairs])) for key in _MEASURED}


if __name__ == "__main__":
    main()
