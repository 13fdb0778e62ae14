import numpy as np
import pytest
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, PiecewisePolynomial

from selftouch_drake.robot import PathSource

START, END = np.array([1.0, -2.0]), np.array([0.5, 3.0])


def moving_to_the_end():
    """From 2 s to 5 s, with non-zero velocity at both ends."""
    return PiecewisePolynomial.FirstOrderHold([2.0, 5.0], np.stack([START, END], axis=1))


def command(source, context, time):
    context.SetTime(time)
    return np.split(source.GetOutputPort("desired_state").Eval(context), 2)


@pytest.mark.parametrize(
    ("time", "q", "v"),
    [
        (1.0, START, np.zeros(2)),
        (2.0, START, (END - START) / 3),
        (3.5, (START + END) / 2, (END - START) / 3),
        (5.0, END, np.zeros(2)),
        (1e6, END, np.zeros(2)),
    ],
)
def test_a_path_is_followed_and_rested_at_both_ends(time, q, v):
    source = PathSource(2)
    context = source.CreateDefaultContext()
    source.SetPath(context, moving_to_the_end())
    commanded_q, commanded_v = command(source, context, time)
    np.testing.assert_allclose(commanded_q, q, atol=1e-12)
    np.testing.assert_allclose(commanded_v, v, atol=1e-12)


def test_any_trajectory_is_a_path_and_another_one_later():
    spline = BsplineTrajectory(BsplineBasis(4, 6), [np.full((2, 1), float(i)) for i in range(6)])
    source = PathSource(2)
    context = source.CreateDefaultContext()
    source.SetPath(context, spline)
    q, v = command(source, context, 0.4)
    np.testing.assert_allclose(q, spline.value(0.4).ravel(), atol=1e-12)
    np.testing.assert_allclose(v, spline.EvalDerivative(0.4, 1).ravel(), atol=1e-12)
    source.SetPath(context, moving_to_the_end())
    np.testing.assert_allclose(command(source, context, 9.0)[0], END, atol=1e-12)


def test_two_contexts_of_one_source_follow_two_paths():
    source = PathSource(2)
    one, other = source.CreateDefaultContext(), source.CreateDefaultContext()
    source.SetPath(one, moving_to_the_end())
    source.SetPath(other, PiecewisePolynomial(np.array([[7.0], [8.0]])))
    np.testing.assert_allclose(command(source, one, 5.0)[0], END)
    np.testing.assert_allclose(command(source, other, 5.0)[0], [7.0, 8.0])
    np.testing.assert_allclose(command(source, one, 2.0)[0], START)
