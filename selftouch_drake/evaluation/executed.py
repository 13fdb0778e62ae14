"""What only the experimenter knows of an executed motion: tracking, limits, fingertips in space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial import cKDTree

from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.planning.smoothing import polyline
from selftouch_drake.agent.planning.timing import speed_shares
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.evaluation.motion import JERK_SPACING, jerk
from selftouch_drake.robot import Log, World
from selftouch_drake.robot.robot import JointLimits

# Rate at which positions are compared with their limits.
_CHECK_RATE_HZ = 1000.0


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
    """Holds motions that were executed in a world against the truth.

    The representation is the one used to make the plans.
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
        planned = measured = None
        if len(motion.plan.links) > 1:
            planned = tip_jerk_reduction(motion.plan, motion.s, motion.q, self._tips)
            measured = tip_jerk_reduction(motion.plan, progress, q, self._tips)
        return ExecutedTruth(
            tracking=np.square(q - motion.q).mean(axis=0),
            turns=world.robot.turns,
            limit_shares=limit_shares(motion, q, execution.torque, world.limits),
            force=float(execution.felt.sum(axis=1).max()),
            impossible=int(np.sum(world.probe.collision_depth(log.q_steps) > 0)),
            tip_jerk_planned=planned,
            tip_jerk_measured=measured,
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

    def _tips(self, q: np.ndarray) -> np.ndarray:
        """`(N, D)` m, where the fingertips are at `(N, J)` configurations."""
        return self._world.robot.toucher_positions(q).reshape(len(q), -1)


def off_skin(p_LT: np.ndarray, radius: np.ndarray, walls: Sequence[cKDTree]) -> np.ndarray:
    """`(T,)` whether every ball that touches is off every skin by more than its own radius.

    What counts is the gap between the wall and the nearest ball's own surface. To lose contact by
    less is to graze; to lose it by more is to leave the body.

    Args:
        p_LT: `(T, skins, balls, 3)` m, centres of the balls in the frame of each skin's link.
        radius: `(balls,)` m.
        walls: points that stand for each skin's wall, half a radius apart or less.
    """
    off = np.ones(len(p_LT), dtype=bool)
    for skin, wall in enumerate(walls):
        distance, _ = wall.query(p_LT[:, skin])
        off &= (distance > 2 * radius).all(axis=1)
    return off


def in_link_frames(p_WT: np.ndarray, X_WL: np.ndarray) -> np.ndarray:
    """`(T, links, points, 3)` m, `(T, points, 3)` of the world in frames `(T, links, 3, 4)`."""
    apart = p_WT[:, None] - X_WL[:, :, None, :, 3]
    return np.einsum("tlpi,tlij->tlpj", apart, X_WL[..., :3])


def limit_shares(
    motion: Motion, q_measured: np.ndarray, torque: np.ndarray, limits: JointLimits
) -> dict[str, float]:
    """Shares of the limits that an executed motion used; 1 is the limit.

    For `position` (distance from the middle of a joint's range, commanded or measured `(T, J)`),
    `velocity` and `acceleration` (commanded) and `torque` (of the actuators, `(N, J)` N m or N) the
    largest share of any joint.
    """
    time_s, q, v = motion.time_s, motion.q, motion.v
    velocity, acceleration = speed_shares(time_s, q, v, limits.velocity, limits.acceleration)
    times = np.append(np.arange(time_s[0], time_s[-1], 1.0 / _CHECK_RATE_HZ), time_s[-1])
    positions = np.concatenate([CubicHermiteSpline(time_s, q, v)(times), q_measured])
    # A joint without limits uses no share of them.
    ends = np.isfinite(limits.upper) & np.isfinite(limits.lower)
    upper, lower = np.where(ends, limits.upper, np.inf), np.where(ends, limits.lower, -1.0)
    middle, half = np.where(ends, (upper + lower) / 2, 0.0), (upper - lower) / 2
    return {
        "position": float(np.max(np.abs(positions - middle) / half)),
        "velocity": velocity,
        "acceleration": acceleration,
        "torque": float(np.max(np.abs(torque) / limits.torque)),
    }


def progress_along(s: np.ndarray, q: np.ndarray, q_measured: np.ndarray) -> np.ndarray:
    """`(T,)` rad, the place on the planned path nearest to where the robot was; it never falls.

    The robot lags behind by milliradians. Where the plan begins and ends at rest its progress is as
    small, so that the measured path over planned progress would seem to jerk there.

    Args:
        s: `(T,)` rad, where on the planned path the robot was meant to be.
        q: `(T, J)` rad, planned and scaled.
        q_measured: `(T, J)` rad, likewise.
    """
    moved = _moved(s)
    if moved.sum() < 2:
        return s
    path = CubicSpline(s[moved], q[moved])
    at = s.astype(float)
    for _ in range(3):
        tangent = path(at, 1)
        ahead = np.sum((q_measured - path(at)) * tangent, axis=1)
        at = at + ahead / np.maximum(np.sum(np.square(tangent), axis=1), 1e-12)
        at = at.clip(s[0], s[-1])
    return np.maximum.accumulate(at)


def tip_jerk_reduction(
    plan: Plan, s: np.ndarray, q: np.ndarray, tips: Callable[[np.ndarray], np.ndarray]
) -> float | None:
    """How many times smaller the jerk of fingertips in space is than along the plan's polyline.

    Both are sampled every 0.02 rad of planned path length; jerk is the root mean square of third
    differences, so that it measures the path, and not the speed along it.

    Args:
        plan: the plan.
        s: `(T,)` rad, where on its path the robot was.
        q: `(T, J)` rad or m, its configurations there.
        tips: from `(N, J)` configurations to `(N, D)` m.

    Returns:
        None if the robot did not move.
    """
    moved = _moved(s)
    if moved.sum() < 2:
        return None
    at = np.linspace(s[0], s[-1], max(5, int(np.ptp(s) / JERK_SPACING)))
    smooth = jerk(CubicSpline(s[moved], tips(q)[moved])(at))
    return jerk(tips(polyline(plan.waypoints_q, plan.waypoint_s)(at))) / smooth if smooth else None


def _moved(s: np.ndarray) -> np.ndarray:
    """`(T,)` whether `s` is beyond all before."""
    return np.concatenate([[True], np.diff(s) > 1e-6])
