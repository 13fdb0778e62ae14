"""Work that is spread over the cores of the machine, with the same result on any number of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def threads() -> ThreadPoolExecutor:
    """A thread for each core that this process may use, for work that releases the GIL."""
    from joblib import cpu_count

    # Not numba's threads: its OpenMP layer breaks after a fork.
    return ThreadPoolExecutor(cpu_count())


def mapped(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yields the result of each item, in order."""
    with threads() as pool:
        yield from pool.map(work, items)
