"""How well planned motions keep contact, arrive, and feel as predicted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial import cKDTree

from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.planning import polyline
from selftouch_drake.agent.planning.timing import speed_shares
from selftouch_drake.agent.rehearsal import reached
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.experiment import Experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.robot import JointLimits

# Jerk is compared on samples this far apart, in rad of path length. The jerk of a polyline grows
# without bound as samples get denser, so the ratio has a meaning only for a stated spacing.
_JERK_SPACING = 0.02
# Rate at which positions are compared with their limits.
_CHECK_RATE_HZ = 1000.0
# rad of path length, between samples of a plan without times.
_SAMPLED = 0.01


def random_pairs(
    experiment: Experiment, representation: QuotientRepresentation, num_pairs: int | None = None
) -> list[tuple[int, int]]:
    """Random pairs of start and goal, drawn from the seed without repetition.

    Both are on one part of the body that was recovered: no touch leads from part to part.

    Args:
        experiment: its seed decides.
        representation: of the agent.
        num_pairs: how many; by default as many as the experiment evaluates.
    """
    num_targets, part = representation.num_targets, representation.part
    random = np.random.default_rng(experiment.random_stream("pairs"))
    # The goals of a start are all kernels but itself.
    column, start = np.arange(num_targets - 1), np.arange(num_targets)[:, None]
    goals = column + (column >= start)
    within = (part[goals] == part[start]) & (part[start] < representation.num_parts)
    codes = np.flatnonzero(within)
    asked = experiment.evaluation.num_pairs if num_pairs is None else num_pairs
    chosen = codes[random.choice(len(codes), size=min(asked, len(codes)), replace=False)]
    starts = chosen // (num_targets - 1)
    return list(zip(starts.tolist(), goals.ravel()[chosen].tolist(), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionScore:
    """One motion, scored by what was felt along it; what happens in the air does not count.

    Attributes:
        contact: share of the time with expected contact in which something was felt.
        reached: whether it ends in its goal; see `selftouch_drake.agent.rehearsal.reached`.
        prediction_error: mean cosine distance between predicted and felt, while in contact; 1 if
            it never is.
    """

    contact: float
    reached: bool
    prediction_error: float


def score_motion(
    motion: Motion, felt: np.ndarray, representation: QuotientRepresentation
) -> MotionScore:
    """Scores a motion by what was felt along it.

    Args:
        motion: what was planned, T instants.
        felt: `(T, S)` N, sensations along it.
        representation: the one used to make the plan.
    """
    comparable = felt.any(axis=1) & motion.predicted.any(axis=1)
    error = cosine_distance(felt[comparable], motion.predicted[comparable])
    return MotionScore(
        contact=motion.contact(felt),
        reached=reached(motion, felt, representation),
        prediction_error=float(error.mean()) if comparable.any() else 1.0,
    )


def contact_along(world: World, plan: Plan) -> float:
    """Share of a path with expected contact on which something is felt, without dynamics."""
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(2, int(length / _SAMPLED)))
    expected = plan.touching(s)
    return float(np.mean(world.probe.sensations(plan.path(s[expected])).any(axis=1)))


def cosine_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """`(T,)` one minus the cosine between the rows of `a` and `b` `(T, S)`, none of them null."""
    a, b = a.astype(float), b.astype(float)
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return 1 - np.einsum("ts,ts->t", a, b) / norms


def summarise(scores: Sequence[MotionScore], prefix: str) -> dict[str, float]:
    """Metrics of several motions, as `metrics.json` names them."""
    contact = [score.contact for score in scores]
    return {
        f"{prefix}_reach_rate": float(np.mean([score.reached for score in scores])),
        f"{prefix}_contact_mean": float(np.mean(contact)),
        f"{prefix}_contact_worst": float(np.min(contact)),
        f"{prefix}_prediction_error_mean": float(
            np.mean([score.prediction_error for score in scores])
        ),
    }


def calibration(
    errors: list[np.ndarray], spreads: list[np.ndarray], shares: tuple[float, ...] = (0.5, 0.9)
) -> dict[float, float]:
    """Checks predicted uncertainty: the share of errors within the predicted bands.

    The factor from spread to band is learned from the first half of the motions, such that it holds
    the wanted share of their errors (split conformal prediction), and judged by the second half.

    Args:
        errors: one array `(T,)` per motion, of cosine distances from predicted to felt.
        spreads: one array `(T,)` per motion, predicted before; positive.
        shares: of the errors that each band is to hold.

    Returns:
        For each wanted share the share found; nothing with fewer than two motions.
    """
    half = len(errors) // 2
    if half == 0:
        return {}
    ratios = [error / spread for error, spread in zip(errors, spreads, strict=True)]
    known, new = np.concatenate(ratios[:half]), np.concatenate(ratios[half:])
    if not (known.size and new.size):
        return {}
    return {share: float(np.mean(new <= np.quantile(known, share))) for share in shares}


def off_skin(p_LT: np.ndarray, radius: np.ndarray, walls: Sequence[cKDTree]) -> np.ndarray:
    """Whether every ball that touches is off every skin by more than its own radius.

    What counts is the gap between the wall and the nearest ball's own surface. To lose contact by
    less is to graze; to lose it by more is to leave the body.

    Args:
        p_LT: `(T, skins, balls, 3)` m, centres of the balls in the frame of each skin's link.
        radius: `(balls,)` m.
        walls: points that stand for each skin's wall, half a radius apart or less.

    Returns:
        `(T,)` bool.
    """
    off = np.ones(len(p_LT), dtype=bool)
    for skin, wall in enumerate(walls):
        distance, _ = wall.query(p_LT[:, skin])
        off &= (distance > 2 * radius).all(axis=1)
    return off


def in_link_frames(p_WT: np.ndarray, X_WL: np.ndarray) -> np.ndarray:
    """`(T, links, points, 3)` points of the world in the frames of links.

    Args:
        p_WT: `(T, points, 3)` m.
        X_WL: `(T, links, 3, 4)` poses of the links.
    """
    apart = p_WT[:, None] - X_WL[:, :, None, :, 3]
    return np.einsum("tlpi,tlij->tlpj", apart, X_WL[..., :3])


def limit_shares(
    time_s: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    q_measured: np.ndarray,
    torque: np.ndarray,
    limits: JointLimits,
) -> dict[str, float]:
    """Shares of the limits that an executed motion used; 1 is the limit.

    Args:
        time_s: `(T,)` s.
        q: `(T, J)` rad or m, commanded.
        v: `(T, J)` rad/s or m/s, commanded.
        q_measured: `(T, J)` rad or m.
        torque: `(N, J)` N·m or N, of the actuators, any number of samples.
        limits: of the robot and its motions.

    Returns:
        For `position` (distance from the middle of a joint's range, commanded or measured),
        `velocity` and `acceleration` (commanded) and `torque` the largest share of any joint.
    """
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
    """The robot's true progress along the planned path.

    The robot lags behind by milliradians. Where the plan begins and ends at rest its progress is as
    small, so that the measured path over planned progress would seem to jerk there.

    Args:
        s: `(T,)` rad, where on the planned path the robot was meant to be.
        q: `(T, J)` rad or m, planned.
        q_measured: `(T, J)` rad or m.

    Returns:
        `(T,)` rad, the place on the planned path nearest to where the robot was; it never falls.
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


def spatial_jerk_reduction(
    s: np.ndarray,
    path: np.ndarray,
    waypoints_q: np.ndarray,
    waypoint_s: np.ndarray,
    to_space: Callable[[np.ndarray], np.ndarray],
) -> float | None:
    """How many times smaller the jerk of a fingertip's path in space is than the polyline's.

    Both are sampled every 0.02 rad of planned path length; jerk is the root mean square of third
    differences, so that it measures the path, and not the speed along it.

    Args:
        s: `(T,)` rad, where on the planned path the robot was.
        path: `(T, D)` m, where its fingertips were.
        waypoints_q: `(W, J)` of the plan.
        waypoint_s: `(W,)` rad, where on its path they are.
        to_space: from `(N, J)` configurations to `(N, D)` m.

    Returns:
        None if the robot did not move.
    """
    moved = _moved(s)
    if moved.sum() < 2:
        return None
    at = np.linspace(s[0], s[-1], max(5, int(np.ptp(s) / _JERK_SPACING)))
    smooth = CubicSpline(s[moved], path[moved])(at)
    rough = to_space(polyline(waypoints_q, waypoint_s)(at))
    jerk = _jerk(smooth)
    return _jerk(rough) / jerk if jerk else None


def jerk_reduction(plan: Plan, joint_scale: np.ndarray) -> float:
    """How many times smaller the jerk of a plan is than that of its polyline, in motor space.

    As `spatial_jerk_reduction`, of scaled configurations; 1 if the polyline has no corner.

    Args:
        plan: the plan.
        joint_scale: `(J,)` factors of the representation used to make the plan.
    """
    if len(np.unique(plan.waypoint_s)) < 3:
        return 1.0
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(5, int(length / _JERK_SPACING)))
    rough = polyline(plan.waypoints_q, plan.waypoint_s)
    return _jerk(rough(s) * joint_scale) / _jerk(plan.path(s) * joint_scale)


def _jerk(samples: np.ndarray) -> float:
    """Root mean square of the third differences of `(N, D)` samples."""
    return float(np.sqrt(np.mean(np.square(np.diff(samples, 3, axis=0)))))


def _moved(s: np.ndarray) -> np.ndarray:
    """`(T,)` whether `s` is beyond all before."""
    return np.concatenate([[True], np.diff(s) > 1e-6])
