"""The methods to compare: this package's pipelines and presets, each over its main parameter."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from yester import BMFR, SVGF, TAA, Frame, HalfRes, Output, denoise
from yester.sequence import LOOKAHEAD

__all__ = [
    "METHODS",
    "PIPELINES",
    "QUARTERS",
    "Method",
    "Result",
    "Run",
    "current_name",
    "on_part",
    "pipeline",
    "quarter",
]


class Result(NamedTuple):
    """A method's result for a frame; auxiliary outputs are None for other libraries' methods.

    Attributes
    ----------
    color : (H, W, 3) float32
        Linear, finite.
    history_length, confidence : (H, W) float32 or None
        As `yester.Output` has them.
    rejection : (H, W) uint8 or None
        Bits of `yester.Rejection`.
    choice : (H, W) float32 or None
        As `yester.Output` has it.
    """

    color: NDArray[np.float32]
    history_length: NDArray[np.float32] | None = None
    confidence: NDArray[np.float32] | None = None
    rejection: NDArray[np.uint8] | None = None
    choice: NDArray[np.float32] | None = None


#: Takes the frames of a sequence in order and yields a result for each; may read ahead.
Run: TypeAlias = Callable[[Iterable[Frame]], Iterator[Result]]


@dataclass(frozen=True)
class Method:
    """A denoising method.

    Attributes
    ----------
    name : str
        Name with parameters.
    family : str
        Name without the value of the main parameter.
    run : callable
        Denoises one sequence; see `Run`.
    default : bool
        True for the default configuration.
    peer : bool
        True for another library's method.
    """

    name: str
    family: str
    run: Run
    default: bool = False
    peer: bool = False


def pipeline(make: Callable[..., Any], *preset: str, lookahead: int = 0, **options: Any) -> Run:
    """Make a `Method.run` from a pipeline's class, preset and options, and the lookahead of `denoise`."""
    return lambda frames: map(_result, denoise(frames, make(*preset, **options), lookahead))


def _result(output: Output) -> Result:
    return Result(output.color, output.history_length, output.confidence, output.rejection, output.choice)


def quarter(frame: Frame, number: int) -> Frame:
    """Keep one colour sample of each 2×2 pixels, at `HalfRes.offset`, as if only these pixels had been traced."""
    x, y = HalfRes.offset(number)
    color = np.full_like(frame.color, np.nan)
    color[y::2, x::2] = frame.color[y::2, x::2]
    return replace(frame, color=color)


def _copied(frame: Frame, number: int) -> Frame:
    """Replicate the traced pixel of each 2×2 to all four."""
    x, y = HalfRes.offset(number)
    height, width = frame.shape
    rows, columns = (np.minimum(np.arange(n) // 2 * 2 + d, n - 1) for n, d in ((height, y), (width, x)))
    return replace(frame, color=frame.color[np.ix_(rows, columns)])


def on_part(part: Callable[[Frame, int], Frame], run: Run) -> Run:
    """Apply `part` to each frame and its number before a method runs."""
    return lambda frames: run(map(part, frames, count()))


def current_name(name: str) -> str:
    """The current name of a method, or prefix of names; warns if the given one is a former name."""
    current = re.sub(r"^TAA seed\b", "TAA textbook", name)
    if current != name:
        warnings.warn(f"methods: {name!r} is now {current!r}", DeprecationWarning, stacklevel=3)
    return current


_TAA = ("best", "denoised", "textbook", "karis", "filament")


def _both_sides(name: str, run: Run) -> Method:
    return Method(f"{name}, both sides", f"{name}, both sides", run)


#: Every pipeline and preset with its defaults, cheaper and more expensive variants of `SVGF`, and pipelines with later
#: frames.
PIPELINES = (
    Method("SVGF", "SVGF", pipeline(SVGF), default=True),
    Method("SVGF, surfaces only", "SVGF, surfaces only", pipeline(SVGF, reflections=())),
    Method("SVGF, no innovation", "SVGF, no innovation", pipeline(SVGF, innovation=False)),
    Method("SVGF, 6 distances", "SVGF, 6 distances", pipeline(SVGF, reflections=(0.25, 0.5, 1, 2, 4, math.inf))),
    Method("BMFR", "BMFR", pipeline(BMFR)),
    *(Method(f"TAA {preset}", f"TAA {preset}", pipeline(TAA, preset), default=preset == _TAA[0]) for preset in _TAA),
    _both_sides("SVGF", pipeline(SVGF, lookahead=LOOKAHEAD)),
    _both_sides("BMFR", pipeline(BMFR, lookahead=LOOKAHEAD)),
    _both_sides("TAA best", pipeline(TAA, "best", lookahead=LOOKAHEAD)),
)

#: Methods for frames with a quarter of the pixels traced: `HalfRes`, and others on adapted frames.
QUARTERS = (
    Method("HalfRes, a quarter traced", "HalfRes", on_part(quarter, pipeline(HalfRes))),
    Method("a quarter traced, SVGF", "SVGF of a quarter", on_part(quarter, pipeline(SVGF))),
    Method("a quarter traced, copied, SVGF", "SVGF of copies", on_part(_copied, pipeline(SVGF))),
    _both_sides("HalfRes, a quarter traced", on_part(quarter, pipeline(HalfRes, lookahead=LOOKAHEAD))),
)

#: All methods, each over its main parameter: passes of the spatial filter, block size, or blend factor.
METHODS = (
    *PIPELINES,
    *QUARTERS,
    *(
        Method(f"{family}, {n} passes", family, pipeline(SVGF, iterations=n, choice=False, **options))
        for family, options, counts in (
            ("SVGF", {}, range(6)),
            ("SVGF, 5×5 taps", {"radius": 2}, (3, 4, 5)),
            ("SVGF, surfaces only", {"reflections": ()}, (1, 2, 3, 5)),
            ("SVGF, no antialiasing", {"reflections": (), "antialias": False}, (1, 2, 3, 5)),
        )
        for n in counts
    ),
    *(Method(f"BMFR, {side} px", "BMFR", pipeline(BMFR, block=side)) for side in (8, 32)),
    Method("BMFR, all features", "BMFR, all features", pipeline(BMFR, features="all")),
    *(
        Method(f"TAA {preset}, alpha {alpha:g}", f"TAA {preset}", pipeline(TAA, preset, alpha=alpha, fast_alpha=alpha))
        for preset in _TAA
        for alpha in (0.03, 0.1, 0.3)
    ),
)
