"""A layout of M/=_Psi in space (paper, "Topology of the representation and body shape").

"In the case where the agent touches its own body with only one finger [...] the internal
representation is equivalent, in topology, to a 3D discrete shape of the body." Kernels are laid out
so that their distances in space fit their distances along the graph.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numba
import numpy as np
from scipy.linalg import eigh, eigvalsh, inv
from scipy.spatial.distance import cdist
from threadpoolctl import threadpool_limits

from .paths import geodesics
from .threads import mapped, thread_pool

# The number of threads changes the order of sums, and with it the axes of a symmetric body.
one_thread = threadpool_limits.wrap(limits=1, user_api="blas")

#: A pass is kept if it leaves at most this share of the stress; the first that leaves more is
#: discarded and ends the search. A body whose second pass is kept has rims, and needs more passes.
_LEAST_LOWERED, _LEAST_LOWERED_WITH_RIMS = 2 / 3, 0.95

#: Iterations of majorisation in each pass.
_UNBENDING = 40

#: Stands for the square of a distance of zero.
_TINY = 1e-300

# Points that one thread pulls at once.
_ROWS = 256


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Embedding:
    """Kernels laid out in space.

    Attributes:
        positions: `(K, d)` in the unit of the distances, centred, in an arbitrary pose.
        stress: weighted squared misfit of distances, as a share: 0 is exact.
        spectrum: `(K,)` eigenvalues of classical scaling, descending, as shares of the largest.
            The fourth shows how far the distances are from fitting in three dimensions.
    """

    positions: np.ndarray
    stress: float
    spectrum: np.ndarray

    @property
    def fourth_eigenvalue(self) -> float:
        """The first eigenvalue that three dimensions leave out, as a share of the largest."""
        return float(self.spectrum[3])


class Majoriser:
    """Lowers the weighted stress of layouts: SMACOF, overrelaxed (de Leeuw and Heiser).

    Of `(K, K)` distances d, each has the weight 1 / d^2.
    """

    @one_thread
    def __init__(self, distances: np.ndarray):
        self.weights = _weights(distances)
        laplacian = np.diag(self.weights.sum(axis=1)) - self.weights
        # Adding a constant everywhere fixes the centroid and does not change the solution.
        self._inverse = inv(laplacian + self.weights.mean())

    @one_thread
    def __call__(
        self, positions: np.ndarray, distances: np.ndarray, num_iterations: int
    ) -> np.ndarray:
        """Moves `(K, d)` positions, step by step, toward `(K, K)` distances (Guttman transform)."""
        pull, dimension = self.weights * distances, positions.shape[1]
        num_used = max(dimension, 3)  # the fourth coordinate is seldom needed
        laid = np.zeros((4, len(pull)))
        laid[:dimension] = positions.T
        total = np.empty_like(laid)
        add_pulls = partial(_add_pulls, laid, pull, total)
        with thread_pool() as pool:
            for iteration in range(num_iterations):
                list(pool.map(add_pulls, range(0, len(pull), _ROWS)))
                moved = total[:num_used] @ self._inverse
                if iteration < num_iterations - 1:
                    moved = 2.0 * moved - laid[:num_used]  # overrelaxed: twice as far
                laid[:num_used] = moved
        return laid[:dimension].T


@one_thread
def classical_embedding(distances: np.ndarray, dimension: int = 3) -> Embedding:
    """Lays out points from `(K, K)` symmetric, finite distances by classical scaling."""
    axes, spectrum = _classical_axes(distances, dimension)
    return Embedding(
        positions=axes, stress=_stress(axes, distances, _weights(distances)), spectrum=spectrum
    )


@one_thread
def stress_embedding(
    distances: np.ndarray,
    dimension: int = 3,
    *,
    last_axes: Sequence[int] = (0, 1, 2, 3),
    num_trial_iterations: int = 30,
    num_iterations: int = 100,
    majoriser: Majoriser | None = None,
) -> Embedding:
    """Lays out points by weighted stress, `sum((d_ij - |x_i - x_j|)^2 / d_ij^2)`, by majorisation.

    Weights of 1 / d^2 give near neighbours as much influence as far ones: geodesic distances are
    accurate nearby and too long far away. Stress has many local minima (a ring's third axis may be
    the second harmonic of the ring), so several classical axes are tried as the last one, and only
    the layout with the lowest stress is iterated to the end.

    Args:
        distances: `(K, K)` symmetric, finite, positive off the diagonal.
        dimension: of the layout, 2, 3 or 4.
        last_axes: which of the further classical axes are tried as the last one to start from.
        num_trial_iterations: for each start.
        num_iterations: for the best start.
        majoriser: of these distances.

    Raises:
        ValueError: there are fewer than 4 points, or no path joins two of them.
    """
    if len(distances) < 4:
        raise ValueError(
            f"num_targets is {len(distances)}: give at least 4, to lay out a body in space"
        )
    if not np.isfinite(distances).all():
        raise ValueError("distances are infinite where no path exists: connect the graph first")
    first = list(range(dimension - 1))
    num_axes = min(dimension + max(last_axes), len(distances))
    axes, spectrum = _classical_axes(distances, num_axes)
    majoriser = majoriser or Majoriser(distances)
    trials = mapped(
        lambda last: majoriser(axes[:, [*first, last]], distances, num_trial_iterations),
        [dimension - 1 + last for last in last_axes if dimension - 1 + last < num_axes],
    )
    best = min(trials, key=lambda positions: _stress(positions, distances, majoriser.weights))
    positions = majoriser(best, distances, num_iterations)
    return Embedding(
        positions=positions,
        stress=_stress(positions, distances, majoriser.weights),
        spectrum=spectrum,
    )


@one_thread
def curvature_corrected_mds(
    edges: np.ndarray,
    distances: np.ndarray,
    dimension: int = 3,
    *,
    most_passes: int = 5,
) -> Embedding:
    """Lays out points by stress, then corrects for the curvature of the body.

    Geodesics along a body are longer than straight lines. Each pass measures the ratio on the
    current layout, shortens the distances by it, and lays out again. This also amplifies errors of
    the distances, so the passes end when one of the first two does not lower the stress by a third.
    Bodies with rims need more: further passes go on while the stress falls. Without passes, it is
    the layout of `stress_embedding`.

    The `(K, K)` distances are shortest paths over `(E, 2)` edges that connect all points, whatever
    the edge lengths.
    """
    majoriser = Majoriser(distances)
    found = stress_embedding(distances, dimension=dimension, majoriser=majoriser)
    for number in range(most_passes):
        positions, stress = unbent(found.positions, edges, distances, majoriser, _UNBENDING)
        least_lowered = _LEAST_LOWERED if number < 2 else _LEAST_LOWERED_WITH_RIMS
        if stress > least_lowered * found.stress:
            break
        found = replace(found, positions=positions, stress=stress)
    return found


def unbent(
    positions: np.ndarray,
    edges: np.ndarray,
    distances: np.ndarray,
    majoriser: Majoriser,
    num_iterations: int,
) -> tuple[np.ndarray, float]:
    """One pass of `curvature_corrected_mds`: from `(K, d)` positions to better ones, and stress."""
    laid = cdist(positions, positions)
    along = geodesics(edges, laid[edges[:, 0], edges[:, 1]], len(laid))
    straight = distances * np.divide(laid, along, out=np.ones_like(laid), where=along > 0)
    positions = majoriser(positions, straight, num_iterations)
    return positions, _stress(positions, straight, majoriser.weights)


def _classical_axes(distances: np.ndarray, num_axes: int) -> tuple[np.ndarray, np.ndarray]:
    """`(K, num_axes)` principal coordinates, each with a fixed sign, and the spectrum."""
    squared = np.square(distances, dtype=float)
    centred = squared - squared.mean(axis=0) - squared.mean(axis=1)[:, None] + squared.mean()
    # Only the vectors that are used: all of them would take twice as long.
    values = eigvalsh(-centred / 2)[::-1]
    _, vectors = eigh(-centred / 2, subset_by_index=[len(values) - num_axes, len(values) - 1])
    axes = vectors[:, ::-1] * np.sqrt(np.maximum(values[:num_axes], 0.0))
    largest = np.abs(axes).argmax(axis=0)
    return axes * np.sign(axes[largest, np.arange(num_axes)]), values / values[0]


def _weights(distances: np.ndarray) -> np.ndarray:
    weights = np.zeros(distances.shape)
    np.divide(1.0, np.square(distances, dtype=float), out=weights, where=distances > 0)
    return weights


def _stress(positions: np.ndarray, distances: np.ndarray, weights: np.ndarray) -> float:
    """Weighted squared misfit over weighted squared distance, at the best common scale."""
    laid = cdist(positions, positions)
    cross, norm = np.sum(weights * laid * distances), np.sum(weights * laid**2)
    return float(1.0 - cross**2 / (norm * np.sum(weights * np.square(distances))))


# Sums in vector lanes: in any order, but in the same one each time. Each pair is seen from both
# ends: to write to the other end would prevent vector lanes, and take twice as long.
@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "nsz"})
def _add_pulls(positions: np.ndarray, pull: np.ndarray, total: np.ndarray, start: int) -> None:
    """Sums the unit vectors from all other points, times `pull`, at `_ROWS` points from `start`.

    Positions are `(4, K)`; coordinates that a layout lacks are 0. The `(K, K)` pull is 0 on the
    diagonal; `(4, K)` total is written.
    """
    x, y, z, w = positions
    for i in range(start, min(start + _ROWS, len(x))):
        sum_x = sum_y = sum_z = sum_w = 0.0
        for j in range(len(x)):
            dx, dy, dz, dw = x[i] - x[j], y[i] - y[j], z[i] - z[j], w[i] - w[j]
            # The vector between equal points is zero, and so is its pull.
            ratio = pull[i, j] / np.sqrt(max(dx * dx + dy * dy + dz * dz + dw * dw, _TINY))
            sum_x += ratio * dx
            sum_y += ratio * dy
            sum_z += ratio * dz
            sum_w += ratio * dw
        total[0, i], total[1, i], total[2, i], total[3, i] = sum_x, sum_y, sum_z, sum_w
