"""What looks odd in a recording, and what can be done about it."""

import itertools
import re
from collections.abc import Iterator, Sequence

import numpy as np

from selftouch_drake.agent.readings.faults import turned_steps
from selftouch_drake.agent.readings.silence import silence
from selftouch_drake.experience.recorded import Recording
from selftouch_drake.experience.time_units import CROSSING_S
from selftouch_drake.run.imported import Data

# Readings at their greatest value in more than this share of the touches are cut off there.
_SATURATED = 0.02
# Steps so many times as far as the usual ones are sudden.
_SUDDEN = 3.0
# Rows that repeat the one before in every number: so many in a row, or this share of all.
_REPEATED, _REPEATED_SHARE = 50, 0.05
# A joint that was measured takes more positions.
_FEW_POSITIONS = 8
# Names of coordinates, as of the pose of a hand.
_PLACE = re.compile(r"(^|[_.\W])[xyz]$", re.IGNORECASE)
# Share of the rows that touch, of a usual recording.
_TOUCHING = (0.002, 0.7)


def listed(names: Sequence[str]) -> str:
    """How many names, and the first ones."""
    more = f", ... {names[-1]}" if len(names) > 8 else ""
    return f"{len(names)} ({', '.join(names[: 7 if more else 8])}{more})"


def oddities(data: Data) -> Iterator[str]:
    """What looks odd, and what can be done."""
    for what, names in (("joints", data.recording.joints), ("receptors", data.recording.receptors)):
        yield from _missing_numbers(what, names, data.recording.unused)
    yield from _odd_joints(data)
    yield from _odd_times(data)
    yield from _odd_readings(data)


def _missing_numbers(what: str, names: Sequence[str], unused: Sequence[str]) -> Iterator[str]:
    """Whether columns that are numbered leave some out that the file does not have."""
    split = [re.fullmatch(r"(.*?)(\d+)", name) for name in names]
    numbered = [one for one in split if one is not None]
    beginnings = {one[1] for one in numbered}
    if len(numbered) < max(len(names), 2) or len(beginnings) > 1:
        return
    (beginning,) = beginnings
    numbers = sorted(int(one[2]) for one in numbered)
    there = {*numbers} | {
        int(name.removeprefix(beginning))
        for name in unused
        if re.fullmatch(re.escape(beginning) + r"\d+", name)
    }
    missing = sorted({*range(min(1, numbers[0]), numbers[-1])} - there - {0})
    if missing:
        yield (
            f"{what} are numbered up to {numbers[-1]}, and {listed(list(map(str, missing)))} "
            "of these numbers are missing: is the file whole?"
        )


