"""Two graphs over kernels: one to measure the body, one to plan steps along it.

`surface_neighbours` joins kernels that are neighbours on the body, and only those. Shape is
measured along them, so one edge through the body would distort all of it. There are few edges, 5 to
12 per kernel, between kernels that are near both in motor space and in sensation. They are the
quotient graph that a representation stores.

`step_links` joins kernels between which the agent may step: the surface edges, so that all of a
part can be reached, and all pairs of kernels that feel alike, however far apart their motor
configurations are. A planner weights each link by the actual step and penalises leaps. So an
unneeded link costs nothing, but a missing link costs a detour: over 200 plans on a torus (1000
targets), the cubed steps sum to 1.49 along edges alone and to 1.1 with links.

No edge and no link joins two parts of the body: between them, a plan lifts off. The paper's graph
is complete (section III); its edges include chords through free space.
"""

import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numba
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.threads import in_slices

if TYPE_CHECKING:
    import networkx as nx

#: Mutual nearest: two rings of a triangulated surface hold 18 kernels, one ring 6.
NUM_MUTUAL = 12

#: Nearest that are neighbours in any case: nearly one ring.
NUM_KEPT = 5

#: Kernels whose targets are within this many spacings are linked; 1.4 to 2 work equally well.
LINK_SPACINGS = 1.5
# With few targets the spacing is too wide to be useful: sensations that have nothing in common are
# sqrt(2) apart. This distance limits links to those that have more in common than not.
_MOST_APART = 1.0
# Target sensations with a smaller cosine have nothing in common, so they are not neighbours. With
# two arms on one body and 60 kernels on a forearm (12 joints), a sixth of the edges joined such
# kernels: the shape error was 16 %, and 5 % without them. With six joints there are hardly any.
_LEAST_ALIKE = 0.05
# The spacing of targets is the distance to the neighbour of this rank, as on a surface.
_SPACING_NEIGHBOUR = 6
# Kernels whose paths one thread shortens at once: their lengths stay in the cache of a core.
_SOURCES = 128


class DisconnectedWarning(UserWarning):
    """A pruned graph was disconnected, and was joined by its shortest bridges."""


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
    near, kept = np.zeros((2, *distance.shape), dtype=bool)
    np.put_along_axis(near, order[:, :num_mutual], True, axis=1)
    np.put_along_axis(kept, order[:, :num_kept], True, axis=1)
    return np.argwhere(np.triu(((near & near.T) | kept | kept.T) & np.isfinite(distance), 1))


def one_ring(edges: np.ndarray, num_kernels: int) -> csr_array:
    """`(K, K)` 1 where two kernels are the same or neighbours, 0 elsewhere; powers are rings."""
    (i, j), here = edges.T, np.arange(num_kernels)
    ends = np.r_[i, j, here], np.r_[j, i, here]
    return csr_array((np.ones(len(ends[0])), ends), shape=(num_kernels, num_kernels))


