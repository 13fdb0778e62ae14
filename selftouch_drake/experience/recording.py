"""Reads recordings of other robots: tables with named columns, as the robot's own tools write them.

A recording is a Parquet, CSV or NPZ file, or a folder of files of one kind. Folders in the layout
of LeRobot (`meta/info.json`, `data/`) are understood.
"""

import fnmatch
import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet as pq

from selftouch_drake.experience.store import UNREADABLE, one_chunk
from selftouch_drake.experiment import closest, shown
from selftouch_drake.files import load_arrays

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
_KINDS = (".parquet", ".csv", ".npz")
_DELIMITERS = ",;\t| "
# What is around and between the numbers of a list that is written as text.
_AROUND, _BETWEEN = " \t\r\n[](){},;", r"[\s,;]+"
# Bytes at the start of a text file that show how it is written.
_HEAD = 65_536
# A column with so many different words or whole numbers may say what touched.
_FEW_VALUES = range(2, 21)


class RecordingError(ValueError):
    """A recording that cannot be used; the text names the file or column, and the remedy."""


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


def read_recording(
    source: Path,
    *,
    q: str | None = None,
    sensation: str | None = None,
    time: str | None = None,
    rows: Sequence[str] = (),
    delimiter: str | None = None,
) -> Recording:
    """Reads a file, or a folder of files of one kind.

    Args:
        source: a Parquet, CSV or NPZ file, or a folder; in LeRobot's layout the files under `data`
            are read.
        q: the columns of motor configurations, with an array or a number in each row, as names
            separated by commas or as a pattern (`joint_*`), in the order of their numbers. By
            default the first of `Q_NAMES` that exists. In an archive, the arrays of `NAMES_OF` name
            the joints and receptors, and arrays may be transposed.
        sensation: the columns of raw readings, likewise; by default the first of `SENSATION_NAMES`.
        time: the column of seconds; by default the first of `TIME_NAMES` that exists, if any.
        rows: conditions, as `COLUMN=VALUE` or `COLUMN=VALUE,VALUE`; rows that meet all are read.
        delimiter: between the columns of text; by default the one that the first line has most of.

    Raises:
        FileNotFoundError: the source does not exist.
        RecordingError: a column does not exist, shapes disagree, or no row is complete.
        ValueError: a file is damaged.
    """
    files, named = _files(source), _lerobot_names(source)
    parts = [
        _Table(path, delimiter).recording(q, sensation, time, rows, named, piece)
        for piece, path in enumerate(files)
    ]
    first = parts[0]
    for path, part in zip(files, parts, strict=True):
        for what in ("joints", "receptors"):
            if getattr(part, what) != getattr(first, what):
                raise RecordingError(
                    f"{path} has {len(getattr(part, what))} {what}, but {files[0]} has "
                    f"{len(getattr(first, what))}, or their names differ; import recordings of one "
                    "robot at a time"
                )
    times = [part.time_s for part in parts if part.time_s is not None]
    joined = replace(
        first,
        q=np.concatenate([part.q for part in parts]),
        readings=np.concatenate([part.readings for part in parts]),
        time_s=np.concatenate(times) if len(times) == len(parts) else None,
        piece=np.concatenate([part.piece for part in parts]),
        num_rows=sum(part.num_rows for part in parts),
        num_incomplete=sum(part.num_incomplete for part in parts),
        choices={
            name: tuple(sorted({value for part in parts for value in part.choices.get(name, ())}))
            for name in first.choices
        },
    )
    if rows and not joined.num_rows:
        raise RecordingError(f"--rows is {', '.join(rows)}; no row of {source} is so: correct it")
    if not len(joined.q):
        raise RecordingError(
            f"{source} has no complete row: in each of {joined.num_rows} a number is missing; "
            "record q and sensation in the same row"
        )
    return joined


