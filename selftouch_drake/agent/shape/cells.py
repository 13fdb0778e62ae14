"""Distances between cells of one size: kernel sets in the coordinates of a quotient map.

Target sensations are evenly spaced, so that all cells are equally wide in sensation. How wide they
come out in other coordinates tells what a step in these coordinates is worth there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Skin is a surface: cells are wide in two directions, and thin across. Measured on the torus, the
#: third width of a cell is a fifth of its second.
_DIMENSION = 2

#: Share of a cell's configurations that are left out as strays, those farthest from its middle.
_STRAYS = 0.1

#: A cell's own covariance counts as its configurations, the mean of all as this many.
_PRIOR = 20

#: Added to a cell's width across, as a share of its second width (both squared): neighbours that
#: lie off the tangent plane, as the surface bends, are near all the same.
_ACROSS = 0.1

#: Rad, the largest angle between a neighbour and the tangent plane that is made good as bending.
_MOST_BENT = 1.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Where kernel sets lie in quotient coordinates, and how wide they are.

    Attributes:
        mean: `(K, D)` middle of each cell.
        covariance: `(K, D, D)` within each cell.
        tangent: `(K, D, 2)` orthonormal, the two directions in which each cell is widest.
        second: `(K,)` variance in the second of these.
        area: `(K,)` product of the standard deviations in both.
    """

    mean: np.ndarray
    covariance: np.ndarray
    tangent: np.ndarray
    second: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, coordinates: np.ndarray, offsets: np.ndarray) -> Cells:
        """Measures the cells of `(R, D)` coordinates grouped by kernel, strays left out."""
        groups = np.split(coordinates, offsets[1:-1])
        pooled = np.mean([np.atleast_2d(np.cov(g.T, bias=True)) for g in groups], axis=0)
        pooled += 1e-9 * np.trace(pooled) * np.eye(len(pooled))
        mean, covariance = (
            np.array(part)
            for part in zip(*[_without_strays(g, pooled) for g in groups], strict=True)
        )
        variance, directions = np.linalg.eigh(covariance)
        return cls(
            mean=mean,
            covariance=covariance,
            tangent=directions[:, :, -_DIMENSION:],
            second=variance[:, -_DIMENSION],
            area=np.sqrt(variance[:, -_DIMENSION:].prod(axis=1)),
        )

    def distances(self) -> np.ndarray:
        """`(K, K)` in widths of the cells: root mean square of there and back."""
        num_coordinates = self.mean.shape[1]
        thick = self.covariance + (_ACROSS * self.second)[:, None, None] * np.eye(num_coordinates)
        apart = self.mean[None] - self.mean[:, None]
        squared = np.einsum("klj,klj->kl", apart @ np.linalg.inv(thick), apart)
        return np.sqrt((squared + squared.T) / 2)

    def lengths(self, edges: np.ndarray) -> np.ndarray:
        """`(E,)` lengths along the surface, in widths of the cells at both ends: means of both."""
        i, j = edges.T
        return (self._directed(i, j) + self._directed(j, i)) / 2

    def _directed(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """The step seen from `start`: along its tangent plane, stretched by what it bends off."""
        tangent, step = self.tangent[start], self.mean[end] - self.mean[start]
        both = (self.covariance[start] + self.covariance[end]) / 2
        along = np.einsum("edt,ed->et", tangent, step)
        width = np.einsum("edt,edf,efu->etu", tangent, both, tangent)
        solved = np.linalg.solve(width, along[..., None])[..., 0]
        length = np.sqrt(np.einsum("et,et->e", along, solved))
        # The chord of an arc of angle 2 a leaves the tangent by a: arc / projection = 2a / sin 2a.
        across = np.linalg.norm(step - np.einsum("edt,et->ed", tangent, along), axis=1)
        bent = np.minimum(np.arctan2(across, np.linalg.norm(along, axis=1)), _MOST_BENT)
        return length / np.sinc(2.0 * bent / np.pi)


def _without_strays(points: np.ndarray, pooled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a cell's `(n, D)` coordinates, twice cleared of strays."""

    def moments(kept: np.ndarray) -> np.ndarray:
        own = np.cov(kept.T, bias=True) if len(kept) > 1 else np.zeros_like(pooled)
        return (len(kept) * own + _PRIOR * pooled) / (len(kept) + _PRIOR)

    middle, covariance = np.median(points, axis=0), moments(points)
    for _ in range(2):
        apart = points - middle
        squared = np.einsum("nd,nd->n", apart @ np.linalg.inv(covariance), apart)
        kept = points[squared <= np.quantile(squared, 1.0 - _STRAYS)]
        middle, covariance = kept.mean(axis=0), moments(kept)
    return middle, covariance
