"""Atomic file writes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """A temporary file that is renamed to `path` at the end, or removed on an exception."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.touch()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from None
        yield temporary
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):  # touch() may have failed
            temporary.unlink()
        raise
