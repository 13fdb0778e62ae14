"""Threads that work beside the caller's, on as many cores as there are, and what each keeps.

`quotient` has threads of its own, because it stands alone.
"""

import gc
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
Value = TypeVar("Value")


@contextmanager
def thread_pool(num_threads: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Threads for work that releases the GIL; no garbage is collected meanwhile.

    A collection frees objects in whichever thread it happens to start. Drake's Meshcat ends the
    process unless the thread that opened it also frees it, and a diagram that draws in it is
    garbage only a collection finds. A generator must not hold such threads while it yields: it may
    never go on.

    Args:
        num_threads: one for each core that this process may use by default.
    """
    # Not numba's threads: its OpenMP layer breaks after a fork.
    from joblib import cpu_count

    collects = gc.isenabled()
    gc.disable()
    try:
        with ThreadPoolExecutor(num_threads or cpu_count()) as pool:
            yield pool
    finally:
        if collects:
            gc.enable()


def mapped(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The result of each item, in order, of work that releases the GIL."""
    with thread_pool() as pool:
        return list(pool.map(work, items))


class OncePerThread(Generic[Value]):
    """A function whose last result each thread keeps, and returns again for equal arguments.

    For what jobs need and what neither pickles nor serves two at a time, as a world: each worker,
    be it a thread or a process, makes its own, once. The result must depend on nothing but the
    arguments.
    """

    def __init__(self, make: Callable[..., Value]):
        self._make = make
        self._last = threading.local()

    def __call__(self, *arguments: Any) -> Value:
        """The result for these arguments."""
        if not self.knows(*arguments):
            self._last.__dict__.clear()  # two worlds need twice the memory
            self.keep(self._make(*arguments), *arguments)
        return self._last.value

    def knows(self, *arguments: Any) -> bool:
        """Whether this thread kept the result for these arguments."""
        return getattr(self._last, "arguments", None) == arguments

    def keep(self, value: Value, *arguments: Any) -> None:
        """Has this thread keep a result that was made elsewhere."""
        self._last.arguments, self._last.value = arguments, value
