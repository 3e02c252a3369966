"""Upper bounds of a choice per tile: oracles that know the references choose between finished results.

For each tile of 8×8 pixels, the first oracle takes the result with the least error in the current frame. No method can
know that error, and noise flatters the choice. The second oracle takes the result with the least error in the frames
before, as a method with perfect error estimates could. Candidates are the results of `SVGF` with fixed numbers of
passes, or the results with and without one component. Run by ``python -m yester.study.compare.oracle``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import SVGF, Frame
from yester.judge import tile_sums
from yester.metrics import METRICS, Picture

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, parser
from . import harm
from .ablation import ABLATIONS, bases
from .methods import Run, pipeline

__all__ = ["ORACLES", "PARTS", "PASSES", "Gain", "chosen", "gains", "main"]

Image = NDArray[np.float32]

#: Numbers of passes between which `SVGF(choice=True)` chooses.
PASSES = range(5)
#: Sides of a tile in pixels.
TILE = 8
#: The oracles, by the errors of a tile that they know: of this frame, or of the frames before.
ORACLES = ("now", "before")
#: The components with and without which the oracles choose.
PARTS = tuple(
    each for each in ABLATIONS if each.whole.name == "SVGF" and each.component not in ("choice", "later frames")
)
#: Weight of the newest frame in the running mean of errors.
_SHARE = 0.3
_MEASURED = tuple(harm.LIMITS)[:3]


@dataclass(frozen=True)
class Gain:
    """The gain of choosing per tile between results, on one sequence.

    Attributes
    ----------
    scene, candidates : str
        Names of the sequence and of the candidates: "passes", or the method with one component switched.
    gains : dict of str to dict of str to float
        By oracle and metric, the improvement over the method in which the component is switched, as `harm.gains`
        returns it. For candidates "passes", the improvement over the usual number of passes, and "default" beside the
        oracles.
    """

    scene: str
    candidates: str
    gains: dict[str, dict[str, float]]


def chosen(results: Sequence[Image], errors: Sequence[NDArray[np.float64]]) -> Image:
    """Compose an image of the tiles with the least error.

    Parameters
    ----------
    results : sequence of (H, W, 3) ndarray
        The images to choose from.
    errors : sequence of ndarray
        The `tile_errors` of each image.

    Returns
    -------
    (H, W, 3) ndarray
        Where errors are equal, the tile of the first image.
    """
    best = np.argmin(np.stack(errors), 0)
    height, width, _ = results[0].shape
    which = np.kron(best, np.ones((TILE, TILE), int))[:height, :width, None]
    return np.choose(which, [*results])


def tile_errors(image: Image, reference: Image) -> NDArray[np.float64]:
    """The mean relative squared error of every tile: (⌈H/8⌉, ⌈W/8⌉). Tiles at the border may be smaller."""
    square = np.mean((image - reference) ** 2, -1, dtype=np.float64) / (np.mean(reference, -1) ** 2 + 0.01)
    return tile_sums(square, TILE) / tile_sums(np.ones_like(square), TILE)


def gains(recording: Recording) -> Iterator[Gain]:
    """Measure the oracles on a sequence, over all frames with a reference except the first of these."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    references = {i: recording.reference(i) for i in sorted(recording.references)}
    default = _results(pipeline(SVGF), frames, references)
    fixed = [_results(pipeline(SVGF, iterations=n, choice=False), frames, references) for n in PASSES]
    usual = _results(pipeline(SVGF, choice=False), frames, references)
    plain = _values(usual, references)
    best = {oracle: _values(_best(fixed, references, oracle), references) for oracle in ORACLES}
    choosing = {"default": _values(default, references), **best}
    yield Gain(recording.name, "passes", {key: harm.gains(values, plain) for key, values in choosing.items()})
    wholes = {base: _results(base.run, frames, references) for base in bases(PARTS)}
    own = {base: _values(whole, references) for base, whole in wholes.items()}
    for each in PARTS:
        pair = wholes[each.base], _results(each.method.run, frames, references)
        values = {oracle: _values(_best(pair, references, oracle), references) for oracle in ORACLES}
        gained = {key: harm.gains(value, own[each.base]) for key, value in values.items()}
        yield Gain(recording.name, each.method.name, gained)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of sequences, then that of components."""
    options = parser("yester.study.compare.oracle", __doc__, ("all", "late-held-out")).parse_args(arguments)
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 256}
    found = [gain for name in expand(options.sequences) for gain in gains(record(name, options.cache, **shape))]
    for key in _MEASURED:
        name = METRICS[key].label.removesuffix(" [dB]")
        print(f"gain in {name} of choosing the number of passes per tile, over the usual number")
        print(_by_scene(key, {gain.scene: gain.gains for gain in found if gain.candidates == "passes"}), end="\n\n")
    for oracle in ORACLES:
        print(f"gain of choosing per tile with or without a component, by the errors of {_KNOWN[oracle]}")
        others: dict[str, dict[str, Mapping[str, float]]] = {}
        for gain in found:
            if gain.candidates != "passes":
                others.setdefault(gain.candidates, {})[gain.scene] = gain.gains[oracle]
        print(harm.table(others), end="\n\n")


def _by_scene(key: str, found: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    """The gains in a metric, and the share of the first oracle's gain that the default reaches."""
    columns = ("default", *ORACLES)
    known = {scene: [gains[column][key] for column in columns] for scene, gains in found.items()}
    known["mean"] = [float(mean) for mean in np.mean([*known.values()], 0)]
    rows = [["", "default", *(f"oracle, {name}" for name in ORACLES), "reached"]]
    for scene, (default, best, before) in known.items():
        share = f"{100 * default / best:.0f} %" if best > 0 else ""
        rows.append([scene, *(harm.amount(key, gain) for gain in (default, best, before)), share])
    return harm.aligned(rows)


_KNOWN = {"now": "this frame", "before": "earlier frames"}


def _results(run: Run, frames: Sequence[Frame], references: Mapping[int, Image]) -> dict[int, Image]:
    return {i: result.color for i, result in enumerate(run(iter(frames))) if i in references}


def _best(candidates: Sequence[Mapping[int, Image]], references: Mapping[int, Image], oracle: str) -> dict[int, Image]:
    """An oracle's choice in every frame; in the first, which has none before it, by the errors of the frame itself."""
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
    """By metric, the mean over all frames but the first, for which no earlier errors are known."""
    pairs = [(Picture(images[i]), Picture(references[i])) for i in [*references][1:]]
    return {key: float(np.mean([METRICS[key].measure(*pair) for pair in pairs])) for key in _MEASURED}


if __name__ == "__main__":
    main()
