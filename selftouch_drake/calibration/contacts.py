"""Where a ball at the tip of a robot touches a skin, by a kinematic model and joint offsets."""

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

from selftouch_drake.robot.kinematics import Kinematics

#: Touches around each one through which a quadric goes, which has six coefficients.
_AROUND = 14


@dataclass(frozen=True, eq=False)
class ModelledTouches:
    """n touches of a skin by a ball.

    Attributes:
        kinematics: of the frame of the link that wears the skin, L, of the ball's, and of one
            behind the ball, on the robot that carries it: the skin is on the other side.
        columns: `(J,)` the joints among those of the kinematics; others stay at 0.
        q: `(n, J)` rad or m, as the joints were read.
        radius: m, of the ball.
        force: `(n,)` sum of the readings, in any unit.
        near: `(J,)` offsets at which it is looked which touches are neighbours.
    """

    kinematics: Kinematics
    columns: np.ndarray
    q: np.ndarray
    radius: float
    force: np.ndarray
    near: np.ndarray

    def _in_link(self, offsets: np.ndarray) -> np.ndarray:
        """`(2, n, 3)` m, the ball and what is behind it, in L; offsets are added to q."""
        q = np.zeros((len(self.q), len(self.kinematics.turns)))
        q[:, self.columns] = self.q + offsets
        X_WL, *others = self.kinematics.poses(q).swapaxes(0, 1)
        p_W = np.stack([X[:, :, 3] for X in others]) - X_WL[:, :, 3]
        return np.einsum("nji,anj->ani", X_WL[:, :, :3], p_W)

    @cached_property
    def _around(self) -> tuple[np.ndarray, np.ndarray]:
        """`(n, k)` the touches around each one, and `(n, 3)` roughly the outward normal."""
        centres, behind = self._in_link(self.near)
        around = cKDTree(centres).query(centres, min(_AROUND, len(centres)))[1]
        normals = self._normals(centres, around, behind - centres)
        # From one touch to the next, over the neighbours whose normals agree best (Hoppe 1992).
        near, far = np.repeat(np.arange(len(around)), around.shape[1]), around.ravel()
        alike = np.einsum("ex,ex->e", normals[near], normals[far])
        apart = csr_array((1.0 + 1e-6 - np.abs(alike), (near, far)), shape=(len(around),) * 2)
        tree = minimum_spanning_tree(apart)
        piece = connected_components(tree, directed=False)[1]
        sides = np.einsum("nx,nx->n", normals, behind - centres)
        for number in range(piece.max() + 1):
            inside = np.flatnonzero(piece == number)
            order, before = breadth_first_order(tree, inside[0], directed=False)
            for n in order[1:]:
                if normals[n] @ normals[before[n]] < 0:
                    normals[n], sides[n] = -normals[n], -sides[n]
            normals[inside] *= 1.0 if np.sign(sides[inside]).sum() >= 0 else -1.0
        return around, normals

    def on_skin(self, offsets: np.ndarray, softness: float) -> tuple[np.ndarray, np.ndarray]:
        """Places touched and outward normals, `(n, 3)` m and `(n, 3)`, in L.

        A ball sinks into a soft skin by the softness times the root of the force.
        """
        around, outward = self._around
        centres, _ = self._in_link(offsets)
        normals = self._normals(centres, around, outward)
        sunk = softness * np.sqrt(self.force / np.median(self.force))
        return centres - (self.radius - sunk)[:, None] * normals, normals

    def _normals(self, centres: np.ndarray, around: np.ndarray, outward: np.ndarray) -> np.ndarray:
        """Normals `(n, 3)` of quadrics through the centres around each, on the outward side."""
        near = centres[around] - centres[:, None]
        spread = near - near.mean(axis=1, keepdims=True)
        axes = np.linalg.svd(spread, full_matrices=False)[2]
        x, y, z = np.einsum("nkx,nax->ank", near, axes)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
        size = np.abs(terms).max(axis=1, keepdims=True) + 1e-12
        fit = np.linalg.pinv(terms / size, rcond=1e-6) @ z[..., None] / size.swapaxes(1, 2)
        slope = np.stack([-fit[:, 1, 0], -fit[:, 2, 0], np.ones(len(fit))], axis=-1)
        normals = np.einsum("na,nax->nx", slope, axes)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        side = np.sign(np.einsum("nx,nx->n", normals, outward))
        return normals * np.where(side == 0, 1.0, side)[:, None]
