"""Work that is done before it is asked for."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

T = TypeVar("T")


def ahead(items: Iterable[T], count: int = 1) -> Generator[T, None, None]:
    """Items in their order, made by a thread of their own, up to `count` before they are asked for.

    What making one raises is raised in its place. Closed early, the thread ends with the item that it is at.
    """
    source = iter(items)
    thread = ThreadPoolExecutor(1)
    try:
        waiting = deque(thread.submit(list, islice(source, 1)) for _ in range(count))
        while item := waiting.popleft().result():
            waiting.append(thread.submit(list, islice(source, 1)))
            yield from item
    finally:
        thread.shutdown(cancel_futures=True)
