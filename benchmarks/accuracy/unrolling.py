"""Torsion of the quotient space: loops that can be filled only if traversed several times.

If no surface fills a loop, but one fills the loop traversed twice (or four times), homology over
Z/2 counts it and homology over Z/3 does not. Two fingers make such a loop: turn the hand until each
finger is where the other was, and the sensation is as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.geometry.farthest import farthest_points

#: Number of points on which loops are searched. The covers have two and four times as many.
_NUM_LANDMARKS = 300

#: Shortest range of scales, as the ratio of its ends, on which Z/2 must count a loop that Z/3 does
#: not. Ties and rounding cause ranges of up to 1.05 on spaces without torsion.
_LEAST_STRETCH = 1.1

#: The torsion of a cover is searched up to this multiple of the scale: a loop of twice the length
#: dies at twice the scale.
_LARGEST = 2.2
_MOST_COVERS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Torsion:
    """Loops of a space that homology over Z/2 counts and homology over Z/3 does not.

    Attributes:
        bars2: `(bars, 2)` births and deaths of loops over Z/2.
        bars3: the same over Z/3.
        scale: `(2,)` ends of the longest range of scales on which Z/2 counts more loops.
        cocycle: `(E, 2)` pairs of points; a closed path takes an odd number of these steps if it
            goes around the loop once.
    """

    bars2: np.ndarray
    bars3: np.ndarray
    scale: np.ndarray
    cocycle: np.ndarray

    @property
    def stretch(self) -> float:
        """Ratio of the ends of `scale`; 1 if there is no torsion."""
        return float(self.scale[1] / self.scale[0])

    @property
    def middle(self) -> float:
        """A scale within the range: the sample covers the space, and its loop is not filled."""
        return float(np.sqrt(self.scale.prod()))

    @property
    def found(self) -> bool:
        """Whether the range is longer than chance explains."""
        return self.stretch >= _LEAST_STRETCH


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """How many times a loop must be traversed before it can be filled.

    Attributes:
        order: 1 if there is no torsion, else 2, 4 or 8.
        covers: torsion of the space, of its double cover, and so on up to the first without any.
        distances: `(2^n K, 2^n K)` along the last cover; k, k + K, k + 2 K, ... lie over point k.
    """

    order: int
    covers: tuple[Torsion, ...]
    distances: np.ndarray


def turns(distances: np.ndarray) -> Turns:
    """Finds the order of a loop by taking double covers of the space one after another.

    Z/2 and Z/3 cannot distinguish a loop of order 2 from one of order 4. But a double cover, in
    which one turn leads to another point, keeps the loop of two turns: its order is 1 or 2.

    Args:
        distances: `(K, K)` symmetric, finite; a few hundred points, since the last cover has four
            times as many: `landmarks` chooses them.

    Raises:
        ImportError: ripser is not installed.
        ValueError: distances are not finite.
    """
    covers = [torsion(distances)]
    while covers[-1].found and len(covers) <= _MOST_COVERS:
        unrolled = double_cover(distances, covers[-1])
        if not np.isfinite(unrolled).all():
            break
        distances = unrolled
        covers.append(torsion(distances, largest=_LARGEST * covers[-1].scale[1]))
    return Turns(
        order=2 ** sum(cover.found for cover in covers), covers=tuple(covers), distances=distances
    )


def landmarks(distances: np.ndarray, num_landmarks: int = _NUM_LANDMARKS) -> np.ndarray:
    """Picks points one by one, each the farthest from all before, starting with point 0.

    Args:
        distances: `(K, K)`.
        num_landmarks: fewer are returned if there are fewer points.
    """
    return farthest_points(lambda point: distances[point], num_landmarks)


def torsion(distances: np.ndarray, largest: float = np.inf) -> Torsion:
    """Compares the loops of the Rips complex over Z/2 and over Z/3.

    By the universal coefficient theorem, the number of loops over Z/p is the number of free loops
    plus one for each cyclic summand of the first homology whose order p divides. So where Z/2
    counts more than Z/3, some loop is filled after an even number of turns. False loops, which
    uneven sampling leaves, are free: both count them, and they cancel in the difference.

    Args:
        distances: `(K, K)` symmetric, finite.
        largest: scale at which the search stops.

    Raises:
        ImportError: ripser is not installed.
        ValueError: distances are not finite.
    """
    if not np.isfinite(distances).all():
        raise ValueError("distances hold NaN or infinity: connect the quotient graph first")
    ripser = _ripser().ripser
    # Beyond this radius the complex is a cone, which has no loops.
    last = min(float(distances.max(axis=1).min()), largest)

    def bars(prime: int) -> dict:
        return ripser(
            distances,
            distance_matrix=True,
            maxdim=1,
            coeff=prime,
            thresh=last,
            do_cocycles=prime == 2,
        )

    of2, of3 = bars(2), bars(3)
    bars2, bars3 = (np.minimum(found["dgms"][1], last).astype(float) for found in (of2, of3))
    scale = _excess(bars2, bars3)
    # The loop that is filled where the range ends and was born before the range began.
    ends = np.abs(bars2[:, 1] - scale[1]) + 1e9 * (bars2[:, 0] > scale[0])
    cocycle = of2["cocycles"][1][int(ends.argmin())][:, :2] if len(bars2) else np.empty((0, 2), int)
    return Torsion(bars2=bars2, bars3=bars3, scale=scale, cocycle=cocycle)


def double_cover(distances: np.ndarray, found: Torsion) -> np.ndarray:
    """Double cover of a space: two points for each, and one turn of the loop leads to the other.

    It turns chords of a sphere whose ends are interchangeable into chords with distinct ends.

    Args:
        distances: `(K, K)` of the space.
        found: its torsion.

    Returns:
        `(2 K, 2 K)` shortest paths through steps no longer than the middle of the range; k and
        k + K lie over point k. Infinite where there is no path.
    """
    num = len(distances)
    flips = np.zeros((num, num), dtype=bool)
    i, j = found.cocycle.T
    flips[i, j] = flips[j, i] = True
    i, j = np.nonzero((distances <= found.middle) & ~np.eye(num, dtype=bool))
    start = np.concatenate([i, i + num])
    end = np.concatenate([j + num * flips[i, j], j + num * ~flips[i, j]])
    steps = csr_array((np.tile(distances[i, j], 2), (start, end)), shape=(2 * num, 2 * num))
    return dijkstra(steps, directed=False)


def _excess(bars2: np.ndarray, bars3: np.ndarray) -> np.ndarray:
    """The range of scales, longest as a ratio of its ends, on which `bars2` has more bars alive."""
    ends = np.unique(np.concatenate([bars2.ravel(), bars3.ravel()]))

    def alive(bars: np.ndarray) -> np.ndarray:
        return np.sum((bars[:, :1] <= ends) & (ends < bars[:, 1:]), axis=0)

    more = np.concatenate([alive(bars2) > alive(bars3), [False]])
    best, start = np.ones(2), None
    for place, inside in enumerate(more):
        if inside and start is None:
            start = place
        elif not inside and start is not None:
            stretch = ends[[start, place]]
            best = max(best, stretch, key=lambda s: s[1] / s[0])
            start = None
    return best


def _ripser() -> ModuleType:
    try:
        import ripser
    except ImportError:
        raise ImportError(
            "ripser is not installed; torsion needs it: pip install 'selftouch-drake[homology]'"
        ) from None
    return ripser
