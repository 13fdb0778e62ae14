"""The load of a motion, as shares of the robot's limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from selftouch_drake.experiment import ExecutionSettings
from selftouch_drake.robot.robot import Robot

# Rate at which positions are compared with their limits.
_CHECK_RATE_HZ = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointLimits:
    """The limits of a robot's joints and of its motions; each may be infinite.

    Attributes:
        lower: `(J,)` rad or m.
        upper: `(J,)` rad or m.
        velocity: `(J,)` rad/s or m/s.
        acceleration: `(J,)` rad/s^2 or m/s^2.
        torque: `(J,)` N·m or N.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray

    @staticmethod
    def of(robot: Robot, execution: ExecutionSettings) -> JointLimits:
        """The limits of `robot` and of the plans of `execution`; the tighter one holds."""
        plant = robot.plant
        actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
        effort = {a.joint().position_start(): a.effort_limit() for a in actuators}
        return JointLimits(
            lower=robot.lower,
            upper=robot.upper,
            velocity=_tighter(plant.GetVelocityUpperLimits(), execution.max_velocity),
            acceleration=_tighter(plant.GetAccelerationUpperLimits(), execution.max_acceleration),
            torque=np.array([effort[place] for place in range(robot.num_joints)]),
        )


def _tighter(of_model: np.ndarray, asked: float) -> np.ndarray:
    """`(J,)` the lower of two limits; 0 in a model means no limit."""
    return np.minimum(np.where(of_model > 0, of_model, np.inf), asked)


def commanded(time_s: np.ndarray, q: np.ndarray, v: np.ndarray) -> CubicHermiteSpline:
    """What the joints are commanded between the samples of a motion.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
    """
    return CubicHermiteSpline(time_s, q, v)


def speed_shares(
    time_s: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
) -> tuple[float, float]:
    """Shares of the limits that a commanded motion uses, exactly; 1 is the limit.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
        velocity_limit: `(J,)` rad/s or m/s.
        acceleration_limit: `(J,)` rad/s^2 or m/s^2.

    Returns:
        The largest share of the velocity and of the acceleration that is allowed, of any joint.
    """
    # On each cubic piece the acceleration is linear; where it is 0, the velocity is greatest.
    step, start, end = np.diff(time_s)[:, None], v[:-1], v[1:]
    mean = np.diff(q, axis=0) / step
    first, last = (6 * mean - 4 * start - 2 * end) / step, (2 * start + 4 * end - 6 * mean) / step
    turns = first * last < 0
    inside = first**2 / np.where(turns, first - last, np.inf) * step / 2
    speed = np.abs([start, end, np.where(turns, start + inside, 0.0)]).max(axis=(0, 1))
    rise = np.abs([first, last]).max(axis=(0, 1))
    return float((speed / velocity_limit).max()), float((rise / acceleration_limit).max())


def limit_shares(
    time_s: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    q_measured: np.ndarray,
    torque: np.ndarray,
    limits: JointLimits,
) -> dict[str, float]:
    """Shares of the limits that an executed motion used; 1 is the limit.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m, commanded.
        v: `(T, J)` rad/s or m/s, commanded.
        q_measured: `(T, J)` rad or m.
        torque: `(N, J)` N·m or N, of the actuators, any number of samples.
        limits: of the robot and its motions.

    Returns:
        For `position` (distance from the middle of a joint's range, commanded or measured),
        `velocity` and `acceleration` (commanded) and `torque` the largest share of any joint.
    """
    velocity, acceleration = speed_shares(time_s, q, v, limits.velocity, limits.acceleration)
    reached = np.concatenate([commanded(time_s, q, v)(_checked_times(time_s)), q_measured])
    # A joint without limits uses no share of them.
    ends = np.isfinite(limits.upper) & np.isfinite(limits.lower)
    upper, lower = np.where(ends, limits.upper, np.inf), np.where(ends, limits.lower, -1.0)
    middle, half = np.where(ends, (upper + lower) / 2, 0.0), (upper - lower) / 2
    return {
        "position": float(np.max(np.abs(reached - middle) / half)),
        "velocity": velocity,
        "acceleration": acceleration,
        "torque": float(np.max(np.abs(torque) / limits.torque)),
    }


def _checked_times(time_s: np.ndarray) -> np.ndarray:
    return np.append(np.arange(time_s[0], time_s[-1], 1.0 / _CHECK_RATE_HZ), time_s[-1])