def _odd_joints(data: Data) -> Iterator[str]:
    recording = data.recording
    q, names = recording.q.astype(float), recording.joints
    if not data.felt.successive and len(q) >= 100:
        yield (
            "the joints jump from row to row, so rows do not count as successive in time: record "
            "faster, or give the rows in order"
        )
    reach = np.ptp(q, axis=0)
    whole = (q == np.round(q)).all(axis=0) & (reach > 50)
    if whole.any():
        yield f"{listed(_named(names, whole))} hold whole numbers, as encoder ticks do"
    turned = np.zeros(len(names), dtype=bool) if recording.turn is None else recording.turn > 0
    if turned.any() and not any("within one turn" in note for note in recording.notes):
        yield (
            f"{listed(_named(names, turned))} begin again after a turn: plans do not cross the end"
        )
    rounded = np.array([len(np.unique(one[:: len(one) // 1000 + 1])) for one in q.T])
    few = (reach > 0) & (rounded <= _FEW_POSITIONS)
    if few.any():
        yield (
            f"{listed(_named(names, few))} take only {rounded[few].max()} positions: were decimals "
            "cut off?"
        )
    yield from _of_unit_length(q, names)
    for joint, name in enumerate(names):
        found = _sudden(recording, joint)
        if found is not None:
            yield (
                f"joint {name} jumps by {found[1]:.3g} from one row to the next, in row "
                f"{found[0]:,}: was its zero set anew, or part of the recording lost?"
            )
    places = [name for name in names if _PLACE.search(name)]
    if {name.lower()[-1] for name in places} == {*"xyz"}:
        yield f"{listed(places)} are places by their names, not joints: choose the joints by --q"
    degrees = ~whole & (reach > 4 * np.pi) & (np.abs(q).max(axis=0) <= 400)
    if degrees.any():
        yield (
            f"{listed(_named(names, degrees))} reach {np.abs(q[:, degrees]).max():.3g}, as degrees "
            "do; limits of plans are then in degrees too"
        )
    for one, name in enumerate(names):
        copies = [n for n in range(one) if reach[one] > 0 and (q[:, n] == q[:, one]).all()]
        if copies:
            yield f"joint {name} repeats {names[copies[0]]}: name one of them by --q"
    if len(names) > 64 or len(names) > len(recording.receptors):
        yield (
            f"{len(names)} joints and {len(recording.receptors)} receptors: are --q and "
            "--sensation exchanged?"
        )


def _of_unit_length(q: np.ndarray, names: Sequence[str]) -> Iterator[str]:
    """Whether some joints are parts of one: a quaternion, or cosine and sine of an angle."""
    sample = q[:: len(q) // 1000 + 1]
    moving = np.ptp(sample, axis=0) > 0
    squares, num = sample**2, len(names)
    for first in range(num - 3):
        four = slice(first, first + 4)
        if moving[four].any() and np.allclose(squares[:, four].sum(axis=1), 1.0, atol=1e-3):
            yield (
                f"{names[first]} to {names[first + 3]} are a quaternion, as of a free base: choose "
                "the joints by --q"
            )
            return
    for one, other in itertools.combinations(np.flatnonzero(moving).tolist(), 2):
        if np.allclose(squares[:, one] + squares[:, other], 1.0, atol=1e-3):
            yield f"{names[one]} and {names[other]} are cosine and sine of one angle: record angles"
            return


def _sudden(recording: Recording, joint: int) -> tuple[int, float] | None:
    """The row of the file in which a joint moves far beyond its usual steps, and how far; if any.

    What jumps often does so by its nature.
    """
    turn = np.zeros(1) if recording.turn is None else recording.turn[[joint]]
    column = recording.q[:, [joint]].astype(float)
    steps = np.where(recording.follows, turned_steps(column, turn)[:, 0], 0.0)
    if len(steps) < 200:
        return None
    usual, reach = np.quantile(steps, 0.999 if len(steps) > 5000 else 0.99), np.ptp(column)
    # Between usual steps: what is quick for a while is a motion.
    beside = np.maximum(np.append(steps[1:], 0.0), np.insert(steps[:-1], 0, 0.0))
    sudden = (steps > _SUDDEN * usual) & (steps > 0.05 * reach) & (beside <= usual)
    far = np.flatnonzero(sudden)
    if usual == 0 or not 0 < len(far) <= 3:
        return None
    return int(recording.row[far[0] + 1]), float(steps[far[0]])


def _odd_times(data: Data) -> Iterator[str]:
    recording = data.recording
    if recording.time_s is None:
        return
    dt = np.diff(recording.time_s)[recording.follows]
    if len(dt) and (repeated := int((dt == 0).sum())):
        yield f"{repeated:,} rows have the time of the row before"
    speeds = recording.speeds()
    reach = np.ptp(recording.q.astype(float), axis=0)
    if not len(speeds) or not (reach > 0).any():
        return
    fast = np.quantile(speeds, 0.99, axis=0)[reach > 0]
    if not (fast > 0).any():
        return
    crossing = np.median(reach[reach > 0][fast > 0] / fast[fast > 0])
    least, most = CROSSING_S
    if not least <= crossing <= most:
        yield (
            f"at their fastest, joints cross their range in {crossing:.3g} s: if the time is in "
            "another unit, give --time-unit"
        )


def _odd_readings(data: Data) -> Iterator[str]:
    recording, felt = data.recording, data.felt
    readings = recording.readings
    end = readings.max() if felt.baseline.rising else readings.min()
    at_end = (readings[felt.rows] == end).any(axis=1)
    if at_end.mean() > _SATURATED and len(np.unique(readings[felt.rows[:1000]])) > 8:
        yield (f"readings end at {end:g} in {at_end.sum():,} touches, as if saturated: press less")
    share = len(felt.rows) / max(len(readings), 1)
    if not _TOUCHING[0] <= share <= _TOUCHING[1]:
        yield f"{100 * share:.3g} % of the rows touch: check resting level and --threshold"
    pressed = np.count_nonzero(felt.sensation, axis=0) / max(len(readings), 1)
    typical = np.median(pressed[pressed > 0]) if (pressed > 0).any() else 0.0
    restless = (pressed > 0.1) & (pressed > 10 * typical)
    if restless.any():
        yield (
            f"{listed(_named(recording.receptors, restless))} are pressed ten times as often as "
            "the others"
        )
    same = (np.diff(readings, axis=0) == 0).all(axis=1) & (np.diff(recording.q, axis=0) == 0).all(
        axis=1
    )
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~same, [True]]))) - 1
    if same.mean() > _REPEATED_SHARE or runs.max(initial=0) >= _REPEATED:
        yield (
            f"{same.sum():,} rows repeat the row before in every number, up to {runs.max():,} one "
            "after another: is the file filled up, or did the robot stand?"
        )
    off = silence(felt.sensation)
    if off is not None:
        when = "last" if off.at_end else "first"
        yield (
            f"{listed(_named(recording.receptors, off.receptors))} feel nothing in the {when} "
            f"{100 * off.share:.0f} % of the touches: were they off, or left alone?"
        )
    num_all = int((np.count_nonzero(felt.sensation, axis=1) >= 0.9 * readings.shape[1]).sum())
    if num_all > 0.5 * len(felt.rows) and readings.shape[1] >= 8:
        yield f"{num_all:,} touches are felt by nearly all receptors: is this one signal?"


def _named(names: Sequence[str], chosen: np.ndarray) -> list[str]:
    return [names[number] for number in np.flatnonzero(chosen).tolist()]
