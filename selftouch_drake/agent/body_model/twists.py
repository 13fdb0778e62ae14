"""Twists and their exponentials: joints that turn, slide, or do both, in plain numpy."""

from collections.abc import Sequence

import numpy as np

# rad. Below it the series, to the sixth power, is exact to the last digit, and above it the closed
# form loses at most four digits of sixteen.
_SERIES_BELOW = 0.03


def exponential(twist: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """`(n, 4, 4)` poses that a joint reaches.

    Args:
        twist: `(6,)` w and v per unit of the reading; the joint slides if w is 0.
        amount: `(n,)` readings.
    """
    w, v = twist[:3], twist[3:]
    a, b, c = _factors(np.linalg.norm(w) * amount)
    t = amount[:, None, None]
    W = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    first, second = t * W, t**2 * (W @ W)
    a, b, c = (factor[:, None, None] for factor in (a, b, c))
    poses = np.zeros((len(amount), 4, 4))
    poses[:, :3, :3] = np.eye(3) + a * first + b * second
    poses[:, :3, 3] = ((np.eye(3) + b * first + c * second) @ v) * amount[:, None]
    poses[:, 3, 3] = 1.0
    return poses


def _factors(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`sin x / x`, `(1 - cos x) / x^2` and `(x - sin x) / x^3` of `(n,)` angles x, rad."""
    square = angle**2
    small = np.abs(angle) < _SERIES_BELOW
    x = np.where(small, 1.0, angle)
    closed = np.sin(x) / x, (1.0 - np.cos(x)) / x**2, (x - np.sin(x)) / x**3
    series = (
        1.0 - square / 6 * (1.0 - square / 20 * (1.0 - square / 42)),
        0.5 - square / 24 * (1.0 - square / 30 * (1.0 - square / 56)),
        1.0 / 6 - square / 120 * (1.0 - square / 42 * (1.0 - square / 72)),
    )
    first, second, third = (np.where(small, s, c) for s, c in zip(series, closed, strict=True))
    return first, second, third


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
