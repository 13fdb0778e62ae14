import numpy as np
import pytest
from by_hand import laid_by_hand

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Felt
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.planning.novelty import Recorded
from selftouch_drake.agent.planning.planner import Planner

# Kernel 0 can be left from 0.0, near what was recorded, or from 9.0, far from it.
KNOWN = laid_by_hand([[9.0, 0.0], [1.0, 2.0], [3.0]], [[0, 1], [1, 2]])
PLANNER = Planner(KNOWN)


def plan(*targets, q_start):
    return PLANNER.plan(q_start, targets)


def surest():
    return Recorded(KNOWN).surest((0, 1, 2), plan)[0]


def test_a_path_along_recorded_postures_strays_least():
    recorded = Recorded(KNOWN)
    near, far = plan(0, 1, 2, q_start=np.array([0.0])), plan(0, 1, 2, q_start=np.array([9.0]))
    assert recorded.novelty(near) <= 1.0  # from one neighbour to the other
    assert recorded.novelty(far) == pytest.approx(2.2, abs=0.2)


def test_free_postures_tell_where_the_robot_can_be():
    free = np.arange(3.0, 9.0)[:, None]
    assert Recorded(KNOWN, free).novelty(plan(0, 1, 2, q_start=np.array([9.0]))) <= 1.0


def test_a_plan_begins_where_its_way_is_best_known():
    assert surest().waypoints_q[0] == 0.0


def test_a_long_way_strays_less_than_one_leap(monkeypatch):
    strays = {0.0: [0.5, 4.0, 0.5], 9.0: [1.0] * 20}
    by_start = lambda self, plan: np.array(strays[plan.waypoints_q[0, 0]])  # noqa: E731
    monkeypatch.setattr(Recorded, "strays", by_start)
    assert surest().waypoints_q[0] == 9.0


def test_a_plan_ends_elsewhere_than_where_its_goal_was_missed():
    known = laid_by_hand([[0.0], [1.0, 2.0]], [[0, 1]])
    planner, start = Planner(known), np.zeros(1)
    memory = RehearsalMemory.blank(known)
    once, twice = memory.missing([1]), memory.missing([1, 2])
    assert planner.plan(start, [0, 1]).waypoints_q[-1] == 1.0
    assert planner.plan(start, [0, 1], memory=once).waypoints_q[-1] == 2.0
    assert planner.plan(start, [0, 1], memory=twice).waypoints_q[-1] == 1.0
    assert planner.plan(start, [0, 1], memory=once, lift_off=True).waypoints_q[-1] == 2.0


class Travelling:
    """A body that travels, and reaches only postures beyond `wall`."""

    jumps = False

    def __init__(self, wall):
        self.wall, self.asked = wall, []

    def feel(self, q):
        self.asked.append(q[0, 0])
        return Felt(q=q, sensation=np.zeros((1, 3)), reached=q[:, 0] > self.wall)


@pytest.mark.parametrize(
    ("wall", "start", "asked"), [(-1, 0, [0]), (5, 9, [0, 9]), (99, 0, [0, 9])]
)
def test_a_body_that_travels_starts_at_the_surest_touch_that_it_reaches(wall, start, asked):
    body = Travelling(wall)
    assert Pilot(Agent.of(KNOWN), body).start_of(0, 1, 2) == start
    assert body.asked == asked
