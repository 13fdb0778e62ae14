"""Which stored configurations of a kernel plans go through."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.representation.quotient import QuotientRepresentation

# A configuration is alone if the nearest firm one of its kernel is this far away, in rad. Of 150
# plans on a torus with two fingers, 1.1 % of the length is out of contact with the strongest half
# and no others, 0.7 % with the strongest third and those alone; with one finger, of the worst of
# 200 plans, 18 % and 3 %.
_ALONE = 1.0


def of_mode(representation: QuotientRepresentation, kernel: int, mode: int | None) -> np.ndarray:
    """Rows of `kernel_q` that belong to `kernel` and are of `mode`; of any if that is None."""
    members = representation.members(kernel)
    if mode is None:
        return np.arange(members.start, members.stop)
    return members.start + np.flatnonzero(representation.kernel_mode[members] == mode)


def firm_members(representation: QuotientRepresentation, kernel: int, mode: int) -> np.ndarray:
    """Rows of `kernel_q` that plans pass through: the third of a kernel that is felt most strongly.

    Firm touches hold contact. But some postures of the arm were tried so seldom that none of the
    third is near; a plan that starts there would have to leap. So those that are far from all of
    the third count as well, if they are not among the lightest quarter. All of `mode`.
    """
    rows = of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    strength = representation.kernel_strength[rows]
    x = representation.scaled(representation.kernel_q[rows])
    x = x[:, representation.mode_joints[mode]]
    strong = strength >= np.quantile(strength, 2 / 3)
    apart, _ = cKDTree(x[strong]).query(x)
    alone = (apart > _ALONE) & (strength >= np.quantile(strength, 0.25))
    return rows[strong | alone]


def goal_members(
    representation: QuotientRepresentation, kernel: int, mode: int | None = None
) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel nearest its target sensation, without light touches.

    To end anywhere in a kernel would be to end near its border, from where a small error of the
    motion leads into another kernel. To ask for the firm half as well leaves so few
    configurations that the last step grows long. All of `mode`, if one is given.
    """
    rows = of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    error, strength = representation.kernel_error[rows], representation.kernel_strength[rows]
    near, felt = error <= np.median(error), strength >= np.quantile(strength, 0.25)
    return rows[near & felt if np.any(near & felt) else near]
