"""From a geometric path to a motion within the limits of the joints.

The fastest progress along the path (`fastest`) is eased, so that its acceleration has no jumps, and
slowed down where a limit is still exceeded.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PPoly

from selftouch_drake.agent.planning.fastest import fastest_progress
from selftouch_drake.compiled import compiled

#: The solver respects limits only at grid points; between them they are exceeded by up to 25 %.
LIMIT_SHARE = 0.8
# mu of scaled path length between grid points. A grid twice as fine saves 0.5 % of the duration.
_GRID_SPACING = 0.07
#: s; a longer motion is refused, because its limits are probably a mistake.
LONGEST_S = 600.0
# A motion that exceeds limits is slowed down by this factor more than needed, because the check of
# the path looks at samples only: at this rate, and so many at least.
_CHECK_MARGIN = 1.01
_CHECK_RATE_HZ = 300.0
_FEWEST_CHECKS = 200
# s over which the progress is averaged. The acceleration of the fastest progress jumps, and with it
# the tracking error of the robot; after averaging it ramps.
_EASING_S = 0.06
#: s, from full speed to rest: at 1 rad/s that is 2.5 rad/s², half of what plans may use.
BRAKING_S = 0.4
# s, between two samples of a motion that is slowed down.
_BRAKING_STEP_S = 0.01
# s, duration of a path of length 0.
_REST_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedPath:
    """A motion along a path, at rest at both ends.

    Attributes:
        time_s: `(T,)` s, from 0, evenly spaced except for the last interval.
        s: `(T,)` mu, scaled length along the path.
        q: `(T, J)` rad or m.
        v: `(T, J)` rad/s or m/s.
        s_of_t: path length as a function of time.
    """

    time_s: np.ndarray
    s: np.ndarray
    q: np.ndarray
    v: np.ndarray
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
        path: clamped B-spline of `(J,)` rad or m over scaled path length in mu.
        velocity_limit: `(J,)` rad/s or m/s, the largest speed of each joint.
        acceleration_limit: `(J,)` rad/s^2 or m/s^2, likewise.
        rate_hz: Hz, rate of the samples.

    Raises:
        ValueError: a limit or the rate is not positive, there is not one limit per joint, or the
            limits are so low that the motion would last longer than `LONGEST_S`.
    """
    velocity_limit = _checked_limit("velocity_limit", velocity_limit, path)
    acceleration_limit = _checked_limit("acceleration_limit", acceleration_limit, path)
    if not 0.0 < rate_hz < np.inf:
        raise ValueError(f"rate_hz is {rate_hz}: give a positive number")

    limits = velocity_limit, acceleration_limit
    pieces = _pieces(path)
    num_points = max(20, int(np.ceil(np.ptp(path.t) / _GRID_SPACING)))
    grid = np.linspace(path.t[0], path.t[-1], num_points)
    fastest = fastest_progress(
        path,
        grid,
        velocity_limit=LIMIT_SHARE * velocity_limit,
        acceleration_limit=LIMIT_SHARE * acceleration_limit,
    )
    s_of_t = _quintic(path) if fastest is None else _eased(fastest)
    # The acceleration is often greatest at a knot: samples at 1 kHz that miss it err by up to 1e-3,
    # these by up to 1e-4.
    end_s = s_of_t.x[-1]
    num = max(_FEWEST_CHECKS, int(_CHECK_RATE_HZ * min(end_s, LONGEST_S)))
    checked_s = np.sort(np.concatenate([s_of_t.x, np.linspace(0.0, end_s, num)]))
    _, _, v, a = _followed(pieces, s_of_t, checked_s)
    # By what factor the motion must take longer so that the path keeps to the limits.
    least = max((abs(v) / velocity_limit).max(), math.sqrt((abs(a) / acceleration_limit).max()))
    while True:
        end_s = s_of_t.x[-1]
        if end_s > LONGEST_S:
            raise ValueError(
                f"the motion would take {end_s:.3g} s, more than {LONGEST_S:g} s: "
                "raise max_velocity or max_acceleration"
            )
        time_s = np.append(np.arange(0.0, end_s, 1.0 / rate_hz), end_s)
        s, q, v, _ = _followed(pieces, s_of_t, time_s)
        velocity, acceleration = speed_shares(time_s, q, v, *limits)
        load = max(least, velocity, math.sqrt(acceleration))
        if load <= 1.0:
            return TimedPath(time_s=time_s, s=s, q=q, v=v, s_of_t=s_of_t)
        slower = _CHECK_MARGIN * load
        power = np.arange(len(s_of_t.c) - 1, -1, -1.0)[:, None]
        s_of_t = PPoly(s_of_t.c / slower**power, s_of_t.x * slower)
        least /= slower


