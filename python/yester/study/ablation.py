"""What each component of the pipelines is worth: every one switched off in turn, everything else as it comes."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from yester import SVGF, TAA, Frame
from yester.io.files import beside

from .chart import measure
from .methods import Method, Result, Step, pipeline
from .metrics import METRICS, Metric, metric
from .points import ALL, Point
from .recording import Recording

__all__ = ["ABLATIONS", "Ablation", "Effect", "ablate", "table"]

#: A threshold that nothing exceeds.
_ENDLESS = 1e30


@dataclass(frozen=True)
class Ablation:
    """A pipeline without one of its components, or with one that it has not by default.

    Attributes
    ----------
    component : str
        What is switched.
    method : Method
        The pipeline with that switched.
    whole : Method
        The pipeline as it comes.
    added : bool
        Whether the component is one that the default is without.
    """

    component: str
    method: Method
    whole: Method
    added: bool = False


def _without(*names: str, **options: object) -> Callable[[], Step]:
    """SVGF on frames that lack some buffers."""

    def start() -> Step:
        step = pipeline(SVGF, **options)()

        def bare(frame: Frame, /) -> Result:
            kept = {name: array for name, array in frame.buffers().items() if name not in names}
            return step(Frame(**kept, camera=frame.camera, jitter=frame.jitter))

        return bare

    return start


def _antialiased(**options: object) -> Callable[[], Step]:
    """SVGF whose output stage is another: the same kernels in the same order."""

    def start() -> Step:
        denoise, antialias = pipeline(SVGF, antialias=False)(), pipeline(TAA, "denoised", **options)()

        def step(frame: Frame, /) -> Result:
            first = denoise(frame)
            second = antialias(
                Frame(first.color, depth=frame.depth, motion=frame.motion, position=frame.position, camera=frame.camera)
            )
            return first._replace(color=second.color)

        return step

    return start


_SVGF = Method("SVGF", "SVGF", pipeline(SVGF), default=True)
_TAA = Method("TAA", "TAA", pipeline(TAA), default=True)

_NO_DEPTH_TEST = {"relative_depth": _ENDLESS, "plane_distance": _ENDLESS}
_SURFACES = ("normal", "object_normal", "ids")
#: Where ids and normals do not stand in for it.
_BARE = Method("SVGF, depth alone", "SVGF", _without(*_SURFACES))


def _ablation(whole: Method, component: str, start: Callable[[], Step], *, added: bool = False) -> Ablation:
    sign = "+" if added else "-"
    return Ablation(component, Method(f"{whole.name} {sign} {component}", whole.family, start), whole, added)


#: Every component of `SVGF` and `TAA`.
ABLATIONS = (
    *(
        _ablation(_SVGF, component, start)
        for component, start in {
            "depth test": pipeline(SVGF, **_NO_DEPTH_TEST),
            "normal test": pipeline(SVGF, normal_angle=180),
            "id test and weight": _without("ids"),
            "normals": _without("normal", "object_normal"),
            "demodulation": _without("albedo", "emission"),
            "gradient": pipeline(SVGF, gradient=False),
            "reflections": pipeline(SVGF, reflections=()),
            # Above the longest history.
            "temporal variance": pipeline(SVGF, min_length=21),
            "spatial variance": pipeline(SVGF, min_length=1),
            "luminance weight": pipeline(SVGF, sigma_luminance=_ENDLESS),
            "normal weight": pipeline(SVGF, sigma_normal=0),
            "plane weight": pipeline(SVGF, sigma_plane=_ENDLESS, sigma_depth=_ENDLESS),
            "long memory": pipeline(SVGF, alpha=0.2),
            "all passes": pipeline(SVGF, iterations=0),
            "passes after 1": pipeline(SVGF, iterations=1),
            "passes after 2": pipeline(SVGF, iterations=2),
            "passes after 3": pipeline(SVGF, iterations=3),
            "antialiasing": pipeline(SVGF, antialias=False),
            "dilation": _antialiased(dilate="none"),
            "clip": _antialiased(gamma=_ENDLESS),
            "cubic history": _antialiased(filter="bilinear"),
            "tone-mapped box": _antialiased(space="ycocg"),
        }.items()
    ),
    *(
        _ablation(_SVGF, component, start, added=True)
        for component, start in {
            "fireflies": pipeline(SVGF, fireflies=True),
            "pass 5": pipeline(SVGF, iterations=5),
            "5×5 taps": pipeline(SVGF, radius=2),
            "tolerance of 4 sigma": pipeline(SVGF, sigma_luminance=4),
            "6 distances": pipeline(SVGF, reflections=(0.25, 0.5, 1, 2, 4, math.inf)),
            "feedback": pipeline(SVGF, feedback=True),
            "soft thresholds": pipeline(
                SVGF, relative_depth=(0.05, 0.15), plane_distance=(0.005, 0.015), normal_angle=(15, 35)
            ),
        }.items()
    ),
    _ablation(_BARE, "depth test", _without(*_SURFACES, **_NO_DEPTH_TEST)),
    *(
        _ablation(_TAA, component, start)
        for component, start in {
            "dilation": pipeline(TAA, dilate="none"),
            "clip": pipeline(TAA, gamma=_ENDLESS),
            "cubic history": pipeline(TAA, filter="bilinear"),
            "tone-mapped box": pipeline(TAA, space="ycocg"),
            "share by speed": pipeline(TAA, fast_alpha=0.05),
        }.items()
    ),
)


@dataclass(frozen=True)
class Effect:
    """What a component gives on one sequence, and what it costs.

    Attributes
    ----------
    scene : str
        Name of the recording, or `ALL` for means over all.
    pipeline, component : str
        What is switched, and where.
    added : bool
        Whether the default is without it.
    gains : dict of str to float
        By metric, how much better the result is with the component than without: in dB for metrics in dB, otherwise as
        a share of the value without. Negative where it harms.
    better : dict of str to int
        By metric, on how many sequences it gains.
    ms : float
        What it costs in a frame.
    """

    scene: str
    pipeline: str
    component: str
    added: bool
    gains: dict[str, float]
    better: dict[str, int]
    ms: float


def ablate(
    recordings: Sequence[Recording],
    folder: Path,
    *,
    metrics: Iterable[str] = ("psnr", "relmse", "flip", "temporal_error"),
) -> list[Effect]:
    """Switch off every component in turn, on every sequence.

    Writes `ablation.csv`; what is measured is kept below `ablation/`, from which an interrupted run goes on.

    Parameters
    ----------
    recordings : sequence of Recording
        With different names, each with references.
    folder : Path
        Made if it does not exist.
    metrics : iterable of str
        Keys of `yester.study.metrics.METRICS`.

    Returns
    -------
    list of Effect
        Of each scene, and if there are several, their means.

    Raises
    ------
    ValueError
        If a metric is unknown.
    """
    keys = [metric(key).key for key in metrics]
    wholes = dict.fromkeys(ablation.whole for ablation in ABLATIONS)
    methods = [*wholes, *(ablation.method for ablation in ABLATIONS)]
    effects = []
    for recording in recordings:
        points = measure(recording, methods, folder / "ablation", metrics=keys, images=0)
        found = {point.method: point for point in points}
        effects += [_effect(ablation, found) for ablation in ABLATIONS]
    if len(recordings) > 1:
        effects += [_mean([e for e in effects if _key(e) == key]) for key in dict.fromkeys(map(_key, effects))]
    with beside(folder / "ablation.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "pipeline", "component", "added", "ms", *keys])
        for e in effects:
            writer.writerow([e.scene, e.pipeline, e.component, int(e.added), e.ms, *(e.gains.get(k, "") for k in keys)])
    return effects


def table(effects: Sequence[Effect]) -> str:
    """Write the effects of one scene, or their means, as text: gains, and on how many sequences there is one."""
    keys = list(dict.fromkeys(key for effect in effects for key in effect.gains))
    rows = [f"{'':<32}" + "".join(f"{key:>20}" for key in keys) + f"{'costs ms':>12}"]
    for e in effects:
        name = f"{e.pipeline} {'+' if e.added else '-'} {e.component}"
        cells = [_cell(METRICS[key], e.gains[key], e.better[key]) if key in e.gains else "" for key in keys]
        rows.append(f"{name:<32}" + "".join(f"{cell:>20}" for cell in cells) + f"{e.ms:>12.1f}")
    return "\n".join(rows)


def _cell(each: Metric, gain: float, better: int) -> str:
    return f"{gain:+.2f} dB ({better:2})" if _in_db(each) else f"{100 * gain:+.1f} % ({better:2})"


def _in_db(each: Metric) -> bool:
    return "dB" in each.label


def _key(effect: Effect) -> tuple[str, str, bool]:
    return effect.pipeline, effect.component, effect.added


def _effect(ablation: Ablation, points: dict[str, Point]) -> Effect:
    whole, switched = points[ablation.whole.name], points[ablation.method.name]
    having, lacking = (switched, whole) if ablation.added else (whole, switched)
    gains = {}
    for key, without in lacking.values.items():
        each = METRICS[key]
        better = (having.values[key] - without) * (1 if each.higher_is_better else -1)
        gains[key] = better if _in_db(each) else better / max(abs(without), 1e-9)
    counts = {key: int(gain > 0) for key, gain in gains.items()}
    pipeline, cost = ablation.whole.name, having.ms - lacking.ms
    return Effect(whole.scene, pipeline, ablation.component, ablation.added, gains, counts, cost)


def _mean(effects: Sequence[Effect]) -> Effect:
    first = effects[0]
    keys = [key for key in first.gains if all(key in effect.gains for effect in effects)]
    return replace(
        first,
        scene=ALL,
        gains={key: float(np.mean([effect.gains[key] for effect in effects])) for key in keys},
        better={key: sum(effect.better[key] for effect in effects) for key in keys},
        ms=float(np.mean([effect.ms for effect in effects])),
    )
