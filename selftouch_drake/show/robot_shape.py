"""The drawn robot: links, joints and touching balls, in any posture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Role
from pydrake.multibody.tree import Frame, RigidBody

from selftouch_drake.lazy import trimesh
from selftouch_drake.robot import Robot, World
from selftouch_drake.robot.kinematics import Kinematics
from selftouch_drake.robot.links import all_links, link_geometries, pieces_in_link
from selftouch_drake.show.skins import moved

# m; finer triangles are invisible in a picture. A link with very many triangles gets larger ones.
_FINEST, _MOST_FACES = 0.0025, 4000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnRobot:
    """A robot in one posture, in the world.

    Attributes:
        links: `(V, 3)` m vertices and `(F, 3)` indices of triangles of each drawn link.
        touches: whether each of them is what presses skins.
        rods: `(n, 2, 3)` m, ends of those that the model draws nothing of.
        joints: `(J, 3)` m, where the moving joints are.
        turns: `(J,)` bool, whether each turns or slides.
        balls: `(B, 3)` m, centres of the balls that touch.
        radii: `(B,)` m.
    """

    links: Sequence[tuple[np.ndarray, np.ndarray]]
    touches: Sequence[bool]
    rods: np.ndarray
    joints: np.ndarray
    turns: np.ndarray
    balls: np.ndarray
    radii: np.ndarray


class RobotShape:
    """The drawing of a robot, for any posture.

    A link is drawn by its visual geometry, or by its collision geometry if it has no other. Links
    whose skin lies on their own geometry are left to their skin.
    """

    def __init__(self, world: World):
        robot, self._turns = world.robot, world.robot.turns
        self._meshes = _drawn_meshes(robot)
        pairs = [(each, world.experiment.touching[each.name].radius) for each in robot.touchers]
        self._touching = {int(t.link.index()) for t, radius in pairs if radius is None}
        self._radii = np.array([radius for _, radius in pairs if radius is not None])
        frames: list[Frame] = [joint.frame_on_parent() for joint in robot.joints]
        frames += [toucher.frame for toucher, radius in pairs if radius is not None]
        frames += [link.body_frame() for link, _ in self._meshes]
        self._kinematics = Kinematics.of(robot.plant, frames)
        self._ends = np.cumsum([len(robot.joints), len(self._radii)])

    def joints(self, q: np.ndarray) -> np.ndarray:
        """`(N, J, 3)` m, the joints in the world at `q` `(N, J)`."""
        return self._kinematics.poses(q)[:, : self._ends[0], :, 3]

    def at(self, q: np.ndarray) -> DrawnRobot:
        """The robot at `(J,)` q."""
        (poses,) = self._kinematics.poses(np.asarray(q, dtype=float)[None])
        joints, balls, links = np.split(poses, self._ends)
        return DrawnRobot(
            links=[
                (moved(np.asarray(mesh.vertices), pose), np.asarray(mesh.faces))
                for (_, mesh), pose in zip(self._meshes, links, strict=True)
            ],
            touches=[int(link.index()) in self._touching for link, _ in self._meshes],
            rods=self._rods(joints[:, :, 3], balls[:, :, 3]),
            joints=joints[:, :, 3],
            turns=self._turns,
            balls=balls[:, :, 3],
            radii=self._radii,
        )

    def _rods(self, joints: np.ndarray, balls: np.ndarray) -> np.ndarray:
        """Rods between joints, and to balls, where the model draws nothing."""
        owner = self._kinematics.owner
        drawn = {int(joint) for joint in owner[self._ends[1] :]}
        ends = [*joints, *balls]
        rods = [
            (joints[before], ends[k])
            for k, before in enumerate(owner[: self._ends[1]])
            if before >= 0
            and int(before) not in drawn
            and np.linalg.norm(ends[k] - joints[before]) > 1e-6
        ]
        return np.array(rods).reshape(-1, 2, 3)


def _drawn_meshes(robot: Robot) -> list[tuple[RigidBody, trimesh.Trimesh]]:
    """Links with visual geometry, each in its own frame."""
    inspector = robot.scene_graph.model_inspector()
    added = {skin.geometry_id for skin in robot.skins}
    added |= {geometry for toucher in robot.touchers for geometry in toucher.geometry_ids}
    covered = {int(s.link.index()) for s in robot.skins if s.model.is_own_geometry}
    meshes = []
    for link in all_links(robot.plant)[1:]:
        if int(link.index()) in covered:
            continue
        for role in (Role.kIllustration, Role.kProximity):
            all_of_link = link_geometries(robot.plant, inspector, link, role)
            own = [geometry for geometry in all_of_link if geometry not in added]
            try:
                pieces = pieces_in_link(inspector, own)
            except ValueError:  # a half space has no end to draw
                pieces = []
            if pieces:
                joined = trimesh.util.concatenate(pieces)
                meshes.append((link, _coarse(joined)))  # type: ignore[arg-type]  # of meshes a mesh
                break
    return meshes


def _coarse(mesh: trimesh.Trimesh, cell: float = _FINEST) -> trimesh.Trimesh:
    """The mesh with all vertices in one cell of a grid, in m, merged."""
    _, number = np.unique((mesh.vertices / cell).round(), axis=0, return_inverse=True)
    number = number.ravel()
    share = 1.0 / np.bincount(number)
    vertices = np.stack([np.bincount(number, axis) * share for axis in mesh.vertices.T], axis=1)
    faces = number[mesh.faces]
    a, b, c = faces.T
    joined = trimesh.Trimesh(vertices, faces[(a != b) & (b != c) & (c != a)], process=False)
    return joined if len(joined.faces) <= _MOST_FACES else _coarse(mesh, 2 * cell)
