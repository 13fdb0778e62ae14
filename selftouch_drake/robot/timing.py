"""From a geometric path to a motion within the limits of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.math import BsplineBasis
from pydrake.polynomial import Polynomial
from pydrake.trajectories import (
    BsplineTrajectory,
    PathParameterizedTrajectory,
    PiecewisePolynomial,
)
from scipy.interpolate import BSpline, PPoly

from selftouch_drake.robot.fastest import fastest_progress
from selftouch_drake.robot.limits import speed_shares
from selftouch_drake.robot.pieces import Pieces, averaged, clamped, follow, shares_along

#: The solver respects limits only at grid points; between them they are exceeded by up to 25 %.
LIMIT_SHARE = 0.8
# rad of scaled path length between grid points. A grid twice as fine saves 0.5 % of the duration.
_GRID_SPACING = 0.07
#: s; a longer motion is refused, because its limits are probably a mistake.
LONGEST_S = 600.0
# A motion that exceeds limits is slowed down by this factor more than needed, because the check of
# the path looks at samples only: so many on each piece of the progress, and at least at this rate.
_CHECK_MARGIN = 1.01
_CHECKS_PER_PIECE = 3
_CHECK_RATE_HZ = 300.0
# s over which the progress is averaged. The acceleration of the fastest progress jumps, and with it
# the tracking error of the robot; after averaging it ramps.
_EASING_S = 0.06
# s between the knots of the averaged progress, and how many values are averaged.
_EASING_STEP_S = 0.01
_EASING_SAMPLES = 12
# The largest first and second derivative of the quintic 10 u^3 - 15 u^4 + 6 u^5 over [0, 1].
_QUINTIC_SPEED = 15.0 / 8.0
_QUINTIC_ACCELERATION = 10.0 / np.sqrt(3.0)
# s, duration of a path of length 0, so that the trajectory is valid.
_REST_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedPath:
    """A motion along a path, at rest at both ends.

    Attributes:
        time_s: `(T,)` s, from 0, evenly spaced except for the last interval.
        s: `(T,)` rad, scaled length along the path.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
        path: q as a function of path length.
        s_of_t: path length as a function of time.
    """

    time_s: np.ndarray
    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
    path: BSpline
    s_of_t: PPoly

    @property
    def trajectory(self) -> PathParameterizedTrajectory:
        """The same as a Drake trajectory of q over `[0, time_s[-1]]`."""
        pieces = [np.array([[Polynomial(piece[::-1])]]) for piece in self.s_of_t.c.T]
        progress = PiecewisePolynomial(pieces, self.s_of_t.x.tolist())
        return PathParameterizedTrajectory(to_drake(self.path), progress)


def time_path(
    path: BSpline,
    *,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
    rate_hz: float = 100.0,
) -> TimedPath:
    """Follows a path as fast as the joints' limits allow, from rest to rest.

    Uses time-optimal path parameterization, or a quintic time scaling if that fails. Then the
    acceleration is smoothed in time. If a limit is still exceeded anywhere, on the path or on the
    cubic pieces between the samples that the joints follow, the whole motion is slowed down.

    Args:
        path: clamped B-spline of `(J,)` rad or m over scaled path length in rad.
        velocity_limit: `(J,)` rad/s or m/s, the largest speed of each joint.
        acceleration_limit: `(J,)` rad/s^2 or m/s^2, the largest acceleration of each joint.
        rate_hz: Hz, rate of the samples.

    Raises:
        ValueError: a limit or the rate is not positive, there is not one limit per joint, or the
            limits are so low that the motion would last longer than `LONGEST_S`.
    """
    velocity_limit = _checked_limit("velocity_limit", velocity_limit, path)
    acceleration_limit = _checked_limit("acceleration_limit", acceleration_limit, path)
    if not 0.0 < rate_hz < np.inf:
        raise ValueError(f"rate_hz is {rate_hz}: give a positive number")

    _require_bearable(_least_duration(path, velocity_limit, acceleration_limit))
    fastest = _fastest(path, velocity_limit, acceleration_limit)
    if fastest is None:
        s_of_t = quintic_time_scaling(path, velocity_limit, acceleration_limit)
    else:
        s_of_t = _eased(fastest)
    pieces = Pieces.of_path(path)
    while True:
        _require_bearable(s_of_t.x[-1])
        timed = _sampled(path, pieces, s_of_t, rate_hz)
        limits = velocity_limit, acceleration_limit
        shares = np.maximum(
            _speed_shares(pieces, s_of_t, *limits),
            speed_shares(timed.time_s, timed.q, timed.v, *limits),
        )
        excess = max(shares[0], np.sqrt(shares[1]))
        if excess <= 1.0:
            return timed
        s_of_t = _slowed(s_of_t, _CHECK_MARGIN * excess)


def to_drake(path: BSpline) -> BsplineTrajectory:
    """The same B-spline as a Drake trajectory of `(J, 1)`, over path length instead of time."""
    basis = BsplineBasis(path.k + 1, path.t.tolist())
    return BsplineTrajectory(basis, [point[:, None] for point in path.c])


def quintic_time_scaling(
    path: BSpline, velocity_limit: np.ndarray, acceleration_limit: np.ndarray
) -> PPoly:
    """The progress s(t) of a quintic from rest to rest, slow enough for any path.

    It respects the limits by construction, because a B-spline and its derivatives lie within the
    convex hulls of their control points.

    Args:
        path: clamped B-spline of `(J,)` rad or m over scaled path length in rad.
        velocity_limit: `(J,)` rad/s or m/s.
        acceleration_limit: `(J,)` rad/s^2 or m/s^2.
    """
    start, end = path.t[0], path.t[-1]
    speed = (end - start) * _hull(path.derivative(1))
    curvature = (end - start) ** 2 * _hull(path.derivative(2))
    duration_s = max(
        _REST_S,
        np.max(_QUINTIC_SPEED * speed / velocity_limit),
        np.sqrt(
            np.max(
                (_QUINTIC_SPEED**2 * curvature + _QUINTIC_ACCELERATION * speed) / acceleration_limit
            )
        ),
    )
    quintic = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / duration_s ** np.arange(6)
    progress = (end - start) * quintic + start * np.eye(6)[0]
    return PPoly(progress[::-1, None], [0.0, duration_s])


def _least_duration(
    path: BSpline, velocity_limit: np.ndarray, acceleration_limit: np.ndarray
) -> float:
    """s, a lower bound for the duration of any motion along the path, from rest."""
    q = path(np.linspace(path.t[0], path.t[-1], 100))
    travelled, farthest = np.abs(np.diff(q, axis=0)).sum(axis=0), np.abs(q - q[0]).max(axis=0)
    return float(
        np.maximum(travelled / velocity_limit, np.sqrt(2.0 * farthest / acceleration_limit)).max()
    )


def _require_bearable(duration_s: float) -> None:
    if duration_s > LONGEST_S:
        raise ValueError(
            f"the motion would take {duration_s:.3g} s, more than {LONGEST_S:g} s: "
            "raise max_velocity or max_acceleration"
        )


def _fastest(
    path: BSpline, velocity_limit: np.ndarray, acceleration_limit: np.ndarray
) -> PPoly | None:
    """The fastest progress s(t); None if the path has length 0 or the solver finds none."""
    if np.ptp(path.c, axis=0).max() < 1e-9:
        return None
    num_points = max(20, int(np.ceil((path.t[-1] - path.t[0]) / _GRID_SPACING)))
    return fastest_progress(
        path,
        np.linspace(path.t[0], path.t[-1], num_points),
        velocity_limit=LIMIT_SHARE * velocity_limit,
        acceleration_limit=LIMIT_SHARE * acceleration_limit,
    )


def _eased(s_of_t: PPoly) -> PPoly:
    """A moving average of the progress, so that its acceleration has no jumps."""
    # At rest before the start and after the end.
    duration_s = s_of_t.x[-1] + _EASING_S
    time_s = np.linspace(0.0, duration_s, int(np.ceil(duration_s / _EASING_STEP_S)) + 1)
    before = _EASING_S * (np.arange(_EASING_SAMPLES) + 0.5) / _EASING_SAMPLES
    progress, terms = np.empty(len(time_s)), np.empty((len(time_s) - 1, 1, 4))
    averaged(Pieces.of_progress(s_of_t), time_s, before, progress)
    progress[[0, -1]] = s_of_t(s_of_t.x[[0, -1]])
    clamped(time_s[1], progress, terms[:, 0])
    return Pieces(time_s, terms).as_progress()


def _slowed(s_of_t: PPoly, factor: float) -> PPoly:
    """The same progress in `factor` times the time."""
    power = np.arange(len(s_of_t.c) - 1, -1, -1.0)[:, None]
    return PPoly(s_of_t.c / factor**power, s_of_t.x * factor)


def _sampled(path: BSpline, pieces: Pieces, s_of_t: PPoly, rate_hz: float) -> TimedPath:
    time_s = _times(s_of_t, rate_hz)
    s, q, v = np.empty(len(time_s)), *np.empty((2, len(time_s), path.c.shape[1]))
    follow(pieces, Pieces.of_progress(s_of_t), time_s, s, q, v)
    return TimedPath(time_s=time_s, s=s, q=q, v=v, path=path, s_of_t=s_of_t)


def _speed_shares(
    pieces: Pieces,
    s_of_t: PPoly,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
) -> tuple[float, float]:
    """As `speed_shares`, for samples of the path itself."""
    # The acceleration is often greatest at a knot: samples at 1 kHz that miss it err by up to 1e-3,
    # these by up to 1e-4.
    checks = max(_CHECKS_PER_PIECE, int(np.ceil(_CHECK_RATE_HZ * np.diff(s_of_t.x).max())))
    progress = Pieces.of_progress(s_of_t)
    return shares_along(pieces, progress, checks, velocity_limit, acceleration_limit)


def _times(s_of_t: PPoly, rate_hz: float) -> np.ndarray:
    """`(T,)` s, evenly spaced from 0 except for the last interval."""
    end_s = s_of_t.x[-1]
    return np.append(np.arange(0.0, end_s, 1.0 / rate_hz), end_s)


def _hull(path: BSpline) -> np.ndarray:
    """`(J,)` upper bound of the absolute value of each coordinate of a B-spline."""
    num_control = len(path.t) - path.k - 1
    return np.abs(path.c[:num_control]).max(axis=0)


def _checked_limit(name: str, limit: np.ndarray, path: BSpline) -> np.ndarray:
    limit, num_joints = np.asarray(limit, dtype=float), path.c.shape[1]
    if limit.shape != (num_joints,):
        raise ValueError(
            f"{name} has shape {limit.shape}: give ({num_joints},), one limit per joint"
        )
    if not np.all((limit > 0.0) & np.isfinite(limit)):
        raise ValueError(f"{name} is {limit.tolist()}: give a positive limit for each joint")
    return limit
