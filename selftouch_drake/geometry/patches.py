"""The part of a surface that can be touched: a patch with a rim, and its holes.

A back that no hand reaches leaves a hole in what an agent can learn of its torso. The correct
result for the agent is the topology of the touched patch, not that of the whole skin.

Touches are a sample. Gaps between them mean nothing, and the rim of the patch is ragged. So a patch
is defined at a scale, a `radius`: anything smaller than a disc of that radius is neither a hole nor
a part.

Use the distance between neighbouring target sensations on the skin, sqrt(area / K): the agent
resolves nothing finer. It must be wider than random gaps. If n touches are spread evenly over an
area A, the widest empty disc has a radius of about sqrt(A ln(n) / (pi n)): use 1.3 times that if it
is larger. With hundreds of touches per target sensation, it is not.
"""

import math

import numpy as np
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.geometry.geodesics import surface_paths
from selftouch_drake.lazy import trimesh


def touched_patch(
    vertices: np.ndarray,
    faces: np.ndarray,
    touch_counts: np.ndarray,
    *,
    radius: float,
) -> np.ndarray:
    """Finds the vertices of a surface that belong to the touched patch.

    This is a morphological closing of the touched vertices: all vertices within `radius` of a
    touched one are added, then all within `radius` of the remaining ones are removed again, so that
    the rim does not grow. Touches along a line have no area: there the second step is left out, and
    the patch is a band. Parts smaller than a disc of this radius are then dropped.

    The surface of `(V, 3)` m and `(F, 3)` triangles is closed, and finer than the radius, m along
    it; `(V,)` touches are nearest to each vertex. Returns `(V,)` whether it is in the patch.

    Raises:
        ValueError: If `radius` is less than the mean edge: no gap would be closed.
    """
    surface = trimesh.Trimesh(vertices, faces, process=False)
    if not radius >= (edge := surface.edges_unique_length.mean()):
        raise ValueError(
            f"radius is {radius:g} m, less than the mean edge of the surface, {edge:.3g} m; give a "
            "larger radius, or a finer surface"
        )
    paths = surface_paths(surface)

    def within(marked: np.ndarray) -> np.ndarray:
        if not marked.any():
            return marked
        found = dijkstra(paths, indices=np.flatnonzero(marked), limit=radius, min_only=True)
        return np.isfinite(found)

    grown = within(np.asarray(touch_counts) > 0)
    touched = ~within(~grown)
    if not touched[faces].all(axis=1).any():
        touched = grown
    inside = touched[faces].all(axis=1)
    part, num_parts = parts_by_vertex(faces[inside], len(vertices))
    area = np.bincount(
        part[faces[inside][:, 0]], weights=surface.area_faces[inside], minlength=num_parts
    )
    return touched & (area >= math.pi * radius**2)[part]


def betti_of_patch(faces: np.ndarray) -> tuple[int, int, int]:
    """Counts the parts, holes and cavities of a triangle surface, closed or with rims.

    These are the ranks of its homology over Z/2. Parts that meet in a single vertex are one part,
    as in any complex. No edge of the `(F, 3)` faces belongs to more than two of them. A sphere has
    (1, 0, 1), a torus (1, 2, 1), a disc (1, 0, 0), an open tube (1, 1, 0).
    """
    if not len(faces):
        return 0, 0, 0
    edges, edge_of, count = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    corners = np.unique(faces)
    part, _ = parts_by_vertex(faces, corners[-1] + 1)
    num_parts = len(np.unique(part[corners]))
    # A part is closed if it has no rim. Here parts are connected by edges: a sphere that touches a
    # disc in one vertex still has its cavity.
    sheet, num_sheets = parts_by_vertex(edge_of.reshape(-1, 3), len(edges))
    num_cavities = num_sheets - len(np.unique(sheet[count == 1]))
    euler_number = len(corners) - len(edges) + len(faces)
    return num_parts, num_parts + num_cavities - euler_number, num_cavities


def parts_by_vertex(faces: np.ndarray, num_vertices: int) -> tuple[np.ndarray, int]:
    """`(V,)` the connected part of each vertex; number of parts, isolated vertices included."""
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    part = trimesh.graph.connected_component_labels(edges, num_vertices)
    return part, int(part.max()) + 1
