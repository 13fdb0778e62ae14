"""Contact as pure geometry, held to Drake's own."""

import os

import numpy as np
import pytest
from pydrake.geometry import HydroelasticContactRepresentation

from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.contact import PressedFaces
from selftouch_drake.robot.station import sensor_model

# A hundred thousand touches of each robot, and more, take hours: `SELFTOUCH_MANY_TOUCHES=100000`.
NUM_TOUCHES = int(os.environ.get("SELFTOUCH_MANY_TOUCHES", "300"))
EXPERIMENTS = (
    "sphere",
    "cube",
    "cylinder",
    "ellipsoid",
    "torus",
    "torus_two_fingers",
    "double_torus",
    "gantry",
    "two_arms",
    "turning_body",
    "infant",
)


def drake_touches(world, q):
    """What Drake says: every contact surface at every configuration."""
    faces, robot = PressedFaces(), world.robot
    sensor = sensor_model(robot)
    for row, at in enumerate(q):
        surfaces = world.probe.query(at).ComputeContactSurfaces(
            HydroelasticContactRepresentation.kPolygon
        )
        sensor.gather(faces, row, surfaces)
    return sensor.touches(faces, robot.skin_positions(q))


def assert_same_touches(touches, expected):
    assert np.array_equal(touches.sensation.any(axis=1), expected.sensation.any(axis=1))
    np.testing.assert_allclose(touches.sensation, expected.sensation, rtol=0, atol=1e-9)
    for name in ("row", "skin", "toucher"):
        np.testing.assert_array_equal(getattr(touches, name), getattr(expected, name))
    np.testing.assert_allclose(touches.p_LC, expected.p_LC, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_touches_are_those_of_drake(name):
    world = World(load_experiment(name))
    walk = random_walk(world.experiment, world.robot, 0)
    found = 0
    while found < NUM_TOUCHES:
        q = walk.steps(1000)
        touches = world.probe.touches(q)
        assert_same_touches(touches, drake_touches(world, q))
        found += np.unique(touches.row).size
