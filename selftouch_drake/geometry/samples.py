"""Triangles cut small, so that points can stand for a surface of triangles of any size."""

from __future__ import annotations

import numpy as np


def cut_triangles(
    triangles: np.ndarray, longest: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Halves triangles across their longest edge until none is longer than `longest`.

    A long thin triangle makes few pieces: their number grows with its area, or with its length
    where it is thinner than `longest`, never with the square of its length.

    Args:
        triangles: `(F, 3, 3)` m, corners.
        longest: m; one for all, or `(F,)` one for each.

    Returns:
        `(P, 3, 3)` m, the pieces, and `(P,)` the triangle that each is part of, in the order of
        the triangles.
    """
    face = np.arange(len(triangles))
    limit = np.broadcast_to(longest, len(triangles))
    done: list[tuple[np.ndarray, np.ndarray]] = []
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        first = edges.argmax(axis=1)
        large = edges[np.arange(len(edges)), first] > limit[face]
        done.append((triangles[~large], face[~large]))
        order = (first[large][:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[large], order[:, :, None], axis=1).swapaxes(0, 1)
        middle = (a + b) / 2
        halves = np.stack([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)], axis=1)
        triangles, face = halves.reshape(-1, 3, 3), np.repeat(face[large], 2)
    pieces, owner = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(owner, kind="stable")
    return pieces[order], owner[order]


def sample_triangles(triangles: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on triangles, such that no point of a triangle is farther than `spacing` from one.

    Args:
        triangles: `(F, 3, 3)` m, corners.
        spacing: m.

    Returns:
        `(N, 3)` m, and `(N,)` the triangle of each.
    """
    # A centroid is at most two thirds of the longest edge from any point of its triangle.
    pieces, face = cut_triangles(triangles, 1.5 * spacing)
    return pieces.mean(axis=1), face
