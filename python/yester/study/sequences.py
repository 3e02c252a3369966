"""Every rendered sequence by its name and its group."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from . import scenes, unkind, unseen

__all__ = ["GROUPS", "NAMES", "Make", "find"]

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


def find(name: str) -> Make:
    """Look a sequence up by its name; ValueError if there is none."""
    for module in (scenes, unkind, unseen):
        if name in NAMES and hasattr(module, name):
            make: Make = getattr(module, name)
            return make
    raise ValueError(f"name: expected one of {', '.join(NAMES)}, got {name!r}")
