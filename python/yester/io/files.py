"""Atomic file writes, and files in messages."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

#: Names in a message; of more, it has the number.
SHOWN = 3


def in_use(temporary: Path) -> bool:
    """Whether the process that writes a temporary file of `beside` still runs, on this machine."""
    if os.name == "nt":
        return False  # there, asking would interrupt it; and a file that is open cannot be removed
    number = temporary.name.split(".")[-2]
    try:
        os.kill(int(number), 0)
    except (ValueError, OverflowError, ProcessLookupError):
        return False
    except PermissionError:  # of another user
        return True
    return True


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """A temporary file that is renamed to `path` at the end, or removed on an exception."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.touch()
        yield temporary
        temporary.replace(path)
    except BaseException as error:
        with suppress(OSError):  # touch() may have failed
            temporary.unlink()
        # Writing to an open file fails without its name, as on a full disk.
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def few(names: Sequence[object]) -> str:
    """The first ones of some names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{', '.join(map(str, names[:SHOWN]))}{more}"


def told(error: Exception) -> str:
    """The message of an error, without the number that Python puts in front of those of the system."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)
