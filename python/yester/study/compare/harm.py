"""Do no harm: the gain of a component or buffer on each sequence, mean and worst case, and the limits of harm."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from yester.metrics import METRICS, Metric

__all__ = ["EXCEPTIONS", "LIMITS", "aligned", "amount", "gains", "harms", "mean_gains", "sure", "table"]

#: By metric, the loss above which a component or buffer counts as harmful: in dB for metrics in dB, otherwise relative
#: to the value without it.
LIMITS = {"psnr": 0.1, "relmse": 0.02, "flip": 0.02, "temporal_error": 0.02}

#: By component and case (`ablation.Effect.name` and `case`), the reason why harm is accepted. An exception applies only
#: if the component gains `_WORTH` times as much in another metric of that case.
EXCEPTIONS: dict[tuple[str, str], str] = {
    ("SVGF - antialiasing", "passing_day"): "edges gain more than what lags behind moving light loses",
    ("SVGF - clip", "neon_corridor"): "wrong history is kept out; features as thin as a pixel lose contrast",
    ("SVGF - tone-mapped box", "cornell_box"): "outliers do not widen the box; dark places lose a little",
}

#: Ratio of gain to loss, both relative to their limits, that excuses the loss.
_WORTH = 5


def gains(having: Mapping[str, float], lacking: Mapping[str, float]) -> dict[str, float]:
    """The gain of a component or buffer, by metric.

    Parameters
    ----------
    having, lacking : mapping of str to float
        By key of `METRICS`, the values with and without it.

    Returns
    -------
    dict of str to float
        By metric of `lacking`: in dB for metrics in dB, otherwise relative to the value without it. Negative values are
        losses.
    """
    result = {}
    for key, without in lacking.items():
        each = METRICS[key]
        better = each.loss(without) - each.loss(having[key])
        result[key] = better if _in_db(each) else better / max(abs(without), 1e-9)
    return result


def mean_gains(
    having: Sequence[Mapping[str, float]], lacking: Sequence[Mapping[str, float]]
) -> tuple[dict[str, float], dict[str, float]]:
    """The gain of a component or buffer over several realisations of the noise.

    Parameters
    ----------
    having, lacking : sequence of mapping of str to float
        As `gains` takes them, for each realisation; at least one.

    Returns
    -------
    gains, errors : dict of str to float
        By metric, the mean gain and its standard error; there are no errors of a single realisation.
    """
    each = [gains(*both) for both in zip(having, lacking, strict=True)]
    deviations = {key: float(np.std([one[key] for one in each], ddof=1)) for key in each[0]} if len(each) > 1 else {}
    means = {key: float(np.mean([one[key] for one in each])) for key in each[0]}
    return means, {key: deviation / math.sqrt(len(each)) for key, deviation in deviations.items()}


def sure(gained: Mapping[str, float], errors: Mapping[str, float]) -> dict[str, float]:
    """Leave out gains and losses of less than two standard errors."""
    return {key: gain for key, gain in gained.items() if abs(gain) >= 2 * errors.get(key, 0.0)}


def harms(gained: Mapping[str, float], limits: Mapping[str, float] = LIMITS, *, excused: bool = False) -> list[str]:
    """The metrics in which a component or buffer does harm.

    Parameters
    ----------
    gained : mapping of str to float
        The result of `gains`.
    limits : mapping of str to float, default LIMITS
        By metric, the largest loss that is no harm. Other metrics are ignored.
    excused : bool, default False
        Whether a gain in another metric excuses a loss, if it is five times as large, both relative to their limits.

    Returns
    -------
    list of str
        The metrics, in the order of `limits`.
    """
    by_limit = {key: gained[key] / limit for key, limit in limits.items() if key in gained}
    bad = [key for key, gain in by_limit.items() if gain < -1]
    best = max(by_limit.values(), default=0.0)
    return [key for key in bad if not (excused and best >= -_WORTH * by_limit[key])]


def table(rows: Mapping[str, Mapping[str, Mapping[str, float]]], ms: Mapping[str, float] | None = None) -> str:
    """Write gains as text: mean over all cases, number of cases with a gain, and the worst case with its name.

    Parameters
    ----------
    rows : mapping of str to mapping of str to mapping of str to float
        By name of the row and case, the result of `gains`. Every row has at least one case.
    ms : mapping of str to float, optional
        By name of the row, its cost per frame in milliseconds.

    Returns
    -------
    str
        One line for each row. A single case is not named.
    """
    keys = [key for key in METRICS if any(key in case for cases in rows.values() for case in cases.values())]
    lines = [["", *keys, *(["costs ms"] if ms is not None else [])]]
    for name, cases in rows.items():
        cells = [name]
        for key in keys:
            found = {case: gained[key] for case, gained in cases.items() if key in gained}
            cells.append(_cell(key, found))
        if ms is not None:
            cells.append(f"{ms[name]:.1f}")
        lines.append(cells)
    return aligned(lines)


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Write rows of cells as lines; the first column is left-aligned, the others right-aligned."""
    first, *widths = (max(map(len, column)) for column in zip(*rows, strict=True))
    return "\n".join(
        f"{name:<{first}}" + "".join(f"{cell:>{width + 2}}" for cell, width in zip(cells, widths, strict=True))
        for name, *cells in rows
    )


def _cell(key: str, found: Mapping[str, float]) -> str:
    if not found:
        return ""
    mean = amount(key, float(np.mean([*found.values()])))
    better = sum(gain > 0 for gain in found.values())
    if len(found) == 1:
        return f"{mean} ({better:2})"
    worst = min(found, key=lambda case: found[case])
    return f"{mean} ({better:2}) {amount(key, found[worst])} {worst}"


def amount(key: str, gain: float) -> str:
    """Format a gain in a metric."""
    return f"{gain:+.2f} dB" if _in_db(METRICS[key]) else f"{100 * gain:+.1f} %"


def _in_db(each: Metric) -> bool:
    return "dB" in each.label
