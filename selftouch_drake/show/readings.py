"""The figures of `metrics.json` in words: what each means, in its unit, and what would be good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One figure, ready to be read.

    Attributes:
        key: its name in `metrics.json`.
        value: the number with its unit, as text.
        meaning: one line.
        good: what would be good, in a few words; empty where nothing is better than anything else.
    """

    key: str
    value: str
    meaning: str
    good: str = ""


# Stage, then key: meaning and unit. A share is shown in percent.
_STAGES: dict[str, dict[str, tuple[str, str]]] = {
    "Babbling": {
        "babbling_num_samples": ("motor configurations kept because they touched", ""),
        "babbling_num_steps": ("steps of random walk it took to find them", ""),
        "babbling_touch_rate": ("share of the steps that touched", "%"),
        "babbling_force_median_N": ("force of a typical touch", "N"),
        "babbling_force_max_N": ("force of the hardest touch", "N"),
        "babbling_wall_s": ("time it took", "s"),
        "coverage_share_10_touches": ("skin where a fingertip-wide spot was touched 10 times", "%"),
        "coverage_share_100_touches": ("skin where it was touched 100 times", "%"),
        "coverage_evenness": ("entropy of touches over area; 1 is perfectly even", ""),
    },
    "Learning": {
        "representation_num_targets": ("target sensations, each with one motor kernel set", ""),
        "kernel_size_min": ("configurations in the smallest kernel set", ""),
        "kernel_size_median": ("configurations in a typical kernel set", ""),
        "kernel_size_max": ("configurations in the largest kernel set", ""),
        "graph_component_sizes": ("kernels in each part of the graph; one number is one part", ""),
        "graph_bridges": ("edges that joined the parts, the shortest between them", ""),
        "learning_wall_s": ("time it took", "s"),
    },
    "What the graph tells the agent": {
        "topology_betti": ("components, loops and voids of its body", ""),
        "topology_margin": ("weakest true hole over strongest false one; near 1 is unsure", ""),
        "embedding_fourth_eigenvalue": ("what three dimensions leave out of its shape", "%"),
        "intrinsic_dimension": ("dimension of its body; 2 is a surface", ""),
    },
    "Against the truth": {
        "kernel_spread_median_m": ("how far apart a kernel set's true fingertips lie", "m"),
        "kernel_spread_worst_m": ("the same for the widest kernel set", "m"),
        "neighbour_agreement": ("of the 6 nearest kernels, those truly among the 12 nearest", "%"),
        "shape_rms_fraction": ("error of the recovered body, as a share of its extent", "%"),
        "shape_rms_fraction_by_metric": ("the same for each way to measure distance", "%"),
        "trustworthiness": ("near on the recovered body is near on the real one; 1 is always", ""),
        "continuity": ("near on the real body is near on the recovered one; 1 is always", ""),
        "distance_distortion_median_fraction": (
            "error of a typical distance along the recovered body, up to scale",
            "%",
        ),
        "distance_distortion_p95_fraction": ("the same for the worst of twenty", "%"),
        "distance_distortion_median_fraction_by_metric": (
            "error of a typical distance for each way to measure distance",
            "%",
        ),
    },
    "Plans, checked without dynamics": {
        "planning_num_pairs": ("random pairs of start and goal sensation", ""),
        "planning_reach_rate": ("plans that end in the goal sensation", "%"),
        "planning_contact_mean": ("share of a plan in contact with the skin", "%"),
        "planning_contact_worst": ("the same for the worst plan", "%"),
        "planning_prediction_error_mean": ("cosine distance, sensation predicted to felt", ""),
        "planning_jerk_reduction": ("times less jerk than straight steps between kernels", "×"),
        "planning_fingertip_jerk_reduction": ("the same for the fingertip's path in space", "×"),
        "planning_query_ms_median": ("time to plan", "ms"),
        "planning_query_ms_p95": ("the same for the slowest of twenty", "ms"),
    },
    "Plans, executed under dynamics": {
        "execution_num_pairs": ("plans executed by the arm", ""),
        "execution_reach_rate": ("executions that end in the goal sensation", "%"),
        "execution_contact_mean": ("share of an execution in contact with the skin", "%"),
        "execution_contact_worst": ("the same for the worst execution", "%"),
        "execution_tracking_rms_rad": ("angle between commanded and measured joints", "rad"),
        "execution_prediction_error_mean": ("cosine distance, sensation predicted to felt", ""),
        "execution_prediction_within_50": ("felt within the band that was to hold half", "%"),
        "execution_prediction_within_90": ("felt within the band that was to hold 90 %", "%"),
        "execution_force_max_N": ("strongest total force on the skin", "N"),
        "execution_position_of_limit": ("of its range, the most that any joint took", "%"),
        "execution_velocity_of_limit": ("of the speed allowed, the most commanded", "%"),
        "execution_acceleration_of_limit": ("the same of the acceleration", "%"),
        "execution_torque_of_limit": ("the same of the torque, as measured", "%"),
        "execution_time_off_skin_s": ("time off the skin by more than a fingertip's radius", "s"),
        "execution_fingertip_jerk_reduction": ("times less jerk of the fingertip's true path", "×"),
    },
    "The same after rehearsal": {
        "rehearsal_reach_rate": ("rehearsed motions that end in the goal sensation", "%"),
        "rehearsal_contact_mean": ("share of a rehearsed motion in contact", "%"),
        "rehearsal_contact_worst": ("the same for the worst motion", "%"),
        "rehearsal_first_try_contact_mean": ("at first try, remembering the pairs before", "%"),
        "rehearsal_tries_mean": ("tries until contact was never lost", ""),
        "rehearsal_time_off_skin_s": ("time off the skin by more than a fingertip's radius", "s"),
    },
}
# What would be good, for figures that can be good or bad.
_GOOD = {
    "babbling_touch_rate": "3 to 8 % is what random walks give",
    "coverage_share_10_touches": "100 %",
    "coverage_share_100_touches": "near 100 %",
    "coverage_evenness": "above 0.9",
    "kernel_size_min": "above 20",
    "topology_betti": "1, 0, 1 for a ball; 1, 2, 1 for a torus",
    "topology_margin": "above 2",
    "embedding_fourth_eigenvalue": "below 15 %",
    "intrinsic_dimension": "1.8 to 2.4, with one finger",
    "kernel_spread_median_m": "a receptor's spacing or less: 0.02 to 0.05 m",
    "kernel_spread_worst_m": "at most twice the median",
    "neighbour_agreement": "above 90 %",
    "shape_rms_fraction": "below 5 %",
    "planning_reach_rate": "100 %",
    "planning_contact_mean": "above 99 %",
    "planning_contact_worst": "above 90 %",
    "planning_prediction_error_mean": "below 0.05",
    "planning_jerk_reduction": "above 10",
    "planning_query_ms_median": "below 100 ms",
    "execution_reach_rate": "100 %",
    "execution_contact_mean": "above 99 %",
    "execution_contact_worst": "above 90 %",
    "execution_tracking_rms_rad": "below 0.01 rad",
    "execution_prediction_error_mean": "below 0.05",
    "execution_prediction_within_50": "50 %",
    "execution_prediction_within_90": "90 %",
    "execution_force_max_N": "below 30 N: a firm touch",
    "execution_time_off_skin_s": "0 s",
    "rehearsal_reach_rate": "100 %",
    "rehearsal_contact_mean": "above 99.5 %",
    "rehearsal_contact_worst": "above 95 %",
    "rehearsal_time_off_skin_s": "0 s",
}
_HEADLINE = {
    "shape_rms_fraction": "shape error",
    "topology_betti": "components, loops, voids",
    "intrinsic_dimension": "dimension",
    "execution_contact_mean": "contact held",
    "execution_reach_rate": "goals reached",
    "execution_prediction_error_mean": "prediction error",
}


