"""PyBullet as the body of the agent: a URDF, and receptors on one of its links."""

from pathlib import Path

import numpy as np
import pybullet

from selftouch_drake.agent.body import Felt, Followed

GRID = np.stack(np.meshgrid(*[np.linspace(-0.08, 0.08, 5)] * 2), -1).reshape(-1, 2)


class PyBulletBody:
    """Puts a robot into postures; receptors on the base feel how deep its last link presses."""

    jumps, num_receptors = True, len(GRID)

    def __init__(self, file=Path(__file__).with_name("finger.urdf"), width=0.05, deepest=0.01):  # noqa: B008
        self.client = pybullet.connect(pybullet.DIRECT)
        self.robot = pybullet.loadURDF(str(file), useFixedBase=True, physicsClientId=self.client)
        self.joints = range(pybullet.getNumJoints(self.robot, self.client))
        infos = [pybullet.getJointInfo(self.robot, j, self.client) for j in self.joints]
        self.joint_names = [info[1].decode() for info in infos]
        self.lower, self.upper = np.array([info[8:10] for info in infos]).T
        self.velocity, self.acceleration = np.full((2, len(infos)), [[1.0], [4.0]])
        self.taxels, self.width, self.deepest = np.c_[GRID, [0.01] * len(GRID)], width, deepest

    def feel(self, q):
        """As in `Body`."""
        sensation, reached = np.zeros((len(q), self.num_receptors)), np.ones(len(q), bool)
        for row, posture in enumerate(q):
            for joint, position in zip(self.joints, posture, strict=True):
                pybullet.resetJointState(self.robot, joint, position, 0, self.client)
            for point in pybullet.getClosestPoints(
                self.robot, self.robot, 0.0, -1, self.joints[-1], physicsClientId=self.client
            ):
                place, depth = point[5], -point[8]
                near = 1 - np.linalg.norm(self.taxels - place, axis=1) / self.width
                sensation[row] += 1000 * max(depth, 0.0) * near.clip(0.0)
                reached[row] &= depth < self.deepest
        return Felt(q=q, sensation=sensation, reached=reached)

    def follow(self, time_s, q):
        """As in `Body`."""
        felt = self.feel(q)
        return Followed(time_s=time_s, q=felt.q, sensation=felt.sensation)

    def close(self):
        """Called at the end."""
        pybullet.disconnect(self.client)


def main(num=2000):
    """Returns how many of random postures are reached and touch, and receptors that felt any."""
    body = PyBulletBody()
    felt = body.feel(np.random.default_rng(0).uniform(body.lower, body.upper, (num, 3)))
    touches = felt.sensation[felt.reached] > 0
    body.close()
    return int(touches.any(axis=1).sum()), int(touches.any(axis=0).sum())


if __name__ == "__main__":
    print("{} touches, of {} receptors".format(*main()))
