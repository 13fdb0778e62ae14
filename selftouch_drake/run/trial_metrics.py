"""Metrics of trials, as `metrics.json` names them, and their table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from selftouch_drake.evaluation import calibration, summarise
from selftouch_drake.run.trials import Trial


def trial_metrics(trials: Sequence[Trial], turns: np.ndarray) -> dict[str, Any]:
    """Metrics of trials.

    Args:
        trials: one or more.
        turns: `(J,)` bool, whether the unit of a joint is the radian, not the metre.
    """
    if not trials:
        return {}
    query_ms = 1e3 * np.array([trial.query_s for trial in trials])
    kept = [trial.kept[0] for trial in trials]
    tracking = np.mean([trial.tracking for trial in trials], axis=0)
    within = calibration([trial.error for trial in trials], [trial.spread for trial in trials])
    metrics: dict[str, Any] = {
        **summarise([trial.planned for trial in trials], "planning"),
        "planning_contact_straight_mean": float(np.mean([t.contact_straight for t in trials])),
        "planning_num_slides": sum(trial.num_slides for trial in trials),
        "planning_impossible_postures": sum(trial.impossible_planned for trial in trials),
        "planning_jerk_reduction": float(np.median([trial.jerk_reduction for trial in trials])),
        "planning_fingertip_jerk_reduction": _median(t.tip_jerk_planned for t in trials),
        "planning_query_ms_median": float(np.median(query_ms)),
        "planning_query_ms_p95": float(np.percentile(query_ms, 95)),
        **summarise([trial.executed for trial in trials], "execution"),
        "execution_impossible_postures": sum(trial.impossible_executed for trial in trials),
        "execution_tracking_rms_rad": _root_mean(tracking[turns]),
        "execution_tracking_rms_m": _root_mean(tracking[~turns]),
        **{f"execution_prediction_within_{100 * s:.0f}": held for s, held in within.items()},
        "execution_force_max_N": max(trial.force for trial in trials),
        **{
            f"execution_{kind}_of_limit": max(trial.limit_shares[kind] for trial in trials)
            for kind in trials[0].limit_shares
        },
        "execution_time_off_skin_s": _sum(trial.off_skin_s for trial in trials),
        "execution_fingertip_jerk_reduction": _median(t.tip_jerk_measured for t in trials),
        "rehearsal_first_try_contact_mean": float(np.mean([t.remembering[0] for t in trials])),
        "rehearsal_reach_rate": float(np.mean([trial.kept[1] for trial in trials])),
        "rehearsal_contact_mean": float(np.mean(kept)),
        "rehearsal_contact_worst": min(kept),
        "rehearsal_tries_mean": float(np.mean([trial.num_tries for trial in trials])),
        "rehearsal_time_off_skin_s": _sum(trial.off_skin_kept_s for trial in trials),
    }
    return {key: value for key, value in metrics.items() if value is not None}


def trial_table(trials: Sequence[Trial]) -> dict[str, np.ndarray]:
    """The results of N pairs in the order of their trials, as a file stores them.

    Returns:
        `pairs` `(N, 2)`; shares of the time in contact `(N,)`: `contact_naive` at the first try
        without memory, `contact_remembering` at the first try with the memory of the rehearsals of
        all pairs before, `contact_kept` at the best; whether the goal was reached, under the same
        names with `reached`; `num_tries` `(N,)` of the rehearsal; `prediction_error` `(N,)` of the
        first try without memory.
    """
    judged = {
        "naive": [trial.first for trial in trials],
        "remembering": [trial.remembering for trial in trials],
        "kept": [trial.kept for trial in trials],
    }
    return {
        "pairs": np.array([(trial.start, trial.goal) for trial in trials]),
        **{f"contact_{name}": np.array([c for c, _ in column]) for name, column in judged.items()},
        **{f"reached_{name}": np.array([r for _, r in column]) for name, column in judged.items()},
        "num_tries": np.array([trial.num_tries for trial in trials]),
        "prediction_error": np.array([trial.executed.prediction_error for trial in trials]),
    }


def _root_mean(squares: np.ndarray) -> float | None:
    return float(np.sqrt(squares.mean())) if squares.size else None


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else 1.0


def _sum(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(sum(known)) if known else None
