"""Contact of rigid triangles with soft skins as pure geometry: Drake's result in less time.

For given positions, Drake's hydroelastic contact of a rigid mesh with a compliant one is geometry.
Each triangle is cut by the tetrahedra of the skin. Pressure is linear in a tetrahedron: it is zero
on the boundary of the skin; at an inner vertex it is the hydroelastic modulus times the distance to
the boundary over the largest such distance. A piece counts if the angle between the normal of its
triangle and the gradient of the pressure is less than 5/8 pi. Tests compare this with Drake.

Drake itself computes dynamics, and contact between two skins, where both sides are soft.
"""

import numpy as np

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.robot.contact import Touches
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.soft_skin import add_load, feel_loads, soft_skin, tets_near
from selftouch_drake.robot.touchers import PATCH, rigid_mesh, triangles_in_frame

# As in Drake, a piece counts if its normal and the gradient of the pressure are nearer than this.
_LEAST_COSINE = np.cos(5 * np.pi / 8)


class RigidTouchers:
    """Contact of the rigid touchers of a robot with its skins, at given poses.

    Attributes:
        is_rigid: `(P,)` bool, for each touching pair, whether the toucher is rigid (not a skin).
    """

    def __init__(self, robot: Robot):
        self._pairs = np.array(robot.touching_pairs, dtype=int).reshape(-1, 2)
        self._num_skins = len(robot.skins)
        worn = {skin.geometry_id for skin in robot.skins}
        rigid = [worn.isdisjoint(toucher.geometry_ids) for toucher in robot.touchers]
        self.is_rigid = np.array(rigid)[self._pairs[:, 0]]
        ends = np.cumsum([0, *(skin.model.fields.num_receptors for skin in robot.skins)])
        touchers, pressed = (set(column.tolist()) for column in self._pairs[self.is_rigid].T)
        inspector = robot.scene_graph.model_inspector()
        self._meshes = {
            t: rigid_mesh(*triangles_in_frame(robot.touchers[t], inspector)) for t in touchers
        }
        self._skins = {s: soft_skin(robot.skins[s].model, int(ends[s])) for s in pressed}
        self._num_receptors = int(ends[-1])

    def touches(self, X_WL: np.ndarray, near: np.ndarray, *, once: bool = False) -> Touches:
        """The touches that rigid touchers cause.

        Args:
            X_WL: `(N, L, 3, 4)` poses of all frames of the robot's kinematics, m.
            near: `(N, P)` bool, pairs that are near enough to touch.
            once: whether only a little of each contact counts: enough to see that there is one.
        """
        sensation = np.zeros((len(X_WL), self._num_receptors))
        number, row = np.nonzero(near.T & self.is_rigid[:, None])
        # Of another layout, `press` would be compiled again.
        row = np.ascontiguousarray(row)
        total = np.empty((len(row), 4))
        toucher, skin = self._pairs[number].T
        for pair in np.unique(number):
            t, s = self._pairs[pair].tolist()
            here = slice(*np.searchsorted(number, [pair, pair + 1]))
            frames = s, self._num_skins + t
            parts = self._skins[s], self._meshes[t]
            press(*parts, X_WL, *frames, row[here], sensation, total[here], once)
        return Touches.of(sensation, row, skin, toucher, total)


# One function: with its innermost loop as another, which is handed skin, mesh and scratch arrays,
# it takes 1.3 times the time on a cube, and twice on an infant.
@compiled
def press(skin, mesh, X_WL, skin_frame, mesh_frame, rows, sensation, total, once):
    """Presses a `RigidMesh` on a `SoftSkin`.

    This happens at `(R,)` rows of `X_WL`, `(N, L, 3, 4)` m, poses in the world of frames, two of
    which are those of the skin's link and of the mesh. Adds to `sensation` `(N, S)` N, and sets
    `total` `(R, 4)` as `Touches.of` takes it. Pressing `once` stops at the first force.
    """
    g, X = skin.pressure, np.empty((3, 4))
    p, planes = np.empty((3 * PATCH, 3)), np.empty((PATCH, 4))
    above, polygons, piece = np.empty((4, 3 * PATCH)), np.empty((2, 8, 2)), np.empty(3)
    box, place, parts = np.empty(6), np.empty(3), np.empty(3)
    # `seen` holds the number of the last search that found each tetrahedron: each is listed once.
    tets, seen, look = np.empty(len(g), dtype=np.int64), np.zeros(len(g), dtype=np.int64), 0
    load = np.zeros(len(skin.weight_ends) - 1)
    loaded = np.empty(len(load), dtype=np.int64)
    for r in range(len(rows)):
        # With literals, numba would compile the called functions twice; the same in `cut`.
        row, num_loaded = rows[r], np.int64(0)
        relative_pose(X_WL, row, skin_frame, mesh_frame, X)
        for i in range(4):
            total[r, i] = 0.0
        for patch in range(len(mesh.point_ends) - 1):
            if once and total[r, 0] != 0.0:
                break
            num_points = _place(mesh, patch, X, p, box)
            look += 1
            num_tets = tets_near(skin, box, look, seen, tets)
            first, last = mesh.face_ends[patch], mesh.face_ends[patch + 1]
            if num_tets:
                _turn(mesh, first, last, X, p, planes)
            for entry in range(num_tets):
                tet, measured = tets[entry], False
                if once and total[r, 0] != 0.0:
                    break
                for face in range(first, last):
                    if not _meets_plane(skin.corners, g, tet, planes, face - first):
                        continue
                    if not measured:
                        if not _reach_into(skin.planes, tet, p, num_points, above):
                            break
                        measured = True
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
                    num_loaded = add_load(skin, tet, place, force, parts, load, loaded, num_loaded)
        feel_loads(skin, load, loaded, num_loaded, sensation, row)


