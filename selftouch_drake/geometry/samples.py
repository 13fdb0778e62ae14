"""Samples surfaces whose triangles may have any size, compact or long and thin."""

from __future__ import annotations

import numpy as np


def sample_triangles(
    triangles: np.ndarray, spacing: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Samples triangles so that each of their points is within `spacing` of a sample.

    The number of samples grows with the area of a triangle, or with its length if it is thinner
    than `spacing`.

    Args:
        triangles: `(F, 3, 3)` m, corners.
        spacing: m; one for all, or `(F,)` one for each triangle.

    Returns:
        `(N, 3)` m, samples; `(N,)` the triangle of each, in the order of the triangles.
    """
    spacing = np.broadcast_to(spacing, len(triangles))
    base, height = lengths_and_heights(triangles)
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    order = (edges.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order[:, :, None], axis=1).swapaxes(0, 1)
    # Rows parallel to the longest edge, starting on it. Points between two rows lie straight above
    # the lower one, as both angles at the longest edge are acute.
    rows = np.maximum(np.ceil(height / (np.sqrt(3) / 2 * spacing)), 1).astype(int)
    face, row = _counted(rows)
    up = row / rows[face]
    points = np.maximum(np.ceil((1 - up) * (base / spacing)[face]), 1).astype(int)
    of_row, place = _counted(points)
    face, up = face[of_row], up[of_row]
    along = (1 - up) * (place + 0.5) / points[of_row]
    return a[face] + along[:, None] * (b - a)[face] + up[:, None] * (c - a)[face], face


def lengths_and_heights(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(F,)` m, longest edge of each triangle `(F, 3, 3)`; `(F,)` m, height above it."""
    base = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    a, b, c = triangles.swapaxes(0, 1)
    # Both are zero if all corners coincide.
    return base, np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(base, 1e-300)


def _counted(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(N,)` each index repeated by its count, and `(N,)` numbers from 0 within each."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
