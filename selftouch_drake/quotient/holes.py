"""Components, loops, voids and the surface of the recovered body, by its alpha complex.

A ball grows around every point. At each radius, the alpha complex holds the simplices of the
Delaunay triangulation that the balls cover, and has the homology of their union. A bar is a loop
(H1) or a void (H2) that is born at one radius and filled at another (paper, section IV). The fitted
surface is that of figure 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

#: Bars between these lengths, in spacings, may be true or false.
_UNSURE = (1.0, 1.3)

#: Length that stands for a missing bar, and the margin where no bar is false.
_NO_LENGTH, _MOST_MARGIN = 1e-100, 100.0

#: Bars born later than this, in spacings, are not holes of the body. On sampled surfaces, loops are
#: born when neighbours meet, measured at 1 to 1.4, and voids when faces close, at 1.7 to 2.5.
_LATE = 4.0

#: Neighbours from which the spacing around a point is measured.
_NEIGHBOURS = 8

#: A component, loop or void: squared radii of its birth and death, and what fills it.
Bar = tuple[float, float, tuple[int, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Topology:
    """What persistent homology finds in a body.

    Attributes:
        betti: numbers of components, loops and voids: (1, 0, 1) for a ball's surface, (1, 2, 1)
            for a torus, (1, 1, 0) for a ring; a plane has no voids.
        margin: length of the shortest true bar over the longest false one, at most 100; near 1
            means unsure.
        scale: radius at which every true bar has just been born, in the unit of the points.
        spacing: radius at which neighbours meet, in the unit of the points.
        diagram: three arrays `(bars, 2)` of births and deaths, for H0, H1 and H2, without bars of
            zero length; one component never dies (infinity).
    """

    betti: tuple[int, int, int]
    margin: float
    scale: float
    spacing: float
    diagram: tuple[np.ndarray, np.ndarray, np.ndarray]


def topology(points: np.ndarray) -> Topology:
    """Counts components, loops and voids of the body that the points sample.

    Bars are measured in spacings, so neither the size nor the unit of the body matters. Let r be
    the radius at which neighbours meet (the median death of H0). On an evenly sampled surface the
    balls leave a false loop inside each polygon of neighbours: of length 0.4 r for a square, 0.7 r
    for a pentagon, r where one or two kernels are missing, 1.3 r where three are. A hole of the
    body dies at its own radius, however fine the sampling. So bars below r are false, bars above
    1.3 r are true, and the widest gap in between decides. The widest gap overall would not work,
    since holes of one body may differ greatly in size.

    Where the points around the place at which a bar dies are farther apart than the median, r is
    larger in proportion: a wide stretch of skin that feels alike leaves a gap that is no hole. A
    closed surface has its void when its last gap is filled. So a loop that dies before the void is
    born is a gap, however long its bar. Bars born late are ignored: the void of a bowl, whose mouth
    closes before the bowl is filled, does not count. Components are counted at a radius at which
    all true bars are born and no missing kernel splits the body.

    The `(K, d)` points, d = 2 or 3, are evenly spread over the body. Errors are as of `delaunay`.
    """
    found = _bars(points)
    h0, h1, h2 = (
        np.sqrt(np.array([bar[:2] for bar in some], dtype=float).reshape(-1, 2)) for some in found
    )
    spacing = float(np.median(h0[:, 1]))
    bars = np.concatenate([h1, h2])
    # How much wider than the median points lie around the places where bars die.
    around = spacings(points, _NEIGHBOURS)
    around = np.maximum(around / np.median(around), 1.0)
    sparsity = np.array([around[list(filled_by)].max() for *_, filled_by in found[1] + found[2]])
    length = (bars[:, 1] - bars[:, 0]) / spacing / sparsity
    early = bars[:, 0] <= _LATE * spacing
    voids = h2[(early & (length > _UNSURE[1]))[len(h1) :]]
    closed = voids[:, 0].min() if len(voids) else 0.0
    gap = bars[:, 1] <= closed
    least, margin = _least_true(length[early & ~gap], length[gap].max(initial=0.0))
    true = early & ~gap & (length >= least)
    loops = int(true[: len(h1)].sum())
    covered = 2.0 * spacing
    last_birth = float(bars[true, 0].max()) if true.any() else covered
    return Topology(
        betti=(int(np.sum(h0[:, 1] > max(last_birth, covered))), loops, int(true.sum()) - loops),
        margin=margin,
        scale=1.01 * last_birth,
        spacing=spacing,
        diagram=(h0, h1, h2),
    )


def spacings(points: np.ndarray, num_neighbours: int) -> np.ndarray:
    """`(K,)` the spacing around each of `(K, d)` points: median distance to its neighbours."""
    neighbours = min(num_neighbours, len(points) - 1)
    distance, _ = cKDTree(points).query(points, neighbours + 1)
    return np.median(distance[:, 1:], axis=1)


def _least_true(length: np.ndarray, longest_gap: float) -> tuple[float, float]:
    """Splits bar lengths, in spacings; returns the shortest true one and the margin.

    If no bar is true, the first is infinite, and the margin is that of a bar just long enough. The
    margin counts the longest bar that is surely false.
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
            of_dimension.append((radius2[birth], np.inf, ()))
        elif radius2[death] > radius2[birth]:
            of_dimension.append((radius2[birth], radius2[death], simplices[death]))
    for some in bars:
        some.sort()
    return bars


