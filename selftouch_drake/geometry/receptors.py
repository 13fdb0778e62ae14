"""Receptors spread evenly over a surface, and the overlapping fields over which they feel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
import trimesh
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

FEWEST_RECEPTORS, MOST_RECEPTORS = 20, 200

# Every point of the skin is felt by at least so many receptors.
OVERLAP = 3

# The field reaches beyond the worst point's third receptor, so that this one does feel it.
FIELD_MARGIN = 1.15

# Edge length at which fields are sampled: a sixth or less of the distance between receptors.
FIELD_RESOLUTION = 0.012

# Sine of the angle at which a chord between two vertices may leave their tangent planes and still
# stand for the path on the surface: a smooth bend costs 1 % of length there, a sharp edge is
# never cut.
CHORD_SLOPE = 0.25


@dataclass(frozen=True, kw_only=True)
class ReceptiveFields:
    """Overlapping receptive fields of S receptors, measured along a surface.

    At each point of the surface the weights of all receptors sum to one: a force that is spread
    by them over the receptors is conserved.

    Attributes:
        p_BS: `(S, 3)` m, receptors in the body's frame.
        vertices: `(V, 3)` m, of the surface on which the fields are sampled.
        faces: `(F, 3)` indices into `vertices`.
        vertex_weights: `(V, S)` sparse rows, the share of each receptor at each vertex.
        radius: m, distance along the surface at which a field ends.
    """

    p_BS: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    vertex_weights: csr_matrix
    radius: float

    @property
    def num_receptors(self) -> int:
        """S, the length of a sensation."""
        return len(self.p_BS)

    def weights_at(self, p_BQ: np.ndarray) -> csr_matrix:
        """Returns `(N, S)` sparse rows: the share of each receptor in what is felt at each point.

        A point in the wall of the skin is felt where it is nearest to the surface.

        Args:
            p_BQ: `(N, 3)` m, points in the skin, in the body's frame.
        """
        return self.interpolation_at(p_BQ) @ self.vertex_weights

    def interpolation_at(self, p_BQ: np.ndarray) -> csr_matrix:
        """Returns `(N, V)` sparse rows: barycentric weights of the nearest triangle's vertices.

        Args:
            p_BQ: `(N, 3)` m, points in the skin, in the body's frame.
        """
        p_BQ = np.asarray(p_BQ, dtype=float)
        num_points = len(p_BQ)
        _, face = self._centroids.query(p_BQ)
        barycentric = np.einsum("nij,nj->ni", self._gradients[face], p_BQ)
        barycentric += self._offsets[face]
        np.maximum(barycentric, 0, out=barycentric)
        barycentric /= barycentric.sum(axis=1, keepdims=True)
        ends = np.arange(0, 3 * num_points + 1, 3, dtype=np.int32)
        return csr_matrix(
            (barycentric.ravel(), self.faces[face].ravel(), ends),
            shape=(num_points, len(self.vertices)),
        )

    @cached_property
    def _centroids(self) -> cKDTree:
        # Larger leaves than scipy's 16 save a fifth of the time on points inside a wall.
        return cKDTree(self.vertices[self.faces].mean(axis=1), leafsize=32)

    @cached_property
    def _gradients(self) -> np.ndarray:
        """`(F, 3, 3)` 1/m, gradient of each barycentric coordinate in the triangle's plane."""
        a, b, c = self.vertices[self.faces].swapaxes(0, 1)
        normal = np.cross(b - a, c - a)
        opposite = np.stack([c - b, a - c, b - a], axis=1)
        area = np.einsum("fi,fi->f", normal, normal)[:, None, None]
        return np.cross(normal[:, None], opposite) / area

    @cached_property
    def _offsets(self) -> np.ndarray:
        """`(F, 3)` barycentric coordinates that the gradients give the body's origin."""
        centroids = self.vertices[self.faces].mean(axis=1)
        return 1 / 3 - np.einsum("fij,fj->fi", self._gradients, centroids)


