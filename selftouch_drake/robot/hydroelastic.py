"""Contact of rigid triangles with soft skins as pure geometry: what Drake computes, in less time.

For given positions Drake's hydroelastic contact of a rigid mesh with a compliant one is geometry.
Each triangle is cut by the tetrahedra of the skin. Pressure is linear in a tetrahedron: zero on the
skin's boundary, at an inner vertex the hydroelastic modulus times its distance to the boundary over
the largest such distance. A piece counts if its triangle's normal and the pressure's gradient are
less than 5/8 of half a turn apart. The tests hold this to Drake's own answer.

Drake alone knows dynamics, and a skin that presses a skin: there both sides are soft.
"""

from __future__ import annotations

import numba
import numpy as np

from selftouch_drake.robot.contact import Touches
from selftouch_drake.robot.receptor_shares import Shares, add_load, feel_loads, receptor_shares
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.soft_skin import SoftSkin, soft_skin, tets_near
from selftouch_drake.robot.touchers import PATCH, RigidMesh, rigid_mesh, touching_triangles

_LEAST_COSINE = np.cos(5 * np.pi / 8)

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


class RigidTouchers:
    """The rigid touchers of a robot, pressed on its skins at given poses.

    A toucher that is itself a skin is none of them: see `is_rigid`.

    Args:
        robot: the robot.
    """

    def __init__(self, robot: Robot):
        self._pairs = np.array(robot.touching_pairs, dtype=int).reshape(-1, 2)
        self._num_skins = len(robot.skins)
        self.is_rigid = np.array([_is_rigid(robot, t) for t in self._pairs[:, 0]])
        ends = np.cumsum([0, *(skin.model.fields.num_receptors for skin in robot.skins)])
        touchers, pressed = (set(column.tolist()) for column in self._pairs[self.is_rigid].T)
        self._meshes = {t: _mesh(robot, t) for t in touchers}
        self._skins: dict[int, tuple[SoftSkin, Shares]] = {}
        for s in pressed:
            skin = robot.skins[s].model
            self._skins[s] = (
                soft_skin(skin.wall, skin.hydroelastic_modulus),
                receptor_shares(skin.wall, skin.fields, int(ends[s])),
            )
        self._num_receptors = int(ends[-1])

    def touches(self, X_WL: np.ndarray, near: np.ndarray) -> Touches:
        """What the skins feel of rigid touchers.

        Args:
            X_WL: `(N, L, 3, 4)` poses of all frames of the robot's kinematics, m.
            near: `(N, P)` bool, which touching pairs may touch.
        """
        sensation = np.zeros((len(X_WL), self._num_receptors))
        number, row = np.nonzero(near.T & self.is_rigid[:, None])
        total = np.empty((len(row), 4))
        toucher, skin = self._pairs[number].T
        for pair in np.unique(number):
            t, s = self._pairs[pair].tolist()
            here = slice(*np.searchsorted(number, [pair, pair + 1]))
            frames = s, self._num_skins + t
            press(
                *self._skins[s], self._meshes[t], X_WL, *frames, row[here], sensation, total[here]
            )
        return Touches.of(sensation, row, skin, toucher, total)


def _is_rigid(robot: Robot, toucher: int) -> bool:
    worn = {skin.geometry_id for skin in robot.skins}
    return not worn.intersection(robot.touchers[toucher].geometry_ids)


def _mesh(robot: Robot, number: int) -> RigidMesh:
    """A toucher's triangles in its frame."""
    toucher, inspector = robot.touchers[number], robot.scene_graph.model_inspector()
    X_FL = toucher.frame.GetFixedPoseInBodyFrame().inverse()
    vertices, faces, count = [], [], 0
    for geometry in toucher.geometry_ids:
        own, own_faces = touching_triangles(inspector.GetShape(geometry))
        X_FG = X_FL.multiply(inspector.GetPoseInFrame(geometry))
        vertices.append(X_FG.multiply(own.T).T)
        faces.append(own_faces + count)
        count += len(own)
    return rigid_mesh(np.concatenate(vertices), np.concatenate(faces))


