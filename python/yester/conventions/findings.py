"""What a check has found, from the disagreement of hypotheses in each tile of the image."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..judge import tile_sums

__all__ = ["SIGMAS", "Channels", "Finding", "Floats", "clipped", "judged", "tile_means"]

Floats: TypeAlias = NDArray[np.floating[Any]]
#: By buffer, the channels of its components, and the factors that make them what the frame has.
Channels: TypeAlias = Mapping[str, Sequence[tuple[float, str]]]
Verdict: TypeAlias = Literal["right", "wrong", "unclear", "unchecked"]
#: Tiles along the shorter side of an image.
_TILES = 8
#: A difference of disagreement counts from this many standard errors, and from this size.
SIGMAS, _LEAST = 3.0, 0.001
#: With more disagreement than this, absolutely or relative to that of no relation, no hypothesis explains the data.
_POOR, _VAIN = 0.6, 0.9
#: Rivals that are printed.
_SHOWN = 3


@dataclass(frozen=True)
class Finding:
    """What the data say about one buffer's convention.

    Parameters
    ----------
    subject : {"cameras", "depth", "motion", "jitter", "normal", "albedo", "ids", "motion_next"}
    verdict : {"right", "wrong", "unclear", "unchecked"}
        ``"right"``: as expected, and all else is excluded. ``"wrong"``: another convention fits clearly better.
        ``"unclear"``: as expected as far as can be told, but others fit as well, or nothing fits. ``"unchecked"``:
        buffers are missing. Motion is right even if that of a neighbouring frame fits as well, as at a steady pace. It
        is wrong only if the vectors of the other convention differ by a pixel or more, or cameras tell.
    stored : str
        The convention that the data support, or what is missing.
    remedy : str
        What to change; empty if nothing.
    margin, error : float
        By how much the disagreement of the next hypothesis is larger, up to 1, and the standard error of that over
        tiles; NaN if nothing was compared. Below 0 where a rival agrees better.
    rivals : tuple of str
        Other conventions that the data do not exclude.
    witnesses : tuple of str
        The buffers that told.
    matrix : (2, 2) ndarray of float64 or None
        For `motion` and `motion_next`: canonical x and y from the stored ones.

    See Also
    --------
    check : Finds these for all buffers.

    Examples
    --------
    >>> print(yester.Finding("depth", "wrong", "distance along the ray", "--map depth.kind=distance"))
    depth       wrong     distance along the ray
                          write: --map depth.kind=distance
    """

    subject: str
    verdict: Verdict
    stored: str
    remedy: str = ""
    margin: float = np.nan
    error: float = np.nan
    rivals: tuple[str, ...] = ()
    witnesses: tuple[str, ...] = ()
    matrix: NDArray[np.float64] | None = None

    def __str__(self) -> str:
        lines = [f"{self.subject:<11} {self.verdict:<9} {self.stored}"]
        if np.isfinite(self.margin):
            lines[0] += f" (margin {self.margin:.3f} ± {self.error:.3f}, by {', '.join(self.witnesses)})"
        if self.rivals:
            more = f"; and {len(self.rivals) - _SHOWN} more" if len(self.rivals) > _SHOWN else ""
            lines.append(f"{'':<21} not excluded: {'; '.join(self.rivals[:_SHOWN])}{more}")
        if self.remedy:
            lines.append(f"{'':<21} write: {self.remedy}")
        return "\n".join(lines)


def judged(
    subject: str,
    names: Sequence[str],
    remedies: Sequence[str],
    residuals: NDArray[np.float64],
    witnesses: Iterable[str],
    *,
    poor: str = "no known convention fits",
    null: int | None = None,
    near: Collection[int] = (),
    minor: Collection[int] = (),
) -> tuple[Finding, int | None]:
    """The finding, and the index of the hypothesis that is chosen: None if none fits.

    Hypotheses come in order, the expected one first.

    `residuals` are the disagreements of each hypothesis in each tile, (hypotheses, tiles). `null` is the hypothesis of
    no relation, which any other must beat, and which is chosen only if it beats all others. Those that are `near` the
    expected one are never chosen instead of it. Rivals among the `minor` ones leave the verdict as it is.
    """
    residuals = residuals[:, np.isfinite(residuals).all(0)]
    told = tuple(witnesses)
    count = residuals.shape[1]
    if count < 4:
        return Finding(subject, "unclear", f"{names[0]}, as expected; too little to compare", witnesses=told), 0

    def worse(one: int, other: int) -> tuple[float, float, bool]:
        difference = residuals[one] - residuals[other]
        mean, error = float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(count))
        return mean, error, mean > max(_LEAST, SIGMAS * error)

    def not_excluded(chosen: int) -> list[int]:
        return [i for i in range(len(names)) if i != chosen and not worse(i, chosen)[2]]

    means = residuals.mean(1)
    eligible = [0, *(i for i in range(1, len(names)) if i not in near)]
    best = min(eligible, key=lambda i: means[i])
    chosen = next(i for i in eligible if not worse(i, best)[2])
    fits = bool(means[chosen] < (_POOR if null is None else _VAIN * means[null]))
    if not fits and chosen:
        chosen = null if null in eligible and means[null] < _VAIN and not not_excluded(null) else 0
    others = [i for i in range(len(names)) if np.abs(residuals[i] - residuals[chosen]).max() > 1e-6]
    doubtful = not_excluded(chosen)
    rivals = tuple(names[i] for i in doubtful)
    margin, error = min((worse(i, chosen)[:2] for i in others if chosen in minor or i not in minor), default=(0.0, 0.0))
    verdict: Verdict = "wrong" if chosen else "unclear" if not fits or set(doubtful) - set(minor) else "right"
    unexplained = not chosen and not fits and means[0] > _POOR
    stored = poor if unexplained else names[chosen]
    finding = Finding(subject, verdict, stored, remedies[chosen], margin, error, rivals, told)
    return finding, None if unexplained else chosen


def tile_side(shape: tuple[int, ...]) -> int:
    return max(min(shape[:2]) // _TILES, 4)


def tile_means(residual: Floats, known: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """Means over tiles, flat; NaN where less than a quarter of a tile is known."""
    side = tile_side(residual.shape)
    known = np.ones(residual.shape, bool) if known is None else known
    number = tile_sums(known, side)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = tile_sums(np.where(known, residual, 0), side) / number
    return np.where(number * 4 >= tile_sums(np.ones(residual.shape), side), means, np.nan).ravel()


def clipped(difference: Floats, scale: Any) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ratio = np.asarray(difference / scale, np.float64)
    return np.where(np.isfinite(ratio), np.minimum(ratio, 1), 1)
