"""A soft skin as compiled code reads it: pressure in its tetrahedra, and a grid to find them by."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry import HollowSkin

# m, edge of a cell of the grid.
_CELL = 0.012

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


class SoftSkin(NamedTuple):
    """T tetrahedra in the frame of the link that wears the skin.

    Attributes:
        planes: `(T, 4, 4)` barycentric coordinates, linear in a point: 1/m, and at the origin.
        pressure: `(T, 5)` its gradient, Pa/m, its value at the origin, Pa, and the gradient's norm.
        box: `(T, 6)` m, lowest and highest coordinates.
        origin: `(3,)` m, corner of the grid's first cell.
        shape: `(3,)` numbers of cells.
        cell_ends: `(cells + 1,)` where the tetrahedra of each cell start and end in `cell_tets`.
        cell_tets: the tetrahedra that meet each cell.
    """

    planes: np.ndarray
    pressure: np.ndarray
    box: np.ndarray
    origin: np.ndarray
    shape: np.ndarray
    cell_ends: np.ndarray
    cell_tets: np.ndarray


def soft_skin(wall: HollowSkin, modulus: float) -> SoftSkin:
    """Reads a skin; `modulus` is hydroelastic, in Pa."""
    corners = wall.tet_vertices[wall.tetrahedra]
    ones = np.ones((*corners.shape[:2], 1))
    inverse = np.linalg.inv(np.concatenate([corners, ones], axis=2))
    planes = np.ascontiguousarray(inverse.swapaxes(1, 2))
    at_corners = pressure_at_vertices(wall, modulus)[wall.tetrahedra]
    pressure = np.einsum("tk,tki->ti", at_corners, planes)
    steepness = np.linalg.norm(pressure[:, :3], axis=1)
    box = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    origin = box[:, :3].min(axis=0)
    shape = np.ceil((box[:, 3:].max(axis=0) - origin) / _CELL).astype(np.int64)
    ends = np.zeros(shape.prod() + 1, dtype=np.int64)
    _sort_into_cells(planes, box, origin, shape, ends, np.empty(0, dtype=np.int64))
    ends = np.cumsum(ends)
    tets = np.empty(ends[-1], dtype=np.int64)
    _sort_into_cells(planes, box, origin, shape, ends, tets)
    return SoftSkin(
        planes=planes,
        pressure=np.concatenate([pressure, steepness[:, None]], axis=1),
        box=box,
        origin=origin,
        shape=shape,
        # Filling a cell moved its start to its end.
        cell_ends=np.concatenate([[0], ends[:-1]]),
        cell_tets=tets,
    )


def pressure_at_vertices(wall: HollowSkin, modulus: float) -> np.ndarray:
    """`(V,)` Pa, the pressure that Drake gives each vertex of a skin's tetrahedra."""
    sides = wall.tetrahedra[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3)
    sides, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    boundary = sides[count == 1]
    inner = np.setdiff1d(np.arange(len(wall.tet_vertices)), boundary)
    distance = np.zeros(len(wall.tet_vertices))
    distance[inner] = distance_to_triangles(wall.tet_vertices[inner], wall.tet_vertices[boundary])
    return modulus * distance / distance.max()


def distance_to_triangles(p: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """`(N,)` m, the distance of each point `(N, 3)` to the nearest triangle `(F, 3, 3)`, exact."""
    centres = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - centres[:, None], axis=2).max()
    tree = cKDTree(centres)
    # The nearest triangle's centre is no farther than the nearest centre and the largest radius.
    near = tree.query_ball_point(p, 1.000001 * (tree.query(p)[0] + radius))
    counts = [len(few) for few in near]
    corners = triangles[np.concatenate(near)]
    p = np.repeat(p, counts, axis=0)
    # The nearest point of a triangle is below p, if that is inside, or on an edge.
    along, to_p = np.roll(corners, -1, axis=1) - corners, p[:, None] - corners
    normal = np.cross(along[:, 0], along[:, 1])
    inside = (np.einsum("nki,ni->nk", np.cross(along, to_p), normal) >= 0).all(axis=1)
    share = np.einsum("nki,nki->nk", to_p, along) / np.einsum("nki,nki->nk", along, along)
    to_edges = to_p - np.clip(share, 0, 1)[:, :, None] * along
    height = np.abs(np.einsum("ni,ni->n", to_p[:, 0], normal)) / np.linalg.norm(normal, axis=1)
    distance = np.where(inside, height, np.linalg.norm(to_edges, axis=2).min(axis=1))
    return np.minimum.reduceat(distance, np.cumsum([0, *counts[:-1]]))


# Compiled code is plain loops: numba compiles whole-array expressions for seconds.


@_compiled
def span(low, high, origin, num):
    """The first and the one-past-last cell, along one axis, between two coordinates."""
    first = max(0, int(np.floor((low - origin) / _CELL)))
    return first, min(num, int(np.floor((high - origin) / _CELL)) + 1)


@_compiled
def _sort_into_cells(planes, box, origin, shape, ends, tets):
    """Counts the tetrahedra that meet each cell into `ends`; with room in `tets`, lists them."""
    for t in range(len(box)):
        first_i, last_i = span(box[t, 0], box[t, 3], origin[0], shape[0])
        first_j, last_j = span(box[t, 1], box[t, 4], origin[1], shape[1])
        first_k, last_k = span(box[t, 2], box[t, 5], origin[2], shape[2])
        for i in range(first_i, last_i):
            for j in range(first_j, last_j):
                for k in range(first_k, last_k):
                    if _meets_cell(planes, t, origin, i, j, k):
                        cell = (i * shape[1] + j) * shape[2] + k
                        if len(tets):
                            tets[ends[cell]] = t
                            ends[cell] += 1
                        else:
                            ends[cell + 1] += 1


@_compiled
def _meets_cell(planes, t, origin, i, j, k):
    # A little larger, so that rounding hides no tetrahedron.
    half = 0.500001 * _CELL
    x = origin[0] + (i + 0.5) * _CELL
    y = origin[1] + (j + 0.5) * _CELL
    z = origin[2] + (k + 0.5) * _CELL
    for s in range(4):
        a, b, c, d = planes[t, s, 0], planes[t, s, 1], planes[t, s, 2], planes[t, s, 3]
        if a * x + b * y + c * z + d + half * (abs(a) + abs(b) + abs(c)) < 0:
            return False
    return True


@_compiled
def tets_near(skin, box, look, seen, tets):
    """Lists, each once, the tetrahedra whose boxes meet a box; returns how many there are."""
    num, shape, ends, boxes = 0, skin.shape, skin.cell_ends, skin.box
    first_i, last_i = span(box[0], box[3], skin.origin[0], shape[0])
    first_j, last_j = span(box[1], box[4], skin.origin[1], shape[1])
    first_k, last_k = span(box[2], box[5], skin.origin[2], shape[2])
    if first_k >= last_k:
        return 0
    for i in range(first_i, last_i):
        for j in range(first_j, last_j):
            cell = (i * shape[1] + j) * shape[2]
            # Cells along the last axis follow each other.
            for entry in range(ends[cell + first_k], ends[cell + last_k]):
                tet = skin.cell_tets[entry]
                if seen[tet] == look:
                    continue
                seen[tet] = look
                meets = True
                for axis in range(3):
                    meets &= box[3 + axis] >= boxes[tet, axis]
                    meets &= box[axis] <= boxes[tet, 3 + axis]
                if meets:
                    tets[num] = tet
                    num += 1
    return num
