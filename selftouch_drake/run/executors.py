"""Executors: this process, processes of this machine, or a Dask cluster."""

import multiprocessing
import os
import signal
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from selftouch_drake.run.warning_lines import one_line_warnings

#: Shards whose results may wait: bounds the memory, and keeps a few machines busy.
SHARDS_AHEAD = 16

#: How long a scheduler may take to answer.
ANSWERS_WITHIN = "10s"


def local_executor(num_workers: int | None = None) -> Executor:
    """Processes of this machine, one for each core by default; a single one is this process.

    They end on Ctrl-C: what they write is whole or not there.
    """
    num_workers = num_workers or os.cpu_count() or 1
    if num_workers == 1:
        return InTurn()
    return ProcessPoolExecutor(
        num_workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
    )


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    warnings.showwarning = one_line_warnings(warnings.showwarning)


def map_ahead(
    executor: Executor, ahead: int, call: Callable[[Any], Any], items: Iterable[Any]
) -> Generator[Any]:
    """What a call makes of each item, in order; at most `ahead` results wait to be asked for."""
    waiting = deque[Future]()
    try:
        for item in items:
            waiting.append(executor.submit(call, item))
            if len(waiting) > ahead or isinstance(executor, InTurn):  # nothing runs meanwhile
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


class InTurn(Executor):
    """Makes calls one after another, in this process."""

    def submit(self, fn, /, *args: Any, **kwargs: Any) -> Future:
        """Makes a call at once."""
        future: Future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future

    def map(self, fn, *iterables, timeout: float | None = None, chunksize: int = 1) -> Iterator:
        """Makes each call when its result is needed."""
        return map(fn, *iterables)


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler, as an executor; they must see the run directory.

    Raises:
        ValueError: Dask is not installed, or no scheduler answers there.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ValueError(
            "--scheduler needs Dask; install it with `pip install 'selftouch-drake[dask]'`"
        ) from None
    try:
        client = Client(address, timeout=ANSWERS_WITHIN, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--scheduler {address} does not answer ({error}); start it, or correct the address"
        ) from None
    with client:
        yield client.get_executor(pure=False)
