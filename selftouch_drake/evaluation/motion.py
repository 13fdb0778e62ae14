"""How well planned motions keep contact, arrive, and feel as predicted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionScore:
    """One motion, scored by what was felt along it.

    Attributes:
        contact: share of the time in contact.
        reached: whether the last sensation belongs to the goal's kernel.
        prediction_error: mean cosine distance between predicted and felt, while in contact.
    """

    contact: float
    reached: bool
    prediction_error: float


def score_motion(
    felt: np.ndarray, predicted: np.ndarray, target_sensations: np.ndarray, goal: int
) -> MotionScore:
    """Scores a motion sampled evenly in time.

    Args:
        felt: `(T, S)` N, sensations along the motion.
        predicted: `(T, S)` predicted sensations, any scale.
        target_sensations: `(K, S)` unit L2 norm.
        goal: the target sensation to be reached.
    """
    touching = felt.any(axis=1)
    cosine = cosine_distance(felt[touching], predicted[touching])
    return MotionScore(
        contact=float(touching.mean()),
        reached=bool(touching[-1] and int(np.argmax(target_sensations @ felt[-1])) == goal),
        prediction_error=float(cosine.mean()) if touching.any() else 1.0,
    )


def cosine_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """`(T,)` one minus the cosine between the rows of `a` and `b` `(T, S)`, none of them null."""
    a, b = a.astype(float), b.astype(float)
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return 1 - np.einsum("ts,ts->t", a, b) / norms


def summarise(scores: list[MotionScore], prefix: str) -> dict[str, float]:
    """Figures of several motions, as `metrics.json` names them."""
    contact = [score.contact for score in scores]
    return {
        f"{prefix}_num_pairs": len(scores),
        f"{prefix}_reach_rate": float(np.mean([score.reached for score in scores])),
        f"{prefix}_contact_mean": float(np.mean(contact)),
        f"{prefix}_contact_worst": float(np.min(contact)),
        f"{prefix}_prediction_error_mean": float(
            np.mean([score.prediction_error for score in scores])
        ),
    }
