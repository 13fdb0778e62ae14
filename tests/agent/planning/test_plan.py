import dataclasses
import re

import numpy as np
import pytest

from selftouch_drake.agent.memory import RehearsalMemory, Slides
from selftouch_drake.agent.planning.planner import Planner
from selftouch_drake.agent.planning.prediction import predict_sensation
from selftouch_drake.evaluation.motion import jerk_reduction


@pytest.fixture(scope="module")
def planner(ring):
    return Planner(ring)


def test_a_plan_leads_from_where_the_arm_is_into_the_goal(ring, planner):
    q_start = ring.kernel_q[2] + 0.01
    plan = planner.plan(q_start, [0, 3])
    assert plan.nodes.tolist() == [0, 1, 2, 3]
    assert planner.links[plan.links].tolist() == [[0, 1], [1, 2], [2, 3]]
    assert np.array_equal(plan.waypoints_q[0], q_start)
    ends = plan.path(plan.waypoint_s[[0, -1]])
    assert np.allclose(ends, plan.waypoints_q[[0, -1]], rtol=0.0, atol=1e-14)
    for node, q in zip(plan.nodes[1:], plan.waypoints_q[1:], strict=True):
        members = ring.kernel_q[ring.members(node)]
        assert np.abs(members - q).max(axis=1).min() < 1e-6


def test_by_default_no_plan_leaves_the_range_of_experience(ring, planner):
    for goal in range(1, 8):
        plan = planner.plan(ring.kernel_q[0], [0, goal])
        q = plan.path(np.linspace(0.0, plan.waypoint_s[-1], 500))
        assert np.all(q >= ring.kernel_q.min(axis=0) - 1e-9)
        assert np.all(q <= ring.kernel_q.max(axis=0) + 1e-9)


def test_a_plan_to_the_current_sensation_stays_there(ring, planner):
    plan = planner.plan(ring.kernel_q[0], [0, 0])
    assert plan.nodes.tolist() == [0]
    assert plan.links.shape == (0,)
    assert plan.waypoint_s.tolist() == [0.0]
    assert np.allclose(plan.path([0.0, 1.0]), ring.kernel_q[0])
    assert jerk_reduction(plan, np.ones(3)) == 1.0
    assert np.allclose(
        predict_sensation(ring, plan, np.zeros(2)).sensation, ring.target_sensations[0]
    )


def test_the_same_question_has_the_same_answer(ring):
    a, b = (Planner(ring).plan(ring.kernel_q[0], [0, 4]) for _ in range(2))
    assert np.array_equal(a.path.c, b.path.c)
    assert np.array_equal(a.nodes, b.nodes)


def test_a_penalised_link_is_avoided(ring, planner):
    plan = planner.plan(ring.kernel_q[0], [0, 3])
    memory = RehearsalMemory.blank(ring)
    memory.link_penalty[plan.links[1]] = 1000.0
    other = planner.plan(ring.kernel_q[0], [0, 3], memory=memory)
    assert plan.links[1] not in other.links
    assert other.nodes[-1] == 3


def test_smoothing_reduces_jerk(ring, planner):
    assert jerk_reduction(planner.plan(ring.kernel_q[0], [0, 4]), np.ones(3)) > 20.0


def test_the_prediction_passes_through_the_targets_at_the_waypoints(ring, planner):
    plan = planner.plan(ring.kernel_q[0], [0, 3])
    predicted = predict_sensation(ring, plan, plan.waypoint_s).sensation
    assert np.allclose(predicted, ring.target_sensations[plan.nodes])
    between = predict_sensation(ring, plan, np.linspace(0.0, plan.waypoint_s[-1], 50)).sensation
    assert between.shape == (50, 12)
    assert np.allclose(np.linalg.norm(between, axis=1), 1.0)
    halfway = predict_sensation(ring, plan, plan.waypoint_s[1:2] / 2.0).sensation[0]
    mean = ring.target_sensations[[0, 1]].sum(axis=0)
    assert np.allclose(halfway, mean / np.linalg.norm(mean))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"targets": [0, 412]},
            "target 412 is out of range: give one of 0 to 23, the targets of this representation",
        ),
        (
            {"targets": [-1, 3]},
            "target -1 is out of range: give one of 0 to 23, the targets of this representation",
        ),
        (
            {"targets": [0, 1.5]},
            "target 1.5 is out of range: give one of 0 to 23, the targets of this representation",
        ),
        (
            {"q_start": np.zeros(2)},
            "q_start is [0.0, 0.0]: give 3 finite numbers, one per joint",
        ),
        (
            {"q_start": np.array([0.0, np.nan, 0.0])},
            "q_start is [0.0, nan, 0.0]: give 3 finite numbers, one per joint",
        ),
    ],
)
def test_errors_say_what_to_do(ring, planner, arguments, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        planner.plan(**{"q_start": ring.kernel_q[0], "targets": [0, 3]} | arguments)


def test_where_no_links_lead_the_plan_lifts_off(make_ring):
    ring = make_ring(links=[])
    # Different receptors feel the two halves of the ring.
    feel = ring.target_sensations
    half = np.repeat([1.0, 0.0], 12)[:, None]
    apart = dataclasses.replace(
        ring,
        target_sensations=np.hstack([half * feel, (1.0 - half) * feel]),
        overlap=np.ones((24, 24), dtype=bool),
    )
    plan = Planner(apart).plan(apart.kernel_q[0], [0, 15])
    assert plan.in_air.tolist() == [True] + [False] * (len(plan.nodes) - 2)
    assert plan.nodes[1] >= 12
    assert plan.goal == 15
    within = Planner(apart).plan(apart.kernel_q[0], [0, 9])
    assert not within.in_air.any()


def test_a_plan_goes_along_the_slides_it_knows(ring, planner):
    q_start = ring.kernel_q[0]
    straight = planner.plan(q_start, [0, 3])
    a, b = straight.waypoints_q[1:3]
    between = np.linspace(a, b, 5)[1:-1] + np.array([0.0, 0.0, 0.1])
    slides = Slides.none(3).and_also(a, b, between, np.array([1, 1, 2]))
    memory = dataclasses.replace(RehearsalMemory.blank(ring), slides=slides)
    slid = planner.plan(q_start, [0, 3], memory=memory)
    assert slid.nodes.tolist() == [0, 1, 1, 1, 2, 2, 3]
    assert np.array_equal(slid.waypoints_q[2:5], between)
    assert slid.links.tolist() == [*straight.links[:1], *[straight.links[1]] * 4, straight.links[2]]
    other = planner.plan(ring.kernel_q[6 * 12], [12, 15], memory=memory)
    assert other.nodes.tolist() == [12, 13, 14, 15]


def test_a_planner_refuses_what_it_cannot_do(ring):
    with pytest.raises(ValueError, match=r"^knot_spacing is 0.0 mu: give a positive number$"):
        Planner(ring, knot_spacing=0.0)
