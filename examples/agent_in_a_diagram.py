"""The paper's agent as a system with ports, in a diagram with its robot and a source of goals.

The agent knows a few thousand touches of a sphere. Goals arrive on a port; the agent feels where
it is, plans to the wanted sensation, and commands the joints.
"""

from __future__ import annotations

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Demultiplexer, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.systems import MakeDynamicStation

NUM_TOUCHES, NUM_TARGETS = 8000, 60
# s, times at which goals arrive; `main` chooses them.
TIMES, END = [0.0, 0.5, 5.0], 12.0
# rad/s and rad/s².
SPEED, ACCELERATION = 1.0, 5.0
# s between two readings of the goal.
PERIOD_S = 0.1


class NaiveAgent(LeafSystem):
    """An agent that moves to a wanted sensation.

    .. pydrake_system::

        name: NaiveAgent
        input_ports:
        - q
        - sensation
        - goal
        output_ports:
        - desired_state

    - q: `(J,)` rad or m.
    - sensation: `(S,)` N.
    - goal: `(1,)` number of a target sensation. A new one counts when the last is reached.
    - desired_state: `(2J,)` rad or m and their rates.

    The motion that it follows is state, so that two contexts follow two motions.
    """

    def __init__(self, agent: Agent):
        super().__init__()
        self._agent = agent
        num_receptors = agent.representation.target_sensations.shape[1]
        self._num_joints = num_joints = agent.representation.kernel_q.shape[1]
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._goal = self.DeclareVectorInputPort("goal", 1)
        # The goal, and a path over the context's time; at first none.
        self._motion = self.DeclareAbstractState(Value[object]())
        self.DeclareInitializationUnrestrictedUpdateEvent(self._rest)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD_S, PERIOD_S, self._decide)
        # It acts in its events only; otherwise the diagram would have an algebraic loop.
        self.DeclareVectorOutputPort(
            "desired_state",
            2 * num_joints,
            self._calc_desired_state,
            prerequisites_of_calc={
                self.time_ticket(),
                self.abstract_state_ticket(self._motion),
            },
        )

    def _rest(self, context, state):
        path = PiecewisePolynomial(self._q.Eval(context)[:, None])
        state.get_mutable_abstract_state(int(self._motion)).set_value((None, path))

    def _decide(self, context, state):
        reached, path = context.get_abstract_state(int(self._motion)).get_value()
        goal, now = int(self._goal.Eval(context)[0]), context.get_time()
        if goal == reached or (reached is not None and now < path.end_time()):
            return
        here = self._agent.felt(self._sensation.Eval(context))
        plan = self._agent.tour([here, goal], q_start=self._q.Eval(context))
        limit = np.ones(self._num_joints)
        timed = time_path(
            plan.path, velocity_limit=SPEED * limit, acceleration_limit=ACCELERATION * limit
        )
        path = PiecewisePolynomial.CubicHermite(now + timed.time_s, timed.q.T, timed.v.T)
        state.get_mutable_abstract_state(int(self._motion)).set_value((goal, path))

    def _calc_desired_state(self, context, output):
        _, path = context.get_abstract_state(int(self._motion)).get_value()
        time = min(context.get_time(), path.end_time())
        still = time == path.end_time()
        v = np.zeros(self._num_joints) if still else path.EvalDerivative(time, 1).ravel()
        output.SetFromVector(np.concatenate([path.value(time).ravel(), v]))


def learned(world: World) -> Agent:
    """An agent with a few thousand touches."""
    touches = collect_walk(DrakeBody(world), world.experiment, 0, NUM_TOUCHES)
    return Agent.learn(touches.q, touches.sensation, num_targets=NUM_TARGETS)


def main() -> tuple[list[int], list[int | None]]:
    """Moves to two sensations; returns the wanted and the felt ones."""
    world = World(load_experiment("sphere"))
    agent = learned(world)
    start, goals = 3, [3, 40, 20]
    builder = DiagramBuilder()
    station = MakeDynamicStation(world.experiment, world.skins)
    robot = builder.AddNamedSystem("robot", station.diagram)
    mind = builder.AddNamedSystem("agent", NaiveAgent(agent))
    wish = PiecewisePolynomial.ZeroOrderHold([*TIMES, END], np.array([[*goals, goals[-1]]], float))
    goal = builder.AddNamedSystem("goal", TrajectorySource(wish))
    num_joints = station.robot.num_joints
    state = builder.AddNamedSystem("state", Demultiplexer([num_joints, num_joints]))
    builder.Connect(robot.GetOutputPort("state"), state.get_input_port())
    builder.Connect(state.get_output_port(0), mind.GetInputPort("q"))
    builder.Connect(robot.GetOutputPort("sensation"), mind.GetInputPort("sensation"))
    builder.Connect(goal.get_output_port(), mind.GetInputPort("goal"))
    builder.Connect(mind.GetOutputPort("desired_state"), robot.GetInputPort("desired_state"))
    log = LogVectorOutput(robot.GetOutputPort("sensation"), builder, publish_period=0.05)

    simulator = Simulator(builder.Build())
    plant = station.robot.plant
    plant_context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(plant_context, agent.plan(start, goals[-1]).waypoints_q[0])
    simulator.AdvanceTo(END)

    felt = log.FindLog(simulator.get_context())
    time_s, sensation = felt.sample_times(), felt.data().T
    ends = [*TIMES[1:], END]
    reached = [agent.felt(sensation[np.searchsorted(time_s, end - 0.01)]) for end in ends]
    in_touch = float(sensation.any(axis=1).mean())
    for wanted, now, end in zip(goals, reached, ends, strict=True):
        print(f"at {end:.1f} s wanted {wanted}, felt {now}")
    print(f"in touch {100 * in_touch:.0f} % of the time")
    return goals, reached


if __name__ == "__main__":
    main()
