"""A continuous trajectory through motor kernels (paper, "Sensation trajectory planning").

"Using this computed path, a continuous trajectory can be interpolated between successive motor
configuration kernels [...]. Such a trajectory can also be optimized [...] to assure a smooth
trajectory of the end-effector." It is a quintic spline of low jerk near the polyline through one
configuration of each kernel.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

DEGREE = 5
# Knots this far apart (mu of path length) follow the polyline of a thousand kernels closely
# enough to keep contact, and round its corners. At half, jerk is 2.6 times as large.
KNOT_SPACING = 0.135
# Midpoints of each knot interval at which distance and jerk are summed.
_SAMPLES_PER_INTERVAL = 8


def path_length(waypoints_x: np.ndarray) -> np.ndarray:
    """`(W,)` mu, length of the polyline up to each of the `(W, J)` scaled waypoints."""
    steps = np.linalg.norm(np.diff(waypoints_x, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def polyline(waypoints: np.ndarray, waypoint_s: np.ndarray) -> BSpline:
    """The straight path through `(W, J)` waypoints, not all the same, each at `(W,)` s, mu."""
    moved = np.concatenate([[True], np.diff(waypoint_s) > 0.0])
    return BSpline(np.pad(waypoint_s[moved], 1, "edge"), waypoints[moved], 1)


def smooth_path(
    waypoints_x: np.ndarray,
    *,
    knot_spacing: float = KNOT_SPACING,
    limits: tuple[np.ndarray, np.ndarray] | None = None,
) -> BSpline:
    """The quintic spline nearest the polyline, as in `smooth_curve`.

    A spline lies in the convex hull of its control points, so clipping these keeps it within the
    limits and equally smooth.

    Args:
        waypoints_x: `(W, J)` mu, scaled.
        knot_spacing: mu of path length, the longest interval between knots; larger is smoother.
        limits: `(J,)` mu each, scaled, which no joint passes unless a waypoint does.

    Returns:
        A clamped quintic B-spline over `[0, length]`, the length of the polyline in mu; constant
        over `[0, 1]` if all waypoints are the same.
    """
    waypoints_x = np.asarray(waypoints_x, dtype=float)
    ends, waypoint_s = waypoints_x[[0, -1]], path_length(waypoints_x)
    length = waypoint_s[-1]
    if length == 0.0:
        return BSpline(_knots(1), ends[:1].repeat(DEGREE + 1, 0), DEGREE)
    num_intervals = int(np.ceil(length / knot_spacing))
    path = smooth_curve(polyline(waypoints_x, waypoint_s), ends, length, num_intervals)
    if limits is not None:
        lower = np.minimum(limits[0], waypoints_x.min(axis=0))
        path.c = np.clip(path.c, lower, np.maximum(limits[1], waypoints_x.max(axis=0)))
    return path


def smooth_curve(
    curve: Callable[[np.ndarray], np.ndarray], ends: np.ndarray, length: float, num_intervals: int
) -> BSpline:
    """The quintic spline nearest a curve: squared distance plus l^6 x squared jerk.

    The length l is the interval between knots. The curve maps `(N,)` mu in `[0, length]` to
    `(N, D)`; the `(2, D)` ends are where the spline starts and ends, its outer control points.
    """
    knots, value, bands = _normal_equations(num_intervals)
    interval = length / num_intervals
    u = (np.arange(num_intervals * _SAMPLES_PER_INTERVAL) + 0.5) / _SAMPLES_PER_INTERVAL
    wanted = curve(u * interval).reshape(num_intervals, _SAMPLES_PER_INTERVAL, -1)
    # Each interval adds to the right-hand sides of the control points whose basis reaches it.
    of_interval = value.swapaxes(1, 2) @ wanted
    right_side = np.zeros((num_intervals + DEGREE, ends.shape[1]))
    for point in range(DEGREE + 1):
        right_side[point : point + num_intervals] += of_interval[:, point]
    # The two outer control points are given: their terms go to the right-hand side.
    for offset in range(DEGREE + 1):
        right_side[offset] -= bands[DEGREE - offset, offset] * ends[0]
        right_side[-1 - offset] -= bands[DEGREE - offset, -1] * ends[1]
    inner = solveh_banded(bands[:, 1:-1], right_side[1:-1])
    knots = knots * interval
    knots[-DEGREE - 1 :] = length
    return BSpline(knots, np.concatenate([ends[:1], inner, ends[1:]]), DEGREE)


# A path and the sensations expected along it use the same knots.
@lru_cache(maxsize=16)
def _normal_equations(num_intervals: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The part of the least-squares problem that does not depend on the curve.

    The knots are at distance 1, so that a short path is as well conditioned as a long one.

    Returns:
        The knots; `(M, samples, DEGREE + 1)` values of the basis functions of the control points at
        the samples of each interval; `(DEGREE + 1, n)` upper bands of the normal equations, the
        main diagonal last.
    """
    # All intervals between the outer ones are alike.
    num_unlike = min(num_intervals, 2 * DEGREE + 1)
    value, local = _local_equations(num_unlike)
    interval = np.arange(num_intervals)
    after = interval - num_intervals + num_unlike
    unlike = np.minimum(interval, DEGREE) + np.maximum(after - DEGREE, 0)
    value, local = value[unlike], local[unlike]
    bands = np.zeros((DEGREE + 1, num_intervals + DEGREE))
    for row in range(DEGREE + 1):
        for column in range(row, DEGREE + 1):
            along = slice(column, column + num_intervals)
            bands[DEGREE + row - column, along] += local[:, row, column]
    return _knots(num_intervals), value, bands


@lru_cache(maxsize=2 * DEGREE + 1)
def _local_equations(num_intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """`value` as above, and `(M, DEGREE + 1, DEGREE + 1)` the terms of each interval."""
    basis = BSpline(_knots(num_intervals), np.eye(num_intervals + DEGREE), DEGREE)
    u = (np.arange(num_intervals * _SAMPLES_PER_INTERVAL) + 0.5) / _SAMPLES_PER_INTERVAL
    interval = np.arange(num_intervals)[:, None, None]
    points = interval + np.arange(DEGREE + 1)
    value, jerk = (
        np.take_along_axis(
            basis(u, order).reshape(num_intervals, _SAMPLES_PER_INTERVAL, -1), points, axis=2
        )
        for order in (0, 3)
    )
    return value, value.swapaxes(1, 2) @ value + jerk.swapaxes(1, 2) @ jerk


def _knots(num_intervals: int) -> np.ndarray:
    return np.pad(np.arange(num_intervals + 1.0), DEGREE, "edge")
