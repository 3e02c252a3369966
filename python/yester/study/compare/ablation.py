"""Ablation study: each component of the pipelines is switched off in turn, the rest stays at its defaults."""

from __future__ import annotations

import csv
import inspect
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from yester import BMFR, OIDN, SVGF, TAA, Frame, HalfRes, Recirculation
from yester.io.files import beside
from yester.metrics import metric
from yester.sequence import LOOKAHEAD

from ..rendered.recording import Recording
from . import harm
from .chart import SIZE, measure, times
from .doors import DOORS, FULL, Door, known_doors, passing
from .methods import Method, Result, Run, on_part, pipeline, quarter
from .peers import imports
from .points import ALL, Point

__all__ = ["ABLATIONS", "Ablation", "Effect", "Harm", "ablate", "bases", "harmful", "harms", "table"]

#: A threshold that nothing exceeds.
_ENDLESS = 1e30


@dataclass(frozen=True)
class Ablation:
    """A pipeline without one of its components, or with one that is off by default.

    Attributes
    ----------
    component : str
        The component that is switched.
    method : Method
        The pipeline with the component switched.
    whole : Method
        The pipeline with its defaults.
    added : bool
        True if the component is off by default.
    needs_all : bool
        True if the pipeline needs frames with all buffers.
    counterpart : Method, optional
        What `method` is compared with, if not with `whole`.
    """

    component: str
    method: Method
    whole: Method
    added: bool = False
    needs_all: bool = False
    counterpart: Method | None = None

    @property
    def base(self) -> Method:
        """The method that `method` is compared with."""
        return self.counterpart or self.whole


#: What the output stage has of a frame.
_GUIDES = ("depth", "position", "camera", "jitter", "albedo", "emission", "normal", "ids")
#: The options of an output stage that the samples correct, as in SVGF.
_CORRECTED: dict[str, Any] = {"innovation": True, "choice": True}


def _without(*names: str, **options: Any) -> Run:
    """SVGF on frames that lack some buffers."""
    absent: dict[str, Any] = dict.fromkeys(names)
    return on_part(lambda frame, _: replace(frame, **absent), pipeline(SVGF, **options))


def _antialiased(*, confidence: bool = True, **options: Any) -> Run:
    """SVGF with another output stage: the same kernels in the same order. By default, the samples do not correct it."""
    options = {"unguided_alpha": 0.5, "choice": False, **options}

    def run(frames: Iterable[Frame]) -> Iterator[Result]:
        svgf, antialias = SVGF(antialias=False), TAA("denoised", **options)
        for frame in frames:
            denoised = svgf.step(frame)
            known = {name: getattr(frame, name) for name in _GUIDES}
            smooth = Frame(denoised.color, motion=denoised.motion, **known)
            trust = denoised.confidence if confidence else None
            yield Result(antialias.step(smooth, samples=frame.color, confidence=trust).color)

    return run


_SVGF = Method("SVGF", "SVGF", pipeline(SVGF), default=True)
_TAA = Method("TAA", "TAA", pipeline(TAA), default=True)
#: What SVGF with another output stage is compared with.
_APART = Method("SVGF, output stage apart", "SVGF", _antialiased())

_BMFR = Method("BMFR", "BMFR", pipeline(BMFR), default=True)
_HALF_RES = Method("HalfRes", "HalfRes", on_part(quarter, pipeline(HalfRes)), default=True)
_OIDN = Method("temporal OIDN high", "temporal OIDN", pipeline(OIDN, "high", temporal=True), default=True, peer=True)
_RECIRCULATION = Method("Recirculation", "Recirculation", on_part(quarter, pipeline(Recirculation)), default=True)

_NO_DEPTH_TEST: dict[str, Any] = {"relative_depth": _ENDLESS, "plane_distance": _ENDLESS}
_SURFACES = ("normal", "object_normal", "ids")
#: Frames without ids and normals, whose tests would otherwise replace the depth test.
_BARE = Method("SVGF, depth alone", "SVGF", _without(*_SURFACES))


def _ablation(whole: Method, component: str, run: Run, *, added: bool = False) -> Ablation:
    sign = "+" if added else "-"
    return Ablation(component, Method(f"{whole.name} {sign} {component}", whole.family, run), whole, added)


def _stage(component: str, *, added: bool = False, **options: Any) -> Ablation:
    """SVGF with another output stage."""
    return replace(_ablation(_SVGF, component, _antialiased(**options), added=added), counterpart=_APART)


def _switch(name: str) -> Ablation:
    """SVGF with one switch inverted: without the component if it is on by default, else with it."""
    default = bool(inspect.signature(SVGF).parameters[name].default)
    return _ablation(_SVGF, _SWITCHES[name], pipeline(SVGF, **{name: not default}), added=not default)


