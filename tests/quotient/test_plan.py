import dataclasses

import numpy as np
import pytest
from by_hand import laid_by_hand, ring_by_hand

from selftouch_drake.quotient import PlanningGraph, Representation, plan


@pytest.fixture(scope="module")
def ring():
    return ring_by_hand(kind=Representation)


def test_a_plan_goes_from_kernel_to_kernel_along_the_body(ring):
    found = plan(ring, 2, 12)
    assert (found.nodes[0], found.goal) == (2, 12)
    for node, q in zip(found.nodes, found.waypoints_q, strict=True):
        stored = ring.kernel_q[ring.members(node)]
        assert np.abs(stored - q).max(axis=1).min() < 1e-6
    # The kernels are a ring of radius 1; a chord would pass its middle.
    q = found.path(np.linspace(0, found.waypoint_s[-1], 200))
    assert np.hypot(q[:, 0], q[:, 1]).min() > 0.85


def test_a_plan_starts_where_the_joints_are(ring):
    q_start = ring.kernel_q[ring.members(2)][3] + 1e-3
    found = plan(ring, 2, 5, q_start=q_start)
    assert found.waypoints_q[0].tobytes() == q_start.tobytes()
    assert found.path(0.0).tobytes() == q_start.tobytes()
    default = plan(ring, 2, 5)
    best = ring.members(2).start + ring.kernel_error[ring.members(2)].argmin()
    np.testing.assert_array_equal(default.waypoints_q[0], ring.kernel_q[best])


def test_one_set_of_ways_serves_many_plans(ring):
    planning_graph = PlanningGraph.of(ring)
    assert (
        plan(ring, 2, 12, planning_graph=planning_graph).path.c.tobytes()
        == plan(ring, 2, 12).path.c.tobytes()
    )


def test_a_plan_to_the_start_is_to_stay(ring):
    found = plan(ring, 4, 4)
    assert found.nodes.tolist() == [4]
    assert np.ptp(found.path(np.linspace(0, 1, 9)), axis=0).max() < 1e-12


def test_a_plan_keeps_to_the_range_of_experience(ring):
    for goal in (6, 12, 18):
        control = plan(ring, 0, goal).path.c
        assert (control >= ring.kernel_q.min(axis=0)).all()
        assert (control <= ring.kernel_q.max(axis=0)).all()


def test_units_of_joints_do_not_change_a_plan(ring):
    factor = np.array([1.0, 1000.0, 0.1])
    other = dataclasses.replace(
        ring, kernel_q=ring.kernel_q * factor, joint_scale=ring.joint_scale / factor
    )
    here, there = plan(ring, 2, 12), plan(other, 2, 12)
    assert here.nodes.tolist() == there.nodes.tolist()
    np.testing.assert_allclose(here.waypoints_q * factor, there.waypoints_q, rtol=1e-9)


@pytest.mark.parametrize("target", [-1, 24, 1.5])
def test_a_target_that_is_not_there_is_refused(ring, target):
    with pytest.raises(ValueError, match="give one of 0 to 23, the targets of this represent"):
        plan(ring, 0, target)


def test_where_no_links_lead_no_plan_goes():
    apart = laid_by_hand([[0.0], [1.0], [2.0]], [[0, 1]], kind=Representation)
    with pytest.raises(ValueError, match="no links lead from target 0 to 2: babble longer"):
        plan(apart, 0, 2)
