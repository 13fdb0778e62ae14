"""Target sensations: discrete sensory invariants (paper, section III).

Two motor configurations are equivalent, M1 =_Psi M2, if they give the same sensation S. In a finite
sample no two sensations are equal, so the space of sensations is first quantised: by k-means into
*target sensations*, whose Voronoi cells stand for equal sensations. The paper computes at most a
thousand of them.

Each sensation is divided by its L2 norm before it is compared. Then a light touch is near a firm
touch of the same place, whereas otherwise all light touches would fall into one giant cell.
"""

import numba
import numpy as np
from scipy.sparse import csr_array

from .threads import in_slices

# Rows that one thread assigns at once.
_ROWS = 1024

#: Iterations of Lloyd. Few are intended: the start spaces targets evenly, which gives edges
#: comparable lengths; k-means run to convergence would crowd them where the agent touched most.
_LLOYD = 4

#: Below this squared distance two unit sensations are the same one, to float32 rounding.
_SAME = 1e-6

# Target sensations with a smaller cosine have nothing in common, so they are not neighbours. With
# six joints hardly any edge joins such kernels, with twelve a sixth do: shape 16 % instead of 5 %.
_LEAST_ALIKE = 0.05

# The spacing of targets is the distance to the neighbour of this rank, as on a surface. Leaps of
# plans are measured in it: fewer give more contact on longer plans.
_SPACING_NEIGHBOUR = 6


def strength(sensation: np.ndarray) -> np.ndarray:
    """`(n,)` N, L2 norm of each sensation; in double precision, since light touches underflow."""
    return np.sqrt(np.einsum("ns,ns->n", sensation, sensation, dtype=float))


def unit(sensation: np.ndarray) -> np.ndarray:
    """`(n, S)` float32, each of `(n, S)` sensations, none null, divided by its L2 norm."""
    return np.divide(sensation, strength(sensation)[:, None], dtype=np.float32, casting="same_kind")


def target_sensations(
    sensation: np.ndarray,
    num_targets: int,
    *,
    or_fewer: bool = False,
) -> np.ndarray:
    """Quantises sensations by spherical k-means from a farthest-point start.

    Of `(n, S)` N sensations, none null, it returns `(K, S)` float32 targets, of unit L2 norm; each
    is the nearest target of some row. They may be as few as there are distinct sensations, if so
    asked.

    Raises:
        ValueError: there are fewer distinct sensations than targets.
    """
    points = unit(sensation)
    # A touch is felt by few of the receptors: sums over those alone.
    felt = csr_array(points)
    start = _farthest_rows(felt, num_targets)
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
        total = (cells @ felt).toarray()
        norm = np.linalg.norm(total, axis=1, keepdims=True)
        centres = np.divide(total, norm, out=centres, where=norm > 0)
    return _without_empty_cells(points, centres)


def assign(sensation: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Voronoi cell of each sensation: the target that is nearest in angle.

    The `(n, S)` N sensations are not null; the `(K, S)` targets have unit L2 norm. Returns `(n,)`
    the index of the target, and `(n,)` float32 the cosine distance to it.
    """
    label = np.empty(len(sensation), dtype=np.int32)
    error = np.empty(len(sensation), dtype=np.float32)
    by_receptor = np.ascontiguousarray(targets.T, dtype=np.float32)

    def compare(chunk: slice) -> None:
        _most_alike(unit(sensation[chunk]), by_receptor, label[chunk], error[chunk])

    in_slices(compare, len(sensation), _ROWS)
    return label, np.maximum(error, 0.0)


def unlike(targets: np.ndarray) -> np.ndarray:
    """`(K, K)` bool, pairs of `(K, S)` target sensations that have nothing in common."""
    return targets @ targets.T < _LEAST_ALIKE


def target_distances(targets: np.ndarray) -> tuple[np.ndarray, float]:
    """`(K, K)` distances between `(K, S)` target sensations, and their spacing.

    Two sensations that have nothing in common are sqrt(2) apart.
    """
    targets = np.asarray(targets, dtype=float)
    distance = np.sqrt(np.clip(2.0 - 2.0 * targets @ targets.T, 0.0, None))
    neighbour = min(_SPACING_NEIGHBOUR, len(targets) - 1)
    return distance, float(np.median(np.partition(distance, neighbour, axis=1)[:, neighbour]))


def angles(sensations: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """`(E,)` rad, angles between rows of `(N, S)` sensations of unit norm, for `(E, 2)` pairs."""
    chord = np.linalg.norm(sensations[pairs[:, 0]] - sensations[pairs[:, 1]], axis=1)
    return 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))


def _farthest_rows(points: csr_array, number: int) -> np.ndarray:
    """Rows of `(n, S)` unit vectors, from row 0 on, each the farthest from all that were picked.

    They are fewer if all others are the same as one that was picked.
    """
    picked = [0]
    nearest = _squared_distances(points, 0)
    while len(picked) < min(number, points.shape[0]):
        farthest = int(nearest.argmax())
        if nearest[farthest] < _SAME:
            break
        picked.append(farthest)
        np.minimum(nearest, _squared_distances(points, farthest), out=nearest)
    return np.array(picked)


def _squared_distances(points: csr_array, row: int) -> np.ndarray:
    """`(n,)` squared distances of `(n, S)` unit vectors from one of them."""
    return 2.0 - 2.0 * (points @ points[[row]].toarray()[0])


def _without_empty_cells(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Moves the centre of each empty cell to one of the points with the largest errors."""
    centres = centres.copy()
    while True:  # every move lowers the total error
        label, error = assign(points, centres)
        empty = np.flatnonzero(np.bincount(label, minlength=len(centres)) == 0)
        if not len(empty):
            return centres
        centres[empty] = points[np.argsort(error, kind="stable")[-len(empty) :]]


@numba.njit(nogil=True, cache=True, fastmath={"contract"})
def _most_alike(
    points: np.ndarray, targets: np.ndarray, label: np.ndarray, error: np.ndarray
) -> None:
    """Compares each point with all targets, over the few receptors that feel it.

    A touch is felt by a tenth of the receptors: this takes a fifth of the time of a matrix
    product, and 1.4 times as long where all of them feel it. From `(n, S)` points, none negative,
    and `(S, K)` targets, of unit L2 norm, it writes `(n,)` labels and errors, as in `assign`.
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
            # Without a branch: each entry is written, and the next one overwrites it if it is 0.
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
