"""Fingertip positions of many configurations at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from selftouch_drake.robot.agent import Agent


@dataclass(frozen=True, slots=True, kw_only=True)
class FingertipKinematics:
    """The arm as a product of rotations, read off a plant whose joints are all revolute.

    Attributes:
        axis_W: `(J, 3)` unit vectors of the joint axes at zero configuration.
        p_WJ: `(J, 3)` m, a point on each axis at zero configuration.
        p_WF: `(fingers, 3)` m, the fingertips at zero configuration.
    """

    axis_W: np.ndarray
    p_WJ: np.ndarray
    p_WF: np.ndarray

    @staticmethod
    def of(agent: Agent) -> FingertipKinematics:
        """Reads the kinematics of `agent`, whose joints follow one another along one arm."""
        plant = agent.plant
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.zeros(plant.num_positions()))
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(agent.arm)]
        joints = [joint for joint in joints if joint.num_positions() == 1]
        frames = [joint.frame_on_parent().CalcPoseInWorld(context) for joint in joints]
        return FingertipKinematics(
            axis_W=np.array(
                [
                    frame.rotation() @ joint.revolute_axis()
                    for joint, frame in zip(joints, frames, strict=True)
                ]
            ),
            p_WJ=np.array([frame.translation() for frame in frames]),
            p_WF=np.array([tip.CalcPoseInWorld(context).translation() for tip in agent.fingertips]),
        )

    def positions(self, q: np.ndarray) -> np.ndarray:
        """`(N, fingers, 3)` m, fingertip positions in the world at `q` `(N, J)` rad."""
        p = np.broadcast_to(self.p_WF, (len(q), *self.p_WF.shape))
        for joint in reversed(range(len(self.axis_W))):
            axis = self.axis_W[joint]
            cos = np.cos(q[:, joint])[:, None, None]
            sin = np.sin(q[:, joint])[:, None, None]
            arm = p - self.p_WJ[joint]
            along = (arm @ axis)[..., None] * axis
            p = self.p_WJ[joint] + along + cos * (arm - along) + sin * np.cross(axis, arm)
        return p
