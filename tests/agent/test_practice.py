"""A finger in the plane, a wall that it must not pass, and a joint that moves nothing."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from test_sliding import LIMIT, deep, feel, touches

from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.planning.smoothing import path_length, smooth_path
from selftouch_drake.agent.practice import go_along, out_of_the_way, practise
from selftouch_drake.agent.rehearsal import RehearsalMemory
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.sliding import Slider

NUM = 40


def representation():
    """Kernels of one touch each, all with the same sensation."""
    x = touches(NUM)
    felt = feel(x)
    return QuotientRepresentation(
        target_sensations=felt / np.linalg.norm(felt, axis=1, keepdims=True),
        kernel_offsets=np.arange(NUM + 1),
        kernel_q=x,
        kernel_row=np.arange(NUM),
        kernel_strength=np.linalg.norm(felt, axis=1),
        kernel_error=np.zeros(NUM),
        kernel_mode=np.zeros(NUM, dtype=int),
        mode_joints=np.array([[True, True, True, False]]),
        joint_scale=np.ones(4),
        overlap=np.ones((2, 2), dtype=bool),
        part=np.zeros(NUM, dtype=int),
        num_touches=NUM,
        set_distance=np.zeros((NUM, NUM)),
        edges=np.array([[0, 1]]),
        edge_cost=np.ones(1),
        embedding=np.zeros((NUM, 3)),
    )


REPRESENTATION = representation()
BLANK = RehearsalMemory.blank(REPRESENTATION)


def possible(x):
    """Whether the hand is not too deep in the ball, and the fourth joint not in the way."""
    return (deep(x) < 0.07) & (np.abs(x[:, 3] - 2.0) > 0.2)


SLIDER = Slider(feel, possible, -LIMIT, LIMIT)


def a_plan(waypoints, *, links=None, in_air=None):
    waypoints = np.asarray(waypoints)
    num = len(waypoints) - 1
    path = smooth_path(waypoints, lower=-LIMIT, upper=LIMIT)
    return Plan(
        nodes=np.arange(num + 1),
        links=np.zeros(num, dtype=int) if links is None else np.array(links),
        in_air=np.zeros(num, dtype=bool) if in_air is None else np.array(in_air),
        waypoints_q=waypoints,
        waypoint_s=path_length(waypoints),
        path=path,
    )


def a_pair():
    """Two touches: the straight way between them leads too deep, but sliding works."""
    x = touches(NUM)
    x[:, 3] = 0.0
    for a in x:
        for b in x:
            plan = a_plan([a, b])
            if len(go_along(plan, REPRESENTATION, SLIDER).impossible):
                _, found = practise(plan, np.array([0]), SLIDER, BLANK, REPRESENTATION)
                if found.all():
                    return a, b
    raise AssertionError("there is such a pair")


def test_a_step_that_fails_is_slid_along_and_what_is_felt_is_named():
    a, b = a_pair()
    memory, found = practise(a_plan([a, b]), np.array([0]), SLIDER, BLANK, REPRESENTATION)
    passed, node = memory.slides.between(a, b)
    assert found.tolist() == [True]
    assert possible(passed).all()
    assert feel(passed).any(axis=1).all()
    assert ((node >= 0) & (node < NUM)).all()
    assert memory.num_tries == BLANK.num_tries


def test_where_touch_is_lost_or_the_robot_cannot_be_is_found_slowly():
    a, b = a_pair()
    away = np.array([np.pi, 0.0, 0.0, 0.0])
    lost = go_along(a_plan([a, away, b]), REPRESENTATION, SLIDER).lost
    assert lost.tolist() == [0, 1]
    in_air = a_plan([a, away, b], links=[-1, -1], in_air=[True, True])
    assert go_along(in_air, REPRESENTATION, SLIDER).lost.tolist() == []
    assert go_along(a_plan([a, b]), REPRESENTATION, SLIDER).impossible.tolist() == [0]


def test_what_holds_still_is_not_slid_along():
    a, b = a_pair()
    plan = a_plan([a, b], links=[-1])
    memory, found = practise(plan, np.array([0]), SLIDER, BLANK, REPRESENTATION)
    assert not found.any()
    assert memory.same_as(BLANK)


def test_through_the_air_a_detour_leads_over_what_is_remembered():
    a, b = a_pair()
    a, b = a - [0, 0, 0, 1.9], b - [0, 0, 0, 1.9]
    plan = a_plan([a, b], links=[-1], in_air=[True])
    memory, found = practise(plan, np.array([0]), SLIDER, BLANK, REPRESENTATION)
    if found.all():
        passed, node = memory.slides.between(a, b)
        way = np.concatenate([a[None], passed, b[None]])
        dense = np.concatenate([np.linspace(*ends, 50) for ends in pairwise(way)])
        assert possible(dense).all()
        assert node.tolist() == [1] * len(passed)


def test_a_joint_that_stands_in_the_way_moves_aside():
    a, b = touches(2)
    a, b = a.copy(), b.copy()
    a[3] = b[3] = 1.95
    aside = out_of_the_way(a_plan([a, b]), REPRESENTATION, SLIDER)
    if aside is not None:
        assert abs(aside[3] - 2.0) > 0.2
    in_air = a_plan([a, b], links=[-1], in_air=[True])
    assert out_of_the_way(in_air, REPRESENTATION, SLIDER) is None


def test_a_slide_outside_the_limits_is_no_slide():
    slides = BLANK.slides.and_also(np.zeros(4), np.ones(4), np.full((2, 4), 0.5), np.array([1, 2]))
    slides = slides.and_also(np.ones(4), np.zeros(4), np.full((1, 4), 2.0), np.array([3]))
    kept = slides.within(np.full(4, -1.0), np.full(4, 1.0))
    assert len(kept.ends) == 1
    assert kept.between(np.zeros(4), np.ones(4))[1].tolist() == [1, 2]


def test_a_slide_that_mends_a_part_of_another_is_taken():
    a, m, b = np.zeros(4), np.full(4, 0.5), np.ones(4)
    slides = BLANK.slides.and_also(a, b, m[None], np.array([1]))
    slides = slides.and_also(m, b, np.full((1, 4), 0.8), np.array([2]))
    passed, node = slides.all_between(a, b)
    assert passed[:, 0].tolist() == [0.5, 0.8]
    assert node.tolist() == [1, 2]


def test_a_memory_of_another_scale_is_foreign():
    other = dataclasses.replace(REPRESENTATION, joint_scale=np.full(4, 2.0))
    with pytest.raises(ValueError, match="another representation"):
        RehearsalMemory.from_arrays(BLANK.to_arrays(), other)


def test_a_plan_to_stay_has_no_step_to_doubt():
    plan = dataclasses.replace(
        a_plan([[np.pi, 0.0, 0.0, 0.0], [np.pi, 0.0, 0.1, 0.0]]),
        nodes=np.zeros(1, dtype=int),
        links=np.empty(0, dtype=int),
        in_air=np.empty(0, dtype=bool),
        waypoints_q=np.array([[np.pi, 0.0, 0.0, 0.0]]),
        waypoint_s=np.zeros(1),
    )
    passage = go_along(plan, REPRESENTATION, SLIDER)
    lost, impossible = passage.lost, passage.impossible
    assert (lost.tolist(), impossible.tolist()) == ([], [])