def alpha_filtration(points: np.ndarray) -> dict[tuple[int, ...], float]:
    """The simplices of the alpha complex, and the squared radius at which each appears.

    A simplex, a sorted tuple of point indices, appears at the radius of its smallest circumsphere
    if that is empty, else together with the first of the simplices that it bounds.
    """
    found = delaunay(points)
    points, largest = found.points, np.sort(found.simplices, axis=1)
    radius2 = circumspheres(points, largest)[1]
    levels = [dict(zip(map(tuple, largest.tolist()), radius2.tolist(), strict=True))]
    for _ in range(points.shape[1] - 1):
        above: dict[tuple[int, ...], list[tuple[int, float]]] = {}
        for simplex, value in levels[-1].items():
            for left_out in simplex:
                face = tuple(v for v in simplex if v != left_out)
                above.setdefault(face, []).append((left_out, value))
        centre, radius2 = circumspheres(points, np.array(list(above)))
        number = [len(bounded) for bounded in above.values()]
        opposite, bounding = map(np.array, zip(*chain(*above.values()), strict=True))
        apart = np.square(points[opposite] - np.repeat(centre, number, axis=0)).sum(axis=1)
        first = np.cumsum([0, *number[:-1]])
        empty = np.minimum.reduceat(apart, first) >= radius2
        value2 = np.where(empty, radius2, np.minimum.reduceat(bounding, first))
        levels.append(dict(zip(above, value2.tolist(), strict=True)))
    levels.append({(vertex,): 0.0 for vertex in range(len(points))})
    return dict(chain(*(level.items() for level in reversed(levels))))


def delaunay(points: np.ndarray) -> Delaunay:
    """Triangulates `(K, d)` points, d = 2 or 3, jittered by 1e-6 of their extent.

    So they are in general position; its `points` are the moved ones.

    Raises:
        ValueError: the points are too few, not finite, or do not spread.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) < 5:
        raise ValueError(
            f"points have shape {points.shape}: give at least 5 points, as (K, 2) or (K, 3)"
        )
    if not np.isfinite(points).all():
        raise ValueError("points hold NaN or infinity: embed the representation first")
    if flat(points):
        raise ValueError(
            f"points lie in a {'line' if points.shape[1] == 2 else 'plane'}: give points that "
            f"spread in {points.shape[1]} dimensions"
        )
    jitter = np.random.default_rng(0).uniform(-1e-6, 1e-6, points.shape) * np.ptp(points)
    return Delaunay(points + jitter)


def flat(points: np.ndarray) -> bool:
    """Whether `(K, d)` points lie in fewer than d dimensions, and so have no alpha complex."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extent[-1] < 1e-6 * extent[0])


def circumspheres(points: np.ndarray, simplices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres `(N, d)` and squared radii `(N,)` of the smallest spheres through the corners.

    Simplices have 2 to d + 1 of the `(K, d)` points as corners.
    """
    first = points[simplices[:, 0]]
    sides = points[simplices[:, 1:]] - first[:, None]
    half = np.square(sides).sum(axis=2)[..., None] / 2
    if sides.shape[1] == sides.shape[2]:
        # Not by the products of the sides: those of a very flat tetrahedron are singular.
        centre = np.linalg.solve(sides, half)[..., 0]
    else:
        gram = np.einsum("nix,njx->nij", sides, sides)
        centre = np.einsum("nix,ni->nx", sides, np.linalg.solve(gram, half)[..., 0])
    return first + centre, np.square(centre).sum(axis=1)


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


def fitted_surface(points: np.ndarray, found: Topology, skin: int = 2) -> np.ndarray:
    """`(F, skin + 1)` corners of the triangles, or steps, through `(K, d)` points of a skin.

    If they enclose a void, it is closed, and corners are counterclockwise seen from outside; else
    it is of the alpha complex and may have a rim.

    They are of a line (`skin` 1) or of a surface (2), and have the topology `found`. Errors are as
    of `delaunay`.
    """
    if found.betti[2]:
        return rolled_surface(points, found.scale)
    # At the scale of a loop's birth some simplices are still missing; two spacings cover the part,
    # as when components are counted.
    scale = max(found.scale, 2.0 * found.spacing)
    simplices = [
        simplex
        for simplex, radius2 in alpha_filtration(points).items()
        if len(simplex) == skin + 1 and radius2 <= scale**2
    ]
    return np.array(simplices, dtype=int).reshape(-1, skin + 1)


def rolled_surface(points: np.ndarray, scale: float) -> np.ndarray:
    """Finds the surface on which a ball rolls around the points without falling between them.

    The ball comes from far away and moves from one Delaunay tetrahedron to the next through every
    triangle that is wider than itself. Triangles that stop it, `(F, 3)` corners counterclockwise
    seen from outside, are the surface. It is closed, and has the loops of the body if the radius is
    the scale of its topology, in the unit of the `(K, 3)` points. Errors are as of `delaunay`.
    """
    found = delaunay(points)
    points, tetrahedra = found.points, found.simplices
    # Face f of tetrahedron t is opposite its corner f.
    faces = tetrahedra[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3)
    inner, here = tetrahedra.ravel(), np.repeat(np.arange(len(tetrahedra)), 4)
    # The outside, beyond the hull, is one more cell.
    there = np.where(found.neighbors < 0, len(tetrahedra), found.neighbors).ravel()
    passed = circumspheres(points, faces)[1] > scale**2
    links = csr_array(
        (np.ones(passed.sum()), (here[passed], there[passed])), shape=(len(tetrahedra) + 1,) * 2
    )
    _, cell = connected_components(links, directed=False)
    outside = cell == cell[-1]
    shown = ~outside[here] & outside[there]
    faces = faces[shown]
    # Normals point away from the corner inside.
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), points[inner[shown]] - a) > 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return faces
