"""One simulation: plans, live play and dynamic babbling."""

import dataclasses

import numpy as np
import pytest
import robots

from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.bodies.drake import DrakeBodies, DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import JointSettings
from selftouch_drake.quotient.smooth import smooth_path
from selftouch_drake.robot import World
from selftouch_drake.robot.imperfections import slip
from selftouch_drake.systems.simulation import LOG_PERIOD, Babbling, Simulation, simulation_of


@pytest.fixture(scope="module", params=["in the air", "through the skin"])
def motion(request, world):
    """A motion that never touches, and one that touches for a while."""
    robot, limits = world.robot, world.limits
    rng = np.random.default_rng(4)
    wander = np.where(robot.turns, 0.15, 0.03)
    touching_q, _ = robots.touches(world)
    middle = 0.7 * robots.anywhere(robot, 2000, seed=4)
    if request.param == "through the skin":
        middle = touching_q
    for q in middle:
        waypoints_q = q + wander * rng.normal(size=(5, robot.num_joints))
        limits_q = robot.lower, robot.upper
        path = smooth_path(waypoints_q.clip(*limits_q), limits=limits_q)
        timed = time_path(
            path, velocity_limit=limits.velocity, acceleration_limit=limits.acceleration
        )
        touching = world.probe.sensations(timed.q).any(axis=1)
        wanted = 0.0 if request.param == "in the air" else 0.2
        if not wanted <= touching.mean() <= 3.0 * wanted or touching[0]:
            continue
        # Rigid parts that run into each other would be pushed apart.
        if not world.probe.impossible(timed.q).any():
            return timed
    raise AssertionError("there is no such motion")


def followed(simulation, time_s, q, v):
    """The log of a motion, from rest at its start to the end of the period in which it ends."""
    simulation.follow(time_s, q, v, jump=True)
    simulation.advance_to(LOG_PERIOD * (len(time_s) - 1))
    return simulation.take_log()


@pytest.fixture(scope="module")
def done(world, motion):
    return followed(simulation_of(world), motion.time_s, motion.q, motion.v)


def test_the_robot_follows_within_five_milliradians(done, motion):
    assert np.sqrt(np.mean(np.square(done.q - motion.q))) < 0.005


def test_the_log_is_as_long_as_the_motion(world, done, motion):
    num_times = len(motion.time_s)
    np.testing.assert_allclose(done.time_s, LOG_PERIOD * np.arange(num_times), atol=1e-12)
    assert done.q.shape == done.v.shape == (num_times, world.robot.num_joints)
    assert done.felt.shape == (num_times, world.experiment.num_receptors)


def test_torque_and_posture_of_every_step_of_the_plant_are_logged(world, done, motion):
    steps_a_period = round(LOG_PERIOD / world.experiment.execution.time_step)
    num_steps = 1 + steps_a_period * (len(motion.time_s) - 1)
    assert done.torque.shape == done.q_steps.shape == (num_steps, world.robot.num_joints)
    np.testing.assert_array_equal(done.q_steps[::steps_a_period], done.q)


def test_what_is_felt_is_what_is_felt_there_without_time(world, done, motion):
    still = world.probe.sensations(done.q)
    np.testing.assert_allclose(done.felt, still, rtol=0, atol=1e-12)
    assert done.felt.any() == world.probe.sensations(motion.q).any()


def test_a_motion_is_executed_the_same_again(world, done, motion):
    again = followed(simulation_of(world), motion.time_s, motion.q, motion.v)
    np.testing.assert_array_equal(again.q, done.q)
    np.testing.assert_array_equal(again.felt, done.felt)


@pytest.mark.parametrize("name", ["cube", "gantry"])
def test_no_limit_is_exceeded_at_a_thousand_hertz(name):
    world = robots.shipped(name)
    robot, limits = world.robot, world.limits
    q = robots.anywhere(robot, 20, seed=4)
    waypoints = 0.8 * q[~world.probe.sensations(q).any(axis=1)][:4]
    path = smooth_path(waypoints, limits=(robot.lower, robot.upper))
    motion = time_path(path, velocity_limit=limits.velocity, acceleration_limit=limits.acceleration)
    finely = load_experiment(name, {"execution": {"time_step": 0.001}})
    simulation = Simulation(finely, world.skins, log_period=0.001)
    done = followed(simulation, motion.time_s, motion.q, motion.v)
    assert len(done.time_s) > 900 * motion.time_s[-1]
    assert np.all((done.q >= robot.lower) & (done.q <= robot.upper))
    assert np.all(np.abs(done.v) <= limits.velocity)
    acceleration = np.diff(done.v, axis=0) / 0.001
    # Contact is not the robot's doing: it may add to what was commanded for an instant.
    touching = done.felt.any(axis=1)
    alone = ~(touching[1:] | touching[:-1])
    assert alone.mean() > 0.5
    assert np.all(np.abs(acceleration[alone]) <= limits.acceleration)
    assert np.all(np.abs(done.torque) <= limits.torque)


