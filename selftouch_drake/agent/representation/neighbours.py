"""Nearest neighbours and shortest paths: building blocks of graphs over kernels.

The paper's graph is complete (section III). Its edges include chords through free space, so the
graphs used here are pruned to near neighbours. The functions below take either as a list of edges.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree

#: Mutual nearest: two rings of a triangulated surface hold 18 kernels, one ring 6.
NUM_MUTUAL = 12

#: Nearest that are neighbours in any case: nearly one ring.
NUM_KEPT = 5


class DisconnectedWarning(UserWarning):
    """A pruned graph was disconnected, and was joined by its shortest bridges."""


def complete_edges(num_kernels: int) -> np.ndarray:
    """`(K (K - 1) / 2, 2)` every pair of kernels, i < j, sorted."""
    return np.stack(np.triu_indices(num_kernels, 1), axis=1)


def neighbour_edges(
    distance: np.ndarray, num_mutual: int = NUM_MUTUAL, num_kept: int = NUM_KEPT
) -> np.ndarray:
    """`(E, 2)` pairs i < j, sorted: prunes the complete graph to near neighbours.

    Two kernels are neighbours if each is among the `num_mutual` nearest of the other, which
    excludes the many one-sided pairs; or if one is among the `num_kept` nearest of the other, so
    that no kernel is isolated. The `(K, K)` distance is symmetric; pairs at infinite distance are
    not neighbours.
    """
    distance = np.array(distance, dtype=float)
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1, kind="stable")
    near, kept = (_among(order[:, :num]) for num in (num_mutual, num_kept))
    return np.argwhere(np.triu(((near & near.T) | kept | kept.T) & np.isfinite(distance), 1))


def _among(columns: np.ndarray) -> np.ndarray:
    """`(K, K)` true in the given `(K, n)` columns of each row."""
    among = np.zeros((len(columns), len(columns)), dtype=bool)
    np.put_along_axis(among, columns, True, axis=1)
    return among


def one_ring(edges: np.ndarray, num_kernels: int) -> csr_array:
    """`(K, K)` 1 where two kernels are the same or neighbours, 0 elsewhere; powers are rings."""
    (i, j), here = edges.T, np.arange(num_kernels)
    ends = np.r_[i, j, here], np.r_[j, i, here]
    return csr_array((np.ones(len(ends[0])), ends), shape=(num_kernels, num_kernels))


def component_labels(edges: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K,)` the component of each kernel; 0 is the largest."""
    _, label = connected_components(_sparse(edges, np.ones(len(edges)), num_kernels), False)
    by_size = np.argsort(-np.bincount(label), kind="stable")
    return np.argsort(by_size)[label]


def connected_edges(edges: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Adds the fewest and shortest bridges that make a graph connected.

    Args:
        edges: `(E, 2)` pairs i < j.
        distance: `(K, K)` length of a bridge between two kernels; infinite where none is allowed,
            as between parts of the body.

    Returns:
        `(E + bridges, 2)` pairs i < j, sorted.

    Warns:
        DisconnectedWarning: bridges were added; the text gives sizes and members of the
            components, and the bridges.
    """
    label = component_labels(edges, len(distance))
    num_components = int(label.max()) + 1
    if num_components == 1:
        return edges
    # To csgraph a length of zero is no edge. All edges are shorter than any bridge.
    length = np.where(np.isfinite(distance), 2.0 + distance, 0.0)
    length[tuple(edges.T)] = 1.0
    tree = np.argwhere(minimum_spanning_tree(np.triu(length, 1)).toarray())
    bridges = tree[label[tree[:, 0]] != label[tree[:, 1]]]
    if not len(bridges):
        return edges
    warnings.warn(
        f"the quotient graph fell into {num_components} components ({_describe(label)}), joined by "
        f"{'a bridge' if len(bridges) == 1 else f'{len(bridges)} bridges'} ({_pairs(bridges)}): "
        "babble longer, or give fewer targets",
        DisconnectedWarning,
        stacklevel=2,
    )
    return np.unique(np.concatenate([edges, bridges]), axis=0)


def geodesics(edges: np.ndarray, length: np.ndarray, num_kernels: int) -> np.ndarray:
    """`(K, K)` lengths of the shortest paths between all kernels; infinite without a path.

    The `(E, 2)` edges have positive lengths `(E,)`.
    """
    return dijkstra(_sparse(edges, length, num_kernels), directed=False)


def locally_scaled(length: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """`(E,)` lengths of `(E, 2)` edges in units of the spacing around their ends, about 1.

    They are `d / sqrt(s_i s_j)`; the spacing `s_i` is the mean length of the edges at kernel i.
    Cells are evenly spaced in sensation, so neighbours should be equally far apart, however
    redundant the arm is there.
    """
    i, j = edges.T
    total = np.bincount(edges.ravel(), np.repeat(length, 2))
    spacing = total / np.maximum(np.bincount(edges.ravel()), 1)
    return length / np.sqrt(spacing[i] * spacing[j])


def _sparse(edges: np.ndarray, length: np.ndarray, num_kernels: int) -> csr_array:
    # To csgraph a stored zero is an edge of length zero, and an absent entry no edge.
    i, j = np.asarray(edges).reshape(-1, 2).T
    return csr_array((np.asarray(length, dtype=float), (i, j)), shape=(num_kernels, num_kernels))


def _pairs(edges: np.ndarray) -> str:
    return ", ".join(f"{i}-{j}" for i, j in edges[:5]) + (", ..." if len(edges) > 5 else "")


def _describe(label: np.ndarray) -> str:
    """Sizes and first members of the components, at most five of them."""
    parts = []
    for component, size in enumerate(np.bincount(label)[:5]):
        first = int(np.flatnonzero(label == component)[0])
        parts.append(f"{size} with kernel {first}")
    return ", ".join(parts) + (", ..." if label.max() >= 5 else "")
