"""The error that the agent expects of a recovered shape (naive).

It is estimated from the layout, in two ways. Inconsistent distances along the body leave stress.
And target sensations are evenly spaced in sensation, so kernels are unevenly spaced where lengths
are wrong, or where the skin is bad. Both are dimensionless, and so comparable between bodies, skins
and numbers of kernels.
"""

from __future__ import annotations

import numpy as np

from selftouch_drake.agent.shape.embedding import Embedding
from selftouch_drake.agent.shape.homology import spacings

#: Logarithm of the expected error: constant, and slopes in the logarithms of stress and unevenness.
#: Calibrated by least squares on bodies recovered from few and many touches and targets, with good
#: and bad skins, with 6 to 16 joints (`benchmarks/trust.py confidence`).
_CONSTANT, _OF_STRESS, _OF_UNEVENNESS = -0.30, 0.22, 0.60

#: A shape is trusted below this expected error and from this margin of its holes on.
MOST_ERROR, LEAST_MARGIN = 0.04, 4.0

#: Neighbours from which the spacing around a kernel is measured, as on a surface.
_NEIGHBOURS = 6


def expected_error(layout: Embedding) -> float:
    """Expected root mean square error of an unbent layout, as a fraction of its extent.

    Args:
        layout: from `curvature_corrected_mds`; other layouts have higher stress.
    """
    # The floor is needed for layouts of few kernels, without any stress.
    stress, uneven = np.log(np.maximum([layout.stress, unevenness(layout.positions)], 1e-6))
    return float(np.exp(_CONSTANT + _OF_STRESS * stress + _OF_UNEVENNESS * uneven))


def trusted(error: float | None, margin: float) -> bool:
    """Whether a shape and its holes can be trusted.

    Args:
        error: the expected error; None if unknown.
        margin: the smallest `Topology.margin` of its parts.
    """
    return bool(error is not None and error < MOST_ERROR and margin >= LEAST_MARGIN)


def unevenness(positions: np.ndarray) -> float:
    """Standard deviation of the logarithm of the spacing around each of the `(n, 3)` positions."""
    return float(np.log(spacings(positions, _NEIGHBOURS)).std())
