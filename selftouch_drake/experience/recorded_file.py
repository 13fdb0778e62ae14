"""One file of a recording: which columns hold joints, readings and times, and which rows count."""

import fnmatch
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from selftouch_drake.experience.columns import (
    RecordingError,
    numbers_in,
    plain,
    read_columns,
    words_in,
)
from selftouch_drake.experiment import closest, shown

#: Default names, tried in order; `#` stands for a number, one column for each.
Q_NAMES = ("q", "observation.state", "state", "joint_positions", "q_#", "joint_#", "joint#")
SENSATION_NAMES = (
    *("sensation", "observation.touch", "observation.tactile", "observation.skin"),
    *("touch", "tactile", "taxels", "skin", "readings"),
    *("taxel_#", "sensation_#", "touch_#", "tactile_#", "taxel#"),
)
#: Arrays of an archive that name the joints or receptors.
NAMES_OF = {
    "--q": ("joint_names", "joints"),
    "--sensation": ("receptor_names", "taxel_names", "receptors"),
}
TIME_NAMES = ("time_s", "time", "timestamp", "t")
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
        joints: J names.
        receptors: S names.
        num_rows: rows in the files, of those that were chosen.
        num_incomplete: number of rows left out because a number was missing, NaN or infinite.
        choices: the values of each other column that has few; `rows` can choose by it.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray | None
    piece: np.ndarray
    joints: tuple[str, ...]
    receptors: tuple[str, ...]
    num_rows: int
    num_incomplete: int
    choices: Mapping[str, tuple[str, ...]]

    def speeds(self) -> np.ndarray:
        """`(m, J)` per second, between successive rows of a piece; none without time."""
        dt = np.zeros(max(len(self.q) - 1, 0)) if self.time_s is None else np.diff(self.time_s)
        follows = (np.diff(self.piece) == 0) & (dt > 0)
        return np.abs(np.diff(self.q.astype(float), axis=0)[follows]) / dt[follows, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Which columns and rows of each file a recording is made of, as the user says.

    Attributes:
        q: as of `read_recording`; None for the usual names.
        sensation: likewise.
        time: likewise.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`.
        delimiter: between the columns of text; None for the most frequent one.
        named: names of the numbers in a column, where LeRobot gives any.
    """

    q: str | None
    sensation: str | None
    time: str | None
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
    """

    option: str
    names: Sequence[str]
    parts: Sequence[np.ndarray]

    def joined(self) -> np.ndarray:
        """`(n, total width)` numbers of all columns."""
        return np.concatenate(self.parts, axis=1)


def read_file(path: Path, wanted: Wanted, number: int) -> Recording:
    """Reads the file with this number of a recording.

    Raises:
        RecordingError: a column does not exist, or shapes disagree.
        ValueError: the file is damaged.
    """
    return _File(path, wanted).recording(number)


class _File:
    """One file: its columns by name, of a table or of an archive of arrays."""

    def __init__(self, path: Path, wanted: Wanted) -> None:
        self._path, self._wanted = path, wanted
        self._columns = read_columns(path, wanted.delimiter)

    def recording(self, number: int) -> Recording:
        """As of `read_file`."""
        wanted = self._wanted
        q = self._taken("--q", wanted.q, Q_NAMES)
        touch = self._taken("--sensation", wanted.sensation, SENSATION_NAMES)
        if wanted.time is not None:
            self._require("--time", wanted.time)
        time_s = self._single(TIME_NAMES if wanted.time is None else [wanted.time])
        episode = self._single(EPISODE_NAMES)
        q, touch = _upright(q, touch)
        configurations, readings = q.joined(), touch.joined()
        num_rows = len(configurations)
        self._require_length("sensation", readings, num_rows)
        if time_s is not None:
            self._require_length("time", time_s, num_rows)
        chosen = self._meeting(wanted.rows, num_rows)
        complete = np.isfinite(configurations).all(axis=1) & np.isfinite(readings).all(axis=1)
        if time_s is not None:
            complete &= np.isfinite(time_s)
        kept = complete & chosen
        return Recording(
            q=configurations[kept],
            readings=readings[kept],
            time_s=None if time_s is None else time_s[kept],
            piece=number * _PIECES_PER_FILE + _pieces(episode, chosen)[kept],
            joints=self._names(q),
            receptors=self._names(touch),
            num_rows=int(chosen.sum()),
            num_incomplete=int((chosen & ~complete).sum()),
            choices=self._choices({*q.names, *touch.names, *EPISODE_NAMES, *TIME_NAMES}, num_rows),
        )

    def _taken(self, option: str, asked: str | None, defaults: Sequence[str]) -> _Taken:
        """The columns asked for, or those of the first default name that exists."""
        if asked is None:
            names = self._usual(option, defaults)
        else:
            names = [name for entry in asked.split(",") for name in self._matching(option, entry)]
        parts = [self._numbers(name) for name in names]
        for name, part in zip(names, parts, strict=True):
            if len(part) != len(parts[0]):
                raise RecordingError(
                    f"column {name} of {self._path} has {len(part)} rows, but {names[0]} has "
                    f"{len(parts[0])}; {option} takes columns that were recorded together"
                )
        flat = [part.reshape(len(part), -1) for part in parts]
        return _Taken(option=option, names=names, parts=flat)

    def _usual(self, option: str, defaults: Sequence[str]) -> list[str]:
        """The columns with the first of some default names that exists."""
        for name in defaults:
            pattern = re.escape(name).replace(r"\#", r"\d+")
            matching = [column for column in self._columns if re.fullmatch(pattern, column)]
            if matching:
                return sorted(matching, key=_in_order_of_numbers)
        raise RecordingError(
            f"{self._path} has no column with a usual name for {option}; it has "
            f"{self._all}: name the column, as in {option} '{defaults[0]}' or "
            f"{option} '{defaults[-1][:-1]}*'"
        )

    def _matching(self, option: str, entry: str) -> list[str]:
        """The column of this name, or those that match it as a pattern."""
        found = [entry] if entry in self._columns else fnmatch.filter(self._columns, entry)
        if not found:
            self._require(option, entry)
        return sorted(found, key=_in_order_of_numbers)

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
            each = [name] if one_number else self._wanted.named.get(name, ())
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


def _in_order_of_numbers(name: str) -> list[tuple[int, str]]:
    """Names in the order of their numbers: joint_2 before joint_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
