"""Set distances measured again where kernels changed, and only there (naive)."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from selftouch_drake.agent.representation.set_distances import (
    MAX_QUERIES,
    SET_DISTANCES,
    linked_nearest,
    set_distances,
)


def remeasured(
    distance: np.ndarray,
    kernel_x: np.ndarray,
    kernel_offsets: np.ndarray,
    changed: np.ndarray,
    name: str,
    *,
    max_queries: int = MAX_QUERIES,
) -> np.ndarray:
    """Set distances of which some kernels are no longer what they were.

    A distance is between two kernels and no others, so that what did not change need not be looked
    at: c changed kernels of K cost c / K of what all cost.

    Args:
        distance: `(K, K)` rad, measured before.
        kernel_x: `(R, J)` rad, scaled configurations grouped by kernel, as they are now.
        kernel_offsets: `(K + 1,)` kernel k owns rows `kernel_offsets[k]:kernel_offsets[k + 1]`.
        changed: `(K,)` bool.
        name: of the set distance, in `SET_DISTANCES`.
        max_queries: configurations of a set that ask for their nearest.

    Returns:
        `(K, K)` rad, float32, as `set_distances` gives it where a kernel changed.
    """
    if changed.all():
        return set_distances(kernel_x, kernel_offsets, name, max_queries=max_queries)[0]
    if not changed.any():
        return distance
    again = np.flatnonzero(changed)
    asking, ask_offsets = _queries(kernel_offsets, max_queries)
    of_changed = np.repeat(changed, np.diff(ask_offsets))
    # The queries of all kernels, and those of the changed ones, as two more sets.
    joined = np.concatenate([kernel_x, kernel_x[asking], kernel_x[asking[of_changed]]])
    num, sizes = len(changed), (len(asking), int(of_changed.sum()))
    offsets = np.concatenate([kernel_offsets, len(kernel_x) + np.cumsum(sizes)])
    links = [(num, k) for k in again] + [(num + 1, k) for k in range(num)]
    nearest = linked_nearest(joined, offsets, np.array(links))
    near = np.split(np.sqrt(nearest.squared), [len(again) * sizes[0]])
    kind = SET_DISTANCES[name]
    to_changed = _reduced(near[0].reshape(len(again), -1).T, ask_offsets, kind.reduce)
    from_changed = _reduced(
        near[1].reshape(num, -1).T,
        np.concatenate([[0], np.cumsum(np.diff(ask_offsets)[again])]),
        kind.reduce,
    )
    distance = distance.copy()
    distance[again] = kind.symmetrise(from_changed, to_changed.T)
    distance[:, again] = distance[again].T
    np.fill_diagonal(distance, 0.0)
    return distance


def _queries(kernel_offsets: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Evenly strided rows of each kernel, `most` of it at most, and where those of each begin."""
    sizes = np.diff(kernel_offsets)
    counts = np.minimum(sizes, most)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    rank = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
    size, count = np.repeat(sizes, counts), np.repeat(counts, counts)
    return np.repeat(kernel_offsets[:-1], counts) + rank * size // count, offsets


def _reduced(
    near: np.ndarray, offsets: np.ndarray, reduce: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """`(n, m)` of `(N, m)` nearest distances: those of each of n sets are reduced to one."""
    return np.stack([reduce(near[a:b]) for a, b in pairwise(offsets)])
