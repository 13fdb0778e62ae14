"""Pools receptors that feel the same touches, so that thousands are fewer places (naive)."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

#: Receptors feel alike if both feel this share of the touches that either of them feels.
_ALIKE = 0.5

#: Touches from which receptors are compared.
_MOST_TOUCHES = 5000


def pools(sensation: csr_array) -> np.ndarray:
    """`(S,)` the pool of each receptor: neighbours that feel alike, and their neighbours.

    The more touches there are, the better neighbours are told apart, or known to be neighbours.
    Receptors that felt nothing yet share the last pool.

    Args:
        sensation: `(n, S)` N, sparse.
    """
    some = np.unique(np.linspace(0, sensation.shape[0] - 1, _MOST_TOUCHES).astype(int))
    felt = (sensation[some] > 0).astype(np.float32)
    together = (felt.T @ felt).tocoo()
    count = np.asarray(felt.sum(axis=0)).ravel()
    either = count[together.row] + count[together.col] - together.data
    alike = together.data >= _ALIKE * either
    graph = csr_array(
        (np.ones(int(alike.sum())), (together.row[alike], together.col[alike])),
        shape=together.shape,
    )
    _, pool = connected_components(graph, directed=False)
    return np.unique(np.where(count > 0, pool, len(count)), return_inverse=True)[1]


def in_pools(sensation: csr_array, pool: np.ndarray) -> np.ndarray:
    """`(n, P)` N, what the receptors of each pool feel together, from `(n, S)` N, sparse.

    `pool` is as of `pools`.
    """
    of_receptor = csr_array((np.ones(len(pool), np.float32), (np.arange(len(pool)), pool)))
    return (sensation @ of_receptor).toarray()
