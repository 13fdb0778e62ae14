"""Pictures of a sweep: each metric against each field that varies."""

import math
import textwrap
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from selftouch_drake.files import written_whole
from selftouch_drake.run.metrics import BY_KEY, Metric
from selftouch_drake.show.style import styled
from selftouch_drake.sweep.table import metric_columns, varied_fields

_NUM_COLUMNS = 4
#: A run: its experiment, seed, fields that vary, and those of its metrics that are numbers.
Row = dict[str, Any]


def draw_sweep_figures(table: pa.Table, folder: Path) -> list[Path]:
    """Draws one picture for each field that varies, and returns their paths.

    Each metric that changes has a panel. A line is the median over the seeds of one experiment, a
    band goes from the smallest value to the largest. If one value of another field is the most
    frequent, as where each field varies alone, only rows with that value count; if none is, as in a
    grid, all rows count.
    """
    folder.mkdir(parents=True, exist_ok=True)
    fields = varied_fields(table)
    rows = _numbers(table)
    others = {"experiment", "seed", *fields}
    names = dict.fromkeys(name for row in rows for name in row if name not in others)
    paths = []
    for field in fields:
        chosen = _along(field, rows, fields)
        changing = [name for name in names if _changes(name, chosen)]
        varies = len({str(row[field]) for row in chosen}) > 1
        if not (varies and changing):
            continue
        path = folder / f"{field}.png"
        figure = _draw(field, chosen, changing)
        with written_whole(path) as aside:
            figure.savefig(aside, format="png")
        paths.append(path)
    return paths


def label(name: str) -> str:
    """A column as the table names it, with the unit of its metric."""
    metric = _metric(name)
    return f"{name} ({metric.unit})" if metric is not None and metric.unit else name


def _metric(name: str) -> Metric | None:
    """The metric that a column is of, or an entry of: `topology_betti[0]`, `by_skin.head`."""
    return BY_KEY.get(name.partition(".")[0].partition("[")[0])


def _numbers(table: pa.Table) -> list[Row]:
    """The rows, with lists of numbers spread over columns and all other values left out."""
    kept = ("experiment", "seed", *varied_fields(table))
    names = metric_columns(table)
    rows = []
    for row in table.to_pylist():
        numbers = {key: row[key] for key in kept}
        for name in names:
            for key, value in _entries(name, row[name]).items():
                if isinstance(value, (int, float)) and math.isfinite(value):
                    # Yes and no become 1 and 0, which have quantiles.
                    numbers[key] = float(value)
        rows.append(numbers)
    return rows


def _entries(name: str, value: Any) -> dict[str, Any]:
    """A value by its name, or each entry of a list by the name with its place."""
    if isinstance(value, list):
        return {f"{name}[{i}]": entry for i, entry in enumerate(value)}
    return {name: value}


def _changes(name: str, rows: list[Row]) -> bool:
    """Whether a metric has two values or more."""
    return len({row[name] for row in rows if name in row}) > 1


def _along(field: str, rows: list[Row], fields: list[str]) -> list[Row]:
    """The rows in which only `field` varies, as far as there is a usual value of the others."""
    for other in fields:
        if other == field:
            continue
        counts = Counter(str(row[other]) for row in rows).most_common(2)
        if len(counts) == 1 or counts[0][1] > counts[1][1]:
            usual = counts[0][0]
            rows = [row for row in rows if str(row[other]) == usual]
    return rows


@styled
def _draw(field: str, rows: list[Row], names: list[str]) -> Figure:
    """A picture with a panel for each metric."""
    num_rows = math.ceil(len(names) / _NUM_COLUMNS)
    figure = Figure(figsize=(3.2 * _NUM_COLUMNS, 2.3 * num_rows), layout="constrained")
    panels = figure.subplots(num_rows, _NUM_COLUMNS, squeeze=False).ravel()
    for panel, name in zip(panels, names, strict=False):
        _draw_panel(panel, field, name, rows)
    for panel in panels[len(names) :]:
        panel.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
    figure.suptitle(f"Over the {label(field)}", x=0.01, ha="left")
    return figure


def _draw_panel(panel: Axes, field: str, name: str, rows: list[Row]) -> None:
    """One metric against a field; values that are no numbers stand side by side."""
    values = {str(row[field]): row[field] for row in rows}
    numeric = all(type(value) in (int, float) for value in values.values())
    if numeric:
        places = sorted(values.values())
        place_of = {str(place): place for place in places}
    else:
        places = sorted(values)
        place_of = {place: number for number, place in enumerate(places)}
    for experiment in dict.fromkeys(row["experiment"] for row in rows):
        found = defaultdict(list)
        for row in rows:
            if row["experiment"] == experiment and name in row:
                found[place_of[str(row[field])]].append(row[name])
        _draw_band(panel, found, name, experiment)
    if not numeric:
        panel.set_xticks(range(len(places)), places)
    elif places[0] > 0 and places[-1] > 20 * places[0]:
        panel.set_xscale("log")
    panel.set_title("\n".join(textwrap.wrap(label(name), 44)), fontsize=8)


def _draw_band(panel: Axes, found: dict[float, list[float]], name: str, experiment: str) -> None:
    """Median, smallest and largest value of a metric at each place."""
    places = sorted(found)
    spread = [np.quantile(found[place], (0, 0.5, 1)) for place in places]
    low, middle, high = np.reshape(spread, (-1, 3)).T
    metric = _metric(name)
    if metric is not None and metric.unit == "%":
        low, middle, high = 100 * low, 100 * middle, 100 * high
    (line,) = panel.plot(places, middle, marker=".", label=experiment)
    panel.fill_between(places, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
