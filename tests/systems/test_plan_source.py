"""One source follows any motion, which is state of the context."""

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial
from scipy.interpolate import CubicHermiteSpline

from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.bodies.drake import rates_through
from selftouch_drake.quotient.smooth import smooth_path
from selftouch_drake.systems import PlanSource


def motion(seed, num_receptors=5):
    """A motion of two joints through five waypoints."""
    rng = np.random.default_rng(seed)
    waypoints = rng.uniform(-1, 1, (5, 2))
    plan = Plan(
        nodes=np.arange(5),
        links=np.zeros(4, dtype=int),
        in_air=np.zeros(4, dtype=bool),
        modes=np.zeros(4, dtype=int),
        imagined=np.zeros(5, dtype=bool),
        waypoints_q=waypoints,
        waypoint_s=np.arange(5.0),
        path=smooth_path(waypoints, limits=(np.full(2, -2.0), np.full(2, 2.0))),
    )
    time_s = np.arange(101) / 100
    q = np.stack([np.sin(time_s * rng.uniform(1, 3)), np.cos(time_s)], axis=1)
    return Motion(
        plan=plan,
        time_s=time_s,
        s=4 * time_s,
        q=q,
        v=np.gradient(q, time_s, axis=0),
        predicted=rng.uniform(size=(101, num_receptors)),
        predicted_spread=np.zeros(101),
    )


def commanded(source, context, time_s):
    context.SetTime(time_s)
    return source.GetOutputPort("desired_state").Eval(context)


def test_it_follows_the_cubic_through_the_samples_and_rests_at_the_ends():
    given = motion(1)
    source = PlanSource(given)
    context = source.CreateDefaultContext()
    path = CubicHermiteSpline(given.time_s, given.q, given.v)
    for time in (0.0, 0.123, 0.5, 0.999):
        expected = np.concatenate([path(time), path(time, 1)])
        np.testing.assert_allclose(commanded(source, context, time), expected, atol=1e-9)
    np.testing.assert_allclose(commanded(source, context, 7.0), [*given.q[-1], 0, 0], atol=1e-12)


def test_a_body_that_is_given_positions_alone_takes_the_same_course():
    waypoints = np.random.default_rng(3).uniform(-1, 1, (6, 3))
    path = smooth_path(waypoints, limits=(np.full(3, -2.0), np.full(3, 2.0)))
    timed = time_path(path, velocity_limit=np.ones(3), acceleration_limit=np.full(3, 5.0))
    v = rates_through(timed.time_s, timed.q)
    assert np.abs(v - timed.v).max() < 3e-4
    theirs, ours = (CubicHermiteSpline(timed.time_s, timed.q, rates) for rates in (v, timed.v))
    between = np.linspace(0.0, timed.time_s[-1], 20 * len(timed.time_s))
    assert np.abs(theirs(between) - ours(between)).max() < 1e-6


def test_it_says_what_should_be_felt_now():
    given = motion(1)
    source = PlanSource(given)
    context, port = source.CreateDefaultContext(), source.GetOutputPort("predicted_sensation")
    for time, row in ((0.0, 0), (0.305, 30), (9.0, 100)):
        context.SetTime(time)
        np.testing.assert_array_equal(port.Eval(context), given.predicted[row])


def test_two_contexts_of_one_source_follow_two_motions():
    source = PlanSource(motion(1))
    first, second = source.CreateDefaultContext(), source.CreateDefaultContext()
    before = commanded(source, second, 0.4)
    source.SetMotion(second, motion(2))
    assert np.abs(commanded(source, second, 0.4) - before).max() > 0.01
    np.testing.assert_array_equal(commanded(source, first, 0.4), before)
    np.testing.assert_array_equal(
        commanded(source, second.Clone(), 0.4), commanded(source, second, 0.4)
    )


def test_a_bare_path_needs_no_plan():
    source = PlanSource(num_joints=2, num_receptors=3)
    context = source.CreateDefaultContext()
    np.testing.assert_array_equal(commanded(source, context, 1.0), np.zeros(4))
    path = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([[0.0, 2.0], [1.0, 1.0]]))
    source.SetPath(context, path)
    np.testing.assert_allclose(commanded(source, context, 0.25), [0.5, 1.0, 2.0, 0.0])
    predicted = source.GetOutputPort("predicted_sensation").Eval(context)
    np.testing.assert_array_equal(predicted, np.zeros(3))


def test_a_motion_of_another_robot_is_refused():
    source = PlanSource(motion(1))
    with pytest.raises(ValueError, match="2 joints and 7 receptors, and this PlanSource 2 and 5"):
        source.SetMotion(source.CreateDefaultContext(), motion(1, num_receptors=7))
