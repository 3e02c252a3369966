"""The rendered sequences by name and by group, and the options with which commands choose among them."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from pathlib import Path

from . import fresh, held_out, scenes, thin, unkind, unseen
from .build import BUILDERS, Make

__all__ = ["FRESH", "GROUPS", "KNOWN", "LATE", "NAMES", "THIN", "expand", "find", "parser"]

#: The names of each group. Parameters may be tuned on the ``tuning`` groups; the ``held-out`` ones are for validation.
GROUPS: dict[str, tuple[str, ...]] = {
    "tuning": scenes.TUNING,
    "held-out": scenes.HELD_OUT,
    "unkind-tuning": unkind.NAMES,
    "unkind-held-out": unseen.NAMES,
}
NAMES = tuple(name for group in GROUPS.values() for name in group)
GROUPS["all"] = NAMES
#: Validation sequences outside ``all``: nothing was chosen or tuned by them.
LATE = held_out.NAMES
GROUPS["late-held-out"] = LATE
#: Those made last: nothing was chosen or tuned by them.
FRESH = fresh.NAMES
GROUPS["fresh-held-out"] = FRESH
#: Sequences outside ``all`` for what is thinner than a pixel.
THIN = thin.NAMES
GROUPS["thin"] = THIN
#: All that there are.
KNOWN = NAMES + LATE + FRESH + THIN


def find(name: str) -> Make:
    """Find the constructor of a sequence; ValueError if the name is unknown."""
    if name not in BUILDERS:
        raise ValueError(f"name: expected one of {', '.join(KNOWN)}, got {name!r}")
    return BUILDERS[name]


def expand(asked: Iterable[str]) -> list[str]:
    """Replace the names of groups by those of their sequences; each sequence comes once."""
    return [*dict.fromkeys(name for one in asked for name in GROUPS.get(one, (one,)))]


def parser(module: str, about: str | None, default: Sequence[str] = ("all",)) -> ArgumentParser:
    """Make a command's parser, with the options ``--sequences`` (for `expand`) and ``--cache`` (for `record`)."""
    result = ArgumentParser(prog=f"python -m {module}", description=about)
    known = [*GROUPS, *KNOWN]
    *several, last = [*GROUPS][[*GROUPS].index("all") + 1 :]
    others = f"{', '.join(several)} and {last}"
    groups = f"names, or {', '.join(GROUPS)}; by default {' '.join(default)}. all does not include {others}"
    result.add_argument("--sequences", metavar="NAME", nargs="+", default=default, choices=known, help=groups)
    result.add_argument("--cache", metavar="DIR", type=Path, help="folder for rendered frames")
    return result