def quintic(num_samples=101):
    """From 0 to 1 in a second, from rest to rest."""
    time_s = np.linspace(0.0, 1.0, num_samples)
    return time_s, (10 * time_s**3 - 15 * time_s**4 + 6 * time_s**5)[:, None]


def free_start(world):
    """A posture in the middle of all ranges where nothing touches."""
    q = 0.3 * robots.anywhere(world.robot, 200, seed=2)
    return robots.free(world, q)[0]


def test_each_motion_goes_on_from_where_the_robot_is(open_world):
    world = open_world
    simulation, robot = simulation_of(world), world.robot
    simulation.rest_at(free_start(world))
    time_s, blend = quintic()
    for joints in ([0, 3], [2, robot.num_joints - 1]):
        step = np.zeros(robot.num_joints)
        step[joints] = np.where(robot.turns[joints], 0.2, 0.05)
        q_before = simulation.q.copy()
        q = simulation.q_commanded + blend * step
        simulation.follow(time_s, q, np.gradient(q, time_s, axis=0))
        np.testing.assert_allclose(simulation.q, q_before)
        np.testing.assert_allclose(simulation.q_commanded, q[0])
        assert simulation.time_s == 0.0
        furthest = 0.0
        while simulation.time_s < 1.1:
            simulation.advance(0.05)
            furthest = max(furthest, np.abs(simulation.q - simulation.q_commanded).max())
        assert furthest < 0.05
        np.testing.assert_allclose(simulation.q_commanded, q[-1])
        np.testing.assert_allclose(simulation.q, q[-1], atol=5e-3)
    assert simulation.felt.shape == (world.experiment.num_receptors,)


def test_the_log_starts_over_when_it_is_taken(cube_world):
    simulation = simulation_of(cube_world)
    simulation.rest_at(free_start(cube_world))
    simulation.advance_to(0.1)
    first = simulation.take_log()
    simulation.advance_to(0.2)
    second = simulation.take_log()
    np.testing.assert_allclose(first.time_s, 0.01 * np.arange(11), atol=1e-12)
    np.testing.assert_allclose(second.time_s, 0.01 * np.arange(11, 21), atol=1e-12)


@pytest.mark.parametrize("name", ["cube", "two_arms"])
def test_a_robot_whose_joints_slipped_goes_astray_by_as_much(name):
    world = robots.shipped(name)
    experiment = dataclasses.replace(world.experiment, joints=JointSettings(offset=0.02))
    simulation = Simulation(experiment, world.skins)
    offset = slip(experiment, world.robot.num_joints)
    assert np.abs(offset).min() > 0
    q = np.tile(free_start(world), (11, 1))
    done = followed(simulation, LOG_PERIOD * np.arange(11), q, np.zeros_like(q))
    np.testing.assert_allclose(q - done.q, np.tile(offset, (11, 1)), atol=1e-4)
    simulation.rest_at(q[0])
    np.testing.assert_allclose(simulation.q, q[0] - offset)
    # What it is commanded is said as its joints read.
    np.testing.assert_allclose(simulation.q_commanded, q[0])


@pytest.mark.parametrize("name", ["cube", "turning_body", "gantry", "two_arms"])
def test_a_robot_is_led_along_a_walk(name):
    world = robots.shipped(name)
    experiment = dataclasses.replace(
        world.experiment, babbling=dataclasses.replace(world.experiment.babbling, step_size=0.05)
    )
    steps = random_walk(experiment, DrakeBody(world), 0).steps(21)
    times = experiment.babbling.step_duration * np.arange(21)
    simulation = Simulation(experiment, world.skins, log_period=0.02)
    simulation.rest_at(steps[0])
    simulation.take_log()
    simulation.lead_through(steps[1:], times[1:])
    log = simulation.take_log()
    # The first sample is that of the first step of time: where a walk begins was not walked to.
    np.testing.assert_allclose(log.time_s, 0.02 * np.arange(1, 101), atol=1e-9)
    followed = np.stack([np.interp(log.time_s, times, joint) for joint in steps.T], axis=1)
    free = ~log.felt.any(axis=1)
    # It lags behind by some of a step, and less than two.
    assert np.abs(log.q - followed)[free].max() < 3 * 0.05
    assert np.sqrt(np.mean(np.square(log.q - followed)[free])) < 0.05


