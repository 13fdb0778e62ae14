"""Discrete sensory invariants: target sensations and their Voronoi cells (paper, section III).

Each sensation is first divided by its L2 norm. Then a light touch is near a firm touch of the same
place, whereas otherwise all light touches would fall into one giant cell.
"""

import warnings

import numba
import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.threads import in_slices

# Rows that one thread assigns at once.
_ROWS = 1024

#: Iterations of Lloyd that move the targets.
_LLOYD = 4

#: Below this squared distance two unit sensations are the same one, to float32 rounding.
_SAME = 1e-6

#: Of clusters, the best of so many random starts is kept, each after so many iterations.
_NUM_STARTS, _ITERATIONS = 8, 10


def strength(sensation: np.ndarray) -> np.ndarray:
    """`(n,)` N, L2 norm of each sensation; in double precision, since light touches underflow."""
    return np.sqrt(np.einsum("ns,ns->n", sensation, sensation, dtype=float))


def unit(sensation: np.ndarray) -> np.ndarray:
    """`(n, S)` float32, each of `(n, S)` sensations, none null, divided by its L2 norm."""
    return np.divide(sensation, strength(sensation)[:, None], dtype=np.float32, casting="same_kind")


def assign(sensation: np.ndarray, target_sensations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The target nearest in angle to each sensation: its index `(n,)`, and float32 cosine distance.

    The `(n, S)` N sensations are not null; the `(K, S)` targets have unit L2 norm.
    """
    label = np.empty(len(sensation), dtype=np.int32)
    error = np.empty(len(sensation), dtype=np.float32)
    targets = np.ascontiguousarray(target_sensations.T, dtype=np.float32)

    def compare(chunk: slice) -> None:
        _most_alike(unit(sensation[chunk]), targets, label[chunk], error[chunk])

    in_slices(compare, len(sensation), _ROWS)
    return label, np.maximum(error, 0.0)


@numba.njit(nogil=True, cache=True, fastmath={"contract"})
def _most_alike(
    points: np.ndarray, targets: np.ndarray, label: np.ndarray, error: np.ndarray
) -> None:
    """Compares each point with all targets, over the few receptors that feel it.

    A touch is felt by a tenth of the receptors: this takes a fifth of the time of a matrix
    product, and 1.4 times as long where all of them feel it. From `(n, S)` points, none negative,
    and `(S, K)` targets, of unit L2 norm, it writes `(n,)` labels and errors, as of `assign`.
    """
    num_receptors, num_targets = targets.shape
    likeness = np.empty(num_targets, np.float32)
    # Numbers >= 0 are ordered as their bits are, and only integers compare in vector registers.
    bits = likeness.view(np.int32)
    # Receptors that feel the point, four at a time; weights of 0 fill up the last four.
    felt = np.zeros(num_receptors + 3, np.int64)
    weight = np.zeros(num_receptors + 3, np.float32)
    for row in range(len(points)):
        num_felt = 0
        for receptor in range(num_receptors):
            felt[num_felt], weight[num_felt] = receptor, points[row, receptor]
            num_felt += points[row, receptor] > 0
        weight[num_felt : num_felt + 3] = 0
        likeness[:] = 0
        for i in range(0, num_felt, 4):
            t0, t1, t2, t3 = (
                targets[felt[i]],
                targets[felt[i + 1]],
                targets[felt[i + 2]],
                targets[felt[i + 3]],
            )
            w0, w1, w2, w3 = weight[i], weight[i + 1], weight[i + 2], weight[i + 3]
            for k in range(num_targets):
                likeness[k] += w0 * t0[k] + w1 * t1[k] + w2 * t2[k] + w3 * t3[k]
        best = np.int32(0)
        for k in range(num_targets):
            best = max(best, bits[k])
        for k in range(num_targets):
            if bits[k] == best:
                label[row], error[row] = k, np.float32(1) - likeness[k]
                break


def target_sensations(
    sensation: np.ndarray,
    num_targets: int,
    *,
    or_fewer: bool = False,
) -> np.ndarray:
    """Quantises sensations by spherical k-means from a farthest-point start.

    Few iterations are intended: the farthest-point start spaces targets evenly, but k-means run to
    convergence would crowd them where the agent touched most. Even spacing gives the edges of the
    quotient graph comparable lengths.

    Of `(n, S)` N sensations, none null, it returns `(K, S)` float32 targets, of unit L2 norm; each
    is the nearest target of some row. They may be as few as there are distinct sensations, if so
    asked.

    Raises:
        ValueError: there are fewer distinct sensations than targets.
    """
    points = unit(sensation)
    start = farthest_points(
        lambda row: 2.0 - 2.0 * (points @ points[row]), num_targets, least=_SAME
    )
    if len(start) == 1:
        raise ValueError("sensation is the same in every row: record touches at more places")
    if len(start) < num_targets and not or_fewer:
        raise ValueError(
            f"num_targets is {num_targets}, but the experience holds only {len(start)} distinct "
            f"sensations: give at most {len(start)}, or babble longer"
        )
    centres = points[start]
    for _ in range(_LLOYD):
        label, _ = assign(points, centres)
        cells = csr_array(
            (np.ones(len(points), np.float32), (label, np.arange(len(points)))),
            shape=(len(start), len(points)),
        )
        total = cells @ points
        norm = np.linalg.norm(total, axis=1, keepdims=True)
        centres = np.divide(total, norm, out=centres, where=norm > 0)
    return _without_empty_cells(points, centres)


def _without_empty_cells(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Moves the centre of each empty cell to one of the points with the largest errors."""
    centres = centres.copy()
    while True:  # every move lowers the total error
        label, error = assign(points, centres)
        empty = np.flatnonzero(np.bincount(label, minlength=len(centres)) == 0)
        if not len(empty):
            return centres
        centres[empty] = points[np.argsort(error, kind="stable")[-len(empty) :]]


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
