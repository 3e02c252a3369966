"""What is compared: this package's pipelines and presets, each over its main parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from yester import BMFR, SVGF, TAA, Frame

__all__ = ["METHODS", "PIPELINES", "Method", "Result", "Step", "pipeline"]


class Result(NamedTuple):
    """What a method makes of a frame; what only this package's pipelines know is None with others.

    Attributes
    ----------
    color : (H, W, 3) float32
        Linear, finite.
    history_length, confidence : (H, W) float32 or None
        As `yester.Output` has them.
    rejection : (H, W) uint8 or None
        Bits of `yester.Rejection`.
    """

    color: NDArray[np.float32]
    history_length: NDArray[np.float32] | None = None
    confidence: NDArray[np.float32] | None = None
    rejection: NDArray[np.uint8] | None = None


class Step(Protocol):
    """Takes the frames of one sequence in order."""

    def __call__(self, frame: Frame, /) -> Result: ...


@dataclass(frozen=True)
class Method:
    """A way to make clean frames of noisy ones.

    Attributes
    ----------
    name : str
        Of the method with its parameters.
    family : str
        What it shares with the same method at other values of its main parameter.
    start : callable
        Makes a `Step` for one sequence.
    default : bool
        Whether it is what one gets who sets nothing.
    peer : bool
        Whether it comes from elsewhere.
    """

    name: str
    family: str
    start: Callable[[], Step]
    default: bool = False
    peer: bool = False


def pipeline(make: Callable[..., Any], *preset: str, **options: Any) -> Callable[[], Step]:
    """Make a `Method.start` of one of this package's pipelines and its options."""

    def start() -> Step:
        state = make(*preset, **options)

        def step(frame: Frame, /) -> Result:
            output = state.step(frame)
            return Result(output.color, output.history_length, output.confidence, output.rejection)

        return step

    return start


_TAA = ("best", "denoised", "seed", "karis", "filament")

#: Every pipeline and preset as it comes, and `SVGF` with less and more of what costs most.
PIPELINES = (
    Method("SVGF", "SVGF", pipeline(SVGF), default=True),
    Method("SVGF, surfaces only", "SVGF, surfaces only", pipeline(SVGF, reflections=())),
    Method("SVGF, 6 distances", "SVGF, 6 distances", pipeline(SVGF, reflections=(0.25, 0.5, 1, 2, 4, math.inf))),
    Method("BMFR", "BMFR", pipeline(BMFR)),
    *(Method(f"TAA {preset}", f"TAA {preset}", pipeline(TAA, preset), default=preset == _TAA[0]) for preset in _TAA),
)

#: All of them over their main parameters: passes of the spatial filter, side of the blocks, share of the new sample.
METHODS = (
    *PIPELINES,
    *(Method(f"SVGF, {n} passes", "SVGF", pipeline(SVGF, iterations=n)) for n in (0, 1, 2, 3, 5)),
    *(
        Method(f"{family}, {n} passes", family, pipeline(SVGF, iterations=n, **options))
        for family, options in (
            ("SVGF, surfaces only", {"reflections": ()}),
            ("SVGF, no antialiasing", {"reflections": (), "antialias": False}),
        )
        for n in (1, 2, 3, 5)
    ),
    *(Method(f"BMFR, {side} px", "BMFR", pipeline(BMFR, block=side)) for side in (8, 32)),
    Method("BMFR, all features", "BMFR, all features", pipeline(BMFR, features="all")),
    *(
        Method(f"TAA {preset}, alpha {alpha:g}", f"TAA {preset}", pipeline(TAA, preset, alpha=alpha, fast_alpha=alpha))
        for preset in _TAA
        for alpha in (0.03, 0.1, 0.3)
    ),
)
