"""The quotient graph: topology on M/=_Psi (paper, "Motor planning").

"Links between points are topological relations. Note that by defining these links, one fixes the
topology of the internal representation space." The paper's graph is complete; its edges include
chords through free space, and a shape measured along them is wrong. Here an edge joins kernels that
are neighbours on the body, and only those: 5 to 12 per kernel, between kernels that are near both
in motor space and in sensation.
"""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from .distances import linked_nearest
from .kernels import KernelSets
from .paths import component_labels
from .representation import Representation
from .sensations import unlike

if TYPE_CHECKING:
    import networkx as nx

#: Mutual nearest: two rings of a triangulated surface hold 18 kernels, one ring 6. With more, edges
#: become short cuts (shape); with fewer, the dimension is too low.
NUM_MUTUAL = 12

#: Nearest that are neighbours in any case: nearly one ring. With fewer, kernels are isolated where
#: fields are uneven.
NUM_KEPT = 5


class DisconnectedWarning(UserWarning):
    """A pruned graph was disconnected, and was joined by its shortest bridges."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuotientGraph:
    """The edges between K kernel sets.

    Attributes:
        edges: `(E, 2)` pairs of kernels that are neighbours on the body, i < j, sorted.
        cost: `(E,)` float32 mu, mean nearest-neighbour distance between the stronger halves of
            both kernels.
        component: `(K,)` the component of each kernel before bridges were added; 0 is the largest.
    """

    edges: np.ndarray
    cost: np.ndarray
    component: np.ndarray

    @property
    def bridges(self) -> np.ndarray:
        """`(B, 2)` the edges that join components."""
        i, j = self.edges.T
        return self.edges[self.component[i] != self.component[j]]


def quotient_graph(sets: KernelSets, strength: np.ndarray, distance: np.ndarray) -> QuotientGraph:
    """Joins kernels that are neighbours on the body.

    Args:
        sets: the K kernel sets, scaled, mu.
        strength: `(R,)` N, of the sensation at each configuration.
        distance: `(K, K)` as from `combined_distance`; infinite between what nothing may join.

    Warns:
        DisconnectedWarning: as in `connected_edges`.
    """
    neighbours = neighbour_edges(distance)
    edges = connected_edges(neighbours, distance)
    return QuotientGraph(
        edges=edges,
        cost=_nearest_distance(sets.stronger_half(strength), edges),
        component=component_labels(neighbours, len(sets)),
    )


def _nearest_distance(sets: KernelSets, edges: np.ndarray) -> np.ndarray:
    """`(E,)` float32 mu, mean nearest distance over both directions of each edge."""
    near = linked_nearest(sets, np.concatenate([edges, edges[:, ::-1]]))
    there, back = np.split(np.add.reduceat(np.sqrt(near.squared), near.offsets[:-1]), 2)
    i, j = edges.T
    return ((there / sets.sizes[i] + back / sets.sizes[j]) / 2).astype(np.float32)


def combined_distance(set_distance: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """`(K, K)` distances between kernels by motor configurations and by sensations.

    The `(K, K)` set distance, mu, times the root of the distance between the `(K, S)` target
    sensations. Two motor configurations can be close although they touch distant places: such pairs
    feel different. With the sensations, no edge left the surface in three bodies (without, 17 of
    5000 on the torus). Kernels with nothing in common come last: the more joints, the less
    informative is their set distance.
    """
    distance = set_distance * np.sqrt(cdist(targets, targets))
    # Ranked behind all others, in order: they connect the graph only if nothing else does.
    distance += np.where(unlike(targets), distance.max(), 0.0)
    return distance


def neighbour_edges(
    distance: np.ndarray, num_mutual: int = NUM_MUTUAL, num_kept: int = NUM_KEPT
) -> np.ndarray:
    """`(E, 2)` pairs i < j, sorted: prunes the complete graph to near neighbours.

    Two kernels are neighbours if each is among the `num_mutual` nearest of the other, which
    excludes the many one-sided pairs; or if one is among the `num_kept` nearest of the other, so
    that no kernel is isolated. The `(K, K)` distance is symmetric; pairs at infinite distance are
    not neighbours.
    """
    distance = np.array(distance, dtype=float)
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1, kind="stable")
    near = np.zeros(distance.shape, dtype=bool)
    kept = np.zeros(distance.shape, dtype=bool)
    np.put_along_axis(near, order[:, :num_mutual], True, axis=1)
    np.put_along_axis(kept, order[:, :num_kept], True, axis=1)
    neighbours = (near & near.T) | kept | kept.T
    return np.argwhere(np.triu(neighbours & np.isfinite(distance), 1))


def connected_edges(edges: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Adds the fewest and shortest bridges that make a graph connected.

    Edges are `(E, 2)` pairs i < j, without and with bridges; the `(K, K)` distance is the length of
    a bridge, infinite where none is allowed.

    Warns:
        DisconnectedWarning: bridges were added; the text gives sizes of the components, and the
            bridges.
    """
    label = component_labels(edges, len(distance))
    num_components = int(label.max()) + 1
    if num_components == 1:
        return edges
    # To csgraph a length of zero is no edge. All edges are shorter than any bridge.
    length = np.where(np.isfinite(distance), 2.0 + distance, 0.0)
    length[tuple(edges.T)] = 1.0
    tree = np.argwhere(minimum_spanning_tree(np.triu(length, 1)).toarray())
    bridges = tree[label[tree[:, 0]] != label[tree[:, 1]]]
    if not len(bridges):
        return edges
    warnings.warn(
        f"the quotient graph fell into {num_components} components, with "
        f"{_first_five(np.bincount(label))} kernels, and was joined by the bridges "
        f"{_first_five(f'{i}-{j}' for i, j in bridges)}: babble longer, or give fewer targets",
        DisconnectedWarning,
        stacklevel=2,
    )
    return np.unique(np.concatenate([edges, bridges]), axis=0)


def _first_five(items: Iterable[object]) -> str:
    texts = [str(item) for item in items]
    if len(texts) > 5:
        texts = [*texts[:5], "..."]
    return ", ".join(texts)


def to_networkx(representation: Representation, *, complete: bool = False) -> "nx.Graph":
    """The quotient graph as a networkx graph.

    Nodes are kernels with attributes `size` (stored configurations) and `target_sensation` (`(S,)`
    unit L2 norm). Every edge has `set_distance` (mu); edges between neighbours also have `cost`
    (mu, as `edge_cost` of the representation). A complete graph joins every two kernels, as in the
    paper.
    """
    import networkx as nx  # not needed to plan

    graph = nx.Graph()
    sizes = np.diff(representation.kernel_offsets).tolist()
    for kernel, (size, target) in enumerate(
        zip(sizes, representation.target_sensations, strict=True)
    ):
        graph.add_node(kernel, size=size, target_sensation=target)
    edges = representation.edges
    if complete:
        edges = np.stack(np.triu_indices(representation.num_targets, 1), axis=1)
    for name, (i, j), values in (
        ("set_distance", edges.T, representation.set_distance[*edges.T]),
        ("cost", representation.edges.T, representation.edge_cost),
    ):
        weighted = zip(i.tolist(), j.tolist(), values.tolist(), strict=True)
        graph.add_weighted_edges_from(weighted, weight=name)
    return graph
