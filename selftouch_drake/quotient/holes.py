"""The topology of M/=_Psi: components, loops and voids of what is touched (paper, section IV).

By the paper's theorem, M/=_Psi is homeomorphic to X/=_phi, so it has as many of each. They are
counted by persistent homology of the alpha complex of the layout. A bar is a loop (H1) or a void
(H2) that is born at one radius and filled at another.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from .alpha import alpha_filtration

#: Bars between these lengths, in meeting radii, may be true or false; `topology` says why.
_UNSURE = (1.0, 1.3)

#: Length that stands for a missing bar, and the margin where no bar is false.
_NO_LENGTH, _MOST_MARGIN = 1e-100, 100.0

#: Bars born later than this, in meeting radii, are not holes of the body. On sampled surfaces,
#: loops are born when neighbours meet, at 1 to 1.4, and voids when faces close, at 1.7 to 2.5.
_LATE = 4.0

#: Neighbours from which the spacing around a point is measured; it moves the margin alone.
_NEIGHBOURS = 8


class Bar(NamedTuple):
    """A component, loop or void.

    Attributes:
        birth: squared radius at which it appears.
        death: squared radius at which it is filled, or joins another; infinite if it never does.
        filled_by: the simplex that fills it.
    """

    birth: float
    death: float
    filled_by: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Topology:
    """What persistent homology finds in a body.

    Attributes:
        betti: numbers of components, loops and voids: (1, 0, 1) for a ball's surface, (1, 2, 1)
            for a torus, (1, 1, 0) for a ring; a plane has no voids.
        margin: length of the shortest true bar over the longest false one, at most 100; near 1
            means unsure.
        scale: radius at which every true bar has just been born, in the unit of the points.
        meeting_radius: radius at which neighbours meet, in the unit of the points.
        diagram: three arrays `(bars, 2)` of births and deaths, for H0, H1 and H2, without bars of
            zero length; one component never dies (infinity).
    """

    betti: tuple[int, int, int]
    margin: float
    scale: float
    meeting_radius: float
    diagram: tuple[np.ndarray, np.ndarray, np.ndarray]


def topology(points: np.ndarray) -> Topology:
    """Counts components, loops and voids of the body that the points sample.

    Bars are measured in meeting radii, so neither the size nor the unit of the body matters. Let r
    be the radius at which neighbours meet (the median death of H0). On an evenly sampled surface
    the balls leave a false loop inside each polygon of neighbours: of length 0.4 r for a square,
    0.7 r for a pentagon, r where one or two kernels are missing, 1.3 r where three are. A hole of
    the body dies at its own radius, however fine the sampling. So bars below r are false, bars
    above 1.3 r are true, and the widest gap in between decides. The widest gap overall would not
    work, since holes of one body may differ greatly in size.

    Where the points around the place at which a bar dies are farther apart than the median, r is
    larger in proportion: a wide stretch of skin that feels alike leaves a gap that is no hole. A
    closed surface has its void when its last gap is filled. So a loop that dies before the void is
    born is a gap, however long its bar. Bars born late are ignored: the void of a bowl, whose mouth
    closes before the bowl is filled, does not count. Components are counted at a radius at which
    all true bars are born and no missing kernel splits the body.

    The `(K, d)` points, d = 2 or 3, are evenly spread over the body. Errors are as in `delaunay`.
    """
    found = _bars(points)
    h0, h1, h2 = (_radii(bars) for bars in found)
    meeting_radius = float(np.median(h0[:, 1]))
    bars = np.concatenate([h1, h2])
    length = (bars[:, 1] - bars[:, 0]) / meeting_radius / _sparsity(points, found[1] + found[2])
    true, margin = _true_bars(bars, length, len(h1), meeting_radius)
    num_loops, num_true = int(true[: len(h1)].sum()), int(true.sum())
    covered = 2.0 * meeting_radius
    last_birth = float(bars[true, 0].max()) if true.any() else covered
    num_components = int(np.sum(h0[:, 1] > max(last_birth, covered)))
    return Topology(
        betti=(num_components, num_loops, num_true - num_loops),
        margin=margin,
        scale=1.01 * last_birth,
        meeting_radius=meeting_radius,
        diagram=(h0, h1, h2),
    )


def _radii(bars: list[Bar]) -> np.ndarray:
    """`(bars, 2)` radii of birth and death."""
    squared = [(bar.birth, bar.death) for bar in bars]
    return np.sqrt(np.array(squared, dtype=float).reshape(-1, 2))


def _sparsity(points: np.ndarray, bars: list[Bar]) -> np.ndarray:
    """`(bars,)` how much wider points lie where a bar dies than the median; 1 or more."""
    around = neighbour_spacings(points, _NEIGHBOURS)
    around = np.maximum(around / np.median(around), 1.0)
    return np.array([around[list(bar.filled_by)].max() for bar in bars])


def _true_bars(
    bars: np.ndarray, length: np.ndarray, num_loops: int, meeting_radius: float
) -> tuple[np.ndarray, float]:
    """`(bars,)` bool, the loops and voids of the body, and the margin.

    The bars are loops, then voids, of lengths in meeting radii.
    """
    early = bars[:, 0] <= _LATE * meeting_radius
    voids = bars[num_loops:][(early & (length > _UNSURE[1]))[num_loops:]]
    closed = voids[:, 0].min() if len(voids) else 0.0
    gap = bars[:, 1] <= closed
    least, margin = _least_true(length[early & ~gap], length[gap].max(initial=0.0))
    return early & ~gap & (length >= least), margin


def _least_true(length: np.ndarray, longest_gap: float) -> tuple[float, float]:
    """Splits bar lengths, in meeting radii; returns the shortest true one and the margin.

    If no bar is true, that length is infinite, and the margin is that of a bar just long enough.
    The margin counts the longest bar that is surely false.
    """
    surely_false, surely_true = _UNSURE
    falling = np.sort(length)[::-1]
    # Cut c calls the first c bars true. Sentinels: a bar of any length above, no bar below.
    above = np.concatenate([[np.inf], falling])
    below = np.concatenate([falling, [_NO_LENGTH]])
    allowed = (above >= surely_false) & (below <= surely_true)
    ratio = np.where(np.isinf(above), surely_true, above) / np.maximum(below, _NO_LENGTH)
    cut = int(np.where(allowed, ratio, -np.inf).argmax())
    shortest = surely_true if np.isinf(above[cut]) else float(above[cut])
    margin = shortest / max(float(below[cut]), longest_gap, _NO_LENGTH)
    return float(above[cut]), min(margin, _MOST_MARGIN)


def _bars(points: np.ndarray) -> tuple[list[Bar], ...]:
    """The bars of H0, H1 and H2, ascending, without those of zero length."""
    appearing = alpha_filtration(points)
    # A face comes before the simplices that it bounds if they appear at the same radius.
    simplices = sorted(appearing, key=lambda simplex: (appearing[simplex], len(simplex)))
    radius2 = [appearing[simplex] for simplex in simplices]
    bars: tuple[list[Bar], ...] = ([], [], [])
    for birth, death in _persistence_pairs(simplices):
        of_dimension = bars[len(simplices[birth]) - 1]
        if death is None:
            of_dimension.append(Bar(radius2[birth], np.inf, ()))
        elif radius2[death] > radius2[birth]:
            of_dimension.append(Bar(radius2[birth], radius2[death], simplices[death]))
    for some in bars:
        some.sort()
    return bars


def _persistence_pairs(simplices: Sequence[tuple[int, ...]]) -> list[tuple[int, int | None]]:
    """Pairs the simplex that creates each homology class with the one that kills it, or None.

    Simplices come in order of appearance, faces first. This is the standard reduction over Z/2,
    from tetrahedra down: a simplex known to create a class is not reduced (Chen and Kerber).
    """
    place = {simplex: p for p, simplex in enumerate(simplices)}
    killer: dict[int, int] = {}
    reduced: dict[int, set[int]] = {}
    births: set[int] = set()
    for size in range(max(map(len, simplices)), 0, -1):
        for p, simplex in enumerate(simplices):
            if len(simplex) != size or p in killer:
                continue
            column = {place[face] for face in combinations(simplex, size - 1) if face}
            while column and (lowest := max(column)) in killer:
                column ^= reduced[killer[lowest]]
            if column:
                killer[lowest] = p
                reduced[p] = column
            else:
                births.add(p)
    pairs: list[tuple[int, int | None]] = list(killer.items())
    return pairs + [(p, None) for p in births - killer.keys()]


def neighbour_spacings(points: np.ndarray, num_neighbours: int) -> np.ndarray:
    """`(K,)` the spacing around each of `(K, d)` points: median distance to its neighbours."""
    neighbours = min(num_neighbours, len(points) - 1)
    distance, _ = cKDTree(points).query(points, neighbours + 1)
    return np.median(distance[:, 1:], axis=1)
