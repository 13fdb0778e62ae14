"""Trials of a run: random plans, executed and rehearsed, and the figures that come of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.rehearsal import RehearsalMemory, Try, best
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.evaluation import (
    MotionScore,
    calibration,
    cosine_distance,
    progress_along,
    score_motion,
    spatial_jerk_reduction,
    summarise,
    time_off_skin,
    wall_points,
)
from selftouch_drake.files import save_arrays
from selftouch_drake.robot.limits import JointLimits, limit_shares
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.motions import (
    Motion,
    Pilot,
    World,
    executed,
    judged,
    load_representation,
    rehearse_motion,
)


def score_motions(
    run: RunDirectory, world: World, progress: Callable[[float, str], None]
) -> dict[str, object]:
    """Plans, executes and rehearses random pairs, and scores them against what was felt.

    The agent begins with a blank memory, whatever the run remembers, so that the figures are the
    same every time. First tries are planned without memory; rehearsals remember those before.

    Args:
        run: a run that has learned.
        world: its world.
        progress: told the fraction done and what is being done.

    Returns:
        Figures as `metrics.json` names them; none if the experiment asks for no pair. What became
        of each pair is kept in the run, as `trial_table` describes.
    """
    pairs = random_pairs(run)
    if not pairs:
        return {}
    representation = load_representation(run)
    wall = wall_points(world.body[0])
    blank = RehearsalMemory.blank(representation)
    first, rehearsing = Pilot(run, blank), Pilot(run, blank)
    planned, motions, rehearsals = [], [], []
    for number, (start, goal) in enumerate(pairs):
        progress(number / len(pairs), f"sensation {start} to {goal}")
        plan = first.plan(start, goal)
        felt = world.probe.sensations(plan["q"])
        planned.append(_score(plan | {"felt": felt}, goal, representation.target_sensations))
        motions.append(executed(world, plan))
        known = judged(motions[-1], goal, representation)
        rehearsals.append(
            rehearse_motion(
                rehearsing,
                world,
                start,
                goal,
                max_tries=run.experiment.execution.max_tries,
                known=known,
            )
        )
        # What stays in the run is the first try, which the figures are about.
        save_arrays(run.plan(start, goal), motions[-1])
    table = trial_table(pairs, motions, rehearsals, representation)
    save_arrays(run.trials, table | run.stamp())
    query_ms = 1e3 * np.array(first.query_s)
    goals = [goal for _, goal in pairs]
    return {
        **summarise(planned, "planning"),
        "planning_jerk_reduction": float(np.median(first.jerk_reduction)),
        "planning_query_ms_median": float(np.median(query_ms)),
        "planning_query_ms_p95": float(np.percentile(query_ms, 95)),
        **execution_figures(motions, goals, representation.target_sensations),
        **limit_figures(motions, world.limits),
        "execution_time_off_skin_s": sum(_time_off_skin(motion, wall) for motion in motions),
        "planning_fingertip_jerk_reduction": _fingertip_jerk_reduction(
            motions, "p_WF_planned", world
        ),
        "execution_fingertip_jerk_reduction": _fingertip_jerk_reduction(
            motions, "p_WF_measured", world
        ),
        **rehearsal_figures(rehearsals),
        "rehearsal_time_off_skin_s": sum(
            _time_off_skin(best(tries).motion, wall) for tries in rehearsals
        ),
    }


def execution_figures(
    motions: list[Motion], goals: list[int], target_sensations: np.ndarray
) -> dict[str, float]:
    """Figures of executed motions, each to its goal."""
    scores = [_score(m, goal, target_sensations) for m, goal in zip(motions, goals, strict=True)]
    tracking = [np.mean(np.square(m["q_measured"] - m["q"])) for m in motions]
    return {
        **summarise(scores, "execution"),
        "execution_tracking_rms_rad": float(np.sqrt(np.mean(tracking))),
        **_calibration_figures(motions),
        "execution_force_max_N": float(max(m["felt"].sum(axis=1).max() for m in motions)),
    }


def limit_figures(motions: list[Motion], limits: JointLimits) -> dict[str, float]:
    """The largest share of each kind of limit that any motion took; above 1 it was exceeded."""
    shares = [
        limit_shares(m["time_s"], m["q"], m["v"], m["q_measured"], m["torque"], limits)
        for m in motions
    ]
    return {f"execution_{kind}_of_limit": max(s[kind] for s in shares) for kind in shares[0]}


def trial_table(
    pairs: list[tuple[int, int]],
    motions: list[Motion],
    rehearsals: list[list[Try[Motion]]],
    representation: QuotientRepresentation,
) -> dict[str, np.ndarray]:
    """What became of each of N pairs, in the order in which they were tried.

    Returns:
        `pairs` `(N, 2)`; shares of the time in contact `(N,)`: `contact_naive` at the first try
        without memory, `contact_remembering` at the first try with the memory of the rehearsals of
        all pairs before, `contact_kept` at the best; whether the goal was reached, under the same
        names with `reached`; `num_tries` `(N,)` of the rehearsal; `prediction_error` `(N,)` of the
        first try without memory.
    """
    naive = [
        judged(motion, goal, representation)
        for motion, (_, goal) in zip(motions, pairs, strict=True)
    ]
    columns = {
        "naive": naive,
        "remembering": [tries[0] for tries in rehearsals],
        "kept": [best(tries) for tries in rehearsals],
    }
    scores = [_score(m, 0, representation.target_sensations) for m in motions]
    return {
        "pairs": np.array(pairs),
        **{f"contact_{name}": np.array([t.contact for t in c]) for name, c in columns.items()},
        **{f"reached_{name}": np.array([t.reached for t in c]) for name, c in columns.items()},
        "num_tries": np.array([len(tries) for tries in rehearsals]),
        "prediction_error": np.array([score.prediction_error for score in scores]),
    }


def rehearsal_figures(rehearsals: list[list[Try[Motion]]]) -> dict[str, object]:
    """Figures of rehearsals in the order in which they were made."""
    kept = [best(tries) for tries in rehearsals]
    contact = [one.contact for one in kept]
    return {
        "rehearsal_first_try_contact_mean": float(np.mean([t[0].contact for t in rehearsals])),
        "rehearsal_reach_rate": float(np.mean([one.reached for one in kept])),
        "rehearsal_contact_mean": float(np.mean(contact)),
        "rehearsal_contact_worst": float(np.min(contact)),
        "rehearsal_tries_mean": float(np.mean([len(tries) for tries in rehearsals])),
    }


def random_pairs(run: RunDirectory) -> list[tuple[int, int]]:
    """The pairs of start and goal that are tried, drawn from the seed without repetition."""
    num_targets = run.experiment.representation.num_targets
    random = np.random.default_rng(run.experiment.random_stream("pairs"))
    wanted = min(run.experiment.evaluation.num_pairs, num_targets * (num_targets - 1))
    codes = random.choice(num_targets * (num_targets - 1), size=wanted, replace=False)
    starts, goals = codes // (num_targets - 1), codes % (num_targets - 1)
    return [(int(i), int(j + (j >= i))) for i, j in zip(starts, goals, strict=True)]


def _calibration_figures(motions: list[Motion]) -> dict[str, float]:
    foretold = [
        m["felt"].any(axis=1) & m["predicted"].any(axis=1) & (m["predicted_spread"] > 0)
        for m in motions
    ]
    found = calibration(
        [
            cosine_distance(m["felt"][rows], m["predicted"][rows])
            for m, rows in zip(motions, foretold, strict=True)
        ],
        [m["predicted_spread"][rows] for m, rows in zip(motions, foretold, strict=True)],
    )
    return {f"execution_prediction_within_{share:.0%}"[:-1]: held for share, held in found.items()}


def _time_off_skin(motion: Motion, wall: cKDTree) -> float:
    return time_off_skin(motion["time_s"], motion["p_WF_measured"], wall)


def _fingertip_jerk_reduction(motions: list[Motion], path: str, world: World) -> float:
    """The median over motions of more than one step, as planned or as measured."""
    to_space = world.probe.kinematics.positions
    measured = path == "p_WF_measured"
    reductions = [
        spatial_jerk_reduction(
            progress_along(motion["s"], motion["q"], motion["q_measured"])
            if measured
            else motion["s"],
            motion[path],
            motion["waypoints_q"],
            to_space,
        )
        for motion in motions
        if len(motion["links"]) > 1
    ]
    return float(np.median(reductions)) if reductions else 1.0


def _score(motion: Motion, goal: int, target_sensations: np.ndarray) -> MotionScore:
    return score_motion(motion["felt"], motion["predicted"], target_sensations, goal)
