"""The touches of one mode of a kernel that plans pass, and at which they end."""

import numpy as np

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.firm import firm, surely_felt


def firm_members(representation: QuotientRepresentation, kernel: int, mode: int) -> np.ndarray:
    """Rows of `kernel_q` that plans pass through, all of `mode`, as in `quotient.firm.firm`.

    Only the joints that matter in the mode count.
    """
    rows = _of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    x = representation.scaled(representation.kernel_q[rows])
    joints = representation.mode_joints[mode]
    return rows[firm(x[:, joints], representation.kernel_strength[rows])]


def goal_members(
    representation: QuotientRepresentation, kernel: int, mode: int | None = None
) -> np.ndarray:
    """Rows of `kernel_q` at which plans end, as in `quotient.firm.surely_felt`.

    All rows are of `mode`, if given.
    """
    rows = _of_mode(representation, kernel, mode)
    if not len(rows):
        return rows
    error, strength = representation.kernel_error[rows], representation.kernel_strength[rows]
    return rows[surely_felt(error, strength)]


def _of_mode(representation: QuotientRepresentation, kernel: int, mode: int | None) -> np.ndarray:
    members = representation.members(kernel)
    rows = np.arange(members.start, members.stop)
    return rows if mode is None else rows[representation.kernel_mode[rows] == mode]
