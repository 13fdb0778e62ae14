"""What the agent expects to feel along a plan."""

from __future__ import annotations

import numpy as np

from selftouch_drake.planning.plan import Plan
from selftouch_drake.representation.quotient import QuotientRepresentation


def predict_sensation(
    representation: QuotientRepresentation, plan: Plan, s: np.ndarray
) -> np.ndarray:
    """The sensation expected along a plan: from one target sensation to the next.

    Linear between the target sensations at the waypoints. That is as near to what is felt as a
    target sensation is to its own cell (mean cosine distance 0.015 on cube and torus); averages
    over stored configurations nearby are worse (0.03 to 0.26), as neighbours in motor space lie far
    apart on the skin.

    Args:
        representation: the one that the plan was made with.
        plan: the plan.
        s: `(T,)` rad, path lengths in `[0, plan.waypoint_s[-1]]`.

    Returns:
        `(T, S)` predicted sensation, unit L2 norm.
    """
    at = plan.waypoint_s
    after = np.searchsorted(at, s).clip(min(1, len(at) - 1), len(at) - 1)
    before = np.maximum(after - 1, 0)
    step = at[after] - at[before]
    share = np.divide(s - at[before], step, out=np.zeros(len(s)), where=step > 0.0)[:, None]
    targets = representation.target_sensations[plan.nodes]
    predicted = (1.0 - share) * targets[before] + share * targets[after]
    return predicted / np.linalg.norm(predicted, axis=1, keepdims=True)
