"""Which receptors feel a force inside the wall of a skin, for compiled code.

The same as `ReceptiveFields.weights_at`, whose nearest centroid is found here among the few that
may be the nearest to a point of a tetrahedron.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.geometry import HollowSkin, ReceptiveFields


class Shares(NamedTuple):
    """Receptive fields of one skin, on F triangles, in the frame of its link.

    Attributes:
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

    nearest_ends: np.ndarray
    nearest_faces: np.ndarray
    centroid: np.ndarray
    barycentric: np.ndarray
    faces: np.ndarray
    weight_ends: np.ndarray
    weight_receptor: np.ndarray
    weight: np.ndarray


def receptor_shares(wall: HollowSkin, fields: ReceptiveFields, first_receptor: int = 0) -> Shares:
    """Reads the receptive fields of a skin whose readings start at `first_receptor`."""
    centroid = fields.vertices[fields.faces].mean(axis=1)
    ends, faces = _nearest_faces(wall.tet_vertices[wall.tetrahedra], centroid)
    return Shares(
        nearest_ends=ends,
        nearest_faces=faces,
        centroid=centroid,
        barycentric=fields.barycentric,
        faces=fields.faces.astype(np.int64),
        weight_ends=fields.vertex_weights.indptr.astype(np.int64),
        weight_receptor=fields.vertex_weights.indices.astype(np.int64) + first_receptor,
        weight=np.asarray(fields.vertex_weights.data, dtype=float),
    )


@compiled
def _nearest_faces(corners, centroid):
    # Three tetrahedra, half a prism of a wall, share one search through all faces.
    ends = np.zeros(len(corners) + 1, dtype=np.int64)
    # A total that starts as a literal would make numba compile `_list_nearest` twice.
    faces, total = np.empty(32 * len(corners), dtype=np.int64), np.int64(0)
    far, near = np.empty(len(centroid)), np.empty(len(centroid), dtype=np.int64)
    squares = np.empty((len(centroid), 5))
    for first in range(0, len(corners), 3):
        last = min(first + 3, len(corners))
        num = _faces_near(corners, first, last, centroid, far, near)
        for tet in range(first, last):
            if total + num > len(faces):
                more = np.empty(2 * len(faces) + num, dtype=np.int64)
                for k in range(total):
                    more[k] = faces[k]
                faces = more
            total = _list_nearest(corners, tet, centroid, near, num, squares, faces, total)
            ends[tet + 1] = total
    return ends, faces[:total]


@inner
def _faces_near(corners, first, last, centroid, far, near):
    """Lists faces in reach: at least all that may be nearest to a point of some tetrahedra."""
    x = y = z = radius = 0.0
    for tet in range(first, last):
        for k in range(4):
            x += corners[tet, k, 0] / (4 * (last - first))
            y += corners[tet, k, 1] / (4 * (last - first))
            z += corners[tet, k, 2] / (4 * (last - first))
    for tet in range(first, last):
        for k in range(4):
            square = (corners[tet, k, 0] - x) ** 2 + (corners[tet, k, 1] - y) ** 2
            radius = max(radius, square + (corners[tet, k, 2] - z) ** 2)
    nearest = np.inf
    for f in range(len(centroid)):
        far[f] = (centroid[f, 0] - x) ** 2 + (centroid[f, 1] - y) ** 2 + (centroid[f, 2] - z) ** 2
        nearest = min(nearest, far[f])
    reach = (2 * np.sqrt(radius) + np.sqrt(nearest)) ** 2
    num = 0
    for f in range(len(centroid)):
        if far[f] <= 1.000001 * reach:
            near[num] = f
            num += 1
    return num


@inner
def _list_nearest(corners, tet, centroid, near, num, squares, faces, total):
    """Appends to `faces` those that may be nearest to a point of one tetrahedron.

    A face is left out if another one is nearer to all four corners: so it is to all points.
    """
    best: int | np.int64 = np.int64(0)
    for n in range(num):
        squares[n, 4] = 0.0
        for k in range(4):
            squares[n, k] = 0.0
            for i in range(3):
                squares[n, k] += (centroid[near[n], i] - corners[tet, k, i]) ** 2
            squares[n, 4] += squares[n, k]
        if squares[n, 4] < squares[best, 4]:
            best = n
    start = total
    for n in range(num):
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
def add_load(shares, tet, place, force, parts, load, loaded, num_loaded):
    """Spreads a force, N, at a place `(3,)` m in a tetrahedron over corners of the nearest face.

    It is added to the load `(V,)` N of each corner. The first `num_loaded` entries of `loaded` are
    the corners that bear something; returns their number then. `parts` is `(3,)` scratch space.
    """
    x, y, z, w, centroid = place[0], place[1], place[2], shares.barycentric, shares.centroid
    best, f = np.inf, 0
    for n in range(shares.nearest_ends[tet], shares.nearest_ends[tet + 1]):
        c = shares.nearest_faces[n]
        away = (centroid[c, 0] - x) ** 2 + (centroid[c, 1] - y) ** 2 + (centroid[c, 2] - z) ** 2
        if away < best:
            best, f = away, c
    for i in range(3):
        u = w[f, i, 0] * x + w[f, i, 1] * y + w[f, i, 2] * z + w[f, i, 3]
        parts[i] = u if u > 0 else 0.0
    whole = parts[0] + parts[1] + parts[2]
    for i in range(3):
        part = force * parts[i] / whole
        corner = shares.faces[f, i]
        if part == 0.0:
            continue
        if load[corner] == 0.0:
            loaded[num_loaded] = corner
            num_loaded += 1
        load[corner] += part
    return num_loaded


@compiled
def feel_loads(shares, load, loaded, num_loaded, felt, row):
    """Adds what receptors feel of the corners' loads to a row of `felt`, N; takes the loads off."""
    for k in range(num_loaded):
        corner = loaded[k]
        for entry in range(shares.weight_ends[corner], shares.weight_ends[corner + 1]):
            felt[row, shares.weight_receptor[entry]] += load[corner] * shares.weight[entry]
        load[corner] = 0.0
