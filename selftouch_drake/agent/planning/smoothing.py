"""From waypoints to a smooth geometric path in motor space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from selftouch_drake.agent.motions import Plan

DEGREE = 5
# Knots this far apart (rad of path length) follow the polyline of a thousand kernels closely
# enough to keep contact, and round its corners.
KNOT_SPACING = 0.135
# Midpoints of each knot interval at which distance and jerk are summed.
_SAMPLES_PER_INTERVAL = 8

# Jerk is compared on samples this far apart, in rad of path length. The jerk of a polyline has no
# limit as samples get denser, so that the figure means something only for a stated spacing.
_JERK_SPACING = 0.02


def path_length(waypoints_x: np.ndarray) -> np.ndarray:
    """`(W,)` rad, length of the polyline up to each of the `(W, J)` scaled waypoints."""
    steps = np.linalg.norm(np.diff(waypoints_x, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def polyline(waypoints: np.ndarray, waypoint_s: np.ndarray) -> BSpline:
    """The straight path through the waypoints.

    Args:
        waypoints: `(W, J)` scaled or not, not all the same.
        waypoint_s: `(W,)` rad, where on the path each is.
    """
    moved = np.concatenate([[True], np.diff(waypoint_s) > 0.0])
    return BSpline(np.pad(waypoint_s[moved], 1, mode="edge"), waypoints[moved], 1)


def smooth_path(
    waypoints_x: np.ndarray,
    *,
    knot_spacing: float = KNOT_SPACING,
    lower: np.ndarray | None = None,
    upper: np.ndarray | None = None,
) -> BSpline:
    """The quintic spline nearest the polyline: squared distance plus l^6 x squared jerk.

    The length l is the interval between knots. The path starts and ends at the first and the last
    waypoint, its outer control points. A spline lies in the convex hull of its control points, so
    that clipping these keeps it within the limits and as smooth as it was.

    Args:
        waypoints_x: `(W, J)` rad, scaled.
        knot_spacing: rad of path length, the longest interval between knots; larger is smoother.
        lower: `(J,)` rad, scaled; no joint goes below this, unless a waypoint does.
        upper: `(J,)` rad, scaled; no joint goes above this, unless a waypoint does.

    Returns:
        A clamped quintic B-spline over `[0, length]`, length of the polyline in rad; over
        `[0, 1]` and constant if there is nowhere to go.
    """
    waypoints_x = np.asarray(waypoints_x, dtype=float)
    ends = waypoints_x[[0, -1]]
    waypoint_s = path_length(waypoints_x)
    length = waypoint_s[-1]
    if length == 0.0:
        knots = np.repeat([0.0, 1.0], DEGREE + 1)
        return BSpline(knots, np.repeat(ends[:1], DEGREE + 1, axis=0), DEGREE)

    along = polyline(waypoints_x, waypoint_s)
    num_intervals = int(np.ceil(length / knot_spacing))
    path = smooth_curve(along, ends, length, num_intervals)
    if lower is not None:
        path.c = np.maximum(path.c, np.minimum(lower, waypoints_x.min(axis=0)))
    if upper is not None:
        path.c = np.minimum(path.c, np.maximum(upper, waypoints_x.max(axis=0)))
    return path


def smooth_curve(
    curve: Callable[[np.ndarray], np.ndarray], ends: np.ndarray, length: float, num_intervals: int
) -> BSpline:
    """The quintic spline nearest a curve: squared distance plus l^6 x squared jerk.

    The length l is the interval between knots.

    Args:
        curve: from `(N,)` rad in `[0, length]` to `(N, D)`.
        ends: `(2, D)` where the spline starts and ends, its outer control points.
        length: rad, positive.
        num_intervals: of knots.
    """
    # Solved over knots one apart, so that the shortest path is as well conditioned as any.
    knots = np.pad(np.arange(num_intervals + 1.0), DEGREE, mode="edge")
    u = (np.arange(num_intervals * _SAMPLES_PER_INTERVAL) + 0.5) / _SAMPLES_PER_INTERVAL
    value, jerk = BSpline.design_matrix(u, knots, DEGREE), _third_derivative(u, knots)
    normal = (value.T @ value + jerk.T @ jerk).todia()
    interval = length / num_intervals
    fixed = np.zeros((normal.shape[0], ends.shape[1]))
    fixed[[0, -1]] = ends
    right = value.T @ curve(u * interval) - normal @ fixed
    inner = solveh_banded(_upper_bands(normal)[:, 1:-1], right[1:-1])
    knots *= interval
    knots[-DEGREE - 1 :] = length
    return BSpline(knots, np.concatenate([ends[:1], inner, ends[1:]]), DEGREE)


def _third_derivative(u: np.ndarray, knots: np.ndarray) -> sparse.csr_array:
    """`(N, n)` from the n control points of a spline to its third derivative at u."""
    derivative = sparse.eye_array(len(knots) - DEGREE - 1, format="csr")
    for degree in range(DEGREE, DEGREE - 3, -1):
        span = knots[degree + 1 : -1] - knots[1 : -degree - 1]
        size = len(span)
        difference = sparse.diags_array(
            [-degree / span, degree / span], offsets=[0, 1], shape=(size, size + 1), format="csr"
        )
        derivative = difference @ derivative
        knots = knots[1:-1]
    return BSpline.design_matrix(u, knots, DEGREE - 3) @ derivative


def _upper_bands(matrix: sparse.dia_array) -> np.ndarray:
    """`(DEGREE + 1, n)` diagonals of a symmetric banded matrix, the main one last."""
    return np.stack([np.pad(matrix.diagonal(k), (k, 0)) for k in range(DEGREE, -1, -1)])


def jerk_reduction(plan: Plan, joint_scale: np.ndarray) -> float:
    """How many times smaller the jerk of the smooth path is than that of its polyline.

    Both are sampled every 0.02 rad of path length; jerk is the root mean square of third
    differences of scaled configurations. 1 if the polyline has no corner.

    Args:
        plan: the plan.
        joint_scale: `(J,)` of the representation that the plan was made with.
    """
    if len(np.unique(plan.waypoint_s)) < 3:
        return 1.0
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(5, int(length / _JERK_SPACING)))
    rough, smooth = (
        np.sqrt(np.mean(np.square(np.diff(path(s) * joint_scale, 3, axis=0))))
        for path in (polyline(plan.waypoints_q, plan.waypoint_s), plan.path)
    )
    return float(rough / smooth)
