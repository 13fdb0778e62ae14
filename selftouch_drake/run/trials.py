"""Trials: random pairs of start and goal, planned, executed, rehearsed and scored.

First tries are independent of each other and may be made in several processes. Rehearsals follow in
order, because each remembers the earlier ones. Only the parts of their scores stay in memory.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Felt
from selftouch_drake.agent.lifelong.expectation import cosine_distance
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.agent.tries import Try, best, judged_try
from selftouch_drake.bodies.drake import DrakeFelt, DrakeFollowed
from selftouch_drake.bodies.embodiment import Bodies, pilot_in
from selftouch_drake.evaluation.executed import ExecutedTruth, ExecutionScorer
from selftouch_drake.evaluation.motion import (
    MotionScore,
    jerk_reduction,
    random_pairs,
    score_motion,
    share_within_scale,
    summarise,
)
from selftouch_drake.evaluation.paths import OwnPaths, TruePaths
from selftouch_drake.files import content_digest
from selftouch_drake.run.artifacts import load_agent, save_plan
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn, map_ahead
from selftouch_drake.run.worlds import run_bodies
from selftouch_drake.threads import OncePerThread

# First tries that may wait for the rehearsals of earlier pairs.
_MOST_AHEAD = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstTry:
    """The result of the first try of one pair of start and goal, without memory.

    Attributes:
        start: target sensation.
        goal: target sensation.
        unpractised: the plan before practice, scored without dynamics; None if the body cannot be
            at rest everywhere.
        unpractised_executed: the same as felt under dynamics.
        planned: the practised plan, scored without dynamics; None likewise.
        executed: the same as felt under dynamics.
        query_s: s, duration of planning.
        jerk_reduction: of the plan, in motor space.
        over_shortest: length of the practised plan on the skin over the shortest way, in the
            agent's own lengths; None if it lifts off, or where `OwnPaths` does not know.
        true_over_shortest: the same by the truth; None likewise, or if nobody knows it.
        unpractised_true_over_shortest: the same of the plan before practice.
        unpractised_lifts_off: whether that plan goes through the air anywhere.
        num_slides: ways that practice found for steps of the plan.
        errors: `(n,)` cosine distances from predicted to felt, in their predicted scales.
        overlap_planned: `(T,)` bool, samples of the plan at which the body cannot be; None if it
            cannot be at rest everywhere.
        overlap_unpractised: `(T,)` bool, the same of the plan before practice; None likewise.
        truth: of the execution; None if nobody knows it.
    """

    start: int
    goal: int
    unpractised: MotionScore | None
    unpractised_executed: MotionScore
    planned: MotionScore | None
    executed: MotionScore
    query_s: float
    jerk_reduction: float
    over_shortest: float | None
    true_over_shortest: float | None
    unpractised_true_over_shortest: float | None
    unpractised_lifts_off: bool
    num_slides: int
    errors: np.ndarray
    overlap_planned: np.ndarray | None
    overlap_unpractised: np.ndarray | None
    truth: ExecutedTruth | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial(FirstTry):
    """The result of one pair of start and goal, with the rehearsal that follows the first try.

    Attributes:
        remembering: the first try with the memory of the rehearsals of all pairs before.
        kept: the best try.
        num_tries: of the rehearsal.
        off_skin_kept_s: s, as `truth.off_skin_s`, for the best try.
    """

    remembering: MotionScore
    kept: MotionScore
    num_tries: int
    off_skin_kept_s: float | None


class FirstTries:
    """Makes and scores first tries of an agent without memory.

    Args:
        pilot: an agent in its body, with its stored sensations, for predictions without practice.
        bodies: its bodies.

    Attributes:
        agent: the agent without memory.
    """

    def __init__(self, pilot: Pilot, bodies: Bodies):
        representation = pilot.agent.representation
        self.agent = pilot.agent.recalling(RehearsalMemory.blank(representation))
        self._pilot, self._still = pilot, bodies.still
        pilot.agent = self.agent
        pilot.prepare_queries()
        world = bodies.world
        self._scorer = None if world is None else ExecutionScorer(world)
        self._own = OwnPaths(representation)
        self._true = None if world is None else TruePaths([s.fields for s in world.skins])

    def first(self, start: int, goal: int) -> tuple[FirstTry, Try] | None:
        """The first try of a pair; None if no way is found."""
        try:
            planned_motion = self._pilot.plan(start, goal)
        except NoWayError:
            return None
        motion, representation = planned_motion.motion, self.agent.representation
        unpractised = self._pilot.motion(planned_motion.unpractised)
        blind, _ = self._pilot.execute(unpractised, practised=False)
        execution, followed = self._pilot.execute(motion)
        blind_slowly, blind_felt = self._slowly(unpractised)
        planned, felt = self._slowly(motion)
        overlap = _overlap(felt)
        own_path, true_path = self._over_shortest(motion, felt)
        truth = None
        if self._scorer is not None and isinstance(followed, DrakeFollowed):
            truth = self._scorer.truth(execution, followed.log)
        first = FirstTry(
            start=start,
            goal=goal,
            unpractised=blind_slowly,
            unpractised_executed=self.score(blind),
            planned=planned,
            executed=self.score(execution),
            query_s=planned_motion.seconds,
            jerk_reduction=jerk_reduction(planned_motion.plan, representation.joint_scale),
            over_shortest=own_path,
            true_over_shortest=true_path,
            unpractised_true_over_shortest=self._over_shortest(unpractised, blind_felt)[1],
            unpractised_lifts_off=bool(unpractised.plan.in_air.any()),
            num_slides=len(planned_motion.agent.memory.slides.ends),
            errors=_prediction_errors(execution),
            overlap_planned=overlap,
            overlap_unpractised=_overlap(blind_felt),
            truth=truth,
        )
        return first, judged_try(execution, representation)

    def _over_shortest(
        self, motion: Motion, felt: Felt | None
    ) -> tuple[float | None, float | None]:
        """`over_shortest` and `true_over_shortest` of `FirstTry`, of what was felt slowly."""
        if felt is None or not motion.touching.all():
            return None, None
        own, true = self._own.over_shortest(felt.sensation), None
        if self._true is not None and isinstance(felt, DrakeFelt):
            true = self._true.over_shortest(felt.contacts)
        return own, true

    def score(self, execution: Execution) -> MotionScore:
        """An execution, scored as it was felt."""
        return score_motion(execution.motion, execution.felt, self.agent.representation)

    def off_skin_s(self, execution: Execution) -> float | None:
        """As in `ExecutionScorer`; None if nobody knows."""
        return None if self._scorer is None else self._scorer.off_skin_s(execution)

    def _slowly(self, motion: Motion) -> tuple[MotionScore | None, Felt | None]:
        """A motion, scored as it is felt slowly, and what is felt; None if the body cannot."""
        if self._still is None:
            return None, None
        felt = self._still.feel(motion.q)
        return score_motion(motion, felt.sensation, self.agent.representation), felt


def _overlap(felt: Felt | None) -> np.ndarray | None:
    """`(T,)` bool, samples of a motion at which the body cannot be; None if nobody knows."""
    return None if felt is None else ~felt.reached


def try_pairs(
    run: RunDirectory,
    bodies: Bodies,
    agent: Agent,
    progress: Callable[[float, str], None],
    executor: Executor | None = None,
) -> tuple[list[Trial], list[tuple[int, int]]]:
    """Plans, executes and rehearses random pairs, and scores each against what was felt.

    The agent begins with a blank memory, whatever the run remembers, so that the metrics are the
    same every time. First tries are planned without memory, here or by the executor, whose
    processes load the agent from the run; rehearsals remember earlier ones. The run keeps the first
    try of each pair, because the metrics describe it.

    Returns:
        The trials, and the pairs for which no way was found.

    Raises:
        ChildProcessError: a process of the executor was killed.
    """
    tries = FirstTries(pilot_in(bodies, agent, run.experiment), bodies)
    learned = content_digest(run.representation)
    _tries.keep(tries, run, learned)
    rehearsing = pilot_in(bodies, tries.agent, run.experiment)
    max_tries = run.experiment.execution.max_tries
    pairs = random_pairs(run.experiment, agent.representation)
    trials, without_way = list[Trial](), list[tuple[int, int]]()
    first_try = partial(_first_try, run, learned)
    ahead = map_ahead(executor or InTurn(), _MOST_AHEAD, first_try, pairs)
    try:
        for number, (start, goal) in enumerate(pairs):
            progress(number / len(pairs), f"sensation {start} to {goal}")
            if (result := next(ahead)) is None:
                without_way.append((start, goal))
                continue
            first, known = result
            save_plan(run, known.execution, start, goal)
            rehearsed = rehearsing.rehearse(start, goal, max_tries=max_tries, known=known)
            rehearsed = rehearsed or [known]
            kept = best(rehearsed).execution
            trials.append(
                Trial(
                    **vars(first),
                    remembering=tries.score(rehearsed[0].execution),
                    kept=tries.score(kept),
                    num_tries=len(rehearsed),
                    off_skin_kept_s=tries.off_skin_s(kept),
                )
            )
    except BrokenExecutor:
        raise ChildProcessError(
            "an evaluating process was killed, perhaps because memory ran out; repeat the command"
        ) from None
    finally:
        ahead.close()
    return trials, without_way


def _prediction_errors(execution: Execution) -> np.ndarray:
    """`(n,)` cosine distances from predicted to felt, in their predicted scales."""
    motion = execution.motion
    known = execution.felt.any(axis=1) & motion.predicted.any(axis=1)
    known &= motion.predicted_spread > 0
    distance = cosine_distance(execution.felt[known], motion.predicted[known])
    return distance / motion.predicted_spread[known]


def _first_try(
    run: RunDirectory, learned: str, pair: tuple[int, int]
) -> tuple[FirstTry, Try] | None:
    return _tries(run, learned).first(*pair)


@OncePerThread
def _tries(run: RunDirectory, learned: str) -> FirstTries:
    """First tries of the agent of a run; `learned` identifies what it learned."""
    bodies = run_bodies(run)
    agent = load_agent(run, predicts=True)
    return FirstTries(pilot_in(bodies, agent, run.experiment), bodies)


def trial_metrics(trials: Sequence[Trial]) -> dict[str, Any]:
    """Metrics of trials; without truth, those that need it are absent."""
    if not trials:
        return {}
    metrics = {
        **summarise([trial.unpractised for trial in trials], "unpractised"),
        **_unpractised_metrics(trials),
        **summarise([trial.unpractised_executed for trial in trials], "unpractised_execution"),
        **_planning_metrics(trials),
        **_execution_metrics(trials),
        **_rehearsal_metrics(trials),
    }
    return {key: value for key, value in metrics.items() if value is not None}


def _unpractised_metrics(trials: Sequence[Trial]) -> dict[str, Any]:
    """More metrics of plans before practice, without dynamics."""
    true_paths = [trial.unpractised_true_over_shortest for trial in trials]
    lifts_off = [trial.unpractised_lifts_off for trial in trials]
    perfect = [
        trial.unpractised.contact == 1.0
        and trial.unpractised.reached
        and not trial.overlap_unpractised.any()
        for trial in trials
        if trial.unpractised is not None and trial.overlap_unpractised is not None
    ]
    overlaps = [trial.overlap_unpractised for trial in trials]
    return {
        "unpractised_perfect_rate": _of_known(np.mean, perfect),
        "unpractised_lift_off_rate": float(np.mean(lifts_off)),
        "unpractised_own_parts_overlap_share": _overlap_share(overlaps),
        **_summary("unpractised_true_path_over_shortest", true_paths),
    }


def _overlap_share(overlaps: Sequence[np.ndarray | None]) -> float | None:
    """Share of the samples of all motions at which the body cannot be; None if nobody knows."""
    known = [one for one in overlaps if one is not None]
    return float(np.concatenate(known).mean()) if known else None


def _planning_metrics(trials: Sequence[Trial]) -> dict[str, Any]:
    """Metrics of practised plans, without dynamics."""
    query_ms = 1e3 * np.array([trial.query_s for trial in trials])
    return {
        "planning_num_pairs": len(trials),
        **summarise([trial.planned for trial in trials], "planning"),
        "planning_num_slides": sum(trial.num_slides for trial in trials),
        "planning_impossible_postures": sum(
            int(trial.overlap_planned.sum())
            for trial in trials
            if trial.overlap_planned is not None
        ),
        "planning_own_parts_overlap_share": _overlap_share([t.overlap_planned for t in trials]),
        "planning_jerk_reduction": float(np.median([trial.jerk_reduction for trial in trials])),
        **_summary("planning_path_over_shortest", [trial.over_shortest for trial in trials]),
        **_summary(
            "planning_true_path_over_shortest", [trial.true_over_shortest for trial in trials]
        ),
        "planning_query_ms_median": float(np.median(query_ms)),
        "planning_query_ms_p95": float(np.percentile(query_ms, 95)),
    }


def _execution_metrics(trials: Sequence[Trial]) -> dict[str, Any]:
    """Metrics of practised plans under dynamics."""
    within = share_within_scale([trial.errors for trial in trials])
    return {
        "execution_num_pairs": len(trials),
        **summarise([trial.executed for trial in trials], "execution"),
        **{
            f"execution_prediction_within_{100 * share:.0f}": held for share, held in within.items()
        },
        **_truth_metrics([trial.truth for trial in trials if trial.truth is not None]),
    }


def _rehearsal_metrics(trials: Sequence[Trial]) -> dict[str, Any]:
    """Metrics of rehearsals, which remember those before."""
    first_contact = [trial.remembering.contact for trial in trials]
    return {
        "rehearsal_first_try_contact_mean": float(np.mean(first_contact)),
        **summarise([trial.kept for trial in trials], "rehearsal"),
        "rehearsal_tries_mean": float(np.mean([trial.num_tries for trial in trials])),
        "rehearsal_time_off_skin_s": _of_known(sum, (trial.off_skin_kept_s for trial in trials)),
    }


def _truth_metrics(truths: Sequence[ExecutedTruth]) -> dict[str, Any]:
    """Metrics of executions that were held against the truth; nothing without any."""
    if not truths:
        return {}
    tracking, turns = np.mean([truth.tracking for truth in truths], axis=0), truths[0].turns
    return {
        "execution_impossible_postures": sum(truth.impossible for truth in truths),
        "execution_tracking_rms_rad": _of_known(_root_mean, tracking[turns]),
        "execution_tracking_rms_m": _of_known(_root_mean, tracking[~turns]),
        "execution_force_max_N": max(truth.force for truth in truths),
        **{
            f"execution_{kind}_of_limit": max(truth.limit_shares[kind] for truth in truths)
            for kind in truths[0].limit_shares
        },
        "execution_time_off_skin_s": _of_known(sum, (t.off_skin_s for t in truths)),
    }


def trial_table(trials: Sequence[Trial]) -> dict[str, np.ndarray]:
    """The results of N pairs in the order of their trials, as a file stores them.

    `pairs` `(N, 2)`; `(N,)` shares of the time in contact and whether the goal was reached, of the
    plan before practice, the first try without memory (`naive`), the first try with the memory of
    the rehearsals of all pairs before and the best; `num_tries` `(N,)` of the rehearsal;
    `prediction_error` `(N,)` of the first try without memory.
    """
    by_name = {
        "unpractised": [trial.unpractised_executed for trial in trials],
        "naive": [trial.executed for trial in trials],
        "remembering": [trial.remembering for trial in trials],
        "kept": [trial.kept for trial in trials],
    }
    columns = {"pairs": np.array([(trial.start, trial.goal) for trial in trials])}
    for name, scores in by_name.items():
        columns[f"contact_{name}"] = np.array([score.contact for score in scores])
    for name, scores in by_name.items():
        columns[f"reached_{name}"] = np.array([score.reached for score in scores])
    columns["num_tries"] = np.array([trial.num_tries for trial in trials])
    errors = [trial.executed.prediction_error for trial in trials]
    columns["prediction_error"] = np.array(errors)
    return columns


def _summary(name: str, values: Sequence[float | None]) -> dict[str, float | None]:
    """Median and worst, which is the largest, of what is known of some values."""
    return {f"{name}_median": _of_known(np.median, values), f"{name}_worst": _of_known(max, values)}


def _root_mean(squares: Sequence[float]) -> float:
    return np.sqrt(np.mean(squares))


def _of_known(
    summary: Callable[[Sequence[float]], float], values: Iterable[float | None]
) -> float | None:
    """A summary of what is known of some values; None if nothing is."""
    known = [value for value in values if value is not None]
    return float(summary(known)) if known else None
