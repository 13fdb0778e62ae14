"""Lays out kernels in space from their distances along the body (paper, section IV)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numba
import numpy as np
from scipy.linalg import eigh, eigvalsh, inv
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.neighbours import geodesics
from selftouch_drake.threads import Threads, mapped

# The number of threads changes the order of sums, and with it the axes of a symmetric body.
_one_thread = threadpool_limits.wrap(limits=1, user_api="blas")


#: Threshold of the fourth eigenvalue, above which a layout is doubted. Measured on six bodies, 100
#: to 1000 kernels: 0.03 to 0.13 where the shape is right, 0.17 to 0.8 where it is wrong.
_MISFIT = 0.15


#: Passes end with the first that leaves more than this share of the stress; it is discarded. A body
#: whose second pass is kept has rims, and needs more.
_LEAST_LOWERED, _LEAST_LOWERED_WITH_RIMS = 2 / 3, 0.95

#: Stands for the square of a distance of zero.
_TINY = 1e-300

# Points that one thread pulls at once.
_ROWS = 256


class MisfitWarning(UserWarning):
    """The distances do not fit in three dimensions: the layout cannot be trusted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Embedding:
    """Kernels laid out in space.

    Attributes:
        positions: `(K, 3)` in the unit of the distances, centred, in an arbitrary pose.
        stress: weighted squared misfit of distances, as a share: 0 is exact.
        spectrum: `(K,)` eigenvalues of classical scaling, descending, as shares of the largest.
            The fourth shows how far the distances are from fitting in three dimensions.
    """

    positions: np.ndarray
    stress: float
    spectrum: np.ndarray

    @property
    def fourth_eigenvalue(self) -> float:
        """The fourth eigenvalue, as a share of the largest: see `MisfitWarning`."""
        return float(self.spectrum[3])


@dataclass(frozen=True, slots=True, eq=False)
class Majoriser:
    """Lowers the weighted stress of layouts: SMACOF, overrelaxed (de Leeuw and Heiser).

    Attributes:
        weights: `(K, K)` of the squared misfits.
        inverse: `(K, K)` of the matrix of the linear system, which is the same in each step.
    """

    weights: np.ndarray
    inverse: np.ndarray

    @classmethod
    @_one_thread
    def of(cls, distances: np.ndarray) -> Majoriser:
        """For `(K, K)` distances; a pair at distance d has the weight 1 / d^2."""
        weights = _weights(distances)
        laplacian = np.diag(weights.sum(axis=1)) - weights
        # Adding a constant everywhere fixes the centroid and does not change the solution.
        return cls(weights, inv(laplacian + weights.mean()))

    @_one_thread
    def __call__(
        self, positions: np.ndarray, distances: np.ndarray, num_iterations: int
    ) -> np.ndarray:
        """Moves `(K, 3)` positions, step by step, toward `(K, K)` distances (Guttman transform)."""
        pull, laid = self.weights * distances, positions.T.copy()
        total = np.empty_like(laid)
        with Threads() as pool:
            for left in reversed(range(num_iterations)):
                add_pulls = partial(_add_pulls, laid, pull, total)
                list(pool.map(add_pulls, range(0, len(pull), _ROWS)))
                moved = total @ self.inverse
                laid = 2.0 * moved - laid if left else moved
        return laid.T

    def stress(self, positions: np.ndarray, distances: np.ndarray) -> float:
        """Weighted squared misfit over weighted squared distance, at the best common scale."""
        return _stress(positions, distances, self.weights)


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
    majoriser: Majoriser | None = None,
) -> Embedding:
    """Lays out points by weighted stress, `sum((d_ij - |x_i - x_j|)^2 / d_ij^2)`, by majorisation.

    Weights of 1 / d^2 give near neighbours as much influence as far ones: geodesic distances are
    accurate nearby and too long far away. Stress has many local minima (a ring's third axis may be
    the second harmonic of the ring), so several triples of classical axes are tried, and only the
    one with the lowest stress is iterated to the end.

    Args:
        distances: `(K, K)` symmetric, finite, positive off the diagonal.
        starts: triples of classical axes to start from.
        num_trial_iterations: iterations for each start.
        num_iterations: iterations for the best start.
        majoriser: of these distances; None makes one.

    Raises:
        ValueError: there are fewer than 4 points, or no path joins two of them.
    """
    if len(distances) < 4:
        raise ValueError(
            f"num_targets is {len(distances)}: give at least 4, to lay out a body in space"
        )
    if not np.isfinite(distances).all():
        raise ValueError("distances are infinite where no path exists: connect the graph first")
    num_axes = min(1 + max(max(start) for start in starts), len(distances))
    axes, spectrum = _classical_axes(distances, num_axes)
    majoriser = majoriser or Majoriser.of(distances)
    trials = mapped(
        lambda start: majoriser(axes[:, start], distances, num_trial_iterations),
        [start for start in starts if max(start) < num_axes],
    )
    best = min(trials, key=lambda positions: majoriser.stress(positions, distances))
    positions = majoriser(best, distances, num_iterations)
    return Embedding(
        positions=positions, stress=majoriser.stress(positions, distances), spectrum=spectrum
    )


