"""Reads recordings of other robots: tables with named columns, as the robot's own tools write them.

A recording is a Parquet, CSV or NPZ file, or a folder of files of one kind. Folders in the layout
of LeRobot (`meta/info.json`, `data/`) are understood.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet as pq

from selftouch_drake.experience.store import UNREADABLE
from selftouch_drake.experiment import closest, shown
from selftouch_drake.files import load_arrays

#: Default names, tried in order; `#` stands for a number, one column for each.
Q_NAMES = ("q", "observation.state", "state", "joint_positions", "q_#", "joint_#", "joint#")
SENSATION_NAMES = (
    *("sensation", "observation.touch", "observation.tactile", "observation.skin"),
    *("touch", "tactile", "taxels", "skin", "readings"),
    *("taxel_#", "sensation_#", "touch_#", "tactile_#", "taxel#"),
)
TIME_NAMES = ("time_s", "time", "timestamp", "t")
EPISODE_NAMES = ("episode_index", "episode", "walk")
_KINDS = (".parquet", ".csv", ".npz")

#: Columns by name, of a table or of an archive of arrays.
Columns = Mapping[str, pa.ChunkedArray | np.ndarray]


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
        num_rows: rows in the files.
        num_incomplete: number of rows left out because a number was missing, NaN or infinite.
    """

    q: np.ndarray
    readings: np.ndarray
    time_s: np.ndarray | None
    piece: np.ndarray
    joints: tuple[str, ...]
    receptors: tuple[str, ...]
    num_rows: int
    num_incomplete: int

    def speeds(self) -> np.ndarray | None:
        """`(m, J)` per second, between successive rows of a piece; None without time."""
        if self.time_s is None:
            return None
        dt = np.diff(self.time_s)
        follows = (np.diff(self.piece) == 0) & (dt > 0)
        if not follows.any():
            return None
        return np.abs(np.diff(self.q.astype(float), axis=0)[follows]) / dt[follows, None]


def read_recording(
    source: Path, *, q: str | None = None, sensation: str | None = None, time: str | None = None
) -> Recording:
    """Reads a file, or a folder of files of one kind.

    Args:
        source: a Parquet, CSV or NPZ file, or a folder; in LeRobot's layout the files under `data`
            are read.
        q: the column of motor configurations, with an array in each row; or several columns with
            one number each, as names separated by commas or as a pattern (`joint_*`), in the order
            of their numbers. By default the first of `Q_NAMES` that exists.
        sensation: the columns of raw readings, likewise; by default the first of `SENSATION_NAMES`.
        time: the column of seconds; by default the first of `TIME_NAMES` that exists, if any.

    Raises:
        FileNotFoundError: the source does not exist.
        RecordingError: a column does not exist, shapes disagree, or no row is complete.
        ValueError: a file is damaged.
    """
    files = _files(source)
    named = _lerobot_names(source)
    parts = [_read(path, q, sensation, time, named, piece) for piece, path in enumerate(files)]
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
    joined = Recording(
        q=np.concatenate([part.q for part in parts]),
        readings=np.concatenate([part.readings for part in parts]),
        time_s=np.concatenate(times) if len(times) == len(parts) else None,
        piece=np.concatenate([part.piece for part in parts]),
        joints=first.joints,
        receptors=first.receptors,
        num_rows=sum(part.num_rows for part in parts),
        num_incomplete=sum(part.num_incomplete for part in parts),
    )
    if not len(joined.q):
        raise RecordingError(
            f"{source} has no complete row: in each of {joined.num_rows} a number is missing; "
            "record q and sensation in the same row"
        )
    return joined


def _files(source: Path) -> list[Path]:
    if source.is_file():
        if source.suffix.lower() not in _KINDS:
            raise RecordingError(f"{source} is not a {_words(_KINDS)} file; convert it to one")
        return [source]
    if not source.is_dir():
        raise FileNotFoundError(f"{source} does not exist; give a file or a folder")
    folder = source / "data" if (source / "meta" / "info.json").is_file() else source
    found = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _KINDS]
    kinds = sorted({path.suffix.lower() for path in found})
    if not found:
        raise RecordingError(f"{folder} holds no {_words(_KINDS)} file; give another folder")
    if len(kinds) > 1:
        raise RecordingError(f"{folder} holds files of kinds {', '.join(kinds)}; give one kind")
    return found


def _read(
    path: Path,
    q: str | None,
    sensation: str | None,
    time: str | None,
    named: Mapping[str, Sequence[str]],
    number: int,
) -> Recording:
    columns = _columns(path)
    joints, configurations = _taken(columns, "--q", q, Q_NAMES, path, named)
    receptors, readings = _taken(columns, "--sensation", sensation, SENSATION_NAMES, path, named)
    time_s = _single(columns, "--time", time, TIME_NAMES, path)
    episode = _single(columns, "", None, EPISODE_NAMES, path)
    num_rows = len(configurations)
    for name, rows in (("sensation", readings), ("time", time_s)):
        if rows is not None and len(rows) != num_rows:
            raise RecordingError(
                f"{path} has {num_rows} rows of q and {len(rows)} of {name}; record them together"
            )
    complete = np.isfinite(configurations).all(axis=1) & np.isfinite(readings).all(axis=1)
    if time_s is not None:
        complete &= np.isfinite(time_s)
    # An episode ends with its file.
    piece = np.zeros(num_rows) if episode is None else np.nan_to_num(episode[:num_rows])
    return Recording(
        q=configurations[complete],
        readings=readings[complete],
        time_s=None if time_s is None else time_s[complete],
        piece=number * 1_000_000 + piece[complete].astype(np.int64),
        joints=joints,
        receptors=receptors,
        num_rows=num_rows,
        num_incomplete=int(num_rows - complete.sum()),
    )


