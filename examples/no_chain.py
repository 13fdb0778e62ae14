"""A body that is no chain of joints, and an agent that finds out.

An arm of four hinges touches a ball with its tip; all of it is a page of numpy. The readings of the
joints can be mixed: then each hinge turns by its own reading and by that of another. No joint turns
or slides something rigid any more, and the agent refuses to believe in a model of its body.
"""

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.agent.body_model.model import BodyModel

# Axis of each hinge, and where the next one, or the tip, is on the link that it moves, m.
AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0]], dtype=float)
OFFSETS = np.array([[0, 0, 0.1], [0.3, 0, 0], [0.25, 0, 0], [0.05, 0.04, 0.12]])
SHOULDER = np.array([0, 0, 0.25])
RADIUS, SOFT, NUM_RECEPTORS = 0.2, 0.02, 80


class Arm:
    """Feels its tip in a soft ball below its shoulder; `mixing` is how much joints are mixed."""

    jumps, num_receptors = True, NUM_RECEPTORS
    joint_names = ("yaw", "shoulder", "elbow", "wrist")

    def __init__(self, mixing: float = 0.0):
        self.mixing = mixing
        self.lower, self.upper = np.full(4, -2.6), np.full(4, 2.6)
        self.velocity, self.acceleration = np.full(4, 1.0), np.full(4, 4.0)
        # Evenly over the ball, by the golden angle.
        i = np.arange(NUM_RECEPTORS) + 0.5
        z, angle = 1 - 2 * i / NUM_RECEPTORS, np.pi * (1 + np.sqrt(5)) * i
        self.receptors = np.stack(
            [np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1
        )

    def tip(self, q: np.ndarray) -> np.ndarray:
        """`(n, 3)` m, where the tip is; the ball's centre is at 0."""
        angle = q + self.mixing * np.sin(2 * q[:, ::-1])
        place = np.tile(OFFSETS[-1], (len(q), 1))
        for joint in (3, 2, 1, 0):
            place = turned(place, AXES[joint], angle[:, joint])
            place += OFFSETS[joint - 1] if joint else SHOULDER
        return place

    def feel(self, q: np.ndarray) -> Felt:
        """As in `Body`."""
        place = self.tip(q)
        far = np.linalg.norm(place, axis=1, keepdims=True)
        depth = np.clip(RADIUS - far, 0.0, None)
        reached = depth[:, 0] < SOFT
        cosine = (place / far) @ self.receptors.T
        return Felt(q=q, sensation=depth * np.clip(cosine - 0.85, 0.0, None), reached=reached)

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`."""
        return Followed(time_s=time_s, q=q, sensation=self.feel(q).sensation)


def turned(place: np.ndarray, axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """`(n, 3)` places, turned about an axis through 0 by `(n,)` rad (Rodrigues' formula)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    along = (place @ axis)[:, None] * axis
    return c * place + s * np.cross(axis, place) + (1 - c) * along


def touches(body: Arm, num: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and sensations of `num` touches at random postures."""
    rng, kept = np.random.default_rng(seed), []
    while sum(len(q) for q, _ in kept) < num:
        felt = body.feel(rng.uniform(body.lower, body.upper, (100_000, 4)))
        touching = felt.reached & felt.sensation.any(axis=1)
        kept.append((felt.q[touching], felt.sensation[touching]))
    q, sensation = (np.concatenate(of)[:num] for of in zip(*kept, strict=True))
    return q, sensation


def main(num_touches: int = 6000, mixing: float = 0.3) -> tuple[BodyModel, BodyModel]:
    """The models of the arm, and of the arm with mixed readings."""
    models = []
    for much in (0.0, mixing):
        body = Arm(much)
        agent = Agent.learn(*touches(body, num_touches), num_targets=150)
        models.append(agent.find_body_model(body.joint_names))
    plain, mixed = models
    return plain, mixed


if __name__ == "__main__":
    for name, model in zip(("joints that turn", "mixed readings"), main(), strict=True):
        print(f"{name}: {'accepted' if model.accepted else 'rejected'}\n  {model.reason}")
