"""Ways to measure the body, by name: which kernels are neighbours, how far apart, how to lay out.

Each metric turns the representation of one part of the body into a graph along it. Distances are
shortest paths on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graphs import unlike
from selftouch_drake.agent.representation.neighbours import (
    complete_edges,
    connected_edges,
    geodesics,
    locally_scaled,
    neighbour_edges,
)
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import set_distances
from selftouch_drake.agent.shape.cells import Cells
from selftouch_drake.agent.shape.embedding import (
    Embedding,
    classical_embedding,
    stress_embedding,
    unbent_embedding,
)
from selftouch_drake.agent.shape.pieces import cut_wide_cells
from selftouch_drake.agent.shape.quotient_map import quotient_coordinates
from selftouch_drake.agent.shape.revolute import revolute_coordinates

Progress = Callable[[float], None]

# Sums in another order, by another number of threads, would train another network.
_one_thread = threadpool_limits.wrap(limits=1, user_api="blas")

#: Networks of the learned metric. The second one learns first what to expect.
_MOST_NETWORKS = 2

#: A learned map does not know the neighbours if more of its steps than this join kernels that feel
#: nothing in common, as neighbours on a body share receptors: below 0.01 where a map came out
#: right (six joints), 0.2 to 0.9 where it did not (nine joints and more).
_MOST_UNLIKE = 0.015

#: Lengths by the map are not to be trusted if ways along it and ways by feel disagree by this share
#: (standard deviation): 0.03 to 0.07 where a map came out right, 0.08 and more where it did not.
_MOST_APART = 0.075

#: Configurations of a set that ask for their nearest, for the literal metric: all 1e12 pairs of
#: 1000 sets of 1000 take minutes, and their minimum changes by a scale.
_LITERAL_QUERIES = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyGraph:
    """Steps along the body, between kernels or, where a kernel is cut, between its pieces.

    Attributes:
        edges: `(E, 2)` pairs of nodes, i < j, that connect all.
        length: `(E,)` positive, in the metric's unit.
        kernel: `(N,)` the kernel that each node is of, rising; None if nodes are kernels.
        doubt: what could not be trusted, and what was taken instead; None if nothing was doubted.
    """

    edges: np.ndarray
    length: np.ndarray
    kernel: np.ndarray | None = None
    doubt: str | None = None


@dataclass(frozen=True, slots=True)
class Metric:
    """A way to measure a part of the body.

    Attributes:
        graph: builds the graph from a representation, a seed and what to call with the fraction
            done.
        layout: lays out N nodes from the graph and `(N, N)` shortest paths on it.
        naive: whether it knows only motor configurations and sensations.
        calibrated: whether it is known how its layouts show their error: see `confidence`.
    """

    graph: Callable[[QuotientRepresentation, int, Progress], BodyGraph]
    layout: Callable[[BodyGraph, np.ndarray], Embedding]
    naive: bool = True
    calibrated: bool = True


def literal(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """The paper to the letter: the complete graph of minimum distances, in rad."""
    (minimum,) = set_distances(
        representation.kernel_x,
        representation.kernel_offsets,
        "minimum",
        max_queries=_LITERAL_QUERIES,
        progress=progress,
    )
    edges = complete_edges(len(minimum))
    return BodyGraph(edges=edges, length=minimum[edges[:, 0], edges[:, 1]])


def motor(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """Set distances between neighbours, each scaled to the spacing around it."""
    edges = representation.edges
    length = representation.set_distance[edges[:, 0], edges[:, 1]]
    return BodyGraph(edges=edges, length=locally_scaled(length, edges))


def sensorimotor(
    representation: QuotientRepresentation, seed: int, progress: Progress
) -> BodyGraph:
    """The same neighbours, as far apart as the angle between their target sensations."""
    edges = representation.edges
    return BodyGraph(edges=edges, length=_angles(representation.target_sensations, edges))


@_one_thread
def learned(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """Neighbours in a quotient map learned from motor kernels, and lengths by map and by feel.

    What is off in the lengths of the map and in the angles between sensations is hardly the same:
    the geometric mean of both is better than either. And where a network came out bad, they
    disagree, so that another is tried; if that does no better, lengths are those by feel alone. If
    no network knows the neighbours, the metric is `sensorimotor`.
    """

    def of_network(number: int) -> Progress:
        return lambda fraction: progress((number + fraction) / _MOST_NETWORKS)

    targets = representation.target_sensations
    tries: list[tuple[float, BodyGraph, np.ndarray]] = []
    share_unlike = 1.0
    for number in range(_MOST_NETWORKS):
        coordinates = quotient_coordinates(
            representation.kernel_x,
            representation.kernel_offsets,
            seed=seed + number,
            target_sensations=targets if number else None,
            progress=of_network(number),
        )
        graph = _between_cells(coordinates, representation.kernel_offsets)
        ends = graph.edges if graph.kernel is None else graph.kernel[graph.edges]
        share = float(unlike(targets)[ends[:, 0], ends[:, 1]].mean())
        share_unlike = min(share, share_unlike)
        if share > _MOST_UNLIKE:
            continue
        felt = _felt_lengths(targets, ends, graph.length)
        tries.append((_disagreement(graph, felt), graph, felt))
        if tries[-1][0] < _MOST_APART:
            break
    if not tries:
        graph = sensorimotor(representation, seed, progress)
        doubt = f"{share_unlike:.0%} of the neighbours in the learned map feel nothing in common"
        return replace(graph, doubt=f"{doubt}; the sensorimotor metric takes its place")
    apart, graph, felt = min(tries, key=lambda one: one[0])
    if apart < _MOST_APART:
        return replace(graph, length=np.sqrt(graph.length * felt))
    doubt = f"lengths in the learned map and by feel disagree by {apart:.1%}"
    return replace(graph, length=felt, doubt=f"{doubt}; those by feel are taken")


def _felt_lengths(targets: np.ndarray, ends: np.ndarray, length: np.ndarray) -> np.ndarray:
    """`(E,)` angles between the sensations of two kernels `ends` `(E, 2)`, scaled as `length`.

    Between pieces of one kernel, which are felt as one, `length` itself.
    """
    felt = _angles(targets, ends)
    one = ends[:, 0] == ends[:, 1]
    felt *= length[~one].mean() / felt[~one].mean()
    return np.where(one, length, felt)


def _disagreement(graph: BodyGraph, felt: np.ndarray) -> float:
    """Standard deviation of the logarithm of the ratio of ways by two lengths of their steps.

    Ways of less than half the median length are left out: on them, chance has not averaged out.
    """
    num_nodes = int(graph.edges.max()) + 1
    by_map, by_feel = (
        geodesics(graph.edges, length, num_nodes)[np.triu_indices(num_nodes, 1)]
        for length in (graph.length, felt)
    )
    long = by_feel > np.median(by_feel) / 2
    return float(np.log(by_map[long] / by_feel[long]).std())


def _angles(targets: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """`(E,)` rad, angles between target sensations."""
    chord = np.linalg.norm(targets[ends[:, 0]] - targets[ends[:, 1]], axis=1)
    return 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))


@_one_thread
def revolute_reference(
    representation: QuotientRepresentation, seed: int, progress: Progress
) -> BodyGraph:
    """Not naive: the same in coordinates found by one who knows that all joints turn."""
    return _between_cells(
        *revolute_coordinates(representation.kernel_q, representation.kernel_offsets)
    )


def _between_cells(coordinates: np.ndarray, offsets: np.ndarray) -> BodyGraph:
    coordinates, offsets, kernel = cut_wide_cells(coordinates, offsets)
    cells = Cells.of(coordinates, offsets)
    distance = cells.distances()
    edges = connected_edges(neighbour_edges(distance), distance)
    length = locally_scaled(cells.lengths(edges), edges)
    return BodyGraph(edges=edges, length=length, kernel=kernel)


def _classical(graph: BodyGraph, distances: np.ndarray) -> Embedding:
    return classical_embedding(distances)


def _stress(graph: BodyGraph, distances: np.ndarray) -> Embedding:
    return stress_embedding(distances)


def _unbent(graph: BodyGraph, distances: np.ndarray) -> Embedding:
    return unbent_embedding(graph.edges, distances)


#: The metrics by name.
METRICS: dict[str, Metric] = {
    "literal": Metric(literal, _classical, calibrated=False),
    "motor": Metric(motor, _stress, calibrated=False),
    "learned": Metric(learned, _unbent),
    "sensorimotor": Metric(sensorimotor, _unbent),
    "revolute_reference": Metric(revolute_reference, _unbent, naive=False),
}
