"""Recomputes set distances of changed kernels only (naive)."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from selftouch_drake.agent.representation.kernels import KernelSets
from selftouch_drake.agent.representation.set_distances import (
    MAX_QUERIES,
    SET_DISTANCES,
    linked_nearest,
    set_distances,
)


def remeasured(
    distance: np.ndarray,
    sets: KernelSets,
    changed: np.ndarray,
    name: str,
    *,
    max_queries: int = MAX_QUERIES,
) -> np.ndarray:
    """Updates set distances after some kernels changed.

    A distance depends on two kernels only, so the cost for c changed kernels of K is c / K of the
    cost for all.

    Args:
        distance: `(K, K)` rad, as computed before.
        sets: K sets of scaled configurations, rad, as they are now.
        changed: `(K,)` bool, the kernels that changed.
        name: key of the set distance in `SET_DISTANCES`.
        max_queries: most configurations per kernel whose nearest neighbours are searched.

    Returns:
        `(K, K)` rad, float32; rows and columns of changed kernels as `set_distances` returns them.
    """
    if changed.all():
        return set_distances(sets, name, max_queries=max_queries)[0]
    if not changed.any():
        return distance
    again = np.flatnonzero(changed)
    asking, ask_offsets = _queries(sets.offsets, max_queries)
    of_changed = np.repeat(changed, np.diff(ask_offsets))
    # The queries of all kernels, and those of the changed ones, as two more sets.
    joined = np.concatenate([sets.x, sets.x[asking], sets.x[asking[of_changed]]])
    num, sizes = len(changed), (len(asking), int(of_changed.sum()))
    offsets = np.concatenate([sets.offsets, len(sets.x) + np.cumsum(sizes)])
    links = [(num, k) for k in again] + [(num + 1, k) for k in range(num)]
    nearest = linked_nearest(KernelSets(joined, offsets), np.array(links))
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
    """At most `most` evenly spaced rows of each kernel, and `(K + 1,)` their offsets."""
    sizes = np.diff(kernel_offsets)
    counts = np.minimum(sizes, most)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    rank = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
    size, count = np.repeat(sizes, counts), np.repeat(counts, counts)
    return np.repeat(kernel_offsets[:-1], counts) + rank * size // count, offsets


def _reduced(
    near: np.ndarray, offsets: np.ndarray, reduce: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """`(n, m)` from `(N, m)` nearest distances: each of the n sets is reduced to one row."""
    return np.stack([reduce(near[a:b]) for a, b in pairwise(offsets)])
