"""Parts of messages: names of files, and errors of the system."""

from __future__ import annotations

from collections.abc import Sequence

#: Names in a message; of more, it has the number.
SHOWN = 3


def few(names: Sequence[object]) -> str:
    """The first ones of some names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{', '.join(map(str, names[:SHOWN]))}{more}"


def told(error: Exception) -> str:
    """The message of an error, without the number that Python puts in front of one of the system."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)
