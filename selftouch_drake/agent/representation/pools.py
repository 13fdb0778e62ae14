"""Pools of receptors: where there are thousands, those that feel the same count as one (naive)."""

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.sparse import csr_array
from scipy.spatial.distance import squareform

#: More receptors than this are pooled: few touches are felt by the same ones.
MOST_POOLS = 1000

# For two receptors of one pool, one minus the share of their touches (over the geometric mean) is
# below this.
_MOST_APART = 0.9999


def pools_of(sensation: np.ndarray) -> np.ndarray:
    """`(S,)` the pool of each receptor: that of those that feel the same of `(n, S)` touches."""
    num_receptors = sensation.shape[1]
    if num_receptors <= MOST_POOLS:
        return np.arange(num_receptors)
    touched = csr_array(sensation > 0, dtype=np.float32)
    felt = touched.sum(axis=0)
    known = np.flatnonzero(felt)
    pool = np.zeros(num_receptors, dtype=int)  # of those that felt nothing yet
    pool[known] = 1 + np.arange(len(known))
    if len(known) < MOST_POOLS:
        return pool
    touched = touched[:, known]
    apart = 1.0 - (touched.T @ touched).toarray() / np.sqrt(np.outer(felt[known], felt[known]))
    tree = linkage(squareform(apart, checks=False), "complete")
    # Those that share no touch stay apart, however many there are.
    pool[known] = fcluster(tree, min(tree[1 - MOST_POOLS, 2], _MOST_APART), "distance")
    return pool


def pooled(sensation: np.ndarray, pool: np.ndarray) -> np.ndarray:
    """`(n, P)` N, what pools feel in all of `(n, S)` N."""
    if len(pool) <= MOST_POOLS:
        return sensation
    return sensation @ csr_array((np.ones(len(pool), np.float32), (np.arange(len(pool)), pool)))
