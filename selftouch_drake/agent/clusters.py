"""Clusters of a few points, by k-means."""

import warnings

import numpy as np

#: The best of so many random starts is kept, each after so many iterations.
_NUM_STARTS, _ITERATIONS = 8, 10


def clusters(points: np.ndarray, number: int) -> np.ndarray:
    """`(n,)` the cluster, 0 to `number` - 1, of each of `(n, D)` points; always the same.

    By k-means: scikit-learn takes longer to import than to work on few points.
    """
    from scipy.cluster.vq import kmeans2  # takes a fifth of a second, which plans need not wait for

    points = np.asarray(points, dtype=float)
    rng = np.random.default_rng(0)
    best, least = np.zeros(len(points), dtype=int), np.inf
    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.filterwarnings("ignore", "One of the clusters is empty")
        for _ in range(_NUM_STARTS):
            centres, label = kmeans2(points, number, iter=_ITERATIONS, minit="++", rng=rng)
            error = np.square(points - centres[label]).sum()
            if error < least:
                best, least = label, error
    return best
