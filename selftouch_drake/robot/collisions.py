"""Impossible postures: those in which rigid parts of the robot run into each other."""

import itertools
from collections.abc import Callable

import numpy as np
from pydrake.geometry import GeometryId, QueryObject, SceneGraphInspector
from pydrake.multibody.tree import RigidBody

from selftouch_drake.compiled import compiled
from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.links import as_mesh
from selftouch_drake.robot.robot import Robot

# Share of its radius that a bound is larger: a mesh of a round shape is inside it, by 8e-4 of its
# radius, and Drake's signed distances of round shapes have errors, too.
_SLACK = 2e-3


class CollisionCheck:
    """Finds configurations in which rigid parts of a robot are deeper in each other than allowed.

    Capsules round the geometries reject most pairs; Drake's signed distances decide the rest. For
    these a mesh is its convex hull.

    `query`, called with one `(J,)` configuration, gives Drake's query object there.

    Raises:
        ExperimentError: a link has a geometry without extent, as a half space.
    """

    def __init__(self, robot: Robot, query: Callable[[np.ndarray], QueryObject]):
        self._query = query
        inspector = robot.scene_graph.model_inspector()
        link_of = {
            geometry: link
            for pair in robot.rigid_pairs
            for link, geometries in zip(pair.links, pair.geometry_ids, strict=True)
            for geometry in geometries
        }
        frames = [link.body_frame() for link in link_of.values()]
        self._kinematics = Kinematics.of(robot.plant, frames)
        bounds = [_bound(inspector, geometry, link) for geometry, link in link_of.items()]
        self._centre = np.array([centre for centre, _, _ in bounds]).reshape(-1, 3)
        self._half = np.array([half for _, half, _ in bounds]).reshape(-1, 3)
        radius = np.array([radius for _, _, radius in bounds])
        number = {geometry: k for k, geometry in enumerate(link_of)}
        self._pairs = [
            (a, b, pair.allowed_depth)
            for pair in robot.rigid_pairs
            for a, b in itertools.product(*pair.geometry_ids)
        ]
        ends = [[number[a], number[b]] for a, b, _ in self._pairs]
        self._ends = np.array(ends, dtype=int).reshape(-1, 2)
        # If their axes are nearer to each other, two capsules overlap by more than allowed.
        allowed = np.array([allowed for *_, allowed in self._pairs])
        self._near = radius[self._ends].sum(axis=1) - allowed

    def depth(self, q: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """`(N,)` m, by how much two rigid parts are deeper in each other than allowed.

        It is that of the first pair that is found to be too deep at `q` `(N, J)`; 0 where the
        posture is possible. With a margin (m), less is allowed.
        """
        depth = np.zeros(len(q))
        if not self._pairs:
            return depth
        X_WL = self._kinematics.poses(q)
        p_WC = np.einsum("ngij,gj->ngi", X_WL[..., :3], self._centre) + X_WL[..., 3]
        half_W = np.einsum("ngij,gj->ngi", X_WL[..., :3], self._half)
        beyond = np.empty((len(q), len(self._pairs)))
        _axes_apart(p_WC, half_W, self._ends, beyond)
        beyond -= self._near + margin
        rows, pairs = np.nonzero(beyond < 0.0)
        # What is deepest, as far as one can see, comes first.
        order = np.lexsort([beyond[rows, pairs], rows])
        near = zip(rows[order].tolist(), pairs[order].tolist(), strict=True)
        for row, some in itertools.groupby(near, key=lambda row_and_pair: row_and_pair[0]):
            found = self._query(q[row])
            for _, pair in some:
                first, second, allowed = self._pairs[pair]
                distance = found.ComputeSignedDistancePairClosestPoints(first, second).distance
                depth[row] = max(0.0, -distance - (allowed - margin))
                if depth[row]:
                    break
        return depth


@compiled
def _axes_apart(centre, half, ends, apart):
    """Writes the distances `apart` `(N, P)` m between pairs `ends` `(P, 2)` of line segments.

    These are the axes of capsules, from centre - half to centre + half, both `(N, G, 3)` m.
    """
    for row in range(len(centre)):
        for pair in range(len(ends)):
            a, b = ends[pair, 0], ends[pair, 1]
            # The nearest points are centre + s half, with s and t from -1 to 1.
            aa = bb = ab = ar = br = 0.0
            for i in range(3):
                u, v, r = half[row, a, i], half[row, b, i], centre[row, a, i] - centre[row, b, i]
                aa, bb, ab, ar, br = aa + u * u, bb + v * v, ab + u * v, ar + u * r, br + v * r
            across = aa * bb - ab * ab
            s = min(max((ab * br - ar * bb) / across, -1.0), 1.0) if across > 0.0 else 0.0
            t = (ab * s + br) / bb if bb > 0.0 else 0.0
            if bb == 0.0 or abs(t) > 1.0:
                t = min(max(t, -1.0), 1.0)
                s = min(max((ab * t - ar) / aa, -1.0), 1.0) if aa > 0.0 else 0.0
            square = 0.0
            for i in range(3):
                away = centre[row, a, i] + s * half[row, a, i] - centre[row, b, i]
                square += (away - t * half[row, b, i]) ** 2
            apart[row, pair] = np.sqrt(square)


def _bound(
    inspector: SceneGraphInspector, geometry: GeometryId, link: RigidBody
) -> tuple[np.ndarray, np.ndarray, float]:
    """A capsule round a geometry, in the frame of its link, m.

    Returns:
        `(3,)` centre; `(3,)` from there to the centre of the cap at one end; and the radius.
    """
    try:
        corners = as_mesh(inspector.GetShape(geometry)).vertices
    except ValueError as error:
        raise ExperimentError(
            f"link {link.name()!r} cannot be checked for collisions: {error}"
        ) from error
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    axis = np.eye(3)[np.ptp(corners, axis=0).argmax()]
    along = np.abs((corners - centre) @ axis)
    square = np.square(corners - centre).sum(axis=1) - along**2
    radius = np.sqrt(square.max())
    beyond = (along - np.sqrt(np.maximum(radius**2 - square, 0.0))).max()
    X_LG = inspector.GetPoseInFrame(geometry)
    half = X_LG.rotation().multiply(max(beyond, 0.0) * axis)
    return X_LG.multiply(centre), half, (1.0 + _SLACK) * float(radius)
