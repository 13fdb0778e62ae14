"""Components, loops and voids of the recovered body: persistent homology (paper, section IV).

A ball grows round every point. The alpha complex holds, at each radius, the parts of the Delaunay
triangulation that the balls cover, and has the homology of their union. A bar is a loop (H1) or a
void (H2) that is born at one radius and filled at another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import Delaunay

#: Bars that persist over less than this ratio of radii are never holes: four points at the corners
#: of a square make a loop of ratio sqrt(2).
LEAST_RATIO = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Topology:
    """What persistent homology tells of a body.

    Attributes:
        betti: numbers of components, loops and voids: (1, 0, 1) for a ball's surface, (1, 2, 1)
            for a torus.
        margin: ratio of the weakest true bar over the strongest false one; the closer to 1, the
            less sure.
        scale: radius at which all true bars live, in the unit of the points.
        diagram: three arrays `(bars, 2)` of births and deaths, for H0, H1 and H2.
    """

    betti: tuple[int, int, int]
    margin: float
    scale: float
    diagram: tuple[np.ndarray, np.ndarray, np.ndarray]


def topology(points: np.ndarray) -> Topology:
    """Counts components, loops and voids of the body that points are laid out on.

    The length of a bar is the ratio of death over birth, so that it has no unit: a loop round an
    evenly sampled body is born when neighbours meet (half their distance) and dies when the balls
    fill it (its radius), whatever the body's size. A false bar lives between the edges of one
    polygon and its fill, at a ratio of 1 to 1.5. All bars of H1 and H2 are pooled and sorted; the
    widest gap between ratios parts the true from the false, unless even the strongest bar is
    below `LEAST_RATIO`, when there is no hole. Components are counted at the scale at which all
    true bars live, since a bar of H0 has no birth.

    Args:
        points: `(K, 3)`, of no common plane, evenly spread.
    """
    return read_topology(alpha_persistence(points))


def read_topology(diagram: Sequence[np.ndarray]) -> Topology:
    """Parts the true bars of a persistence diagram from the false ones, as `topology` says."""
    h0, h1, h2 = diagram
    bars = np.concatenate([h1, h2])
    ratio = bars[:, 1] / np.maximum(bars[:, 0], np.finfo(float).tiny)
    falling = np.concatenate([np.sort(ratio)[::-1], [1.0]])
    gap = falling[:-1] / falling[1:]
    num_true = 0 if falling[0] < LEAST_RATIO else 1 + int(gap.argmax())
    least = falling[num_true - 1] if num_true else np.inf
    true = bars[ratio >= least]
    if num_true:
        margin = float(gap[num_true - 1])
        scale = float(np.sqrt(true[:, 0].max() * true[:, 1].min()))
    else:
        margin = float(LEAST_RATIO / falling[0])
        scale = float(np.max(h0[np.isfinite(h0[:, 1]), 1], initial=0.0))
    loops = int(np.sum(h1[:, 1] / np.maximum(h1[:, 0], np.finfo(float).tiny) >= least))
    components = int(np.sum(h0[:, 1] > scale))
    return Topology(
        betti=(components, loops, num_true - loops), margin=margin, scale=scale, diagram=(h0, h1, h2)
    )


def alpha_persistence(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Computes the persistence diagram of the alpha filtration of points in space.

    Args:
        points: `(K, 3)`, at least 5, of no common plane.

    Returns:
        Three arrays `(bars, 2)`, births and deaths in the unit of the points, for H0, H1 and H2;
        bars of no length are left out, one component never dies (infinity).

    Raises:
        ValueError: the points are too few or lie in a plane.
    """
    simplices, radius = alpha_filtration(points)
    order = sorted(range(len(simplices)), key=lambda s: (radius[s], len(simplices[s])))
    position = {simplices[s]: place for place, s in enumerate(order)}
    size = [len(simplices[s]) for s in order]
    boundary = [
        [position[face] for face in combinations(simplices[s], size[place] - 1) if face]
        for place, s in enumerate(order)
    ]
    born = np.sqrt([radius[s] for s in order])
    pairs, alive = _reduce(boundary, size)
    bars: list[list[tuple[float, float]]] = [[], [], []]
    for birth, death in pairs:
        if born[death] > born[birth]:
            bars[size[birth] - 1].append((born[birth], born[death]))
    for birth in alive:
        bars[size[birth] - 1].append((born[birth], np.inf))
    h0, h1, h2 = (np.array(sorted(b), dtype=float).reshape(-1, 2) for b in bars)
    return h0, h1, h2


def alpha_filtration(points: np.ndarray) -> tuple[list[tuple[int, ...]], list[float]]:
    """The simplices of the alpha complex and the squared radius at which each appears.

    A simplex appears when the balls of its corners meet in a point that no nearer ball owns: at
    the radius of its smallest circumsphere if that holds no other point, else with the first of
    the simplices that it bounds.

    Returns:
        Simplices as sorted tuples of points, corners first, and their squared radii.
    """
    tetrahedra = delaunay(points)
    levels = [{tuple(t): r for t, r in zip(tetrahedra.tolist(), _radius2(points, tetrahedra), strict=True)}]
    for size in (3, 2):
        cofaces: dict[tuple[int, ...], list[tuple[tuple[int, ...], float]]] = {}
        for simplex, value in levels[-1].items():
            for face in combinations(simplex, size):
                cofaces.setdefault(face, []).append((simplex, value))
        faces = np.array(list(cofaces))
        own, centre = _radius2(points, faces), _centre(points, faces)
        level = {}
        for face, r, c in zip(cofaces, own.tolist(), centre, strict=True):
            above = cofaces[face]
            opposite = [next(v for v in simplex if v not in face) for simplex, _ in above]
            gap2 = np.square(points[opposite] - c).sum(axis=1)
            level[face] = r if gap2.min() >= r * (1 - 1e-9) else min(v for _, v in above)
        levels.append(level)
    corners = {(v,): 0.0 for v in range(len(points))}
    simplices: list[tuple[int, ...]] = []
    radius: list[float] = []
    for level in (corners, *reversed(levels)):
        simplices += level
        radius += level.values()
    return simplices, radius
