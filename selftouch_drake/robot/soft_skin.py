"""A soft skin for compiled code: pressure in its tetrahedra, a grid to find them, and receptors.

Receptors feel a force inside the wall as `ReceptiveFields.weights_at` says; the nearest centroid is
found among the few that may be the nearest to a point of a tetrahedron.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.geometry.triangles import counted
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.skins import SkinModel


class SoftSkin(NamedTuple):
    """T tetrahedra, and F triangles of receptive fields, in the frame of the link with the skin.

    Attributes:
        corners: `(T, 4, 3)` m.
        planes: `(T, 4, 4)` barycentric coordinates, linear in a point: 1/m, and at the origin.
        pressure: `(T, 5)` its gradient, Pa/m, its value at the origin, Pa, and the gradient's norm.
        box: `(T, 6)` m, lowest and highest coordinates.
        grid: `(4,)` m, corner of the first cell, and edge of a cell.
        shape: `(3,)` numbers of cells.
        cell_ends: `(cells + 1,)` where the tetrahedra of each cell start and end in `cell_tets`.
        cell_tets: the tetrahedra that meet each cell.
        nearest_ends: `(T + 1,)` where the faces of each tetrahedron of the skin start and end in
            `nearest_faces`.
        nearest_faces: faces whose centroid may be the nearest to a point of that tetrahedron.
        centroid: `(F, 3)` m.
        barycentric: `(F, 3, 4)` weights of a face's corners, linear in a point: 1/m, and at the
            origin.
        faces: `(F, 3)` corners.
        weight_ends: where the receptors of each corner start and end in the two below.
        weight_receptor: receptors that feel at each corner, as columns of a sensation.
        weight: their shares.
    """

    corners: np.ndarray
    planes: np.ndarray
    pressure: np.ndarray
    box: np.ndarray
    grid: np.ndarray
    shape: np.ndarray
    cell_ends: np.ndarray
    cell_tets: np.ndarray
    nearest_ends: np.ndarray
    nearest_faces: np.ndarray
    centroid: np.ndarray
    barycentric: np.ndarray
    faces: np.ndarray
    weight_ends: np.ndarray
    weight_receptor: np.ndarray
    weight: np.ndarray


def soft_skin(skin: SkinModel, first_receptor: int = 0) -> SoftSkin:
    """Reads a skin whose readings start at `first_receptor` in a sensation."""
    wall, fields = skin.wall, skin.fields
    corners = wall.tet_vertices[wall.tetrahedra]
    ones = np.ones((*corners.shape[:2], 1))
    inverse = np.linalg.inv(np.concatenate([corners, ones], axis=2))
    planes = np.ascontiguousarray(inverse.swapaxes(1, 2))
    # As Drake does: zero on the boundary, and in proportion to the distance at mid-depth.
    num = len(wall.vertices)
    boundary = np.concatenate([wall.faces, wall.faces + 2 * num])
    distance, middle = np.zeros(3 * num), slice(num, 2 * num)
    distance[middle] = distance_to_triangles(wall.tet_vertices[middle], wall.tet_vertices[boundary])
    at_vertices = skin.hydroelastic_modulus * distance / distance.max()
    pressure = np.einsum("tk,tki->ti", at_vertices[wall.tetrahedra], planes)
    steepness = np.linalg.norm(pressure[:, :3], axis=1)
    box = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    # Cells as large as tetrahedra hold few, and few hold each.
    grid = np.append(box[:, :3].min(axis=0), (box[:, 3:] - box[:, :3]).mean())
    shape = np.ceil((box[:, 3:].max(axis=0) - grid[:3]) / grid[3]).astype(np.int64)
    cell, tet = _cells_of_tets(planes, box, grid, shape)
    centroid = fields.vertices[fields.faces].mean(axis=1)
    nearest_ends, nearest_faces = _nearest_faces(corners, centroid)
    return SoftSkin(
        corners=corners,
        planes=planes,
        pressure=np.concatenate([pressure, steepness[:, None]], axis=1),
        box=box,
        grid=grid,
        shape=shape,
        cell_ends=np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=shape.prod()))]),
        cell_tets=tet[np.argsort(cell, kind="stable")],
        nearest_ends=nearest_ends,
        nearest_faces=nearest_faces,
        centroid=centroid,
        barycentric=fields.barycentric,
        faces=fields.faces.astype(np.int64),
        weight_ends=fields.vertex_weights.indptr.astype(np.int64),
        weight_receptor=fields.vertex_weights.indices.astype(np.int64) + first_receptor,
        weight=np.asarray(fields.vertex_weights.data, dtype=float),
    )


def distance_to_triangles(p: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """`(N,)` m, the distance of each point `(N, 3)` to the nearest triangle `(F, 3, 3)`, exact."""
    centres = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - centres[:, None], axis=2).max()
    tree = cKDTree(centres)
    # The nearest triangle's centre is no farther than the nearest centre and the largest radius.
    near = tree.query_ball_point(p, 1.000001 * (tree.query(p)[0] + radius))
    counts = [len(few) for few in near]
    p = np.repeat(p, counts, axis=0)
    nearest = trimesh.triangles.closest_point(triangles[np.concatenate(near)], p)
    distance = np.linalg.norm(nearest - p, axis=1)
    return np.minimum.reduceat(distance, np.cumsum([0, *counts[:-1]]))


def _cells_of_tets(
    planes: np.ndarray, box: np.ndarray, grid: np.ndarray, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a cell and a tetrahedron that meets it; arguments as in `SoftSkin`."""
    low, high = (np.floor((c - grid[:3]) / grid[3]).astype(int) for c in np.split(box, 2, axis=1))
    low, high = np.maximum(low, 0), np.minimum(high, shape - 1)
    size = high - low + 1
    tet, number = counted(size.prod(axis=1))
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


