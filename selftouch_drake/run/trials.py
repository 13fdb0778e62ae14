"""Trials: random pairs of start and goal, planned, executed, rehearsed and scored.

Pairs are tried one after another; only the parts of their scores stay in memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Execution, Motion, Plan, touching
from selftouch_drake.agent.rehearsal import RehearsalMemory, Try, best
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.evaluation import (
    MotionScore,
    cosine_distance,
    in_link_frames,
    off_skin,
    progress_along,
    score_motion,
    spatial_jerk_reduction,
)
from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import wall_points
from selftouch_drake.robot import World
from selftouch_drake.robot.limits import limit_shares
from selftouch_drake.run.acting import NoWayError, Pilot, execute
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.knowledge import save_plan

# rad of path length, between samples of a plan that is not executed.
_SAMPLED = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """The result of one pair of start and goal.

    Attributes:
        start: target sensation.
        goal: target sensation.
        query_s: s, duration of planning.
        jerk_reduction: of the plan, in motor space.
        num_slides: steps that the agent replaced by slides before it acted.
        contact_straight: share of the plan in contact without these slides.
        planned: scored without dynamics.
        executed: scored as felt under dynamics, at first try and without memory.
        first: the agent's own judgement of that, as are the next two: contact, and whether the goal
            was reached.
        remembering: at first try, with the memory of the rehearsals of all pairs before.
        kept: of the best try.
        num_tries: of the rehearsal.
        tracking: `(J,)` mean square error of each joint, rad² or m².
        limit_shares: for each kind of limit, the largest share that any joint used.
        force: N, the largest total force.
        error: `(n,)` cosine distances between predicted and felt sensations that are not null.
        spread: `(n,)` predicted scale of these errors.
        impossible_planned: samples of the plan in which rigid parts run into each other.
        impossible_executed: steps of the plant in which they do.
        tip_jerk_planned: times less jerk in space than the polyline; None for a single step.
        tip_jerk_measured: the same for the measured path.
        off_skin_s: s, off every skin by more than a ball's radius; None if not only balls touch.
        off_skin_kept_s: the same for the best try.
    """

    start: int
    goal: int
    query_s: float
    jerk_reduction: float
    num_slides: int
    contact_straight: float
    planned: MotionScore
    executed: MotionScore
    first: tuple[float, bool]
    remembering: tuple[float, bool]
    kept: tuple[float, bool]
    num_tries: int
    tracking: np.ndarray
    limit_shares: dict[str, float]
    force: float
    error: np.ndarray
    spread: np.ndarray
    impossible_planned: int
    impossible_executed: int
    tip_jerk_planned: float | None
    tip_jerk_measured: float | None
    off_skin_s: float | None
    off_skin_kept_s: float | None


def try_pairs(
    run: RunDirectory, world: World, agent: Agent, progress: Callable[[float, str], None]
) -> tuple[list[Trial], list[tuple[int, int]]]:
    """Plans, executes and rehearses random pairs, and scores each against what was felt.

    The agent begins with a blank memory, whatever the run remembers, so that the metrics are the
    same every time. First tries are planned without memory; rehearsals remember earlier ones. The
    run keeps the first try of each pair, because the metrics describe it.

    Args:
        run: where the plans are kept.
        world: where they are executed.
        agent: the agent that plans.
        progress: called with the fraction done and the current task.

    Returns:
        The trials, and the pairs for which no way was found.
    """
    representation, max_tries = agent.representation, run.experiment.execution.max_tries
    agent = agent.recalling(RehearsalMemory.blank(representation))
    naive, rehearsing = Pilot(agent, world), Pilot(agent, world)
    balls = _Balls.of(world)
    pairs = random_pairs(run.experiment, representation)
    trials, without_way = list[Trial](), list[tuple[int, int]]()
    for number, (start, goal) in enumerate(pairs):
        progress(number / len(pairs), f"sensation {start} to {goal}")
        try:
            query = naive.plan(start, goal)
        except NoWayError:
            without_way.append((start, goal))
            continue
        motion = query.motion
        execution, log = execute(world, motion)
        known = agent.judge(execution)
        tries = rehearsing.rehearse(start, goal, max_tries=max_tries, known=known) or [known]
        save_plan(run, execution, start, goal)
        kept = best(tries)
        targets = representation.target_sensations
        predicted = execution.felt.any(axis=1) & motion.predicted.any(axis=1)
        predicted &= motion.predicted_spread > 0
        trials.append(
            Trial(
                start=start,
                goal=goal,
                query_s=query.seconds,
                jerk_reduction=query.jerk_reduction,
                num_slides=len(query.agent.memory.slides.ends),
                contact_straight=contact_along(world, query.straight),
                planned=score_motion(motion, world.probe.sensations(motion.q), targets),
                executed=score_motion(motion, execution.felt, targets),
                first=_judgement(known),
                remembering=_judgement(tries[0]),
                kept=_judgement(kept),
                num_tries=len(tries),
                tracking=np.square(execution.q_measured - motion.q).mean(axis=0),
                limit_shares=limit_shares(
                    motion.time_s,
                    motion.q,
                    motion.v,
                    execution.q_measured,
                    execution.torque,
                    world.limits,
                ),
                force=float(execution.felt.sum(axis=1).max()),
                error=cosine_distance(execution.felt[predicted], motion.predicted[predicted]),
                spread=motion.predicted_spread[predicted],
                impossible_planned=_impossible(world, motion.q),
                impossible_executed=_impossible(world, log.q_steps),
                tip_jerk_planned=_tip_jerk(world, motion, motion.s, motion.q),
                tip_jerk_measured=_tip_jerk(
                    world,
                    motion,
                    progress_along(
                        motion.s,
                        representation.scaled(motion.q),
                        representation.scaled(execution.q_measured),
                    ),
                    execution.q_measured,
                ),
                off_skin_s=_off_skin_s(balls, world, execution),
                off_skin_kept_s=_off_skin_s(balls, world, kept.execution),
            )
        )
    return trials, without_way


def random_pairs(
    experiment: Experiment, representation: QuotientRepresentation
) -> list[tuple[int, int]]:
    """Pairs of start and goal for the trials, drawn from the seed without repetition.

    Both are on one part of the body that was recovered: no touch leads from part to part.
    """
    num_targets, part = representation.num_targets, representation.part
    random = np.random.default_rng(experiment.random_stream("pairs"))
    # The goals of a start are all kernels but itself.
    column, start = np.arange(num_targets - 1), np.arange(num_targets)[:, None]
    goals = column + (column >= start)
    within = (part[goals] == part[start]) & (part[start] < representation.num_parts)
    codes = np.flatnonzero(within)
    wanted = min(experiment.evaluation.num_pairs, len(codes))
    chosen = codes[random.choice(len(codes), size=wanted, replace=False)]
    starts = chosen // (num_targets - 1)
    return list(zip(starts.tolist(), goals.ravel()[chosen].tolist(), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class _Balls:
    """Touching balls, and the walls on which they should stay."""

    radius: np.ndarray
    walls: list[cKDTree]

    @staticmethod
    def of(world: World) -> _Balls | None:
        """The balls of a world; None if something else touches as well."""
        radii = [toucher.radius for toucher in world.experiment.touching.values()]
        known = [radius for radius in radii if radius is not None]
        if len(known) < len(radii):
            return None
        spacing = min(known) / 2
        walls = [cKDTree(wall_points(skin.wall, spacing)) for skin in world.skins]
        return _Balls(np.array(known), walls)

    def off_skin_s(self, world: World, execution: Execution) -> float:
        """s, time that an execution was off all skins although contact was expected."""
        motion, robot = execution.motion, world.robot
        p_LT = in_link_frames(
            robot.toucher_positions(execution.q_measured),
            robot.skin_positions(execution.q_measured),
        )
        off = off_skin(p_LT, self.radius, self.walls) & motion.touching
        return float(np.sum(off[:-1] * np.diff(motion.time_s)))


def _off_skin_s(balls: _Balls | None, world: World, execution: Execution) -> float | None:
    return None if balls is None else balls.off_skin_s(world, execution)


def _judgement(one: Try) -> tuple[float, bool]:
    return one.contact, one.reached


def contact_along(world: World, plan: Plan) -> float:
    """Share of the path with expected contact on which something is felt."""
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(2, int(length / _SAMPLED)))
    expected = touching(plan.waypoint_s, plan.in_air, s)
    return float(np.mean(world.probe.sensations(plan.path(s[expected])).any(axis=1)))


def _impossible(world: World, q: np.ndarray) -> int:
    return int(np.sum(world.probe.collision_depth(q) > 0))


def _tip_jerk(world: World, motion: Motion, s: np.ndarray, q: np.ndarray) -> float | None:
    """Jerk of the fingertips along the polyline, over their jerk along the plan."""
    if len(motion.links) < 2:
        return None

    def to_space(q: np.ndarray) -> np.ndarray:
        return world.robot.toucher_positions(q).reshape(len(q), -1)

    return spatial_jerk_reduction(s, to_space(q), motion.waypoints_q, motion.waypoint_s, to_space)
