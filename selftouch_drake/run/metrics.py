"""The metrics in `metrics.json`, as `metrics.csv` describes them, and how they are read.

The report, the headline and the stages read this one table. A stage that runs again removes the
metrics of later stages. A metric without a meaning for an experiment is absent, such as the shape
error with two fingers on one hand.
"""

import csv
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric of `metrics.json`.

    Attributes:
        section: its heading in the report.
        stage: the stage that makes it: babble, learn or evaluate.
        key: its name there.
        unit: `%` for a share, which is stored as 0 to 1; `percent` for what is stored in percent;
            empty for a plain number.
        target: which value is good, in a few words; empty if no value is better than another, or
            if how good it is says more of the experiment than of the agent.
        meaning: one line.
    """

    section: str
    stage: str
    key: str
    unit: str
    target: str
    meaning: str


_TABLE = Path(__file__).with_name("metrics.csv").read_text(encoding="utf-8").splitlines()
#: Every metric, in the order of the report.
METRICS = tuple(Metric(**row) for row in csv.DictReader(_TABLE))
BY_KEY = {metric.key: metric for metric in METRICS}


@dataclass(frozen=True, slots=True)
class MetricText:
    """One metric of a run, as text.

    Attributes:
        name: its key in `metrics.json`; among what summarises a run, in a few words.
        value: the number with its unit, as text.
        metric: what the table says about it.
        missed: whether the value misses its target.
    """

    name: str
    value: str
    metric: Metric
    missed: bool


@dataclass(frozen=True, slots=True)
class MotionRow:
    """How good the agent's motions between random pairs of sensations are, of one kind.

    Attributes:
        name: of the kind, as in `before practice`.
        explanation: what kind of motion it is.
        cells: one text for each of `MOTION_COLUMNS` but the first; empty if unknown.
        missed: of each, whether it misses its target.
    """

    name: str
    explanation: str
    cells: list[str]
    missed: list[bool]


#: The headings of rows of motions.
MOTION_COLUMNS = ("motions", "contact", "worst", "reached", "prediction error", "path / shortest")
# The few metrics that summarise what the agent knows of its body, in a few words.
_TILES = {
    "surface_rms_fraction": "shape error",
    "shape_expected_error": "expected by the agent",
    "shape_trusted": "trusted",
    "parts_found": "parts",
    "parts_doubt": "number of parts not sure",
    "kernels_in_fragments": "kernels on fragments",
    "skins_not_recovered": "skins touched, not recovered",
    "topology_betti": "components, loops, voids",
    "topology_betti_by_part": "components, loops, voids by part",
    "intrinsic_dimension": "dimension",
    "embedding_dimension": "dimension of space",
    "body_model_accepted": "body model accepted",
    "body_model_place_error_percent": "error of imagined places",
}
_MOTIONS = {
    "unpractised": (
        "before practice",
        "the plans as the agent makes them from what it has learned, never followed; without "
        "dynamics",
    ),
    "planning": (
        "practised",
        "the plans after the agent followed them slowly and found other ways where they failed; "
        "without dynamics",
    ),
    "execution": ("executed", "the practised plans under dynamics"),
    "unpractised_execution": (
        "executed before practice",
        "the plans before practice under dynamics",
    ),
}
_OF_MOTIONS = (
    "contact_mean",
    "contact_worst",
    "reach_rate",
    "prediction_error_mean",
    "path_over_shortest_median",
)


def keys_of(*stages: str) -> frozenset[str]:
    """The keys of the metrics that some stages make."""
    return frozenset(metric.key for metric in METRICS if metric.stage in stages)


def metric_texts(metrics: Mapping[str, Any]) -> dict[str, list[MetricText]]:
    """All metrics of a run by section, in order, unknown ones last; no section is empty.

    They are as `RunDirectory.metrics` returns them.
    """
    found: dict[str, list[MetricText]] = {}
    unknown = [Metric("Others", "", key, "", "", "") for key in metrics if key not in BY_KEY]
    for metric in (*METRICS, *unknown):
        if metric.key in metrics:
            reading = _metric_text(metric, metrics, metric.key)
            found.setdefault(metric.section, []).append(reading)
    return found


def tiles(metrics: Mapping[str, Any]) -> list[MetricText]:
    """What the agent of a run knows of its body, as far as it is known."""
    return [
        _metric_text(BY_KEY[k], metrics, _tile_name(k, metrics)) for k in _TILES if k in metrics
    ]


def _tile_name(key: str, metrics: Mapping[str, Any]) -> str:
    """What summarises a run in a few words; of one part, nothing is `by part`."""
    one = key.endswith("_by_part") and len(metrics[key]) == 1
    return _TILES[key.removesuffix("_by_part") if one else key]


def motions(metrics: Mapping[str, Any]) -> list[MotionRow]:
    """The motions of the agent of a run, one kind in each row; empty if it has made none."""
    rows = []
    for kind, (name, explanation) in _MOTIONS.items():
        keys = [f"{kind}_{ending}" for ending in _OF_MOTIONS]
        cells = [_text(metrics[k], BY_KEY[k].unit) if k in metrics else "" for k in keys]
        if any(cells):
            missed = [k in metrics and misses_target(BY_KEY[k], metrics) for k in keys]
            rows.append(MotionRow(name, explanation, cells, missed))
    return rows


def _metric_text(metric: Metric, metrics: Mapping[str, Any], name: str) -> MetricText:
    value = _text(metrics[metric.key], metric.unit)
    return MetricText(name, value, metric, misses_target(metric, metrics))


# What a target says, and when a value misses it.
_TARGETS: tuple[tuple[str, Callable[[float, float], bool]], ...] = (
    (r"below ([\d.]+)", operator.ge),
    (r"above ([\d.]+)", operator.le),
    (r"at most ([\d.]+)", operator.gt),
    (r"([\d.]+) or more", operator.lt),
    (r"(100) %$", operator.lt),
    (r"(0)( s)?$", operator.gt),
)
# The metric that holds the target of another.
_TRUE = {
    "parts_found": "parts_true",
    "topology_betti_by_part": "topology_betti_true_by_part",
}


def misses_target(metric: Metric, metrics: Mapping[str, Any]) -> bool:
    """Whether the value of a metric misses a target that can be judged without more knowledge.

    Where a metric has several values, one that misses is enough.
    """
    value = metrics[metric.key]
    if (true := metrics.get(_TRUE.get(metric.key, ""))) is not None:
        if isinstance(true, list):
            pairs = zip(true, value, strict=False)
            return any(right is not None and right != found for right, found in pairs)
        return bool(value != true)
    if metric.target == "yes":
        return value is False
    if metric.target == "none":
        return bool(value)
    values = list(value.values()) if isinstance(value, Mapping) else [value]
    scale = 100.0 if metric.unit == "%" else 1.0
    for pattern, misses in _TARGETS:
        if found := re.match(pattern, metric.target):
            numbers = [v for v in values if isinstance(v, int | float)]
            return any(misses(round(scale * v, 9), float(found[1])) for v in numbers)
    return False


def _text(value: Any, unit: str) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(entry, unit)}" for name, entry in value.items())
    if isinstance(value, list):
        nested = any(isinstance(entry, list | str) for entry in value)
        return ("; " if nested else ", ").join(_text(entry, unit) for entry in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float):
        return str(value)
    if unit == "%":
        return f"{100 * value:.1f} %"
    if unit == "percent":
        return f"{value:.2f} %"
    number = f"{value:,}" if isinstance(value, int) else f"{value:,.3g}"
    if isinstance(value, float) and abs(value) >= 1000:
        number = f"{value:,.0f}"
    return f"{number} {unit}".rstrip()
