"""Postures that a robot cannot take: those in which its rigid parts run into each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, QueryObject, SceneGraphInspector

from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.links import pieces_in_link
from selftouch_drake.robot.robot import Robot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bound:
    """A ball round a geometry: its centre in the link's frame, and its radius, m."""

    frame: int
    centre: np.ndarray
    radius: float


class CollisionCheck:
    """Finds configurations in which rigid parts of a robot are deeper in each other than allowed.

    Balls round the geometries reject most pairs; Drake's signed distances decide the rest.

    Args:
        robot: the robot.
    """

    def __init__(self, robot: Robot):
        self._robot = robot
        links = {int(link.index()): link for pair in robot.rigid_pairs for link in pair.links}
        number = {index: k for k, index in enumerate(links)}
        inspector = robot.scene_graph.model_inspector()
        bounds: dict[GeometryId, _Bound] = {}
        self._pairs: list[tuple[GeometryId, GeometryId, float]] = []
        for pair in robot.rigid_pairs:
            for link, ids in zip(pair.links, pair.geometry_ids, strict=True):
                for geometry in ids:
                    if geometry not in bounds:
                        bounds[geometry] = _bound(inspector, geometry, number[int(link.index())])
            self._pairs += [
                (a, b, pair.allowed_depth)
                for a in pair.geometry_ids[0]
                for b in pair.geometry_ids[1]
            ]
        ends = [(bounds[a], bounds[b]) for a, b, _ in self._pairs]
        self._frames = np.array([[a.frame, b.frame] for a, b in ends]).reshape(-1, 2)
        self._centres = np.array([[a.centre, b.centre] for a, b in ends]).reshape(-1, 2, 3)
        # Nearer than this the two balls overlap by more than is allowed.
        self._near = np.array(
            [a.radius + b.radius - p[2] for (a, b), p in zip(ends, self._pairs, strict=True)]
        )
        self._kinematics = Kinematics.of(
            robot.plant, [link.body_frame() for link in links.values()]
        )

    def depth(self, q: np.ndarray, query: Callable[[np.ndarray], QueryObject]) -> np.ndarray:
        """`(N,)` m, by how much rigid parts are deeper in each other than allowed at `q` `(N, J)`.

        Args:
            q: configurations.
            query: called with one `(J,)` configuration, gives Drake's query object there.

        Returns:
            0 where the posture is possible.
        """
        depth = np.zeros(len(q))
        if not self._pairs or not len(q):
            return depth
        X_WL = self._kinematics.poses(q)
        X = X_WL[:, self._frames]
        p = np.einsum("npkij,pkj->npki", X[..., :3], self._centres) + X[..., 3]
        apart = np.linalg.norm(p[:, :, 0] - p[:, :, 1], axis=2)
        rows, pairs = np.nonzero(apart < self._near)
        for row in np.unique(rows):
            found = query(q[row])
            for a, b, allowed in (self._pairs[pair] for pair in pairs[rows == row]):
                distance = found.ComputeSignedDistancePairClosestPoints(a, b).distance
                depth[row] = max(depth[row], -distance - allowed)
        return depth


def _bound(inspector: SceneGraphInspector, geometry: GeometryId, frame: int) -> _Bound:
    (piece,) = pieces_in_link(inspector, [geometry])
    low, high = piece.bounds
    centre = (low + high) / 2
    radius = float(np.linalg.norm(piece.vertices - centre, axis=1).max())
    return _Bound(frame=frame, centre=centre, radius=radius)