def place_receptors(
    surface: trimesh.Trimesh, num_receptors: int, seed: int, *, unevenness: float = 0.0
) -> np.ndarray:
    """Spreads receptors evenly: each sits at the vertex farthest, on the surface, from all before.

    An uneven layout takes distances for shorter the farther they lie to one side of the body.

    Args:
        surface: Closed outer surface in the body's frame, m.
        num_receptors: 20 to 200.
        seed: Chooses the first vertex, and the side where receptors are few.
        unevenness: 0 to below 1; at u they are 1 / (1 - u) times as far apart there as on the
            other side.

    Returns:
        `p_BS`: `(num_receptors, 3)` m, in the body's frame.

    Raises:
        ValueError: If `num_receptors` is out of range, or more than the surface has vertices.
    """
    if not FEWEST_RECEPTORS <= num_receptors <= MOST_RECEPTORS:
        raise ValueError(
            f"skin.num_receptors is {num_receptors}; give {FEWEST_RECEPTORS} to {MOST_RECEPTORS}"
        )
    surface = _refined(surface)
    paths = surface_paths(surface)
    vertex = np.random.default_rng(seed).integers(len(surface.vertices))
    distance = np.full(len(surface.vertices), np.inf)
    crowding = _crowding(surface.vertices, unevenness, seed)
    receptors = []
    for _ in range(num_receptors):
        receptors.append(vertex)
        nearer = dijkstra(paths, indices=vertex, limit=distance.max())
        distance = np.minimum(distance, nearer)
        vertex = (crowding * distance).argmax()
    return surface.vertices[receptors]


def _crowding(vertices: np.ndarray, unevenness: float, seed: int) -> np.ndarray:
    """`(V,)` 1 on one side of the body, falling to `1 - unevenness` on the other."""
    side = np.random.default_rng([seed, 1]).standard_normal(3)
    along = vertices @ side
    return 1 - unevenness * (along - along.min()) / np.ptp(along)


def receptive_fields(
    surface: trimesh.Trimesh, p_BS: np.ndarray, *, width: float = 1.0
) -> ReceptiveFields:
    """Gives each receptor a smooth round field, wide enough for three to overlap everywhere.

    A receptor is felt from the vertex of the surface that is nearest to it.

    Args:
        surface: Closed outer surface in the body's frame, m.
        p_BS: `(S, 3)` m, receptors on the surface.
        width: Radius of the fields, as a multiple of that least one.
    """
    surface = _refined(surface)
    _, nearest = cKDTree(surface.vertices).query(p_BS)
    paths = surface_paths(surface)
    reach = 3 * math.sqrt(surface.area / len(p_BS))
    distance = dijkstra(paths, indices=nearest, limit=reach)
    farthest = np.partition(distance, OVERLAP - 1, axis=0)[OVERLAP - 1].max()
    if width * FIELD_MARGIN * farthest > reach:
        distance = dijkstra(paths, indices=nearest)
        farthest = np.partition(distance, OVERLAP - 1, axis=0)[OVERLAP - 1].max()
    radius = width * FIELD_MARGIN * farthest
    bump = np.square(np.maximum(1 - np.square(distance / radius), 0)).T
    vertex_weights = csr_matrix(bump / bump.sum(axis=1, keepdims=True))
    return ReceptiveFields(
        p_BS=surface.vertices[nearest],
        vertices=np.array(surface.vertices),
        faces=np.array(surface.faces, dtype=np.int32),
        vertex_weights=vertex_weights,
        radius=float(radius),
    )


def surface_paths(surface: trimesh.Trimesh) -> csr_matrix:
    """Returns `(V, V)` m, a graph whose shortest paths run along the surface.

    Vertices up to three edges apart are joined by straight lines, in so many directions that a
    path is 1 or 2 % too long; but only where a straight line stays on the surface.
    """
    num_vertices = len(surface.vertices)
    ends = np.concatenate([surface.edges_unique, surface.edges_unique[:, ::-1]]).T
    edges = csr_matrix((np.ones(ends.shape[1]), tuple(ends)), shape=(num_vertices, num_vertices))
    rings = edges + edges @ edges + edges @ edges @ edges
    i, j = scipy.sparse.triu(rings, k=1).nonzero()
    chord = surface.vertices[j] - surface.vertices[i]
    length = np.linalg.norm(chord, axis=1)
    normals = surface.vertex_normals
    slope = np.minimum(
        np.abs(np.einsum("ni,ni->n", chord, normals[i])),
        np.abs(np.einsum("ni,ni->n", chord, normals[j])),
    )
    on_surface = slope <= CHORD_SLOPE * length
    is_edge = np.asarray(edges[i, j]).ravel() > 0
    keep = on_surface | is_edge
    i, j, length = i[keep], j[keep], length[keep]
    shape = (num_vertices, num_vertices)
    return csr_matrix(
        (np.tile(length, 2), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=shape
    )


def _refined(surface: trimesh.Trimesh) -> trimesh.Trimesh:
    """Returns the same surface in triangles fine enough for fields; the first vertices stay."""
    mean_edge = surface.edges_unique_length.mean()
    halvings = max(round(math.log2(mean_edge / FIELD_RESOLUTION)), 0)
    return surface.subdivide(iterations=halvings) if halvings else surface
