"""Captures the standard output of a single thread."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock, get_ident
from typing import Any, TextIO, cast


class _Shared:
    """Standard output, without the threads whose output is captured."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.kept: dict[int, list[str]] = {}

    def write(self, text: str) -> int:
        kept = self.kept.get(get_ident())
        if kept is None:
            return self.stream.write(text)
        kept.append(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


_lock = Lock()


@contextmanager
def kept_output() -> Iterator[list[str]]:
    """Capture this thread's writes to `sys.stdout`; those of other threads pass through.

    For libraries that print errors instead of raising them. Several threads may capture at once; the first one replaces
    `sys.stdout` and the last one restores it, unless it was replaced in the meantime.
    """
    thread, said = get_ident(), list[str]()
    with _lock:
        former: Any = sys.stdout
        shared = former if isinstance(former, _Shared) else _Shared(former)
        sys.stdout = cast(TextIO, shared)
        outer = shared.kept.get(thread)
        shared.kept[thread] = said
    try:
        yield said
    finally:
        with _lock:
            if outer is None:
                del shared.kept[thread]
            else:
                shared.kept[thread] = outer
            current: object = sys.stdout
            if current is shared and not shared.kept:
                sys.stdout = shared.stream
