import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from selftouch_drake.evaluation.executed import limit_shares
from selftouch_drake.robot.robot import JointLimits

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
    return SimpleNamespace(time_s=time_s, q=q, v=v)


def test_an_executed_motion_is_held_against_every_limit():
    motion = parabola()
    torque = np.array([[1.0, -15.0], [-2.0, 0.0]])
    aside = np.array([0.0, 0.1])
    shares = limit_shares(motion, motion.q + aside, torque, LIMITS)
    # Joint 1 ranges over 2 +- 2 rad, and begins at its lower limit.
    assert shares == pytest.approx(
        {"position": 1.0, "velocity": 2.0, "acceleration": 1.0, "torque": 0.75}
    )
    beyond = limit_shares(motion, motion.q - aside, torque, LIMITS)
    assert beyond["position"] == pytest.approx(1.05)


def test_a_joint_without_limits_takes_none_of_them():
    endless = dataclasses.replace(
        LIMITS, lower=np.array([-1.0, -np.inf]), upper=np.array([1.0, np.inf])
    )
    motion = parabola()
    motion.q[:, 1] += 100.0
    torque = np.zeros((1, 2))
    shares = limit_shares(motion, motion.q, torque, endless)
    # What is left is joint 0, halfway from the middle of its range to its end.
    assert shares["position"] == pytest.approx(0.5)
    free = dataclasses.replace(LIMITS, torque=np.array([np.inf, np.inf]))
    assert limit_shares(motion, motion.q, np.ones((1, 2)), free)["torque"] == 0.0
