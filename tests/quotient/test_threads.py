import gc
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor

import pytest

from selftouch_drake.quotient.threads import in_slices, mapped, thread_pool


class Loop:
    """Garbage that only a collection finds, as a diagram that draws in Meshcat is."""

    def __init__(self):
        self.itself = self


@pytest.fixture
def collecting():
    """Collects at every opportunity, whatever other tests have left."""
    before, threshold = gc.isenabled(), gc.get_threshold()
    gc.enable()
    gc.set_threshold(700, 10, 10)
    yield
    gc.set_threshold(*threshold)
    (gc.enable if before else gc.disable)()


def freed_in():
    """A new loop, already garbage, and a list of the threads that have freed it."""
    threads: list[str] = []
    weakref.finalize(Loop(), lambda: threads.append(threading.current_thread().name))
    return threads


def work(_=None):
    """Makes more objects than may be made without a collection."""
    return len([[] for _ in range(100_000)])


def test_results_come_in_order():
    assert mapped(lambda i: i * i, range(100)) == [i * i for i in range(100)]


def test_slices_are_every_row_once():
    rows = []
    in_slices(lambda some: rows.extend(range(10)[some]), 10, 4)
    assert sorted(rows) == list(range(10))


def test_garbage_is_not_freed_by_threads_that_work(collecting):
    threads = freed_in()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(work).result()
    assert len(threads) == 1
    assert threads[0] != threading.current_thread().name
    threads = freed_in()
    with thread_pool(1) as outer:
        mapped(work, range(2))
        outer.submit(mapped, work, range(2)).result()
        outer.submit(work).result()
        assert threads == []
    gc.collect()
    assert threads == [threading.current_thread().name]


def test_garbage_is_collected_again_after_an_error(collecting):
    with pytest.raises(ZeroDivisionError):
        mapped(lambda number: 1 // number, [1, 0])
    assert gc.isenabled()
    gc.disable()
    mapped(abs, [1])
    assert not gc.isenabled()
