"""Executors: processes of this machine, or a Dask cluster; and what their jobs share."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Generic, TypeVar

from selftouch_drake.threads import Threads

Value = TypeVar("Value")


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


# s; shorter work needs no other processes, because they take as long to start.
_HEAD_START_S = 2.0


def _start() -> None:
    """Imports modules that take seconds to load."""
    import selftouch_drake.experience  # noqa: F401


class HereAndInProcesses(Threads):
    """This process, and further ones that join in if there is much work.

    Args:
        num_workers: number of processes, including this one; one per core by default.
    """

    def __init__(self, num_workers: int | None = None):
        num_workers = num_workers or os.cpu_count() or 1
        # No process starts before the first call.
        self._num_others = num_workers - 1
        self._others = local_executor(max(self._num_others, 1))
        self._thread, self._number = threading.local(), itertools.count()
        self._ends, self._joined = threading.Event(), threading.Event()
        super().__init__(num_workers, initializer=self._begin)

    def submit(self, fn, /, *args: Any, **kwargs: Any) -> Future:
        """Schedules a call, here or in a process that has started."""
        return super().submit(self._run, fn, args, kwargs)

    def get_ready(self, fn: Callable[..., Any], *args: Any) -> None:
        """Has the other processes make a call when they start, before there is work for them."""
        if self._num_others:
            threading.Thread(target=self._get_ready, args=(fn, args), daemon=True).start()

    def _get_ready(self, fn: Callable[..., Any], args: tuple[Any, ...]) -> None:
        if not self._ends.wait(_HEAD_START_S):
            # It may end just now.
            with suppress(RuntimeError):
                for _ in range(self._num_others):
                    self._others.submit(fn, *args).add_done_callback(self._joins)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Waits for calls that run, but not for processes that have not started."""
        self._ends.set()
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        # Python must not exit while processes that have started are being shut down.
        self._others.shutdown(wait=wait and self._joined.is_set(), cancel_futures=True)

    def _joins(self, started: Future) -> None:
        if not started.cancelled():
            self._joined.set()

    def _begin(self) -> None:
        """Each thread stands for one process, the first for this one."""
        self._thread.is_here = next(self._number) == 0
        if self._thread.is_here or self._ends.wait(_HEAD_START_S):
            return
        # A call that went there at once would wait for Drake; meanwhile it may be made here.
        started = self._others.submit(_start)
        started.add_done_callback(self._joins)
        while not (started.done() or self._ends.wait(0.1)):
            pass

    def _run(self, fn, args, kwargs):
        if self._thread.is_here:
            return fn(*args, **kwargs)
        return self._others.submit(fn, *args, **kwargs).result()


class InTurn(Executor):
    """Makes each call in the thread that asks for its result."""

    def submit(self, fn, /, *args: Any, **kwargs: Any) -> Future:
        """Schedules a call."""
        return _Call(partial(fn, *args, **kwargs))


class _Call(Future):
    def __init__(self, call: Callable[[], Any]):
        super().__init__()
        self._call = call

    def result(self, timeout: float | None = None) -> Any:
        if not self.done():
            self.set_result(self._call())
        return super().result(timeout)


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
        raise ValueError(
            f"--scheduler {address} does not answer ({error}); start it, or correct the address"
        ) from None
    with client:
        yield client.get_executor(pure=False)


@dataclass(frozen=True)
class Shared(Generic[Value]):
    """Stands for something that jobs need and that cannot be pickled, as a world; see `shared`."""

    name: str
    make: Callable[..., Value]
    arguments: tuple[Any, ...]

    @property
    def value(self) -> Value:
        """What this process was given, or made."""
        return _given[self.name] if self.name in _given else _made(self)


@contextmanager
def shared(value: Value, make: Callable[..., Value], *arguments: Any) -> Iterator[Shared[Value]]:
    """Yields what stands for `value` here; each other process makes its own, once.

    Args:
        value: what jobs in this process use.
        make: makes the same in another process.
        arguments: of `make`.
    """
    stands_for = Shared(uuid.uuid4().hex, make, arguments)
    _given[stands_for.name] = value
    try:
        yield stands_for
    finally:
        del _given[stands_for.name]


_given: dict[str, Any] = {}


@lru_cache(maxsize=1)
def _made(needed: Shared[Value]) -> Value:
    return needed.make(*needed.arguments)
