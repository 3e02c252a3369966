"""A user's own mapping of channels to buffers, for files that are not recognised or are recognised wrongly."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .channels import CANONICAL, VALUES, Form, Found, Recognised

#: Largest number of float32, in which buffers are converted.
_LARGEST = float(np.finfo(np.float32).max)
#: What `read_exr` takes: the name of a TOML file, or what is in it.
Mapped: TypeAlias = str | os.PathLike[str] | Mapping[str, Any]

#: Numbers of components that a buffer may have, if there are several.
_FEWER = {"motion": 2, "motion_next": 2}
#: The buffers that have a property; all have the others.
_OF: dict[str, tuple[str, ...]] = {
    "unit": ("motion", "motion_next"),
    "space": ("normal", "position"),
    **dict.fromkeys(("kind", "near", "miss"), ("depth",)),
}
_PROPERTIES = {"channels", *(one.name for one in fields(Form))} - {"cryptomatte", "index"}


def load(given: Mapped | None) -> dict[str, dict[str, Any]]:
    """Check a mapping.

    Parameters
    ----------
    given : path-like or mapping, optional
        A TOML file, or what it has: by buffer of a `Frame`, channels or a table with any of ``channels`` (a list;
        ``-`` in front of a channel turns its sign, an empty list leaves the buffer out), ``unit``, ``scale``,
        ``space``, ``kind``, ``near`` and ``miss`` (see `yester.io.channels.Form`).

    Returns
    -------
    dict of str to dict
        The properties of each buffer.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not TOML, or something in it is not known; the message names the file and the entry.
    """
    if given is None:
        return {}
    where = "mapping"
    if not isinstance(given, Mapping):
        where = str(given)
        try:
            given = tomllib.loads(Path(given).read_text("utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{where}: not a TOML file: {error}") from None
    result = {}
    for buffer, entry in given.items():
        if buffer not in CANONICAL:
            raise ValueError(
                f"{where}: expected buffers ({', '.join(CANONICAL)}), got {buffer!r}{_like(buffer, CANONICAL)}"
            )
        result[buffer] = _entry(entry, buffer, f"{where}: {buffer}")
    return result


def parse(texts: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The mapping that arguments of the command line describe.

    Parameters
    ----------
    texts : iterable of str
        Each the name of a TOML file, or ``BUFFER=CHANNEL,CHANNEL,...``, or ``BUFFER.PROPERTY=VALUE``. Later ones add
        to earlier ones.

    Returns
    -------
    dict
        As `load` returns it.

    Raises
    ------
    OSError, ValueError
        As `load`.
    """
    result: dict[str, dict[str, Any]] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            for buffer, entry in load(text).items():
                result.setdefault(buffer, {}).update(entry)
            continue
        buffer, _, name = key.strip().partition(".")
        parts = [part.strip() for part in value.split(",") if part.strip()]
        known: Any = {name: parts} if name else parts
        if name in ("near", "scale"):
            try:
                numbers = [float(part) for part in parts]
            except ValueError:
                raise ValueError(f"--map {key}: expected numbers, got {value!r}") from None
            known = {name: numbers[0] if len(numbers) == 1 else numbers}
        elif name and name != "channels":
            known = {name: value.strip()}
        for mapped, entry in load({buffer: known}).items():
            result.setdefault(mapped, {}).update(entry)
    return result


def apply(mapping: Mapping[str, Mapping[str, Any]], known: Recognised, names: Iterable[str]) -> Recognised:
    """Replace what was recognised by what the user says.

    Raises ValueError if a channel is not in the file, or a property is given for a buffer without channels.
    """
    names = list(names)
    buffers, unused = dict(known.buffers), dict(known.unused)
    for buffer, entry in mapping.items():
        form = {name: value for name, value in entry.items() if name != "channels"}
        if "channels" in entry:
            buffers.pop(buffer, None)
            channels = tuple(channel.removeprefix("-") for channel in entry["channels"])
            signs = tuple(-1.0 if channel.startswith("-") else 1.0 for channel in entry["channels"])
            for channel in channels:
                if channel not in names:
                    raise ValueError(f"mapping: {buffer}: no channel {channel!r}{_like(channel, names)}")
            if not channels:
                continue
            scale = _product(signs, form.pop("scale", ()))
            buffers[buffer] = Found(channels, Form(**form, scale=scale), target=channels, mapped=True)
            unused = {channel: why for channel, why in unused.items() if channel not in channels}
        elif buffer in buffers:
            found = buffers[buffer]
            buffers[buffer] = replace(found, form=replace(found.form, **form), mapped=True)
        else:
            raise ValueError(
                f"mapping: {buffer}: expected channels, as none were recognised, got {', '.join(form)} alone"
            )
    ordered = {buffer: buffers[buffer] for buffer in CANONICAL if buffer in buffers}
    return replace(known, buffers=ordered, unused=unused)


def _entry(entry: Any, buffer: str, where: str) -> dict[str, Any]:
    """The checked properties of a buffer."""
    table = dict(entry) if isinstance(entry, Mapping) else {"channels": entry}
    known = sorted(name for name in _PROPERTIES if buffer in _OF.get(name, CANONICAL))
    for name, value in table.items():
        if name not in known:
            raise ValueError(f"{where}: expected some of {', '.join(known)}, got {name!r}{_like(name, known)}")
        if name in VALUES and value not in VALUES[name]:
            raise ValueError(f"{where}.{name}: expected {' or '.join(VALUES[name])}, got {value!r}")
        if name == "near" and not _finite(value):
            raise ValueError(f"{where}.near: expected a number, got {value!r}")
    least, most = _FEWER.get(buffer, len(CANONICAL[buffer])), len(CANONICAL[buffer])
    if "scale" in table:
        scale = table["scale"]
        several = scale if isinstance(scale, list | tuple) else [scale] * most
        if not least <= len(several) <= most or not all(_finite(one) and one for one in several):
            raise ValueError(f"{where}.scale: expected a number other than 0, or {most} of them, got {scale!r}")
        table["scale"] = tuple(float(one) for one in several)
    if "channels" in table:
        given = [table["channels"]] if isinstance(table["channels"], str) else table["channels"]
        if not isinstance(given, list | tuple) or not all(isinstance(one, str) for one in given):
            raise ValueError(f"{where}: expected names of channels, got {table['channels']!r}")
        if given and not least <= len(given) <= most:
            count = most if least == most else f"{least} or {most}"
            raise ValueError(f"{where}: expected {count} channels, got {len(given)}: {', '.join(given)}")
        table["channels"] = tuple(given)
    return table


def _finite(value: Any) -> bool:
    """Whether it is a number that float32 holds."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _product(signs: tuple[float, ...], scale: tuple[float, ...]) -> tuple[float, ...]:
    product = tuple(sign * one for sign, one in zip(signs, [*scale, *[1.0] * len(signs)], strict=False))
    return product if any(one != 1 for one in product) else ()


def _like(name: str, known: Iterable[str]) -> str:
    close = get_close_matches(name, list(known), 1)
    return f" (perhaps {close[0]})" if close else ""
