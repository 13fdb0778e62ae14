"""Columns of recorded files as numbers and as words, whatever kind of file holds them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.feather
import pyarrow.parquet as pq

from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.store import UNREADABLE, one_chunk
from selftouch_drake.experience.text_table import read_text_table
from selftouch_drake.files import load_arrays

#: Endings of the files that are read, of tables as text and of all.
TEXT_KINDS = (".csv", ".tsv")
KINDS = (".parquet", ".feather", *TEXT_KINDS, ".npz", ".npy", ".mat")

#: A column of a table, or an array of an archive.
Column: TypeAlias = pa.ChunkedArray | np.ndarray
# What stands around and between the numbers of a list that is written as text.
_AROUND, _BETWEEN = " \t\r\n[](){},;", r"[\s,;]+"
# A column with so many different words or whole numbers may say what touched.
_FEW_VALUES = range(2, 21)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns:
    """What a file holds.

    Attributes:
        by_name: each column, by its name.
        clashing: names that several columns with different content have.
        num_broken: number of rows left out because they could not be read.
        notes: what was understood that the reader of the summary should know.
    """

    by_name: Mapping[str, Column]
    clashing: frozenset[str] = frozenset()
    num_broken: int = 0
    notes: tuple[str, ...] = ()


def read_columns(files: Sequence[Path], delimiter: str | None) -> Columns:
    """All columns of a file, or of several `.npy` files that hold one array each.

    The delimiter is as of `read_recording`.

    Raises:
        RecordingError: a file is damaged, or the delimiter is more than one character.
        ValueError: an archive is damaged.
    """
    path, *others = files
    kind = path.suffix.lower()
    if kind == ".npy":
        return Columns(by_name=_loose_arrays([path, *others]))
    if kind == ".npz":
        return Columns(by_name=load_arrays(path))
    if kind == ".mat":
        return Columns(by_name=_matlab_arrays(path))
    try:
        if kind in TEXT_KINDS:
            text = read_text_table(path, delimiter)
            named = _by_name(text.names, text.columns)
            return Columns(
                by_name=named[0], clashing=named[1], num_broken=text.num_broken, notes=text.notes
            )
        read = pyarrow.feather.read_table if kind == ".feather" else pq.read_table
        table = read(path)
    except UNREADABLE as error:
        reason = " ".join(str(error).split())[:200]
        raise RecordingError(f"{path} is damaged ({reason}); write it again") from None
    by_name, clashing = _by_name(table.column_names, table.columns)
    return Columns(by_name=by_name, clashing=clashing)


def _by_name(
    names: Sequence[str], columns: Sequence[pa.ChunkedArray]
) -> tuple[dict[str, Column], frozenset[str]]:
    """Columns by name, and the names that columns with different content share."""
    found: dict[str, Column] = {}
    clashing = set()
    for name, column in zip(names, columns, strict=True):
        if not name:
            continue
        if name in found and not column.equals(found[name]):
            clashing.add(name)
        found.setdefault(name, column)
    return found, frozenset(clashing)


def _loose_arrays(files: Sequence[Path]) -> dict[str, Column]:
    """The array of each `.npy` file, by its name without what all begin with, as in `walk1_q`."""
    found: dict[str, Column] = {}
    beginning = ""
    if len(files) > 1:
        least, most = min(path.stem for path in files), max(path.stem for path in files)
        alike = [one == other for one, other in zip(least, most, strict=False)]
        common = least[: alike.index(False)] if False in alike else least
        beginning = common[: common.rfind("_") + 1]
    for path in files:
        try:
            found[path.stem.removeprefix(beginning)] = np.load(path, allow_pickle=False)
        # For truncated, damaged and foreign files, numpy raises a dozen kinds of errors.
        except Exception as error:
            reason = " ".join(str(error).split())[:200].rstrip(".")
            raise RecordingError(f"{path} is damaged ({reason}); write it again") from None
    return found


def _matlab_arrays(path: Path) -> dict[str, Column]:
    """The arrays of a MATLAB file; those in one of several structs have names such as `data.q`."""
    from scipy.io import loadmat  # no other run needs it

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise RecordingError(
            f"{path} is a MATLAB file of version 7.3; save it with -v7, or as npz"
        ) from None
    # For truncated, damaged and foreign files, scipy raises a dozen kinds of errors.
    except Exception as error:
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise RecordingError(f"{path} is damaged ({reason}); write it again") from None
    content = {name: value for name, value in content.items() if not name.startswith("__")}
    while len(content) == 1 and isinstance(inner := next(iter(content.values())), Mapping):
        content = dict(inner)
    return _flat(content)


def _flat(content: Mapping[str, Any], under: str = "") -> dict[str, Column]:
    """Arrays by name, those of a mapping within by the names of both."""
    found: dict[str, Column] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{under}{name}.")
        else:
            words = isinstance(value, list) and all(isinstance(one, str) for one in value)
            array = np.array(value, dtype=str) if words else np.asarray(value)
            if array.dtype.kind == "O" and all(isinstance(one, str) for one in array.ravel()):
                array = array.astype(str)
            if array.dtype.kind in "fiubUMm":
                found[f"{under}{name}"] = array
    return found


def numbers_in(column: Column, what: str) -> np.ndarray:
    """`(n, ...)` numbers of a column, which errors call `what`; NaN where one is missing.

    Raises:
        RecordingError: it does not hold a number, or an array of numbers, in each row.
    """
    numbers = _of_arrow(one_chunk(column), what) if isinstance(column, pa.ChunkedArray) else column
    if numbers.dtype.kind not in "fiub":
        raise RecordingError(f"{what} holds {numbers.dtype}; name a column that holds numbers")
    if numbers.ndim == 0:
        raise RecordingError(f"{what} is one number; give one row for each instant")
    if numbers.dtype.kind == "b":
        return numbers.astype(np.uint8)
    if numbers.dtype.kind != "f" and numbers.dtype.itemsize == 8 and numbers.size:
        # CSV files and lists use eight bytes for each number.
        ends = map(np.min_scalar_type, (numbers.min(), numbers.max()))
        numbers = numbers.astype(np.result_type(*ends))
    return numbers


def words_in(column: Column, *, few: bool = False) -> np.ndarray | None:
    """`(n,)` what each row of a column holds, as text; None if that is no word and no number.

    If `few`, None as well unless these are few different words or whole numbers.
    """
    if isinstance(column, pa.ChunkedArray):
        kind = column.type
        if pa.types.is_string(kind) or pa.types.is_dictionary(kind):
            column = column.cast(pa.string()).fill_null("")
        elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            return None
        column = column.to_numpy()
    whole_or_words = "iubUO"
    if column.ndim != 1 or column.dtype.kind not in (whole_or_words if few else "iubUOf"):
        return None
    values, place = np.unique(column, return_inverse=True)
    if few and len(values) not in _FEW_VALUES:
        return None
    return np.array([plain(value) for value in values])[place]


def plain(value: object) -> str:
    """A word, or a number in one form: 1, 1.0 and "1" are equal."""
    try:
        return f"{float(str(value)):g}"
    except ValueError:
        return str(value)


def _of_arrow(column: pa.Array, what: str) -> np.ndarray:
    """`(n, ...)` what a column holds, lists of one length as further axes; NaN if missing."""
    if isinstance(column, pa.ExtensionArray):
        column = column.storage
    kind = column.type
    if not _is_list(kind):
        try:
            if pa.types.is_string(kind):
                return _of_arrow(_lists_in_text(column), what)
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


def _is_list(kind: pa.DataType) -> bool:
    return (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    )


def _lists_in_text(column: pa.Array) -> pa.Array:
    """Cells such as `[0.1, 0.2]` or `0.1 0.2` as lists of numbers."""
    cells = pa.compute.utf8_trim(column, _AROUND)
    cells = pa.compute.if_else(pa.compute.equal(cells, ""), None, cells)
    return pa.compute.split_pattern_regex(cells, _BETWEEN).cast(pa.list_(pa.float64()))
