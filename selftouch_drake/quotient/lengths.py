"""Distances between neighbours on the body: ways to measure the edges of the quotient graph.

The theorem says nothing about lengths; for a shape, the agent also needs a distance. `literal` is
the paper's own metric. The others measure along the body, between neighbours.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .distances import set_distances
from .graph import neighbour_edges
from .paths import geodesics
from .representation import Representation
from .sensations import angles, target_distances, unlike

#: Configurations of each set whose nearest neighbours the literal metric searches: all 1e12 pairs
#: of 1000 sets of 1000 take minutes, and change the minima only by a common factor.
_LITERAL_QUERIES = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyGraph:
    """A graph along the body.

    Attributes:
        edges: `(E, 2)` pairs of nodes, i < j; the graph is connected.
        length: `(E,)` positive, in a unit of its own.
        kernel: `(N,)` the kernel of each node, ascending. Here each kernel is a node; others may
            cut a kernel that lies at several places into pieces.
    """

    edges: np.ndarray
    length: np.ndarray
    kernel: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """`(E, 2)` the kernels that each edge joins."""
        return self.kernel[self.edges]

    def geodesics(self, length: np.ndarray) -> np.ndarray:
        """`(N, N)` lengths of the shortest paths over edges of lengths `(E,)`."""
        return geodesics(self.edges, length, len(self.kernel))


def literal(
    representation: Representation, progress: Callable[[float], None] = lambda fraction: None
) -> BodyGraph:
    """Exactly as in the paper: the complete graph of minimum distances, in mu."""
    minimum = set_distances(
        representation.kernel_sets, "minimum", max_queries=_LITERAL_QUERIES, progress=progress
    )
    i, j = np.triu_indices(len(minimum), 1)
    edges = np.stack([i, j], axis=1)
    return BodyGraph(edges=edges, length=minimum[i, j], kernel=np.arange(len(minimum)))


def sensorimotor(representation: Representation) -> BodyGraph:
    """Neighbours by motor sets or by sensations; lengths are angles between sensations."""
    targets = representation.target_sensations
    apart = np.where(unlike(targets), np.inf, target_distances(targets)[0])
    edges = np.unique(np.vstack([representation.edges, neighbour_edges(apart)]), axis=0)
    return BodyGraph(edges=edges, length=angles(targets, edges), kernel=np.arange(len(targets)))
