import re

import numpy as np
import pytest

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.agent.planning.planner import Planner


@pytest.fixture(scope="module")
def planner(ring):
    return Planner(ring)


def test_a_tour_passes_its_targets_in_order(ring, planner):
    plan = planner.plan(ring.kernel_q[0], [0, 2, 1, 22])
    assert plan.nodes.tolist() == [0, 1, 2, 1, 0, 23, 22]
    links = planner.links[plan.links].tolist()
    assert links == [[0, 1], [1, 2], [1, 2], [0, 1], [0, 23], [22, 23]]
    assert len(plan.waypoints_q) == len(plan.waypoint_s) == 7


def test_a_tour_is_one_smooth_motion(ring, planner):
    plan = planner.plan(ring.kernel_q[0], [0, 3, 6])
    s = np.linspace(0.0, plan.waypoint_s[-1], 2000)
    bend = np.abs(np.diff(plan.path(s, 2), axis=0)).max()
    assert bend < 0.05 * np.abs(plan.path(s, 2)).max()


def test_a_target_named_twice_is_passed_once(ring, planner):
    assert planner.plan(ring.kernel_q[0], [0, 2, 2, 3]).nodes.tolist() == [0, 1, 2, 3]


def test_an_arm_in_the_air_first_goes_to_the_nearest_touch(ring, planner):
    q_start = 1.4 * ring.kernel_q[6 * 2] + [0.0, 0.0, 0.3]
    plan = planner.plan(q_start, [None, 4])
    assert plan.nodes.tolist() == [NO_KERNEL, 2, 3, 4]
    assert plan.links[0] == -1
    assert np.array_equal(plan.waypoints_q[0], q_start)
    firm = ring.kernel_q[ring.kernel_strength >= 1.0]
    distance = np.linalg.norm(firm - q_start, axis=1)
    step = np.linalg.norm(plan.waypoints_q[1] - q_start)
    assert step <= np.sort(distance)[6]


def test_an_arm_in_the_air_may_want_only_the_nearest_touch(ring, planner):
    plan = planner.plan(1.3 * ring.kernel_q[12], [None, 2])
    assert plan.nodes.tolist() == [NO_KERNEL, 2]


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        (
            [0],
            "targets is [0]: give the target sensation felt now (or None), then at least one goal",
        ),
        ([], "targets is []: give the target sensation felt now (or None), then at least one goal"),
        (
            [0, 24, 3],
            "target 24 is out of range: give one of 0 to 23, the targets of this representation",
        ),
        (
            [0, None],
            "target None is out of range: give one of 0 to 23, the targets of this representation",
        ),
    ],
)
def test_a_tour_without_way_is_refused(ring, planner, targets, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        planner.plan(ring.kernel_q[0], targets)


def test_a_start_outside_the_joint_limits_is_refused(ring):
    limits = np.full(3, -1.2), np.full(3, 1.2)
    message = "q_start[1] is 1.3: give a position within the limits of the joint, -1.2 to 1.2"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        Planner(ring).plan(np.array([0.0, 1.3, 0.0]), [None, 0], limits=limits)
