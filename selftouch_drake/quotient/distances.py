"""Distances between points of M/=_Psi: between motor kernel sets (paper, "Motor planning").

"The points themselves being sets, the distance should be defined between sets in the motor
configuration space and should be derived from quotient metrics." Every set distance here uses one
table: the distances from each configuration of one set to the nearest configuration of the other.
They differ in how they reduce it to a number.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numba
import numpy as np

from .kernels import KernelSets
from .threads import in_slices, thread_pool

#: Most queries per set. More of them change distances by less than 2 %, and take longer.
MAX_QUERIES = 120
# Queries per set where a rough distance is enough.
_FEW_QUERIES = 16
# Sets whose few queries are compared in one call.
_TOGETHER = 8
# Links along which one thread searches at once.
_LINKS = 32
# Stands for the rows of the nearest members, where nobody asks which they are.
_NO_ROWS = np.empty((0, 0), dtype=np.int32)


@dataclass(frozen=True, slots=True)
class SetDistance:
    """A way to reduce nearest distances to the distance of two sets.

    Attributes:
        reduce: maps nearest distances `(N, K)`, of N configurations of a set to K sets, to `(K,)`.
        combine: makes one `(K, K)` array of those from each set and those to each set.
    """

    reduce: Callable[[np.ndarray], np.ndarray]
    combine: Callable[[np.ndarray, np.ndarray], np.ndarray]


def quantile(near: np.ndarray, share: float) -> np.ndarray:
    """The same as `np.quantile(near, share, axis=0)` of `(N, K)`, in a fifth of the time."""
    # The quantile lies between two ranks, at this place.
    place = share * (len(near) - 1)
    rank_above = min(int(place) + 1, len(near) - 1)
    parted = np.partition(near.T, rank_above, axis=1)
    above = parted[:, rank_above]
    if rank_above == 0 or not len(above):
        return above
    below = parted[:, :rank_above].max(axis=1)
    step = above - below
    # As numpy does it: exact at both ends.
    past_below = place - int(place)
    if past_below < 0.5:
        return below + step * past_below
    return above - step * (1.0 - past_below)


#: The set distances by name. `minimum` is the paper's quotient metric; measured on bodies of known
#: shape, `quantile` keeps neighbours best.
SET_DISTANCES = {
    "minimum": SetDistance(lambda near: near.min(axis=0), np.minimum),
    "quantile": SetDistance(
        lambda near: quantile(near, 0.1), lambda there, back: (there + back) / 2
    ),
}


def set_distances(
    sets: KernelSets,
    name: Literal["minimum", "quantile"] = "quantile",
    *,
    max_queries: int = MAX_QUERIES,
    rough: np.ndarray | None = None,
    changed: np.ndarray | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> np.ndarray:
    """Computes distances between every two kernel sets.

    Nearest distances are exact: the queries of a set (all its configurations, or `max_queries`
    evenly strided ones) are compared with every configuration of every other set.

    For pairs that are rough, `(K, K)` bool, symmetric, 16 queries are enough. If `(K,)` bool says
    which sets changed, only distances to and from these are wanted. Returns `(K, K)` mu, float32,
    symmetric with a zero diagonal; 0 between sets that did not change.

    Raises:
        ValueError: a kernel is empty.
    """
    if (empty := np.flatnonzero(sets.sizes <= 0)).size:
        raise ValueError(f"kernel {empty[0]} holds no configuration: drop it from its offsets")
    sets = sets.at(np.ascontiguousarray(sets.x, dtype=np.float32))
    chosen = SET_DISTANCES[name]
    exact = np.ones((len(sets), len(sets)), dtype=bool) if rough is None else ~rough
    if changed is not None:
        exact &= changed[:, None] | changed
    there = np.zeros(exact.shape, dtype=np.float32)
    if rough is not None:
        _fill_roughly(there, sets, chosen, min(_FEW_QUERIES, max_queries))
    queries = sets.thinned(max_queries)

    def fill_exactly(kernel: int) -> None:
        asked = np.flatnonzero(exact[kernel])
        there[kernel, asked] = chosen.reduce(_nearest(queries.configurations(kernel), sets, asked))

    with thread_pool() as pool:
        for done, _ in enumerate(pool.map(fill_exactly, range(len(sets))), 1):
            progress(done / len(sets))
    distance = chosen.combine(there, there.T)
    np.fill_diagonal(distance, 0.0)
    return distance


def _fill_roughly(
    there: np.ndarray, sets: KernelSets, chosen: SetDistance, num_queries: int
) -> None:
    """Writes `(K, K)` reduced distances from few queries of each set to all sets."""
    queries, kernels = sets.thinned(num_queries), np.arange(len(sets))

    def fill(rows: slice) -> None:
        some = [queries.configurations(kernel) for kernel in kernels[rows]]
        near = _nearest(np.concatenate(some), sets, kernels)
        first = 0
        for kernel, asking in zip(kernels[rows], some, strict=True):
            there[kernel] = chosen.reduce(near[first : first + len(asking)])
            first += len(asking)

    in_slices(fill, len(sets), _TOGETHER)


def _nearest(x: np.ndarray, sets: KernelSets, asked: np.ndarray) -> np.ndarray:
    """`(N, n)` mu, distance of each of `(N, J)` configurations to the n sets that are asked."""
    offsets = np.asarray(sets.offsets, dtype=np.int64)
    squared = np.empty((len(asked), len(x)), dtype=np.float32)
    search = _nearest_squared(sets.x.shape[1], False)
    search(x.T.copy(), sets.x, offsets[asked], offsets[asked + 1], squared, _NO_ROWS)
    return np.sqrt(squared.T)


class Nearest(NamedTuple):
    """The nearest configurations along L links, each from a first to a second kernel.

    Attributes:
        offsets: `(L + 1,)` link l owns entries `offsets[l]:offsets[l + 1]` of the other arrays, one
            for each configuration of its first kernel.
        row: `(N,)` int32, the row of the nearest configuration of the second kernel.
        squared: `(N,)` float32 mu^2, the squared distance to it.
    """

    offsets: np.ndarray
    row: np.ndarray
    squared: np.ndarray


def linked_nearest(sets: KernelSets, links: np.ndarray) -> Nearest:
    """Finds, for every configuration of a kernel, the nearest one in each linked kernel.

    The sets are scaled, mu; `(L, 2)` links are first and second kernel of each.
    """
    members = np.ascontiguousarray(sets.x, dtype=np.float32)
    set_offsets = np.asarray(sets.offsets, dtype=np.int64)
    offsets = np.cumsum([0, *sets.sizes[links[:, 0]]])
    row, squared = np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.float32)
    search = _nearest_squared(members.shape[1], True)

    def along(some: slice) -> None:
        for link in range(len(links))[some]:
            tail, head = links[link]
            queries = members[slice(*set_offsets[tail : tail + 2])]
            entries = slice(*offsets[link : link + 2])
            search(
                np.ascontiguousarray(queries.T),
                members,
                set_offsets[head : head + 1],
                set_offsets[head + 1 : head + 2],
                squared[None, entries],
                row[None, entries],
            )

    in_slices(along, len(links), _LINKS)
    return Nearest(offsets, row, squared)


# It is not cached: the functions that call it keep it.
@numba.njit
def square_step(x, y):
    """The squared distance of two configurations `(J,)`."""
    total = np.float32(0.0)
    for joint in range(len(x)):
        step = x[joint] - y[joint]
        total += step * step
    return total


@lru_cache
def _nearest_squared(num_joints: int, tell_which: bool) -> Callable[..., None]:
    """Compiles the nearest search; a fixed number of joints keeps all sums in registers."""

    def nearest_squared(
        queries: np.ndarray,
        members: np.ndarray,
        starts: np.ndarray,
        stops: np.ndarray,
        out: np.ndarray,
        which: np.ndarray,
    ) -> None:
        """Squared distance from each query to the nearest member of each set.

        Queries are in the vector lanes, and four members are compared at a time. This needs no
        reduction across lanes, and each load of a query serves four pairs. With AVX2 this is
        limited by arithmetic alone: 0.14 ns per pair on one core, for 6 joints.

        The `(J, N)` queries and `(R, J)` members are float32; set k is rows `starts[k]` to
        `stops[k]`, int64. It writes `(K, N)` float32 `out` and, if `tell_which`, int32 `which`,
        the nearest member; that costs 6 % of the time.
        """
        for k in range(len(starts)):
            best = out[k]
            best[:] = np.inf
            if tell_which:
                which[k, :] = starts[k]
            last = stops[k] - 1
            for r0 in range(starts[k], last + 1, 4):
                # A short tail repeats its last member, which changes no minimum.
                r1, r2, r3 = min(r0 + 1, last), min(r0 + 2, last), min(r0 + 3, last)
                m0, m1, m2, m3 = members[r0], members[r1], members[r2], members[r3]
                for i in range(queries.shape[1]):
                    sum0 = sum1 = sum2 = sum3 = np.float32(0)
                    for j in range(num_joints):
                        query = queries[j, i]
                        d0, d1, d2, d3 = query - m0[j], query - m1[j], query - m2[j], query - m3[j]
                        sum0 += d0 * d0
                        sum1 += d1 * d1
                        sum2 += d2 * d2
                        sum3 += d3 * d3
                    near01 = sum0 if sum0 < sum1 else sum1
                    near23 = sum2 if sum2 < sum3 else sum3
                    near = near01 if near01 < near23 else near23
                    if tell_which:
                        which[k, i] = np.int32(r0) if near < best[i] else which[k, i]
                    best[i] = near if near < best[i] else best[i]
            if tell_which:
                for i in range(queries.shape[1]):
                    # So far it is the first of the four that were compared together.
                    first, least = which[k, i], np.float32(np.inf)
                    for r in range(first, min(first + 4, last + 1)):
                        total = np.float32(0)
                        for j in range(num_joints):
                            step = queries[j, i] - members[r, j]
                            total += step * step
                        if total < least:
                            which[k, i], least = r, total

    # Each variant has cache files of its own: where one function has several, two processes that
    # compile at once may take the same file for different ones, and one runs the other's code.
    nearest_squared.__qualname__ += f"_{num_joints}_{tell_which}"
    return numba.njit(nogil=True, fastmath=True, cache=True)(nearest_squared)
