"""Distances between kernel sets in quotient coordinates, measured in cell widths.

Target sensations are evenly spaced, so all cells are equally wide in sensation. The width of a cell
in other coordinates is therefore the local unit of length there.

Where receptors are missing, a wide stretch of skin feels alike and becomes one kernel. That leaves
a gap in the layout, and a false loop around it. But a quotient map is smooth, and separates the
motor configurations within such a kernel: wide cells are cut into pieces.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from selftouch_drake.agent.clusters import clusters
from selftouch_drake.agent.shape.rings import one_ring
from selftouch_drake.quotient.graph import neighbour_edges
from selftouch_drake.quotient.kernels import KernelSets

#: Share of a cell's configurations that are dropped as outliers: those farthest from its centre.
_STRAYS = 0.1

#: Weight of the pooled covariance, in configurations, when a cell's own is shrunk towards it.
_PRIOR = 20

#: Variance added to a cell in all directions, as a share of the smallest along the skin: on a bent
#: surface, neighbours off the tangent plane are still near.
_ACROSS = 0.1

#: Rad, largest angle between a neighbour and the tangent plane that is corrected as curvature.
_MOST_BENT = 1.2

#: Largest area of a piece, over the area of the cells around it. Cut from 1.5 times that area on,
#: not from twice, worn tori have wider margins.
_LARGEST = 0.75

#: Fewest configurations per piece, on average: its width cannot be measured with fewer.
_LEAST_SIZE = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Means and widths of kernel sets in quotient coordinates.

    A cell is wide in as many directions as the skin has, d, and thin in all others: on a torus, the
    third width is a fifth of the second.

    Attributes:
        mean: `(K, D)` mean of each cell.
        covariance: `(K, D, D)` covariance within each cell.
        tangent: `(K, D, d)` orthonormal, the directions in which each cell is widest.
        least: `(K,)` variance in the last of these.
        area: `(K,)` product of the standard deviations in all of them.
    """

    mean: np.ndarray
    covariance: np.ndarray
    tangent: np.ndarray
    least: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, sets: KernelSets, skin: int = 2) -> "Cells":
        """Measures the cells of K sets in quotient coordinates, without outliers."""
        groups = np.split(np.asarray(sets.x, dtype=float), sets.offsets[1:-1])
        scatters = [_scatter(group, group.mean(axis=0)) / len(group) for group in groups]
        pooled = np.mean(scatters, axis=0)
        pooled += 1e-9 * np.trace(pooled) * np.eye(len(pooled))
        measured = [_moments(group, pooled) for group in groups]
        mean, covariance = (np.array(part) for part in zip(*measured, strict=True))
        variance, directions = np.linalg.eigh(covariance)
        return cls(
            mean=mean,
            covariance=covariance,
            tangent=directions[:, :, -skin:],
            least=variance[:, -skin],
            area=np.sqrt(variance[:, -skin:].prod(axis=1)),
        )

    def distances(self) -> np.ndarray:
        """`(K, K)` in cell widths: root mean square of the distances seen from either cell."""
        num_cells, num_coordinates = self.mean.shape
        thick = self.covariance + (_ACROSS * self.least)[:, None, None] * np.eye(num_coordinates)
        inverse = np.linalg.inv(thick)
        # (x_l - x_k) A_k (x_l - x_k), multiplied out: as two matrix products over all pairs.
        x = self.mean - self.mean.mean(axis=0)
        pairs = (x[:, :, None] * x[:, None]).reshape(num_cells, -1)
        of_start = np.einsum("kde,ke->kd", inverse, x)
        squared = inverse.reshape(num_cells, -1) @ pairs.T - 2.0 * of_start @ x.T
        squared += np.einsum("kd,kd->k", of_start, x)[:, None]
        return np.sqrt(np.maximum(squared + squared.T, 0.0) / 2)

    def lengths(self, edges: np.ndarray) -> np.ndarray:
        """`(E,)` lengths along the surface in cell widths, averaged over both ends of an edge."""
        i, j = edges.T
        return (self._directed(i, j) + self._directed(j, i)) / 2

    def _directed(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Edge lengths seen from `start`: in its tangent plane, corrected for curvature."""
        tangent, step = self.tangent[start], self.mean[end] - self.mean[start]
        both = (self.covariance[start] + self.covariance[end]) / 2
        along = np.einsum("edt,ed->et", tangent, step)
        width = np.einsum("edt,edf,efu->etu", tangent, both, tangent)
        solved = np.linalg.solve(width, along[..., None])[..., 0]
        length = np.sqrt(np.einsum("et,et->e", along, solved))
        # The chord of an arc of angle 2a is at angle a to the tangent: arc / projection is
        # 2a / sin 2a.
        across = np.linalg.norm(step - np.einsum("edt,et->ed", tangent, along), axis=1)
        bent = np.minimum(np.arctan2(across, np.linalg.norm(along, axis=1)), _MOST_BENT)
        return length / np.sinc(2.0 * bent / np.pi)


def _moments(points: np.ndarray, pooled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a cell's `(n, D)` coordinates, after dropping outliers twice.

    The covariance is shrunk towards the pooled one.
    """

    def shrunk(kept: np.ndarray, mean: np.ndarray) -> np.ndarray:
        return (_scatter(kept, mean) + _PRIOR * pooled) / (len(kept) + _PRIOR)

    last = int((1.0 - _STRAYS) * (len(points) - 1))
    middle = np.median(points, axis=0)
    covariance = shrunk(points, points.mean(axis=0))
    for _ in range(2):
        apart = points - middle
        squared = np.einsum("nd,nd->n", apart @ np.linalg.inv(covariance), apart)
        kept = points[squared <= np.partition(squared, last)[last]]
        middle = kept.mean(axis=0)
        covariance = shrunk(kept, middle)
    return middle, covariance


def _scatter(points: np.ndarray, mean: np.ndarray) -> np.ndarray:
    apart = points - mean
    return apart.T @ apart


def cut_wide_cells(sets: KernelSets, cells: "Cells") -> tuple[KernelSets, np.ndarray]:
    """Cuts each cell at least 1.5 times as large as those around it into pieces.

    k-means in the cell's own tangent plane finds the pieces. Returns the same coordinates as P
    sets, one for each piece, and `(P,)` the kernel of each piece, ascending.
    """
    sizes = sets.sizes
    # The median area of each cell and of two rings of neighbours.
    ring = one_ring(neighbour_edges(cells.distances()), len(sizes))
    rings = (ring @ ring).tocsr()
    ends = pairwise(rings.indptr.tolist())
    typical = np.array([np.median(cells.area[rings.indices[slice(*pair)]]) for pair in ends])
    number = np.minimum((cells.area / typical / _LARGEST).astype(int), sizes // _LEAST_SIZE)
    if number.max() < 2:
        return sets, np.arange(len(sizes))
    piece = np.zeros(len(sets.x), dtype=int)
    for kernel in np.flatnonzero(number > 1).tolist():
        along = (sets.configurations(kernel) - cells.mean[kernel]) @ cells.tangent[kernel]
        rows = slice(*sets.offsets[kernel : kernel + 2])
        piece[rows] = clusters(along, number[kernel])
    owner = sets.kernel
    order = np.lexsort((piece, owner))
    first = np.flatnonzero(np.diff(owner, prepend=-1) | np.diff(piece[order], prepend=-1))
    return KernelSets(sets.x[order], np.append(first, len(order))), owner[first]
