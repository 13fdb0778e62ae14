"""A finger in the plane, a wall that it must not pass, and a joint that moves nothing."""

import dataclasses
from itertools import pairwise

import numpy as np
from by_hand import laid_by_hand
from test_sliding import LIMIT, Finger, deep, feel, touches

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.practice.dry_run import dry_run, missed_touches
from selftouch_drake.agent.practice.other_ways import other_ways
from selftouch_drake.agent.practice.sliding import Slider
from selftouch_drake.quotient.smooth import path_length, smooth_path

NUM = 40


def representation():
    """Kernels of one touch each, all with the same sensation."""
    x = touches(NUM)
    felt = feel(x)
    return laid_by_hand(
        x[:, None],
        [[0, 1]],
        target_sensations=felt / np.linalg.norm(felt, axis=1, keepdims=True),
        kernel_strength=np.linalg.norm(felt, axis=1),
        mode_joints=np.array([[True, True, True, False]]),
    )


REPRESENTATION = representation()
BLANK = RehearsalMemory.blank(REPRESENTATION)


def possible(x):
    """Whether the hand is not too deep in the ball, and the fourth joint not in the way."""
    return (deep(x) < 0.07) & (np.abs(x[:, 3] - 2.0) > 0.2)


SLIDER = Slider(Finger(np.ones(4), possible=possible), np.ones(4))


def a_plan(waypoints, *, links=None, in_air=None):
    waypoints = np.asarray(waypoints)
    num = len(waypoints) - 1
    path = smooth_path(waypoints, limits=(-LIMIT, LIMIT))
    return Plan(
        nodes=np.arange(num + 1),
        links=np.zeros(num, dtype=int) if links is None else np.array(links),
        in_air=np.zeros(num, dtype=bool) if in_air is None else np.array(in_air),
        modes=np.full(len(np.arange(num + 1)) - 1, -1),
        imagined=np.zeros(len(np.arange(num + 1)), bool),
        waypoints_q=waypoints,
        waypoint_s=path_length(waypoints),
        path=path,
    )


def ways_for(plan):
    """The memory with other ways for step 0 of a plan, and its link if none was found."""
    return other_ways(plan, np.array([0]), SLIDER, BLANK, REPRESENTATION)


def a_pair():
    """Two touches: the straight way between them leads too deep, but sliding works."""
    x = touches(NUM)
    x[:, 3] = 0.0
    for a in x:
        for b in x:
            plan = a_plan([a, b])
            if len(dry_run(plan, SLIDER).impossible):
                _, without = ways_for(plan)
                if not len(without):
                    return a, b
    raise AssertionError("there is such a pair")


def test_a_step_that_fails_is_slid_along_and_what_is_felt_is_named():
    a, b = a_pair()
    memory, without = ways_for(a_plan([a, b]))
    passed, node = memory.slides.between(a, b)
    assert without.tolist() == []
    assert possible(passed).all()
    assert feel(passed).any(axis=1).all()
    assert ((node >= 0) & (node < NUM)).all()
    assert memory.num_tries == BLANK.num_tries


def test_where_touch_is_lost_or_the_robot_cannot_be_is_found_slowly():
    a, b = a_pair()
    away = np.array([np.pi, 0.0, 0.0, 0.0])
    lost = dry_run(a_plan([a, away, b]), SLIDER).lost
    assert lost.tolist() == [0, 1]
    in_air = a_plan([a, away, b], links=[-1, -1], in_air=[True, True])
    assert dry_run(in_air, SLIDER).lost.tolist() == []
    assert dry_run(a_plan([a, b]), SLIDER).impossible.tolist() == [0]


def test_what_holds_still_is_not_slid_along():
    a, b = a_pair()
    plan = a_plan([a, b], links=[-1])
    memory, without = ways_for(plan)
    assert without.tolist() == []  # no link is to blame
    assert memory.same_as(BLANK)


def test_through_the_air_a_detour_leads_over_what_is_remembered():
    a, b = a_pair()
    a, b = a - [0, 0, 0, 1.9], b - [0, 0, 0, 1.9]
    plan = a_plan([a, b], links=[-1], in_air=[True])
    memory, without = ways_for(plan)
    assert without.tolist() == []
    passed, node = memory.slides.between(a, b)
    way = np.concatenate([a[None], passed, b[None]])
    dense = np.concatenate([np.linspace(*ends, 50) for ends in pairwise(way)])
    assert possible(dense).all()
    assert node.tolist() == [1] * len(passed)


def test_a_plan_may_leave_a_start_that_practice_does_not_allow():
    a, _ = a_pair()
    for start, impossible in ((1.85, []), (2.15, [0])):  # the fourth joint, forbidden to 1.8
        plan = a_plan([[*a[:3], start], [*a[:3], 1.0]])
        assert dry_run(plan, SLIDER).impossible.tolist() == impossible


def test_a_plan_to_stay_has_no_step_to_doubt():
    plan = dataclasses.replace(
        a_plan([[np.pi, 0.0, 0.0, 0.0], [np.pi, 0.0, 0.1, 0.0]]),
        nodes=np.zeros(1, dtype=int),
        links=np.empty(0, dtype=int),
        in_air=np.empty(0, dtype=bool),
        modes=np.full(len(np.zeros(1, dtype=int)) - 1, -1),
        imagined=np.zeros(len(np.zeros(1, dtype=int)), bool),
        waypoints_q=np.array([[np.pi, 0.0, 0.0, 0.0]]),
        waypoint_s=np.zeros(1),
    )
    felt = dry_run(plan, SLIDER)
    assert felt.doubtful.tolist() == []


def test_a_landing_and_a_goal_at_which_nothing_is_felt_are_found():
    x, away = touches(NUM), np.array([np.pi, 0.0, 0.0, 0.0])
    kernel_q = x.copy()
    kernel_q[[1, 2]] = away
    known = dataclasses.replace(REPRESENTATION, kernel_q=kernel_q)

    def missed(waypoints, in_air):
        plan = a_plan(waypoints, links=np.full(len(in_air), -1), in_air=in_air)
        return missed_touches(plan, dry_run(plan, SLIDER), known)

    assert missed([x[0], away], [True]) == [1, 1]
    assert missed([x[0], away, away + 1e-3], [True, False]) == [1]
    assert missed([x[0], away, away], [False, False]) == [2]
