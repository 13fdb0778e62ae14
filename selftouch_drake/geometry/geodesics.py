"""Distances along a surface."""

import numpy as np
import scipy.sparse
from scipy.sparse import csr_array, csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from selftouch_drake.lazy import trimesh

# Sine of the largest angle between a chord and the tangent planes at its ends at which it replaces
# the path on the surface: a smooth bend then costs 1 % of length, and sharp edges are never cut.
CHORD_SLOPE = 0.25


def surface_distances(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Geodesic distances along a surface, between the vertices nearest to given points.

    The surface of `(V, 3)` m and `(F, 3)` triangles is closed, in one part or several. Of `(K, 3)`
    m points on or near it, it returns `(K, K)` m, symmetric; 0 between points that share their
    nearest vertex, infinite between those on parts that are not connected.
    """
    surface = trimesh.Trimesh(vertices, faces, process=False)
    _, nearest = cKDTree(vertices).query(points)
    used, back = np.unique(nearest, return_inverse=True)
    distance = dijkstra(surface_paths(surface), indices=used)[:, used]
    return np.minimum(distance, distance.T)[np.ix_(back, back)]


def surface_paths(surface: trimesh.Trimesh) -> csr_matrix:
    """Returns `(V, V)` m, a graph whose shortest paths run along the surface.

    Straight lines join vertices up to three edges apart. They have so many directions that a path
    is only 1 or 2 % too long. A line counts only if it stays on the surface, which is closed, and
    in metres.
    """
    edges = neighbouring_vertices(surface)
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
    is_edge = np.isin(
        np.ravel_multi_index((i, j), edges.shape),
        np.ravel_multi_index(tuple(surface.edges_unique.T), edges.shape),
    )
    keep = on_surface | is_edge
    ends, length = np.stack([i[keep], j[keep]]), np.tile(length[keep], 2)
    return csr_matrix((length, np.concatenate([ends, ends[::-1]], axis=1)), shape=edges.shape)


def neighbouring_vertices(surface: trimesh.Trimesh) -> csr_array:
    """`(V, V)` 1 where an edge joins two vertices."""
    ends = np.concatenate([surface.edges_unique, surface.edges_unique[:, ::-1]]).T
    num_vertices = len(surface.vertices)
    return csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(num_vertices, num_vertices))