def _columns(path: Path) -> Columns:
    if path.suffix.lower() == ".npz":
        return load_arrays(path)
    try:
        table = pq.read_table(path) if path.suffix.lower() == ".parquet" else pa.csv.read_csv(path)
    except UNREADABLE as error:
        reason = " ".join(str(error).split())[:200]
        raise RecordingError(f"{path} is damaged ({reason}); write it again") from None
    return {name: table.column(name) for name in table.column_names}


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
    # Some versions have a list, others a mapping with one list in it.
    lists = {
        name: next(iter(n.values()), None) if isinstance(n, dict) else n
        for name, n in names.items()
    }
    return {
        name: [str(n) for n in found] for name, found in lists.items() if isinstance(found, list)
    }


def _taken(
    columns: Columns,
    option: str,
    asked: str | None,
    defaults: Sequence[str],
    path: Path,
    named: Mapping[str, Sequence[str]],
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and `(n, width)` numbers of the columns that an option asks for."""
    chosen = _chosen(columns, option, asked, defaults, path)
    parts = [_numbers(columns[name], f"column {name} of {path}") for name in chosen]
    if len(parts) == 1 and parts[0].ndim > 1:
        rows, name = parts[0].reshape(len(parts[0]), -1), chosen[0]
        width = rows.shape[1]
        names = named.get(name, ())
        if len(names) != width:
            names = [f"{name}[{number}]" for number in range(width)]
        return tuple(names), rows
    for name, part in zip(chosen, parts, strict=True):
        if part.ndim > 1 or len(part) != len(parts[0]):
            raise RecordingError(
                f"column {name} of {path} has shape {part.shape}; {option} takes one column of "
                "arrays, or several with one number in each row"
            )
    return tuple(chosen), np.stack(parts, axis=1)


def _chosen(
    columns: Columns, option: str, asked: str | None, defaults: Sequence[str], path: Path
) -> list[str]:
    there = ", ".join(list(columns)[:20]) + (", ..." if len(columns) > 20 else "")
    if asked is None:
        for name in defaults:
            numbered = re.escape(name).replace(r"\#", r"\d+")
            if found := [column for column in columns if re.fullmatch(numbered, column)]:
                return sorted(found, key=_in_order_of_numbers)
        raise RecordingError(
            f"{path} has no column with a usual name for {option}; it has {there}: "
            f"name the column, as in {option} '{defaults[0]}' or {option} '{defaults[-1][:-1]}*'"
        )
    chosen: list[str] = []
    for entry in asked.split(","):
        found = [entry] if entry in columns else [c for c in columns if fnmatchcase(c, entry)]
        if not found:
            hint = closest(entry, columns) or f"it has {there}"
            raise RecordingError(f"{option} is {shown(entry)}; {path} has no such column: {hint}")
        chosen += sorted(found, key=_in_order_of_numbers)
    return chosen


def _in_order_of_numbers(name: str) -> list[tuple[int, str]]:
    """Names in the order of their numbers: joint_2 before joint_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _single(
    columns: Columns, option: str, asked: str | None, defaults: Sequence[str], path: Path
) -> np.ndarray | None:
    """`(n,)` a column with one number in each row; None if none is named and none is found."""
    if asked is None:
        asked = next((name for name in defaults if name in columns), None)
    if asked is None:
        return None
    if asked not in columns:
        hint = closest(asked, columns) or f"it has {', '.join(list(columns)[:20])}"
        raise RecordingError(f"{option} is {shown(asked)}; {path} has no such column: {hint}")
    numbers = _numbers(columns[asked], f"column {asked} of {path}")
    return numbers.reshape(len(numbers), -1)[:, 0].astype(float)


def _numbers(column: pa.ChunkedArray | np.ndarray, what: str) -> np.ndarray:
    """`(n, ...)` numbers of a column; NaN where one is missing."""
    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
        if isinstance(column, pa.ChunkedArray):
            column = pa.concat_arrays(column.chunks)
        column = _of_arrow(column, what)
    if column.dtype.kind not in "fiub":
        raise RecordingError(f"{what} holds {column.dtype}; name a column that holds numbers")
    if column.ndim == 0:
        raise RecordingError(f"{what} is one number; give one row for each instant")
    return _narrow(column)


def _of_arrow(column: pa.Array, what: str) -> np.ndarray:
    if isinstance(column, pa.ExtensionArray):
        column = column.storage
    kind = column.type
    if not (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    ):
        try:
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


def _narrow(numbers: np.ndarray) -> np.ndarray:
    """The same numbers in a smaller type: CSV files and lists use eight bytes for each."""
    if numbers.dtype.kind == "b":
        return numbers.astype(np.uint8)
    if numbers.dtype.itemsize < 8 or not numbers.size or numbers.dtype.kind == "f":
        return numbers
    return numbers.astype(np.result_type(*map(np.min_scalar_type, (numbers.min(), numbers.max()))))


def _words(kinds: Sequence[str]) -> str:
    return ", ".join(kind[1:] for kind in kinds[:-1]) + f" or {kinds[-1][1:]}"
