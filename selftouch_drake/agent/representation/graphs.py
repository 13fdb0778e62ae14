"""Two graphs over kernels: one to measure the body, one to plan steps along it.

`surface_neighbours` joins kernels that are neighbours on the body, and only those. Shape is
measured along them, so one edge through the body would distort all of it. There are few edges, 5 to
12 per kernel, between kernels that are near both in motor space and in sensation. They are the
quotient graph that a representation stores.

`step_links` joins kernels between which the agent may step: the surface edges, so that all of a
part can be reached, and all pairs of kernels that feel alike, however far apart their motor
configurations are. Which of these the agent can reach in one step depends on its configuration. A
planner weights each link by the actual step and penalises leaps. So an unneeded link costs nothing,
but a missing link costs a detour: over 200 plans on a torus (1000 targets), the cubed steps sum to
1.49 along edges alone and to 1.1 with links.

No edge and no link joins two parts of the body: between them, a plan lifts off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.neighbours import complete_edges, neighbour_edges
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

if TYPE_CHECKING:
    import networkx as nx

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


def surface_neighbours(
    set_distance: np.ndarray, target_sensations: np.ndarray, part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Finds the kernels that are neighbours on the body, and a combined distance between kernels.

    This is the set distance times the root of the distance between target sensations. Two motor
    configurations can be close although they touch distant places: such pairs feel different. With
    the sensations, no edge left the surface in three bodies (without, 17 of 5000 on the torus).
    Kernels with nothing in common come last: the more joints, the less informative is their set
    distance.

    Args:
        set_distance: `(K, K)` rad, between kernel sets.
        target_sensations: `(K, S)` unit L2 norm.
        part: `(K,)` the part of the body of each kernel.

    Returns:
        `(E, 2)` pairs i < j of one part, sorted, and `(K, K)` the combined distance, infinite
        between parts.
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


def to_networkx(representation: QuotientRepresentation, *, complete: bool = False) -> nx.Graph:
    """The quotient graph as a networkx graph.

    Args:
        representation: K kernels.
        complete: join every two kernels, as the paper does, instead of only neighbours.

    Returns:
        Nodes are kernels 0 to K - 1 with attributes `size` (stored configurations), `part`,
        `target_sensation` (`(S,)` unit L2 norm) and `position` (`(3,)` in the embedding of its
        part). Every edge has `set_distance` (rad); edges between neighbours also have `cost` (rad,
        as `edge_cost` of the representation).
    """
    import networkx as nx  # not needed to plan

    graph = nx.Graph()
    sizes = np.diff(representation.kernel_offsets)
    for kernel in range(representation.num_targets):
        graph.add_node(
            kernel,
            size=int(sizes[kernel]),
            part=int(representation.part[kernel]),
            target_sensation=representation.target_sensations[kernel],
            position=representation.embedding[kernel],
        )
    edges = representation.edges
    if complete:
        edges = complete_edges(representation.num_targets)
    distance = representation.set_distance[edges[:, 0], edges[:, 1]]
    for (i, j), apart in zip(edges.tolist(), distance.tolist(), strict=True):
        graph.add_edge(i, j, set_distance=apart)
    for edge, cost in zip(representation.edges, representation.edge_cost.tolist(), strict=True):
        graph.edges[*edge.tolist()]["cost"] = cost
    return graph


def without_vectors(graph: nx.Graph) -> nx.Graph:
    """A graph of `to_networkx` for formats without vectors, such as GraphML.

    A node's `position` becomes `position_0` to `position_2`, its `target_sensation` becomes
    `target_sensation_0` and so on.
    """
    plain = graph.copy()
    for _, attributes in plain.nodes(data=True):
        for name in [name for name, value in attributes.items() if np.ndim(value)]:
            for i, entry in enumerate(np.asarray(attributes.pop(name)).tolist()):
                attributes[f"{name}_{i}"] = entry
    return plain
