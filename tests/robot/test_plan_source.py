import numpy as np
import pytest
from pydrake.math import BsplineBasis
from pydrake.trajectories import BsplineTrajectory, PiecewisePolynomial

from selftouch_drake.robot import PlanSource

START, END = np.array([1.0, -2.0]), np.array([0.5, 3.0])


def _moving_to_the_end():
    """From 2 s to 5 s, with velocity left at both ends."""
    return PiecewisePolynomial.FirstOrderHold([2.0, 5.0], np.stack([START, END], axis=1))


def _command(source, time):
    context = source.CreateDefaultContext()
    context.SetTime(time)
    return np.split(source.get_output_port().Eval(context), 2)


@pytest.mark.parametrize(
    ("time", "q", "v"),
    [
        (-1.0, START, np.zeros(2)),
        (0.0, START, (END - START) / 3),
        (1.5, (START + END) / 2, (END - START) / 3),
        (3.0, END, np.zeros(2)),
        (1e6, END, np.zeros(2)),
    ],
)
def test_it_follows_and_rests_at_both_ends(time, q, v):
    commanded_q, commanded_v = _command(PlanSource(_moving_to_the_end()), time)
    np.testing.assert_allclose(commanded_q, q, atol=1e-12)
    np.testing.assert_allclose(commanded_v, v, atol=1e-12)


def test_it_takes_any_trajectory_and_another_one_later():
    basis = BsplineBasis(4, 6)
    spline = BsplineTrajectory(basis, [np.full((2, 1), float(i)) for i in range(6)])
    source = PlanSource(spline)
    q, v = _command(source, 0.4)
    np.testing.assert_allclose(q, spline.value(0.4).ravel(), atol=1e-12)
    np.testing.assert_allclose(v, spline.EvalDerivative(0.4, 1).ravel(), atol=1e-12)
    source.set_trajectory(_moving_to_the_end())
    np.testing.assert_allclose(_command(source, 9.0)[0], END, atol=1e-12)
