"""The surface through the kernels: "shaded areas are fitted surfaces" (paper, figure 3; naive)."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.quotient.alpha import alpha_filtration, circumspheres, delaunay
from selftouch_drake.quotient.holes import Topology


def fitted_surface(points: np.ndarray, found: Topology, skin: int = 2) -> np.ndarray:
    """The surface, or the line, through points: `(F, skin + 1)` corners of triangles or segments.

    The `(K, d)` points lie on a skin that is a line (`skin` 1) or a surface (2), and have the
    topology `found`. If they enclose a void, the surface is closed, with corners counterclockwise
    seen from outside. Otherwise its triangles are of the alpha complex, and it may have a rim.
    Errors are as in `delaunay`.
    """
    if found.betti[2]:
        return rolled_surface(points, found.scale)
    # At the scale of a loop's birth some simplices are still missing; two meeting radii cover the
    # part, as when components are counted.
    scale = max(found.scale, 2.0 * found.meeting_radius)
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
    the scale of its topology, in the unit of the `(K, 3)` points. Errors are as in `delaunay`.
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
