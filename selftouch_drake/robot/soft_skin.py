"""A soft skin for compiled code: pressure in its tetrahedra, and a grid to find them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.geometry import HollowSkin


class SoftSkin(NamedTuple):
    """T tetrahedra in the frame of the link that wears the skin.

    Attributes:
        corners: `(T, 4, 3)` m.
        planes: `(T, 4, 4)` barycentric coordinates, linear in a point: 1/m, and at the origin.
        pressure: `(T, 5)` its gradient, Pa/m, its value at the origin, Pa, and the gradient's norm.
        box: `(T, 6)` m, lowest and highest coordinates.
        grid: `(4,)` m, corner of the first cell, and edge of a cell.
        shape: `(3,)` numbers of cells.
        cell_ends: `(cells + 1,)` where the tetrahedra of each cell start and end in `cell_tets`.
        cell_tets: the tetrahedra that meet each cell.
    """

    corners: np.ndarray
    planes: np.ndarray
    pressure: np.ndarray
    box: np.ndarray
    grid: np.ndarray
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
    # Cells as large as tetrahedra hold few, and few hold each.
    grid = np.append(box[:, :3].min(axis=0), (box[:, 3:] - box[:, :3]).mean())
    shape = np.ceil((box[:, 3:].max(axis=0) - grid[:3]) / grid[3]).astype(np.int64)
    cell, tet = _cells_of_tets(planes, box, grid, shape)
    return SoftSkin(
        corners=corners,
        planes=planes,
        pressure=np.concatenate([pressure, steepness[:, None]], axis=1),
        box=box,
        grid=grid,
        shape=shape,
        cell_ends=np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=shape.prod()))]),
        cell_tets=tet[np.argsort(cell, kind="stable")],
    )


def pressure_at_vertices(wall: HollowSkin, modulus: float) -> np.ndarray:
    """`(V,)` Pa, the pressure that Drake gives each vertex of a skin's tetrahedra."""
    num = len(wall.vertices)
    boundary = np.concatenate([wall.faces, wall.faces + 2 * num])
    distance = np.zeros(3 * num)
    middle = slice(num, 2 * num)
    distance[middle] = distance_to_triangles(wall.tet_vertices[middle], wall.tet_vertices[boundary])
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


def _cells_of_tets(
    planes: np.ndarray, box: np.ndarray, grid: np.ndarray, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a cell and a tetrahedron that meets it; arguments as of `SoftSkin`."""
    low, high = (np.floor((c - grid[:3]) / grid[3]).astype(int) for c in np.split(box, 2, axis=1))
    low, high = np.maximum(low, 0), np.minimum(high, shape - 1)
    size = high - low + 1
    tet = np.repeat(np.arange(len(box)), size.prod(axis=1))
    number = np.arange(len(tet)) - np.repeat(np.cumsum(size.prod(axis=1)), size.prod(axis=1))
    number += size.prod(axis=1)[tet]
    x, number = np.divmod(number, size[tet, 1] * size[tet, 2])
    at = low[tet] + np.stack([x, *np.divmod(number, size[tet, 2])], axis=1)
    # Highest barycentric coordinates in each cell, taken a little larger, so that rounding hides
    # no tetrahedron.
    half = 0.500001 * grid[3] * np.abs(planes[:, :, :3]).sum(axis=2)
    centre = grid[:3] + (at + 0.5) * grid[3]
    highest = np.einsum("nki,ni->nk", planes[tet, :, :3], centre) + planes[tet, :, 3] + half[tet]
    meets = (highest >= 0).all(axis=1)
    return np.ravel_multi_index(tuple(at[meets].T), tuple(shape)), tet[meets]


@inner
def _span(low, high, origin, cell, num):
    """The first and the one-past-last cell, along one axis, between two coordinates."""
    first = max(0, int(np.floor((low - origin) / cell)))
    return first, min(num, int(np.floor((high - origin) / cell)) + 1)


@compiled
def tets_near(skin, box, look, seen, tets):
    """Lists, each once, the tetrahedra whose boxes meet a box; returns how many there are."""
    num, grid, shape, ends, boxes = 0, skin.grid, skin.shape, skin.cell_ends, skin.box
    first_i, last_i = _span(box[0], box[3], grid[0], grid[3], shape[0])
    first_j, last_j = _span(box[1], box[4], grid[1], grid[3], shape[1])
    first_k, last_k = _span(box[2], box[5], grid[2], grid[3], shape[2])
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
