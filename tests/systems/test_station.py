import numpy as np
import pytest
import robots
from pydrake.systems.framework import PortDataType

from selftouch_drake.systems import MakeDynamicStation
from selftouch_drake.systems.simulation import simulation_of


@pytest.fixture(scope="module")
def dynamic(world):
    return MakeDynamicStation(world.experiment, world.skins)


def _ports(num_ports, get_port):
    ports = [get_port(i) for i in range(num_ports)]
    vector = PortDataType.kVectorValued
    return {p.get_name(): p.size() if p.get_data_type() == vector else None for p in ports}


def test_dynamic_ports(world, dynamic):
    diagram, num_joints = dynamic.diagram, world.robot.num_joints
    assert _ports(diagram.num_input_ports(), diagram.get_input_port) == {
        "desired_state": 2 * num_joints
    }
    assert _ports(diagram.num_output_ports(), diagram.get_output_port) == {
        "q": num_joints,
        "state": 2 * num_joints,
        "sensation": world.experiment.num_receptors,
        "torque": num_joints,
        "contact_results": None,
        "body_poses": None,
        "query_object": None,
    }


def test_only_touchers_and_skins_meet_in_the_kinematic_world(world):
    station = robots.drakes_postures(world)
    robot = station.robot
    inspector = station.query(np.zeros(robot.num_joints)).inspector()
    found = {
        frozenset(inspector.GetName(geometry).split("::")[-1] for geometry in pair)
        for pair in inspector.GetCollisionCandidates()
    }
    expected = {
        frozenset(inspector.GetName(g).split("::")[-1] for g in (pressing, pressed))
        for t, s in robot.touching_pairs
        for pressing in robot.touchers[t].geometry_ids
        for pressed in [robot.skins[s].geometry_id]
    }
    assert found == expected


def test_which_toucher_may_touch_which_skin(two_arms):
    names = [toucher.name for toucher in two_arms.robot.touchers]
    skins = [skin.model.name for skin in two_arms.robot.skins]
    pairs = {(names[t], skins[s]) for t, s in two_arms.robot.touching_pairs}
    # The three joints of a wrist turn at one place: a finger is next to its own forearm.
    assert pairs == {
        ("left_fingertip", "body"),
        ("left_fingertip", "right_forearm"),
        ("right_fingertip", "body"),
        ("right_fingertip", "left_forearm"),
    }


def hold(world, start, goal, duration):
    """Lets controllers pull a robot from rest at `start` to `goal`."""
    simulation = simulation_of(world)
    simulation.rest_at(start)
    time_s = np.array([0.0, 1e-3])
    # A path that begins elsewhere: the robot is drawn to it.
    simulation.follow(time_s, np.stack([goal, goal]), np.zeros((2, len(goal))))
    simulation.advance_to(duration)
    return simulation.take_log()


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_joint_limits_hold_and_efforts_saturate(open_world, side):
    world = open_world
    robot, effort = world.robot, world.limits.torque
    limit, outwards = (robot.lower, -1) if side == "lower" else (robot.upper, 1)
    inside = 0.1 * (robot.upper - robot.lower)
    log = hold(world, limit - outwards * inside, limit + outwards, duration=1.0)
    assert (log.q_steps < robot.upper + 1e-3).all()
    assert (log.q_steps > robot.lower - 1e-3).all()
    free = ~log.felt.any()
    if free:
        np.testing.assert_allclose(log.q[-1], limit, atol=1e-3)
    assert np.isfinite(effort).all()
    np.testing.assert_allclose(np.abs(log.torque).max(axis=0), effort, rtol=1e-12)


def test_gravity_is_compensated(world):
    q = robots.free(world, robots.anywhere(world.robot, 200, seed=7))[0]
    simulation_of(world).rest_at(q)
    simulation_of(world).advance(0.5)
    log = simulation_of(world).take_log()
    np.testing.assert_allclose(log.q_steps, np.broadcast_to(q, log.q_steps.shape), atol=1e-6)
    # An infant's arms weigh little.
    assert np.abs(log.torque).max() > 0.3
    assert not log.felt.any()


def test_what_is_desired_reaches_every_joint_of_every_model(world):
    num_joints = world.robot.num_joints
    q = robots.anywhere(world.robot, 300, seed=8) * 0.8
    start = robots.free(world, q)[0]
    for joint in range(num_joints):
        goal = start.copy()
        goal[joint] += 0.02
        log = hold(world, start, goal, duration=0.4)
        moved = log.q[-1] - start
        assert np.argmax(np.abs(moved)) == joint
        assert moved[joint] == pytest.approx(0.02, abs=2e-3)


ARM = (
    robots.link("base"),
    robots.link("upper", robots.shape("sphere", radius=0.1)),
    robots.link("lower", pose="0.2 0 0 0 0 0"),
    robots.link("hand", pose="0.4 0 0 0 0 0"),
    robots.joint("shoulder", "revolute", "base", "upper", "0 1 0", effort=0),
    robots.joint("elbow", "prismatic", "upper", "lower", "1 0 0", (0, 0.5), effort=0),
    robots.joint("wrist", "continuous", "lower", "hand", "0 0 1", None, effort=30),
)


def test_joints_without_actuators_get_them(tmp_path):
    world = robots.build(
        tmp_path,
        *ARM,
        skins={"upper": {"link": "base", "surface": {"shape": "sphere", "radius": 0.1}}},
        touching={"hand": {"frame": "hand", "radius": 0.01}},
    )
    plant = world.robot.plant
    assert plant.num_actuators() == plant.num_positions() == 3
    assert dict(zip(world.robot.joint_names, world.limits.torque, strict=True)) == {
        "shoulder": np.inf,
        "elbow": np.inf,
        "wrist": 30.0,
    }
    log = hold(world, np.array([0.1, 0.3, 2.0]), np.array([0.2, 0.35, 2.1]), duration=0.5)
    np.testing.assert_allclose(log.q[-1], [0.2, 0.35, 2.1], atol=2e-3)


def test_actuators_of_joints_that_are_fixed_go(tmp_path):
    world = robots.build(
        tmp_path,
        *ARM,
        robots.link("finger"),
        robots.joint("knuckle", "revolute", "hand", "finger", effort=5),
        robot={"joints": ["wrist", "shoulder"]},
        skins={"upper": {"link": "base", "surface": {"shape": "sphere", "radius": 0.1}}},
        touching={"hand": {"frame": "finger", "radius": 0.01}},
    )
    plant = world.robot.plant
    assert plant.num_actuators() == plant.num_positions() == 2
    assert world.robot.joint_names == ["shoulder", "wrist"]
