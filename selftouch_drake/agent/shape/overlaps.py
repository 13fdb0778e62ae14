"""Lengths of edges where readings say only which receptors feel a touch (naive).

Sets of receptors change in jumps: the angle between two sets grows as the root of the distance
between their places, where that between forces grows as the distance. But many touches show how
often two receptors feel the same one. That share is the overlap of two equal discs, and gives their
distance. So around each kernel the receptors are laid out on a chart. There the kernel and its
neighbours lie where a touch is within the discs of those that feel it, and outside the others.
"""

import numpy as np
from scipy.special import expit

from selftouch_drake.agent.representation.quotient import LEAST_OF_PART, QuotientRepresentation
from selftouch_drake.agent.shape.rings import one_ring
from selftouch_drake.quotient.graph import neighbour_edges
from selftouch_drake.quotient.layout import classical_embedding
from selftouch_drake.quotient.paths import component_labels, geodesics

#: Most receptors that feel one touch. If each adds the same to the square of its strength, squares
#: have at most so many steps. Of forces there are many more.
_MOST_STEPS = 64

#: Overlaps below this do not tell a distance. Shorter lengths than the second number, as a share of
#: the median, are chance.
_LEAST_OVERLAP, _SHORTEST = 0.05, 0.05

#: In diameters of a disc: how far a chart reaches (further, and a thin tube would meet itself), how
#: far from its middle kernels are looked for, and over how much the edge of a disc is blurred,
#: since a kernel has touches inside and outside; and the number of places along each axis.
_REACH, _WIDE, _BLUR, _PLACES = 1.0, 0.5, 0.05, 31

#: Least probability that a receptor feels a touch, or does not.
_LEAST_CHANCE = 1e-4


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
    touches = rate * representation.kernel_sets.sizes[:, None]
    felt = touches.sum(axis=0)
    overlap = touches.T @ rate / np.sqrt(np.outer(felt, felt))
    # Distance between two equal discs, in diameters, at which such a share overlaps.
    apart = np.linspace(0.0, 1.0, 1001)
    shared = 2 / np.pi * (np.arccos(apart) - apart * np.sqrt(1 - apart**2))
    distance = np.maximum(np.interp(-overlap, -shared, apart), 1e-3)
    distance[overlap < _LEAST_OVERLAP] = np.inf
    near = neighbour_edges(distance)
    if len(felt) < LEAST_OF_PART or component_labels(near, len(felt)).any():
        return None
    length = distance[tuple(near.T)]
    along = geodesics(near, length, len(felt))
    ring, by_chart = one_ring(representation.edges, len(rate)), np.zeros((len(rate), len(rate)))
    for kernel, feels in enumerate(rate):
        chart = np.flatnonzero(along[feels.argmax()] < _REACH)
        number = np.full(len(felt), -1)
        number[chart] = np.arange(len(chart))
        inside = (number[near] >= 0).all(axis=1)
        within = geodesics(number[near[inside]], length[inside], len(chart))
        middles = classical_embedding(within, skin).positions
        middles -= feels[chart] @ middles / feels[chart].sum()
        around = ring.indices[ring.indptr[kernel] : ring.indptr[kernel + 1]]
        places = _between_discs(rate[around][:, chart], middles)
        by_chart[kernel, around] = np.linalg.norm(places - places[around == kernel], axis=1)
    i, j = representation.edges.T
    mean = (by_chart[i, j] + by_chart[j, i]) / 2
    return np.maximum(mean, _SHORTEST * np.median(mean))


def _between_discs(rate: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """`(n, D)` mean places of n kernels, by `(n, S)` rates and `(S, D)` middles of discs."""
    axis = np.linspace(-_WIDE, _WIDE, _PLACES)
    places = np.stack(np.meshgrid(*[axis] * middles.shape[1]), axis=-1).reshape(
        -1, middles.shape[1]
    )
    outside = np.linalg.norm(places[:, None] - middles, axis=2) - 0.5
    feels = expit(-outside / _BLUR).clip(_LEAST_CHANCE, 1 - _LEAST_CHANCE)
    likely = np.log(feels) @ rate.T + np.log(1 - feels) @ (1 - rate.T)
    weight = np.exp(likely - likely.max(axis=0))
    return weight.T @ places / weight.sum(axis=0)[:, None]
