"""Columns of recorded files as numbers and as words, whatever kind of file holds them."""

import numpy as np
import pyarrow as pa
import pyarrow.compute

from selftouch_drake.experience.containers.contents import Column
from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.experience.store import one_chunk

# What stands around and between the numbers of a list that is written as text.
_WRAPPED = r"^\s*(np\.)?(array|tensor)\(|,\s*(dtype|device)=.*$"
_AROUND, _BETWEEN = " \t\r\n[](){},;", r"[\s,;]+"
# A column with so many different words or whole numbers may say what touched.
_FEW_VALUES = range(2, 21)


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
        if _is_text(kind) or pa.types.is_dictionary(kind):
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
            if pa.types.is_null(kind):
                return np.full(len(column), np.nan)
            if pa.types.is_decimal(kind):
                column = column.cast(pa.float64())
            if _is_text(kind):
                return _of_arrow(_lists_in_text(column), what)
            return column.to_numpy(zero_copy_only=False)
        except pa.ArrowException:
            if _is_text(kind) and pa.compute.any(pa.compute.match_substring(column, "...")).as_py():
                raise RecordingError(
                    f"{what} has arrays that were printed with ... in them; write all numbers"
                ) from None
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


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _is_list(kind: pa.DataType) -> bool:
    return (
        pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    )


def _lists_in_text(column: pa.Array) -> pa.Array:
    """Cells such as `[0.1, 0.2]`, `0.1 0.2` or `array([0.1, 0.2])` as lists of numbers."""
    column = pa.compute.replace_substring_regex(column, _WRAPPED, "")
    cells = pa.compute.utf8_trim(column, _AROUND)
    cells = pa.compute.if_else(pa.compute.equal(cells, ""), None, cells)
    return pa.compute.split_pattern_regex(cells, _BETWEEN).cast(pa.list_(pa.float64()))
