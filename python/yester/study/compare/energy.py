"""The light of a frame that denoisers keep: ``python -m yester.study.compare.energy``.

Where antialiasing averages in a display's tones, a pixel that a lamp covers in part comes out darker than the mean of
its samples. A display does not show that, but a compositor's glare does. Printed is the mean luminance of results
relative to that of the references, in percent, over three realisations of the noise, in sequences that show lamps or
highlights brighter than white, and in one that does not. Then the usual metrics of three ways to finish `SVGF`, over
the same sequences.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import BMFR, OIDN, SVGF, TAA, Frame

from ..rendered.recording import record
from ..rendered.sequences import expand, parser
from . import harm, samples
from .samples import COLUMNS, Images, Method, cells, compare, steps

__all__ = ["METHODS", "SEQUENCES", "change", "main"]

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def _linear(frames: Iterable[Frame]) -> Images:
    denoiser, _ = SVGF().split()
    stage = TAA("denoised", innovation=True, space="ycocg", guided_exposure=0)
    for frame in frames:
        smooth = denoiser.step(frame)
        given = replace(frame, color=smooth.color, motion=smooth.motion)
        yield stage.step(given, samples=frame.color, confidence=smooth.confidence).color


#: By name, what takes frames and yields images. The first three are compared by the usual metrics as well.
METHODS: Mapping[str, Method] = {
    "SVGF": steps(SVGF),
    "linear stage": _linear,
    "no antialiasing": steps(lambda: SVGF(antialias=False)),
    "both sides": samples.METHODS["SVGF, both sides"],
    "BMFR": steps(BMFR),
    "TAA": steps(TAA),
    "OIDN high": steps(lambda: OIDN("high")),
    "temporal": steps(lambda: OIDN("high", temporal=True)),
    "as rendered": samples.METHODS["as rendered"],
}
_FINISHED = [*METHODS][:3]
SEQUENCES = (
    "cornell_box",
    "switched_light",
    "glossy_plates",
    "many_lights",
    "naked_lamps",
    "opening_door",
    "neon_corridor",
    "spinning_shapes",
)


def _known(images: Sequence[NDArray[np.float32]]) -> Method:
    return lambda frames: iter(images)


def change(images: Sequence[NDArray[np.float32]], references: Mapping[int, NDArray[np.float32]]) -> float:
    """Mean over the frames of known reference of luminance relative to the reference's, less one."""
    ratios = [np.mean(images[i] @ _LUMINANCE) / np.mean(known @ _LUMINANCE) for i, known in references.items()]
    return float(np.mean(ratios)) - 1


def main(arguments: Sequence[str] | None = None) -> None:
    """Print two tables: light by sequence and method, and the metrics of ways to finish."""
    options = parser("yester.study.compare.energy", __doc__, SEQUENCES).parse_args(arguments)
    shape: dict[str, Any] = {"frames": 12, "width": 128, "height": 96, "reference_spp": 256}
    rows, measured = [["light", *METHODS]], []
    for name in expand(options.sequences):
        recording = record(name, options.cache, **shape, variants=2, raw_albedo=True)
        references = {i: recording.reference(i) for i in recording.references}
        changes: dict[str, list[float]] = {method: [] for method in METHODS}
        for each in (recording, *recording.variants):
            frames = [each.frame(i) for i in range(len(each.frames))]
            found = {method: [*run(frames)] for method, run in METHODS.items()}
            for method, images in found.items():
                changes[method].append(change(images, references))
            measured.append(compare(frames, references, {method: _known(found[method]) for method in _FINISHED}))
        rows.append([name, *[f"{100 * np.mean(each):+.1f} %" for each in changes.values()]])
    means = [[method, *cells(found[method] for found in measured)] for method in _FINISHED]
    print(harm.aligned(rows), harm.aligned([["", *COLUMNS.values()], *means]), sep="\n\n")


if __name__ == "__main__":
    main()