#: Names of the components that are boolean parameters of `SVGF`, by parameter.
_SWITCHES = {
    "fireflies": "fireflies",
    "gradient": "gradient",
    "antialias": "antialiasing",
    "feedback": "feedback",
    "by_confidence": "shares by confidence",
    "choice": "choice",
    "innovation": "innovation",
    "coherence": "coherence of guides",
}

#: Every component of `SVGF` and `TAA`, and some of other pipelines; those of a network if it is installed.
ABLATIONS = (
    *map(_switch, _SWITCHES),
    *(
        _ablation(_SVGF, component, run)
        for component, run in {
            "depth test": pipeline(SVGF, **_NO_DEPTH_TEST),
            "normal test": pipeline(SVGF, normal_angle=180),
            "motion test": pipeline(SVGF, motion_difference=math.inf),
            "id test and weight": _without("ids"),
            "normals": _without("normal", "object_normal"),
            "demodulation": _without("albedo", "emission"),
            "reflections": pipeline(SVGF, reflections=()),
            # Above the longest history.
            "temporal variance": pipeline(SVGF, min_length=21),
            "spatial variance": pipeline(SVGF, min_length=1),
            "luminance weight": pipeline(SVGF, sigma_luminance=_ENDLESS),
            "limit of noise": pipeline(SVGF, relative_noise=math.inf),
            "brighter taps weigh less": pipeline(SVGF, tap_exposure=math.inf),
            "normal weight": pipeline(SVGF, sigma_normal=0),
            "depth weight": pipeline(SVGF, sigma_plane=_ENDLESS, sigma_depth=_ENDLESS),
            # With `choice`, a pass would be added.
            "all passes": pipeline(SVGF, iterations=0, choice=False),
            "passes after 1": pipeline(SVGF, iterations=1, choice=False),
            "passes after 2": pipeline(SVGF, iterations=2, choice=False),
        }.items()
    ),
    _ablation(_SVGF, "confidence in the output stage", _antialiased(**_CORRECTED, confidence=False)),
    _ablation(_SVGF, "weights by tone", _antialiased(**_CORRECTED, guided_exposure=0.0)),
    _stage("dilation", dilate="none"),
    _ablation(_SVGF, "clip", _antialiased(**_CORRECTED, gamma=_ENDLESS)),
    _ablation(_SVGF, "choice of the clip", _antialiased(**_CORRECTED, clip_choice=False)),
    _stage("cubic history", filter="bilinear"),
    _stage("tone-mapped box", space="ycocg"),
    _stage("share without guides", unguided_alpha=0.0),
    _stage("changes of material", material_change=False),
    _ablation(_SVGF, "smooth edges", _antialiased(**_CORRECTED, smooth_edges=False)),
    *(
        _ablation(_SVGF, component, run, added=True)
        for component, run in {
            "long memory": pipeline(SVGF, alpha=0.05),
            "pass 4": pipeline(SVGF, iterations=4),
            "5×5 taps": pipeline(SVGF, radius=2),
            "tolerance of 4 sigma": pipeline(SVGF, sigma_luminance=4),
            "albedo test": pipeline(SVGF, relative_albedo=0.1),
            "6 distances": pipeline(SVGF, reflections=(0.25, 0.5, 1, 2, 4, math.inf)),
            "later frames": pipeline(SVGF, lookahead=LOOKAHEAD),
            "soft thresholds": pipeline(
                SVGF, relative_depth=(0.05, 0.15), plane_distance=(0.005, 0.015), normal_angle=(15, 35)
            ),
        }.items()
    ),
    _stage("alternation", added=True, alternation=True),
    _stage("dilation around movers", added=True, dilate_movers=True),
    _stage("albedo test of the output stage", added=True, relative_albedo=0.1),
    _stage("hull of 26 planes", added=True, box="hull", response="current"),
    _stage("exact hull", added=True, box="exact-hull", response="current"),
    _ablation(_BMFR, "innovation", pipeline(BMFR, innovation=False)),
    _ablation(_BMFR, "small blocks without albedo", pipeline(BMFR, block=16)),
    _ablation(_BMFR, "bright light weighs less in fits", pipeline(BMFR, by_light=False)),
    _ablation(_BMFR, "restored detail", pipeline(BMFR, restore=False)),
    _ablation(_BMFR, "motion test", pipeline(BMFR, motion_difference=math.inf)),
    _ablation(_BMFR, "shares by confidence", pipeline(BMFR, by_confidence=True), added=True),
    _ablation(_HALF_RES, "shares by confidence", on_part(quarter, pipeline(HalfRes, by_confidence=True)), added=True),
    _ablation(_HALF_RES, "innovation", on_part(quarter, pipeline(HalfRes, innovation=False))),
    _ablation(_HALF_RES, "choice", on_part(quarter, pipeline(HalfRes, choice=False))),
    _ablation(_HALF_RES, "brighter taps weigh less", on_part(quarter, pipeline(HalfRes, tap_exposure=math.inf))),
    _ablation(_HALF_RES, "limit of noise", on_part(quarter, pipeline(HalfRes, relative_noise=math.inf))),
    replace(
        _ablation(_RECIRCULATION, "innovation", on_part(quarter, pipeline(Recirculation, innovation=False))),
        needs_all=True,
    ),
    *(
        _ablation(_OIDN, component, pipeline(OIDN, "high", temporal=True, **{component: False}))
        for component in ("innovation", "choice")
        if imports("mitsuba_oidn")
    ),
    _ablation(_BARE, "depth test", _without(*_SURFACES, **_NO_DEPTH_TEST)),
    *(
        _ablation(_TAA, component, run)
        for component, run in {
            "dilation": pipeline(TAA, dilate="none"),
            "dilation around movers": pipeline(TAA, dilate_movers=False),
            "clip": pipeline(TAA, gamma=_ENDLESS),
            "cubic history": pipeline(TAA, filter="bilinear"),
            "tone-mapped box": pipeline(TAA, space="ycocg"),
            "share by speed": pipeline(TAA, fast_alpha=0.05),
        }.items()
    ),
    *(
        _ablation(_TAA, component, run, added=True)
        for component, run in {
            "innovation": pipeline(TAA, innovation=True),
            "fireflies": pipeline(TAA, fireflies=True),
            "depth and plane test": pipeline(TAA, relative_depth=0.1, plane_distance=0.01),
            "id test": pipeline(TAA, ids=True),
            "gradient": pipeline(TAA, gradient=True),
            "anti-lag": pipeline(TAA, anti_lag=1.0),
            "hull of 26 planes": pipeline(TAA, box="hull", response="current"),
            "exact hull": pipeline(TAA, box="exact-hull", response="current"),
        }.items()
    ),
)


