"""Noise that repeats: ``python -m yester.study.compare.repeated``.

Sequences are denoised as they should be rendered, with another seed for each frame; as a renderer makes them that
begins every frame with the same random numbers; and with each frame shown twice. Printed are the means over the
sequences, of `SVGF` with and without its choice, `BMFR` and Open Image Denoise, and the least and the largest
`repetition` of light from the third frame on, or of two frames that are the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from yester import BMFR, OIDN, SVGF, Frame
from yester.io.mitsuba import render_sequence
from yester.judge import repetitions

from ..rendered.recording import Recording, record
from ..rendered.sequences import expand, find, parser
from . import harm
from .samples import COLUMNS, Method, cells, compare, errors, steps

__all__ = ["KINDS", "METHODS", "SEQUENCES", "main"]

#: Slow and fast cameras, things that move, light that moves, a mirror, texture; the last two were not looked at before
#: the thresholds were set.
SEQUENCES = ("cornell_box", "spinning_shapes", "moving_light", "mirror_room", "tapestry", "carousel", "fast_dolly")
#: What is done to the noise.
KINDS = ("a seed each", "one seed", "each twice")
_SEED = 4000
_FRAMES, _WIDTH, _HEIGHT = 12, 128, 96

#: By name, what takes frames and yields images.
METHODS: Mapping[str, Method] = {
    "as rendered": lambda frames: (frame.color for frame in frames),
    "SVGF(choice=False)": steps(lambda: SVGF(choice=False)),
    "SVGF": steps(SVGF),
    "BMFR": steps(BMFR),
    "OIDN high": steps(lambda: OIDN("high")),
    "OIDN high, temporal": steps(lambda: OIDN("high", temporal=True)),
}


def _one_seed(name: str) -> Iterator[Frame]:
    """The frames of a sequence, each rendered with the same random numbers."""
    sequence = find(name)(_FRAMES, _WIDTH, _HEIGHT)
    for number in range(_FRAMES):
        # Motion needs the frame before as well, which is rendered and dropped.
        lead = min(number, 1)
        span = slice(number - lead, number + 1)
        *_, frame = render_sequence(
            sequence.scene,
            sequence.cameras[span],
            seed=_SEED - lead,
            transforms=sequence.transforms[span],
            parameters=sequence.parameters[span],
        )
        yield frame


def _twice(frames: Sequence[Frame]) -> Iterator[Frame]:
    for frame in frames:
        yield frame
        assert frame.motion is not None
        yield replace(frame, motion=np.zeros_like(frame.motion))


def _measured(name: str, recording: Recording, kind: str) -> tuple[dict[str, dict[str, float]], list[float]]:
    """Errors by method and metric, and the repetitions that tell."""
    frames = [recording.frame(i) for i in range(len(recording.frames))]
    if kind == "a seed each":
        return errors(recording, METHODS), repetitions(frames)[1:]
    references = {i: recording.reference(i) for i in recording.references}
    if kind == "one seed":
        frames = [*_one_seed(name)]
        return compare(frames, references, METHODS), repetitions(frames)[1:]
    frames = [*_twice(frames)]
    both = {2 * i + again: reference for i, reference in references.items() for again in (0, 1)}
    return compare(frames, both, METHODS), repetitions(frames)[::2]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table: rows of methods for each kind of noise."""
    options = parser("yester.study.compare.repeated", __doc__, SEQUENCES).parse_args(arguments)
    names = expand(options.sequences)
    rows, ranges = [["noise", "", *COLUMNS.values()]], [["noise", "repetition"]]
    for kind in KINDS:
        measured = []
        for name in names:
            recording = record(name, options.cache, frames=_FRAMES, width=_WIDTH, height=_HEIGHT, reference_spp=256)
            measured.append(_measured(name, recording, kind))
        rows += [[kind, method, *cells(found[method] for found, _ in measured)] for method in METHODS]
        told = [share for _, shares in measured for share in shares]
        ranges.append([kind, f"{min(told):.2f} to {max(told):.2f}"])
    print(harm.aligned(rows), harm.aligned(ranges), sep="\n\n")


if __name__ == "__main__":
    main()
