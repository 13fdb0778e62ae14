"""One file of a recording: its columns are chosen, brought together, and put in order of time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from selftouch_drake.experience.choice import Choice, Taken, Wanted, upright
from selftouch_drake.experience.clocks import own_clocks, times_of
from selftouch_drake.experience.containers.contents import Clock, Contents
from selftouch_drake.experience.joining import Stream, joined_rows, pieces, together
from selftouch_drake.experience.recorded import Recording
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.times import in_order
from selftouch_drake.experience.usual_names import EPISODE_NAMES

# Pieces of motion are numbered from here on in each further file.
_PIECES_PER_FILE = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Joints and readings of the same rows.

    Attributes:
        q: `(n, J)`, NaN where a joint is missing.
        readings: `(n, S)`, likewise.
        time_s: `(n,)` s, likewise; None without times.
        time_names: the columns of times.
        time_from: what the times are, in words; empty without.
        notes: what was done, in words.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray | None
    time_names: Sequence[str] = ()
    time_from: str = ""
    notes: tuple[str, ...] = ()


def recorded(contents: Contents, source: Path, wanted: Wanted, number: int) -> Recording:
    """What the file with this number of a recording holds.

    Raises:
        RecordingError: a column does not exist, or shapes disagree.
    """
    choice = Choice(contents, str(source), wanted)
    q = choice.taken("--q", wanted.q)
    touch = choice.taken("--sensation", wanted.sensation)
    if both := sorted({*q.names} & {*touch.names}):
        raise RecordingError(
            f"column {both[0]} of {source} is taken for --q and for --sensation; name the columns "
            "of each"
        )
    q, touch = map(choice.labelled, upright(q, touch))
    rows = _without_empty(_rows(contents, choice, source, wanted, q, touch), source, q, touch)
    num_rows = len(rows.q)
    configurations = rows.q
    chosen = choice.meeting(wanted.rows, num_rows)
    piece = pieces(choice.single(EPISODE_NAMES, num_rows), chosen)
    notes = [*contents.notes, *q.notes, *touch.notes, *rows.notes]
    complete = np.isfinite(configurations).all(axis=1) & np.isfinite(rows.readings).all(axis=1)
    if rows.time_s is not None:
        complete &= np.isfinite(rows.time_s)
        apart = joined_rows(configurations, rows.readings, rows.time_s, complete, chosen)
        if apart is not None:
            complete, chosen, num_filled = apart
            notes.append(
                "joints and skin are in rows of their own: the joints are interpolated in "
                f"{num_filled:,} rows of the skin"
            )
    kept = np.flatnonzero(complete & chosen)
    num_gaps, piece = 0, piece[kept]
    if rows.time_s is not None:
        found = in_order(rows.time_s[kept], piece)
        kept, piece, num_gaps = kept[found.order], np.cumsum(found.breaks), found.num_gaps
        if found.num_restarts:
            notes.append(f"the clock starts again {found.num_restarts:,} times")
        if found.num_moved:
            notes.append(f"{found.num_moved:,} rows are earlier than those before: sorted")
    taken = {*q.names, *touch.names, *EPISODE_NAMES, *rows.time_names}
    return Recording(
        q=configurations[kept],
        readings=rows.readings[kept],
        time_s=None if rows.time_s is None else rows.time_s[kept],
        piece=number * _PIECES_PER_FILE + piece,
        row=kept,
        num_read=num_rows,
        joints=tuple(q.labels),
        receptors=tuple(touch.labels),
        num_rows=int(chosen.sum()) + contents.num_broken,
        num_incomplete=int((chosen & ~complete).sum()) + contents.num_broken,
        choices=choice.choices(taken, num_rows),
        unused=choice.unused(taken),
        notes=tuple(notes),
        time_from=rows.time_from,
        num_gaps=num_gaps,
    )


def _rows(
    contents: Contents, choice: Choice, source: Path, wanted: Wanted, q: Taken, touch: Taken
) -> _Rows:
    """Joints and readings of the same rows, interpolated where they have clocks of their own."""
    asked = wanted.time
    if asked not in (None, "none"):
        choice.require("--time", asked)
    clocks = {}
    if asked is None or contents.clocks:
        clocks = own_clocks(contents, str(source), q.names, touch.names, wanted.time_unit)
    if len({id(clocks.get(name)) for name in (*q.names, *touch.names)}) > 1:
        if asked == "none":
            raise RecordingError(
                f"--time is none; joints and skin of {source} were recorded apart, and times alone "
                "bring them together: leave it out"
            )
        joined = together(_streams(q, clocks), _streams(touch, clocks), str(source))
        return _Rows(
            q=joined.q,
            readings=joined.readings,
            time_s=joined.time_s,
            time_names=[clocks[name].name for name in (*q.names, *touch.names)],
            time_from=joined.time_from,
            notes=joined.notes,
        )
    configurations, readings = q.joined(), touch.joined()
    num_rows = len(configurations)
    _require_length(source, "sensation", readings, num_rows)
    if asked == "none":
        return _Rows(q=configurations, readings=readings, time_s=None)
    if clocks:
        clock = clocks[q.names[0]]
        time_s = clock.time_s if clock.stamp_s is None else clock.stamp_s
        what = clock.what if clock.stamp_s is None else "the stamps of the messages"
        return _Rows(q=configurations, readings=readings, time_s=time_s, time_from=what)
    names, times = times_of(contents, str(source), asked, wanted.time_unit, configurations)
    if times is None:
        return _Rows(q=configurations, readings=readings, time_s=None)
    _require_length(source, "time", times.time_s, num_rows)
    return _Rows(
        q=configurations,
        readings=readings,
        time_s=times.time_s,
        time_names=names,
        time_from=", ".join(filter(None, [f"column {names[0]}", times.note])),
    )


def _without_empty(rows: _Rows, source: Path, q: Taken, touch: Taken) -> _Rows:
    """Rows in which a receptor that holds no number at all is dead: 0 throughout.

    Raises:
        RecordingError: a joint holds no number.
    """
    empty = ~np.isfinite(rows.q).any(axis=0)
    if empty.any() and not empty.all():
        name = np.array(q.labels)[empty][0]
        raise RecordingError(f"joint {name} of {source} holds no number; leave it out by --q")
    empty = ~np.isfinite(rows.readings).any(axis=0)
    if not empty.any() or empty.all():
        return rows
    readings = rows.readings.copy()
    readings[:, empty] = 0
    names = np.array(touch.labels)[empty].tolist()
    note = f"{len(names)} receptors ({', '.join(names[:3])}) hold no number, and count as dead"
    return replace(rows, readings=readings, notes=(*rows.notes, note))


def _streams(taken: Taken, clocks: Mapping[str, Clock]) -> list[Stream]:
    return [
        Stream(values=part, clock=clocks[name])
        for name, part in zip(taken.names, taken.parts, strict=True)
    ]


def _require_length(source: Path, name: str, rows: np.ndarray, num_rows: int) -> None:
    """Raises a `RecordingError` if there are not as many rows as of q."""
    if len(rows) != num_rows:
        raise RecordingError(
            f"{source} has {num_rows} rows of q and {len(rows)} of {name}; record them together, "
            "or give each times of its own"
        )