@_compiled
def press(skin, shares, mesh, X_WL, skin_frame, mesh_frame, rows, sensation, total):
    """Presses a rigid mesh on a skin in several rows of poses.

    Args:
        skin: a `SoftSkin`.
        shares: the `Shares` of its receptors.
        mesh: a `RigidMesh`.
        X_WL: `(N, L, 3, 4)` poses of frames in the world, m.
        skin_frame: the number of the frame of the skin's link.
        mesh_frame: that of the mesh.
        rows: `(R,)` which of N.
        sensation: `(N, receptors)` N, to which is added what they feel.
        total: `(R, 4)` N and N m, is set to the force of each contact, and to the sum of force
            times place in the frame of the skin's link.
    """
    g, X = skin.pressure, np.empty((3, 4))
    p, normals = np.empty((3 * PATCH, 3)), np.empty((PATCH, 3))
    above, polygons, piece = np.empty((4, 3 * PATCH)), np.empty((2, 8, 2)), np.empty(3)
    box, place = np.empty(6), np.empty(3)
    # `seen` holds the last look at each tetrahedron, so that each is listed once.
    tets, seen, look = np.empty(len(g), dtype=np.int64), np.zeros(len(g), dtype=np.int64), 0
    load = np.zeros(len(shares.weight_ends) - 1)
    loaded = np.empty(len(load), dtype=np.int64)
    for r in range(len(rows)):
        row, num_loaded = rows[r], 0
        relative_pose(X_WL, row, skin_frame, mesh_frame, X)
        for i in range(4):
            total[r, i] = 0.0
        for patch in range(len(mesh.point_ends) - 1):
            num_points = _place(mesh, patch, X, p, box)
            look += 1
            num_tets = tets_near(skin, box, look, seen, tets)
            first, last = mesh.face_ends[patch], mesh.face_ends[patch + 1]
            if num_tets:
                _turn(mesh.normals, first, last, X, normals)
            for entry in range(num_tets):
                tet = tets[entry]
                if not _reach_into(skin.planes, tet, p, num_points, above):
                    continue
                for face in range(first, last):
                    along = 0.0
                    for i in range(3):
                        along += normals[face - first, i] * g[tet, i]
                    if not along > _LEAST_COSINE * g[tet, 4]:
                        continue
                    a, b, c = mesh.faces[face, 0], mesh.faces[face, 1], mesh.faces[face, 2]
                    if not cut(above, a, b, c, polygons, piece):
                        continue
                    pressure = g[tet, 3]
                    for i in range(3):
                        edges = piece[1] * (p[b, i] - p[a, i]) + piece[2] * (p[c, i] - p[a, i])
                        place[i] = p[a, i] + edges
                        pressure += g[tet, i] * place[i]
                    # Pressure is linear: its value at the centroid times the area is its integral.
                    force = piece[0] * mesh.areas[face] * pressure
                    total[r, 0] += force
                    for i in range(3):
                        total[r, 1 + i] += force * place[i]
                    num_loaded = add_load(shares, tet, place, force, load, loaded, num_loaded)
        feel_loads(shares, load, loaded, num_loaded, sensation, row)


@_compiled
def relative_pose(X_WL, row, a, b, X_AB):
    """Writes the pose of one frame in another at one row of `(N, L, 3, 4)` into `(3, 4)`."""
    for i in range(3):
        for j in range(4):
            X_AB[i, j] = 0.0
            for k in range(3):
                away = X_WL[row, b, k, j] - (X_WL[row, a, k, 3] if j == 3 else 0.0)
                X_AB[i, j] += X_WL[row, a, k, i] * away


