"""Prefetching of iterators in a background thread."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

T = TypeVar("T")


def ahead(items: Iterable[T]) -> Generator[T, None, None]:
    """Prefetch the next item of an iterable in a background thread; the order is kept.

    An exception is raised at the position of its item. If closed early, the thread ends after the current item.
    """
    source = iter(items)
    thread = ThreadPoolExecutor(1)
    try:
        waiting = thread.submit(list, islice(source, 1))
        while item := waiting.result():
            waiting = thread.submit(list, islice(source, 1))
            yield from item
    finally:
        thread.shutdown(cancel_futures=True)
