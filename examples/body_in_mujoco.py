"""MuJoCo as the body of the agent: any MJCF whose skin is `touch` sensors."""

from pathlib import Path

import mujoco
import numpy as np

from selftouch_drake.agent.body import Felt, Followed


class MuJoCoBody:
    """Puts the hinges and slides of a model into postures, and reads its touch sensors there."""

    jumps = True

    def __init__(self, file=Path(__file__).with_name("finger.xml"), deepest=0.01):  # noqa: B008
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.data, self.deepest = mujoco.MjData(self.model), deepest
        moves = np.flatnonzero(self.model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE))
        self.joint_names = [self.model.joint(joint).name for joint in moves]
        self.address = self.model.jnt_qposadr[moves]
        self.lower, self.upper = self.model.jnt_range[moves].T
        self.velocity, self.acceleration = np.full((2, len(moves)), [[1.0], [4.0]])
        touch = self.model.sensor_type == int(mujoco.mjtSensor.mjSENS_TOUCH)
        self.readings = self.model.sensor_adr[touch]
        self.num_receptors = len(self.readings)

    def feel(self, q):
        """As in `Body`."""
        sensation, reached = np.zeros((len(q), self.num_receptors)), np.zeros(len(q), bool)
        for row, posture in enumerate(q):
            self.data.qpos[self.address], self.data.qvel[:] = posture, 0.0
            mujoco.mj_forward(self.model, self.data)
            sensation[row] = self.data.sensordata[self.readings]
            reached[row] = self.data.contact.dist.min(initial=0.0) > -self.deepest
        return Felt(q=q, sensation=sensation, reached=reached)

    def follow(self, time_s, q):
        """As in `Body`."""
        felt = self.feel(q)
        return Followed(time_s=time_s, q=felt.q, sensation=felt.sensation)


def main(num=2000):
    """Returns how many of random postures are reached and touch, and receptors that felt any."""
    body = MuJoCoBody()
    felt = body.feel(np.random.default_rng(0).uniform(body.lower, body.upper, (num, 3)))
    touches = felt.sensation[felt.reached] > 0
    return int(touches.any(axis=1).sum()), int(touches.any(axis=0).sum())


if __name__ == "__main__":
    print("{} touches, of {} receptors".format(*main()))