def _files(source: Path) -> list[Path]:
    if source.is_file():
        if source.suffix.lower() not in _KINDS:
            raise RecordingError(f"{source} is not a parquet, csv or npz file; convert it to one")
        return [source]
    if not source.is_dir():
        raise FileNotFoundError(f"{source} does not exist; give a file or a folder")
    folder = source / "data" if (source / "meta" / "info.json").is_file() else source
    found = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _KINDS]
    kinds = sorted({path.suffix.lower() for path in found})
    if not found:
        raise RecordingError(f"{folder} holds no parquet, csv or npz file; give another folder")
    if len(kinds) > 1:
        raise RecordingError(f"{folder} holds files of kinds {', '.join(kinds)}; give one kind")
    return found


class _Table:
    """One file: its columns by name, of a table or of an archive of arrays."""

    def __init__(self, path: Path, delimiter: str | None) -> None:
        self.path = path
        self.columns: Mapping[str, pa.ChunkedArray | np.ndarray]
        kind = path.suffix.lower()
        if kind == ".npz":
            self.columns = load_arrays(path)
            return
        try:
            table = pq.read_table(path) if kind == ".parquet" else _read_text(path, delimiter)
        except UNREADABLE as error:
            reason = " ".join(str(error).split())[:200]
            raise RecordingError(f"{path} is damaged ({reason}); write it again") from None
        self.columns = {name: table.column(name) for name in table.column_names}

    def recording(
        self,
        q: str | None,
        sensation: str | None,
        time: str | None,
        conditions: Sequence[str],
        named: Mapping[str, Sequence[str]],
        number: int,
    ) -> Recording:
        """As of `read_recording`, with names by LeRobot and the number of the file."""
        taken_q, parts_q = self._taken("--q", q, Q_NAMES)
        taken_s, parts_s = self._taken("--sensation", sensation, SENSATION_NAMES)
        if time is not None:
            self._require("--time", time)
        time_s = self._single(TIME_NAMES if time is None else [time])
        episode = self._single(EPISODE_NAMES)
        parts_q, parts_s = _upright(parts_q, parts_s)
        configurations, readings = np.concatenate(parts_q, axis=1), np.concatenate(parts_s, axis=1)
        num_rows = len(configurations)
        for name, rows in (("sensation", readings), ("time", time_s)):
            if rows is not None and len(rows) != num_rows:
                raise RecordingError(
                    f"{self.path} has {num_rows} rows of q and {len(rows)} of {name}; record them "
                    "together"
                )
        chosen = self._meeting(conditions, num_rows)
        complete = np.isfinite(configurations).all(axis=1) & np.isfinite(readings).all(axis=1)
        if time_s is not None:
            complete &= np.isfinite(time_s)
        # A piece ends with its file, its episode, and where rows were left out by choice.
        piece = np.zeros(num_rows) if episode is None else np.nan_to_num(episode[:num_rows])
        breaks = np.diff(piece, prepend=piece[:1]) != 0
        breaks[1:] |= ~chosen[:-1]
        kept = complete & chosen
        return Recording(
            q=configurations[kept],
            readings=readings[kept],
            time_s=None if time_s is None else time_s[kept],
            piece=number * 1_000_000_000 + np.cumsum(breaks)[kept],
            joints=self._names("--q", taken_q, parts_q, named),
            receptors=self._names("--sensation", taken_s, parts_s, named),
            num_rows=int(chosen.sum()),
            num_incomplete=int((chosen & ~complete).sum()),
            choices=self._choices({*taken_q, *taken_s, *EPISODE_NAMES, *TIME_NAMES}, num_rows),
        )

    def _taken(
        self, option: str, asked: str | None, defaults: Sequence[str]
    ) -> tuple[list[str], list[np.ndarray]]:
        """Names and `(n, width)` numbers of the columns asked for, or of the first default."""
        taken: list[str] = []
        if asked is None:
            patterns = (re.escape(name).replace(r"\#", r"\d+") for name in defaults)
            matching = ([c for c in self.columns if re.fullmatch(p, c)] for p in patterns)
            taken = sorted(next(filter(None, matching), []), key=_in_order_of_numbers)
            if not taken:
                raise RecordingError(
                    f"{self.path} has no column with a usual name for {option}; it has "
                    f"{self._all}: name the column, as in {option} '{defaults[0]}' or "
                    f"{option} '{defaults[-1][:-1]}*'"
                )
        for entry in asked.split(",") if asked is not None else ():
            found = [entry] if entry in self.columns else fnmatch.filter(self.columns, entry)
            if not found:
                self._require(option, entry)
            taken += sorted(found, key=_in_order_of_numbers)
        parts = [self._numbers(name) for name in taken]
        for name, part in zip(taken, parts, strict=True):
            if len(part) != len(parts[0]):
                raise RecordingError(
                    f"column {name} of {self.path} has {len(part)} rows, but {taken[0]} has "
                    f"{len(parts[0])}; {option} takes columns that were recorded together"
                )
        return taken, [part.reshape(len(part), -1) for part in parts]

    def _require(self, option: str, asked: str) -> None:
        if asked not in self.columns:
            hint = closest(asked, self.columns) or f"it has {self._all}"
            raise RecordingError(
                f"{option} is {shown(asked)}; {self.path} has no such column: {hint}"
            )

    @property
    def _all(self) -> str:
        return ", ".join([*self.columns][:20]) + (", ..." if len(self.columns) > 20 else "")

    def _single(self, names: Sequence[str]) -> np.ndarray | None:
        """`(n,)` the number in each row of the first of these columns that exists, if any."""
        for name in names:
            if name in self.columns:
                numbers = self._numbers(name)
                return numbers.reshape(len(numbers), -1)[:, 0].astype(float)
        return None

    def _numbers(self, name: str) -> np.ndarray:
        """`(n, ...)` numbers of a column; NaN where one is missing."""
        column, what = self.columns[name], f"column {name} of {self.path}"
        if isinstance(column, pa.ChunkedArray):
            column = _of_arrow(one_chunk(column), what)
        if column.dtype.kind not in "fiub":
            raise RecordingError(f"{what} holds {column.dtype}; name a column that holds numbers")
        if column.ndim == 0:
            raise RecordingError(f"{what} is one number; give one row for each instant")
        if column.dtype.kind == "b":
            return column.astype(np.uint8)
        if column.dtype.kind != "f" and column.dtype.itemsize == 8 and column.size:
            # CSV files and lists use eight bytes for each number.
            ends = map(np.min_scalar_type, (column.min(), column.max()))
            column = column.astype(np.result_type(*ends))
        return column

    def _names(
        self,
        option: str,
        taken: Sequence[str],
        parts: Sequence[np.ndarray],
        named: Mapping[str, Sequence[str]],
    ) -> tuple[str, ...]:
        """Names of all numbers in the columns that were taken, `(n, width)` parts."""
        widths = [part.shape[1] for part in parts]
        total = sum(widths)
        for name in (*(f"{name}_names" for name in taken), *NAMES_OF[option]):
            found = self.columns.get(name)
            if isinstance(found, np.ndarray) and found.dtype.kind == "U" and found.size == total:
                return tuple(found.ravel().tolist())
        names: list[str] = []
        for name, width in zip(taken, widths, strict=True):
            each = [name] if width == 1 and len(widths) > 1 else named.get(name, ())
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
            words = _words_in(self.columns[name])
            if words is None or len(words) != num_rows:
                raise RecordingError(
                    f"--rows is {shown(condition)}; column {name} of {self.path} does not hold one "
                    "word or number for each instant: choose by another"
                )
            chosen &= np.isin(words, [_plain(value) for value in values.split(",")])
        return chosen

    def _choices(self, taken: Collection[str], num_rows: int) -> dict[str, tuple[str, ...]]:
        """The values of all columns that are not taken and have few: words or whole numbers."""
        found = {}
        for name in sorted(set(self.columns) - set(taken)):
            words = _words_in(self.columns[name], few=True)
            if words is not None and len(words) == num_rows:
                found[name] = tuple(np.unique(words).tolist())
        return found


