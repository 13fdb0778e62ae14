"""Impossible postures: those in which rigid parts of the robot run into each other."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import GeometryId, QueryObject, SceneGraphInspector
from pydrake.multibody.tree import Frame, RigidBody

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.links import pieces_in_link
from selftouch_drake.robot.robot import Robot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bound:
    """A ball round a geometry: its centre in the frame of its link, and its radius, m."""

    centre: np.ndarray
    radius: float


class CollisionCheck:
    """Finds configurations in which rigid parts of a robot are deeper in each other than allowed.

    Balls round the geometries reject most pairs; Drake's signed distances decide the rest. For
    these a mesh is its convex hull.

    Args:
        robot: the robot.

    Raises:
        ExperimentError: a link has a geometry without extent, as a half space.
    """

    def __init__(self, robot: Robot):
        inspector = robot.scene_graph.model_inspector()
        bounds: dict[GeometryId, _Bound] = {}
        frames: list[Frame] = []
        for pair in robot.rigid_pairs:
            for link, geometries in zip(pair.links, pair.geometry_ids, strict=True):
                for geometry in geometries:
                    if geometry not in bounds:
                        bounds[geometry] = _bound(inspector, geometry, link)
                        frames.append(link.body_frame())
        self._kinematics = Kinematics.of(robot.plant, frames)
        self._centre = np.array([bound.centre for bound in bounds.values()]).reshape(-1, 3)
        number = {geometry: k for k, geometry in enumerate(bounds)}
        self._pairs = [
            (a, b, pair.allowed_depth)
            for pair in robot.rigid_pairs
            for a, b in itertools.product(*pair.geometry_ids)
        ]
        self._ends = np.array([[number[a], number[b]] for a, b, _ in self._pairs]).reshape(-1, 2)
        # At a smaller distance the two balls overlap by more than allowed.
        self._near = np.array(
            [bounds[a].radius + bounds[b].radius - allowed for a, b, allowed in self._pairs]
        )

    def depth(
        self, q: np.ndarray, query: Callable[[np.ndarray], QueryObject], margin: float = 0.0
    ) -> np.ndarray:
        """`(N,)` m, by how much rigid parts are deeper in each other than allowed at `q` `(N, J)`.

        Args:
            q: configurations, rad or m.
            query: called with one `(J,)` configuration, gives Drake's query object there.
            margin: m, by which less is allowed.

        Returns:
            0 where the posture is possible.
        """
        depth = np.zeros(len(q))
        if not self._pairs:
            return depth
        X_WL = self._kinematics.poses(q)
        p_WC = np.einsum("ngij,gj->ngi", X_WL[..., :3], self._centre) + X_WL[..., 3]
        a, b = self._ends.T
        apart = np.linalg.norm(p_WC[:, a] - p_WC[:, b], axis=2)
        rows, pairs = np.nonzero(apart < self._near + margin)
        for row in np.unique(rows):
            found = query(q[row])
            for pair in pairs[rows == row]:
                first, second, allowed = self._pairs[pair]
                distance = found.ComputeSignedDistancePairClosestPoints(first, second).distance
                depth[row] = max(depth[row], -distance - (allowed - margin))
        return depth


def _bound(inspector: SceneGraphInspector, geometry: GeometryId, link: RigidBody) -> _Bound:
    try:
        (piece,) = pieces_in_link(inspector, [geometry])
    except ValueError as error:
        raise ExperimentError(
            f"link {link.name()!r} cannot be checked for collisions: {error}"
        ) from error
    low, high = piece.bounds
    centre = (low + high) / 2
    radius = float(np.linalg.norm(piece.vertices - centre, axis=1).max())
    return _Bound(centre=centre, radius=radius)
