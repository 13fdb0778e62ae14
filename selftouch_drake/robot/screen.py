"""Says which configurations cannot touch any skin, so that Drake need not be asked.

Exact in one direction: what it rejects is out of reach. Each toucher is stood for by balls that
cover it, each skin by a grid of distances to its wall in the frame of its link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import trimesh
from pydrake.geometry import Sphere
from scipy.spatial import cKDTree

from selftouch_drake.geometry import HollowSkin, farthest_points, wall_points
from selftouch_drake.robot.kinematics import compose, joint_poses
from selftouch_drake.robot.links import as_mesh
from selftouch_drake.robot.pairs import Toucher
from selftouch_drake.robot.robot import Robot

# m, edge of a cell of the grid; larger where a skin is so large that its grid would have more than
# `_MOST_CELLS` along one side.
_CELL = 0.005
_MOST_CELLS = 160
# Balls that stand for a toucher which is none: more fit closer, fewer are quicker to ask.
_NUM_BALLS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallGrid:
    """How far the cells of a grid are from a skin's wall, in the frame of its link.

    The wall is stood for by points on its outer, middle and inner layer. A ball that touches the
    wall from outside is within its radius of a layer, and a point inside the wall is within half
    the longest step from layer to layer; a triangle whose edges are no longer than e is nowhere
    farther than e / sqrt(3) from its corners; and a point of a cell is within half the cell's
    diagonal of its centre.

    Attributes:
        origin: `(3,)` m, the corner of the first cell.
        cell: m, edge of a cell.
        reach: `(x, y, z)` float32 m: a ball whose centre is in this cell and whose radius is
            smaller does not touch the wall; 0 where any ball may.
        farthest: m, the largest radius that the grid can judge.
    """

    origin: np.ndarray
    cell: float
    reach: np.ndarray
    farthest: float

    @staticmethod
    def of(wall: HollowSkin, largest_radius: float) -> WallGrid:
        """The grid for balls up to `largest_radius` m."""
        extent = float(np.ptp(wall.tet_vertices, axis=0).max()) + 2 * largest_radius
        cell = max(_CELL, extent / _MOST_CELLS)
        points = wall_points(wall, cell)
        inside = np.linalg.norm(wall.vertices - wall.inner_vertices, axis=1).max() / 4
        slack = cell / np.sqrt(3) + cell * np.sqrt(3) / 2
        farthest = max(largest_radius, inside)
        margin = farthest + slack
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
            farthest=farthest,
        )


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
            clouds.append(X_FL.multiply(wall_points(wall, 0.01).T).T)
            half_step = np.linalg.norm(wall.vertices - wall.inner_vertices, axis=1).max() / 4
            slacks.append(half_step + 0.01 / np.sqrt(3))
        elif isinstance(shape, Sphere):
            balls.append((X_FG.translation(), shape.radius()))
        else:
            mesh = as_mesh(shape)
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


class TouchScreen:
    """The screen of one robot."""

    def __init__(self, robot: Robot):
        covers = [covering_balls(toucher, robot) for toucher in robot.touchers]
        largest = max(float(radius.max()) for _, radius in covers)
        bounds = [_bounding_ball(centre, radius) for centre, radius in covers]
        largest = max(largest, max(radius for _, radius in bounds))
        grids = [WallGrid.of(skin.model.wall, largest) for skin in robot.skins]
        self._pairs = np.array(robot.touching_pairs, dtype=np.int64).reshape(-1, 2)
        self._kinematics = robot.kinematics
        self._num_skins = len(grids)
        # The bounding ball of each toucher comes first; if it is off, none of its balls is on.
        self._ball_ends = np.cumsum([0, *(len(r) + (len(r) > 1) for _, r in covers)])
        self._centre = np.concatenate(
            [
                np.concatenate([bound[None], centre]) if len(radius) > 1 else centre
                for (bound, _), (centre, radius) in zip(bounds, covers, strict=True)
            ]
        )
        self._radius = np.concatenate(
            [
                np.concatenate([[bound], radius]) if len(radius) > 1 else radius
                for (_, bound), (_, radius) in zip(bounds, covers, strict=True)
            ]
        )
        self._origin = np.array([grid.origin for grid in grids])
        self._cell = np.array([grid.cell for grid in grids])
        self._shape = np.array([grid.reach.shape for grid in grids])
        self._grid_ends = np.cumsum([0, *(grid.reach.size for grid in grids)])
        self._reach = np.concatenate([grid.reach.ravel() for grid in grids])

    def may_touch(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether anything might touch a skin at `q` `(N, J)`."""
        found = np.empty(len(q), dtype=np.bool_)
        k = self._kinematics
        _may_touch(
            np.ascontiguousarray(q, dtype=float), k.parent, k.X_PF, k.axis_F, k.turns, k.owner,
            k.X_JL, self._num_skins, self._pairs, self._ball_ends, self._centre, self._radius,
            self._origin, self._cell, self._shape, self._grid_ends, self._reach, found,
        )  # fmt: skip
        return found


def _bounding_ball(centre: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, float]:
    middle = (centre.min(axis=0) + centre.max(axis=0)) / 2
    return middle, float((np.linalg.norm(centre - middle, axis=1) + radius).max())


@numba.njit(cache=True, error_model="numpy")
def _may_touch(
    q, parent, X_PF, axis_F, turns, owner, X_JL, num_skins, pairs, ball_ends, centre, radius,
    origin, cell, shape, grid_ends, reach, found,
):  # fmt: skip
    num_joints = len(parent)
    X_WJ = np.empty((num_joints, 3, 4))
    X_WF, X_FJ = np.empty((3, 4)), np.empty((3, 4))
    X_WL = np.empty((len(owner), 3, 4))
    for row in range(len(q)):
        joint_poses(q[row], parent, X_PF, axis_F, turns, X_WJ, X_WF, X_FJ)
        for frame in range(len(owner)):
            if owner[frame] < 0:
                X_WL[frame] = X_JL[frame]
            else:
                compose(X_WJ[owner[frame]], X_JL[frame], X_WL[frame])
        near = False
        for pair in range(len(pairs)):
            toucher, skin = pairs[pair, 0], pairs[pair, 1]
            X_WT, X_WS = X_WL[num_skins + toucher], X_WL[skin]
            first = ball_ends[toucher]
            for ball in range(first, ball_ends[toucher + 1]):
                x = X_WT[0, 3] - X_WS[0, 3]
                y = X_WT[1, 3] - X_WS[1, 3]
                z = X_WT[2, 3] - X_WS[2, 3]
                for i in range(3):
                    x += X_WT[0, i] * centre[ball, i]
                    y += X_WT[1, i] * centre[ball, i]
                    z += X_WT[2, i] * centre[ball, i]
                inside = True
                place = 0
                for i in range(3):
                    along = X_WS[0, i] * x + X_WS[1, i] * y + X_WS[2, i] * z - origin[skin, i]
                    step = int(np.floor(along / cell[skin]))
                    inside &= 0 <= step < shape[skin, i]
                    place = place * shape[skin, i] + step
                touching = inside and reach[grid_ends[skin] + place] <= radius[ball]
                bounding = ball == first and ball_ends[toucher + 1] - first > 1
                if bounding and not touching:
                    break
                if touching and not bounding:
                    near = True
                    break
            if near:
                break
        found[row] = near
