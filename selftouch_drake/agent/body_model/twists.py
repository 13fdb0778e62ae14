"""Poses that joints reach which turn, slide, or do both."""

from collections.abc import Sequence

import numpy as np

from selftouch_drake.agent.body_model.chain import exponentials


def exponential(twist: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """`(n, 4, 4)` poses that a joint reaches.

    Args:
        twist: `(6,)` w and v per unit of the reading; the joint slides if w is 0.
        amount: `(n,)` readings.
    """
    return exponentials(amount[:, None] * twist)


def chained(
    twists: np.ndarray, q: np.ndarray, up: Sequence[int], down: Sequence[int]
) -> np.ndarray:
    """`(n, 4, 4)` pose of one link in another: up through joints, and down through others.

    Args:
        twists: `(J, 6)` of all joints.
        q: `(n, J)` readings.
        up: joints from the other link to a link that carries both, in the order that they are met.
        down: joints from there to the one link, in order.
    """
    found = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for joint in up:
        found = found @ exponential(twists[joint], -q[:, joint])
    for joint in down:
        found = found @ exponential(twists[joint], q[:, joint])
    return found


def transposed(poses: np.ndarray) -> np.ndarray:
    """`(n, 4, 4)` matrices, transposed: their rotations are inverted."""
    return np.swapaxes(poses, -1, -2)


def transformed(poses: np.ndarray, places: np.ndarray) -> np.ndarray:
    """`(n, 3)` places, carried by `(n, 4, 4)` poses."""
    return np.einsum("nij,nj->ni", poses[:, :3, :3], places) + poses[:, :3, 3]
