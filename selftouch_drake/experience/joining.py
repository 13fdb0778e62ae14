"""Joints and skin that were recorded apart, in rows or with clocks of their own, brought together.

Readings stay as they are, and joints are interpolated at their times: a joint moves smoothly, and
what presses may come and go from one reading to the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.experience.containers.contents import Clock
from selftouch_drake.experience.recording_error import RecordingError

# Joints that are farther apart in time than this many of their usual steps are not interpolated.
_FAR = 10.0
# A reading of another board of the skin counts up to this many of its usual steps away.
_NEAR = 1.5
# s: clocks of two senders that differ by more cannot be used together.
_SAME_CLOCK_S = 0.05
# Stamps that pass so much faster or slower than the times of arrival are of a simulated clock.
_PACE = 0.05
# s: what comes later by so much, and is older, was not overtaken: the clock was set back.
_OVERTAKEN_S = 1.0
# Steps of this share of a joint's range, and so rare, are the end of a turn.
_JUMP, _RARE = 0.5, 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stream:
    """Columns that were recorded together.

    Attributes:
        values: `(n, width)`.
        clock: the times of the n rows.
    """

    values: np.ndarray
    clock: Clock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Together:
    """Joints and skin at the times of the skin.

    Attributes:
        q: `(n, J)`, NaN where a joint is not known.
        readings: `(n, S)`, NaN where a board of the skin sent none.
        time_s: `(n,)` s.
        time_from: whose times these are.
        notes: what was done, in words.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray
    time_from: str
    notes: tuple[str, ...]


def together(joints: Sequence[Stream], skin: Sequence[Stream], source: str) -> Together:
    """Joints and readings at the times of the slowest board of the skin.

    Raises:
        RecordingError: the times of some streams do not overlap.
    """
    streams = [*joints, *skin]
    times, time_from, notes = _on_one_clock([stream.clock for stream in streams])
    slowest = min(skin, key=lambda stream: len(stream.values))
    at = times[streams.index(slowest)]
    order = np.argsort(at, kind="stable")
    order = order[np.isfinite(at[order])]
    at = at[order]
    for stream, time_s in zip(streams, times, strict=True):
        if _goes_back(time_s):
            raise RecordingError(
                f"{source} has times of {stream.clock.name} that begin again; write each piece to "
                "files of its own"
            )
        there = time_s[np.isfinite(time_s)]
        if not len(at) or not len(there) or there.max() <= at[0] or there.min() >= at[-1]:
            raise RecordingError(
                f"{source} has times of {slowest.clock.name} and of {stream.clock.name} that do "
                "not overlap; give them one clock, or record them together"
            )
    parts = list(zip(streams, times, strict=True))
    q = [interpolated(stream.values, time_s, at) for stream, time_s in parts[: len(joints)]]
    readings = [
        stream.values[order] if stream is slowest else _nearest(stream.values, time_s, at)
        for stream, time_s in parts[len(joints) :]
    ]
    names = ", ".join(dict.fromkeys(stream.clock.name for stream in joints))
    notes.append(
        f"{names} and {', '.join(dict.fromkeys(stream.clock.name for stream in skin))} have times "
        f"of their own: the joints are interpolated at the times of {slowest.clock.name}"
    )
    return Together(
        q=np.concatenate(q, axis=1),
        readings=np.concatenate(readings, axis=1),
        time_s=at,
        time_from=time_from,
        notes=tuple(notes),
    )


def _on_one_clock(clocks: Sequence[Clock]) -> tuple[list[np.ndarray], str, list[str]]:
    """`(n,)` s of each clock, by the stamps of the senders if these agree, else by arrival.

    Senders without a stamp, and those whose clocks differ, have nothing in common but arrival.
    """
    stamps = [clock.stamp_s for clock in clocks if clock.stamp_s is not None]
    if len(stamps) == len(clocks):
        behind = [
            float(np.nanmedian(clock.time_s - stamp))
            for clock, stamp in zip(clocks, stamps, strict=True)
        ]
        apart = max(behind) - min(behind)
        back = [
            clock.name for clock, stamp in zip(clocks, stamps, strict=True) if _goes_back(stamp)
        ]
        if back:
            note = f"stamps of {back[0]} begin again: the times of arrival are used"
            return [clock.time_s for clock in clocks], "the times of arrival", [note]
        if apart <= _SAME_CLOCK_S:
            return stamps, "the stamps of the messages", []
        note = f"stamps of the topics are {apart:.3g} s apart: the times of arrival are used"
        return [clock.time_s for clock in clocks], "the times of arrival", [note]
    without = [clock.name for clock in clocks if clock.stamp_s is None]
    if stamps:
        note = f"{', '.join(without)} has no stamps: the times of arrival are used{_pace(clocks)}"
        return [clock.time_s for clock in clocks], "the times of arrival", [note]
    whose = " and ".join(dict.fromkeys(clock.what for clock in clocks))
    return [clock.time_s for clock in clocks], whose, []


