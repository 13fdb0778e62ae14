"""What only the experimenter knows of an executed motion: tracking, limits, time off the skin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.planning.timing import speed_shares
from selftouch_drake.robot import World
from selftouch_drake.robot.robot import JointLimits
from selftouch_drake.systems.simulation import Log

# Rate at which positions are compared with their limits.
_CHECK_RATE_HZ = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExecutedTruth:
    """One executed motion, held against the truth.

    Attributes:
        tracking: `(J,)` mean square error of each joint, rad² or m².
        turns: `(J,)` bool, whether the unit of a joint is the radian, not the metre.
        limit_shares: by kind, as in `limit_shares`.
        force: N, the largest sum of a sensation.
        impossible: steps of the plant at which rigid parts were too deep in each other.
        off_skin_s: s, off every skin by more than a ball's radius; None if not only balls touch.
    """

    tracking: np.ndarray
    turns: np.ndarray
    limit_shares: dict[str, float]
    force: float
    impossible: int
    off_skin_s: float | None


class ExecutionScorer:
    """Holds motions that were executed in a world against the truth."""

    def __init__(self, world: World):
        self._world = world
        radii = [toucher.radius for toucher in world.experiment.touching.values()]
        self._radii = [radius for radius in radii if radius is not None]
        self._walls: list[cKDTree] | None = None  # of the skins, if nothing but balls touches them
        if len(self._radii) == len(radii):
            self._walls = [cKDTree(s.wall.samples(min(self._radii) / 4)) for s in world.skins]

    def truth(self, execution: Execution, log: Log) -> ExecutedTruth:
        """One executed motion, held against the log of its simulation."""
        world, motion, q = self._world, execution.motion, log.q
        return ExecutedTruth(
            tracking=np.square(q - motion.q).mean(axis=0),
            turns=world.robot.turns,
            limit_shares=limit_shares(motion, q, execution.torque, world.limits),
            force=float(execution.felt.sum(axis=1).max()),
            impossible=int(np.sum(world.probe.impossible(log.q_steps))),
            off_skin_s=self.off_skin_s(execution),
        )

    def off_skin_s(self, execution: Execution) -> float | None:
        """s, off every skin by more than a ball's radius; None if not only balls touch."""
        if self._walls is None:
            return None
        robot, motion = self._world.robot, execution.motion
        q = execution.q_measured - self._world.slip
        p_LT = in_link_frames(robot.toucher_positions(q), robot.skin_positions(q))
        off = off_skin(p_LT, np.array(self._radii), self._walls) & motion.touching
        return float(np.sum(off[:-1] * np.diff(motion.time_s)))


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
