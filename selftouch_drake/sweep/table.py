"""The table of a sweep, and pictures of each metric against each field that varies."""

import math
import textwrap
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.experience.store import UNREADABLE
from selftouch_drake.files import written_whole
from selftouch_drake.run.directory import RunError
from selftouch_drake.run.metrics import BY_KEY, Metric
from selftouch_drake.run.naming import fields_of, leaves
from selftouch_drake.show.style import styled
from selftouch_drake.sweep.design import Sweep
from selftouch_drake.sweep.runs import SweepDirectory, run_name

# Columns that are not metrics, before those of the fields that vary.
_KEYS = ("run", "experiment", "seed", "error")
# Key of the table's metadata that names the fields that vary.
_FIELDS = b"selftouch.fields"


def gather(sweep: Sweep, directory: SweepDirectory, failed: dict[str, str]) -> pa.Table:
    """Writes the metrics of all runs to `table.parquet` and returns them.

    Columns: `run`, `experiment`, `seed`, `error` (null where there was none), the fields that vary
    by their dotted names, then every metric of `metrics.json`; missing ones are null.
    """
    rows: list[dict[str, Any]] = []
    varied = [field for field in sweep.fields if field != "seed"]
    for experiment in sweep.experiments:
        run, fields = directory.run(experiment), fields_of(experiment)
        name = run_name(experiment)
        row = {
            "run": name,
            "experiment": experiment.name,
            "seed": experiment.seed,
            "error": failed.get(name),
        }
        row |= {field: fields.get(field) for field in varied}
        try:
            metrics = run.metrics() if run.path.is_dir() else {}
        except RunError as error:  # the row says why it has none
            row["error"], metrics = row["error"] or str(error), {}
        rows.append(row | leaves(metrics))
    columns = dict.fromkeys(key for row in rows for key in row)
    table = pa.table({key: _column([row.get(key) for row in rows]) for key in columns})
    table = table.replace_schema_metadata({_FIELDS: "\n".join(varied).encode()})
    with written_whole(directory.table) as aside:
        pq.write_table(table, aside, compression="zstd", write_page_checksum=True)
    return table


def _column(values: list) -> pa.Array:
    try:
        return pa.array(values)
    except pa.ArrowException:  # values of many kinds
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


def figure_names(table: pa.Table) -> list[str]:
    """The columns that are metrics."""
    others = {*_KEYS, *varied_fields(table)}
    return [name for name in table.column_names if name not in others]


_NUM_COLUMNS = 4
Row = dict[str, Any]


def draw_figures(table: pa.Table, folder: Path) -> list[Path]:
    """Draws one picture for each field that varies, and returns their paths.

    Each metric that changes has a panel. A line is the median over the seeds of one experiment, a
    band goes from the smallest value to the largest. If one value of another field is the most
    frequent, as where each field varies alone, only rows with that value count; if none is, as in a
    grid, all rows count.
    """
    folder.mkdir(parents=True, exist_ok=True)
    fields, rows, paths = varied_fields(table), _numbers(table), []
    others = {"experiment", "seed", *fields}
    for field in fields:
        chosen = _along(field, rows, fields)
        names = dict.fromkeys(name for row in rows for name in row if name not in others)
        changing = [n for n in names if len({row[n] for row in chosen if n in row}) > 1]
        if len({str(row[field]) for row in chosen}) < 2 or not changing:
            continue
        path = folder / f"{field}.png"
        figure = _draw(field, chosen, changing)
        with written_whole(path) as aside:
            figure.savefig(aside, format="png")
        paths.append(path)
    return paths


def _numbers(table: pa.Table) -> list[Row]:
    """The rows, with lists of numbers spread over columns and all other values left out."""
    rows = []
    for row in table.to_pylist():
        numbers = {key: row[key] for key in ("experiment", "seed", *varied_fields(table))}
        for name in figure_names(table):
            value, entries = row[name], {name: row[name]}
            if isinstance(value, list):
                entries = {f"{name}[{i}]": entry for i, entry in enumerate(value)}
            for key, number in entries.items():
                if isinstance(number, (int, float)) and math.isfinite(number):
                    # Yes and no become 1 and 0, which have quantiles.
                    numbers[key] = float(number)
        rows.append(numbers)
    return rows


def label(name: str) -> str:
    """A column as the table names it, with the unit of its metric."""
    metric = _metric(name)
    return f"{name} ({metric.unit})" if metric is not None and metric.unit else name


def _metric(name: str) -> Metric | None:
    """The metric that a column is of, or an entry of: `topology_betti[0]`, `by_skin.head`."""
    return BY_KEY.get(name.partition(".")[0].partition("[")[0])


def _along(field: str, rows: list[Row], fields: list[str]) -> list[Row]:
    """The rows in which only `field` varies, as far as there is a usual value of the others."""
    for other in fields:
        if other == field:
            continue
        counts = Counter(str(row[other]) for row in rows).most_common(2)
        if len(counts) == 1 or counts[0][1] > counts[1][1]:
            rows = [row for row in rows if str(row[other]) == counts[0][0]]
    return rows


@styled
def _draw(field: str, rows: list[Row], names: list[str]) -> Figure:
    num_rows = math.ceil(len(names) / _NUM_COLUMNS)
    figure = Figure(figsize=(3.2 * _NUM_COLUMNS, 2.3 * num_rows), layout="constrained")
    panels = figure.subplots(num_rows, _NUM_COLUMNS, squeeze=False).ravel()
    for panel, name in zip(panels, names, strict=False):
        _panel(panel, field, name, rows)
    for panel in panels[len(names) :]:
        panel.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    figure.suptitle(f"Over the {label(field)}", x=0.01, ha="left")
    return figure


def _panel(panel: Axes, field: str, name: str, rows: list[Row]) -> None:
    values = {str(row[field]): row[field] for row in rows}
    numeric = all(type(value) in (int, float) for value in values.values())
    places = sorted(values.values() if numeric else values)
    at = {str(place): place if numeric else i for i, place in enumerate(places)}
    for experiment in dict.fromkeys(row["experiment"] for row in rows):
        found = defaultdict(list)
        for row in rows:
            if row["experiment"] == experiment and name in row:
                found[at[str(row[field])]].append(row[name])
        x = sorted(found)
        spread = [np.quantile(found[place], (0, 0.5, 1)) for place in x]
        low, middle, high = np.reshape(spread, (-1, 3)).T
        metric = _metric(name)
        if metric is not None and metric.unit == "%":
            low, middle, high = 100 * low, 100 * middle, 100 * high
        (line,) = panel.plot(x, middle, marker=".", label=experiment)
        panel.fill_between(x, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    if not numeric:
        panel.set_xticks(range(len(places)), places)
    elif places[0] > 0 and places[-1] > 20 * places[0]:
        panel.set_xscale("log")
    panel.set_title("\n".join(textwrap.wrap(label(name), 44)), fontsize=8)