def _pace(clocks: Sequence[Clock]) -> str:
    """How fast the stamps of some sender pass, in words, if not as fast as the times of arrival."""
    for clock in clocks:
        if clock.stamp_s is None or not np.isfinite(clock.stamp_s).any():
            continue
        passed = np.ptp(clock.time_s[np.isfinite(clock.time_s)])
        pace = np.ptp(clock.stamp_s[np.isfinite(clock.stamp_s)]) / max(float(passed), 1e-9)
        if abs(pace - 1) > _PACE:
            return f", although the stamps of {clock.name} pass {pace:.3g} times as fast"
    return ""


def _goes_back(time_s: np.ndarray) -> bool:
    """Whether a clock was set back, by more than messages overtake each other."""
    there = time_s[np.isfinite(time_s)]
    return bool((np.diff(there) < -_OVERTAKEN_S).any())


def interpolated(values: np.ndarray, time_s: np.ndarray, at: np.ndarray) -> np.ndarray:
    """`(m, J)` joints at other times, each between those rows that have it.

    Args:
        values: `(n, J)`, NaN where a joint is missing.
        time_s: `(n,)` s, likewise.
        at: `(m,)` s.

    Returns:
        NaN where the rows before and after are far in time, or where a joint jumps between them, as
        an angle does at the end of a turn.
    """
    found = np.full((len(at), values.shape[1]), np.nan)
    for joint, column in enumerate(values.T):
        known = np.flatnonzero(np.isfinite(column) & np.isfinite(time_s))
        known = known[np.argsort(time_s[known], kind="stable")]
        times, positions = time_s[known], column[known].astype(float)
        if len(known) < 2:
            continue
        after = np.searchsorted(times, at, side="right").clip(1, len(known) - 1)
        near = (at >= times[0]) & (at <= times[-1])
        steps = np.diff(times)
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        near &= steps[after - 1] <= _FAR * max(usual, 1e-12)
        moves = np.abs(np.diff(positions))
        jumps = moves > _JUMP * np.ptp(positions)
        if jumps.mean() < _RARE:
            near &= ~jumps[after - 1]
        # What was read at just this time needs nothing between.
        exact = np.isin(at, times)
        chosen = near | exact
        found[chosen, joint] = np.interp(at[chosen], times, positions)
    return found


def _nearest(values: np.ndarray, time_s: np.ndarray, at: np.ndarray) -> np.ndarray:
    """`(m, S)` readings nearest to other times; NaN where none is near."""
    known = np.flatnonzero(np.isfinite(time_s))
    known = known[np.argsort(time_s[known], kind="stable")]
    times = time_s[known]
    after = np.searchsorted(times, at).clip(1, len(times) - 1)
    nearest = np.where(at - times[after - 1] <= times[after] - at, after - 1, after)
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else np.inf
    found = values[known[nearest]].astype(float)
    found[np.abs(times[nearest] - at) > _NEAR * usual] = np.nan
    return found


def joined_rows(
    q: np.ndarray,
    readings: np.ndarray,
    time_s: np.ndarray,
    complete: np.ndarray,
    chosen: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Interpolates `(n, J)` joints in place, if joints and skin are in rows of their own.

    Args:
        q: `(n, J)`, NaN where a joint is missing.
        readings: `(n, S)`, likewise.
        time_s: `(n,)` s, likewise.
        complete: `(n,)` bool, the rows that have all.
        chosen: `(n,)` bool, the rows that are asked for.

    Returns:
        The rows that are complete then, those that count as rows, which are those of the skin, and
        how many were interpolated; None if most rows of the skin have joints.
    """
    there = np.isfinite(time_s)
    joints_there = np.isfinite(q).all(axis=1) & there
    felt_there = np.isfinite(readings).all(axis=1) & there
    if 2 * complete.sum() >= felt_there.sum():
        return None
    rows = np.flatnonzero(chosen & felt_there & ~joints_there)
    filled = interpolated(q, time_s, time_s[rows])
    known = np.isfinite(filled).all(axis=1)
    rows, filled = rows[known], filled[known]
    if not len(rows):
        return None
    q[rows] = filled
    complete = complete.copy()
    complete[rows] = True
    return complete, chosen & (felt_there | ~joints_there), len(rows)


def pieces(episode: np.ndarray | None, chosen: np.ndarray) -> np.ndarray:
    """`(n,)` number of the piece of motion of each row, ascending.

    A piece ends with its file, its episode, and where rows were left out by choice.
    """
    num_rows = len(chosen)
    piece = np.zeros(num_rows) if episode is None else np.nan_to_num(episode[:num_rows])
    breaks = np.diff(piece, prepend=piece[:1]) != 0
    breaks[1:] |= ~chosen[:-1]
    return np.cumsum(breaks)
