"""Firm touches: the motor configurations of a kernel that plans pass, and at which they end.

"Each point of the internal representation corresponds to a set of different end-effector poses that
generates little variation around the target sensation" (paper, section III); not all of them are
equally good to pass. A touch that is just felt is lost by a small error of the motion. The strength
of the sensation tells the agent which touches are firm.
"""

import numpy as np
from numba import njit

from .distances import quantile, square_step
from .representation import Representation

# A configuration is isolated if it is farther than this from all strong ones of its kernel, in mu.
# Without them, from the strongest half, the worst of 200 plans lost contact on 18 % instead of 3 %.
_ISOLATED = 1.0


def firm(x: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """`(n,)` bool, the touches of a kernel that plans pass through: its strongest third.

    Firm touches keep contact. But some postures of the arm were tried so rarely that no touch of
    the strongest third is near; a plan that starts there would have to leap. So isolated touches
    count as well, unless they are among the lightest quarter. The n > 0 scaled configurations are
    `(n, J)` mu, and strengths `(n,)` N.
    """
    strong, felt = strength >= _quantile(strength, 2 / 3), strength >= _quantile(strength, 0.25)
    return _strong_or_isolated(x, strong, felt)


def surely_felt(error: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """`(n,)` bool, the touches of a kernel at which plans end.

    They are the half nearest to the target sensation, without light touches: a plan that ended near
    the border of a kernel could miss it by a small error of the motion. With the firm half alone,
    the last step would become long. The n > 0 errors are cosine distances, strengths are in N.
    """
    near, felt = error <= np.median(error), strength >= _quantile(strength, 0.25)
    return near & felt if np.any(near & felt) else near


def firm_rows(representation: Representation, kernel: int) -> np.ndarray:
    """Rows of `kernel_q` of a kernel that plans pass through."""
    members = representation.members(kernel)
    x = representation.scaled(representation.kernel_q[members])
    return members.start + np.flatnonzero(firm(x, representation.kernel_strength[members]))


def goal_rows(representation: Representation, kernel: int) -> np.ndarray:
    """Rows of `kernel_q` of a kernel at which plans end."""
    members = representation.members(kernel)
    error = representation.kernel_error[members]
    ends = surely_felt(error, representation.kernel_strength[members])
    return members.start + np.flatnonzero(ends)


def _quantile(values: np.ndarray, share: float) -> np.floating:
    return quantile(values[:, None], share)[0]


@njit(cache=True)
def _strong_or_isolated(x, strong, felt):
    """`(n,)` bool: `strong`, or `felt` and far from all strong ones; x is `(n, J)` mu."""
    kept, among = strong.copy(), x[strong]
    for row in np.flatnonzero(felt & ~strong):
        for other in range(len(among)):
            if square_step(x[row], among[other]) <= _ISOLATED**2:
                break
        else:
            kept[row] = True
    return kept
