"""The fastest motion along a path within the limits of the joints.

Time-optimal path parameterization by reachability (Pham and Pham 2018), compiled: the result of
Drake's Toppra in a tenth of its time. At each point of a grid along the path, the square of the
speed along it and the acceleration along it are bounded by linear constraints. From the end
backwards, the largest square of the speed from which the rest of the path can be gone; then from
the start forwards, the largest acceleration that stays below.
"""

import numpy as np
from scipy.interpolate import BSpline, PPoly

from selftouch_drake.compiled import compiled, inner

# A smaller coefficient of the acceleration counts as zero.
_NONE = 1e-12
# Steps towards the largest speed; each excludes at least one constraint, and usually all but one.
_MOST_STEPS = 100


def fastest_progress(
    path: BSpline,
    grid: np.ndarray,
    *,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
) -> PPoly | None:
    """The fastest motion along a path from rest to rest: length over time.

    The limits of the acceleration, `(J,)` rad/s^2 or m/s^2, hold on both sides of each point of the
    grid, `(N,)` rising lengths from the first to the last of the path; those of the velocity, rad/s
    or m/s, at the points. None if there is no progress, for instance on a constant path.
    """
    slope, bend = path(grid, 1), path(grid, 2)
    with np.errstate(divide="ignore"):
        top = np.square(velocity_limit / np.abs(slope)).min(axis=1)
    square = np.zeros(len(grid))
    _run(np.diff(grid), slope, bend, np.asarray(acceleration_limit, dtype=float), top, square)
    speed = np.sqrt(square)
    mean = (speed[1:] + speed[:-1]) / 2
    if not (np.isfinite(mean) & (mean > 0.0)).all():
        return None
    duration = np.diff(grid) / mean
    pieces = np.stack([np.diff(speed) / duration / 2, speed[:-1], grid[:-1]])
    return PPoly(pieces, np.concatenate([[0.0], np.cumsum(duration)]))


@compiled
def _run(length, slope, bend, limit, top, square):
    """Writes the squares of the speed along the path at the points of its grid."""
    num = len(length)
    # Constraints: the acceleration along the path is within `room` of `tilt * square`.
    tilt, room = np.empty(2 * len(limit)), np.empty(2 * len(limit))
    bounds = np.empty(4)
    # Backwards: the largest square from which the rest of the path is feasible.
    square[num] = 0.0
    for back in range(num):
        i = num - 1 - back
        x = min(top[i], _constrain(length[i], slope, bend, i, limit, tilt, room))
        for _ in range(_MOST_STEPS):
            _bound(tilt, room, length[i], square[i + 1], x, bounds)
            if bounds[0] <= bounds[2]:
                break
            # The gap between the bounds is a concave, piecewise linear function of x.
            x -= (bounds[0] - bounds[2]) / (bounds[1] - bounds[3])
        square[i] = max(x, 0.0)
    # Forwards: as fast as possible within these.
    x = square[0] = 0.0
    for i in range(num):
        _constrain(length[i], slope, bend, i, limit, tilt, room)
        _bound(tilt, room, length[i], square[i + 1], x, bounds)
        x = min(max(x + 2 * length[i] * bounds[2], 0.0), square[i + 1])
        square[i + 1] = x


@inner
def _constrain(length, slope, bend, i, limit, tilt, room):
    """Writes what the joints' limits, at both ends of a stretch, allow along it.

    Returns the largest square where the acceleration along it does not matter to a joint.
    """
    num, most = slope.shape[1], np.inf
    for k in range(2 * num):
        if k < num:
            j, factor, share = k, slope[i, k], bend[i, k]
        else:
            j = k - num
            factor, share = slope[i + 1, j] + 2 * length * bend[i + 1, j], bend[i + 1, j]
        if abs(factor) < _NONE:
            tilt[k], room[k] = 0.0, np.inf
            if share != 0.0:
                most = min(most, limit[j] / abs(share))
        else:
            tilt[k], room[k] = -share / factor, limit[j] / abs(factor)
    return most


@inner
def _bound(tilt, room, length, after, x, bounds):
    """Writes the lowest and the highest acceleration along the path where the square is `x`.

    Each is followed by its slope in `x`. The square at the end of the stretch is 0 to `after`.
    """
    bounds[0], bounds[1] = -x / (2 * length), -1 / (2 * length)
    bounds[2], bounds[3] = (after - x) / (2 * length), -1 / (2 * length)
    for k in range(len(tilt)):
        middle = tilt[k] * x
        if middle - room[k] > bounds[0]:
            bounds[0], bounds[1] = middle - room[k], tilt[k]
        if middle + room[k] < bounds[2]:
            bounds[2], bounds[3] = middle + room[k], tilt[k]
