"""Checks of the arguments of a planner."""

from __future__ import annotations

import operator

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: Lowest and highest motor configuration, `(J,)` each.
Limits = tuple[np.ndarray, np.ndarray]


def checked_target(target: int | None, representation: QuotientRepresentation) -> int:
    """Returns `target` as an int.

    Raises:
        ValueError: `target` is not the number of a target sensation.
    """
    num_targets = representation.num_targets
    try:
        index = operator.index(target)  # type: ignore[arg-type]
    except TypeError:
        raise ValueError(f"target {target!r} is not an index: give a whole number") from None
    if not 0 <= index < num_targets:
        raise ValueError(
            f"target {target} is out of range: give one of 0 to {num_targets - 1}, "
            "the targets of this representation"
        )
    return index


def checked_configuration(
    q_start: np.ndarray, representation: QuotientRepresentation, limits: Limits | None = None
) -> np.ndarray:
    """Returns `q_start` as floats, if a plan may start there.

    Raises:
        ValueError: `q_start` does not hold one finite number per joint, or is outside the limits.
    """
    q_start = np.asarray(q_start, dtype=float)
    num_joints = representation.kernel_q.shape[1]
    if q_start.shape != (num_joints,):
        raise ValueError(
            f"q_start has shape {q_start.shape}: give ({num_joints},), one number per joint"
        )
    if not np.all(np.isfinite(q_start)):
        raise ValueError(f"q_start is {q_start.tolist()}: give finite numbers")
    if limits is not None:
        lower, upper = limits
        # Stored configurations are float32.
        outside = np.flatnonzero((q_start < lower - 1e-6) | (q_start > upper + 1e-6))
        if outside.size:
            joint = outside[0]
            raise ValueError(
                f"q_start[{joint}] is {q_start[joint]:g}: give a position within the limits of "
                f"the joint, {lower[joint]:g} to {upper[joint]:g}"
            )
    return q_start


def checked_penalty(link_penalty: np.ndarray | None, num_links: int) -> np.ndarray:
    """`(L,)` factors as floats; all 1 if `link_penalty` is None.

    Raises:
        ValueError: `link_penalty` does not hold one positive factor per link.
    """
    if link_penalty is None:
        return np.ones(num_links)
    link_penalty = np.asarray(link_penalty, dtype=float)
    if link_penalty.shape != (num_links,):
        raise ValueError(
            f"link_penalty has shape {link_penalty.shape}: give ({num_links},), one factor per link"
        )
    bad = np.flatnonzero(~(np.isfinite(link_penalty) & (link_penalty > 0.0)))
    if bad.size:
        raise ValueError(
            f"link_penalty[{bad[0]}] is {link_penalty[bad[0]]:g}: give finite positive factors, "
            "1 for links without penalty"
        )
    return link_penalty
