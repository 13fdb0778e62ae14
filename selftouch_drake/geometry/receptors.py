"""Receptors spread evenly over a surface, and their overlapping receptive fields."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.geometry.geodesics import surface_paths
from selftouch_drake.lazy import trimesh

FEWEST_RECEPTORS, MOST_RECEPTORS = 4, 1000

# Every point of the skin is felt by at least this number of receptors.
OVERLAP = 3

# Fields reach beyond the distance from the worst point to its third receptor, so that it feels it.
FIELD_MARGIN = 1.15

# m, edge length at which fields are sampled, and fewest edges between neighbouring receptors: dense
# receptors need shorter edges.
FIELD_RESOLUTION = 0.012
EDGES_BETWEEN_RECEPTORS = 4


@dataclass(frozen=True, kw_only=True)
class ReceptiveFields:
    """Overlapping receptive fields of S receptors, measured along a surface.

    At each point of the surface the weights of all receptors sum to one, so distributing a force
    over the receptors conserves it.

    Attributes:
        p_LS: `(S, 3)` m, receptors in the link's frame L.
        vertices: `(V, 3)` m, of the surface on which the fields are sampled.
        faces: `(F, 3)` indices into `vertices`.
        vertex_weights: `(V, S)` sparse, the share of each receptor at each vertex.
        radius: m, distance along the surface at which a field ends.
    """

    p_LS: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    vertex_weights: csr_matrix
    radius: float

    @property
    def num_receptors(self) -> int:
        """S, the length of a sensation."""
        return len(self.p_LS)

    def weights_at(self, p_LQ: np.ndarray) -> csr_matrix:
        """Returns `(N, S)` sparse: the share of each receptor in a force at each point.

        A point in the wall of the skin counts as the nearest point of the surface.

        Args:
            p_LQ: `(N, 3)` m, points in the skin, in the link's frame L.
        """
        vertices, parts = self.parts_at(p_LQ)
        ends = np.arange(0, parts.size + 1, 3, dtype=np.int32)
        shape = len(parts), len(self.vertices)
        return csr_matrix((parts.ravel(), vertices.ravel(), ends), shape) @ self.vertex_weights

    def parts_at(self, p_LQ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(N, 3)` the vertices of the nearest triangle, and `(N, 3)` barycentric weights there.

        Args:
            p_LQ: `(N, 3)` m, points in the skin, in the link's frame L.
        """
        p_LQ = np.asarray(p_LQ, dtype=float)
        _, face = self._centroids.query(p_LQ)
        parts = np.einsum("nij,nj->ni", self.barycentric[face, :, :3], p_LQ)
        parts += self.barycentric[face, :, 3]
        np.maximum(parts, 0, out=parts)
        parts /= parts.sum(axis=1, keepdims=True)
        return self.faces[face], parts

    @cached_property
    def _centroids(self) -> cKDTree:
        # Larger leaves than scipy's 16 save a fifth of the time on points inside a wall.
        return cKDTree(self.vertices[self.faces].mean(axis=1), leafsize=32)

    @cached_property
    def barycentric(self) -> np.ndarray:
        """`(F, 3, 4)` weights of the corners of each triangle, linear in a point.

        The gradient in the triangle's plane, 1/m, and the weight at the link's origin.
        """
        corners = self.vertices[self.faces]
        a, b, c = corners.swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        opposite = np.stack([c - b, a - c, b - a], axis=1)
        area = np.einsum("fi,fi->f", normal, normal)[:, None, None]
        gradients = np.cross(normal[:, None], opposite) / area
        offsets = 1 / 3 - np.einsum("fij,fj->fi", gradients, corners.mean(axis=1))
        return np.concatenate([gradients, offsets[:, :, None]], axis=2)


