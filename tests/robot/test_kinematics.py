import numpy as np


def test_fingertips_are_where_drake_puts_them(world):
    agent = world.probe.agent
    q = np.random.default_rng(0).uniform(agent.lower, agent.upper, (200, 6))
    context = agent.plant.CreateDefaultContext()
    expected = np.empty((len(q), len(agent.fingertips), 3))
    for row, q_row in enumerate(q):
        agent.plant.SetPositions(context, q_row)
        for finger, tip in enumerate(agent.fingertips):
            expected[row, finger] = tip.CalcPoseInWorld(context).translation()
    positions = world.probe.kinematics.positions(q)
    np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-12)
    assert len(agent.fingertips) == world.experiment.num_fingers


def test_no_configurations_have_no_fingertips(world):
    positions = world.probe.kinematics.positions(np.empty((0, 6)))
    assert positions.shape == (0, world.experiment.num_fingers, 3)
