"""From waypoints to a smooth geometric path in motor space."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

DEGREE = 5
# Knots this far apart (rad of path length) follow the polyline of a thousand kernels closely
# enough to keep contact, and round its corners.
KNOT_SPACING = 0.15
# Midpoints of each knot interval at which distance and jerk are summed.
_SAMPLES_PER_INTERVAL = 8


def path_length(waypoints_q: np.ndarray) -> np.ndarray:
    """`(W,)` rad, length of the polyline up to each of the `(W, J)` waypoints."""
    steps = np.linalg.norm(np.diff(waypoints_q, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def polyline(waypoints_q: np.ndarray) -> BSpline:
    """The straight path through the waypoints, over its length in rad.

    Args:
        waypoints_q: `(W, J)` rad; successive waypoints differ.
    """
    s = path_length(waypoints_q)
    return BSpline(np.concatenate([s[:1], s, s[-1:]]), waypoints_q, 1)


def smooth_path(
    waypoints_q: np.ndarray,
    *,
    knot_spacing: float = KNOT_SPACING,
    lower: np.ndarray | None = None,
    upper: np.ndarray | None = None,
) -> BSpline:
    """The quintic spline nearest the polyline: squared distance plus spacing^6 x squared jerk.

    It starts and ends exactly at the first and last waypoint. A spline lies in the convex hull of
    its control points, so that clipping these keeps it within the limits and as smooth as it was.

    Args:
        waypoints_q: `(W, J)` rad.
        knot_spacing: rad of path length between knots; larger is smoother.
        lower: `(J,)` rad, no joint goes below this, unless a waypoint does.
        upper: `(J,)` rad, no joint goes above this, unless a waypoint does.

    Returns:
        A clamped quintic B-spline over `[0, length]`, length of the polyline in rad; over
        `[0, 1]` and constant if there is nowhere to go.
    """
    waypoints_q = _without_repeats(np.asarray(waypoints_q, dtype=float))
    if len(waypoints_q) == 1:
        knots = np.repeat([0.0, 1.0], DEGREE + 1)
        return BSpline(knots, np.repeat(waypoints_q, DEGREE + 1, axis=0), DEGREE)

    line = polyline(waypoints_q)
    length = line.t[-1]
    breaks = np.linspace(0.0, length, 1 + int(np.ceil(length / knot_spacing)))
    knots = np.concatenate([np.zeros(DEGREE), breaks, np.full(DEGREE, length)])
    s = (np.arange(_SAMPLES_PER_INTERVAL) + 0.5) / _SAMPLES_PER_INTERVAL
    s = (breaks[:-1, None] + s * breaks[1]).ravel()

    basis = BSpline(knots, np.eye(len(knots) - DEGREE - 1), DEGREE)
    value, jerk = basis(s), basis.derivative(3)(s)
    normal = value.T @ value + knot_spacing**6 * jerk.T @ jerk
    ends = waypoints_q[[0, -1]]
    right = (value.T @ line(s) - normal[:, [0, -1]] @ ends)[1:-1]
    control = np.concatenate([ends[:1], np.linalg.solve(normal[1:-1, 1:-1], right), ends[1:]])
    if lower is not None:
        control = np.maximum(control, np.minimum(lower, waypoints_q.min(axis=0)))
    if upper is not None:
        control = np.minimum(control, np.maximum(upper, waypoints_q.max(axis=0)))
    return BSpline(knots, control, DEGREE)


def _without_repeats(waypoints_q: np.ndarray) -> np.ndarray:
    moves = np.any(np.diff(waypoints_q, axis=0) != 0.0, axis=1)
    return waypoints_q[np.concatenate([[True], moves])]
