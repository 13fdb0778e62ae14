import numpy as np
import pytest
from pydrake.systems.framework import PortDataType
from pydrake.trajectories import PiecewisePolynomial

from selftouch_drake.robot import MakeKinematicStation

# N·m, of each joint in models/arm.sdf.
TORQUE_LIMITS = np.array([80.0, 80.0, 60.0, 20.0, 20.0, 20.0])


@pytest.fixture(scope="module")
def kinematic_station(world):
    return MakeKinematicStation(world.experiment, world.skin, world.fields)


def _ports(num_ports, get_port):
    ports = [get_port(i) for i in range(num_ports)]
    vector = PortDataType.kVectorValued
    return {p.get_name(): p.size() if p.get_data_type() == vector else None for p in ports}


def test_kinematic_ports(kinematic_station, world):
    diagram = kinematic_station.diagram
    assert _ports(diagram.num_input_ports(), diagram.get_input_port) == {"q": 6}
    assert _ports(diagram.num_output_ports(), diagram.get_output_port) == {
        "sensation": world.fields.num_receptors,
        "query_object": None,
    }


def test_dynamic_ports(moving_agent, world):
    diagram = moving_agent.station.diagram
    assert _ports(diagram.num_input_ports(), diagram.get_input_port) == {"desired_state": 12}
    assert _ports(diagram.num_output_ports(), diagram.get_output_port) == {
        "state": 12,
        "sensation": world.fields.num_receptors,
        "torque": 6,
        "contact_results": None,
        "query_object": None,
    }


def test_the_kinematic_station_feels_what_the_probe_feels(kinematic_station, world):
    agent = world.probe.agent
    q = np.random.default_rng(3).uniform(agent.lower, agent.upper, (2000, 6))
    expected = world.probe.sensations(q)
    touching = np.flatnonzero(expected.any(axis=1))[:20]
    assert len(touching) == 20
    diagram = kinematic_station.diagram
    context = diagram.CreateDefaultContext()
    for row in [*touching, 0]:
        diagram.GetInputPort("q").FixValue(context, q[row])
        sensation = diagram.GetOutputPort("sensation").Eval(context)
        np.testing.assert_allclose(sensation, expected[row], rtol=0, atol=1e-12 * expected.max())


def test_only_fingertips_meet_the_skin(world, kinematic_station):
    diagram = kinematic_station.diagram
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("q").FixValue(context, np.zeros(6))
    inspector = diagram.GetOutputPort("query_object").Eval(context).inspector()
    candidates = [
        {inspector.GetName(geometry).split("::")[-1] for geometry in pair}
        for pair in inspector.GetCollisionCandidates()
    ]
    fingers = [f"fingertip_{i}" for i in range(world.experiment.num_fingers)]
    assert sorted(candidates, key=sorted) == [{"skin", finger} for finger in fingers]


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_joint_limits_hold_and_torques_saturate(moving_agent, side):
    agent = moving_agent.station.agent
    limit, outwards = (agent.lower, -1) if side == "lower" else (agent.upper, 1)
    beyond = PiecewisePolynomial((limit + outwards * 1.0)[:, None])
    held = moving_agent.follow(beyond, start=limit - outwards * 0.3, duration=1.0)
    assert (held.q < agent.upper + 1e-3).all()
    assert (held.q > agent.lower - 1e-3).all()
    np.testing.assert_allclose(held.q[-1], limit, atol=1e-3)
    np.testing.assert_allclose(np.abs(held.torque).max(axis=0), TORQUE_LIMITS, rtol=1e-12)


def test_gravity_is_compensated(moving_agent):
    q = np.array([0.5, -0.5, 0.3, 0.2, 0.4, -0.3])
    still = moving_agent.follow(PiecewisePolynomial(q[:, None]), start=q, duration=0.5)
    np.testing.assert_allclose(still.q, np.broadcast_to(q, still.q.shape), atol=1e-6)
    assert np.abs(still.torque).max() > 5.0
    assert not still.sensation.any()
