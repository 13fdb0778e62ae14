"""How well planned motions keep contact, arrive, and feel as predicted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.lifelong.expectation import cosine_distance
from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.tries import reached
from selftouch_drake.experiment import Experiment
from selftouch_drake.quotient.smooth import polyline
from selftouch_drake.robot import World

# Jerk is compared on samples this far apart, in mu of path length. The jerk of a polyline grows
# without bound as samples get denser, so the ratio has a meaning only for a stated spacing.
_JERK_SPACING = 0.02
# mu of path length, between samples of a plan without times.
_SAMPLED = 0.01


def random_pairs(
    experiment: Experiment, representation: QuotientRepresentation, num_pairs: int | None = None
) -> list[tuple[int, int]]:
    """Random pairs of start and goal, drawn from the seed without repetition.

    Both are on one part of the body that was recovered: no touch leads from part to part. They are
    as many as the experiment evaluates by default.
    """
    part = representation.part
    random = np.random.default_rng(experiment.random_stream("pairs"))
    within = (part[:, None] == part) & (part < representation.num_parts)
    np.fill_diagonal(within, False)
    pairs = np.argwhere(within)
    asked = experiment.evaluation.num_pairs if num_pairs is None else num_pairs
    chosen = random.choice(len(pairs), size=min(asked, len(pairs)), replace=False)
    return [(start, goal) for start, goal in pairs[chosen].tolist()]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionScore:
    """One motion, scored by what was felt along it; what happens in the air does not count.

    Attributes:
        contact: share of the time with expected contact in which something was felt.
        reached: whether it ends in its goal; see `selftouch_drake.agent.tries.reached`.
        prediction_error: mean cosine distance between predicted and felt, while in contact; 1 if
            it never is.
    """

    contact: float
    reached: bool
    prediction_error: float


def score_motion(
    motion: Motion, felt: np.ndarray, representation: QuotientRepresentation
) -> MotionScore:
    """Scores a motion of T instants by what was felt along it, `(T, S)` N.

    The representation is the one used to make the plan.
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


def summarise(scores: Sequence[MotionScore | None], prefix: str) -> dict[str, float]:
    """Metrics of the motions that have a score, as `metrics.json` names them; none without any."""
    known = [score for score in scores if score is not None]
    if not known:
        return {}
    contact = [score.contact for score in known]
    errors = [score.prediction_error for score in known]
    return {
        f"{prefix}_reach_rate": float(np.mean([score.reached for score in known])),
        f"{prefix}_contact_mean": float(np.mean(contact)),
        f"{prefix}_contact_worst": float(np.min(contact)),
        f"{prefix}_prediction_error_mean": float(np.mean(errors)),
    }


def share_within_scale(errors: list[np.ndarray]) -> dict[float, float]:
    """Checks predicted uncertainty: the share of errors within bands of half and 90 % of them.

    The factor from spread to band is learned from the first half of the motions, such that it holds
    the wanted share of their errors (split conformal prediction), and judged by the second half.

    Args:
        errors: one array `(T,)` per motion, of cosine distances from predicted to felt, over the
            spreads that were predicted before.

    Returns:
        For each wanted share the share found; nothing with fewer than two motions.
    """
    half = len(errors) // 2
    known, new = (np.concatenate([np.zeros(0), *part]) for part in (errors[:half], errors[half:]))
    if not (known.size and new.size):
        return {}
    return {share: float(np.mean(new <= np.quantile(known, share))) for share in (0.5, 0.9)}


def jerk_reduction(plan: Plan, joint_scale: np.ndarray) -> float:
    """How many times smaller the jerk of a plan is than that of its polyline, in motor space.

    Between configurations that are scaled by `(J,)` factors; 1 if the polyline has no corner.
    """
    if len(np.unique(plan.waypoint_s)) < 3:
        return 1.0
    length = plan.waypoint_s[-1]
    s = np.linspace(0.0, length, max(5, int(length / _JERK_SPACING)))
    rough = polyline(plan.waypoints_q, plan.waypoint_s)
    return jerk(rough(s) * joint_scale) / jerk(plan.path(s) * joint_scale)


def jerk(samples: np.ndarray) -> float:
    """Root mean square of the third differences of `(N, D)` samples."""
    return float(np.sqrt(np.mean(np.square(np.diff(samples, 3, axis=0)))))
