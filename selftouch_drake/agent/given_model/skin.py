"""Where a ball at the end of a way touches a skin, and how the skin lies there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    minimum_spanning_tree,
)
from scipy.spatial import cKDTree

from selftouch_drake.agent.given_model.way import GivenWay

#: Touches around each one through which a quadric goes, which has six coefficients.
_AROUND = 14
# Damping of a quadric, relative to its terms, which are at most 1.
_DAMPING = 1e-8


@dataclass(frozen=True, eq=False)
class TouchedSkin:
    """n touches of a skin by a ball.

    Attributes:
        q: `(n, L)` rad or m, as the joints of the way were read.
        radius: m, of the ball.
        force: `(n,)` sum of the readings, in any unit.
        near: the way at which it is looked which touches are neighbours.
    """

    q: np.ndarray
    radius: float
    force: np.ndarray
    near: GivenWay

    @cached_property
    def _around(self) -> tuple[np.ndarray, np.ndarray]:
        """`(n, k)` the touches around each one, and `(n, 3)` roughly the outward normal."""
        centres = self.near.places(self.q)
        away = self.near.behind(self.q, 2.0 * self.radius) - centres
        around = cKDTree(centres).query(centres, min(_AROUND, len(centres)))[1]
        normals = _normals(centres, around, away)
        # From one touch to the next, over the neighbours whose normals agree best (Hoppe 1992).
        near, far = np.repeat(np.arange(len(around)), around.shape[1]), around.ravel()
        alike = np.einsum("ex,ex->e", normals[near], normals[far])
        apart = csr_array((1.0 + 1e-6 - np.abs(alike), (near, far)), shape=(len(around),) * 2)
        tree = minimum_spanning_tree(apart)
        piece = connected_components(tree, directed=False)[1]
        sides = np.einsum("nx,nx->n", normals, away)
        for number in range(piece.max() + 1):
            inside = np.flatnonzero(piece == number)
            order, before = breadth_first_order(tree, inside[0], directed=False)
            for n in order[1:]:
                if normals[n] @ normals[before[n]] < 0:
                    normals[n], sides[n] = -normals[n], -sides[n]
            normals[inside] *= 1.0 if np.sign(sides[inside]).sum() >= 0 else -1.0
        return around, normals

    def touched(self, way: GivenWay, softness: float) -> tuple[np.ndarray, np.ndarray]:
        """Places touched and outward normals, `(n, 3)` m and `(n, 3)`, in the skin's link.

        A ball sinks into a soft skin by the softness times the root of the force.
        """
        around, outward = self._around
        centres = way.places(self.q)
        normals = _normals(centres, around, outward)
        sunk = softness * np.sqrt(self.force / np.median(self.force))
        return centres - (self.radius - sunk)[:, None] * normals, normals


def _normals(centres: np.ndarray, around: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """Normals `(n, 3)` of quadrics through the centres around each, on the outward side."""
    near = centres[around] - centres[:, None]
    spread = near - near.mean(axis=1, keepdims=True)
    # Columns: the widest axis first.
    axes = np.linalg.eigh(spread.swapaxes(1, 2) @ spread)[1][:, :, ::-1]
    x, y, z = np.moveaxis(near @ axes, 2, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    size = np.abs(terms).max(axis=1, keepdims=True) + 1e-12
    scaled = terms / size
    square = scaled.swapaxes(1, 2) @ scaled + _DAMPING * np.eye(6)
    fit = np.linalg.solve(square, scaled.swapaxes(1, 2) @ z[..., None]) / size.swapaxes(1, 2)
    slope = np.stack([-fit[:, 1, 0], -fit[:, 2, 0], np.ones(len(fit))], axis=-1)
    normals = np.einsum("na,nxa->nx", slope, axes)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    side = np.sign(np.einsum("nx,nx->n", normals, outward))
    return normals * np.where(side == 0, 1.0, side)[:, None]
