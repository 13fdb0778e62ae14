"""The agent: its robot, the skins that it wears and what touches them (paper, figure 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from selftouch_drake.show.page.scene import add_scene, draw, scale_bar, unhidden, visible
from selftouch_drake.show.page.solids import balls, rod, shell, surface
from selftouch_drake.show.robot_shape import DrawnRobot
from selftouch_drake.show.skins import SkinSurface, as_one, moved
from selftouch_drake.show.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALE,
    SKIN,
    VERMILION,
    styled,
)
from selftouch_drake.show.view import View

# Sizes as shares of the whole picture's: joints, several joints in one point, rods, and the longest
# edge of what is sorted by depth.
_JOINT, _JOINTS, _ROD, _EDGE = 0.036, 0.028, 0.02, 0.025
# How far from its centre the housing of a joint ends, as such a share.
_HOUSING = 0.06
# A ball that touches is drawn at least so large, as a share of the whole picture.
_BALL = 0.016


@styled
def agent(skins: Sequence[SkinSurface], robot: DrawnRobot) -> Figure:
    """The agent: skins, receptors, joints and what touches (paper, figure 2).

    Args:
        skins: in the world.
        robot: in the same posture.
    """
    skin = as_one(skins)
    size = _size(skin, robot)
    view = _view(robot)
    links = [(link.vertices, link.faces) for link in robot.links]
    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    ax = add_scene(figure, figure.add_gridspec(1, 1)[0])
    draw(
        ax,
        view,
        surface(skin.vertices, skin.faces, SKIN),
        *(
            shell(link.vertices, link.faces, VERMILION if link.touches else PALE, _EDGE * size)
            for link in robot.links
        ),
        *(rod(a, b, _ROD * size, PALE) for a, b in robot.rods),
    )
    seen = visible(skin.receptors, skin.vertices, skin.faces, view, others=links)
    radius = 0.012 * float(np.median([each.extent for each in skins]))
    draw(ax, view, balls(skin.receptors[seen], radius, INK), zorder=2)
    everything = [*links, (skin.vertices, skin.faces)]
    marks = _draw_joints(ax, view, robot, everything, size)
    _draw_balls(ax, view, skin, robot, links, size)
    scale_bar(ax)
    if len(robot.balls) or any(link.touches for link in robot.links):
        marks.append((VERMILION, "what touches"))
    marks.append((INK, f"receptors ({len(skin.receptors)})"))
    handles = [ax.scatter([], [], s=30, color=color, label=label) for color, label in marks]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(marks), columnspacing=1.2)
    return figure


def clearest(joints: np.ndarray, skins: Sequence[SkinSurface], skin_poses: np.ndarray) -> int:
    """The posture in which the joints are farthest from the skins, so that one sees them.

    Args:
        joints: `(N, J, 3)` m, in the world, in N postures.
        skins: each in the frame of its link.
        skin_poses: `(N, skins, 3, 4)`.
    """
    middles = [skin.vertices.mean(axis=0) for skin in skins]
    centres = np.array([[moved(m, X) for m, X in zip(middles, Xs, strict=True)] for Xs in skin_poses])
    distance = np.linalg.norm(joints[:, :, None] - centres[:, None], axis=3)
    # What a joint keeps from a skin in every posture says nothing.
    varies = np.ptp(distance, axis=0) > 1e-6
    if not varies.any():
        return 0
    return int(distance[:, varies].min(axis=1).argmax())


def _view(robot: DrawnRobot) -> View:
    """From beside the vertical plane in which the robot reaches from its first joint."""
    base = robot.joints[0]
    ends = robot.joints if not len(robot.balls) else np.concatenate([robot.joints, robot.balls])
    reach = ends - base
    # Level directions alone count.
    level = reach[np.linalg.norm(reach[:, :2], axis=1).argmax()]
    view = View.facing(level + 1e-9, elevation=16.0)
    return View(view.elevation, view.azimuth - 40.0)


def _size(skin: SkinSurface, robot: DrawnRobot) -> float:
    points = [skin.vertices, robot.joints, robot.balls, *(link.vertices for link in robot.links)]
    return float(np.ptp(np.concatenate([p.reshape(-1, 3) for p in points]), axis=0).max())


def _draw_joints(
    ax: Axes,
    view: View,
    robot: DrawnRobot,
    everything: Sequence[tuple[np.ndarray, np.ndarray]],
    size: float,
) -> list[tuple[str, str]]:
    """Marks the joints that nothing hides; returns colour and name of each kind that there is."""
    places, which = np.unique(robot.joints.round(6), axis=0, return_inverse=True)
    number = np.bincount(which.ravel())
    turns = np.array([robot.turns[which.ravel() == k].all() for k in range(len(places))])
    # Through the housing of the joint itself, but not through another link.
    seen = unhidden(places + _HOUSING * size * view.towards, everything, view)
    kinds = (
        (turns & (number < 3), _JOINT, BLUE, "joints that turn"),
        (turns & (number >= 3), _JOINTS, GREEN, "three in one point"),
        (~turns, _JOINT, ORANGE, "joints that slide"),
    )
    solids = [
        balls(places[those & seen], radius * size, color, detail=3)
        for those, radius, color, _ in kinds
    ]
    draw(ax, view, *solids, zorder=3)
    return [(color, label) for those, _, color, label in kinds if those.any()]


def _draw_balls(
    ax: Axes,
    view: View,
    skin: SkinSurface,
    robot: DrawnRobot,
    links: Sequence[tuple[np.ndarray, np.ndarray]],
    size: float,
) -> None:
    """Draws the balls that touch over everything, those that nothing hides."""
    if not len(robot.balls):
        return
    radii = np.maximum(robot.radii, _BALL * size)
    # Where it presses, a ball is deep in the skin: the skin's surface there counts.
    near = cKDTree(skin.vertices).query(robot.balls)[0] < 3 * radii
    everything = [*links, (skin.vertices, skin.faces)]
    seen = unhidden(robot.balls + 1.5 * radii[:, None] * view.towards, everything, view)
    on_skin = visible(robot.balls, skin.vertices, skin.faces, view, others=links)
    seen = np.where(near, seen | on_skin, seen)
    draw(ax, view, balls(robot.balls[seen], radii[seen], VERMILION, detail=3), zorder=4)
