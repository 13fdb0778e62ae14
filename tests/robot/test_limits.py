import numpy as np
import pytest

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot.limits import JointLimits, commanded, limit_shares, speed_shares

LIMITS = JointLimits(
    lower=np.array([-1.0, 0.0]),
    upper=np.array([1.0, 4.0]),
    velocity=np.array([1.0, 2.0]),
    acceleration=np.array([5.0, 4.0]),
    torque=np.array([10.0, 20.0]),
)


def parabola(num_samples=11):
    """From rest at the limit of joint 1's acceleration for a second; joint 0 stays."""
    time_s = np.linspace(0.0, 1.0, num_samples)
    q = np.stack([0.5 * np.ones(num_samples), 2.0 * time_s**2], axis=1)
    v = np.stack([np.zeros(num_samples), 4.0 * time_s], axis=1)
    return time_s, q, v


def test_shares_are_of_the_joint_that_takes_most():
    shares = speed_shares(*parabola(), LIMITS.velocity, LIMITS.acceleration)
    assert shares == pytest.approx((2.0, 1.0))


def test_an_executed_motion_is_held_against_every_limit():
    time_s, q, v = parabola()
    torque = np.array([[1.0, -15.0], [-2.0, 0.0]])
    aside = np.array([0.0, 0.1])
    shares = limit_shares(time_s, q, v, q + aside, torque, LIMITS)
    # Joint 1 ranges over 2 +- 2 rad, and begins at its lower limit.
    assert shares == pytest.approx(
        {"position": 1.0, "velocity": 2.0, "acceleration": 1.0, "torque": 0.75}
    )
    beyond = limit_shares(time_s, q, v, q - aside, torque, LIMITS)
    assert beyond["position"] == pytest.approx(1.05)


def test_what_happens_between_samples_counts():
    # The samples rest; the cubic between them goes there and back.
    time_s, v = np.array([0.0, 0.3, 1.0]), np.zeros((3, 2))
    q = np.array([[0.0, 2.0], [0.3, 2.0], [0.3, 2.0]])
    velocity, acceleration = speed_shares(time_s, q, v, np.ones(2), np.ones(2))
    assert velocity == pytest.approx(1.5, rel=1e-4)
    assert acceleration == pytest.approx(20.0)
    assert commanded(time_s, q, v)(0.15)[0] == pytest.approx(0.15)


def test_limits_are_those_of_the_arm_and_the_experiment(cube_world):
    execution = load_experiment("cube", {"execution": {"max_velocity": 0.5}}).execution
    limits = JointLimits.of(cube_world.probe.agent, execution)
    assert np.array_equal(limits.velocity, np.full(6, 0.5))
    assert np.array_equal(limits.acceleration, np.full(6, 5.0))
    assert limits.torque.tolist() == [80.0, 80.0, 60.0, 20.0, 20.0, 20.0]
    assert np.all(limits.lower < limits.upper)
