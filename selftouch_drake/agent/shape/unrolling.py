"""Loops that come undone only when gone round several times: torsion of the quotient space.

A loop that no surface fills, while going round it twice (or four times) is filled, is a loop to
coefficients in Z/2 and none to coefficients in Z/3. Two fingers make one: turn the hand until each
finger is where the other was, and all feels as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.geometry.farthest import farthest_points

#: Points that loops are looked for on. Their covers hold two and four times as many.
_NUM_LANDMARKS = 300

#: Least stretch of scale, as a ratio, over which a loop must be one to Z/2 and none to Z/3. Ties
#: and rounding make stretches up to 1.05 on spaces without torsion.
_LEAST_STRETCH = 1.1

#: A loop of twice the length dies at twice the scale: how far the torsion of a cover is looked for.
_LARGEST = 2.2
_MOST_COVERS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Torsion:
    """What coefficients in Z/2 see of a space and those in Z/3 do not.

    Attributes:
        bars2: `(bars, 2)` births and deaths of loops to coefficients in Z/2.
        bars3: the same to coefficients in Z/3.
        scale: `(2,)` ends of the longest stretch of scale on which there are more loops to Z/2.
        cocycle: `(E, 2)` pairs of points, the turns: going along these steps counts one half.
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
        """A scale amid the stretch, at which the sample covers the space and its loop is open."""
        return float(np.sqrt(self.scale.prod()))

    @property
    def found(self) -> bool:
        """Whether the stretch is longer than chance makes it."""
        return self.stretch >= _LEAST_STRETCH


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turns:
    """How many turns a loop takes to come undone.

    Attributes:
        order: 1 if every loop of chance aside is free or none, else 2, 4 or 8.
        covers: the torsion of the space, of its double cover, and so on, to the first with none.
        distances: `(2^n K, 2^n K)` along the last cover; point k lies over k + K, k + 2 K, ... too.
    """

    order: int
    covers: tuple[Torsion, ...]
    distances: np.ndarray


def turns(distances: np.ndarray) -> Turns:
    """Counts the turns after which a loop comes undone, by unrolling the space again and again.

    A loop of order 2 and one of order 4 look alike to Z/2 and to Z/3. But a double cover, in which
    one turn leads to another point, has the loop of two turns left: a loop of order 1 or 2.

    Args:
        distances: `(K, K)` symmetric, finite; of a few hundred points, as the last cover is four
            times as large: `landmarks` chooses.

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
    """Picks points one by one, each the farthest from all before, beginning with point 0.

    Args:
        distances: `(K, K)`.
        num_landmarks: fewer are returned when there are fewer points.
    """
    return farthest_points(lambda point: distances[point], num_landmarks)


def torsion(distances: np.ndarray, largest: float = np.inf) -> Torsion:
    """Compares the loops of the Rips complex to coefficients in Z/2 and in Z/3.

    By the theorem of universal coefficients the number of loops to Z/p is that of free loops, plus
    one for each cyclic part of the first homology whose order p divides. So where Z/2 counts more
    than Z/3, some loop is undone by an even number of turns. Loops of chance, that a ragged sample
    leaves, are free: both count them alike, and their difference does not see them.

    Args:
        distances: `(K, K)` symmetric, finite.
        largest: scale at which to stop looking.

    Raises:
        ImportError: ripser is not installed.
        ValueError: distances are not finite.
    """
    if not np.isfinite(distances).all():
        raise ValueError("distances hold NaN or infinity: connect the quotient graph first.")
    ripser = _ripser().ripser
    # Beyond this radius all is one cone, and no loop lives.
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
    # The loop that is filled where the stretch ends; it was born before the stretch began.
    ends = np.abs(bars2[:, 1] - scale[1]) + 1e9 * (bars2[:, 0] > scale[0])
    cocycle = of2["cocycles"][1][int(ends.argmin())][:, :2] if len(bars2) else np.empty((0, 2), int)
    return Torsion(bars2=bars2, bars3=bars3, scale=scale, cocycle=cocycle)


def double_cover(distances: np.ndarray, found: Torsion) -> np.ndarray:
    """Unrolls a space twice: two points for each, and a turn of the loop leads to the other.

    Of chords on a sphere whose ends are not told apart it makes chords whose ends are.

    Args:
        distances: `(K, K)` that `found` was found on.
        found: its torsion.

    Returns:
        `(2 K, 2 K)` shortest paths through steps no longer than the middle of the stretch; point k
        lies over k and over k + K. Infinite where there is no path.
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
    """The stretch of scale, longest as a ratio, on which more bars of the first kind live."""
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
            "persistent homology to other coefficients needs ripser: "
            "pip install 'selftouch-drake[homology]'"
        ) from None
    return ripser
