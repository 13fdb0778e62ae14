"""Drawn skins, closed surfaces with receptors at the poses of their links, and paths over them."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.lazy import trimesh
from selftouch_drake.robot import World
from selftouch_drake.robot.skin_surface import SkinSurface, moved
from selftouch_drake.robot.skin_surface import surfaces_of as surfaces_of


def typical_extent(skins: "Sequence[SkinSurface]") -> float:
    """m, the extent of a typical skin, which marks are drawn in proportion to."""
    return float(np.median([skin.extent for skin in skins]))


def all_moved(skins: "Sequence[SkinSurface]", poses: np.ndarray) -> "list[SkinSurface]":
    """Each skin at its own pose `(skins, 3, 4)`."""
    return [skin.moved(pose) for skin, pose in zip(skins, poses, strict=True)]


def as_one(skins: "Sequence[SkinSurface]") -> "SkinSurface":
    """Skins in one frame as one surface of several pieces."""
    vertices, faces = trimesh.util.append_faces(
        [s.vertices for s in skins], [s.faces for s in skins]
    )
    receptors = np.concatenate([skin.receptors for skin in skins])
    return SkinSurface(name="", vertices=vertices, faces=faces, receptors=receptors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinPath:
    """Path of one toucher along a motion, in the frame of the skin on which it slides.

    In this frame, a moving body stands still.

    Attributes:
        skin: number of the skin.
        points: `(n, 3)` m, one after another.
        rows: `(n,)` the instants of the motion, rising.
    """

    skin: int
    points: np.ndarray
    rows: np.ndarray

    def moved(self, pose: np.ndarray) -> "SkinPath":
        """The same path with its frame put at a pose `(3, 4)`."""
        return dataclasses.replace(self, points=moved(self.points, pose))

    def stretches(self) -> list[np.ndarray]:
        """The points `(m, 3)` of each stretch without a break; at a break it touches elsewhere."""
        return np.split(self.points, np.flatnonzero(np.diff(self.rows) > 1) + 1)

    def dots(self, spacing: float) -> np.ndarray:
        """`(N, 3)` m, points `spacing` apart along all stretches."""
        return np.concatenate([evenly_spaced(each, spacing) for each in self.stretches()])

    def at(self, row: int) -> np.ndarray | None:
        """`(3,)` m, position at an instant; None if it is on another skin."""
        found = np.flatnonzero(self.rows == row)
        return self.points[found[0]] if len(found) else None


def touch_paths(world: World, q: np.ndarray) -> "list[SkinPath]":
    """Paths of all touchers over the skins, along a motion q `(T, J)`.

    Where balls touch one skin, all of their path is shown, in contact or not. Otherwise a path is
    where its toucher presses a skin: of a ball the path of its centre, of anything else that of the
    centre of pressure.
    """
    robot = world.robot
    are_balls = [world.experiment.touching[t.name].radius is not None for t in robot.touchers]
    X_WL, p_WT = robot.skin_positions(q), robot.toucher_positions(q)
    if len(robot.skins) == 1 and all(are_balls):
        every = np.arange(len(q))
        return [
            SkinPath(skin=0, points=_in_frames(place, X_WL[:, 0]), rows=every)
            for place in p_WT.swapaxes(0, 1)
        ]
    touches = world.probe.touches(q)
    paths = []
    for toucher, skin in sorted(set(zip(touches.toucher, touches.skin, strict=True))):
        here = (touches.toucher == toucher) & (touches.skin == skin)
        rows, points = touches.row[here], touches.p_LC[here]
        # Beyond the touchers are skins that touch one another.
        if toucher < len(are_balls) and are_balls[toucher]:
            points = _in_frames(p_WT[rows, toucher], X_WL[rows, skin])
        paths.append(SkinPath(skin=int(skin), points=points, rows=rows))
    return paths


def evenly_spaced(path: np.ndarray, spacing: float) -> np.ndarray:
    """`(N, 3)` points along a polyline `(T, 3)`, `spacing` apart, both in metres."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], 2 + int(length[-1] / spacing))
    return np.stack([np.interp(at, length, axis) for axis in path.T], axis=1)


def _in_frames(p_W: np.ndarray, X_WL: np.ndarray) -> np.ndarray:
    """`(N, 3)` points given in the world, each expressed in its own frame `(N, 3, 4)`."""
    return np.einsum("ni,nij->nj", p_W - X_WL[:, :, 3], X_WL[:, :, :3])
