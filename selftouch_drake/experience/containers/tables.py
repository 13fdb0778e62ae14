"""Tables of pyarrow: Parquet, Feather and Arrow files; and columns of tables by their names."""

import zlib
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq

from selftouch_drake.experience.containers.contents import Column, Contents, damaged
from selftouch_drake.experience.containers.text import read_text_table
from selftouch_drake.experience.store import UNREADABLE

# How pandas calls an index that has no name.
_INDEX = "__index_level_0__"


def read_text(path: Path, delimiter: str | None) -> Contents:
    """A table that is written as text.

    Raises:
        RecordingError: it is damaged, or the delimiter is more than one character.
    """
    try:
        text = read_text_table(path, delimiter)
    except (*UNREADABLE, EOFError, zlib.error) as error:
        raise damaged(path, error) from None
    by_name, clashing = columns_by_name(text.names, text.columns)
    return Contents(
        by_name=by_name, clashing=clashing, num_broken=text.num_broken, notes=text.notes
    )


def read_arrow(path: Path) -> Contents:
    """A Parquet, Feather or Arrow file.

    Raises:
        RecordingError: it is damaged.
    """
    skipped: list[str] = []
    try:
        if path.suffix.lower() == ".parquet":
            # Pictures would take all memory.
            schema = pq.read_schema(path)
            kept = [field.name for field in schema if not _is_picture(field.type)]
            skipped = [field.name for field in schema if _is_picture(field.type)]
            table = pq.read_table(path, columns=kept if skipped else None)
        else:
            table = _feather_or_stream(path)
    except UNREADABLE as error:
        raise damaged(path, error) from None
    names = table.column_names
    if _INDEX in names and "time" not in names:
        kind = table.schema.field(_INDEX).type
        is_time = pa.types.is_timestamp(kind) or pa.types.is_duration(kind)
        names = ["time" if name == _INDEX and is_time else name for name in names]
    by_name, clashing = columns_by_name(names, table.columns)
    return Contents(by_name=by_name, clashing=clashing, skipped=tuple(skipped))


def _is_picture(kind: pa.DataType) -> bool:
    return pa.types.is_struct(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind)


def _feather_or_stream(path: Path) -> pa.Table:
    """Hugging Face's data sets are streams, what pyarrow and pandas write has a footer."""
    try:
        return pyarrow.feather.read_table(path)
    except pa.ArrowInvalid:
        with pa.memory_map(str(path)) as source, pa.ipc.open_stream(source) as stream:
            return stream.read_all()


def columns_by_name(
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
