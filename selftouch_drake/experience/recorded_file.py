"""One file of a recording: which columns hold joints, readings and times, and which rows count."""

import fnmatch
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from selftouch_drake.agent.readings.faults import turned_steps
from selftouch_drake.experience.columns import numbers_in, plain, read_columns, words_in
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.times import Times, in_order, in_seconds, joined_counts
from selftouch_drake.experience.units import named, plain_form
from selftouch_drake.experiment import closest, shown

#: Default names, tried in order; `#` stands for a number, one column for each. Capitals, blanks,
#: points, brackets and units do not matter: `Q [3]`, `q.3` and `q_3 [rad]` are `q_3`.
Q_NAMES = (
    *("q", "observation.state", "state", "joint_positions", "q_#", "joint_#", "joint#", "q#"),
    *("joint_positions_#", "joint_position_#", "joint_#_pos", "joint_#_position"),
)
SENSATION_NAMES = (
    *("sensation", "observation.touch", "observation.tactile", "observation.skin"),
    *("touch", "tactile", "taxels", "skin", "readings"),
    *("taxel_#", "sensation_#", "touch_#", "tactile_#", "taxel#", "taxels_#", "skin_#"),
)
#: Arrays of an archive that name the joints or receptors.
NAMES_OF = {
    "--q": ("joint_names", "joints"),
    "--sensation": ("receptor_names", "taxel_names", "receptors"),
}
TIME_NAMES = ("time_s", "time", "timestamp", "t", "timestamps", "stamp", "header.stamp")
#: Endings of the names of two columns that hold one time: whole seconds, and nanoseconds.
_STAMPS = (("secs", "nsecs"), ("sec", "nanosec"), ("sec", "nsec"))
# Names, or parts of names, of what is recorded of a joint beside its position.
_NO_POSITION = re.compile(
    r"(?:^|[_\W])(d?q?vel|velocity|velocities|speed|qd|dq|acc|acceleration|effort|torque|tau|current"
    r"|cmd|command|commanded|desired|setpoint|goal|target|error|temp|temperature)s?(?:$|[_\W\d])",
    re.IGNORECASE,
)
# How a pattern for an option is written, as in errors.
_PATTERNS = {"--q": "joint*", "--sensation": "taxel*"}
EPISODE_NAMES = ("episode_index", "episode", "walk")
# Pieces of motion are numbered from here on in each further file.
_PIECES_PER_FILE = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """The recording of another robot: n rows of J joints and S receptors.

    Attributes:
        q: `(n, J)` motor configurations, in the robot's units.
        readings: `(n, S)` raw readings, of the type of the file.
        time_s: `(n,)` s, or None if it was not recorded.
        piece: `(n,)` number of the piece of motion (a file or an episode) of each row.
        row: `(n,)` the row of the files, one after the other, that each row comes from.
        num_read: rows in the files, chosen or not, complete or not.
        joints: J names.
        receptors: S names.
        num_rows: rows in the files, of those that were chosen.
        num_incomplete: number of rows left out because a number was missing, NaN or infinite.
        choices: the values of each other column that has few; `rows` can choose by it.
        unused: names of the columns that were not read.
        notes: what was understood, turned into other units, or put in order, in words.
        left_out: why rows were left out, besides incomplete ones, and how many for each reason.
        time_from: the column of times and what it holds; empty without times.
        num_gaps: number of pauses in time.
        turn: `(J,)` turn after which a joint's reading begins again, in its unit; 0 if it does not.
            None as long as nobody asked.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray | None
    piece: np.ndarray
    row: np.ndarray
    num_read: int
    joints: tuple[str, ...]
    receptors: tuple[str, ...]
    num_rows: int
    num_incomplete: int
    choices: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=dict)
    time_from: str = ""
    num_gaps: int = 0
    turn: np.ndarray | None = None

    @property
    def follows(self) -> np.ndarray:
        """`(n - 1,)` bool, whether the next row belongs to the same piece of motion."""
        return np.diff(self.piece) == 0

    def without(self, rows: np.ndarray, reason: str) -> "Recording":
        """The recording without some rows, `(n,)` bool, and the reason."""
        if not rows.any():
            return self
        counts = dict(self.left_out)
        counts[reason] = counts.get(reason, 0) + int(rows.sum())
        kept = ~rows
        return replace(
            self,
            q=self.q[kept],
            readings=self.readings[kept],
            time_s=None if self.time_s is None else self.time_s[kept],
            piece=self.piece[kept],
            row=self.row[kept],
            left_out=counts,
        )

    def speeds(self) -> np.ndarray:
        """`(m, J)` per second, between successive rows of a piece; none without time."""
        dt = np.zeros(max(len(self.q) - 1, 0)) if self.time_s is None else np.diff(self.time_s)
        follows = self.follows & (dt > 0)
        turn = np.zeros(self.q.shape[1]) if self.turn is None else self.turn
        return turned_steps(self.q, turn)[follows] / dt[follows, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Which columns and rows of each file a recording is made of, as the user says.

    Attributes:
        q: as of `read_recording`; None for the usual names.
        sensation: likewise.
        time: likewise; "none" for no time.
        time_unit: s, ms, us or ns; None for what name or numbers say.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`.
        delimiter: between the columns of text; None for the most frequent one.
        named: names of the numbers in a column, where LeRobot gives any.
    """

    q: str | None
    sensation: str | None
    time: str | None
    time_unit: str | None
    rows: Sequence[str]
    delimiter: str | None
    named: Mapping[str, Sequence[str]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Taken:
    """Columns of numbers that make up one array.

    Attributes:
        option: the option that chooses them.
        names: of the columns.
        parts: `(n, width)` numbers of each.
        notes: what was done with them, in words.
    """

    option: str
    names: Sequence[str]
    parts: Sequence[np.ndarray]
    notes: tuple[str, ...] = ()

    def joined(self) -> np.ndarray:
        """`(n, total width)` numbers of all columns."""
        return np.concatenate(self.parts, axis=1)


def read_file(files: Sequence[Path], wanted: Wanted, number: int) -> Recording:
    """Reads the file with this number of a recording; several if each holds one array.

    Raises:
        RecordingError: a column does not exist, or shapes disagree.
        ValueError: the file is damaged.
    """
    return _File(files, wanted).recording(number)


class _File:
    """One file: its columns by name, of a table or of an archive of arrays."""

    def __init__(self, files: Sequence[Path], wanted: Wanted) -> None:
        self._path = files[0] if len(files) == 1 else files[0].parent
        self._wanted = wanted
        self._read = read_columns(files, wanted.delimiter)
        self._columns = self._read.by_name

    def recording(self, number: int) -> Recording:
        """As of `read_file`."""
        q = self._taken("--q", self._wanted.q, Q_NAMES)
        touch = self._taken("--sensation", self._wanted.sensation, SENSATION_NAMES)
        if both := sorted({*q.names} & {*touch.names}):
            raise RecordingError(
                f"column {both[0]} of {self._path} is taken for --q and for --sensation; name the "
                "columns of each"
            )
        q, touch = _upright(q, touch)
        configurations, readings = q.joined(), touch.joined()
        num_rows = len(configurations)
        self._require_length("sensation", readings, num_rows)
        time_names, times = self._times()
        if times is not None:
            self._require_length("time", times.time_s, num_rows)
        chosen = self._meeting(self._wanted.rows, num_rows)
        piece = _pieces(self._single(EPISODE_NAMES), chosen)
        notes = [*self._read.notes, *q.notes, *touch.notes]
        complete = np.isfinite(configurations).all(axis=1) & np.isfinite(readings).all(axis=1)
        if times is not None:
            complete &= np.isfinite(times.time_s)
            apart = _joined_in_time(configurations, readings, times.time_s, complete, chosen)
            if apart is not None:
                complete, chosen, num_filled = apart
                notes.append(
                    "joints and skin are in rows of their own: the joints are interpolated in "
                    f"{num_filled:,} rows of the skin"
                )
        rows = np.flatnonzero(complete & chosen)
        num_gaps, piece = 0, piece[rows]
        if times is not None:
            found = in_order(times.time_s[rows], piece)
            rows, piece, num_gaps = rows[found.order], np.cumsum(found.breaks), found.num_gaps
            if found.num_restarts:
                notes.append(f"the clock starts again {found.num_restarts:,} times")
            if found.num_moved:
                notes.append(f"{found.num_moved:,} rows are earlier than those before: sorted")
        num_broken = self._read.num_broken
        taken = {*q.names, *touch.names, *EPISODE_NAMES, *time_names}
        what = "" if times is None else ", ".join(filter(None, [time_names[0], times.note]))
        return Recording(
            q=configurations[rows],
            readings=readings[rows],
            time_s=None if times is None else times.time_s[rows],
            piece=number * _PIECES_PER_FILE + piece,
            row=rows,
            num_read=num_rows,
            joints=self._names(q),
            receptors=self._names(touch),
            num_rows=int(chosen.sum()) + num_broken,
            num_incomplete=int((chosen & ~complete).sum()) + num_broken,
            choices=self._choices(taken, num_rows),
            unused=self._unused(taken),
            notes=tuple(notes),
            time_from=what,
            num_gaps=num_gaps,
        )

    def _unused(self, taken: Collection[str]) -> tuple[str, ...]:
        """The columns that are not taken and name nothing."""
        naming = {*NAMES_OF["--q"], *NAMES_OF["--sensation"]}
        return tuple(
            name
            for name in self._columns
            if name not in taken and name not in naming and not name.endswith("_names")
        )

    def _times(self) -> tuple[list[str], Times | None]:
        """The columns of times, and the times, if there are any."""
        asked = self._wanted.time
        if asked == "none":
            return [], None
        if asked is not None:
            self._require("--time", asked)
            names = [asked]
        else:
            names = self._of_usual_name(TIME_NAMES)[:1]
            if not names:
                forms = {plain_form(name): name for name in self._columns}
                ends = ("stamp_secs", "stamp_sec", "secs", "sec")
                names = [name for form, name in forms.items() if form.endswith(ends)][:1]
        if not names:
            return [], None
        (name,) = names
        for whole, rest in _STAMPS:
            sibling = f"{name[: -len(whole)]}{rest}"
            if name.endswith(whole) and sibling in self._columns:
                stamps = joined_counts(self._numbers(name), self._numbers(sibling))
                what = f"columns {name} and {sibling} of {self._path}"
                return [name, sibling], in_seconds(stamps, name, what, "ns")
        what = f"column {name} of {self._path}"
        column = self._columns[name]
        return names, in_seconds(column, name, what, self._wanted.time_unit)

    def _taken(self, option: str, asked: str | None, defaults: Sequence[str]) -> _Taken:
        """The columns asked for, or those of the first default name that exists."""
        if asked is None:
            names = self._usual(option, defaults)
        else:
            names = [name for entry in asked.split(",") for name in self._matching(option, entry)]
        if repeated := [name for name in names if names.count(name) > 1]:
            raise RecordingError(
                f"{option} is {shown(asked)}; it takes {repeated[0]} twice: name each column once"
            )
        if option == "--q":
            self._require_positions(asked, names)
        parts = [self._numbers(name) for name in names]
        for name, part in zip(names, parts, strict=True):
            if len(part) != len(parts[0]):
                raise RecordingError(
                    f"column {name} of {self._path} has {len(part)} rows, but {names[0]} has "
                    f"{len(parts[0])}; {option} takes columns that were recorded together"
                )
        flat = [part.reshape(len(part), -1) for part in parts]
        if asked is None and len(names) > 1 and max(part.shape[1] for part in flat) > 1:
            raise RecordingError(
                f"column {names[0]} of {self._path} holds {flat[0].shape[1]} numbers in a row, and "
                f"so do others of {len(names)}; write decimal points, or name columns by {option}"
            )
        return self._in_usual_units(_Taken(option=option, names=names, parts=flat))

    def _in_usual_units(self, taken: _Taken) -> _Taken:
        """Angles in rad and lengths in m, where the names of joints state another unit."""
        if taken.option != "--q":
            return taken
        parts, notes = [], []
        for name, part in zip(taken.names, taken.parts, strict=True):
            unit = named(name)
            if unit.kind in ("rad", "m") and unit.factor != 1.0:
                notes.append(f"{unit.unit} turned to {unit.kind}")
                part = part * unit.factor
            parts.append(part)
        said = tuple(f"joints: {note}" for note in dict.fromkeys(notes))
        return replace(taken, parts=parts, notes=said)

    def _require_positions(self, asked: str | None, names: Sequence[str]) -> None:
        """Raises a `RecordingError` if a pattern takes what is no position, by its name."""
        if asked is not None and not any(sign in asked for sign in "*?["):
            return
        others = [name for name in names if _NO_POSITION.search(name)]
        speeds = [name for name in names if named(name).kind in ("velocity", "effort")]
        if wrong := others or speeds:
            what = f"--q is {shown(asked)}" if asked else f"{self._path} has several columns"
            raise RecordingError(
                f"{what}; it takes {wrong[0]} too, which by its name is no joint position: name "
                "the positions alone, or each column"
            )

    def _usual(self, option: str, defaults: Sequence[str]) -> list[str]:
        """The columns with the first of some default names that exists."""
        found = self._of_usual_name(defaults)
        if found:
            return found
        raise RecordingError(
            f"{self._path} has no column with a usual name for {option}; it has "
            f"{self._all}: name the column, as in {option} '{defaults[0]}' or "
            f"{option} '{_PATTERNS[option]}'"
        )

    def _of_usual_name(self, defaults: Sequence[str]) -> list[str]:
        """The columns with the first of some names that exists; none if none does."""
        forms = {column: plain_form(column) for column in self._columns}
        for name in defaults:
            if name in self._columns:
                return [name]
            pattern = re.escape(plain_form(name)).replace(r"\#", r"\d+")
            matching = [column for column, form in forms.items() if re.fullmatch(pattern, form)]
            exact = re.escape(name).replace(r"\#", r"\d+")
            if any(re.fullmatch(exact, column) for column in matching):
                # Names that are written as usual come before their variants.
                matching = [
                    column for column in matching if re.fullmatch(exact, named(column).bare)
                ]
            if matching:
                return sorted(matching, key=in_order_of_numbers)
        return []

    def _matching(self, option: str, entry: str) -> list[str]:
        """The column of this name, those from one to another, or those that match a pattern."""
        bare = {named(column).bare: column for column in self._columns}
        if entry in self._columns or entry in bare:
            return [entry if entry in self._columns else bare[entry]]
        first, to, last = entry.partition("..")
        if to:
            for end in (first, last):
                self._require(option, end)
            every = list(self._columns)
            return every[every.index(first) : every.index(last) + 1]
        found = fnmatch.filter(self._columns, entry)
        if not found:
            self._require(option, entry)
        return sorted(found, key=in_order_of_numbers)

    def _require(self, option: str, asked: str) -> None:
        """Raises a `RecordingError` if there is no such column."""
        if asked not in self._columns:
            hint = closest(asked, self._columns) or f"it has {self._all}"
            raise RecordingError(
                f"{option} is {shown(asked)}; {self._path} has no such column: {hint}"
            )

    def _require_length(self, name: str, rows: np.ndarray, num_rows: int) -> None:
        """Raises a `RecordingError` if there are not as many rows as of q."""
        if len(rows) != num_rows:
            raise RecordingError(
                f"{self._path} has {num_rows} rows of q and {len(rows)} of {name}; record them "
                "together"
            )

    @property
    def _all(self) -> str:
        """The names of all columns, as far as a line holds them."""
        return ", ".join([*self._columns][:20]) + (", ..." if len(self._columns) > 20 else "")

    def _single(self, names: Sequence[str]) -> np.ndarray | None:
        """`(n,)` the number in each row of the first of these columns that exists, if any."""
        for name in names:
            if name in self._columns:
                numbers = self._numbers(name)
                return numbers.reshape(len(numbers), -1)[:, 0].astype(float)
        return None

    def _numbers(self, name: str) -> np.ndarray:
        """`(n, ...)` numbers of a column; NaN where one is missing."""
        if name in self._read.clashing:
            raise RecordingError(
                f"{self._path} has several columns {name} that differ; rename all but one"
            )
        return numbers_in(self._columns[name], f"column {name} of {self._path}")

    def _names(self, taken: _Taken) -> tuple[str, ...]:
        """Names of all numbers in the columns that were taken."""
        widths = [part.shape[1] for part in taken.parts]
        for name in (*(f"{name}_names" for name in taken.names), *NAMES_OF[taken.option]):
            found = self._columns.get(name)
            if not isinstance(found, np.ndarray):
                continue
            if found.dtype.kind == "U" and found.size == sum(widths):
                return tuple(found.ravel().tolist())
        names: list[str] = []
        for name, width in zip(taken.names, widths, strict=True):
            one_number = width == 1 and len(widths) > 1
            unit = named(name)
            shown_as = unit.bare if unit.kind in ("rad", "m") else name
            each = [shown_as] if one_number else self._wanted.named.get(name, ())
            names += each if len(each) == width else [f"{name}[{n}]" for n in range(width)]
        return tuple(names)

    def _meeting(self, conditions: Sequence[str], num_rows: int) -> np.ndarray:
        """`(n,)` bool, the rows that meet all conditions."""
        chosen = np.ones(num_rows, dtype=bool)
        for condition in conditions:
            name, equals, values = condition.partition("=")
            if not equals:
                raise RecordingError(f"--rows is {shown(condition)}; write it as COLUMN=VALUE")
            self._require("--rows", name)
            words = words_in(self._columns[name])
            if words is None or len(words) != num_rows:
                raise RecordingError(
                    f"--rows is {shown(condition)}; column {name} of {self._path} does not hold "
                    "one word or number for each instant: choose by another"
                )
            chosen &= np.isin(words, [plain(value) for value in values.split(",")])
        return chosen

    def _choices(self, taken: Collection[str], num_rows: int) -> dict[str, tuple[str, ...]]:
        """The values of all columns that are not taken and have few: words or whole numbers."""
        found = {}
        for name in sorted(set(self._columns) - set(taken)):
            words = words_in(self._columns[name], few=True)
            if words is not None and len(words) == num_rows:
                found[name] = tuple(np.unique(words).tolist())
        return found


def _pieces(episode: np.ndarray | None, chosen: np.ndarray) -> np.ndarray:
    """`(n,)` number of the piece of motion of each row, ascending.

    A piece ends with its file, its episode, and where rows were left out by choice.
    """
    num_rows = len(chosen)
    piece = np.zeros(num_rows) if episode is None else np.nan_to_num(episode[:num_rows])
    breaks = np.diff(piece, prepend=piece[:1]) != 0
    breaks[1:] |= ~chosen[:-1]
    return np.cumsum(breaks)


def _joined_in_time(
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
    filled = _filled(q, time_s, joints_there, chosen & felt_there & ~joints_there)
    if not filled.any():
        return None
    return complete | filled, chosen & (felt_there | ~joints_there), int(filled.sum())


def _filled(q: np.ndarray, time_s: np.ndarray, there: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Interpolates `(n, J)` joints in place, between rows that are there, to wanted rows.

    Returns:
        `(n,)` bool, the rows that were filled: neither far in time from rows that are there nor
        where a joint jumps, as an angle does at the end of a turn.
    """
    filled = np.zeros(len(q), dtype=bool)
    known = np.flatnonzero(there)
    if len(known) < 2:
        return filled
    known = known[np.argsort(time_s[known], kind="stable")]
    times, rows = time_s[known], np.flatnonzero(wanted)
    after = np.searchsorted(times, time_s[rows], side="right").clip(1, len(known) - 1)
    apart = times[after] - times[after - 1]
    step = np.abs(q[known[after]] - q[known[after - 1]])
    near = (time_s[rows] >= times[0]) & (time_s[rows] <= times[-1])
    near &= apart <= 10.0 * max(float(np.median(np.diff(times))), 1e-12)
    near &= (step <= 0.5 * np.ptp(q[known], axis=0)).all(axis=1)
    rows = rows[near]
    for joint in range(q.shape[1]):
        q[rows, joint] = np.interp(time_s[rows], times, q[known, joint])
    filled[rows] = True
    return filled


def _upright(q: _Taken, touch: _Taken) -> tuple[_Taken, _Taken]:
    """Arrays with one row for each instant: there are more instants than joints or receptors.

    Only single arrays of different lengths are transposed, one of them or both.
    """
    if len(q.parts) > 1 or len(touch.parts) > 1 or len(q.parts[0]) == len(touch.parts[0]):
        return q, touch
    a, b = q.parts[0], touch.parts[0]
    for rows_q, rows_touch in ((a.T, b), (a, b.T), (a.T, b.T)):
        widest = max(rows_q.shape[1], rows_touch.shape[1])
        if len(rows_q) == len(rows_touch) and len(rows_q) > widest:
            return replace(q, parts=[rows_q]), replace(touch, parts=[rows_touch])
    return q, touch


def in_order_of_numbers(name: str) -> list[tuple[int, str]]:
    """Names in the order of their numbers: joint_2 before joint_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
