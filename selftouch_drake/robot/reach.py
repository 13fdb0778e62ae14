"""Approximations of touchers and skins to bound their distance: balls and grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Sphere
from scipy.spatial import cKDTree

from selftouch_drake.geometry import HollowSkin, farthest_points
from selftouch_drake.lazy import trimesh
from selftouch_drake.robot.pairs import Toucher
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.touchers import touching_triangles

# m, edge of a cell of the grid; larger where a skin is so large that its grid would have more than
# `_MOST_CELLS` along one side. Half as large rejects 1 to 5 % more steps, which saves no time, and
# takes eight times as long to build.
_CELL = 0.01
_MOST_CELLS = 160
# Number of balls that cover a toucher of another shape: more fit closer, fewer are faster.
_NUM_BALLS = 12
# m, between the samples of a touching skin.
_SPACING = 0.006


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallGrid:
    """Distances from the cells of a grid to a skin's wall, in the frame that carries the skin.

    Points on its outer, middle and inner layer represent the wall. A ball that touches the
    wall from outside is within its radius of a layer, and a point inside the wall is within half
    the longest step from layer to layer; and a point of a cell is within half the cell's diagonal
    of its centre.

    Attributes:
        origin: `(3,)` m, the corner of the first cell.
        cell: m, edge of a cell.
        reach: `(x, y, z)` float32 m: a ball whose centre is in this cell and whose radius is
            smaller does not touch the wall; 0 where any ball may.
        box: `(6,)` m, the lowest and highest coordinates of the wall.
    """

    origin: np.ndarray
    cell: float
    reach: np.ndarray
    box: np.ndarray

    @staticmethod
    def of(wall: HollowSkin, X_JL: np.ndarray, largest_radius: float) -> WallGrid:
        """The grid for balls up to `largest_radius` m.

        Args:
            wall: in the frame L of its link.
            X_JL: `(3, 4)` that frame in the frame that carries it.
            largest_radius: m.
        """
        corners = moved(X_JL, wall.tet_vertices)
        extent = float(np.ptp(corners, axis=0).max()) + 2 * largest_radius
        cell = max(_CELL, extent / _MOST_CELLS)
        points = moved(X_JL, wall.samples(cell / np.sqrt(3)))
        inside = np.linalg.norm(wall.vertices - wall.inner_vertices, axis=1).max() / 4
        slack = cell / np.sqrt(3) + cell * np.sqrt(3) / 2
        margin = max(largest_radius, inside) + slack
        origin = points.min(axis=0) - margin
        shape = np.ceil((points.max(axis=0) + margin - origin) / cell).astype(int)
        centres = origin + cell * (np.indices(shape).reshape(3, -1).T + 0.5)
        distance, _ = cKDTree(points).query(centres, distance_upper_bound=margin)
        reach = distance - slack
        reach[reach <= inside] = 0.0
        return WallGrid(
            origin=origin,
            cell=cell,
            # Rounded down, never up: what is rejected is out of reach.
            reach=np.nextafter(reach.astype(np.float32), -np.inf).reshape(shape),
            box=np.concatenate([corners.min(axis=0), corners.max(axis=0)]),
        )


def moved(X_AB: np.ndarray, p_BQ: np.ndarray) -> np.ndarray:
    """`(N, 3)` points in frame A, given in frame B, by its pose `(3, 4)`."""
    return p_BQ @ X_AB[:, :3].T + X_AB[:, 3]


def covering_balls(toucher: Toucher, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Balls that cover a toucher.

    Returns:
        `(B, 3)` m, centres in the toucher's frame, and `(B,)` m, radii.
    """
    inspector = robot.scene_graph.model_inspector()
    worn = {skin.geometry_id: skin.model.wall for skin in robot.skins}
    X_FL = toucher.frame.GetFixedPoseInBodyFrame().inverse()
    clouds, slacks, balls = [], [], []
    for geometry_id in toucher.geometry_ids:
        shape = inspector.GetShape(geometry_id)
        X_FG = X_FL.multiply(inspector.GetPoseInFrame(geometry_id))
        if geometry_id in worn:
            wall = worn[geometry_id]
            clouds.append(X_FL.multiply(wall.samples(_SPACING).T).T)
            half_step = np.linalg.norm(wall.vertices - wall.inner_vertices, axis=1).max() / 4
            slacks.append(half_step + _SPACING)
        elif isinstance(shape, Sphere):
            balls.append((X_FG.translation(), shape.radius()))
        else:
            mesh = trimesh.Trimesh(*touching_triangles(shape), process=False)
            spacing = max(float(mesh.extents.min()) / 8, 0.002)
            fine, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, spacing)
            clouds.append(X_FG.multiply(fine.T).T)
            slacks.append(spacing / np.sqrt(3))
    if clouds:
        cloud = np.concatenate(clouds)
        slack = np.repeat(slacks, [len(c) for c in clouds])
        chosen = farthest_points(
            lambda k: np.linalg.norm(cloud - cloud[k], axis=1), min(_NUM_BALLS, len(cloud))
        )
        distance, owner = cKDTree(cloud[chosen]).query(cloud)
        for ball, centre in enumerate(cloud[chosen]):
            mine = owner == ball
            balls.append((centre, float((distance[mine] + slack[mine]).max())))
    return np.array([c for c, _ in balls]), np.array([r for _, r in balls])
