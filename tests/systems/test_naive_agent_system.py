"""The agent as a system: it goes to wanted sensations, and all that it is about is state."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from selftouch_drake.agent.agent import Agent
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.systems import MakeSelfTouchDiagram, NaiveAgent


@pytest.fixture(scope="module")
def agent(cube_world):
    touches = collect_walk(DrakeBody(cube_world), cube_world.experiment, 0, 4000)
    return Agent.learn(touches.q, touches.sensation, num_targets=60)


@pytest.fixture(scope="module")
def diagram(cube_world, agent):
    return MakeSelfTouchDiagram(cube_world.experiment, NaiveAgent(agent), skins=cube_world.skins)


class Acting:
    """A context of the diagram, at rest at a posture of a target sensation."""

    def __init__(self, diagram, agent, start):
        self.diagram, self.agent = diagram, agent
        self.context = diagram.CreateDefaultContext()
        plant = diagram.GetSubsystemByName("station").GetSubsystemByName("plant")
        q = agent.plan(start, start).waypoints_q[0]
        plant.SetPositions(plant.GetMyMutableContextFromRoot(self.context), q)
        self.mind = diagram.GetSubsystemByName("commander")
        self.want(np.zeros(agent.representation.target_sensations.shape[1]))
        self.simulator = Simulator(diagram, self.context)

    def want(self, sensation):
        self.diagram.GetInputPort("goal").FixValue(self.context, sensation)

    def commanded(self):
        port = self.mind.GetOutputPort("desired_state")
        return port.Eval(self.mind.GetMyContextFromRoot(self.context)).copy()

    def go_on(self, duration):
        self.simulator.AdvanceTo(self.context.get_time() + duration)

    def felt(self):
        return self.agent.target_felt(self.diagram.GetOutputPort("sensation").Eval(self.context))


def goal_of(agent, number):
    # Of any strength.
    return 3.0 * agent.representation.target_sensations[number]


def test_its_ports(diagram, agent):
    mind = diagram.GetSubsystemByName("commander")
    names = [mind.get_input_port(i).get_name() for i in range(mind.num_input_ports())]
    assert names == ["q", "sensation", "goal"]
    assert diagram.GetInputPort("goal").size() == agent.representation.target_sensations.shape[1]


def test_without_a_goal_it_holds_still_and_with_one_it_goes_there(diagram, agent):
    acting = Acting(diagram, agent, 3)
    acting.go_on(0.5)
    still = acting.commanded()
    assert not still[6:].any()
    acting.go_on(0.5)
    np.testing.assert_array_equal(acting.commanded(), still)
    acting.want(goal_of(agent, 40))
    acting.go_on(12.0)
    assert acting.felt() == 40
    # There it rests, until the goal changes.
    there = acting.commanded()
    acting.go_on(1.0)
    np.testing.assert_array_equal(acting.commanded(), there)


def test_another_goal_on_the_way_slows_it_down_before_it_goes_there(diagram, agent):
    acting = Acting(diagram, agent, 3)
    acting.want(goal_of(agent, 40))
    acting.go_on(1.0)
    assert np.abs(acting.commanded()[6:]).max() > 0.1
    acting.want(goal_of(agent, 20))
    steps = []
    for _ in range(1300):
        before = acting.commanded()
        acting.go_on(0.01)
        steps.append(np.abs(acting.commanded() - before)[:6].max())
    # 1 rad/s is the limit: it jumps nowhere.
    assert max(steps) < 0.011
    assert min(steps[:80]) < 1e-3
    assert acting.felt() == 20


def test_two_contexts_do_not_disturb_each_other_and_do_the_same_again(diagram, agent):
    def way(goal, other=None):
        acting, found = Acting(diagram, agent, 3), []
        acting.want(goal_of(agent, goal))
        for _ in range(8):
            acting.go_on(0.25)
            found.append(acting.commanded())
            if other is not None:
                other.go_on(0.25)
        return np.array(found)

    first = way(40)
    other = Acting(diagram, agent, 7)
    other.want(goal_of(agent, 20))
    np.testing.assert_array_equal(way(40, other), first)
    assert np.abs(way(20) - first).max() > 0.01
