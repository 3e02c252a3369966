"""Scenes in which nothing moves: ``python -m yester.study.compare.still``.

The first frame of a sequence is rendered again and again, each time with noise of its own. Compared after 8, 32 and
128 frames are the mean of the samples, Open Image Denoise of that mean (with the means of albedo and normals), and
`SVGF` without and with ``average_still``, which `yester.plan` sets for such frames. Printed are means over the
sequences by which constants were set, then over others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yester import OIDN, SVGF, Frame
from yester.io import mitsuba as renderer
from yester.metrics import METRICS, Picture

from ..rendered.sequences import expand, find, parser
from . import harm

__all__ = ["COUNTS", "HELD_OUT", "METHODS", "SEQUENCES", "main", "render"]

SEQUENCES = ("cornell_box", "tapestry", "glossy_plates", "naked_lamps")
#: Not looked at before the constants were set.
HELD_OUT = ("sunlit_teapot", "grass", "glass_shelf", "spinning_shapes")
#: Frames after which results are compared.
COUNTS = (8, 32, 128)
_COLUMNS = {"psnr": "PSNR", "relmse": "relMSE", "flip": "FLIP"}
_SEED, _REFERENCE_SEED = 5000, 900_000
#: Samples per pixel of references, and of each part, which is rendered at once.
_REFERENCE, _PART = 2048, 256

#: The images after so many frames.
Method = Callable[[Sequence[Frame], Sequence[int]], list[NDArray[np.float32]]]


def _means(frames: Sequence[Frame], counts: Sequence[int]) -> Iterator[Frame]:
    """The means of all buffers after so many frames."""
    for count in counts:
        several = [frame.buffers() for frame in frames[:count]]
        yield Frame(**{name: np.mean([each[name] for each in several], 0) for name in ("color", "albedo", "normal")})


def _steps(pipeline: SVGF, frames: Sequence[Frame], counts: Sequence[int]) -> list[NDArray[np.float32]]:
    images = [pipeline.step(frame).color for frame in frames[: max(counts)]]
    return [images[count - 1] for count in counts]


METHODS: Mapping[str, Method] = {
    "mean of samples": lambda frames, counts: [frame.color for frame in _means(frames, counts)],
    "OIDN high, of the mean": lambda frames, counts: [OIDN("high").step(mean).color for mean in _means(frames, counts)],
    "SVGF": lambda frames, counts: _steps(SVGF(), frames, counts),
    "SVGF(average_still=True)": lambda frames, counts: _steps(SVGF(average_still=True), frames, counts),
}


def render(name: str, count: int, *, spp: int = _REFERENCE) -> tuple[list[Frame], NDArray[np.float32]]:
    """A sequence's first frame, so many times, and its reference."""
    sequence = find(name)(2, 128, 96)

    def shots(number: int, **options: Any) -> Iterator[Frame]:
        changes: dict[str, Any] = {
            "transforms": [sequence.transforms[0]] * number,
            "parameters": [sequence.parameters[0]] * number,
        }
        yield from renderer.render_sequence(sequence.scene, [sequence.cameras[0]] * number, **changes, **options)

    parts = range(_REFERENCE_SEED, _REFERENCE_SEED + -(-spp // _PART))
    few = min(spp, _PART)
    clean = [next(shots(1, seed=seed, spp=few, buffers=False)).color for seed in parts]
    return list(shots(count, seed=_SEED)), np.mean(clean, 0, dtype=np.float32)


def _measure(names: Iterable[str], counts: Sequence[int]) -> list[list[str]]:
    found: dict[tuple[int, str], list[list[float]]] = {}
    for name in names:
        frames, reference = render(name, max(counts))
        picture = Picture(reference)
        for method, run in METHODS.items():
            for count, image in zip(counts, run(frames, counts), strict=True):
                these = [METRICS[metric].measure(Picture(image), picture) for metric in _COLUMNS]
                found.setdefault((count, method), []).append(these)
    rows = []
    for (count, method), errors in sorted(found.items(), key=lambda item: item[0][0]):
        psnr, relmse, flip = np.mean(errors, 0)
        rows.append([str(count), method, f"{psnr:.2f}", f"{relmse:.4f}", f"{flip:.4f}"])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print two tables: rows of methods for each number of frames."""
    options = parser("yester.study.compare.still", __doc__, (*SEQUENCES, *HELD_OUT)).parse_args(arguments)
    names = expand(options.sequences)
    head = ["frames", "", *_COLUMNS.values()]
    parts = [[name for name in names if name not in HELD_OUT], [name for name in names if name in HELD_OUT]]
    print("\n\n".join(harm.aligned([head, *_measure(part, COUNTS)]) for part in parts if part))


if __name__ == "__main__":
    main()
