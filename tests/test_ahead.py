"""Prefetching an iterator in a background thread: the same items, and no more ahead than allowed."""

import threading
from contextlib import closing

import pytest
from yester.io.ahead import ahead


@pytest.mark.parametrize("length", [0, 1, 2, 50])
def test_order(length):
    assert list(ahead(iter(range(length)))) == list(range(length))


def test_reads_one_item_ahead():
    """Each item signals its start; an item too far ahead would signal before it is requested."""
    making = threading.Semaphore(0)

    def items():
        for i in range(20):
            making.release()
            yield i

    with closing(ahead(items())) as numbers:
        next(numbers)
        for _ in range(2):
            assert making.acquire(timeout=60)
        assert not making.acquire(timeout=0.2)
        next(numbers)
        assert making.acquire(timeout=60)
        assert not making.acquire(timeout=0.2)


def test_made_by_another_thread():
    """The next item is made while one is in use: here each waits for the other."""
    together = threading.Barrier(2, timeout=60)

    def items():
        yield threading.get_ident()
        together.wait()
        yield threading.get_ident()

    with closing(ahead(items())) as threads:
        first = next(threads)
        together.wait()
        assert next(threads) == first != threading.get_ident()


def test_an_error_comes_in_its_place():
    def items():
        yield from range(5)
        raise OSError("the sixth")

    numbers = ahead(items())
    assert [next(numbers) for _ in range(5)] == list(range(5))
    with pytest.raises(OSError, match="the sixth"):
        next(numbers)


def test_closed_early_the_thread_ends():
    made = []
    before = threading.active_count()
    with closing(ahead(map(made.append, range(1000)))) as items:
        next(items)
    assert threading.active_count() == before
    assert len(made) <= 2
