"""The pipelines that can be chosen, and their parameters with ranges and defaults, as the pipelines themselves say."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from typing import Any

from .. import BMFR, OIDN, SVGF, TAA, Frame, HalfRes, Recirculation

__all__ = ["PIPELINES", "adapted", "build", "controls", "plain"]

#: By name on the page.
PIPELINES: dict[str, Callable[..., Any]] = {
    "SVGF": SVGF,
    "BMFR": BMFR,
    "HalfRes": HalfRes,
    "TAA": TAA,
    "Recirculation": Recirculation,
    "OIDN": OIDN,
}

_NUMBER = r"(-?\d+(?:\.\d+)?)"


def build(name: str, parameters: Mapping[str, Any]) -> Any:
    """Make a pipeline; ValueError names the parameter that does not fit."""
    if name not in [*PIPELINES]:  # of a page, it may be anything
        raise ValueError(f"pipeline: expected one of {', '.join(PIPELINES)}, got {name!r}")
    known = {control["name"] for control in controls(name)}
    for given in parameters:
        if given not in known:
            raise ValueError(f"parameters: expected some of {', '.join(sorted(known))}, got {given!r}")
    try:
        return PIPELINES[name](**{key: tuple(v) if isinstance(v, list) else v for key, v in parameters.items()})
    except (TypeError, OverflowError) as error:
        raise ValueError(f"parameters: {error}") from error


@cache
def controls(name: str) -> tuple[dict[str, Any], ...]:
    """The parameters of a pipeline, each with what a page needs to show it.

    Names and defaults are those of the signature. Types and ranges are what the constructor answers to values that are
    out of range, and the explanation is that of the docstring.

    Parameters
    ----------
    name : str
        One of `PIPELINES`.

    Returns
    -------
    tuple of dict
        ``name``; ``kind``: switch, choice, number or list; ``default``, None if the preset decides; ``about``; of
        choices ``among``; of numbers ``whole``, ``low`` and ``high``, None where there is no limit.
    """
    make = PIPELINES[name]
    told = _documented(make)
    found = []
    for parameter in inspect.signature(make).parameters.values():
        default = list(parameter.default) if isinstance(parameter.default, tuple) else parameter.default
        found.append(
            {"name": parameter.name, "default": default, "about": told.get(parameter.name, "")}
            | _kind(make, parameter.name, default)
        )
    return tuple(found)


def _kind(make: Callable[..., Any], name: str, default: Any) -> dict[str, Any]:
    """Find out what values a parameter takes, from the errors of those that it does not."""
    if isinstance(default, bool):
        return {"kind": "switch"}
    said = {probe: _answer(make, name, probe) for probe in ("?", -(10**9), 10**9, math.nan)}
    if choices := re.search(r"expected one of (.*), got", said["?"]):
        return {"kind": "choice", "among": [choice.strip('"') for choice in choices[1].split(", ")]}
    if "bool" in said["?"]:
        return {"kind": "switch"}
    if isinstance(default, list) or "Sequence" in said[10**9] or "tuple" in said[10**9]:
        return {"kind": "list"}
    ranges = [r for probe in (-(10**9), 10**9) if (r := re.search(r"expected (.*), got", said[probe]))]
    low = high = None
    for limits in ranges:
        both = re.search(rf"{_NUMBER} (?:to|or) {_NUMBER}", limits[1])
        lowest = re.search(rf"(?:from|above|least) {_NUMBER}|{_NUMBER} or more", limits[1])
        if both:
            low, high = float(both[1]), float(both[2])
        elif lowest and low is None:
            low = float(lowest[1] or lowest[2])
    return {"kind": "number", "whole": "integer" in said[math.nan], "low": low, "high": high}


def _answer(make: Callable[..., Any], name: str, value: object) -> str:
    """The error that a value gives; empty if it is accepted."""
    try:
        make(**{name: value})
    except (TypeError, ValueError, OverflowError) as error:
        return str(error)
    return ""


def _documented(make: Callable[..., Any]) -> dict[str, str]:
    """The explanations of a docstring's parameters, by name."""
    text = inspect.getdoc(make) or ""
    section = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n[A-Z][a-z]+(?: \w+)?\n-+\n|\Z)", text, re.S | re.M)
    about = {}
    for entry in re.finditer(r"^(\S.*?) : .*\n((?:    .*\n?)+)", section[1] if section else "", re.M):
        for one in entry[1].split(", "):
            about[one] = " ".join(entry[2].split())
    return about


def adapted(name: str, frame: Frame, number: int) -> Frame:
    """The frame as a pipeline takes it: for `HalfRes`, with one sample of each 2×2 pixels."""
    if name != "HalfRes":
        return frame
    from ..study.compare.methods import quarter

    return quarter(frame, number)


def plain() -> dict[str, tuple[dict[str, Any], ...]]:
    """The pipelines that are installed, with their controls, as the page is told of them."""
    found = {}
    for name in PIPELINES:
        # Open Image Denoise may be absent.
        with suppress(ImportError):
            found[name] = controls(name)
    return found
