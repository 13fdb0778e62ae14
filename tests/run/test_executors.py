"""Calls run in this process or in others, and each thread keeps what it made."""

import os
from concurrent.futures import ThreadPoolExecutor, wait

import pytest

from selftouch_drake.run.executors import InTurn, local_executor
from selftouch_drake.threads import OncePerThread


def test_one_worker_is_this_process():
    with local_executor(1) as executor:
        assert executor.submit(os.getpid).result() == os.getpid()


def test_more_workers_are_other_processes():
    with local_executor(2) as executor:
        assert executor.submit(os.getpid).result() != os.getpid()


def test_calls_in_turn_are_made_at_once_or_when_their_results_are_asked_for():
    said = []
    calls = [InTurn().submit(said.append, number) for number in (1, 2)]
    assert said == [1, 2]
    assert wait(calls).not_done == set()
    results = InTurn().map(said.append, (3, 4))
    assert said == [1, 2]
    next(results)
    assert said == [1, 2, 3]
    with pytest.raises(ZeroDivisionError):
        InTurn().submit(divmod, 1, 0).result()


def test_each_thread_keeps_what_it_made_last():
    made = []

    @OncePerThread
    def thing(name):
        made.append(name)
        return [name]

    first = thing("a")
    assert thing("a") is first
    with ThreadPoolExecutor(1) as other:
        assert other.submit(thing, "a").result() is not first
    assert thing("a") is first
    thing("b")
    assert thing("a") is not first
    assert made == ["a", "a", "b", "a"]
    thing.keep(first, "c")
    assert thing.knows("c")
    assert thing("c") is first
