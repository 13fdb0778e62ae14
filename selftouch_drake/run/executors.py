"""Where walks run: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager


def local_executor(num_workers: int | None = None, *, ends_on_ctrl_c: bool = False) -> Executor:
    """A pool of processes, one for each core by default.

    By default they ignore Ctrl-C: the main process waits for the jobs that are running. For long
    jobs they end on Ctrl-C.
    """
    return ProcessPoolExecutor(
        num_workers or os.cpu_count(),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_DFL if ends_on_ctrl_c else signal.SIG_IGN),
    )


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler, as an executor; they must see the run directory.

    Args:
        address: of the scheduler, as in `tcp://10.0.0.1:8786`.

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
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"--scheduler {address} does not answer: {error}") from None
    with client:
        yield client.get_executor(pure=False)