def test_joints_are_led_on_from_where_they_are_commanded_to_be(world):
    simulation, J = simulation_of(world), world.robot.num_joints
    lower, upper = world.robot.babbled_range
    middle = (lower + upper) / 2
    simulation.rest_at(middle)
    simulation.take_log()
    for k in range(1, 4):
        simulation.lead_through(middle + 0.01 * k, 0.05 * k)
        np.testing.assert_allclose(simulation.q_commanded, middle + 0.01 * k, atol=1e-12)
    assert simulation.time_s == 0.05 * 3
    assert simulation.v.shape == (J,)
    np.testing.assert_allclose(simulation.q_read, simulation.q, atol=0)
    # The log went on, and the joints did: 0.2 rad/s without a stop.
    log = simulation.take_log()
    assert len(log.time_s) >= 15
    assert np.all(log.v[4:] > 0.1)


def test_a_robot_is_taken_over_as_it_is(cube_world):
    simulation, q = Simulation(cube_world.experiment, cube_world.skins), free_start(cube_world)
    commanded, v = q + 0.01, np.linspace(-0.2, 0.2, len(q))
    simulation.rest_at(0.5 * q)
    simulation.advance_to(0.1)
    simulation.take_over(commanded, q, v)
    assert simulation.time_s == 0.0
    np.testing.assert_array_equal(simulation.q, q)
    np.testing.assert_array_equal(simulation.v, v)
    np.testing.assert_array_equal(simulation.q_commanded, commanded)
    simulation.advance_to(1.0)
    np.testing.assert_allclose(simulation.q, commanded, atol=5e-3)
    np.testing.assert_allclose(simulation.take_log().q[0], q)


def test_a_robot_that_travels_approaches_a_walk_unlogged(cube_world):
    babbling, q = Babbling(cube_world.experiment, cube_world.skins), free_start(cube_world)
    first, second = babbling.babbler.first_node(0), babbling.babbler.first_node(1)
    assert np.abs(first - second).max() > 0.1
    babbling.go_on_to(1, q, np.zeros(len(q)), q_from=q, approach_s=1.5)
    assert babbling.time_s == 1.5
    np.testing.assert_allclose(babbling.q_commanded, second, atol=1e-12)
    babbling.advance_to(1.6)
    log = babbling.take_log()
    assert len(log.time_s)
    assert log.time_s[0] > 1.5, "what it feels on the way is not logged"


@pytest.fixture(scope="module")
def traveller():
    """The world of a cube that babbles under dynamics and cannot jump."""
    babbling = {"mode": "dynamic", "jumps": False}
    return World(load_experiment("cube", {"babbling": babbling}))


def from_walk_to_motion_to_walk(world):
    """A body that babbles, follows a motion and babbles again; where it was at each handover."""
    body, ends, begins = DrakeBodies(world).babbling, [], []
    go_on = body.babble(0)
    go_on()
    ends.append(body._running.q.copy())
    q = np.linspace(body._at, body._at + 0.05, 11)
    followed = body.follow(0.1 * np.arange(11), q)
    begins.append(followed.q[0])
    ends.append(body._running.q.copy())
    travelled = body.robot_s
    go_on = body.babble(1)
    approach_s = body.robot_s - travelled
    felt = go_on()
    begins.append(felt.q[0])
    return body, ends, begins, approach_s


def test_a_robot_that_travels_never_jumps_between_its_diagrams(traveller):
    body, ends, begins, approach_s = from_walk_to_motion_to_walk(traveller)
    # A sample later, no joint is further than it may have gone.
    assert (np.abs(begins[0] - ends[0]) <= 0.03 * body.velocity).all()
    first = body._babbling.babbler.first_node(1)
    needs = (np.abs(first - ends[1]) / body.velocity).max()
    assert approach_s >= 1.9 * needs, "it travels at half of its speed"
    assert np.abs(begins[1] - first).max() < 0.1
    assert body.robot_s == pytest.approx(10.0 + 1.0 + approach_s + 10.0)


def test_handovers_are_the_same_again(traveller):
    _, *one = from_walk_to_motion_to_walk(traveller)
    _, *other = from_walk_to_motion_to_walk(traveller)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
