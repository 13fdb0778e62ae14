"""Impossible postures: those in which rigid parts of the robot run into each other.

The depth of two convex shapes in each other is the length of the shortest shift that parts them:
the distance of the origin from the boundary of their Minkowski difference. The check asks only
whether that is more than allowed, and its search ends as soon as the answer is certain, mostly far
from the limit. So it needs 5 % of the time of Drake's signed distances, which took half of the time
of an infant's touches.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Capsule, Cylinder, Ellipsoid, GeometryId, SceneGraphInspector, Sphere
from pydrake.multibody.tree import RigidBody

from selftouch_drake.compiled import compiled, inner
from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.links import as_mesh
from selftouch_drake.robot.robot import Robot

# m; each Minkowski difference is rounded by a ball of this radius, so that no two of its farthest
# points coincide. If shapes must be apart by a margin, the ball has that radius too, since faces
# bound depths and not distances.
_ROUNDED = 1e-6
# Most faces, and most corners, of a surface in a difference; a pair that needs more counts as too
# deep.
_FACES = 200
# The first surface is a tetrahedron: directions of its corners, and the corners of its faces,
# counter-clockwise seen from outside.
_FIRST_DIRECTIONS = np.array(
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
)
_FIRST_FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


class Solids(NamedTuple):
    """Convex shapes, each the Minkowski sum of the hull of points and an ellipsoid.

    Attributes:
        points: `(n, 3)` m, of all G shapes, each in the frame of its link.
        axes: `(G, 3, 3)` m, the semi-axes of the ellipsoids, as columns in the frames of the links.
        centres: `(G, 3)` m, of balls that hold the shapes, in the frames of the links.
        radii: `(G,)` m, of these balls.
        ends: `(G + 1,)` where the points of each shape begin and end.
    """

    points: np.ndarray
    axes: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    ends: np.ndarray


class _Surface(NamedTuple):
    """A closed surface of triangles that grows inside the difference of two shapes.

    Attributes:
        corners: `(_FACES, 3)` m, room for them.
        faces: `(_FACES, 3)` the numbers of each face's corners.
        planes: `(_FACES, 4)` the unit normal of each face, and its distance from the origin, m.
    """

    corners: np.ndarray
    faces: np.ndarray
    planes: np.ndarray


class CollisionCheck:
    """Finds configurations in which rigid parts of a robot are deeper in each other than allowed.

    As in Drake, a mesh is its convex hull.

    Raises:
        ExperimentError: a link has a geometry without extent, as a half space.
    """

    def __init__(self, robot: Robot):
        link_of = {
            geometry: link
            for pair in robot.rigid_pairs
            for link, geometries in zip(pair.links, pair.geometry_ids, strict=True)
            for geometry in geometries
        }
        frames = [link.body_frame() for link in link_of.values()]
        self._kinematics = Kinematics.of(robot.plant, frames)
        self._solids = _solids_of(robot.scene_graph.model_inspector(), link_of)
        number = {geometry: k for k, geometry in enumerate(link_of)}
        pairs = [
            (number[a], number[b], pair.allowed_depth)
            for pair in robot.rigid_pairs
            for a in pair.geometry_ids[0]
            for b in pair.geometry_ids[1]
        ]
        self._pairs = np.array([(a, b) for a, b, _ in pairs], dtype=np.int64).reshape(-1, 2)
        self._allowed = np.array([allowed for _, _, allowed in pairs])

    def impossible(self, q: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """`(N,)` bool, whether rigid parts are too deep in each other at `q` `(N, J)`.

        With a margin (m), less is allowed.
        """
        found = np.zeros(len(q), dtype=np.bool_)
        if len(self._pairs):
            X_WL = self._kinematics.poses(q)
            _collide(self._solids, X_WL, self._pairs, self._allowed - margin, found)
        return found


def _solids_of(inspector: SceneGraphInspector, link_of: Mapping[GeometryId, RigidBody]) -> Solids:
    """The shapes of G geometries, each in the frame of its link.

    Raises:
        ExperimentError: a geometry has no extent.
    """
    points, axes = [np.empty((0, 3))], [np.empty((0, 3, 3))]
    centres, radii = [np.empty((0, 3))], list[float]()
    for geometry, link in link_of.items():
        try:
            p_GP, semi_axes = _as_sum(inspector, geometry)
        except ValueError as error:
            raise ExperimentError(
                f"link {link.name()!r} cannot be checked for collisions: {error}"
            ) from error
        X_LG = inspector.GetPoseInFrame(geometry)
        p_LP = X_LG.multiply(p_GP.T).T
        centre = (p_LP.min(axis=0) + p_LP.max(axis=0)) / 2
        points.append(p_LP)
        axes.append(X_LG.rotation().matrix()[None] * semi_axes)
        centres.append(centre[None])
        radii.append(np.linalg.norm(p_LP - centre, axis=1).max() + semi_axes.max())
    return Solids(
        points=np.concatenate(points),
        axes=np.concatenate(axes),
        centres=np.concatenate(centres),
        radii=np.array(radii),
        ends=np.cumsum([len(p_LP) for p_LP in points]),
    )


def _as_sum(inspector: SceneGraphInspector, geometry: GeometryId) -> tuple[np.ndarray, np.ndarray]:
    """`(n, 3)` points and `(3,)` semi-axes, m, whose sum a shape is, in its own frame.

    Raises:
        ValueError: as in `as_mesh`.
    """
    shape, hull = inspector.GetShape(geometry), inspector.GetConvexHull(geometry)
    round_ones: dict[type, Any] = {
        Sphere: lambda s: (0.0, [s.radius()] * 3),
        Ellipsoid: lambda s: (0.0, [s.a(), s.b(), s.c()]),
        Capsule: lambda s: (s.length(), [s.radius()] * 3),
        Cylinder: lambda s: (s.length(), [s.radius(), s.radius(), 0.0]),
    }
    for kind, measures in round_ones.items():
        if isinstance(shape, kind):
            length, semi_axes = measures(shape)
            return np.array([[0, 0, -length / 2], [0, 0, length / 2]]), np.array(semi_axes)
    if hull is not None:
        return np.array([hull.vertex(i) for i in range(hull.num_vertices())]), np.zeros(3)
    return np.array(as_mesh(shape).vertices), np.zeros(3)


@compiled
def _collide(solids, X_WL, pairs, allowed, found):
    """Writes which `(N,)` rows of `X_WL`, `(N, G, 3, 4)` m, have a pair that is too deep.

    Allowed are `(P,)` m for the `(P, 2)` pairs.
    """
    p_WC = np.empty_like(solids.centres)
    # Scratch memory, allocated once. All of it in one tuple takes 4 % more time.
    surface = _Surface(
        np.empty((_FACES, 3)), np.empty((_FACES, 3), dtype=np.int64), np.empty((_FACES, 4))
    )
    edges = np.empty((3 * _FACES, 2), dtype=np.int64)
    direction, farthest = np.empty(3), np.empty(3)
    for row in range(len(X_WL)):
        for part in range(len(p_WC)):
            for i in range(3):
                x, c = X_WL[row, part, i], solids.centres[part]
                p_WC[part, i] = x[0] * c[0] + x[1] * c[1] + x[2] * c[2] + x[3]
        for pair in range(len(pairs)):
            a, b, square = pairs[pair, 0], pairs[pair, 1], 0.0
            for i in range(3):
                direction[i] = p_WC[b, i] - p_WC[a, i]
                square += direction[i] * direction[i]
            near = max(solids.radii[a] + solids.radii[b] - allowed[pair], 0.0)
            if square >= near * near:
                continue
            if _too_deep(
                solids, X_WL[row], a, b, allowed[pair], surface, edges, direction, farthest
            ):
                found[row] = True
                break


@inner
def _too_deep(solids, X, a, b, allowed, surface, edges, direction, farthest):
    """Whether two shapes, at poses X `(G, 3, 4)`, are deeper in each other than allowed.

    The direction leads from a to b. Each farthest point of the difference in a direction bounds the
    depth from above. It becomes a corner of a closed surface inside the difference, whose nearest
    face bounds the depth from below (the expanding polytope of van den Bergen, 2001). All arguments
    from `surface` on are scratch memory: `(3 * _FACES, 2)` edges, `(3,)` the direction, and `(3,)`
    m the farthest point.
    """
    corners, planes = surface.corners, surface.planes
    ball = _ROUNDED + max(-allowed, 0.0)
    allowed += ball
    if _farthest(solids, X, a, b, ball, direction, farthest) <= allowed:
        return False
    num_corners, num_faces = np.int64(4), np.int64(4)
    for corner in range(4):
        for i in range(3):
            direction[i] = _FIRST_DIRECTIONS[corner, i]
        if _farthest(solids, X, a, b, ball, direction, corners[corner]) <= allowed:
            return False
    for face in range(4):
        o, p, q = _FIRST_FACES[face]
        _set_face(surface, face, o, p, q)
    while num_corners < len(corners) and num_faces > 0:
        nearest = _nearest_face(planes, num_faces)
        if planes[nearest, 3] > allowed:
            break
        for i in range(3):
            direction[i] = planes[nearest, i]
        far = _farthest(solids, X, a, b, ball, direction, corners[num_corners])
        if far <= allowed:
            return False
        num_faces = _expand(surface, edges, num_corners, num_faces)
        num_corners += 1
    return True


@inner
def _nearest_face(planes, num_faces):
    """The number of the face whose plane is nearest to the origin."""
    nearest = 0
    for face in range(num_faces):
        if planes[face, 3] < planes[nearest, 3]:
            nearest = face
    return nearest


@inner
def _farthest(solids, X, a, b, ball, direction, point):
    """Writes the point of shape a less shape b, rounded by a ball, that is farthest in a direction.

    The ball's radius is in m. Makes a unit vector of the direction; returns how far along it the
    point is, m.
    """
    x, y, z = direction[0], direction[1], direction[2]
    size = np.sqrt(x * x + y * y + z * z)
    for i in range(3):
        direction[i] = direction[i] / size if size > 0.0 else 1.0 / np.sqrt(3.0)
        point[i] = ball * direction[i]
    _add_farthest(solids, X, a, 1.0, direction, point)
    _add_farthest(solids, X, b, -1.0, direction, point)
    return direction[0] * point[0] + direction[1] * point[1] + direction[2] * point[2]


@inner
def _add_farthest(solids, X, part, sign, n, point):
    """Adds to a point that of a shape, times the sign, for which the sum is farthest along `n`."""
    points, axes = solids.points, solids.axes[part]
    # The direction in the frame of the link.
    x = sign * (n[0] * X[part, 0, 0] + n[1] * X[part, 1, 0] + n[2] * X[part, 2, 0])
    y = sign * (n[0] * X[part, 0, 1] + n[1] * X[part, 1, 1] + n[2] * X[part, 2, 1])
    z = sign * (n[0] * X[part, 0, 2] + n[1] * X[part, 1, 2] + n[2] * X[part, 2, 2])
    at, most = 0, -np.inf
    for k in range(solids.ends[part], solids.ends[part + 1]):
        along = x * points[k, 0] + y * points[k, 1] + z * points[k, 2]
        if along > most:
            at, most = k, along
    # The farthest point of an ellipsoid M (unit ball) is M u, u the unit vector along M' n.
    s = axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z
    t = axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z
    u = axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z
    size = max(np.sqrt(s * s + t * t + u * u), 1e-300)
    x = points[at, 0] + (axes[0, 0] * s + axes[0, 1] * t + axes[0, 2] * u) / size
    y = points[at, 1] + (axes[1, 0] * s + axes[1, 1] * t + axes[1, 2] * u) / size
    z = points[at, 2] + (axes[2, 0] * s + axes[2, 1] * t + axes[2, 2] * u) / size
    for i in range(3):
        in_world = X[part, i, 0] * x + X[part, i, 1] * y + X[part, i, 2] * z + X[part, i, 3]
        point[i] += sign * in_world


@inner
def _expand(surface, edges, new, num_faces):
    """Replaces the faces that a new corner sees by faces that join it to their rim.

    Returns the new number of faces; 0 if there is no room for them.
    """
    corners, faces, planes = surface.corners, surface.faces, surface.planes
    num_edges, kept = np.int64(0), np.int64(0)
    for face in range(num_faces):
        x, y, z = corners[new, 0], corners[new, 1], corners[new, 2]
        if planes[face, 0] * x + planes[face, 1] * y + planes[face, 2] * z <= planes[face, 3]:
            _set_face(surface, kept, faces[face, 0], faces[face, 1], faces[face, 2])
            kept += 1
            continue
        for i in range(3):
            num_edges = _toggle_edge(edges, num_edges, faces[face, i], faces[face, (i + 1) % 3])
    if kept + num_edges > len(faces):
        return np.int64(0)
    for edge in range(num_edges):
        _set_face(surface, kept + edge, edges[edge, 0], edges[edge, 1], new)
    return kept + num_edges


@inner
def _toggle_edge(edges, num_edges, start, end):
    """Adds an edge of a face that is seen, or removes it if the face beyond it is seen too.

    What is left in the end is the rim. Returns the new number of edges.
    """
    for edge in range(num_edges):
        if edges[edge, 0] == end and edges[edge, 1] == start:
            last = num_edges - 1
            edges[edge, 0], edges[edge, 1] = edges[last, 0], edges[last, 1]
            return last
    edges[num_edges, 0], edges[num_edges, 1] = start, end
    return num_edges + 1


@inner
def _set_face(surface, face, o, p, q):
    """Writes the corners of a face, its unit normal, and its distance from the origin along it."""
    corners, faces, planes = surface.corners, surface.faces, surface.planes
    faces[face, 0], faces[face, 1], faces[face, 2], planes[face, 3] = o, p, q, 0.0
    square = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across = (corners[p, j] - corners[o, j]) * (corners[q, k] - corners[o, k])
        across -= (corners[p, k] - corners[o, k]) * (corners[q, j] - corners[o, j])
        planes[face, i] = across
        square += across * across
    for i in range(3):
        planes[face, i] /= max(np.sqrt(square), 1e-300)
        planes[face, 3] += planes[face, i] * corners[o, i]
