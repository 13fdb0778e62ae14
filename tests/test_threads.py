import gc
import threading
import weakref

from selftouch_drake.threads import Threads, mapped


class Loop:
    """Garbage that only a collection finds, as a diagram that draws in Meshcat is."""

    def __init__(self):
        self.itself = self


def freed_in():
    """A new loop, already garbage, and a list of the threads that have freed it."""
    threads: list[str] = []
    weakref.finalize(Loop(), lambda: threads.append(threading.current_thread().name))
    return threads


def test_results_come_in_order():
    assert list(mapped(lambda i: i * i, range(100))) == [i * i for i in range(100)]


def test_garbage_is_freed_where_it_was_made():
    threads = freed_in()
    with Threads(1) as outer:
        with Threads(1) as inner:
            inner.submit(gc.collect).result()
        outer.submit(gc.collect).result()
        assert threads == []
    gc.collect()
    assert threads == [threading.current_thread().name]


def test_threads_that_are_forgotten_keep_nothing_from_being_freed():
    Threads(1).submit(gc.collect).result()
    assert gc.get_freeze_count() == 0


def test_threads_free_their_own_garbage():
    def make_and_free():
        threads = freed_in()
        gc.collect()
        return threads

    with Threads(1) as pool:
        assert len(pool.submit(make_and_free).result()) == 1
    assert gc.get_freeze_count() == 0
