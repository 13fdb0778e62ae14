"""Ways to measure the body, by name: which kernels are neighbours, how far apart, how to lay out.

Each metric turns the representation of one part of the body into a graph along it. Distances are
shortest paths on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graphs import unlike
from selftouch_drake.agent.representation.neighbours import (
    complete_edges,
    connected_edges,
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
    """

    edges: np.ndarray
    length: np.ndarray
    kernel: np.ndarray | None = None


@dataclass(frozen=True, slots=True)
class Metric:
    """A way to measure a part of the body.

    Attributes:
        graph: builds the graph from a representation, a seed and what to call with the fraction
            done.
        layout: lays out N nodes from the graph and `(N, N)` shortest paths on it.
        naive: whether it knows only motor configurations and sensations.
        instead: the metric that takes its place on a part where it cannot be trusted.
    """

    graph: Callable[[QuotientRepresentation, int, Progress], BodyGraph]
    layout: Callable[[BodyGraph, np.ndarray], Embedding]
    naive: bool = True
    instead: str | None = None


def share_unlike(representation: QuotientRepresentation, graph: BodyGraph) -> float:
    """Share of the steps of a graph whose ends feel nothing in common.

    Neighbours on a body share receptors. Measured, it is below 0.01 where a learned map came out
    right (six joints), and 0.6 to 0.8 where it did not (twelve joints, two arms).
    """
    kernel = np.arange(representation.num_targets) if graph.kernel is None else graph.kernel
    i, j = kernel[graph.edges].T
    return float(unlike(representation.target_sensations)[i, j].mean())


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
    edges, targets = representation.edges, representation.target_sensations
    chord = np.linalg.norm(targets[edges[:, 0]] - targets[edges[:, 1]], axis=1)
    length = 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    return BodyGraph(edges=edges, length=length)


@_one_thread
def learned(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """Neighbours and lengths in the coordinates of a quotient map learned from motor kernels."""
    coordinates = quotient_coordinates(
        representation.kernel_x, representation.kernel_offsets, seed=seed, progress=progress
    )
    return _between_cells(coordinates, representation.kernel_offsets)


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


def _unbent(num_passes: int) -> Callable[[BodyGraph, np.ndarray], Embedding]:
    return lambda graph, distances: unbent_embedding(graph.edges, distances, num_passes=num_passes)


#: The metrics by name. The truer the lengths, the more passes are of use, as measured.
METRICS: dict[str, Metric] = {
    "literal": Metric(literal, _classical),
    "motor": Metric(motor, _stress),
    "learned": Metric(learned, _unbent(1), instead="sensorimotor"),
    "sensorimotor": Metric(sensorimotor, _unbent(3)),
    "revolute_reference": Metric(revolute_reference, _unbent(3), naive=False),
}