def readings(metrics: Mapping[str, Any]) -> dict[str, list[Reading]]:
    """All figures by stage, in the order of the stages; stages without a figure are left out.

    Args:
        metrics: what `RunDirectory.metrics` returns. Figures of unknown name come last.
    """
    stages = {
        stage: [
            Reading(
                key=key,
                value=_text(metrics[key], unit),
                meaning=meaning,
                good=_GOOD.get(key, ""),
            )
            for key, (meaning, unit) in known.items()
            if key in metrics
        ]
        for stage, known in _STAGES.items()
    }
    known_keys = {key for known in _STAGES.values() for key in known}
    stages["Others"] = [
        Reading(key=key, value=_text(value, ""), meaning="")
        for key, value in metrics.items()
        if key not in known_keys
    ]
    return {stage: figures for stage, figures in stages.items() if figures}


def headline(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The few figures that sum a run up, as far as they are known: name and value."""
    units = {key: unit for known in _STAGES.values() for key, (_, unit) in known.items()}
    return [
        (name, _text(metrics[key], units[key])) for key, name in _HEADLINE.items() if key in metrics
    ]


def _text(value: Any, unit: str) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_text(entry, unit)}" for name, entry in value.items())
    if isinstance(value, list):
        return ", ".join(_text(entry, unit) for entry in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if unit == "%":
        return f"{100 * value:.1f} %"
    number = f"{value:,}" if isinstance(value, int) else f"{value:,.3g}"
    if isinstance(value, float) and abs(value) >= 1000:
        number = f"{value:,.0f}"
    return f"{number} {unit}".rstrip()
