"""From a geometric path to a motion within the limits of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline, CubicSpline, PPoly

from selftouch_drake.agent.planning.fastest import fastest_progress

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
# s, duration of a path of length 0.
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


def time_path(
    path: BSpline,
    *,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
    rate_hz: float = 100.0,
) -> TimedPath:
    """Follows a path as fast as the joints' limits allow, from rest to rest.

    Uses time-optimal path parameterization, with an acceleration that is smoothed in time, or a
    quintic time scaling if that fails. If a limit is still exceeded anywhere, on the path or on the
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
    s_of_t = _quintic(path) if fastest is None else _eased(fastest)
    while True:
        _require_bearable(s_of_t.x[-1])
        timed = _sampled(path, s_of_t, rate_hz)
        limits = velocity_limit, acceleration_limit
        shares = np.maximum(
            _speed_shares(path, s_of_t, *limits),
            speed_shares(timed.time_s, timed.q, timed.v, *limits),
        )
        excess = max(shares[0], np.sqrt(shares[1]))
        if excess <= 1.0:
            return timed
        s_of_t = _slowed(s_of_t, _CHECK_MARGIN * excess)


def commanded(time_s: np.ndarray, q: np.ndarray, v: np.ndarray) -> CubicHermiteSpline:
    """What the joints are commanded between the samples of a motion.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
    """
    return CubicHermiteSpline(time_s, q, v)


def speed_shares(
    time_s: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
) -> tuple[float, float]:
    """Shares of the limits that a commanded motion uses, exactly; 1 is the limit.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
        velocity_limit: `(J,)` rad/s or m/s.
        acceleration_limit: `(J,)` rad/s^2 or m/s^2.

    Returns:
        The largest share of the velocity and of the acceleration that is allowed, of any joint.
    """
    # On each cubic piece the acceleration is linear; where it is 0, the velocity is greatest.
    step, start, end = np.diff(time_s)[:, None], v[:-1], v[1:]
    mean = np.diff(q, axis=0) / step
    first, last = (6 * mean - 4 * start - 2 * end) / step, (2 * start + 4 * end - 6 * mean) / step
    turns = first * last < 0
    inside = first**2 / np.where(turns, first - last, np.inf) * step / 2
    speed = np.abs([start, end, np.where(turns, start + inside, 0.0)]).max(axis=(0, 1))
    rise = np.abs([first, last]).max(axis=(0, 1))
    return float((speed / velocity_limit).max()), float((rise / acceleration_limit).max())


def _quintic(path: BSpline) -> PPoly:
    """The progress s(t) of a quintic from rest to rest, as short as for a path of length 0."""
    quintic = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / _REST_S ** np.arange(6)
    progress = np.ptp(path.t) * quintic + path.t[0] * np.eye(6)[0]
    return PPoly(progress[::-1, None], [0.0, _REST_S])


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
    progress = s_of_t((time_s[:, None] - before).clip(0.0, s_of_t.x[-1])).mean(axis=1)
    progress[[0, -1]] = s_of_t(s_of_t.x[[0, -1]])
    return CubicSpline(time_s, progress, bc_type="clamped")


def _slowed(s_of_t: PPoly, factor: float) -> PPoly:
    """The same progress in `factor` times the time."""
    power = np.arange(len(s_of_t.c) - 1, -1, -1.0)[:, None]
    return PPoly(s_of_t.c / factor**power, s_of_t.x * factor)


def _sampled(path: BSpline, s_of_t: PPoly, rate_hz: float) -> TimedPath:
    time_s = _times(s_of_t, rate_hz)
    # A motion never goes back.
    s = np.maximum.accumulate(s_of_t(time_s).clip(path.t[0], path.t[-1]))
    q, v = path(s), path(s, 1) * s_of_t(time_s, 1)[:, None]
    return TimedPath(time_s=time_s, s=s, q=q, v=v, path=path, s_of_t=s_of_t)


def _speed_shares(
    path: BSpline, s_of_t: PPoly, velocity_limit: np.ndarray, acceleration_limit: np.ndarray
) -> tuple[float, float]:
    """As `speed_shares`, for samples of the path itself."""
    # The acceleration is often greatest at a knot: samples at 1 kHz that miss it err by up to 1e-3,
    # these by up to 1e-4.
    step = np.diff(s_of_t.x)
    checks = max(_CHECKS_PER_PIECE, int(np.ceil(_CHECK_RATE_HZ * step.max())))
    time_s = s_of_t.x[:-1, None] + step[:, None] * np.arange(checks) / checks
    time_s = np.append(time_s, s_of_t.x[-1])
    s = s_of_t(time_s).clip(path.t[0], path.t[-1])
    speed, rise = s_of_t(time_s, 1)[:, None], s_of_t(time_s, 2)[:, None]
    v = path(s, 1) * speed
    a = path(s, 2) * speed**2 + path(s, 1) * rise
    return float((abs(v) / velocity_limit).max()), float((abs(a) / acceleration_limit).max())


def _times(s_of_t: PPoly, rate_hz: float) -> np.ndarray:
    """`(T,)` s, evenly spaced from 0 except for the last interval."""
    end_s = s_of_t.x[-1]
    return np.append(np.arange(0.0, end_s, 1.0 / rate_hz), end_s)


def _checked_limit(name: str, limit: np.ndarray, path: BSpline) -> np.ndarray:
    limit, num_joints = np.asarray(limit, dtype=float), path.c.shape[1]
    if limit.shape != (num_joints,):
        raise ValueError(
            f"{name} has shape {limit.shape}: give ({num_joints},), one limit per joint"
        )
    if not np.all((limit > 0.0) & np.isfinite(limit)):
        raise ValueError(f"{name} is {limit.tolist()}: give a positive limit for each joint")
    return limit
