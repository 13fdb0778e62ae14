"""One unit for all joints of M, from how much each changes the sensation.

The paper measures distances in the motor configuration space. Configurations come in the robot's
units, some in radians, others in metres, and a naive agent does not know which. So joints are
scaled by their influence on the sensation S = Psi(M).
"""

import numpy as np

from .distances import linked_nearest
from .kernels import KernelSets
from .sensations import unit

#: mu, standard deviation of scaled configurations, root mean square over joints: that of the
#: paper's arm in radians. Knots and isolated touches of plans are measured in it.
_SPREAD = 1.6

#: Smallest influence of a joint, as a share of the largest (both squared): even a joint that does
#: not change the sensation takes time to move. No joint of the two bodies has less.
_LEAST_INFLUENCE = 0.02


def joint_scale(q: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(J,)` positive factors, so that equal scaled steps change the sensation equally.

    The squared change of the sensation is fitted as a weighted sum of the squared changes of the
    joints. Changing the unit of a joint changes its factor inversely, and nothing else. A joint
    that did not move has 1. From `(n, J)` q, a sample of the experience, and `(n, S)` N that was
    felt there; no row null.
    """
    deviation = q.std(axis=0, dtype=float)
    moved = deviation > 0
    scale = np.ones(q.shape[1])
    if len(q) < 4 or not moved.any():
        return scale
    z = ((q - q.mean(axis=0, dtype=float))[:, moved] / deviation[moved]).astype(np.float32)
    influence = _influence(z, sensation)
    scale[moved] = influence / deviation[moved] * _SPREAD / np.sqrt(np.mean(influence**2))
    return scale


def _influence(z: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(J,)` positive, how much a step of each joint changes the sensation, up to a factor.

    Each standardised configuration of `(n, J)` z is compared with the nearest one of the other half
    of the rows.
    """
    from scipy.optimize import nnls  # not needed to plan

    half = len(z) // 2
    first = np.concatenate([np.arange(0, 2 * half, 2), np.arange(1, 2 * half, 2)])
    halves = KernelSets(z[first], np.array([0, half, 2 * half]))
    nearest = linked_nearest(halves, np.array([[0, 1], [1, 0]]))
    second = first[nearest.row]
    felt = unit(sensation)
    change = np.square(felt[first] - felt[second]).sum(axis=1, dtype=float)
    step = np.square(z[first] - z[second], dtype=float)
    squared, _ = nnls(step, change)
    if not squared.any():
        squared = np.ones(len(squared))
    return np.sqrt(np.maximum(squared, _LEAST_INFLUENCE * squared.max()))
