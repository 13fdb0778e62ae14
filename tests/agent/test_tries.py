import dataclasses

import numpy as np
import pytest
from test_memory import CHAIN

from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.tries import Try, best, judged_try
from selftouch_drake.quotient.smooth import smooth_path


def tried(contact, *, reached=True):
    return Try(contact=contact, reached=reached, lost_steps=np.array([], int), execution=None)


def judged(felt, *, links=(4, 7), goal=2, in_air=None, known=CHAIN):
    """Judges sensations at evenly spaced times along steps of one radian each."""
    felt = np.array(felt, dtype=float)
    num_steps, num_times = len(links), len(felt)
    at = np.linspace(0.0, num_steps, num_times)
    plan = Plan(
        nodes=np.array([*range(3, 3 + num_steps), goal]),
        links=np.array(links, dtype=int),
        in_air=np.zeros(num_steps, bool) if in_air is None else np.array(in_air),
        modes=np.full(len(np.array([*range(3, 3 + num_steps), goal])) - 1, -1),
        imagined=np.zeros(len(np.array([*range(3, 3 + num_steps), goal])), bool),
        waypoints_q=np.zeros((num_steps + 1, 2)),
        waypoint_s=np.arange(num_steps + 1.0),
        path=smooth_path(np.zeros((1, 2))),
    )
    motion = Motion(
        plan=plan,
        time_s=at,
        s=at,
        q=np.zeros((num_times, 2)),
        v=np.zeros((num_times, 2)),
        predicted=felt,
        predicted_spread=np.zeros(num_times),
    )
    execution = Execution(
        motion=motion, felt=felt, q_measured=motion.q, v_measured=motion.v, torque=np.zeros((9, 2))
    )
    return judged_try(execution, known)


A, B, C, NOTHING = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("felt", "contact", "reached", "lost"),
    [
        ([A, A, B, B, C], 1.0, True, []),
        ([A, NOTHING, B, B, C], 0.8, True, [0]),
        ([A, A, B, NOTHING, C], 0.8, True, [1]),
        ([A, NOTHING, B, NOTHING, C], 0.6, True, [0, 1]),
        ([A, A, NOTHING, B, C], 0.8, True, [1]),
        ([A, A, B, B, B], 1.0, False, []),
        ([A, A, B, B, NOTHING], 0.8, False, [1]),
        ([NOTHING] * 5, 0.0, False, [0, 1]),
    ],
)
def test_sensations_show_the_steps_that_failed(felt, contact, reached, lost):
    one = judged(felt)
    assert (one.contact, one.reached, one.lost_steps.tolist()) == (contact, reached, lost)
    assert one.perfect == (contact == 1.0 and reached)
    assert one.execution.felt.tolist() == [list(row) for row in felt]


def test_a_plan_to_stay_has_no_step_to_blame():
    assert judged([C, C], links=()).perfect
    assert judged([NOTHING, NOTHING], links=()).lost_steps.tolist() == []


@pytest.mark.parametrize(
    ("felt", "in_air", "contact", "lost"),
    [
        ([A, NOTHING, B, C, C], [True, False], 1.0, []),
        ([NOTHING, NOTHING, B, B, C], [True, False], 1.0, []),
        ([A, NOTHING, NOTHING, NOTHING, C], [True, False], 1 / 3, [1]),
        ([A, A, NOTHING, NOTHING, C], [False, True], 1.0, []),
        ([A, NOTHING, NOTHING, NOTHING, C], [False, True], 2 / 3, [0]),
    ],
)
def test_nothing_is_lost_in_the_air(felt, in_air, contact, lost):
    one = judged(felt, in_air=in_air)
    assert one.contact == pytest.approx(contact)
    assert one.lost_steps.tolist() == lost
    assert one.reached


def test_a_goal_is_reached_though_something_else_is_touched_harder():
    both = (5, 0, 1, 0)
    assert not judged([A, A, both]).reached
    apart = dataclasses.replace(CHAIN, num_set_aside=1, overlap=np.eye(4, dtype=bool))
    assert judged([A, A, both], known=apart).reached


def test_the_best_try_reaches_its_goal_and_keeps_contact():
    early, late = tried(0.9), tried(0.9)
    assert best([tried(1.0, reached=False), early, tried(0.8), late]) is early
