"""Where a triangle surface crosses itself."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


def first_self_intersection(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Returns a point where two triangles without a common vertex touch, or None.

    An edge of one of them then pierces the other. Meant for triangles of similar size: the
    candidates are the pairs whose circumscribing balls about the centroids could meet.

    Args:
        vertices: `(V, 3)` m.
        faces: `(F, 3)` indices into `vertices`.
    """
    corners = vertices[faces]
    centroids = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centroids[:, None], axis=2).max(axis=1)
    pairs = cKDTree(centroids).query_pairs(2 * radii.max(), output_type="ndarray")
    i, j = pairs.T
    gap = np.linalg.norm(centroids[i] - centroids[j], axis=1)
    near = gap <= radii[i] + radii[j]
    i, j = i[near], j[near]
    apart = (faces[i][:, :, None] != faces[j][:, None, :]).all(axis=(1, 2))
    i, j = i[apart], j[apart]
    for edged, pierced in ((i, j), (j, i)):
        for start, end in ((0, 1), (1, 2), (2, 0)):
            p, q = corners[edged, start], corners[edged, end]
            hit = _segment_pierces(p, q, corners[pierced])
            if hit.any():
                return centroids[pierced[hit.argmax()]]
    return None


def _segment_pierces(p: np.ndarray, q: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Returns `(N,)` whether segment `p` to `q` meets `triangle` `(N, 3, 3)` (Möller-Trumbore)."""
    a = triangle[:, 0]
    ab, ac, pq, ap = triangle[:, 1] - a, triangle[:, 2] - a, q - p, p - a
    normal = np.cross(ab, ac)
    slope = -np.einsum("ni,ni->n", pq, normal)
    # Segments in the plane of the triangle are left to the triangles that stand on it.
    scale = np.linalg.norm(pq, axis=1) * np.linalg.norm(normal, axis=1)
    crossing = np.abs(slope) > 1e-9 * scale
    slope = np.where(crossing, slope, 1)
    turn = np.cross(ap, pq)
    t = np.einsum("ni,ni->n", ap, normal) / slope
    u = np.einsum("ni,ni->n", ac, turn) / slope
    v = -np.einsum("ni,ni->n", ab, turn) / slope
    tiny = 1e-9
    inside = (t >= -tiny) & (t <= 1 + tiny) & (u >= -tiny) & (v >= -tiny) & (u + v <= 1 + tiny)
    return crossing & inside