@inner
def relative_pose(X_WL, row, a, b, X_AB):
    """Writes the pose of frame b in frame a, at one row of `(N, L, 3, 4)`, into `(3, 4)`."""
    for i in range(3):
        for j in range(4):
            X_AB[i, j] = 0.0
            for k in range(3):
                away = X_WL[row, b, k, j] - (X_WL[row, a, k, 3] if j == 3 else 0.0)
                X_AB[i, j] += X_WL[row, a, k, i] * away


@inner
def _place(mesh, patch, X, p, box):
    """Writes the corners of a patch and their bounding box; returns the number of corners."""
    start = mesh.point_ends[patch]
    num = mesh.point_ends[patch + 1] - start
    for i in range(3):
        a, b, c, d = X[i, 0], X[i, 1], X[i, 2], X[i, 3]
        low, high = np.inf, -np.inf
        for v in range(num):
            q = start + v
            p[v, i] = a * mesh.points[q, 0] + b * mesh.points[q, 1] + c * mesh.points[q, 2] + d
            low = p[v, i] if p[v, i] < low else low
            high = p[v, i] if p[v, i] > high else high
        box[i], box[3 + i] = low, high
    return num


@inner
def _turn(mesh, first, last, X, p, planes):
    """Writes the planes of a patch's faces: unit normals, and heights of the origin over them."""
    for f in range(last - first):
        corner, planes[f, 3] = mesh.faces[first + f, 0], 0.0
        for i in range(3):
            planes[f, i] = 0.0
            for k in range(3):
                planes[f, i] += X[i, k] * mesh.normals[first + f, k]
            planes[f, 3] -= planes[f, i] * p[corner, i]


@inner
def _meets_plane(corners, g, tet, planes, f):
    """Whether a face's plane cuts a tetrahedron, and the pressure of that piece counts."""
    x, y, z, d = planes[f, 0], planes[f, 1], planes[f, 2], planes[f, 3]
    if not x * g[tet, 0] + y * g[tet, 1] + z * g[tet, 2] > _LEAST_COSINE * g[tet, 4]:
        return False
    below = above = False
    for k in range(4):
        height = x * corners[tet, k, 0] + y * corners[tet, k, 1] + z * corners[tet, k, 2] + d
        below |= height < 0
        above |= height > 0
    return below and above


@inner
def _reach_into(planes, tet, p, num_points, above):
    """Whether no side of a tetrahedron has all points outside; writes heights to `above`."""
    for k in range(4):
        a, b, c, d = planes[tet, k, 0], planes[tet, k, 1], planes[tet, k, 2], planes[tet, k, 3]
        inside = False
        for v in range(num_points):
            above[k, v] = a * p[v, 0] + b * p[v, 1] + c * p[v, 2] + d
            inside |= above[k, v] > 0
        if not inside:
            return False
    return True


@compiled
def cut(above, a, b, c, polygons, piece):
    """Cuts a triangle by the four planes of a tetrahedron; returns whether anything is left.

    A point of the triangle has coordinates u and v: corner a plus u times the edge to b plus v
    times the edge to c. The corners are columns of `above` `(4, V)`, heights over the four planes,
    positive inside. `polygons` is `(2, 8, 2)` scratch space. `piece` `(3,)` is set to the area in
    (u, v), 1/2 if all is inside, and the centroid (u, v).
    """
    for k in range(4):
        if above[k, a] <= 0 and above[k, b] <= 0 and above[k, c] <= 0:
            return False
    polygons[0, 0, 0] = polygons[0, 0, 1] = polygons[0, 1, 1] = polygons[0, 2, 0] = 0.0
    polygons[0, 1, 0] = polygons[0, 2, 1] = 1.0
    num, side = np.int64(3), np.int64(0)
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


@inner
def _clip(polygons, side, num, height, along_u, along_v):
    """Writes the part of a polygon above a plane to the other side of `polygons`."""
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