@_compiled
def _place(mesh, patch, X, p, box):
    """Places the corners of a patch, with their bounding box; returns how many there are."""
    start = mesh.point_ends[patch]
    num = mesh.point_ends[patch + 1] - start
    for i in range(3):
        a, b, c, d = X[i, 0], X[i, 1], X[i, 2], X[i, 3]
        low, high = np.inf, -np.inf
        for v in range(num):
            q = start + v
            p[v, i] = a * mesh.points[q, 0] + b * mesh.points[q, 1] + c * mesh.points[q, 2] + d
            low, high = min(low, p[v, i]), max(high, p[v, i])
        box[i], box[3 + i] = low, high
    return num


@_compiled
def _turn(normals, first, last, X, turned):
    for i in range(3):
        a, b, c = X[i, 0], X[i, 1], X[i, 2]
        for f in range(first, last):
            turned[f - first, i] = a * normals[f, 0] + b * normals[f, 1] + c * normals[f, 2]


@_compiled
def _reach_into(planes, tet, p, num_points, above):
    """Whether no side of a tetrahedron has all points outside; heights over them go to `above`."""
    for k in range(4):
        a, b, c, d = planes[tet, k, 0], planes[tet, k, 1], planes[tet, k, 2], planes[tet, k, 3]
        highest = 0.0
        for v in range(num_points):
            above[k, v] = a * p[v, 0] + b * p[v, 1] + c * p[v, 2] + d
            highest = max(highest, above[k, v])
        if highest <= 0:
            return False
    return True


@_compiled
def cut(above, a, b, c, polygons, piece):
    """Cuts a triangle by the four planes of a tetrahedron.

    A point of the triangle is its corner a, and shares u and v of its edges to b and c.

    Args:
        above: `(4, V)` heights of points over the four planes, positive inside.
        a: the points that are its corners.
        b: the second.
        c: the third.
        polygons: `(2, 8, 2)` scratch.
        piece: `(3,)` takes the area in (u, v), 1/2 if all is inside, and the centroid's u and v.

    Returns:
        Whether anything is left.
    """
    for k in range(4):
        if above[k, a] <= 0 and above[k, b] <= 0 and above[k, c] <= 0:
            return False
    polygons[0, 0, 0] = polygons[0, 0, 1] = polygons[0, 1, 1] = polygons[0, 2, 0] = 0.0
    polygons[0, 1, 0] = polygons[0, 2, 1] = 1.0
    num, side = 3, 0
    for k in range(4):
        if above[k, a] < 0 or above[k, b] < 0 or above[k, c] < 0:
            along_u, along_v = above[k, b] - above[k, a], above[k, c] - above[k, a]
            num = _clip(polygons, side, num, above[k, a], along_u, along_v)
            side = 1 - side
            if num < 3:
                return False
    u0, v0 = polygons[side, 0, 0], polygons[side, 0, 1]
    area = u = v = 0.0
    for n in range(1, num - 1):
        u1, v1 = polygons[side, n, 0] - u0, polygons[side, n, 1] - v0
        u2, v2 = polygons[side, n + 1, 0] - u0, polygons[side, n + 1, 1] - v0
        twice = u1 * v2 - v1 * u2
        area += twice
        u += twice * (u1 + u2)
        v += twice * (v1 + v2)
    piece[0], piece[1], piece[2] = area / 2, u0 + u / (3 * area), v0 + v / (3 * area)
    return area > 0


@_compiled
def _clip(polygons, side, num, height, along_u, along_v):
    """Keeps, on the other side of `polygons`, what of a polygon is not below a plane."""
    kept = 0
    u0, v0 = polygons[side, num - 1, 0], polygons[side, num - 1, 1]
    h0 = height + along_u * u0 + along_v * v0
    for n in range(num):
        u, v = polygons[side, n, 0], polygons[side, n, 1]
        h = height + along_u * u + along_v * v
        if (h >= 0) != (h0 >= 0):
            share = h / (h - h0)
            polygons[1 - side, kept, 0] = u + share * (u0 - u)
            polygons[1 - side, kept, 1] = v + share * (v0 - v)
            kept += 1
        if h >= 0:
            polygons[1 - side, kept, 0], polygons[1 - side, kept, 1] = u, v
            kept += 1
        u0, v0, h0 = u, v, h
    return kept
