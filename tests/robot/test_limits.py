import dataclasses

import numpy as np
import pytest
import robots

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


def test_a_joint_without_limits_takes_none_of_them():
    endless = dataclasses.replace(
        LIMITS, lower=np.array([-1.0, -np.inf]), upper=np.array([1.0, np.inf])
    )
    time_s, q, v = parabola()
    q[:, 1] += 100.0
    torque = np.zeros((1, 2))
    shares = limit_shares(time_s, q, v, q, torque, endless)
    # What is left is joint 0, halfway from the middle of its range to its end.
    assert shares["position"] == pytest.approx(0.5)
    free = dataclasses.replace(LIMITS, torque=np.array([np.inf, np.inf]))
    assert limit_shares(time_s, q, v, q, np.ones((1, 2)), free)["torque"] == 0.0


def test_limits_are_those_of_the_robot_and_the_experiment(cube_world):
    execution = load_experiment("cube", {"execution": {"max_velocity": 0.5}}).execution
    limits = JointLimits.of(cube_world.robot, execution)
    assert np.array_equal(limits.velocity, np.full(6, 0.5))
    assert np.array_equal(limits.acceleration, np.full(6, 5.0))
    assert limits.torque.tolist() == [80.0, 80.0, 60.0, 20.0, 20.0, 20.0]
    assert np.all(limits.lower < limits.upper)


def test_limits_of_several_models_are_in_the_order_of_q(two_arms):
    efforts = dict(zip(two_arms.robot.joint_names, two_arms.limits.torque, strict=True))
    of_model = {"shoulder_yaw": 80, "shoulder_pitch": 80, "elbow_pitch": 60}
    of_model |= {f"wrist_{axis}": 20 for axis in "xyz"}
    assert efforts == {
        f"{side}_arm::{name}": effort
        for side in ("left", "right")
        for name, effort in of_model.items()
    }


def test_the_tighter_limit_of_model_and_experiment_holds(tmp_path):
    def mount(name, parent, **limits):
        return robots.link(name, pose=f"{0.1 * len(name)} 0 0 0 0 0") + robots.joint(
            f"to_{name}", "revolute", parent, name, **limits
        )

    world = robots.build(
        tmp_path,
        robots.link("base"),
        mount("a", "base", velocity=0.25),
        mount("bb", "a", velocity=9.0, effort=7),
        # Zero in a model is what it writes where it says nothing.
        mount("ccc", "bb", velocity=0),
        mount("dddd", "ccc"),
        skins={"skin": {"link": "base", "surface": {"shape": "sphere", "radius": 0.05}}},
        touching={"end": {"frame": "dddd", "radius": 0.01}},
        execution={"max_velocity": 2.0, "max_acceleration": 3.0},
    )
    assert world.limits.velocity.tolist() == [0.25, 2.0, 2.0, 2.0]
    assert world.limits.acceleration.tolist() == [3.0] * 4
    assert world.limits.torque.tolist() == [np.inf, 7.0, np.inf, np.inf]


def test_babbling_stays_within_one_turn_where_there_are_no_limits(tmp_path):
    limits = {"none": None, "all": (-1, 2), "1e16": (-1e16, 1e16), "low": (0.5, 1e16)}
    parts, parent = [robots.link("base")], "base"
    for number, (name, bounds) in enumerate(limits.items(), start=1):
        parts.append(robots.link(name, pose=f"{0.2 * number} 0 0 0 0 0"))
        parts.append(robots.joint(f"to_{name}", "revolute", parent, name, limits=bounds))
        parent = name
    world = robots.build(
        tmp_path,
        *parts,
        skins={"skin": {"link": "base", "surface": {"shape": "sphere", "radius": 0.05}}},
        touching={"end": {"frame": "low", "radius": 0.01}},
    )
    robot = world.robot
    assert robot.joint_names == [f"to_{name}" for name in limits]
    assert robot.lower.tolist() == [-np.inf, -1.0, -np.inf, 0.5]
    assert robot.upper.tolist() == [np.inf, 2.0, np.inf, np.inf]
    lower, upper = robot.babbled_range
    np.testing.assert_allclose(lower, [-np.pi, -1.0, -np.pi, 0.5])
    np.testing.assert_allclose(upper, [np.pi, 2.0, np.pi, 0.5 + 2 * np.pi])
