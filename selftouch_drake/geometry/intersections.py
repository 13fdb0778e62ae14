"""Where a triangle surface crosses itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry.samples import lengths_and_heights, sample_triangles

# A triangle is covered by a row of balls if its length exceeds this multiple of its height, and by
# no more than about this number.
_SLENDER = 3
_MOST_BALLS = 64

# Balls whose neighbours are looked up at a time: bounds the memory, and lets Ctrl-C through.
_BLOCK = 10_000


def first_self_intersection(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Returns a point where two triangles without a common vertex touch, or None.

    An edge of one of them then pierces the other. Triangles may be of any sizes, long or compact.

    Args:
        vertices: `(V, 3)` m.
        faces: `(F, 3)` indices into `vertices`.
    """
    corners = vertices[faces]
    for i, j in _near_pairs(corners):
        apart = (faces[i][:, :, None] != faces[j][:, None, :]).all(axis=(1, 2))
        i, j = i[apart], j[apart]
        for edged, pierced in ((i, j), (j, i)):
            for start, end in ((0, 1), (1, 2), (2, 0)):
                p, q = corners[edged, start], corners[edged, end]
                hit = _segment_pierces(p, q, corners[pierced])
                if hit.any():
                    return corners[pierced[hit.argmax()]].mean(axis=0)
    return None


def _near_pairs(triangles: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields blocks of pairs of triangles `(F, 3, 3)`, each pair once in a block, that may meet.

    They are those that are covered by balls that meet. Each ball is compared with balls that are as
    large as itself or larger, one class of size after another: few of these are near, however many
    small ones are.
    """
    longest, height = lengths_and_heights(triangles)
    slender = np.flatnonzero(longest > _SLENDER * height)
    compact = np.flatnonzero(longest <= _SLENDER * height)
    middles = triangles[compact].mean(axis=1)
    reach = np.linalg.norm(triangles[compact] - middles[:, None], axis=2).max(axis=1)
    spacing = np.maximum(2 * height, longest / _MOST_BALLS)[slender]
    samples, owner = sample_triangles(triangles[slender], spacing)
    centres = np.concatenate([middles, samples])
    radii = np.concatenate([reach, spacing[owner]])
    face = np.concatenate([compact, slender[owner]])
    size = np.frexp(radii)[1]
    by_size = np.argsort(radii, kind="stable")
    for level in np.unique(size):
        larger = np.flatnonzero(size == level)
        tree = cKDTree(centres[larger])
        # Sorted, so that a block of small pieces need not look far.
        smaller = by_size[: np.searchsorted(size[by_size], level, side="right")]
        for block in np.array_split(smaller, len(smaller) // _BLOCK + 1):
            reach = radii[block].max() + radii[larger].max()
            near = cKDTree(centres[block]).sparse_distance_matrix(
                tree, reach, output_type="coo_matrix"
            )
            i, j = block[near.row], larger[near.col]
            meet = (near.data <= radii[i] + radii[j]) & (face[i] != face[j])
            i, j = face[i[meet]], face[j[meet]]
            pair = np.unique(np.minimum(i, j) * len(triangles) + np.maximum(i, j))
            yield np.divmod(pair, len(triangles))


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
