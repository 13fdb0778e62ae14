"""What the agent expects at a configuration: what it felt at the most similar one (naive)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from selftouch_drake.agent.representation.quotient import (
    NO_MODE,
    QuotientRepresentation,
    row_joints,
)


def recalled(
    known: QuotientRepresentation, kernel_sensation: csr_array, q: np.ndarray
) -> np.ndarray:
    """`(n, S)` what the agent felt at the stored configurations most similar to `q`.

    Of each stored touch, only the joints that matter to it are compared. Touches for which these
    are not known yet are left out, unless they are known for none: among many joints, the search
    takes long.

    Args:
        known: what the agent knows.
        kernel_sensation: `(R, S)` the sensation at each of its configurations.
        q: `(n, J)` motor configurations, in the robot's units.
    """
    x, stored = known.scaled(q), known.scaled(known.kernel_q)
    least, nearest = np.full(len(q), np.inf), np.zeros(len(q), dtype=int)
    modes = np.unique(known.kernel_mode)
    for mode in modes[modes != NO_MODE] if len(modes) > 1 else modes:
        (joints,) = row_joints(np.array([mode]), known.mode_joints)
        rows = np.flatnonzero(known.kernel_mode == mode)
        off, row = cKDTree(stored[rows][:, joints]).query(x[:, joints])
        off /= np.sqrt(joints.sum())
        nearest = np.where(off < least, rows[row], nearest)
        least = np.minimum(off, least)
    return kernel_sensation[nearest].toarray()
