"""Distances along a surface."""

from __future__ import annotations

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

    The surface of `(V, 3)` m and `(F, 3)` triangles is closed or has a rim, in one part or several.
    Of `(K, 3)` m points on or near it, it returns `(K, K)` m, symmetric; 0 between points that
    share their nearest vertex, infinite between those on parts that are not connected.
    """
    surface = trimesh.Trimesh(vertices, faces, process=False)
    # Vertices without triangles do not belong to the surface.
    corners = np.unique(faces)
    _, nearest = cKDTree(surface.vertices[corners]).query(points)
    used, back = np.unique(corners[nearest], return_inverse=True)
    distance = dijkstra(surface_paths(surface), indices=used)[:, used]
    return np.minimum(distance, distance.T)[np.ix_(back, back)]


def surface_paths(surface: trimesh.Trimesh) -> csr_matrix:
    """Returns `(V, V)` m, a graph whose shortest paths run along the surface.

    Straight lines join vertices up to three edges apart. They have so many directions that a path
    is only 1 or 2 % too long. A line counts only if it stays on the surface. Near the rim of a
    patch, where it might leave the patch, only edges and the diagonals of convex pairs of triangles
    are lines: paths there are up to 5 % too long. The surface, in metres, may have a rim.
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
    near_rim = _near_rim(surface, edges)
    if near_rim.any():
        # Vertices three edges from i are in the patch if i is more than three from the rim.
        on_surface &= ~(near_rim[i] & near_rim[j])
    is_edge = np.isin(
        np.ravel_multi_index((i, j), edges.shape),
        np.ravel_multi_index(tuple(surface.edges_unique.T), edges.shape),
    )
    keep = on_surface | is_edge
    i, j, length = i[keep], j[keep], length[keep]
    if near_rim.any():
        i, j, length = _with_diagonals(i, j, length, surface, near_rim)
    return csr_matrix(
        (np.tile(length, 2), (np.concatenate([i, j]), np.concatenate([j, i]))),
        shape=edges.shape,
    )


def neighbouring_vertices(surface: trimesh.Trimesh) -> csr_array:
    """`(V, V)` 1 where an edge joins two vertices."""
    ends = np.concatenate([surface.edges_unique, surface.edges_unique[:, ::-1]]).T
    num_vertices = len(surface.vertices)
    return csr_array((np.ones(ends.shape[1]), tuple(ends)), shape=(num_vertices, num_vertices))


def _near_rim(surface: trimesh.Trimesh, edges: csr_array) -> np.ndarray:
    """`(V,)` whether a vertex is at most three edges from the rim."""
    near = np.zeros(len(surface.vertices), dtype=bool)
    near[surface.edges_unique[np.bincount(surface.edges_unique_inverse) == 1]] = True
    for _ in range(3 if near.any() else 0):
        near |= edges @ near > 0
    return near


def _with_diagonals(
    i: np.ndarray, j: np.ndarray, length: np.ndarray, surface: trimesh.Trimesh, where: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Adds diagonals of adjacent triangles to lines `i < j`, between vertices `where` `(V,)`."""
    diagonals = np.sort(surface.face_adjacency_unshared, axis=1)
    unfolded = _unfolded(surface)
    # If a pair of triangles is not convex, its diagonal leaves it.
    keep = np.isfinite(unfolded) & where[diagonals].all(axis=1)
    i, j = np.concatenate([[i, j], diagonals[keep].T], axis=1)
    length = np.concatenate([length, unfolded[keep]])
    # Two vertices may be joined twice: by an edge, and across another edge.
    order = np.lexsort([length, j, i])
    i, j, length = i[order], j[order], length[order]
    first = np.concatenate([[True], (np.diff(i) != 0) | (np.diff(j) != 0)])
    return i[first], j[first], length[first]


def _unfolded(surface: trimesh.Trimesh) -> np.ndarray:
    """`(A,)` m, diagonal of each pair of adjacent triangles, unfolded; infinite if not convex."""
    a, b = surface.vertices[surface.face_adjacency_edges].transpose(1, 0, 2)
    c, d = surface.vertices[surface.face_adjacency_unshared].transpose(1, 0, 2)
    base = np.linalg.norm(b - a, axis=1)
    axis = (b - a) / base[:, None]
    x_c, x_d = (np.einsum("ni,ni->n", p - a, axis) for p in (c, d))
    y_c, y_d = (np.linalg.norm(p - a - x[:, None] * axis, axis=1) for p, x in ((c, x_c), (d, x_d)))
    crossing = (x_c * y_d + x_d * y_c) / (y_c + y_d)
    inside = (crossing >= 0) & (crossing <= base)
    return np.where(inside, np.hypot(x_c - x_d, y_c + y_d), np.inf)
