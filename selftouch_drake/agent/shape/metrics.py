"""The body's shape by name: which kernels are neighbours, how far apart, and how to lay them out.

Each metric turns a representation into a graph along the body. Distances are shortest paths on it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.graph import (
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
    warn_of_misfit,
)
from selftouch_drake.agent.shape.parts import cut_wide_cells
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
    """Steps along the body, between kernels or, where a kernel is cut, between its parts.

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
    """A way to measure the body.

    Attributes:
        graph: builds the graph from a representation, a seed and a listener to its progress.
        layout: lays out N nodes from the graph and `(N, N)` shortest paths on it.
        naive: whether it knows only motor configurations and sensations.
    """

    graph: Callable[[QuotientRepresentation, int, Progress], BodyGraph]
    layout: Callable[[BodyGraph, np.ndarray], Embedding]
    naive: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredBody:
    """The body by one metric.

    Attributes:
        distances: `(K, K)` along the body, in the metric's unit.
        embedding: the kernels laid out in space.
        parts: `(P, 3)` where the parts of those kernels lie that were cut in parts.
    """

    distances: np.ndarray
    embedding: Embedding
    parts: np.ndarray

    @property
    def places(self) -> np.ndarray:
        """`(K + P, 3)` the kernels and then the parts: the body, sampled without gaps."""
        return np.concatenate([self.embedding.positions, self.parts])


def literal(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """The paper to the letter: the complete graph of minimum distances, in rad."""
    (minimum,) = set_distances(
        representation.kernel_q,
        representation.kernel_offsets,
        "minimum",
        max_queries=_LITERAL_QUERIES,
        progress=progress,
    )
    edges = complete_edges(len(minimum))
    return BodyGraph(edges=edges, length=minimum[edges[:, 0], edges[:, 1]])


def motor(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """Set distances between neighbours, each scaled to the spacing around it."""
    edges = surface_edges(representation)
    length = representation.set_distance[edges[:, 0], edges[:, 1]]
    return BodyGraph(edges=edges, length=locally_scaled(length, edges))


def sensorimotor(
    representation: QuotientRepresentation, seed: int, progress: Progress
) -> BodyGraph:
    """The same neighbours, as far apart as their target sensations."""
    edges = surface_edges(representation)
    targets = representation.target_sensations
    length = np.linalg.norm(targets[edges[:, 0]] - targets[edges[:, 1]], axis=1)
    return BodyGraph(edges=edges, length=length)


@_one_thread
def learned(representation: QuotientRepresentation, seed: int, progress: Progress) -> BodyGraph:
    """Neighbours and lengths in the coordinates of a quotient map learned from motor kernels."""
    coordinates = quotient_coordinates(
        representation.kernel_q, representation.kernel_offsets, seed=seed, progress=progress
    )
    return _between_cells(coordinates, representation.kernel_offsets)


@_one_thread
def revolute_reference(
    representation: QuotientRepresentation, seed: int, progress: Progress
) -> BodyGraph:
    """Not naive: the same in coordinates found by one who is told that all joints turn."""
    return _between_cells(
        *revolute_coordinates(representation.kernel_q, representation.kernel_offsets)
    )


def surface_edges(representation: QuotientRepresentation) -> np.ndarray:
    """`(E, 2)` near neighbours, joined where they fall apart.

    Nearness is the set distance times the root of the distance between target sensations. An arm
    can come near another place of the body without passing between: such pairs feel unlike, and
    with the sensations no edge left the surface in three bodies (17 of 5000 on the torus without).
    """
    targets = representation.target_sensations
    near = representation.set_distance * np.sqrt(cdist(targets, targets))
    return connected_edges(neighbour_edges(near), near)


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
    "learned": Metric(learned, _unbent(1)),
    "sensorimotor": Metric(sensorimotor, _unbent(5)),
    "revolute_reference": Metric(revolute_reference, _unbent(3), naive=False),
}


def recover(
    representation: QuotientRepresentation,
    metric: str,
    *,
    seed: int = 0,
    progress: Progress = lambda fraction: None,
) -> RecoveredBody:
    """Recovers the body by a metric chosen by name.

    Args:
        representation: K kernels, 4 or more.
        metric: a name in `METRICS`.
        seed: of metrics that learn; the same seed gives the same bytes.
        progress: told the fraction done.

    Raises:
        ValueError: the metric is unknown, or the representation is too small for it.
    """
    if metric not in METRICS:
        raise ValueError(f"metric {metric!r} is unknown: choose one of {', '.join(METRICS)}.")
    graph = METRICS[metric].graph(representation, seed, lambda fraction: progress(0.9 * fraction))
    num_kernels = representation.num_targets
    kernel = np.arange(num_kernels) if graph.kernel is None else graph.kernel
    distances = geodesics(graph.edges, graph.length, len(kernel))
    layout = METRICS[metric].layout(graph, distances)
    progress(1.0)
    return _of_kernels(kernel, num_kernels, distances, layout)


def _of_kernels(
    kernel: np.ndarray, num_kernels: int, distances: np.ndarray, layout: Embedding
) -> RecoveredBody:
    """A kernel lies amid its parts, and as far from others as they do on average."""
    number = np.bincount(kernel, minlength=num_kernels)
    mean = csr_array(
        (1.0 / number[kernel], (kernel, np.arange(len(kernel)))), shape=(num_kernels, len(kernel))
    )
    between = mean @ (mean @ distances).T
    np.fill_diagonal(between, 0.0)
    return RecoveredBody(
        distances=between,
        embedding=dataclasses.replace(layout, positions=mean @ layout.positions),
        parts=layout.positions[number[kernel] > 1],
    )


def embed_representation(
    representation: QuotientRepresentation, metric: str, *, seed: int = 0
) -> QuotientRepresentation:
    """The same representation, its `embedding` filled by a metric.

    Warns:
        MisfitWarning: the distances ask for more than three dimensions.
    """
    embedding = recover(representation, metric, seed=seed).embedding
    warn_of_misfit(embedding)
    return dataclasses.replace(representation, embedding=embedding.positions)
