"""Nearest distances between kernel sets, compared with scipy."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.distances import _nearest_squared


def measure_peers(representation: QuotientRepresentation, num_sets: int, turns: int) -> list[dict]:
    """Nearest distances between a part of all sets, by each way, on one core.

    The ways take turns; each has float32 or float64 as it likes best, trees included.
    """
    chosen = np.random.default_rng(0).choice(representation.num_targets, num_sets, replace=False)
    sets = [
        representation.scaled(representation.kernel_q[representation.members(k)]).astype(np.float32)
        for k in chosen
    ]
    doubles = [np.asarray(members, dtype=float) for members in sets]
    members, offsets = np.concatenate(sets), np.cumsum([0, *map(len, sets)])
    nearest_squared = _nearest_squared(members.shape[1], False)
    no_rows = np.empty((0, 0), dtype=np.int32)  # nobody asks which members are nearest

    def here() -> list[np.ndarray]:
        tables = [np.empty((num_sets, len(a)), dtype=np.float32) for a in sets]
        for a, table in zip(sets, tables, strict=True):
            nearest_squared(
                np.ascontiguousarray(a.T), members, offsets[:-1], offsets[1:], table, no_rows
            )
        return [np.sqrt(table) for table in tables]

    def tree() -> list[np.ndarray]:
        trees = [cKDTree(b) for b in doubles]
        return [np.array([tree.query(a)[0] for tree in trees]) for a in doubles]

    def distances() -> list[np.ndarray]:
        return [np.sqrt([cdist(a, b, "sqeuclidean").min(axis=1) for b in doubles]) for a in doubles]

    ways: dict[str, Callable[[], list[np.ndarray]]]
    ways = {"selftouch_drake": here, "scipy cKDTree": tree, "scipy cdist": distances}
    here()  # compiled now
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    found = {}
    for _ in range(turns):
        for name, way in ways.items():
            began = time.thread_time()
            found[name] = way()
            seconds[name].append(time.thread_time() - began)
    num_pairs = float(len(members)) ** 2
    nanoseconds = {name: 1e9 * statistics.median(s) / num_pairs for name, s in seconds.items()}
    return [
        {
            "way": name,
            "ns_per_pair": cost,
            "times_here": cost / nanoseconds["selftouch_drake"],
            "all_pairs_2_cores_s": cost * 1e-9 * 1e12 / 2,
            "largest_difference_rad": max(
                float(np.abs(a - b).max())
                for a, b in zip(found[name], found["scipy cdist"], strict=True)
            ),
        }
        for name, cost in nanoseconds.items()
    ]
