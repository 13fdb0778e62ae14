"""The table of a sweep: all metrics of all runs."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from selftouch_drake.experience.store import UNREADABLE
from selftouch_drake.files import written_whole
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.naming import fields_of, leaves
from selftouch_drake.sweep.design import Sweep
from selftouch_drake.sweep.directory import SweepDirectory, run_name

# Columns that are not metrics, before those of the fields that vary.
_KEYS = ("run", "experiment", "seed", "error")
# Key of the table's metadata that names the fields that vary.
_FIELDS = b"selftouch.fields"


def gather(sweep: Sweep, directory: SweepDirectory, failed: dict[str, str]) -> pa.Table:
    """Writes the metrics of all runs to `table.parquet` and returns them.

    Columns: `run`, `experiment`, `seed`, `error` (null where there was none), the fields that vary
    by their dotted names, then every metric of `metrics.json`; missing ones are null.
    """
    varied = [field for field in sweep.fields if field != "seed"]
    rows = [
        _row(directory.run(experiment), varied, failed.get(run_name(experiment)))
        for experiment in sweep.experiments
    ]
    columns = dict.fromkeys(key for row in rows for key in row)
    table = pa.table({key: _column([row.get(key) for row in rows]) for key in columns})
    table = table.replace_schema_metadata({_FIELDS: "\n".join(varied).encode()})
    with written_whole(directory.table) as aside:
        pq.write_table(table, aside, compression="zstd", write_page_checksum=True)
    return table


def _row(run: RunDirectory, varied: list[str], error: str | None) -> dict[str, Any]:
    """A run with the fields that vary, and its metrics as far as they are there.

    Args:
        run: of the sweep, whether it exists or not.
        varied: names of the fields that vary, dotted.
        error: why the run failed, if it did.
    """
    metrics: dict[str, Any] = {}
    try:
        if run.path.is_dir():
            metrics = run.metrics()
    except RunError as damage:  # the row says why it has none
        error = error or str(damage)
    row = {
        "run": run.path.name,
        "experiment": run.experiment.name,
        "seed": run.experiment.seed,
        "error": error,
    }
    fields = fields_of(run.experiment)
    row |= {field: fields.get(field) for field in varied}
    return row | leaves(metrics)


def _column(values: list) -> pa.Array:
    """The values as a column; as texts, if they are of many kinds."""
    try:
        return pa.array(values)
    except pa.ArrowException:
        return pa.array([None if value is None else str(value) for value in values])


def read_table(path: Path) -> pa.Table:
    """Reads the table of a sweep.

    Raises:
        ValueError: the file is damaged, or is not such a table.
    """
    try:
        table = pq.read_table(path, page_checksum_verification=True)
        fields = (table.schema.metadata or {}).get(_FIELDS, b"none").decode().split("\n")
        there = {*table.column_names, ""}
    except FileNotFoundError:
        raise
    except UNREADABLE as error:
        reason = str(error).splitlines()[0]
        raise ValueError(f"{path} is damaged ({reason}); run the sweep again") from None
    if not {*_KEYS, *fields} <= there:
        raise ValueError(f"{path} is not the table of a sweep; run the sweep again")
    return table


def varied_fields(table: pa.Table) -> list[str]:
    """The fields that vary, as the table's columns name them."""
    text = table.schema.metadata[_FIELDS].decode()
    return [field for field in text.split("\n") if field]


def metric_columns(table: pa.Table) -> list[str]:
    """The columns that are metrics."""
    others = {*_KEYS, *varied_fields(table)}
    return [name for name in table.column_names if name not in others]
