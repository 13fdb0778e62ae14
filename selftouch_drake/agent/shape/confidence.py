"""How far off the agent expects a recovered shape to be (naive).

The layout itself shows it, in two ways. Distances along the body that contradict each other leave
stress. And target sensations are evenly spaced by feel, so that kernels lie unevenly where lengths
are wrong, or where skin feels badly. Neither has a unit, so that bodies, skins and numbers of
kernels compare.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.shape.embedding import Embedding

#: Logarithm of the expected error: constant, and slopes in the logarithms of stress and unevenness.
#: Least squares over bodies recovered from few and many touches and targets, through good and bad
#: skins, with 6 to 12 joints (`benchmarks/trust.py confidence`).
_CONSTANT, _OF_STRESS, _OF_UNEVENNESS = -0.62, 0.18, 0.61

#: A shape is trusted below this expected error, and from this margin of its holes on.
MOST_ERROR, LEAST_MARGIN = 0.04, 3.0

#: Neighbours from which the spacing around a kernel is measured, as on a surface.
_NEIGHBOURS = 6


def expected_error(layout: Embedding) -> float:
    """Expected root mean square error of an unbent layout, as a fraction of its extent.

    Args:
        layout: of 7 kernels or more, by `unbent_embedding`: the stress of others is higher.
    """
    # The floor holds for layouts without any stress, of a few kernels.
    stress, uneven = np.log(np.maximum([layout.stress, unevenness(layout.positions)], 1e-6))
    return float(np.exp(_CONSTANT + _OF_STRESS * stress + _OF_UNEVENNESS * uneven))


def trusted(error: float | None, margin: float) -> bool:
    """Whether a shape and its holes are to be trusted.

    Args:
        error: the expected one; None if it is not known.
        margin: the least of its parts, as `Topology.margin`.
    """
    return error is not None and error < MOST_ERROR and margin >= LEAST_MARGIN


def unevenness(positions: np.ndarray) -> float:
    """Standard deviation of the logarithm of the spacing around each of the `(n, 3)` positions."""
    distance, _ = cKDTree(positions).query(positions, _NEIGHBOURS + 1)
    return float(np.log(np.median(distance[:, 1:], axis=1)).std())