def _read_text(path: Path, delimiter: str | None) -> pa.Table:
    with path.open("rb") as file:
        head = file.read(_HEAD).decode("utf-8", errors="replace")
    if delimiter is None:
        first, *_ = head.splitlines() or [""]
        delimiter = max(_DELIMITERS, key=re.sub(r'"[^"]*"', "", first).count)
    elif len(delimiter) != 1:
        raise RecordingError(f"--delimiter is {shown(delimiter)}; give one character, such as ;")
    # A cell in quotes may hold an array that was printed over several lines.
    options = pa.csv.ParseOptions(delimiter=delimiter, newlines_in_values='"' in head)
    return pa.csv.read_csv(path, parse_options=options)


def _upright(
    q: list[np.ndarray], readings: list[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Arrays with one row for each instant: there are more instants than joints or receptors."""
    if len(q) > 1 or len(readings) > 1 or len(q[0]) == len(readings[0]):
        return q, readings
    for a, b in ((q[0].T, readings[0]), (q[0], readings[0].T), (q[0].T, readings[0].T)):
        if len(a) == len(b) and len(a) > max(a.shape[1], b.shape[1]):
            return [a], [b]
    return q, readings


def _words_in(column: pa.ChunkedArray | np.ndarray, *, few: bool = False) -> np.ndarray | None:
    """What each row of a column holds, as text; None if that is no word and no number.

    If `few`, None as well unless these are few different words or whole numbers.
    """
    if isinstance(column, pa.ChunkedArray):
        kind = column.type
        if pa.types.is_string(kind) or pa.types.is_dictionary(kind):
            column = column.cast(pa.string()).fill_null("")
        elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            return None
        column = column.to_numpy()
    if column.ndim != 1 or column.dtype.kind not in ("iubUO" if few else "iubUOf"):
        return None
    values, place = np.unique(column, return_inverse=True)
    if few and len(values) not in _FEW_VALUES:
        return None
    return np.array([_plain(value) for value in values])[place]


def _plain(value: object) -> str:
    """A word, or a number in one form: 1, 1.0 and "1" are equal."""
    try:
        return f"{float(str(value)):g}"
    except ValueError:
        return str(value)


def _lerobot_names(source: Path) -> dict[str, list[str]]:
    """LeRobot's names for the numbers of each column, where it has any."""
    file = source / "meta" / "info.json"
    if not file.is_file():
        return {}
    try:
        features = json.loads(file.read_text(encoding="utf-8"))["features"]
        names = {name: feature.get("names") for name, feature in features.items()}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise RecordingError(f"{file} is damaged; write it again") from None
    found = {}
    for name, given in names.items():
        # Some versions have a list, others a mapping with one list in it.
        given = next(iter(given.values()), None) if isinstance(given, dict) else given
        if isinstance(given, list):
            found[name] = [str(one) for one in given]
    return found


def _in_order_of_numbers(name: str) -> list[tuple[int, str]]:
    """Names in the order of their numbers: joint_2 before joint_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _of_arrow(column: pa.Array, what: str) -> np.ndarray:
    if isinstance(column, pa.ExtensionArray):
        column = column.storage
    kind = column.type
    if not (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    ):
        try:
            if pa.types.is_string(kind):  # cells such as [0.1, 0.2] or 0.1 0.2
                cells = pa.compute.utf8_trim(column, _AROUND)
                cells = pa.compute.if_else(pa.compute.equal(cells, ""), None, cells)
                lists = pa.compute.split_pattern_regex(cells, _BETWEEN)
                return _of_arrow(lists.cast(pa.list_(pa.float64())), what)
            return column.to_numpy(zero_copy_only=False)
        except pa.ArrowException:
            raise RecordingError(f"{what} holds {kind}; name a column that holds numbers") from None
    there = np.asarray(column.is_valid())
    lengths = np.asarray(pa.compute.list_value_length(column.filter(pa.array(there))))
    if len(lengths) and (lengths != lengths[0]).any():
        row = int(np.flatnonzero(there)[np.flatnonzero(lengths != lengths[0])[0]])
        raise RecordingError(
            f"{what} has arrays of length {lengths[0]}, but another length in row {row}; "
            "record the same number of values in each row"
        )
    values = _of_arrow(column.flatten(), what)
    width = int(lengths[0]) if len(lengths) else 0
    rows = values.reshape(len(lengths), width, *values.shape[1:])
    if there.all():
        return rows
    found = np.full((len(there), *rows.shape[1:]), np.nan)
    found[there] = rows
    return found
