"""A surface as fine as touches tell it: a coarse one, split and fitted to where they begin.

How deep touches are on average differs from place to place, by centimetres where the toucher gets
in from one side only. Where they begin does not: there the toucher just reaches the skin. So each
vertex of a coarse mesh goes, along its normal, to the outermost touches about it, as a curved sheet
through them says (moving least squares; Levin, "The approximation power of moving least-squares",
1998). What is connected stays so.
"""

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry.triangles import first_self_intersection
from selftouch_drake.lazy import trimesh as lazy_trimesh

if TYPE_CHECKING:
    import trimesh

# Touches begin at this quantile of their height. On a torus and a cube surfaces are off by 1.9 and
# 2.8 mm with it, by 3.1 and 5.3 with the median, 2.1 and 3.2 with 0.9: a lower one sees how deep
# touches are, and a higher one the errors of a few.
_OUTERMOST = 0.95
# Widths of an edge and of the window about a vertex, in spacings of touches, and the least of both
# as a share of the extent: finer ones show noise, coarser ones cut off edges.
_EDGE, _WINDOW, _LEAST = 2.0, 3.0, 0.02
# Touches in a window: where there are fewer, it grows; more cost time.
_FEWEST, _MOST = 20, 200
# Touches that are so many windows above or below are of another side of the skin.
_OTHER_SIDE = 4.0
# How strongly a sheet is taken for flat: in touches that would say so.
_FLAT = 2.0
# Factors on triangles and windows, until the surface does not cross itself.
_COARSER = 1.0, 1.5, 2.0
# Rounds of fitting, each with a step that evens triangles out.
_ROUNDS, _EVENING = 4, 0.5


def fitted_to_touches(
    mesh: "trimesh.Trimesh", touches: np.ndarray
) -> "tuple[trimesh.Trimesh, float]":
    """The surface, split into smaller triangles, where touches begin.

    Args:
        mesh: a coarse surface near them, closed or with a rim, whose faces look outward.
        touches: `(n, 3)` places of a toucher's centre.

    Returns:
        The surface, and how deep touches lie under it on average. It is the given one if there are
        few touches, or if it would cross itself.
    """
    if len(touches) < _FEWEST:
        return mesh, 0.0
    for coarser in _COARSER:
        fine = _fitted(mesh, touches, coarser)
        if first_self_intersection(np.asarray(fine.vertices), np.asarray(fine.faces)) is None:
            break
    else:
        return mesh, 0.0
    _, nearest = cKDTree(fine.vertices).query(touches)
    off = touches - fine.vertices[nearest]
    return fine, -float(np.einsum("ni,ni->n", off, fine.vertex_normals[nearest]).mean())


def _fitted(mesh: "trimesh.Trimesh", touches: np.ndarray, coarser: float) -> "trimesh.Trimesh":
    """The surface where touches begin, with triangles and windows larger by a factor."""
    spacing = coarser * np.sqrt(mesh.area / len(touches))
    least = coarser * _LEAST * float(np.linalg.norm(mesh.extents))
    _, shared = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    while np.median(mesh.edges_unique_length) > 1.5 * max(_EDGE * spacing, least):
        # Smooth normals keep vertices apart on their way; a mesh that branches has none.
        mesh = mesh.subdivide_loop(iterations=1) if shared.max() <= 2 else mesh.subdivide()
    nearby, window = cKDTree(touches), max(_WINDOW * spacing, least)
    for _ in range(_ROUNDS):
        vertices, normals = np.array(mesh.vertices), np.array(mesh.vertex_normals)
        above = _above(vertices, normals, nearby, window)
        above = (above + _beside(mesh, above)) / 2
        moved = _evened(mesh, vertices + above[:, None] * normals, normals)
        mesh = lazy_trimesh.Trimesh(moved, mesh.faces, process=False)
    return mesh


def _above(vertices: np.ndarray, normals: np.ndarray, nearby: cKDTree, window: float) -> np.ndarray:
    """`(V,)` how far above each vertex, along its normal, touches begin.

    Args:
        vertices: `(V, 3)`.
        normals: `(V, 3)`.
        nearby: the touches.
        window: width of a Gaussian window about a vertex.
    """
    far, near = nearby.query(vertices, k=min(_MOST, nearby.n))
    width = np.maximum(window, far[:, _FEWEST - 1] / 2)[:, None]
    off = nearby.data[near] - vertices[:, None]
    height = np.einsum("vka,va->vk", off, normals)
    across = np.linalg.svd(normals[:, None, :])[2][:, 1:]
    x, y = np.moveaxis(np.einsum("vka,vba->vkb", off, across) / width[:, :, None], 2, 0)
    weight = np.exp(-0.5 * (x * x + y * y)) * (np.abs(height) < _OTHER_SIDE * width)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    weighed = terms * weight[:, :, None]
    square = np.einsum("vka,vkb->vab", weighed, terms)
    square += np.diag([1e-6, 1e-6, 1e-6, _FLAT, _FLAT, _FLAT])
    sheet = np.linalg.solve(square, np.einsum("vka,vk->va", weighed, height)[:, :, None])
    rest = height - (terms @ sheet)[:, :, 0]
    return sheet[:, 0, 0] + _quantile(rest, weight)


def _quantile(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """`(V,)` where touches begin among the `(V, k)` values of each row."""
    order = np.argsort(values, axis=1)
    share = np.cumsum(np.take_along_axis(weight, order, axis=1), axis=1)
    number = (share < _OUTERMOST * share[:, -1:]).sum(axis=1).clip(0, values.shape[1] - 1)
    found = np.take_along_axis(order, number[:, None], axis=1)
    return np.take_along_axis(values, found, axis=1)[:, 0]


def _evened(mesh: "trimesh.Trimesh", vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Vertices, moved along the surface towards the middle of their neighbours; rims stay."""
    step = _beside(mesh, vertices) - vertices
    step -= np.einsum("vi,vi->v", step, normals)[:, None] * normals
    step[rim(mesh)] = 0.0
    return vertices + _EVENING * step


def rim(mesh: "trimesh.Trimesh") -> np.ndarray:
    """Numbers of the vertices at which a surface ends."""
    once = lazy_trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    return np.unique(np.asarray(mesh.edges)[once])


def _beside(mesh: "trimesh.Trimesh", values: np.ndarray) -> np.ndarray:
    """`(V, ...)` means of values over the neighbours of each vertex."""
    ends = np.asarray(mesh.edges_unique)
    count = np.bincount(ends.ravel(), minlength=len(values)).clip(1)
    total = np.zeros_like(values)
    np.add.at(total, ends[:, 0], values[ends[:, 1]])
    np.add.at(total, ends[:, 1], values[ends[:, 0]])
    return (total.T / count).T
