"""Lengths of edges where readings say only which receptors feel a touch (naive).

Sets of receptors change in jumps: the angle between two sets grows as the root of the distance
between their places, where that between forces grows as the distance. But from many touches it is
known how often receptors feel the same one. Where their fields are alike, the share falls almost
linearly with the distance between them, as the overlap of two discs does. So receptors are laid out
first. A kernel is at the middle of the receptors that feel it.
"""

import numpy as np

from selftouch_drake.agent.representation.graphs import (
    component_labels,
    geodesics,
    neighbour_edges,
)
from selftouch_drake.agent.representation.quotient import LEAST_KERNELS, QuotientRepresentation
from selftouch_drake.agent.shape.embedding import curvature_corrected_mds

#: Most receptors that feel one touch. If each adds the same to the square of its strength, squares
#: have at most so many steps. Of forces there are many more.
_MOST_STEPS = 64

#: Overlaps below this do not tell a distance. Shorter lengths than the second number, as a share of
#: the median, are chance.
_LEAST_OVERLAP, _SHORTEST = 0.05, 0.05


def overlap_lengths(representation: QuotientRepresentation, skin: int) -> np.ndarray | None:
    """`(E,)` lengths of the edges of one part, whose skin has 1 or 2 dimensions.

    None where readings tell more than which receptors feel a touch, or where too few receptors feel
    the same touches.
    """
    squares = np.square(np.unique(representation.kernel_strength), dtype=float)
    most = min(_MOST_STEPS, representation.num_rows // 20)
    if len(squares) < 2 or np.ptp(squares) > most * np.diff(squares).min():
        return None
    targets = representation.target_sensations.astype(float)
    rate = targets / targets.max(axis=1, keepdims=True)
    rate = rate[:, rate.max(axis=0) > 0.5]
    felt = rate.sum(axis=0)
    overlap = rate.T @ rate / np.sqrt(np.outer(felt, felt))
    distance = np.where(overlap < _LEAST_OVERLAP, np.inf, np.maximum(1.0 - overlap, 1e-3))
    near = neighbour_edges(distance)
    if len(felt) < LEAST_KERNELS or component_labels(near, len(felt)).any():
        return None
    along = geodesics(near, distance[tuple(near.T)], len(felt))
    laid = curvature_corrected_mds(near, along, skin + 1).positions
    places = rate @ laid / rate.sum(axis=1, keepdims=True)
    length = np.linalg.norm(np.diff(places[representation.edges], axis=1)[:, 0], axis=1)
    return np.maximum(length, _SHORTEST * np.median(length))
