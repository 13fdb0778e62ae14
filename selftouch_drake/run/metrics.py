"""The one table of the metrics in `metrics.json`: meaning, unit, target, and stage.

The report, the headline and the stages read it. A stage that runs again removes the metrics of
later stages. A metric without a meaning for an experiment is absent, such as the shape error with
two fingers on one hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """One metric of `metrics.json`.

    Attributes:
        key: its name there.
        meaning: one line.
        unit: `%` for a share, which is stored as 0 to 1; empty for a plain number.
        stage: the stage that makes it: babble, learn or evaluate.
        section: its heading in the report.
        target: which value is good, in a few words; empty if no value is better than another.
        headline: its name in the headline; empty if the headline does not show it.
    """

    key: str
    meaning: str
    unit: str
    stage: str
    section: str
    target: str = ""
    headline: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One metric of a run, as text.

    Attributes:
        key: its name in `metrics.json`.
        value: the number with its unit, as text.
        meaning: one line.
        target: which value is good; empty if no value is better than another.
    """

    key: str
    value: str
    meaning: str
    target: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One of the few metrics that summarise a run.

    Attributes:
        name: in a few words.
        value: the number with its unit, as text.
        explanation: what it measures, and which value is good.
    """

    name: str
    value: str
    explanation: str


# Heading and stage, then key, unit, meaning and target of each metric.
_BABBLING = (
    ("babbling_num_samples", "", "touches that were kept", ""),
    ("babbling_num_steps", "", "steps of the random walk that found them", ""),
    ("babbling_touch_rate", "%", "share of the steps that touched", ""),
    (
        "babbling_num_impossible",
        "",
        "touching steps in a posture that the robot cannot take; not kept",
        "",
    ),
    ("babbling_touches_by_skin", "", "touches of each skin", "above 0 for each skin"),
    ("babbling_force_median_N", "N", "total force of the median touch", ""),
    ("babbling_force_max_N", "N", "total force of the hardest touch", ""),
    ("babbling_wall_s", "s", "duration of the stage", ""),
)
_IMPORT = (
    ("import_num_rows", "", "rows of the recording", ""),
    ("import_num_incomplete", "", "rows left out because a number was missing", "0"),
    ("import_num_null", "", "rows left out because nothing was felt", ""),
    ("import_offset_median", "", "reading of a typical receptor at rest, in raw units", ""),
    ("import_drift_max", "", "largest change of the resting level of a receptor, in raw units", ""),
    ("import_noise_median", "", "standard deviation of a typical receptor at rest", ""),
    ("import_threshold_median", "", "smallest reading above rest that counts as a touch", ""),
    ("import_num_lone", "", "readings left out because no other receptor shared them", ""),
    (
        "import_num_fading",
        "",
        "rows left out because pressure fell, if readings decay slowly",
        "",
    ),
    ("import_silent_receptors", "", "receptors that never read anything", "none"),
    ("import_still_joints", "", "joints that never move", "none"),
)
_COVERAGE = (
    (
        "coverage_share_10_touches",
        "%",
        "share of the skin's area with 10 touches on each fingertip-wide spot",
        "100 %",
    ),
    (
        "coverage_share_100_touches",
        "%",
        "share of the skin's area with 100 touches on each spot: it takes a million touches",
        "",
    ),
    (
        "coverage_evenness",
        "",
        "entropy of the touches over the skin's area; 1 is perfectly even",
        "above 0.9",
    ),
)
_LEARNING = (
    ("representation_num_targets", "", "target sensations, each with one motor kernel set", ""),
    ("representation_num_set_aside", "", "touches of two places at once; not used", ""),
    ("kernel_size_min", "", "motor configurations in the smallest kernel", "above 20"),
    ("kernel_size_median", "", "motor configurations in the median kernel", ""),
    ("kernel_size_max", "", "motor configurations in the largest kernel", ""),
    ("graph_component_sizes", "", "number of kernels in each component of the quotient graph", ""),
    ("graph_bridges", "", "bridges: edges added to join the components of one part", ""),
    ("learning_wall_s", "s", "duration of the stage", ""),
)
_FOUND = (
    (
        "parts_found",
        "",
        "parts of the body that the agent found: no touch joins them",
        "equal to parts_true",
    ),
    (
        "topology_betti",
        "",
        "components, loops and voids of the recovered body",
        "1, 0, 1 for a ball; 1, 2, 1 for a torus",
    ),
    (
        "topology_betti_by_part",
        "",
        "components, loops and voids of each recovered part",
        "equal to topology_betti_true_by_part",
    ),
    (
        "topology_margin",
        "",
        "weakest hole that counts over the strongest that does not; near 1 is unsure",
        "above 2",
    ),
    (
        "shape_expected_error",
        "%",
        "error of the shape that the agent itself expects, of the worst part",
        "below 4 %",
    ),
    (
        "shape_trusted",
        "",
        "whether the agent trusts shape and holes: expected error below 4 %, margin 4 or more",
        "yes",
    ),
    (
        "embedding_fourth_eigenvalue",
        "%",
        "share of the shape that three dimensions leave out",
        "below 15 %",
    ),
    (
        "intrinsic_dimension",
        "",
        "dimension of the recovered body; 2 is a surface",
        "1.8 to 2.4, with one finger",
    ),
    ("intrinsic_dimension_by_part", "", "dimension of each recovered part", "1.8 to 2.4"),
    ("shape_doubt_by_part", "", "where the shape metric was doubted, and what was done", ""),
)
_TRUTH = (
    ("parts_true", "", "parts that the robot can truly touch", ""),
    (
        "topology_betti_true_by_part",
        "",
        "true components, loops and voids of the touched area of each part",
        "",
    ),
    (
        "kernel_spread_median_m",
        "m",
        "distance between the true touches of one kernel, root mean square",
        "at most the receptors' spacing: 0.02 to 0.05 m",
    ),
    (
        "kernel_spread_worst_m",
        "m",
        "the same for the widest kernel",
        "at most twice the median",
    ),
    (
        "neighbour_agreement",
        "%",
        "share of the 6 nearest kernels that are truly among the 12 nearest",
        "above 90 %",
    ),
    (
        "shape_rms_fraction",
        "%",
        "shape error: RMS distance of recovered from true places, as a share of the body's size",
        "below 5 %",
    ),
    (
        "surface_rms_fraction",
        "%",
        "the same with places on the surface of the skin: contacts lie inside, where it gives way",
        "below 5 %",
    ),
    ("shape_rms_fraction_by_skin", "%", "shape error of each skin", "below 6 %"),
    ("shape_rms_fraction_by_metric", "%", "shape error by each shape metric", ""),
    (
        "trustworthiness",
        "",
        "kernels near on the recovered body are near on the real one; 1 is perfect, 0.5 is chance",
        "",
    ),
    (
        "continuity",
        "",
        "kernels near on the real body are near on the recovered one; 1 is perfect, 0.5 is chance",
        "",
    ),
    (
        "distance_distortion_median_fraction",
        "%",
        "error of the median distance along the recovered body, up to scale",
        "",
    ),
    ("distance_distortion_p95_fraction", "%", "the same for the 95th percentile", ""),
    (
        "distance_distortion_median_fraction_by_metric",
        "%",
        "error of the median distance by each shape metric",
        "",
    ),
)
_PLANNING = (
    ("planning_num_pairs", "", "random pairs of start and goal for which a plan was made", ""),
    (
        "planning_num_without_way",
        "",
        "further pairs without a plan, because rigid parts would run into each other",
        "0",
    ),
    ("planning_reach_rate", "%", "share of the plans that end in the goal sensation", "100 %"),
    ("planning_contact_mean", "%", "share of a plan that touches the skin", "above 99 %"),
    ("planning_contact_worst", "%", "the same for the worst plan", "above 90 %"),
    (
        "planning_contact_straight_mean",
        "%",
        "mean share in contact before the agent improved its plans by sliding",
        "",
    ),
    ("planning_num_slides", "", "steps that the agent replaced by slides, in all plans", ""),
    (
        "planning_impossible_postures",
        "",
        "samples of the plans in which rigid parts run into each other",
        "0",
    ),
    (
        "planning_prediction_error_mean",
        "",
        "difference between predicted and felt sensation, 0 to 1 (cosine distance)",
        "below 0.05",
    ),
    (
        "planning_jerk_reduction",
        "×",
        "jerk of straight steps between the kernels, over that of the plan",
        "above 10",
    ),
    (
        "planning_fingertip_jerk_reduction",
        "×",
        "the same for the fingertips' paths in space",
        "",
    ),
    ("planning_query_ms_median", "ms", "time for one plan", "below 100 ms"),
    ("planning_query_ms_p95", "ms", "the same for the 95th percentile", ""),
)
_EXECUTION = (
    ("execution_num_pairs", "", "plans executed by the robot", ""),
    (
        "execution_reach_rate",
        "%",
        "share of the executions that end in the goal sensation",
        "100 %",
    ),
    ("execution_contact_mean", "%", "share of an execution that touches the skin", "above 99 %"),
    ("execution_contact_worst", "%", "the same for the worst execution", "above 90 %"),
    (
        "execution_impossible_postures",
        "",
        "steps of the plant in which rigid parts run into each other",
        "0",
    ),
    (
        "execution_tracking_rms_rad",
        "rad",
        "tracking error of the joints that turn, RMS",
        "below 0.01 rad",
    ),
    (
        "execution_tracking_rms_m",
        "m",
        "tracking error of the joints that slide, RMS",
        "below 0.005 m",
    ),
    (
        "execution_prediction_error_mean",
        "",
        "difference between predicted and felt sensation, 0 to 1 (cosine distance)",
        "below 0.05",
    ),
    (
        "execution_prediction_within_50",
        "%",
        "share of felt sensations within the band predicted to hold half of them",
        "50 %",
    ),
    (
        "execution_prediction_within_90",
        "%",
        "share of felt sensations within the band predicted to hold 90 %",
        "90 %",
    ),
    ("execution_force_max_N", "N", "largest total force on the skin", "below 30 N: a firm touch"),
    (
        "execution_position_of_limit",
        "%",
        "largest share of its range that a joint used",
        "at most 100 %",
    ),
    (
        "execution_velocity_of_limit",
        "%",
        "largest share of its speed limit that a joint was commanded",
        "at most 100 %",
    ),
    ("execution_acceleration_of_limit", "%", "the same for the acceleration", "at most 100 %"),
    ("execution_torque_of_limit", "%", "the same for the torque, as measured", "at most 100 %"),
    (
        "execution_time_off_skin_s",
        "s",
        "time during which the fingertip was more than its radius away from the skin",
        "0 s",
    ),
    (
        "execution_fingertip_jerk_reduction",
        "×",
        "jerk of straight steps over that of the measured fingertips' paths",
        "",
    ),
)
_REHEARSAL = (
    (
        "rehearsal_reach_rate",
        "%",
        "share of rehearsed motions that end in the goal sensation",
        "100 %",
    ),
    (
        "rehearsal_contact_mean",
        "%",
        "share of a rehearsed motion that touches the skin",
        "above 99.5 %",
    ),
    ("rehearsal_contact_worst", "%", "the same for the worst motion", "above 95 %"),
    (
        "rehearsal_first_try_contact_mean",
        "%",
        "mean share in contact at first tries, with memory of earlier pairs",
        "",
    ),
    ("rehearsal_tries_mean", "", "tries until contact was never lost, mean", ""),
    (
        "rehearsal_time_off_skin_s",
        "s",
        "time during which the fingertip was more than its radius away from the skin",
        "0 s",
    ),
)
_SECTIONS = (
    ("Babbling", "babble", _BABBLING),
    ("Imported data", "babble", _IMPORT),
    ("Coverage of the skin", "evaluate", _COVERAGE),
    ("Learning", "learn", _LEARNING),
    ("What the agent found out about its body", "learn", _FOUND),
    ("Against the truth", "evaluate", _TRUTH),
    ("Plans, checked without dynamics", "evaluate", _PLANNING),
    ("Plans, executed under dynamics", "evaluate", _EXECUTION),
    ("Plans, after rehearsal", "evaluate", _REHEARSAL),
)
# The metrics that summarise a run, each with its name and an explanation for newcomers.
_HEADLINE = {
    "shape_rms_fraction": (
        "shape error",
        "distance of the recovered places from the true ones, as a share of the body's size; "
        "below 5 % the body is easy to recognise",
    ),
    "shape_expected_error": (
        "expected by the agent",
        "error of the shape that the agent expects, without knowing the truth",
    ),
    "shape_trusted": (
        "trusted",
        "whether the agent trusts its shape and holes: expected error below 4 %, holes with a "
        "margin of 4 or more",
    ),
    "parts_found": ("parts", "pieces of the body that no touch joins; one skin is one part"),
    "topology_betti": (
        "components, loops, voids",
        "1, 0, 1 is one closed surface without handles, 1, 2, 1 a torus",
    ),
    "topology_betti_by_part": (
        "components, loops, voids by part",
        "1, 0, 1 is closed, 1, 0, 0 a patch with one rim, 1, 1, 0 an open tube",
    ),
    "intrinsic_dimension": (
        "dimension",
        "number of directions in which one can move on the body; a surface has 2",
    ),
    "execution_contact_mean": (
        "contact held",
        "share of the time in which motions touch the skin; at 99 % or more, a finger hardly ever "
        "loses contact",
    ),
    "execution_reach_rate": (
        "goals reached",
        "share of the motions that end in the goal sensation; 100 % is best",
    ),
    "execution_prediction_error_mean": (
        "prediction error",
        "difference between expected and felt sensations, without a unit: 0 is none, 1 is nothing "
        "in common; below 0.05 is good",
    ),
}
#: Every metric, in the order of the report.
METRICS = tuple(
    Metric(
        key=key,
        meaning=meaning,
        unit=unit,
        stage=stage,
        section=section,
        target=target,
        headline=_HEADLINE.get(key, ("", ""))[0],
    )
    for section, stage, entries in _SECTIONS
    for key, unit, meaning, target in entries
)


def keys_of(*stages: str) -> frozenset[str]:
    """The keys of the metrics that some stages make."""
    return frozenset(metric.key for metric in METRICS if metric.stage in stages)


def readings(metrics: Mapping[str, Any]) -> dict[str, list[Reading]]:
    """All metrics of a run by section, in order; sections without a metric are left out.

    Args:
        metrics: as `RunDirectory.metrics` returns them. Unknown ones come last.
    """
    found: dict[str, list[Reading]] = {}
    for metric in METRICS:
        if metric.key in metrics:
            reading = Reading(
                key=metric.key,
                value=_text(metrics[metric.key], metric.unit),
                meaning=metric.meaning,
                target=metric.target,
            )
            found.setdefault(metric.section, []).append(reading)
    known = {metric.key for metric in METRICS}
    others = [
        Reading(key=key, value=_text(value, ""), meaning="")
        for key, value in metrics.items()
        if key not in known
    ]
    return found | ({"Others": others} if others else {})


def headline(metrics: Mapping[str, Any]) -> list[Tile]:
    """The few metrics that summarise a run, if known."""
    units = {metric.key: metric.unit for metric in METRICS}
    return [
        Tile(name=name, value=_text(metrics[key], units[key]), explanation=explanation)
        for key, (name, explanation) in _HEADLINE.items()
        if key in metrics
    ]


def _text(value: Any, unit: str) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(entry, unit)}" for name, entry in value.items())
    if isinstance(value, list):
        nested = any(isinstance(entry, list) for entry in value)
        return ("; " if nested else ", ").join(_text(entry, unit) for entry in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, int | float):
        return str(value)
    if unit == "%":
        return f"{100 * value:.1f} %"
    number = f"{value:,}" if isinstance(value, int) else f"{value:,.3g}"
    if isinstance(value, float) and abs(value) >= 1000:
        number = f"{value:,.0f}"
    return f"{number} {unit}".rstrip()
