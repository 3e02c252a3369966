"""Measurements: a point is one method on one sequence; means, Pareto fronts and tables of points."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from yester.io.files import beside
from yester.metrics import METRICS, Metric

__all__ = ["ALL", "Point", "means", "pareto", "table", "write_csv"]

#: The scene name of points that are means over all scenes.
ALL = "all"


@dataclass(frozen=True)
class Point:
    """One method on one sequence.

    Attributes
    ----------
    scene : str
        Name of the recording, or `ALL` for means over all of them.
    method, family : str
        As in `Method`.
    default, peer : bool
        As in `Method`.
    ms : float
        Median time of a frame of `size` in milliseconds; 0 if not measured.
    ms_range : (float, float)
        The quartiles.
    values : dict of str to float
        By key of `METRICS`: means over the frames for which the metric can be computed, and over the recording's
        variants. Metrics that can be computed for no frame are absent.
    images : Path or None
        The folder with the images of this point.
    size : (int, int) or None
        Width and height of the timed frames, which are not those of the sequence. None if not measured.
    runs : tuple of dict of str to float
        The values of the recording and of each of its variants.
    """

    scene: str
    method: str
    family: str
    default: bool
    peer: bool
    ms: float
    ms_range: tuple[float, float]
    values: dict[str, float]
    images: Path | None = None
    size: tuple[int, int] | None = None
    runs: tuple[dict[str, float], ...] = ()


def means(points: Sequence[Point]) -> list[Point]:
    """Average every method over all sequences.

    Parameters
    ----------
    points : sequence of Point
        Of several scenes. Methods and metrics that some scene lacks are left out, since means over different scenes are
        not comparable.

    Returns
    -------
    list of Point
        With the scene `ALL`, without images and runs. Metrics and times are arithmetic means.
    """
    scenes = {point.scene for point in points}
    by_method: dict[str, list[Point]] = {}
    for point in points:
        by_method.setdefault(point.method, []).append(point)
    result = []
    for same in by_method.values():
        if len(same) < len(scenes):
            continue
        common = [name for name in METRICS if all(name in point.values for point in same)]
        result.append(
            replace(
                same[0],
                scene=ALL,
                ms=float(np.mean([point.ms for point in same])),
                ms_range=tuple(np.mean([point.ms_range for point in same], axis=0).tolist()),
                values={name: float(np.mean([point.values[name] for point in same])) for name in common},
                images=None,
                runs=(),
            )
        )
    return result


def pareto(points: Sequence[Point], metric: Metric) -> list[Point]:
    """Find the Pareto front of time and a metric: the points that no other point beats in both.

    Parameters
    ----------
    points : sequence of Point
        Of one scene. Points without the metric are left out.
    metric : Metric
        The metric to trade against time.

    Returns
    -------
    list of Point
        Ordered from the fastest to the most accurate.
    """
    front: list[Point] = []
    for point in sorted(
        (point for point in points if metric.key in point.values),
        key=lambda point: (point.ms, metric.loss(point.values[metric.key])),
    ):
        if not front or metric.loss(point.values[metric.key]) < metric.loss(front[-1].values[metric.key]):
            front.append(point)
    return front


def table(points: Sequence[Point]) -> str:
    """Write the points of one scene as text; a star marks the best value of each column."""
    metrics = [metric for metric in METRICS.values() if any(metric.key in point.values for point in points)]
    best = {
        metric.key: min((point.values[metric.key] for point in points if metric.key in point.values), key=metric.loss)
        for metric in metrics
    }
    width = max(len(point.method) for point in points)
    head = f"{'':<{width}}{'ms':>9}" + "".join(f"{metric.key:>16}" for metric in metrics)
    rows = [head]
    for point in points:
        cells = []
        for metric in metrics:
            value = point.values.get(metric.key)
            cells.append("" if value is None else f"{value:.4f}{'*' if value == best[metric.key] else ' '}")
        rows.append(f"{point.method:<{width}}{point.ms:>9.1f}" + "".join(f"{cell:>16}" for cell in cells))
    return "\n".join(rows)


def write_csv(points: Sequence[Point], path: Path) -> None:
    """Write a row for each point; cells of metrics that it lacks are empty."""
    with beside(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "method", "family", "default", "peer", "ms", "ms_low", "ms_high", *METRICS, "timed"])
        for point in points:
            values = [point.values.get(name, "") for name in METRICS]
            flags = [int(point.default), int(point.peer)]
            times = [point.ms, *point.ms_range]
            timed = "" if point.size is None else "{}x{}".format(*point.size)
            writer.writerow([point.scene, point.method, point.family, *flags, *times, *values, timed])