def place_receptors(
    surface: trimesh.Trimesh, num_receptors: int, seed: int, *, unevenness: float = 0.0
) -> np.ndarray:
    """Spreads receptors evenly: each at the vertex farthest, along the surface, from earlier ones.

    For an uneven layout, distances count less towards one side of the surface.

    Args:
        surface: Closed outer surface in the link's frame L, m.
        num_receptors: 4 to 1000.
        seed: Chooses the first vertex, and the side where receptors are few.
        unevenness: 0 to below 1; at u, receptors there are 1 / (1 - u) times as far apart as on
            the other side.

    Returns:
        `p_LS`: `(num_receptors, 3)` m, in the link's frame L.

    Raises:
        ValueError: If `num_receptors` is out of range, or more than the surface has vertices.
    """
    if not FEWEST_RECEPTORS <= num_receptors <= MOST_RECEPTORS:
        raise ValueError(
            f"num_receptors is {num_receptors}; give {FEWEST_RECEPTORS} to {MOST_RECEPTORS}"
        )
    surface = _refined(surface, num_receptors)
    paths = surface_paths(surface)
    nearest = np.full(len(surface.vertices), np.inf)

    def distance_from(vertex: int) -> np.ndarray:
        # Longer distances than the largest one left change nothing: the search ends there.
        found = dijkstra(paths, indices=vertex, limit=nearest.max())
        return np.minimum(nearest, found, out=nearest)

    along = surface.vertices @ np.random.default_rng([seed, 1]).standard_normal(3)
    receptors = farthest_points(
        distance_from,
        num_receptors,
        first=int(np.random.default_rng(seed).integers(len(surface.vertices))),
        # From 1 on one side of the surface to `1 - unevenness` on the other.
        weight=1 - unevenness * (along - along.min()) / np.ptp(along),
    )
    return surface.vertices[receptors]


def receptive_fields(
    surface: trimesh.Trimesh, p_LS: np.ndarray, *, width: float = 1.0
) -> ReceptiveFields:
    """Gives each receptor a smooth round field, wide enough that three overlap everywhere.

    The field of a receptor is centred on the nearest vertex of the surface.

    Args:
        surface: Closed outer surface in the link's frame L, m.
        p_LS: `(S, 3)` m, receptors on the surface.
        width: Radius of the fields, as a multiple of this smallest radius.
    """
    surface = _refined(surface, len(p_LS))
    _, nearest = cKDTree(surface.vertices).query(p_LS)
    paths = surface_paths(surface)
    reach = 3 * math.sqrt(surface.area / len(p_LS))
    distance = dijkstra(paths, indices=nearest, limit=reach)
    farthest = np.partition(distance, OVERLAP - 1, axis=0)[OVERLAP - 1].max()
    if width * FIELD_MARGIN * farthest > reach:
        distance = dijkstra(paths, indices=nearest)
        farthest = np.partition(distance, OVERLAP - 1, axis=0)[OVERLAP - 1].max()
    radius = width * FIELD_MARGIN * farthest
    # In place: for a thousand receptors, one such table takes a few hundred megabytes.
    bump = np.square(np.divide(distance, radius, out=distance), out=distance)
    np.square(np.maximum(np.subtract(1, bump, out=bump), 0, out=bump), out=bump)
    vertex_weights = csr_matrix(bump.T)
    vertex_weights.data /= np.repeat(bump.T.sum(axis=1), np.diff(vertex_weights.indptr))
    return ReceptiveFields(
        p_LS=surface.vertices[nearest],
        vertices=np.array(surface.vertices),
        faces=np.array(surface.faces, dtype=np.int32),
        vertex_weights=vertex_weights,
        radius=float(radius),
    )


def _refined(surface: trimesh.Trimesh, num_receptors: int) -> trimesh.Trimesh:
    """Refines the triangles of a surface enough for fields; its vertices stay, and come first."""
    spacing = math.sqrt(surface.area / num_receptors)
    resolution = min(FIELD_RESOLUTION, spacing / EDGES_BETWEEN_RECEPTORS)
    mean_edge = surface.edges_unique_length.mean()
    halvings = max(round(math.log2(mean_edge / resolution)), 0)
    return surface.subdivide(iterations=halvings) if halvings else surface
