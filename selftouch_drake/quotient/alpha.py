"""The alpha complex of a layout, from which `holes` and `surface` are found.

A ball grows around every point. At each radius, the alpha complex holds the simplices of the
Delaunay triangulation that the balls cover, and has the homology of their union.
"""

from itertools import chain

import numpy as np
from scipy.spatial import Delaunay


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
        levels.append(_faces(points, levels[-1]))
    levels.append({(vertex,): 0.0 for vertex in range(len(points))})
    return dict(chain(*(level.items() for level in reversed(levels))))


def _faces(
    points: np.ndarray, simplices: dict[tuple[int, ...], float]
) -> dict[tuple[int, ...], float]:
    """The faces of some simplices, and the squared radius at which each appears."""
    # Of each face: the corner that each simplex has beside it, and when that simplex appears.
    bounded: dict[tuple[int, ...], list[tuple[int, float]]] = {}
    for simplex, radius2 in simplices.items():
        for corner in simplex:
            face = tuple(other for other in simplex if other != corner)
            bounded.setdefault(face, []).append((corner, radius2))
    number = [len(of_face) for of_face in bounded.values()]
    first = np.cumsum([0, *number[:-1]])
    corners, appear = map(np.array, zip(*chain(*bounded.values()), strict=True))
    centre, own_radius2 = circumspheres(points, np.array(list(bounded)))
    apart = np.square(points[corners] - np.repeat(centre, number, axis=0)).sum(axis=1)
    empty = np.minimum.reduceat(apart, first) >= own_radius2
    radius2_of = np.where(empty, own_radius2, np.minimum.reduceat(appear, first))
    return dict(zip(bounded, radius2_of.tolist(), strict=True))


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
