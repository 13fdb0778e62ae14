"""The surface or line through the recovered body (paper, figure 3: "shaded areas are fitted")."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.shape.homology import (
    Topology,
    alpha_filtration,
    circumspheres,
    delaunay,
)


def fitted_surface(points: np.ndarray, found: Topology) -> np.ndarray:
    """Finds the surface through the points: closed if they enclose a void, else with a rim.

    Args:
        points: `(K, d)`, of a surface.
        found: the topology of these points.

    Returns:
        `(F, 3)` corners of each triangle; counterclockwise seen from outside if it is closed.

    Raises:
        ValueError: the points are too few or lie in a plane.
    """
    if found.betti[2]:
        return rolled_surface(points, found.scale)
    return alpha_simplices(points, covering_scale(found), 3)


def fitted_line(points: np.ndarray, found: Topology) -> np.ndarray:
    """`(E, 2)` steps of the line through `(K, 2)` points with this topology.

    Raises:
        ValueError: the points are too few or lie in a line.
    """
    return alpha_simplices(points, covering_scale(found), 2)


def covering_scale(found: Topology) -> float:
    """The radius at which balls around the points cover the part.

    At the scale of a loop's birth some simplices are still missing; two spacings cover the part, as
    when components are counted.
    """
    return max(found.scale, 2.0 * found.spacing)


def alpha_simplices(points: np.ndarray, scale: float, size: int) -> np.ndarray:
    """`(N, size)` simplices of the alpha complex of `(K, d)` points at a scale; may have a rim.

    Raises:
        ValueError: the points are too few or do not spread.
    """
    simplices = [
        simplex
        for simplex, radius2 in zip(*alpha_filtration(points), strict=True)
        if len(simplex) == size and radius2 <= scale**2
    ]
    return np.array(simplices, dtype=int).reshape(-1, size)


def rolled_surface(points: np.ndarray, scale: float) -> np.ndarray:
    """Finds the surface on which a ball rolls around the points without falling between them.

    The ball comes from far away and moves from one Delaunay tetrahedron to the next through every
    triangle that is wider than itself. Triangles that stop it are the surface. It is closed, and
    has the loops of the body if the radius is the scale of its topology.

    Args:
        points: `(K, 3)`.
        scale: radius of the ball, in the unit of the points: `Topology.scale`.

    Returns:
        `(F, 3)` corners of each triangle, counterclockwise seen from outside.

    Raises:
        ValueError: `scale` is not positive, or the points are too few or lie in a plane.
    """
    if not scale > 0:
        raise ValueError(f"scale is {scale}: give a positive radius, such as Topology.scale")
    points, tetrahedra = delaunay(points)
    num_tetrahedra = len(tetrahedra)
    # Face f of tetrahedron t is opposite its corner f.
    corner = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    faces = tetrahedra[:, corner].reshape(-1, 3)
    owner = np.repeat(np.arange(num_tetrahedra), 4)
    inner = tetrahedra.ravel()

    order = np.lexsort(faces.T)
    same = (faces[order][1:] == faces[order][:-1]).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    hull = np.setdiff1d(order, np.concatenate([first, second]))

    # The outside, beyond the hull, is one more cell.
    beyond = np.full(len(hull), num_tetrahedra)
    face = np.concatenate([first, second, hull])
    here = owner[face]
    there = np.concatenate([owner[second], owner[first], beyond])
    _, radius2 = circumspheres(points, faces[face])
    passed = radius2 > scale**2
    links = csr_array(
        (np.ones(passed.sum()), (here[passed], there[passed])), shape=(num_tetrahedra + 1,) * 2
    )
    _, cell = connected_components(links, directed=False)
    outside = cell == cell[-1]
    shown = face[~outside[here] & outside[there]]
    return _outward(points, faces[shown], points[inner[shown]])


def _outward(points: np.ndarray, faces: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Orders corners so that normals point away from the `(F, 3)` points inside."""
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), inside - a) > 0
    faces = faces.copy()
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return faces