def component_labels(edges: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K,)` the component of each kernel; 0 is the largest."""
    ends = tuple(np.asarray(edges).reshape(-1, 2).T)
    graph = csr_array((np.ones(len(edges)), ends), shape=(num_kernels, num_kernels))
    _, label = connected_components(graph, False)
    by_size = np.argsort(-np.bincount(label), kind="stable")
    return np.argsort(by_size)[label]


def connected_edges(edges: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Adds the fewest and shortest bridges that make a graph connected.

    Edges are `(E, 2)` pairs i < j, without and with bridges; the `(K, K)` distance is the length of
    a bridge, infinite where none is allowed, as between parts of the body.

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
        f"the quotient graph fell into {num_components} components, of "
        f"{_first_five(np.bincount(label))} kernels, joined by bridges "
        f"{_first_five(f'{i}-{j}' for i, j in bridges)}: babble longer, or give fewer targets",
        DisconnectedWarning,
        stacklevel=2,
    )
    return np.unique(np.concatenate([edges, bridges]), axis=0)


def geodesics(edges: np.ndarray, length: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K, K)` shortest paths between kernels, infinite if none; `(E,)` lengths are positive."""
    found = np.empty((num_kernels, num_kernels))
    tail, head = np.ascontiguousarray(np.reshape(edges, (-1, 2)).T)
    length = np.asarray(length, dtype=float)

    def fill(rows: slice) -> None:
        to_all = np.where(
            np.arange(num_kernels)[:, None] == np.arange(num_kernels)[rows], 0, np.inf
        )
        _shorten(tail, head, length, to_all)
        found[rows] = to_all.T

    in_slices(fill, num_kernels, _SOURCES)
    return found


@numba.njit(nogil=True, cache=True)
def _shorten(tail: np.ndarray, head: np.ndarray, length: np.ndarray, path: np.ndarray) -> None:
    """Shortens paths `(K, n)`, from n kernels to all, over the edges until none gets shorter.

    The sources are in the vector lanes: with few hops between kernels, this takes a sixth of the
    time of `scipy.sparse.csgraph.dijkstra`, for the same bytes.
    """
    shorter = True
    while shorter:
        shorter = False
        for edge in range(len(length)):
            there, here, step, fewer = path[tail[edge]], path[head[edge]], length[edge], 0
            for source in range(len(here)):
                back, out = here[source] + step, there[source] + step
                fewer += (out < here[source]) + (back < there[source])
                here[source] = out if out < here[source] else here[source]
                there[source] = back if back < there[source] else there[source]
            if fewer:
                shorter = True


def locally_scaled(length: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """`(E,)` lengths of `(E, 2)` edges in units of the spacing around their ends, about 1.

    They are `d / sqrt(s_i s_j)`; the spacing `s_i` is the mean length of the edges at kernel i.
    Cells are evenly spaced in sensation, so neighbours should be equally far apart, however
    redundant the arm is there.
    """
    i, j = edges.T
    total = np.bincount(edges.ravel(), np.repeat(length, 2))
    spacing = total / np.maximum(np.bincount(edges.ravel()), 1)
    return length / np.sqrt(spacing[i] * spacing[j])


def _first_five(items: Iterable[object]) -> str:
    texts = [str(item) for item in items]
    return ", ".join(texts[:5] + ["..."] * (len(texts) > 5))


def surface_neighbours(
    set_distance: np.ndarray, target_sensations: np.ndarray, part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Finds the kernels that are neighbours on the body, and a combined distance between kernels.

    This is the set distance times the root of the distance between target sensations. Two motor
    configurations can be close although they touch distant places: such pairs feel different. With
    the sensations, no edge left the surface in three bodies (without, 17 of 5000 on the torus).
    Kernels with nothing in common come last: the more joints, the less informative is their set
    distance.

    Of `(K, K)` rad set distances, `(K, S)` target sensations of unit L2 norm, and `(K,)` the part
    of each kernel, it returns `(E, 2)` pairs i < j of one part, sorted, and `(K, K)` the combined
    distance, infinite between parts.
    """
    near = set_distance * np.sqrt(cdist(target_sensations, target_sensations))
    # Ranked behind all others, in order: they connect the graph only if nothing else does.
    near += np.where(unlike(target_sensations), near.max(), 0.0)
    near[part[:, None] != part] = np.inf
    return neighbour_edges(near), near


def unlike(target_sensations: np.ndarray) -> np.ndarray:
    """`(K, K)` bool, pairs of `(K, S)` target sensations that have nothing in common."""
    alike = target_sensations @ target_sensations.T
    return alike < _LEAST_ALIKE


def step_links(representation: QuotientRepresentation) -> np.ndarray:
    """`(L, 2)` the kernels between which plans may step, each pair once, in order."""
    distance, spacing = target_distances(representation)
    linked = distance <= min(LINK_SPACINGS * spacing, _MOST_APART)
    linked &= representation.part[:, None] == representation.part
    i, j = representation.edges.T
    linked[i, j] = True
    return np.argwhere(np.triu(linked | linked.T, 1))


def target_distances(representation: QuotientRepresentation) -> tuple[np.ndarray, float]:
    """`(K, K)` distances between target sensations, and their spacing."""
    targets = np.asarray(representation.target_sensations, dtype=float)
    distance = np.sqrt(np.clip(2.0 - 2.0 * targets @ targets.T, 0.0, None))
    neighbour = min(_SPACING_NEIGHBOUR, len(targets) - 1)
    return distance, float(np.median(np.partition(distance, neighbour, axis=1)[:, neighbour]))


def link_lengths(representation: QuotientRepresentation, links: np.ndarray) -> np.ndarray:
    """`(L,)` lengths of `(L, 2)` links along the body as the agent feels it, in spacings."""
    distance, spacing = target_distances(representation)
    return distance[*links.T] / spacing


def to_networkx(representation: QuotientRepresentation, *, complete: bool = False) -> "nx.Graph":
    """The quotient graph as a networkx graph.

    Nodes are kernels with attributes `size` (stored configurations), `part`, `target_sensation`
    (`(S,)` unit L2 norm) and `position` (`(3,)` in the embedding of its part). Every edge has
    `set_distance` (rad); edges between neighbours also have `cost` (rad, as `edge_cost` of the
    representation). A complete graph joins every two kernels, as in the paper.
    """
    import networkx as nx  # not needed to plan

    graph = nx.Graph()
    for kernel, size in enumerate(np.diff(representation.kernel_offsets).tolist()):
        graph.add_node(
            kernel,
            size=size,
            part=int(representation.part[kernel]),
            target_sensation=representation.target_sensations[kernel],
            position=representation.embedding[kernel],
        )
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


def without_vectors(graph: "nx.Graph") -> "nx.Graph":
    """A graph of `to_networkx` for formats without vectors, such as GraphML.

    A node's `position` becomes `position_0` to `position_2`, and so on.
    """
    plain = graph.copy()
    for _, attributes in plain.nodes(data=True):
        for name in [name for name, value in attributes.items() if np.ndim(value)]:
            for i, entry in enumerate(np.asarray(attributes.pop(name)).tolist()):
                attributes[f"{name}_{i}"] = entry
    return plain
