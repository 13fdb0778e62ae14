"""Rows of a recording that are no readings are left out, and columns that are no joints."""

from dataclasses import replace

import numpy as np

from selftouch_drake.agent.readings.baseline import are_successive
from selftouch_drake.agent.readings.faults import (
    frozen_rows,
    held_every,
    jumping_rows,
    lost_boards,
    marks_of_nothing,
    velocities,
)
from selftouch_drake.agent.readings.turns import wrapping
from selftouch_drake.experience.recorded import Recording
from selftouch_drake.experience.recording_error import RecordingError


def without_faults(recording: Recording) -> Recording:
    """Leaves out what is no measurement, and says so in the recording's notes and counts.

    Raises:
        RecordingError: hardly anything would be left.
    """
    found = _without_marks(recording)
    found = found.without(lost_boards(found.readings), "a part of the skin is lost at once")
    found = _without_velocities(found)
    follows = found.follows
    found = replace(found, turn=wrapping(found.q, follows))
    if are_successive(found.q.astype(float)):
        assert found.turn is not None
        jumps = jumping_rows(found.q, follows, found.turn)
        if jumps.mean() < 0.2:
            found = found.without(jumps, "a joint jumps away and back")
        found = _without_held(found, "skin", found.readings, found.q)
        found = _without_held(found, "joints", found.q, found.readings)
        frozen = frozen_rows(found.readings, found.q, found.follows)
        found = found.without(frozen, "the skin stands still for a while, and the joints move")
    return found


def _without_marks(recording: Recording) -> Recording:
    """Leaves out rows in which a mark stands for a missing number.

    Receptors that hardly read anything else count as dead.

    Raises:
        RecordingError: most rows have one.
    """
    readings, notes = recording.readings, list(recording.notes)
    marks = marks_of_nothing(readings)
    marked = np.isin(readings, marks) if marks else np.zeros(readings.shape, dtype=bool)
    gone = marked.mean(axis=0) > 0.5
    if gone.any():
        names = [recording.receptors[number] for number in np.flatnonzero(gone)]
        notes.append(
            f"{len(names)} receptors ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''}) "
            "read nothing but a mark in most rows"
        )
        readings = readings.copy()
        readings[:, gone], marked[:, gone] = 0, False
    joints = [marks_of_nothing(one[:, None]) for one in recording.q.T]
    at_joints = np.column_stack(
        [np.isin(one, found) for one, found in zip(recording.q.T, joints, strict=True)]
    )
    rows = np.asarray(marked.any(axis=1) | at_joints.any(axis=1))
    values = sorted({*marks, *(value for found in joints for value in found)})
    shown = ", ".join(f"{value:g}" for value in values[:4])
    if rows.mean() > 0.5:
        raise RecordingError(
            f"{rows.sum():,} of {len(rows):,} rows hold {shown}, which no other number is near, as "
            "if it stood for a missing one; leave its columns out of --q or --sensation"
        )
    found = replace(recording, readings=readings, notes=tuple(notes))
    return found.without(rows, f"{shown} stands for a missing number")


def _without_velocities(recording: Recording) -> Recording:
    """Leaves out columns of joints that are velocities of others, and efforts after them."""
    q = recording.q.astype(float)
    speeds = velocities(q, recording.follows, recording.time_s)
    if not speeds.any():
        return recording
    names = [recording.joints[number] for number in np.flatnonzero(speeds).tolist()]
    first = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    note = f"{first} are {len(names)} velocities, or efforts, of the other joints: left out"
    return replace(
        recording,
        q=recording.q[:, ~speeds],
        joints=tuple(np.array(recording.joints)[~speeds].tolist()),
        notes=(*recording.notes, note),
    )


def _without_held(
    recording: Recording, what: str, values: np.ndarray, others: np.ndarray
) -> Recording:
    """Leaves out rows that repeat values which are read less often than rows are written."""
    repeated = held_every(values, others, recording.follows)
    if repeated is None:
        return recording
    return recording.without(repeated, f"the {what} only repeats what was read before")
