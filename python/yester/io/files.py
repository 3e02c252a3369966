"""Files that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """A temporary file that takes the place of `path` at the end, or goes away if anything interrupts."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.touch()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from None
        yield temporary
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):  # there is none, if touch() failed
            temporary.unlink()
        raise
