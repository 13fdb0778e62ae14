"""Distances along the body's surface. The experimenter's side: knows the body."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree


def surface_distances(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Lengths of the shortest ways along a surface, between the vertices nearest to points.

    A way runs along edges and straight across from one triangle to the next, in twelve directions
    round a vertex of six triangles: that is 1 to 5 % longer than the shortest of all ways.

    Args:
        vertices: `(V, 3)` m, of a closed surface.
        faces: `(F, 3)` its triangles.
        points: `(K, 3)` m, on or near the surface.

    Returns:
        `(K, K)` m, symmetric; 0 between points that share their nearest vertex.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    along = mesh.edges_unique
    across = mesh.face_adjacency_unshared
    length = np.concatenate([mesh.edges_unique_length, _unfolded(mesh)])
    i, j = np.concatenate([along, across]).T
    # Where a triangle pair is no convex quadrangle its straight line leaves it.
    known = np.isfinite(length)
    graph = coo_array((length[known], (i[known], j[known])), shape=(len(vertices), len(vertices)))
    _, nearest = cKDTree(vertices).query(points)
    used, back = np.unique(nearest, return_inverse=True)
    distance = dijkstra(graph.tocsr(), directed=False, indices=used)[:, used]
    return distance[np.ix_(back, back)]


def _unfolded(mesh: trimesh.Trimesh) -> np.ndarray:
    """`(A,)` m, between the far corners of each two adjacent triangles laid flat; else infinite."""
    a, b = mesh.vertices[mesh.face_adjacency_edges].transpose(1, 0, 2)
    c, d = mesh.vertices[mesh.face_adjacency_unshared].transpose(1, 0, 2)
    base = np.linalg.norm(b - a, axis=1)
    axis = (b - a) / base[:, None]
    x_c, x_d = (np.einsum("ni,ni->n", p - a, axis) for p in (c, d))
    y_c, y_d = (np.linalg.norm(p - a - x[:, None] * axis, axis=1) for p, x in ((c, x_c), (d, x_d)))
    crossing = (x_c * y_d + x_d * y_c) / (y_c + y_d)
    inside = (crossing >= 0) & (crossing <= base)
    return np.where(inside, np.hypot(x_c - x_d, y_c + y_d), np.inf)
