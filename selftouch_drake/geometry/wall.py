"""Samples the wall of a skin."""

from __future__ import annotations

import numpy as np

from selftouch_drake.geometry.hollow import HollowSkin


def wall_points(skin: HollowSkin, spacing: float) -> np.ndarray:
    """Points on the outer, middle and inner layer of a skin's wall.

    In a triangle with edges up to e, every point is within e / sqrt(3) of a corner. So every point
    of a layer is that near to a sample, with e = `spacing`.

    Args:
        skin: In its link's frame L.
        spacing: m, the longest edge between neighbouring points of a layer.

    Returns:
        `(N, 3)` m, in the link's frame; on the edges of triangles there are two points each.
    """
    num_vertices = len(skin.vertices)
    layers = np.concatenate([skin.faces + layer * num_vertices for layer in range(3)])
    corners = skin.tet_vertices[layers]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    # trimesh cuts triangles, too, but takes 300 MB for half a million points.
    parts = np.ceil(longest / spacing).astype(int)
    cut = [
        np.einsum("pk,fki->fpi", _lattice(number), corners[parts == number]).reshape(-1, 3)
        for number in np.unique(parts)
    ]
    return np.concatenate(cut)


def _lattice(num_parts: int) -> np.ndarray:
    """`(n, 3)` weights of a triangle's corners for points that cut each edge into equal parts."""
    i, j = np.indices((num_parts + 1, num_parts + 1)).reshape(2, -1)
    inside = i + j <= num_parts
    i, j = i[inside], j[inside]
    return np.stack([i, j, num_parts - i - j], axis=1) / num_parts
