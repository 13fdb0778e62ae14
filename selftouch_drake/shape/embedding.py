"""The shape of the body, from the distances between its kernel sets (paper, section IV).

A metric turns a representation into distances along the body between all kernels; an embedding
lays the kernels out in three dimensions at those distances.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, inv
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from selftouch_drake.representation.graph import (
    complete_edges,
    connected_edges,
    geodesics,
    locally_scaled,
    neighbour_edges,
    quotient_pseudo_metric,
)
from selftouch_drake.representation.quotient import QuotientRepresentation
from selftouch_drake.representation.set_distances import set_distances

# Sums in another order, by another number of threads, turn the axes of a symmetric body freely.
_one_thread = threadpool_limits.wrap(limits=1, user_api="blas")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Embedding:
    """Kernels laid out in space.

    Attributes:
        positions: `(K, 3)` in the unit of the distances, centred, in an arbitrary pose.
        stress: weighted squared misfit of distances, as a share: 0 is exact.
        spectrum: `(K,)` eigenvalues of classical scaling, falling, as shares of the largest. Paths
            along a curved body have no flat layout: the fourth eigenvalue warns how far from one.
    """

    positions: np.ndarray
    stress: float
    spectrum: np.ndarray


def literal(representation: QuotientRepresentation) -> np.ndarray:
    """The paper to the letter: shortest paths over minimum distances in the complete graph.

    Returns:
        `(K, K)` rad.
    """
    (minimum,) = set_distances(representation.kernel_q, representation.kernel_offsets, "minimum")
    return quotient_pseudo_metric(minimum, complete_edges(len(minimum)))


def motor(representation: QuotientRepresentation) -> np.ndarray:
    """Geodesics of the near-neighbour graph, every edge scaled to the spacing around it.

    Returns:
        `(K, K)` in spacings.
    """
    edges = surface_edges(representation)
    length = locally_scaled(representation.set_distance, edges)
    return geodesics(edges, length, representation.num_targets)


def sensorimotor(representation: QuotientRepresentation) -> np.ndarray:
    """Geodesics of the same graph, an edge as long as its target sensations lie apart.

    Returns:
        `(K, K)` in distances between unit sensations.
    """
    edges = surface_edges(representation)
    i, j = edges.T
    targets = representation.target_sensations
    length = np.linalg.norm(targets[i] - targets[j], axis=1)
    return geodesics(edges, length, representation.num_targets)


#: The metrics by name. Each is a function from a representation to `(K, K)` distances.
METRICS: dict[str, Callable[[QuotientRepresentation], np.ndarray]] = {
    "literal": literal,
    "motor": motor,
    "sensorimotor": sensorimotor,
}


def surface_edges(representation: QuotientRepresentation) -> np.ndarray:
    """`(E, 2)` near neighbours by set distance, joined where they fall apart."""
    distance = representation.set_distance
    return connected_edges(neighbour_edges(distance), distance)


def body_distances(representation: QuotientRepresentation, metric: str) -> np.ndarray:
    """Computes the distances of a metric chosen by name.

    Returns:
        `(K, K)` distances between all kernels, in the metric's unit.

    Raises:
        ValueError: the metric is unknown.
    """
    if metric not in METRICS:
        raise ValueError(f"metric {metric!r} is unknown: choose one of {', '.join(METRICS)}.")
    return METRICS[metric](representation)


def embed(representation: QuotientRepresentation, metric: str) -> Embedding:
    """Lays out the kernels by a metric: `literal` by classical scaling, all others by stress.

    Raises:
        ValueError: the metric is unknown.
    """
    distances = body_distances(representation, metric)
    return classical_embedding(distances) if metric == "literal" else stress_embedding(distances)


def embed_representation(
    representation: QuotientRepresentation, metric: str
) -> QuotientRepresentation:
    """The same representation, its `embedding` filled by a metric."""
    return dataclasses.replace(representation, embedding=embed(representation, metric).positions)


@_one_thread
def classical_embedding(distances: np.ndarray) -> Embedding:
    """Lays out points by classical multidimensional scaling.

    Args:
        distances: `(K, K)` symmetric, finite.
    """
    axes, spectrum = _classical_axes(distances, 3)
    return Embedding(
        positions=axes, stress=_stress(axes, distances, _weights(distances)), spectrum=spectrum
    )


@_one_thread
def stress_embedding(
    distances: np.ndarray,
    *,
    starts: Sequence[tuple[int, int, int]] = ((0, 1, 2), (0, 1, 3), (0, 1, 4), (0, 1, 5)),
    num_trial_iterations: int = 30,
    num_iterations: int = 100,
) -> Embedding:
    """Lays out points by weighted stress, `sum((d_ij - |x_i - x_j|)^2 / d_ij^2)`, by majorisation.

    Weights of 1 / d^2 let near neighbours count as much as far ones: distances along a body are
    true nearby and too long far away. Stress has many local minima (a ring's third axis may be the
    second harmonic of the ring), so that several triples of classical axes are tried, and the one
    that comes to the lowest stress is finished.

    Args:
        distances: `(K, K)` symmetric, finite, positive off the diagonal.
        starts: triples of classical axes to start from.
        num_trial_iterations: for each start.
        num_iterations: for the best.

    Raises:
        ValueError: there are fewer than 4 points, or no path joins two of them.
    """
    if len(distances) < 4:
        raise ValueError(f"num_targets={len(distances)}: a body in space needs 4 kernels or more.")
    if not np.isfinite(distances).all():
        raise ValueError("distances are infinite where no path joins: connect the graph first.")
    num_axes = min(1 + max(max(start) for start in starts), len(distances))
    axes, spectrum = _classical_axes(distances, num_axes)
    weights = _weights(distances)
    step = _majoriser(distances, weights)
    trials = [
        step(axes[:, start], num_trial_iterations) for start in starts if max(start) < num_axes
    ]
    best = min(trials, key=lambda positions: _stress(positions, distances, weights))
    positions = step(best, num_iterations)
    return Embedding(
        positions=positions, stress=_stress(positions, distances, weights), spectrum=spectrum
    )


def _classical_axes(distances: np.ndarray, num_axes: int) -> tuple[np.ndarray, np.ndarray]:
    """`(K, num_axes)` principal coordinates, each with a fixed sign, and the spectrum."""
    squared = np.square(distances, dtype=float)
    centred = squared - squared.mean(axis=0) - squared.mean(axis=1)[:, None] + squared.mean()
    values, vectors = eigh(-centred / 2)
    values, vectors = values[::-1], vectors[:, ::-1]
    axes = vectors[:, :num_axes] * np.sqrt(np.maximum(values[:num_axes], 0.0))
    largest = np.abs(axes).argmax(axis=0)
    return axes * np.sign(axes[largest, np.arange(num_axes)]), values / values[0]


def _weights(distances: np.ndarray) -> np.ndarray:
    weights = np.zeros(distances.shape)
    np.divide(1.0, np.square(distances, dtype=float), out=weights, where=distances > 0)
    np.fill_diagonal(weights, 0.0)
    return weights


def _stress(positions: np.ndarray, distances: np.ndarray, weights: np.ndarray) -> float:
    """Weighted squared misfit over weighted squared distance, at the best common scale."""
    laid = _lengths(positions)
    cross, norm = np.sum(weights * laid * distances), np.sum(weights * laid**2)
    return float(1.0 - cross**2 / (norm * np.sum(weights * np.square(distances))))


def _lengths(positions: np.ndarray) -> np.ndarray:
    return cdist(positions, positions)


def _majoriser(
    distances: np.ndarray, weights: np.ndarray
) -> Callable[[np.ndarray, int], np.ndarray]:
    """Builds the SMACOF iteration (Guttman transform), overrelaxed (de Leeuw and Heiser).

    The system solved is the same at each step, and is inverted once.
    """
    laplacian = np.diag(weights.sum(axis=1)) - weights
    # A constant added everywhere fixes the centroid, and leaves the solution as it is.
    solve = inv(laplacian + weights.mean())
    pull = weights * distances

    def transform(positions: np.ndarray) -> np.ndarray:
        laid = _lengths(positions)
        ratio = np.divide(pull, laid, out=np.zeros_like(pull), where=laid > 0)
        return solve @ (ratio.sum(axis=1)[:, None] * positions - ratio @ positions)

    def iterate(positions: np.ndarray, num_iterations: int) -> np.ndarray:
        for _ in range(num_iterations - 1):
            positions = 2.0 * transform(positions) - positions
        return transform(positions)

    return iterate
