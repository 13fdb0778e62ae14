"""What only the experimenter knows of an executed motion: tracking, limits, fingertips in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.evaluation.motion import (
    in_link_frames,
    limit_shares,
    off_skin,
    progress_along,
    spatial_jerk_reduction,
)
from selftouch_drake.robot import Log, World


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExecutedTruth:
    """One executed motion, held against the truth.

    Attributes:
        tracking: `(J,)` mean square error of each joint, rad² or m².
        turns: `(J,)` bool, whether the unit of a joint is the radian, not the metre.
        limit_shares: by kind, as of `limit_shares`.
        force: N, the largest sum of a sensation.
        impossible: steps of the plant at which rigid parts were too deep in each other.
        tip_jerk_planned: how many times less the fingertips jerk along the plan than along its
            polyline; None if the plan stays.
        tip_jerk_measured: as executed.
        off_skin_s: s, off every skin by more than a ball's radius; None if not only balls touch.
    """

    tracking: np.ndarray
    turns: np.ndarray
    limit_shares: dict[str, float]
    force: float
    impossible: int
    tip_jerk_planned: float | None
    tip_jerk_measured: float | None
    off_skin_s: float | None


class ExecutionJudge:
    """Holds executed motions against the truth.

    Args:
        world: in which they were executed.
        representation: used to make the plans.
    """

    def __init__(self, world: World, representation: QuotientRepresentation):
        self._world, self._representation = world, representation
        radii = [toucher.radius for toucher in world.experiment.touching.values()]
        self._radii = [radius for radius in radii if radius is not None]
        self._walls: list[cKDTree] | None = None  # of the skins, if nothing but balls touches them
        if len(self._radii) == len(radii):
            self._walls = [cKDTree(s.wall.samples(min(self._radii) / 4)) for s in world.skins]

    def truth(self, execution: Execution, log: Log) -> ExecutedTruth:
        """One executed motion, held against the log of its simulation."""
        world, motion, q = self._world, execution.motion, log.q
        scaled = self._representation.scaled
        progress = progress_along(motion.s, scaled(motion.q), scaled(q))
        return ExecutedTruth(
            tracking=np.square(q - motion.q).mean(axis=0),
            turns=world.robot.turns,
            limit_shares=limit_shares(
                motion.time_s, motion.q, motion.v, q, execution.torque, world.limits
            ),
            force=float(execution.felt.sum(axis=1).max()),
            impossible=int(np.sum(world.probe.collision_depth(log.q_steps) > 0)),
            tip_jerk_planned=_tip_jerk(world, motion, motion.s, motion.q),
            tip_jerk_measured=_tip_jerk(world, motion, progress, q),
            off_skin_s=self.off_skin_s(execution),
        )

    def off_skin_s(self, execution: Execution) -> float | None:
        """s, off every skin by more than a ball's radius; None if not only balls touch."""
        if self._walls is None:
            return None
        robot, motion = self._world.robot, execution.motion
        q = execution.q_measured - self._world.simulation.slip
        p_LT = in_link_frames(robot.toucher_positions(q), robot.skin_positions(q))
        off = off_skin(p_LT, np.array(self._radii), self._walls) & motion.touching
        return float(np.sum(off[:-1] * np.diff(motion.time_s)))


def _tip_jerk(world: World, motion: Motion, s: np.ndarray, q: np.ndarray) -> float | None:
    """Jerk of the fingertips along the polyline, over their jerk along the plan."""
    plan = motion.plan
    if len(plan.links) < 2:
        return None

    def to_space(q: np.ndarray) -> np.ndarray:
        return world.robot.toucher_positions(q).reshape(len(q), -1)

    return spatial_jerk_reduction(s, to_space(q), plan.waypoints_q, plan.waypoint_s, to_space)
