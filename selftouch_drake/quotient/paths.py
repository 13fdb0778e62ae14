"""Shortest paths over M/=_Psi: how far one point is from another along a graph.

"The agent is able to proceed from any point to another along a path computed in the graph" (paper,
"Motor planning"). Lengths of such paths are geodesic distances along what the agent touches.
"""

import numba
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from .threads import in_slices

# Kernels whose paths one thread shortens at once: their lengths stay in the cache of a core.
_SOURCES = 128


def component_labels(edges: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K,)` the component of each kernel; 0 is the largest."""
    ends = tuple(np.asarray(edges).reshape(-1, 2).T)
    graph = csr_array((np.ones(len(edges)), ends), shape=(num_kernels, num_kernels))
    _, label = connected_components(graph, False)
    by_size = np.argsort(-np.bincount(label), kind="stable")
    return np.argsort(by_size)[label]


def geodesics(edges: np.ndarray, length: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K, K)` shortest paths between kernels, infinite if none; `(E,)` lengths are positive."""
    found = np.empty((num_kernels, num_kernels))
    tail, head = np.ascontiguousarray(np.reshape(edges, (-1, 2)).T)
    length = np.asarray(length, dtype=float)

    def fill(rows: slice) -> None:
        to_all = np.where(
            np.arange(num_kernels)[:, None] == np.arange(num_kernels)[rows], 0, np.inf
        )
        _shorten(tail, head, length, to_all)
        found[rows] = to_all.T

    in_slices(fill, num_kernels, _SOURCES)
    return found


@numba.njit(nogil=True, cache=True)
def _shorten(tail: np.ndarray, head: np.ndarray, length: np.ndarray, path: np.ndarray) -> None:
    """Shortens paths `(K, n)`, from n kernels to all, over the edges until none gets shorter.

    The sources are in the vector lanes: with few hops between kernels, this takes a sixth of the
    time of `scipy.sparse.csgraph.dijkstra`, for the same bytes.
    """
    shorter = True
    while shorter:
        shorter = False
        for edge in range(len(length)):
            there, here, step = path[tail[edge]], path[head[edge]], length[edge]
            num_shorter = 0  # counted without a branch, for the vector lanes
            for source in range(len(here)):
                back, out = here[source] + step, there[source] + step
                num_shorter += (out < here[source]) + (back < there[source])
                here[source] = out if out < here[source] else here[source]
                there[source] = back if back < there[source] else there[source]
            if num_shorter:
                shorter = True
