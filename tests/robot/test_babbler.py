import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from selftouch_drake.experience import RandomWalk
from selftouch_drake.robot import Babbler, MakeDynamicStation, MakeKinematicStation

PERIOD = 0.1


def _walk(agent):
    return RandomWalk(
        lower=agent.lower,
        upper=agent.upper,
        step_size=0.15,
        persistence=0.9,
        seed=np.random.SeedSequence(4),
    )


def test_a_babbler_in_a_diagram_walks_and_feels_as_the_random_walk_does(torus_world):
    world = torus_world
    builder = DiagramBuilder()
    station = builder.AddSystem(
        MakeKinematicStation(world.experiment, world.skin, world.fields).diagram
    )
    babbler = builder.AddSystem(
        Babbler(walk=_walk(world.probe.agent), num_joints=6, period_s=PERIOD)
    )
    builder.Connect(babbler.GetOutputPort("q"), station.GetInputPort("q"))
    simulator = Simulator(builder.Build())
    context = simulator.get_context()
    q, sensation = [], []
    for step in range(500):
        simulator.AdvanceTo((step + 0.5) * PERIOD)
        q.append(babbler.GetOutputPort("q").Eval(babbler.GetMyContextFromRoot(context)))
        station_context = station.GetMyContextFromRoot(context)
        sensation.append(station.GetOutputPort("sensation").Eval(station_context))
    expected = _walk(world.probe.agent).steps(500)
    np.testing.assert_array_equal(q, expected)
    felt = world.probe.sensations(expected)
    assert felt.any(axis=1).sum() >= 5
    np.testing.assert_allclose(sensation, felt, rtol=0, atol=1e-12 * felt.max())


def test_joint_controllers_are_led_from_step_to_step_without_a_jump(cube_world):
    agent = cube_world.probe.agent
    steps = _walk(agent).steps(6)
    babbler = Babbler(walk=_walk(agent), num_joints=6, period_s=PERIOD)
    simulator = Simulator(babbler)
    for time in (0.0, 0.03, 0.1, 0.17, 0.2, 0.45):
        simulator.AdvanceTo(time)
        q, v = np.split(babbler.GetOutputPort("desired_state").Eval(simulator.get_context()), 2)
        for expected, joint in zip(steps.T, q, strict=True):
            assert joint == pytest.approx(np.interp(time, PERIOD * np.arange(6), expected))
        # Right at a step the one before is still to be seen, by whoever moves at that instant.
        done = max(int(np.ceil(time / PERIOD - 1e-9)) - 1, 0)
        np.testing.assert_allclose(v, (steps[done + 1] - steps[done]) / PERIOD, atol=1e-9)


def test_an_arm_that_follows_the_walk_does_not_jerk(cube_world):
    world = cube_world
    builder = DiagramBuilder()
    made = MakeDynamicStation(world.experiment, world.skin, world.fields)
    station = builder.AddSystem(made.diagram)
    walk = RandomWalk(
        lower=made.agent.lower,
        upper=made.agent.upper,
        step_size=0.05,
        persistence=0.9,
        seed=np.random.SeedSequence(0),
    )
    babbler = builder.AddSystem(Babbler(walk=walk, num_joints=6, period_s=PERIOD))
    builder.Connect(babbler.GetOutputPort("desired_state"), station.GetInputPort("desired_state"))
    log = LogVectorOutput(
        station.GetOutputPort("state"), builder, world.experiment.execution.time_step
    )
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    context = simulator.get_mutable_context()
    plant = made.agent.plant
    start = babbler.GetOutputPort("q").Eval(babbler.GetMyContextFromRoot(context))
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), start)
    simulator.AdvanceTo(2.0)
    v = log.FindLog(context).data()[6:, 40:]
    into_the_instant = np.diff(v, axis=1)[:, ::20]
    # The walk turns there only for the plant step after, by 0.2 rad/s (standard deviation).
    assert np.abs(into_the_instant).max() < 0.02