def bases(ablations: Iterable[Ablation]) -> list[Method]:
    """The methods with which these are compared, each once."""
    return [*dict.fromkeys(each.base for each in ablations)]


@dataclass(frozen=True)
class Effect:
    """The gain of a component on one sequence, and its cost.

    Attributes
    ----------
    scene : str
        Name of the recording, or `ALL` for means over all.
    pipeline, component : str
        The component that is switched, and its pipeline.
    added : bool
        True if the component is off by default.
    gains : dict of str to float
        By metric, the improvement of the result with the component over that without, as `harm.gains` returns it,
        averaged over the recording's variants. Negative where it harms.
    ms : float
        Cost per frame in milliseconds, as `yester.study.compare.chart.times` measures it; the same for all doors.
    door : str, default FULL
        Name of the door through which the frames came.
    default : bool, default True
        True if the pipeline has default parameters.
    errors : dict of str to float, default {}
        By metric, the standard error of the gain, if the recording has variants.
    """

    scene: str
    pipeline: str
    component: str
    added: bool
    gains: dict[str, float]
    ms: float
    door: str = FULL
    default: bool = True
    errors: dict[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the component in its pipeline."""
        return f"{self.pipeline} {'+' if self.added else '-'} {self.component}"

    @property
    def case(self) -> str:
        """Name of the sequence, and of the door unless it is the full one."""
        return self.scene if self.door == FULL else f"{self.scene}, {self.door}"


def ablate(
    recordings: Sequence[Recording],
    folder: Path,
    *,
    metrics: Iterable[str] = tuple(harm.LIMITS),
    doors: Sequence[Door] = DOORS[:1],
    ablations: Sequence[Ablation] = ABLATIONS,
    size: tuple[int, int] = SIZE,
) -> list[Effect]:
    """Switch off every component in turn, on every sequence.

    Writes `ablation.csv`; measurements are cached in `ablation/`, from which an interrupted run resumes.

    Parameters
    ----------
    recordings : sequence of Recording
        With different names, each with references.
    folder : Path
        Output folder, created if missing.
    metrics : iterable of str
        Keys of `yester.metrics.METRICS`.
    doors : sequence of Door, default the full one
        Doors through which the frames come. With poor doors, only components that are on by default are switched, and
        pipelines that need all buffers are skipped. Doors that need raw albedo are skipped for recordings without it.
    ablations : sequence of Ablation, default ABLATIONS
        The components to switch.
    size : (int, int), default 1280x720
        Width and height of the frames on which components are timed.

    Returns
    -------
    list of Effect
        For each scene, door and component; with several scenes, also the means over them.

    Raises
    ------
    ValueError
        If a metric is unknown.
    """
    keys = [metric(key).key for key in metrics]
    cases = []
    for recording in recordings:
        for door in known_doors(recording, doors):
            poor = door.name != FULL
            chosen = [each for each in ablations if not (poor and (each.added or each.needs_all))]
            bases = dict.fromkeys(base for each in chosen for base in (each.whole, each.base))
            methods = [*bases, *(each.method for each in chosen)]
            place = folder / "ablation" / door.name if poor else folder / "ablation"
            passed = passing([(method, door) for method in methods])
            _, *points = measure(recording, passed, place, metrics=keys, images=0)
            found = {method.name: point for method, point in zip(methods, points, strict=True)}
            cases += [(each, found, door.name) for each in chosen]
    switched = [*dict.fromkeys(method for each, *_ in cases for method in (each.base, each.method))]
    spent = {name: float(np.median(ms)) for name, ms in times(switched, folder / "ablation", size).items()}
    effects = [_effect(*case, spent) for case in cases]
    if len(recordings) > 1:
        effects += [_mean([e for e in effects if _key(e) == key]) for key in dict.fromkeys(map(_key, effects))]
    with beside(folder / "ablation.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "pipeline", "component", "added", "ms", *keys, "door", *(f"{k}_error" for k in keys)])
        for e in effects:
            gains, errors = ([known.get(key, "") for key in keys] for known in (e.gains, e.errors))
            writer.writerow([e.scene, e.pipeline, e.component, int(e.added), e.ms, *gains, e.door, *errors])
    return effects


def table(effects: Sequence[Effect]) -> str:
    """Write the effects as text: mean gain, number of cases with a gain, and the worst case with its name."""
    rows: dict[str, dict[str, Effect]] = {}
    for effect in effects:
        if effect.scene != ALL:
            rows.setdefault(effect.name, {})[effect.case] = effect
    return harm.table(
        {name: {case: e.gains for case, e in cases.items()} for name, cases in rows.items()},
        {name: float(np.mean([e.ms for e in cases.values()])) for name, cases in rows.items()},
    )


class Harm(NamedTuple):
    """A component that is on by default and harms a sequence.

    Attributes
    ----------
    effect : Effect
    losses : str
        The metrics in which it does harm, and by how much.
    made_good : bool
        Whether another metric gains enough for an exception. It is not listed as one.
    """

    effect: Effect
    losses: str
    made_good: bool


def harms(effects: Sequence[Effect], limits: Mapping[str, float] = harm.LIMITS) -> list[Harm]:
    """Find the components that are on by default and harm a sequence.

    Parameters
    ----------
    effects : sequence of Effect
        The result of `ablate`.
    limits : mapping of str to float, default `harm.LIMITS`
        By metric, the largest loss that is no harm.

    Returns
    -------
    list of Harm
        One for each component and case; the largest loss, relative to its limit, comes first. Left out are losses of
        less than two standard errors, and cases in `harm.EXCEPTIONS` where another metric gains enough.
    """
    found = []
    for e in effects:
        if e.scene == ALL or e.added or not e.default:
            continue
        sure = harm.sure(e.gains, e.errors)
        bad = harm.harms(sure, limits)
        left = harm.harms(sure, limits, excused=True)
        if bad and (left or (e.name, e.case) not in harm.EXCEPTIONS):
            losses = ", ".join(f"{key} {harm.amount(key, e.gains[key])}" for key in bad)
            found.append((min(e.gains[key] / limits[key] for key in bad), Harm(e, losses, not left)))
    return [each for _, each in sorted(found, key=lambda pair: pair[0])]


def harmful(effects: Sequence[Effect], limits: Mapping[str, float] = harm.LIMITS) -> list[str]:
    """Write a line for each result of `harms`."""
    good = " (made good in another metric, but not listed as an exception)"
    found = harms(effects, limits)
    return [f"{e.name}, {e.case}: {losses}{good if made_good else ''}" for e, losses, made_good in found]


def _key(effect: Effect) -> tuple[str, str]:
    return effect.name, effect.door


def _effect(ablation: Ablation, points: dict[str, Point], door: str, spent: dict[str, float]) -> Effect:
    whole, switched = points[ablation.base.name], points[ablation.method.name]
    having, lacking = (switched, whole) if ablation.added else (whole, switched)
    more = spent[ablation.method.name] - spent[ablation.base.name]
    gains, errors = harm.mean_gains(having.runs, lacking.runs)
    return Effect(
        whole.scene,
        ablation.whole.name,
        ablation.component,
        ablation.added,
        gains,
        more if ablation.added else -more,
        door,
        ablation.whole.default,
        errors,
    )


def _mean(effects: Sequence[Effect]) -> Effect:
    first = effects[0]
    keys = [key for key in first.gains if all(key in effect.gains for effect in effects)]
    return replace(
        first,
        scene=ALL,
        gains={key: float(np.mean([effect.gains[key] for effect in effects])) for key in keys},
        ms=float(np.mean([effect.ms for effect in effects])),
        errors={},
    )
