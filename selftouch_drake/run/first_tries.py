"""First tries of random pairs: planned and executed without memory of rehearsals, and scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.rehearsal import Try, judge
from selftouch_drake.evaluation import (
    MotionScore,
    cosine_distance,
    in_link_frames,
    limit_shares,
    off_skin,
    progress_along,
    score_motion,
    spatial_jerk_reduction,
)
from selftouch_drake.geometry import wall_points
from selftouch_drake.robot import World
from selftouch_drake.run.acting import NoWayError, Pilot


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstTry:
    """The result of the first try of one pair of start and goal, without memory.

    Attributes:
        start: target sensation.
        goal: target sensation.
        unpractised: the plan before practice, scored without dynamics.
        unpractised_executed: the same as felt under dynamics.
        planned: the practised plan, scored without dynamics.
        executed: the same as felt under dynamics.
        query_s: s, duration of planning.
        jerk_reduction: of the plan, in motor space.
        num_slides: ways that practice found for steps of the plan.
        tracking: `(J,)` mean square error of each joint, rad² or m².
        limit_shares: for each kind of limit, the largest share that any joint used.
        force: N, the largest total force.
        error: `(n,)` cosine distances between predicted and felt sensations that are not null.
        spread: `(n,)` predicted scale of these errors.
        impossible_planned: samples of the plan in which rigid parts run into each other.
        impossible_executed: steps of the plant in which they do.
        tip_jerk_planned: times less jerk in space than the polyline; None for a single step.
        tip_jerk_measured: the same for the measured path; None also if the robot did not move.
        off_skin_s: s, off every skin by more than a ball's radius; None if not only balls touch.
    """

    start: int
    goal: int
    unpractised: MotionScore
    unpractised_executed: MotionScore
    planned: MotionScore
    executed: MotionScore
    query_s: float
    jerk_reduction: float
    num_slides: int
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


class FirstTries:
    """Makes and scores first tries of an agent without memory.

    Args:
        world: where plans are executed.
        agent: the agent that plans; with its stored sensations, for predictions without practice.

    Attributes:
        agent: the agent without memory.
    """

    def __init__(self, world: World, agent: Agent):
        self.agent = agent.recalling(RehearsalMemory.blank(agent.representation))
        self._world = world
        self._pilot = Pilot(self.agent, world)
        self._pilot.get_ready()
        self._balls = _Balls.of(world)

    def first(self, start: int, goal: int) -> tuple[FirstTry, Try] | None:
        """The first try of a pair; None if no way is found."""
        try:
            query = self._pilot.plan(start, goal)
        except NoWayError:
            return None
        world, motion, representation = self._world, query.motion, self.agent.representation
        unpractised = self._pilot.motion(query.unpractised)
        blind, _ = self._pilot.execute(unpractised, practised=False)
        execution, log = self._pilot.execute(motion)
        predicted = execution.felt.any(axis=1) & motion.predicted.any(axis=1)
        predicted &= motion.predicted_spread > 0
        progress = progress_along(
            motion.s, representation.scaled(motion.q), representation.scaled(execution.q_measured)
        )
        first = FirstTry(
            start=start,
            goal=goal,
            unpractised=self._without_dynamics(unpractised),
            unpractised_executed=self.score(blind),
            planned=self._without_dynamics(motion),
            executed=self.score(execution),
            query_s=query.seconds,
            jerk_reduction=query.jerk_reduction,
            num_slides=len(query.agent.memory.slides.ends),
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
            tip_jerk_measured=_tip_jerk(world, motion, progress, execution.q_measured),
            off_skin_s=self.off_skin_s(execution),
        )
        return first, judge(execution, self.agent.representation)

    def score(self, execution: Execution) -> MotionScore:
        """An execution, scored as it was felt."""
        return score_motion(execution.motion, execution.felt, self.agent.representation)

    def _without_dynamics(self, motion: Motion) -> MotionScore:
        felt = self._world.probe.sensations(motion.q)
        return score_motion(motion, felt, self.agent.representation)

    def off_skin_s(self, execution: Execution) -> float | None:
        """s, off every skin by more than a ball's radius; None if not only balls touch."""
        return None if self._balls is None else self._balls.off_skin_s(self._world, execution)


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


def _impossible(world: World, q: np.ndarray) -> int:
    return int(np.sum(world.probe.collision_depth(q) > 0))


def _tip_jerk(world: World, motion: Motion, s: np.ndarray, q: np.ndarray) -> float | None:
    """Jerk of the fingertips along the polyline, over their jerk along the plan."""
    plan = motion.plan
    if len(plan.links) < 2:
        return None

    def to_space(q: np.ndarray) -> np.ndarray:
        return world.robot.toucher_positions(q).reshape(len(q), -1)

    return spatial_jerk_reduction(s, to_space(q), plan.waypoints_q, plan.waypoint_s, to_space)