def braking(now: float, end_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How a motion slows down to a stop on its own path, from a time of its own on.

    Returns:
        `(N,)` s from 0 to `BRAKING_S`; `(N,)` s of the motion's own time then, which goes on ever
        more slowly, at most to its end; `(N,)` its rate, 1 to 0.
    """
    since = np.linspace(0.0, BRAKING_S, round(BRAKING_S / _BRAKING_STEP_S) + 1)
    at = (now + since - since**2 / (2 * BRAKING_S)).clip(0.0, end_s)
    return since, at, 1.0 - since / BRAKING_S


def _pieces(path: BSpline) -> PPoly:
    ends = path.t[path.k : len(path.t) - path.k]
    powers = range(path.k, -1, -1)
    return PPoly(np.stack([path(ends[:-1], n) / math.factorial(n) for n in powers]), ends)


def speed_shares(
    time_s: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    velocity_limit: np.ndarray,
    acceleration_limit: np.ndarray,
) -> tuple[float, float]:
    """Shares of the limits that a motion uses, exactly: cubic between `(T,)` s, with `(T, J)` q, v.

    The limits are `(J,)` rad/s or m/s, and rad/s^2 or m/s^2. Returns the largest shares of velocity
    and acceleration of any joint; 1 is the limit.
    """
    # On each cubic piece the acceleration is linear, from gain + bend to gain - bend; where it is
    # 0, the velocity is greatest.
    step, start = np.diff(time_s)[:, None], v[:-1]
    gain = np.diff(v, axis=0) / step
    bend = (6 * np.diff(q, axis=0) / step - 3 * (start + v[1:])) / step
    to_turn, turns = np.zeros_like(bend), np.abs(bend) > np.abs(gain)
    np.divide(np.square(gain + bend) * step, 4 * bend, out=to_turn, where=turns)
    speed = max((np.abs(each) / velocity_limit).max() for each in (v, start + to_turn))
    rise = ((np.abs(gain) + np.abs(bend)) / acceleration_limit).max()
    return float(speed), float(rise)


def _quintic(path: BSpline) -> PPoly:
    """The progress s(t) of a quintic from rest to rest, as short as for a path of length 0."""
    quintic = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / _REST_S ** np.arange(6)
    progress = np.ptp(path.t) * quintic + path.t[0] * np.eye(6)[0]
    return PPoly(progress[::-1, None], [0.0, _REST_S])


def _eased(s_of_t: PPoly) -> PPoly:
    """A moving average of the progress, so that its acceleration has no jumps."""
    # The speed is linear on each piece, and zero before and after. So the mean's acceleration is
    # linear between these times; its integrals are exact.
    ends, speed = s_of_t.x, np.append(s_of_t.c[1], 0.0)
    time_s = np.unique(np.concatenate([ends, ends + _EASING_S]))
    gained = np.interp(time_s, ends, speed) - np.interp(time_s - _EASING_S, ends, speed)
    step, rise = np.diff(time_s), gained / _EASING_S
    speed = np.cumsum([0.0, *step * (rise[1:] + rise[:-1]) / 2])
    gone = step * (speed[:-1] + step * (2 * rise[:-1] + rise[1:]) / 6)
    s = np.cumsum([s_of_t.c[2, 0], *gone])
    pieces = [np.diff(rise) / step / 6, rise[:-1] / 2, speed[:-1], s[:-1]]
    return PPoly(np.stack(pieces), time_s)


def _followed(path: PPoly, s_of_t: PPoly, time_s: np.ndarray) -> tuple[np.ndarray, ...]:
    """`(T,)` length along the path at rising times, `(T, J)` q, velocity and acceleration there."""
    s, motion = np.empty(len(time_s)), np.empty((3, len(time_s), path.c.shape[2]))
    _follow(path.x, path.c, s_of_t.x, s_of_t.c, time_s, s, *motion)
    return s, *motion


@compiled
def _follow(path_ends, path, progress_ends, progress, time_s, s, q, v, a):
    piece, part, farthest = 0, 0, path_ends[0]
    for i in range(len(time_s)):
        while part < progress.shape[1] - 1 and time_s[i] >= progress_ends[part + 1]:
            part += 1
        away = time_s[i] - progress_ends[part]
        along = speed = rise = 0.0
        for power in range(len(progress)):
            rise = rise * away + 2 * speed
            speed = speed * away + along
            along = along * away + progress[power, part]
        # A motion never goes back.
        farthest = s[i] = max(farthest, min(along, path_ends[-1]))
        while piece < path.shape[1] - 1 and farthest >= path_ends[piece + 1]:
            piece += 1
        away = farthest - path_ends[piece]
        for joint in range(path.shape[2]):
            place = slope = bend = 0.0
            for power in range(len(path)):
                bend = bend * away + 2 * slope
                slope = slope * away + place
                place = place * away + path[power, piece, joint]
            q[i, joint], v[i, joint] = place, slope * speed
            a[i, joint] = bend * speed**2 + slope * rise


def _checked_limit(name: str, limit: np.ndarray, path: BSpline) -> np.ndarray:
    limit, num_joints = np.asarray(limit, dtype=float), path.c.shape[1]
    if limit.shape != (num_joints,) or not np.all((limit > 0.0) & np.isfinite(limit)):
        raise ValueError(
            f"{name} is {limit.tolist()}: give {num_joints} positive limits, one per joint"
        )
    return limit
