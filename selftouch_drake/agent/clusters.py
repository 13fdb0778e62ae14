"""Clusters of points by k-means, compiled: for few points, libraries take longer to import."""

from __future__ import annotations

import numba
import numpy as np

#: The best of so many random starts is kept. Iterations end when no point changes its cluster.
_NUM_STARTS = 10
_MOST_ITERATIONS = 300


def clusters(points: np.ndarray, number: int) -> np.ndarray:
    """`(n,)` the cluster, 0 to `number` - 1, of each of `(n, D)` points; always the same."""
    points = np.ascontiguousarray(points, dtype=float)
    draws = np.random.default_rng(0).random((_NUM_STARTS, number))
    return _best(points, draws, _MOST_ITERATIONS)


@numba.njit(nogil=True, cache=True)
def _best(points: np.ndarray, draws: np.ndarray, most_iterations: int) -> np.ndarray:
    """The clusters with the least squared error, from a start for each row of `draws`."""
    best, least = np.zeros(len(points), np.int64), np.inf
    for draw in draws:
        centres = _spread(points, draw)
        label = np.full(len(points), -1)
        for _ in range(most_iterations):
            changed, error = _assigned(points, centres, label)
            if not changed:
                break
            _moved(points, label, centres)
        if error < least:
            best, least = label, error
    return best


@numba.njit(nogil=True, cache=True)
def _spread(points: np.ndarray, draw: np.ndarray) -> np.ndarray:
    """Centres far apart: each is drawn in proportion to squared distances (k-means++)."""
    centres = np.empty((len(draw), points.shape[1]))
    nearest = np.ones(len(points))
    for c in range(len(draw)):
        chosen = np.searchsorted(np.cumsum(nearest), draw[c] * nearest.sum(), side="right")
        centres[c] = points[min(chosen, len(points) - 1)]
        for i in range(len(points)):
            squared = 0.0
            for d in range(points.shape[1]):
                squared += (points[i, d] - centres[c, d]) ** 2
            nearest[i] = squared if c == 0 else min(nearest[i], squared)
    return centres


@numba.njit(nogil=True, cache=True)
def _assigned(points: np.ndarray, centres: np.ndarray, label: np.ndarray) -> tuple[bool, float]:
    """Writes the nearest centre of each point; returns whether any changed, and the error."""
    changed, error = False, 0.0
    for i in range(len(points)):
        nearest, least = 0, np.inf
        for c in range(len(centres)):
            squared = 0.0
            for d in range(points.shape[1]):
                squared += (points[i, d] - centres[c, d]) ** 2
            if squared < least:
                nearest, least = c, squared
        changed |= label[i] != nearest
        label[i] = nearest
        error += least
    return changed, error


@numba.njit(nogil=True, cache=True)
def _moved(points: np.ndarray, label: np.ndarray, centres: np.ndarray) -> None:
    """Moves each centre to the mean of its points; one without points stays."""
    number, total = np.zeros(len(centres), np.int64), np.zeros_like(centres)
    for i in range(len(points)):
        number[label[i]] += 1
        total[label[i]] += points[i]
    for c in range(len(centres)):
        if number[c]:
            centres[c] = total[c] / number[c]
