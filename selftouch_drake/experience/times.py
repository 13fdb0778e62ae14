"""Times of recordings in seconds, and the rows of a recording in the order of time.

Other people's clocks count in s, ms, us or ns, from zero or from 1970, or write dates.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from selftouch_drake.experience.columns import numbers_in
from selftouch_drake.experience.containers.contents import Column
from selftouch_drake.experience.dates import counted, written_dates
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.store import one_chunk
from selftouch_drake.experience.time_units import calendar_of, unit_by_speeds
from selftouch_drake.experience.units import named

#: Seconds in each unit that `--time-unit` takes.
SECONDS_IN = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Seconds since 1970 in the years 2001 to 2096: other units have three more digits each.
_EPOCH_S = (1e9, 4e9)
# s: a median step above this that is not known to be in seconds may be in any unit. Robots record
# touches at 5 Hz to 2 kHz: each step is 0.0005 to 0.2 in s, and 0.5 to 200 in ms.
_LONGEST_STEP_S = 0.4
# A pause of this many median steps, and at least so many seconds, is a gap.
_GAP_STEPS, _GAP_S = 20.0, 0.5
# Steps back in more than this share of the rows: they are out of order, and not started again.
_SHUFFLED = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Times:
    """The times of a file.

    Attributes:
        time_s: `(n,)` s; NaN where one is missing.
        note: what they were, if not seconds; else empty.
        origin_s: s since 1970, or since whenever this clock began, at which `time_s` is 0.
    """

    time_s: np.ndarray
    note: str
    origin_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InOrder:
    """The rows of a file in the order of time.

    Attributes:
        order: `(n,)` row of the file for each row in order.
        breaks: `(n,)` bool, whether a new piece of motion begins with a row in order.
        num_gaps: number of pauses.
        num_restarts: how often the clock began again.
        num_moved: number of rows that were not in order.
    """

    order: np.ndarray
    breaks: np.ndarray
    num_gaps: int
    num_restarts: int
    num_moved: int


def in_seconds(
    column: Column,
    name: str,
    what: str,
    unit: str | None,
    joints: np.ndarray | None = None,
) -> Times:
    """A column of times in seconds; errors call it `what`.

    Args:
        column: numbers or dates.
        name: of the column, which may state a unit.
        what: how errors call it.
        unit: `s`, `ms`, `us` or `ns`; by default that in the name or, since 1970, that of which
            there are as many, or the only one in which joints move neither too fast nor too slowly.
        joints: `(n, J)` motor configurations of the same rows, if there are any.

    Returns:
        Dates and times since some year are counted from the first row.

    Raises:
        RecordingError: these are no times, or their unit cannot be known.
    """
    dates = _dates(column)
    if dates is not None:
        counts, first_ns = dates
        return Times(time_s=counts * 1e-9, note="dates", origin_s=first_ns * 1e-9)
    try:
        counts = numbers_in(column, what)
    except RecordingError:
        raise RecordingError(
            f"{what} holds no times: give numbers or dates such as 2026-05-01 10:00:00.02, another "
            "column by --time, or --time none"
        ) from None
    counts = counts.reshape(len(counts), -1) if counts.ndim > 1 else counts[:, None]
    if counts.shape[1] != 1 and counts.shape[0] == 1:
        counts = counts.T
    counts = counts[:, 0]
    there = counts[np.isfinite(counts)]
    since_1970 = _unit_since_1970(there)
    if since_1970 and _median_step(there.astype(float)) * SECONDS_IN[since_1970] > _LONGEST_STEP_S:
        # Microseconds since a computer was started may look like seconds since 1970.
        since_1970 = None
    stated = named(name)
    if unit is None:
        unit = since_1970 or (stated.unit if stated.kind == "s" else None)
    factor = SECONDS_IN.get(unit or "s", stated.factor)
    if unit is None and (calendar := calendar_of(there)):
        seconds = (counts - there[0]).astype(float) * calendar.unit_s
        return Times(time_s=seconds, note=calendar.note, origin_s=float(there[0]) * calendar.unit_s)
    if since_1970:
        first = there[0]
        wide = counts.astype(float) if counts.dtype.kind == "f" else counts.astype(np.int64)
        seconds = (wide - wide.dtype.type(first)).astype(float) * factor
        return Times(time_s=seconds, note=f"{unit} since 1970", origin_s=float(first) * factor)
    seconds = counts.astype(float) * factor
    step = _median_step(seconds[np.isfinite(seconds)])
    if unit is None and step > _LONGEST_STEP_S:
        found = (
            None if joints is None else unit_by_speeds(seconds, joints, tuple(SECONDS_IN.items()))
        )
        if found is not None:
            note = f"taken for {found}, in which alone the joints move as joints do"
            return Times(time_s=seconds * SECONDS_IN[found], note=note)
        if counts.dtype == np.float32 and np.mean(np.diff(there) == 0) > 0.5:
            raise RecordingError(
                f"{what} has times that are rounded to {step:g}, as 32 bits are too few: write 64, "
                "or give --time none"
            )
        raise RecordingError(
            f"{what} has steps of {step:g}, in an unknown unit: give --time-unit s, ms, us or ns, "
            "or --time none"
        )
    return Times(time_s=seconds, note="" if unit in (None, "s") else f"in {unit}")


def joined_counts(seconds: np.ndarray, nanoseconds: np.ndarray) -> np.ndarray:
    """`(n,)` ns, of stamps in two columns: whole seconds and the nanoseconds beyond them."""
    whole = np.nan_to_num(seconds).astype(np.int64) * 1_000_000_000
    return whole + np.nan_to_num(nanoseconds).astype(np.int64)


def in_order(time_s: np.ndarray, piece: np.ndarray) -> InOrder:
    """The rows of `(n,)` finite times in order, within each of the pieces of motion.

    A clock that begins again begins a new piece, and so does a gap; single rows that are out of
    order are put in order.
    """
    order = np.arange(len(time_s))
    breaks = np.diff(piece, prepend=piece[:1]) != 0
    num_restarts = num_moved = num_gaps = 0
    step = _median_step(time_s)
    pause = max(_GAP_STEPS * step, _GAP_S)
    ends = [*np.flatnonzero(breaks).tolist(), len(time_s)]
    first = 0
    for end in ends:
        times = time_s[first:end]
        back = np.flatnonzero(np.diff(times) < 0)
        if len(back):
            far = back[(times[back] - times[back + 1]) > pause]
            shuffled = len(back) > _SHUFFLED * len(times)
            starts = [0, *([] if shuffled else (far + 1).tolist()), len(times)]
            for start, stop in pairwise(starts):
                rows = np.argsort(times[start:stop], kind="stable") + start
                num_moved += int((np.diff(times[start:stop]) < 0).sum())
                order[first + start : first + stop] = first + rows
                breaks[first + start] |= start > 0
            num_restarts += len(starts) - 2
        first = end
    later = np.diff(time_s[order], prepend=time_s[order][:1]) > pause
    num_gaps = int((later & ~breaks).sum())
    return InOrder(
        order=order,
        breaks=breaks | later,
        num_gaps=num_gaps,
        num_restarts=num_restarts,
        num_moved=num_moved,
    )


def _median_step(times: np.ndarray) -> float:
    """The usual step forwards between times, whatever their order; 0 if there is none."""
    steps = np.diff(times)
    if np.count_nonzero(steps < 0) > _SHUFFLED * len(steps):
        steps = np.diff(np.sort(times))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


def _unit_since_1970(counts: np.ndarray) -> str | None:
    """The unit in which numbers count from 1970, if they do."""
    if not len(counts):
        return None
    middle = float(np.median(counts))
    for unit, seconds in SECONDS_IN.items():
        if _EPOCH_S[0] <= middle * seconds < _EPOCH_S[1]:
            return unit
    return None


def _dates(column: Column) -> tuple[np.ndarray, int] | None:
    """`(n,)` ns from the first date, NaN where one is missing, and ns of that since 1970.

    None if these are no dates.
    """
    if isinstance(column, np.ndarray):
        if column.dtype.kind == "U":
            return written_dates(column.ravel())
        if column.dtype.kind not in "Mm":
            return None
        unit = "datetime64[ns]" if column.dtype.kind == "M" else "timedelta64[ns]"
        return counted(column.ravel().astype(unit))
    kind = column.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return written_dates(np.array(column.fill_null("").to_pylist(), dtype=str))
    if pa.types.is_time(kind):
        wide = one_chunk(column).cast(pa.time64("ns")).cast(pa.int64()).cast(pa.duration("ns"))
        return counted(wide.to_numpy(zero_copy_only=False))
    if pa.types.is_timestamp(kind):
        column = pc.cast(column, pa.timestamp("ns", kind.tz))
    elif pa.types.is_duration(kind):
        column = pc.cast(column, pa.duration("ns"))
    else:
        return None
    return counted(one_chunk(column).to_numpy(zero_copy_only=False))