def _nearest_faces(corners: np.ndarray, centroid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the faces of each tetrahedron end, and the faces; arguments as in `SoftSkin`."""
    # Three tetrahedra, half a prism of a wall, share one search for faces in reach: for at least
    # all that may be nearest to one of their points.
    prisms = corners.reshape(-1, 12, 3)
    middle, tree = prisms.mean(axis=1), cKDTree(centroid)
    radius = np.linalg.norm(prisms - middle[:, None], axis=2).max(axis=1)
    reach = 1.000001 * (tree.query(middle)[0] + 2 * radius)
    near = tree.query_ball_point(middle, reach, return_sorted=True)
    near_ends = np.cumsum([0, *map(len, near)])
    return _listed_nearest(corners, centroid, np.concatenate(near).astype(np.int64), near_ends)


@compiled
def _listed_nearest(corners, centroid, near, near_ends):
    ends = np.zeros(len(corners) + 1, dtype=np.int64)
    # A total that starts as a literal would make numba compile `_list_nearest` twice.
    faces, total = np.empty(3 * len(near), dtype=np.int64), np.int64(0)
    squares = np.empty((len(centroid), 5))
    for tet in range(len(corners)):
        some = near[near_ends[tet // 3] : near_ends[tet // 3 + 1]]
        total = _list_nearest(corners, tet, centroid, some, squares, faces, total)
        ends[tet + 1] = total
    return ends, faces[:total]


@inner
def _list_nearest(corners, tet, centroid, near, squares, faces, total):
    """Appends to `faces` those that may be nearest to a point of one tetrahedron.

    A face is left out if another one is nearer to all four corners: so it is to all points.
    """
    best: int | np.int64 = np.int64(0)
    for n in range(len(near)):
        squares[n, 4] = 0.0
        for k in range(4):
            squares[n, k] = 0.0
            for i in range(3):
                squares[n, k] += (centroid[near[n], i] - corners[tet, k, i]) ** 2
            squares[n, 4] += squares[n, k]
        if squares[n, 4] < squares[best, 4]:
            best = n
    start = total
    for n in range(len(near)):
        if not _nearer(squares, best, n):
            faces[total] = n
            total += 1
    kept = start
    for n in range(start, total):
        beaten = False
        for other in range(start, total):
            beaten |= _nearer(squares, faces[other], faces[n])
        # A face that is beaten stays in the comparison: being nearer is transitive.
        squares[faces[n], 4] = -1.0 if beaten else 1.0
    for n in range(start, total):
        if squares[faces[n], 4] > 0:
            faces[kept] = near[faces[n]]
            kept += 1
    return kept


@inner
def _nearer(squares, a, b):
    nearer = True
    for k in range(4):
        nearer &= squares[a, k] < 0.999999 * squares[b, k]
    return nearer


@compiled
def add_load(skin, tet, place, force, parts, load, loaded, num_loaded):
    """Spreads a force, N, at a place `(3,)` m in a tetrahedron over corners of the nearest face.

    It is added to the load `(V,)` N of each corner. The first `num_loaded` entries of `loaded` are
    the corners that bear something; returns their number then. `parts` is `(3,)` scratch space.
    """
    x, y, z, w, centroid = place[0], place[1], place[2], skin.barycentric, skin.centroid
    best, f = np.inf, 0
    for n in range(skin.nearest_ends[tet], skin.nearest_ends[tet + 1]):
        c = skin.nearest_faces[n]
        away = (centroid[c, 0] - x) ** 2 + (centroid[c, 1] - y) ** 2 + (centroid[c, 2] - z) ** 2
        if away < best:
            best, f = away, c
    for i in range(3):
        u = w[f, i, 0] * x + w[f, i, 1] * y + w[f, i, 2] * z + w[f, i, 3]
        parts[i] = u if u > 0 else 0.0
    whole = parts[0] + parts[1] + parts[2]
    for i in range(3):
        part = force * parts[i] / whole
        corner = skin.faces[f, i]
        if part == 0.0:
            continue
        if load[corner] == 0.0:
            loaded[num_loaded] = corner
            num_loaded += 1
        load[corner] += part
    return num_loaded


@compiled
def feel_loads(skin, load, loaded, num_loaded, felt, row):
    """Adds what receptors feel of the corners' loads to a row of `felt`, N; takes the loads off."""
    for k in range(num_loaded):
        corner = loaded[k]
        for entry in range(skin.weight_ends[corner], skin.weight_ends[corner + 1]):
            felt[row, skin.weight_receptor[entry]] += load[corner] * skin.weight[entry]
        load[corner] = 0.0


@compiled
def press_faces(skin, centroid, force, X_WL, felt, total):
    """Adds what receptors feel of the faces of a contact surface to `felt` `(S,)` N.

    The faces have a centroid `(F, 3)` m in the world, inside the skin, and a force `(F,)` N; the
    link with the skin has the pose `(3, 4)`. Adds to `total` `(4,)` as `Touches.of` takes it.
    """
    place, parts = np.empty(3), np.empty(3)
    load = np.zeros(len(skin.weight_ends) - 1)
    loaded = np.empty(len(load), dtype=np.int64)
    num_loaded, row = np.int64(0), np.int64(0)
    for face in range(len(force)):
        total[0] += force[face]
        for i in range(3):
            place[i] = 0.0
            for k in range(3):
                place[i] += (centroid[face, k] - X_WL[k, 3]) * X_WL[k, i]
            total[1 + i] += force[face] * place[i]
        tet = _tet_at(skin, place)
        num_loaded = add_load(skin, tet, place, force[face], parts, load, loaded, num_loaded)
    feel_loads(skin, load, loaded, num_loaded, felt.reshape(1, len(felt)), row)


@inner
def _tet_at(skin, place):
    """The tetrahedron that holds a place in the wall, or is beyond by rounding."""
    cell, best, deepest = np.int64(0), np.int64(0), -np.inf
    for i in range(3):
        along = int(np.floor((place[i] - skin.grid[i]) / skin.grid[3]))
        cell = cell * skin.shape[i] + min(max(along, 0), skin.shape[i] - 1)
    first, last = skin.cell_ends[cell], skin.cell_ends[cell + 1]
    if first == last:
        first, last = 0, len(skin.cell_tets)
    for entry in range(first, last):
        tet, least, planes = skin.cell_tets[entry], np.inf, skin.planes
        for k in range(4):
            height = planes[tet, k, 3]
            for i in range(3):
                height += planes[tet, k, i] * place[i]
            least = min(least, height)
        if least > deepest:
            best, deepest = tet, least
    return best
