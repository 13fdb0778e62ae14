"""Threads that work beside the caller's, one on each core."""

import gc
import math
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

# Where Linux keeps the share of the cores that a container may use.
_QUOTA = Path("/sys/fs/cgroup/cpu.max")


def num_cores() -> int:
    """Cores that this process may use, by its affinity and the quota of its container."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    try:
        quota_us, period_us = map(int, _QUOTA.read_text().split())
    except (OSError, ValueError):  # no container, or one without a quota
        return cores
    return max(1, min(cores, math.ceil(quota_us / period_us)))


@contextmanager
def thread_pool(num_threads: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Threads for work that releases the GIL, one for each core by default.

    No garbage is collected meanwhile: a collection frees objects in whichever thread it happens to
    start, and some objects of a caller may be freed only by the thread that made them. A generator
    must not hold such threads while it yields: it may never go on.
    """
    # Not numba's threads: its OpenMP layer breaks after a fork.
    collects = gc.isenabled()
    gc.disable()
    try:
        with ThreadPoolExecutor(num_threads or num_cores()) as pool:
            yield pool
    finally:
        if collects:
            gc.enable()


def mapped(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The result of each item, in order, of work that releases the GIL."""
    with thread_pool() as pool:
        return list(pool.map(work, items))


def in_slices(work: Callable[[slice], object], num_rows: int, most: int) -> None:
    """Calls `work` with slices of at most `most` of `num_rows` rows; it releases the GIL."""
    mapped(work, [slice(start, start + most) for start in range(0, num_rows, most)])
