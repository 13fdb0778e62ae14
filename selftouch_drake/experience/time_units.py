"""In which unit a column of numbers counts the time, where nothing but the numbers says so."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.readings.baseline import are_successive

#: s in which joints cross their range at a plausible speed: at most and at least.
CROSSING_S = (0.05, 3600.0)
# s from row to row: robots that move from row to row are recorded at 0.2 Hz to 10 kHz.
_STEP_S = (1e-4, 5.0)
# s from row to row of calendars, which leave no doubt about their unit if the step fits as well.
_CALENDAR_STEP_S = (1e-4, 60.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calendar:
    """A count since some year that programs use: what they count, and the values of this century.

    Attributes:
        note: what it counts, in words.
        unit_s: s in one count.
        least: in the year 2000.
        most: in the year 2100.
    """

    note: str
    unit_s: float
    least: float
    most: float


_CALENDARS = (
    Calendar(note="days since 1900", unit_s=86_400.0, least=36_526, most=73_051),
    Calendar(note="days since the year 0", unit_s=86_400.0, least=730_486, most=767_011),
    Calendar(note="100 ns since 1601", unit_s=1e-7, least=1.259e17, most=1.575e17),
    Calendar(note="100 ns since the year 1", unit_s=1e-7, least=6.308e17, most=6.625e17),
)


def calendar_of(counts: np.ndarray) -> Calendar | None:
    """The calendar of Excel, MATLAB, Windows or .NET in which `(n,)` numbers count, if any."""
    if len(counts) < 2:
        return None
    steps = np.diff(np.sort(counts))
    steps = steps[steps > 0]
    if not len(steps):
        return None
    middle, step = float(np.median(counts)), float(np.median(steps))
    least, most = _CALENDAR_STEP_S
    for calendar in _CALENDARS:
        fits = calendar.least <= middle < calendar.most
        # Seconds since a computer was started may be as many, but come in longer steps.
        if fits and least <= step * calendar.unit_s <= most:
            return calendar
    return None


def crossing(q: np.ndarray, times: np.ndarray) -> float:
    """Time in which joints cross their range at their fastest, as a median; nan if none moves.

    Args:
        q: `(n, J)`, in the order of time.
        times: `(n,)` in any unit.
    """
    dt = np.diff(times)
    forwards = np.isfinite(dt) & (dt > 0)
    reach = np.ptp(q, axis=0)
    if not forwards.any() or not (reach > 0).any():
        return np.nan
    speeds = np.abs(np.diff(q[:, reach > 0], axis=0))[forwards] / dt[forwards, None]
    fast = np.quantile(speeds, 0.99, axis=0)
    return float(np.median(reach[reach > 0][fast > 0] / fast[fast > 0])) if fast.any() else np.nan


def unit_by_speeds(
    counts: np.ndarray, joints: np.ndarray, units: Sequence[tuple[str, float]]
) -> str | None:
    """The only unit in which rows come and joints move as those of a robot; None if several do.

    Args:
        counts: `(n,)`, NaN where one is missing.
        joints: `(n, J)`, likewise.
        units: names and seconds in each.

    Returns:
        None as well where joints jump from row to row, as in postures that were recorded one by
        one, and where times are the numbers of rows: then nothing says how fast they move.
    """
    there = np.isfinite(counts) & np.isfinite(joints).all(axis=1)
    order = np.argsort(counts[there], kind="stable")
    times, q = counts[there][order], joints[there][order].astype(float)
    if len(times) < 100 or not are_successive(q):
        return None
    steps = np.diff(times)
    # Numbers of rows, and times whose digits were cut off.
    if (np.abs(steps - 1) < 1e-6).all() or (steps > 0).mean() < 0.5:
        return None
    step, across = float(np.median(steps[steps > 0])), crossing(q, times)
    if not np.isfinite(across):
        return None
    plausible = [
        name
        for name, seconds in units
        if _STEP_S[0] <= step * seconds <= _STEP_S[1]
        and CROSSING_S[0] <= across * seconds <= CROSSING_S[1]
    ]
    return plausible[0] if len(plausible) == 1 else None
