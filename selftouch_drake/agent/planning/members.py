"""Which stored configurations of a kernel a plan may use."""

from __future__ import annotations

import numpy as np
from numba import njit

from selftouch_drake.agent.planning.steps import square_step
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import quantile

# A configuration is isolated if it is farther than this from all strong ones of its kernel, in rad.
# Measured on a torus with two fingers (150 plans): out of contact on 1.1 % of the length if plans
# use the strongest half, on 0.7 % if they use the strongest third and the isolated ones. The worst
# of 200 plans with one finger: 18 % and 3 %.
_ISOLATED = 1.0


def of_mode(representation: QuotientRepresentation, kernel: int, mode: int | None) -> np.ndarray:
    """Rows of `kernel_q` that belong to `kernel` and `mode`; None stands for all modes."""
    members = representation.members(kernel)
    if mode is None:
        return np.arange(members.start, members.stop)
    return members.start + np.flatnonzero(representation.kernel_mode[members] == mode)


def firm_members(representation: QuotientRepresentation, kernel: int, mode: int) -> np.ndarray:
    """Rows of `kernel_q` that plans pass through: the strongest third of the touches of a kernel.

    Firm touches keep contact. But some postures of the arm were tried so rarely that no touch of
    the strongest third is near; a plan that starts there would have to leap. So isolated touches
    count as well, unless they are among the lightest quarter. All rows are of `mode`.
    """
    rows = of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    strength = representation.kernel_strength[rows]
    x = representation.scaled(representation.kernel_q[rows])
    x = x[:, representation.mode_joints[mode]]
    strong, felt = strength >= _quantile(strength, 2 / 3), strength >= _quantile(strength, 0.25)
    return rows[_strong_or_isolated(x, strong, felt)]


def goal_members(
    representation: QuotientRepresentation, kernel: int, mode: int | None = None
) -> np.ndarray:
    """Rows of `kernel_q`: the half of a kernel nearest its target sensation, without light touches.

    A plan that ended near the border of a kernel could miss it by a small error of the motion.
    If only the firm half counted as well, so few configurations would remain that the last step
    would become long. All rows are of `mode`, if one is given.
    """
    rows = of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    error, strength = representation.kernel_error[rows], representation.kernel_strength[rows]
    near, felt = error <= np.median(error), strength >= _quantile(strength, 0.25)
    return rows[near & felt if np.any(near & felt) else near]


def _quantile(values: np.ndarray, share: float) -> np.floating:
    return quantile(values[:, None], share)[0]


@njit(cache=True)
def _strong_or_isolated(x, strong, felt):
    """`(n,)` bool: `strong`, or `felt` and far from all strong ones; x is `(n, J)` rad."""
    kept = strong.copy()
    among = x[strong]
    for row in np.flatnonzero(felt & ~strong):
        kept[row] = True
        for other in range(len(among)):
            if square_step(x[row], among[other]) <= _ISOLATED**2:
                kept[row] = False
                break
    return kept
