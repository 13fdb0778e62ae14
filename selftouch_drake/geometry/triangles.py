"""Samples and intersections of triangles of any size, compact or long and thin."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

# A triangle is covered by a row of balls if its length exceeds this multiple of its height, and by
# no more than about this number.
_SLENDER = 3
_MOST_BALLS = 64

# Balls per neighbour query: bounds the memory, and lets Ctrl-C through.
_BLOCK = 10_000


def sample_triangles(
    triangles: np.ndarray, spacing: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Samples triangles so that each of their points is within `spacing` of a sample.

    The number of samples grows with the area of a triangle `(3, 3)` m, or with its length if it is
    thinner than `spacing`, m, one for all or `(F,)`. Returns `(N, 3)` m, and `(N,)` the triangle of
    each, in order.
    """
    spacing = np.broadcast_to(spacing, len(triangles))
    base, height = lengths_and_heights(triangles)
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    order = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order[:, :, None], axis=1).swapaxes(0, 1)
    # Rows parallel to the longest edge, starting on it. Points between two rows lie straight above
    # the lower one, as both angles at the longest edge are acute.
    rows = np.maximum(np.ceil(height / (np.sqrt(3) / 2 * spacing)), 1).astype(int)
    face, row = counted(rows)
    up = row / rows[face]
    points = np.maximum(np.ceil((1 - up) * (base / spacing)[face]), 1).astype(int)
    of_row, place = counted(points)
    face, up = face[of_row], up[of_row]
    along = (1 - up) * (place + 0.5) / points[of_row]
    return a[face] + along[:, None] * (b - a)[face] + up[:, None] * (c - a)[face], face


def lengths_and_heights(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(F,)` m, longest edge of each triangle `(F, 3, 3)`; `(F,)` m, height above it."""
    base = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    a, b, c = triangles.swapaxes(0, 1)
    # Both are zero if all corners coincide.
    return base, np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(base, 1e-300)


def counted(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(N,)` each index repeated by its count, and `(N,)` numbers from 0 within each."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


def first_self_intersection(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Returns a point where two faces `(F, 3)` without a common vertex intersect, or None.

    An edge of one of them then pierces the other.
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
    """Yields blocks of pairs of triangles `(F, 3, 3)` that may meet, each pair once per block.

    Balls cover the triangles, and a pair may meet if its balls do. Each ball looks for those that
    are no larger than itself, within twice its radius: few are near, however many small ones are.
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
    tree = cKDTree(centres)
    for block in np.array_split(np.arange(len(centres)), len(centres) // _BLOCK + 1):
        near = tree.query_ball_point(centres[block], 2 * radii[block])
        i = np.repeat(block, [len(few) for few in near])
        j = np.concatenate(near).astype(int)
        apart = np.linalg.norm(centres[i] - centres[j], axis=1)
        meet = (radii[j] <= radii[i]) & (apart <= radii[i] + radii[j]) & (face[i] != face[j])
        i, j = face[i[meet]], face[j[meet]]
        pair = np.unique(np.minimum(i, j) * len(triangles) + np.maximum(i, j))
        yield np.divmod(pair, len(triangles))


def _segment_pierces(p: np.ndarray, q: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Returns `(N,)` whether segment `p` to `q` meets `triangle` `(N, 3, 3)` (Möller-Trumbore)."""
    a = triangle[:, 0]
    ab, ac, pq, ap = triangle[:, 1] - a, triangle[:, 2] - a, q - p, p - a
    normal = np.cross(ab, ac)
    slope = -np.einsum("ni,ni->n", pq, normal)
    # Segments in the plane of a triangle are skipped: an adjacent triangle finds the crossing.
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
