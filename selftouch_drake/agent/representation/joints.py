"""Scales joints by how much each of them changes the sensation, so that they compare (naive).

Motor configurations come in the robot's units, some in radians, others in metres, and the agent
does not know which. Distances in motor space need one unit.
"""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.representation.kernels import KernelSets
from selftouch_drake.agent.representation.quantise import unit
from selftouch_drake.agent.representation.set_distances import linked_nearest

#: Standard deviation of scaled configurations, root mean square over joints. It is that of the
#: paper's arm in radians, so a length in "rad" means the same for any robot.
_SPREAD = 1.6

#: Smallest influence of a joint, as a share of the largest (both squared): even a joint that does
#: not change the sensation takes time to move.
_LEAST_INFLUENCE = 0.02


def joint_scale(q: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(J,)` positive factors, so that equal scaled steps change the sensation equally.

    Near configurations are paired. The squared change of the sensation is fitted as a weighted sum
    of the squared changes of the joints. Changing the unit of a joint changes its factor inversely,
    and nothing else. A joint that did not move has 1. From `(n, J)` q, a sample of the experience,
    and `(n, S)` N that was felt there; no row null.
    """
    deviation = q.std(axis=0, dtype=float)
    moved = deviation > 0
    scale = np.ones(q.shape[1])
    if len(q) < 4 or not moved.any():
        return scale
    z = ((q - q.mean(axis=0, dtype=float))[:, moved] / deviation[moved]).astype(np.float32)
    from scipy.optimize import nnls  # not needed to plan

    first, second = _near_pairs(z)
    felt = unit(sensation)
    change = np.square(felt[first] - felt[second]).sum(axis=1, dtype=float)
    step = np.square(z[first] - z[second], dtype=float)
    influence, _ = nnls(step, change)
    if not influence.any():
        influence = np.ones(len(influence))
    influence = np.sqrt(np.maximum(influence, _LEAST_INFLUENCE * influence.max()))
    scale[moved] = influence / deviation[moved] * _SPREAD / np.sqrt(np.mean(influence**2))
    return scale


def _near_pairs(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs each row of either half with the nearest row of the other half."""
    half = len(z) // 2
    order = np.concatenate([np.arange(0, 2 * half, 2), np.arange(1, 2 * half, 2)])
    halves = KernelSets(z[order], np.array([0, half, 2 * half]))
    nearest = linked_nearest(halves, np.array([[0, 1], [1, 0]]))
    return order, order[nearest.row]
