"""Timed paths under dynamics."""

import numpy as np
import pytest

from selftouch_drake.agent.planning import smooth_path
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot.execution import LOG_PERIOD, DynamicWorld
from selftouch_drake.robot.timing import time_path

VELOCITY, ACCELERATION = np.full(6, 1.0), np.full(6, 5.0)


@pytest.fixture(scope="module")
def agent(cube_world):
    return cube_world.probe.agent


@pytest.fixture(scope="module", params=["in the air", "through the skin"])
def motion(request, cube_world, agent):
    """A motion that never touches, and one that presses and lets go again."""
    rng = np.random.default_rng(4)
    while True:
        waypoints_q = rng.uniform(0.7 * agent.lower, 0.7 * agent.upper, (1, 6))
        waypoints_q = waypoints_q + 0.15 * rng.normal(size=(5, 6))
        path = smooth_path(waypoints_q, lower=agent.lower, upper=agent.upper)
        motion = time_path(path, velocity_limit=VELOCITY, acceleration_limit=ACCELERATION)
        touching = cube_world.probe.sensations(motion.q).any(axis=1)
        wanted = 0.0 if request.param == "in the air" else 0.3
        if wanted <= touching.mean() <= 2.0 * wanted and not touching[0]:
            return motion


@pytest.fixture(scope="module")
def done(cube_world, motion):
    world = DynamicWorld(cube_world.experiment, cube_world.skin, cube_world.fields)
    return world.execute(motion.time_s, motion.q, motion.v)


def test_the_arm_follows_within_five_milliradians(done, motion):
    error = done.q_measured - motion.q
    assert np.sqrt(np.mean(np.square(error))) < 0.005


def test_the_log_is_as_long_as_the_motion(done, motion):
    assert np.allclose(done.time_s, LOG_PERIOD * np.arange(len(motion.time_s)))
    for logged in (done.q_measured, done.v_measured, done.felt):
        assert len(logged) == len(motion.time_s)


def test_the_torque_of_every_step_of_the_plant_is_logged(cube_world, done, motion):
    steps_a_period = LOG_PERIOD / cube_world.experiment.execution.time_step
    assert len(done.torque) == 1 + round(steps_a_period * (len(motion.time_s) - 1))


def test_what_is_felt_is_what_is_felt_there_without_time(cube_world, done):
    still = cube_world.probe.sensations(done.q_measured)
    assert np.mean(done.felt.any(axis=1) == still.any(axis=1)) > 0.99
    assert np.allclose(done.felt.sum(axis=1), still.sum(axis=1), atol=0.05 * (1.0 + still.max()))


def test_no_limit_is_exceeded_at_a_thousand_hertz(cube_world, agent, motion):
    finely = load_experiment("cube", {"execution": {"time_step": 0.001}})
    world = DynamicWorld(finely, cube_world.skin, cube_world.fields, log_period=0.001)
    done = world.execute(motion.time_s, motion.q, motion.v)
    assert len(done.time_s) > 900 * motion.time_s[-1]
    assert np.all((done.q_measured >= agent.lower) & (done.q_measured <= agent.upper))
    assert np.all(np.abs(done.v_measured) <= VELOCITY)
    acceleration = np.diff(done.v_measured, axis=0) / 0.001
    # Contact is not the arm's doing: it may add to what was commanded for an instant.
    touching = done.felt.any(axis=1)
    free = ~(touching[1:] | touching[:-1])
    assert np.all(np.abs(acceleration[free]) <= ACCELERATION)
    plant = agent.plant
    effort = [plant.get_joint_actuator(i).effort_limit() for i in plant.GetJointActuatorIndices()]
    assert np.all(np.abs(done.torque) <= effort)
