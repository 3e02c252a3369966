"""Prefetching an iterator in a background thread: the same items, and no more ahead than allowed."""

import threading
from contextlib import closing

import pytest
from yester.io.ahead import ahead


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("length", [0, 1, 2, 50])
def test_order(length, count):
    assert list(ahead(iter(range(length)), count)) == list(range(length))


@pytest.mark.parametrize("count", [1, 3])
def test_reads_ahead_within_the_limit(count):
    """Each item signals its start; an item too far ahead would signal before it is requested."""
    making = threading.Semaphore(0)

    def items():
        for i in range(20):
            making.release()
            yield i

    with closing(ahead(items(), count)) as numbers:
        next(numbers)
        for _ in range(1 + count):
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

    numbers = ahead(items(), 3)
    assert [next(numbers) for _ in range(5)] == list(range(5))
    with pytest.raises(OSError, match="the sixth"):
        next(numbers)


@pytest.mark.parametrize("count", [1, 3])
def test_closed_early_the_thread_ends(count):
    made = []
    before = threading.active_count()
    with closing(ahead(map(made.append, range(1000)), count)) as items:
        next(items)
    assert threading.active_count() == before
    assert len(made) <= 1 + count
