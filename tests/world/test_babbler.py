import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake.babbling import RandomWalk
from selftouch_drake.world import Babbler, MakeKinematicStation

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
