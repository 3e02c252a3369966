"""Every rendered sequence by its name and its group."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from . import held_out, scenes, unkind, unseen

__all__ = ["GROUPS", "LATE", "NAMES", "Make", "find"]

#: Makes a sequence from the number of frames, and the width and height of the images.
Make: TypeAlias = Callable[[int, int, int], scenes.Sequence]

#: The names of each group. Parameters may be tuned on the ``tuning`` groups; the ``held-out`` ones are for validation.
GROUPS: dict[str, tuple[str, ...]] = {
    "tuning": scenes.TUNING,
    "held-out": scenes.HELD_OUT,
    "unkind-tuning": unkind.NAMES,
    "unkind-held-out": unseen.NAMES,
}
NAMES = tuple(name for group in GROUPS.values() for name in group)
GROUPS["all"] = NAMES
#: Sequences that are in no group but their own, so that nothing is chosen by them: for validation, once.
LATE = held_out.NAMES
GROUPS["late-held-out"] = LATE


def find(name: str) -> Make:
    """Look a sequence up by its name; ValueError if there is none."""
    for module in (scenes, unkind, unseen, held_out):
        if name in NAMES + LATE and hasattr(module, name):
            make: Make = getattr(module, name)
            return make
    raise ValueError(f"name: expected one of {', '.join(NAMES + LATE)}, got {name!r}")
