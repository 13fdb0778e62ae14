"""The paper's agent as a system with ports, in a diagram with its robot and a source of goals.

The agent knows a few thousand touches of a sphere. Goals, wanted sensations, arrive on a port; the
agent feels where it is, plans to the wanted sensation, and commands the joints.
"""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.agent.agent import Agent
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.systems import MakeSelfTouchDiagram, NaiveAgent

NUM_TOUCHES, NUM_TARGETS = 8000, 60
# s, times at which goals arrive; `main` chooses them.
TIMES, END = [0.0, 0.5, 5.0], 12.0


def learned(world: World) -> Agent:
    """An agent with a few thousand touches."""
    touches = collect_walk(DrakeBody(world), world.experiment, 0, NUM_TOUCHES)
    return Agent.learn(touches.q, touches.sensation, num_targets=NUM_TARGETS)


def main() -> tuple[list[int], list[int | None]]:
    """Moves to two sensations; returns the wanted and the felt ones."""
    world = World(load_experiment("sphere"))
    agent = learned(world)
    start, goals = 3, [3, 40, 20]
    sensations = agent.representation.target_sensations[[*goals, goals[-1]]]
    wish = PiecewisePolynomial.ZeroOrderHold([*TIMES, END], sensations.T)

    builder = DiagramBuilder()
    robot = MakeSelfTouchDiagram(world.experiment, NaiveAgent(agent), skins=world.skins)
    builder.AddSystem(robot)
    goal = builder.AddNamedSystem("goal", TrajectorySource(wish))
    builder.Connect(goal.get_output_port(), robot.GetInputPort("goal"))
    log = LogVectorOutput(robot.GetOutputPort("sensation"), builder, publish_period=0.05)

    simulator = Simulator(builder.Build())
    plant = robot.GetSubsystemByName("station").GetSubsystemByName("plant")
    plant_context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(plant_context, agent.plan(start, goals[-1]).waypoints_q[0])
    simulator.AdvanceTo(END)

    felt = log.FindLog(simulator.get_context())
    time_s, sensation = felt.sample_times(), felt.data().T
    ends = [*TIMES[1:], END]
    reached = [agent.target_felt(sensation[np.searchsorted(time_s, end - 0.01)]) for end in ends]
    in_touch = float(sensation.any(axis=1).mean())
    for wanted, now, end in zip(goals, reached, ends, strict=True):
        print(f"at {end:.1f} s wanted {wanted}, felt {now}")
    print(f"in touch {100 * in_touch:.0f} % of the time")
    return goals, reached


if __name__ == "__main__":
    main()
