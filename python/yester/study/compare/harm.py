"""Do no harm: the gain of a component or buffer on each sequence, mean and worst case, and the limits of harm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from yester.metrics import METRICS, Metric

__all__ = ["EXCEPTIONS", "LIMITS", "aligned", "amount", "gains", "harms", "table"]

#: By metric, the loss from which on a component or a buffer harms: in dB for metrics in dB, otherwise as a share of the
#: value without it.
LIMITS = {"psnr": 0.1, "relmse": 0.02, "flip": 0.02, "temporal_error": 0.02}

#: Why a component may harm a sequence, by the component, as `ablation` names it, and the sequence. It
#: holds only where the component gains `_WORTH` times as much in another metric of that sequence.
EXCEPTIONS: dict[tuple[str, str], str] = {}

#: Ratio of gain to loss, both relative to their limits, that excuses the loss.
_WORTH = 5


def gains(having: Mapping[str, float], lacking: Mapping[str, float]) -> dict[str, float]:
    """The improvement of the metrics with something over those without.

    Parameters
    ----------
    having, lacking : mapping of str to float
        By key of `METRICS`, the values with and without it.

    Returns
    -------
    dict of str to float
        By metric of `lacking`: in dB for metrics in dB, otherwise as a share of the value without. Negative where it is
        worse.
    """
    result = {}
    for key, without in lacking.items():
        each = METRICS[key]
        better = (having[key] - without) * (1 if each.higher_is_better else -1)
        result[key] = better if _in_db(each) else better / max(abs(without), 1e-9)
    return result


def harms(gained: Mapping[str, float], limits: Mapping[str, float] = LIMITS, *, excused: bool = False) -> list[str]:
    """The metrics that something harms.

    Parameters
    ----------
    gained : mapping of str to float
        By metric, what `gains` gives.
    limits : mapping of str to float, default LIMITS
        By metric, the largest loss that is no harm. Other metrics are not looked at.
    excused : bool, default False
        A loss is excused by a gain in another metric that is five times as large, both relative to their limits.

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
    """Write gains as text: means over all cases, in how many there is a gain, and the worst case with its name.

    Parameters
    ----------
    rows : mapping of str to mapping of str to mapping of str to float
        By the name of what is gained from, by case, by metric: what `gains` gives. Every row has a case.
    ms : mapping of str to float, optional
        By the name of what is gained from, what it costs in a frame.

    Returns
    -------
    str
        One line for each row. With a single case, it is not named.
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
    """Write rows of cells as lines: the first column to the left, the others to the right."""
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
    """Write a gain in a metric."""
    return f"{gain:+.2f} dB" if _in_db(METRICS[key]) else f"{100 * gain:+.1f} %"


def _in_db(each: Metric) -> bool:
    return "dB" in each.label
