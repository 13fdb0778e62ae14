"""Walks run in this process first, and in others if there is much work."""

import os
import time

import pytest

from selftouch_drake.run import executors
from selftouch_drake.run.executors import HereAndInProcesses, InTurn, local_executor, shared


def slow_process(seconds):
    time.sleep(seconds)
    return os.getpid()


def test_what_is_little_is_done_here():
    with HereAndInProcesses(2) as executor:
        assert set(executor.map(slow_process, [0.0] * 20)) == {os.getpid()}


def test_one_worker_is_this_process():
    with HereAndInProcesses(1) as executor:
        assert set(executor.map(slow_process, [0.0] * 3)) == {os.getpid()}


def test_others_join_in_where_there_is_much_to_do(monkeypatch):
    monkeypatch.setattr(executors, "_HEAD_START_S", 0.0)
    monkeypatch.setattr(executors, "_start", os.getpid)
    with HereAndInProcesses(2) as executor:
        calls = [executor.submit(slow_process, 0.1)]
        while len({call.result() for call in calls}) < 2:
            assert len(calls) < 3000
            calls += [executor.submit(slow_process, 0.05) for _ in range(4)]
    assert os.getpid() in {call.result() for call in calls}


def test_the_end_does_not_wait_for_processes_that_start(monkeypatch):
    monkeypatch.setattr(executors, "_HEAD_START_S", 3600.0)
    with HereAndInProcesses(2) as executor:
        executor.submit(slow_process, 0.0)
        executor.submit(slow_process, 0.0)


def test_errors_come_back():
    with HereAndInProcesses(2) as executor, pytest.raises(ZeroDivisionError):
        executor.submit(divmod, 1, 0).result()


def test_calls_in_turn_wait_until_their_results_are_asked_for():
    said = []
    first, second = (InTurn().submit(said.append, number) for number in (1, 2))
    assert said == []
    second.result()
    first.result()
    first.result()
    assert said == [2, 1]
    with pytest.raises(ZeroDivisionError):
        InTurn().submit(divmod, 1, 0).result()


def value_of(needed):
    return needed.value


def made(text):
    return f"{text} made in {os.getpid()}"


def test_what_cannot_be_pickled_is_made_again_in_another_process():
    here = lambda: None  # noqa: E731 - cannot be pickled
    with shared(here, made, "world") as needed, local_executor(1) as process:
        assert needed.value is here
        elsewhere, again = (process.submit(value_of, needed).result() for _ in range(2))
    assert elsewhere == again != made("world")
    assert elsewhere.startswith("world made in")
