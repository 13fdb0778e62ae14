"""The babbler walks the random walk of its experiment, whoever asks in whichever order."""

import dataclasses

import numpy as np
import pytest
import robots

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.robot.robot import BabblingJoints
from selftouch_drake.systems import Babbler


def with_babbling(experiment, **changes):
    babbling = dataclasses.replace(experiment.babbling, **changes)
    return dataclasses.replace(experiment, babbling=babbling)


def states(babbler, context, times):
    """`(n, 2J)` what is commanded at some times, in their order."""
    port, found = babbler.GetOutputPort("desired_state"), []
    for time in times:
        context.SetTime(time)
        found.append(port.Eval(context))
    return np.array(found)


@pytest.mark.parametrize("walk", [0, 3])
def test_its_nodes_are_those_of_the_random_walk(world, walk):
    experiment, joints = world.experiment, world.robot.num_joints
    expected = random_walk(experiment, DrakeBody(world), walk).steps(600)
    babbler = Babbler(experiment, walk=walk)
    np.testing.assert_array_equal(babbler.nodes(600), expected)
    times = experiment.babbling.step_duration * np.arange(600)
    there = states(babbler, babbler.CreateDefaultContext(), times)[:, :joints]
    np.testing.assert_allclose(there, expected, rtol=0, atol=1e-12)


def test_what_it_knows_of_joints_is_what_a_robot_with_its_skins_has(world):
    alone = BabblingJoints.of(world.experiment)
    robot = BabblingJoints.of_plant(world.robot.plant, world.experiment)
    for field in dataclasses.fields(alone):
        np.testing.assert_array_equal(getattr(alone, field.name), getattr(robot, field.name))
    np.testing.assert_array_equal(robot.velocity, world.limits.velocity)


def test_pieces_are_straight_and_their_rates_are_true(cube_world):
    babbler = Babbler(cube_world.experiment)
    nodes = babbler.nodes(3)
    share = np.array([0.0, 0.25, 0.5, 0.99])
    found = states(babbler, babbler.CreateDefaultContext(), 0.1 + 0.1 * share)
    q, v = np.split(found, 2, axis=1)
    np.testing.assert_allclose(q, nodes[1] + share[:, None] * (nodes[2] - nodes[1]), atol=1e-12)
    np.testing.assert_allclose(v, np.tile((nodes[2] - nodes[1]) / 0.1, (4, 1)), atol=1e-9)


def test_two_contexts_walk_alike_in_any_order_and_again_when_set_back(cube_world):
    babbler, times = Babbler(cube_world.experiment), np.linspace(0.0, 70.0, 200)
    first, second = babbler.CreateDefaultContext(), babbler.CreateDefaultContext()
    forward = states(babbler, first, times)
    np.testing.assert_array_equal(states(babbler, second, times[::-1])[::-1], forward)
    np.testing.assert_array_equal(states(babbler, first, times), forward)
    np.testing.assert_array_equal(states(babbler, first.Clone(), times), forward)
    # As another system does, which was asked for a late time at once.
    late = Babbler(cube_world.experiment)
    np.testing.assert_array_equal(
        states(late, late.CreateDefaultContext(), times[::-1])[::-1], forward
    )


def test_contexts_walk_walks_of_their_own(cube_world):
    babbler, other = Babbler(cube_world.experiment), Babbler(cube_world.experiment, walk=2)
    first, second = babbler.CreateDefaultContext(), babbler.CreateDefaultContext()
    times = np.linspace(0.0, 3.0, 20)
    before = states(babbler, first, times)
    states(babbler, second, times)
    babbler.SetWalk(second, 2)
    expected = states(other, other.CreateDefaultContext(), times)
    np.testing.assert_array_equal(states(babbler, second, times), expected)
    np.testing.assert_array_equal(states(babbler, first, times), before)


def test_a_robot_that_travels_is_asked_no_more_than_its_joints_can(cube_world):
    experiment = with_babbling(cube_world.experiment, jumps=False, step_size=0.3)
    babbler = Babbler(experiment)
    found = states(babbler, babbler.CreateDefaultContext(), np.linspace(0.0, 30.0, 2000))
    q, v = np.split(found, 2, axis=1)
    share = np.abs(v) / cube_world.limits.velocity
    assert 0.6 < share.max() <= 1.0 + 1e-9
    assert np.abs(np.diff(q, axis=0)).max() < 0.02
    # It stretches time, and passes the same nodes.
    assert np.abs(q[:, None] - babbler.nodes(20)).max(axis=2).min(axis=0).max() < 0.02
    jumps = Babbler(with_babbling(experiment, jumps=True))
    np.testing.assert_array_equal(jumps.nodes(20), babbler.nodes(20))


def test_it_approaches_the_first_node_from_where_a_robot_is(cube_world):
    babbler = Babbler(cube_world.experiment)
    context, begin = babbler.CreateDefaultContext(), np.full(6, 0.3)
    babbler.SetWalk(context, 1, q_from=begin, approach_s=2.0)
    first, second = Babbler(cube_world.experiment, walk=1).nodes(2)
    found = states(babbler, context, [0.0, 1.0, 2.0, 2.1])[:, :6]
    expected = [begin, (begin + first) / 2, first, second]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_q_is_where_joints_are_commanded_to_be():
    babbler = Babbler(robots.shipped("two_arms").experiment)
    context = babbler.CreateDefaultContext()
    context.SetTime(1.234)
    q = babbler.GetOutputPort("q").Eval(context)
    np.testing.assert_array_equal(q, babbler.GetOutputPort("desired_state").Eval(context)[: len(q)])
    assert len(q) == robots.shipped("two_arms").robot.num_joints
