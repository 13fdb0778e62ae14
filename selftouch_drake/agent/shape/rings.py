"""Rings of neighbours around each node of a graph."""

import numpy as np
from scipy.sparse import csr_array


def one_ring(edges: np.ndarray, num_kernels: int) -> csr_array:
    """`(K, K)` 1 where two kernels are the same or neighbours, 0 elsewhere; powers are rings."""
    (i, j), here = edges.T, np.arange(num_kernels)
    ends = np.r_[i, j, here], np.r_[j, i, here]
    return csr_array((np.ones(len(ends[0])), ends), shape=(num_kernels, num_kernels))
