"""A checked body says what is wrong with a user's body, and counts what it was asked to do."""

import os
import signal
import threading
import time
import warnings

import numpy as np
import pytest
from toys import FELT, FOLLOWED, MADE, Flat, changed, disconnects, hangs

from selftouch_drake.agent.body import Body, BodyError
from selftouch_drake.bodies.checked import CheckedBody, UnrestWarning

POSTURES = np.array([[0.5, 0.5, 0.2], [0.1, 0.9, 0.1], [0.2, 0.2, -0.3], [0.9, 0.1, 0.5]])


def test_a_good_body_passes_unchanged():
    body = CheckedBody(Flat())
    assert isinstance(body, Body)
    assert body.joint_names == ("x", "y", "press")
    assert body.upper.tolist() == [1, 1, 0.5]
    felt = body.feel(POSTURES)
    assert felt.q.tolist() == POSTURES.tolist()
    assert felt.sensation.tolist() == Flat().touch(POSTURES).tolist()
    assert felt.reached.tolist() == [True] * 4
    followed = body.follow(np.array([0.0, 0.5, 1.0]), POSTURES[:3])
    assert followed.sensation.tolist() == felt.sensation[:3].tolist()


@pytest.mark.parametrize(("kind", "line"), MADE)
def test_a_body_that_is_none_says_why(kind, line):
    with pytest.raises(BodyError) as error:
        CheckedBody(kind())
    assert str(error.value) == line


@pytest.mark.parametrize(("kind", "line"), FELT)
def test_wrong_feelings_are_refused(kind, line):
    body = CheckedBody(kind())
    with pytest.raises(BodyError) as error:
        body.feel(np.tile([0.5, 0.5, 0.2], (4, 1)))
    assert str(error.value) == line


@pytest.mark.parametrize(("kind", "line"), FOLLOWED)
def test_wrong_motions_are_refused(kind, line):
    body = CheckedBody(kind())
    with pytest.raises(BodyError) as error:
        body.follow(np.array([0.0, 0.5, 1.0]), POSTURES[:3])
    assert str(error.value) == line


def test_a_call_that_hangs_is_given_up_and_ended():
    num_threads = threading.active_count()
    body = CheckedBody(changed(feel=hangs)(), timeout_s=0.2)
    with pytest.raises(BodyError) as error:
        body.feel(POSTURES)
    assert str(error.value) == (
        "Mine.feel did not return in 0.2 s; check the connection, or raise timeout_s"
    )
    # The next call has a thread that is free.
    assert body.follow(np.zeros(1), POSTURES[:1]).q.tolist() == POSTURES[:1].tolist()
    assert threading.active_count() <= num_threads + 2


def test_a_lost_connection_names_the_error_and_its_place():
    body = CheckedBody(changed(feel=disconnects)())
    with pytest.raises(
        BodyError, match=r"Mine.feel raised ConnectionError: no answer from /dev/"
    ) as error:
        body.feel(POSTURES)
    assert "toys.py)" in str(error.value)


def test_errors_of_the_body_itself_keep_their_words():
    def feel(self, q):
        raise BodyError("the emergency stop was pressed; release it")

    with pytest.raises(BodyError) as error:
        CheckedBody(changed(feel=feel)()).feel(POSTURES)
    assert str(error.value) == "the emergency stop was pressed; release it"


def test_nothing_beyond_the_limits_is_asked_for():
    body = CheckedBody(Flat())
    felt = body.feel(np.array([[0.5, 2.0, 0.2], [0.5, 1.0 + 1e-9, 0.2]]))
    assert felt.q.tolist() == [[0.5, 1.0, 0.2]] * 2
    assert felt.reached.tolist() == [False, True]


def test_a_body_that_travels_is_asked_for_one_posture_at_a_time_and_its_time_is_counted():
    inner = Flat(jumps=False)
    inner.robot_s = 0.0

    def feel(q, plain=inner.feel):
        inner.robot_s += 2.0
        return plain(q)

    inner.feel = feel
    body = CheckedBody(inner)
    body.feel(POSTURES)
    assert inner.calls == [1] * 4
    assert body.robot_s == 8.0


def test_a_body_that_jumps_needs_no_time():
    inner = Flat()
    body = CheckedBody(inner)
    body.feel(np.tile(POSTURES, (100, 1)))
    assert inner.calls == [256, 144]
    assert body.robot_s == 0


def test_without_a_clock_of_its_own_the_time_on_the_wall_counts():
    slow = changed(jumps=False, feel=lambda self, q: time.sleep(0.05) or Flat().feel(q))
    body = CheckedBody(slow())
    body.feel(POSTURES)
    assert 0.2 <= body.robot_s < 2


def test_a_body_rests_and_is_closed_at_the_end_even_if_it_failed():
    done = []
    kind = changed(
        feel=disconnects,
        rest=lambda self: done.append("rest"),
        close=lambda self: done.append("close"),
    )
    with pytest.raises(BodyError, match="no answer"), CheckedBody(kind()) as body:
        body.feel(POSTURES)
    assert done == ["rest", "close"]


def test_on_ctrl_c_the_call_ends_before_the_body_rests():
    done = []

    def feel(self, q):
        try:
            hangs(self, q)
        finally:
            done.append("ended")

    body = CheckedBody(changed(feel=feel, rest=lambda self: done.append("rest"))())
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt), body:
        body.feel(POSTURES)
    assert done == ["ended", "rest"]


def test_a_body_that_cannot_rest_is_said():
    def rest(self):
        raise OSError("no answer")

    with pytest.warns(UnrestWarning, match=r"Mine.rest raised OSError: no answer .*look after it"):
        CheckedBody(changed(rest=rest)()).close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        CheckedBody(Flat()).close()