@_one_thread
def curvature_corrected_mds(
    edges: np.ndarray,
    distances: np.ndarray,
    *,
    most_passes: int = 5,
    num_iterations: int = 40,
) -> Embedding:
    """Lays out points by stress, then corrects for the curvature of the body.

    Geodesics along a body are longer than straight lines. Each pass measures the ratio on the
    current layout, shortens the distances by it, and lays out again. This also amplifies errors of
    the distances, so the passes end when one of the first two does not lower the stress by a third.
    Bodies with rims need more: further passes go on while the stress falls.

    Args:
        edges: `(E, 2)` pairs of neighbours that connect all points.
        distances: `(K, K)` shortest paths over these edges, whatever the edge lengths.
        most_passes: 0 keeps the layout of `stress_embedding`.
        num_iterations: of majorisation, in each pass.
    """
    majoriser = Majoriser.of(distances)
    found = stress_embedding(distances, majoriser=majoriser)
    unbend = unbending(edges, distances, majoriser, num_iterations=num_iterations)
    for number in range(most_passes):
        positions, stress = unbend(found.positions)
        least_lowered = _LEAST_LOWERED if number < 2 else _LEAST_LOWERED_WITH_RIMS
        if stress > least_lowered * found.stress:
            break
        found = replace(found, positions=positions, stress=stress)
    return found


def unbending(
    edges: np.ndarray, distances: np.ndarray, majoriser: Majoriser, *, num_iterations: int
) -> Callable[[np.ndarray], tuple[np.ndarray, float]]:
    """Builds one pass: from `(K, 3)` positions to better ones and a stress.

    Args:
        edges: `(E, 2)` pairs of neighbours that connect all points.
        distances: `(K, K)` shortest paths over these edges, whatever the edge lengths.
        majoriser: of these distances.
        num_iterations: of majorisation.
    """

    def unbend(positions: np.ndarray) -> tuple[np.ndarray, float]:
        laid = _lengths(positions)
        along = geodesics(edges, laid[edges[:, 0], edges[:, 1]], len(laid))
        straight = distances * np.divide(laid, along, out=np.ones_like(laid), where=along > 0)
        positions = majoriser(positions, straight, num_iterations)
        return positions, majoriser.stress(positions, straight)

    return unbend


def warn_of_misfit(embedding: Embedding) -> None:
    """Warns when distances do not fit in three dimensions.

    Geodesic distances on a closed surface never fit exactly, so the fourth eigenvalue is never 0.
    A large one means shortcuts, wrong lengths, or a quotient space that is not a body.

    Warns:
        MisfitWarning: the fourth eigenvalue is above 0.15; the text gives it.
    """
    if embedding.fourth_eigenvalue > _MISFIT:
        warnings.warn(
            f"the recovered body does not fit in space: the fourth eigenvalue is "
            f"{embedding.fourth_eigenvalue:.0%} of the first, above {_MISFIT:.0%}: babble longer, "
            "or choose another metric",
            MisfitWarning,
            stacklevel=3,
        )


def _classical_axes(distances: np.ndarray, num_axes: int) -> tuple[np.ndarray, np.ndarray]:
    """`(K, num_axes)` principal coordinates, each with a fixed sign, and the spectrum."""
    squared = np.square(distances, dtype=float)
    centred = squared - squared.mean(axis=0) - squared.mean(axis=1)[:, None] + squared.mean()
    # All vectors would take twice as long.
    values = eigvalsh(-centred / 2)[::-1]
    _, vectors = eigh(-centred / 2, subset_by_index=[len(values) - num_axes, len(values) - 1])
    axes = vectors[:, ::-1] * np.sqrt(np.maximum(values[:num_axes], 0.0))
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


# Sums in vector lanes: in any order, but in the same one each time. Each pair is seen from both
# ends: to write to the other end would prevent vector lanes, and take twice as long.
@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "nsz"})
def _add_pulls(positions: np.ndarray, pull: np.ndarray, total: np.ndarray, start: int) -> None:
    """Sums the unit vectors from all other points, times `pull`, at `_ROWS` points from `start`.

    Args:
        positions: `(3, K)`.
        pull: `(K, K)`, zero on the diagonal.
        total: `(3, K)`, written.
        start: the first point.
    """
    x, y, z = positions
    for i in range(start, min(start + _ROWS, len(x))):
        sum_x = sum_y = sum_z = 0.0
        for j in range(len(x)):
            dx, dy, dz = x[i] - x[j], y[i] - y[j], z[i] - z[j]
            # Of equal points, the vector is zero.
            ratio = pull[i, j] / np.sqrt(max(dx * dx + dy * dy + dz * dz, _TINY))
            sum_x += ratio * dx
            sum_y += ratio * dy
            sum_z += ratio * dz
        total[0, i], total[1, i], total[2, i] = sum_x, sum_y, sum_z
