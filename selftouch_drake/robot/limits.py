"""The limits of a robot and of its motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from selftouch_drake.experiment import ExecutionSettings
from selftouch_drake.robot.robot import Robot


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
