"""The robot with its skins and what touches them: as a figure, and as pixels in any posture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from selftouch_drake.robot import World
from selftouch_drake.show.page.scene import (
    ColoredMesh,
    add_scene,
    balls,
    draw,
    fit_height,
    rod,
    scale_bar,
    shell,
    surface,
    unhidden,
    visible,
)
from selftouch_drake.show.robot_shape import DrawnRobot, RobotShape
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one, moved, surfaces_of
from selftouch_drake.show.style import (
    BLUE,
    FIRM,
    GREEN,
    INK,
    ORANGE,
    PALE,
    PRESSURE,
    SKIN,
    VERMILION,
    styled,
)
from selftouch_drake.show.view import View

# Sizes as shares of the whole picture's: joints, several joints in one point, rods, and the longest
# edge of what is sorted by depth.
_JOINT, _JOINTS, _ROD, _EDGE = 0.036, 0.028, 0.02, 0.025
# Degrees above the horizon, and round the vertical: never along an axis, where boxes look flat.
_ELEVATION = 18.0
_AZIMUTHS = [quarter + angle for quarter in (-90, 0, 90, 180) for angle in (22, 34, 45, 56, 68)]
# How far from its centre the housing of a joint ends, as such a share.
_HOUSING = 0.06
# A ball that touches is drawn at least so large, as a share of the whole picture.
_BALL = 0.016
# m; marks of larger robots are as large as for this size.
_LARGEST = 1.1
# The longest edge of pictures of pixels, which are drawn often.
_COARSE = 0.05
# Of a skin's receptors, as a share of its longest side.
_RECEPTOR = 0.02
# Postures that show where the robot gets.
_NUM_POSTURES = 100
# Of skins and of links.
_SKIN, _LINK = "#EBCBAA", "#7FA8CC"


@styled
def agent(skins: Sequence[SkinSurface], robot: DrawnRobot) -> Figure:
    """The agent: skins, receptors, joints and what touches (paper, figure 2).

    Args:
        skins: in the world.
        robot: in the same posture.
    """
    skin = as_one(skins)
    size = min(_size(skin, robot), _LARGEST)
    links = [(link.vertices, link.faces) for link in robot.links]
    everything = [*links, (skin.vertices, skin.faces)]
    view = _view(robot, everything, size)
    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    ax = add_scene(figure, figure.add_gridspec(1, 1)[0])
    draw(ax, view, *robot_meshes(skin, robot, size))
    seen = visible(skin.receptors, skin.vertices, skin.faces, view, others=links)
    radius = 0.012 * float(np.median([each.extent for each in skins]))
    draw(ax, view, balls(skin.receptors[seen], radius, INK), zorder=2)
    marks = _draw_joints(ax, view, robot, everything, size)
    _draw_balls(ax, view, robot, everything, size)
    scale_bar(ax)
    if len(robot.balls) or any(link.touches for link in robot.links):
        marks.append((VERMILION, "what touches"))
    marks.append((INK, f"receptors ({len(skin.receptors)})"))
    if np.ptp(ax.get_ylim()) < 0.8 * np.ptp(ax.get_xlim()):
        fit_height(figure, margin=0.6)
    handles = [ax.scatter([], [], s=30, color=color, label=label) for color, label in marks]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(marks), columnspacing=1.2)
    return figure


def robot_meshes(
    skin: SkinSurface,
    robot: DrawnRobot,
    size: float,
    *,
    skin_color: str = SKIN,
    link_color: str = PALE,
    edge: float = _EDGE,
) -> list[ColoredMesh]:
    """Skins and links of a robot, those that touch in orange, and rods for links without geometry.

    Args:
        skin: all skins, in the world.
        robot: in the same posture.
        size: m, of the whole picture.
        skin_color: of the skins.
        link_color: of links and rods.
        edge: longest edge of what is sorted by depth, as a share of `size`.
    """
    return [
        surface(skin.vertices, skin.faces, skin_color),
        *(
            shell(link.vertices, link.faces, VERMILION if link.touches else link_color, edge * size)
            for link in robot.links
        ),
        *(rod(a, b, _ROD * size, link_color) for a, b in robot.rods),
    ]


def ball_radii(robot: DrawnRobot, size: float) -> np.ndarray:
    """`(B,)` m, of the balls that touch, large enough to be seen in a picture of `size` m."""
    return np.maximum(robot.radii, _BALL * size)


def clearest(joints: np.ndarray, skins: Sequence[SkinSurface], skin_poses: np.ndarray) -> int:
    """The posture in which the joints are farthest from the skins, so that one sees them.

    Args:
        joints: `(N, J, 3)` m, in the world, in N postures.
        skins: each in the frame of its link.
        skin_poses: `(N, skins, 3, 4)`.
    """
    middles = [skin.vertices.mean(axis=0) for skin in skins]
    centres = np.array(
        [[moved(m, X) for m, X in zip(middles, Xs, strict=True)] for Xs in skin_poses]
    )
    distance = np.linalg.norm(joints[:, :, None] - centres[:, None], axis=3)
    # A distance that is the same in every posture says nothing.
    varies = np.ptp(distance, axis=0) > 1e-6
    if not varies.any():
        return 0
    return int(distance[:, varies].min(axis=1).argmax())


def _view(
    robot: DrawnRobot, everything: Sequence[tuple[np.ndarray, np.ndarray]], size: float
) -> View:
    """The side from which most joints and balls are seen, and apart from one another."""
    joints = np.unique(robot.joints.round(6), axis=0)
    places = np.concatenate([joints, robot.balls])
    lift = np.concatenate([np.full(len(joints), _HOUSING * size), 1.5 * ball_radii(robot, size)])
    # Touchers matter most.
    weight = np.repeat([1.0, 2.0], [len(joints), len(robot.balls)])

    def score(view: View) -> float:
        picture = view.project(places)[:, :2]
        apart = np.linalg.norm(picture[:, None] - picture, axis=2) + np.diag([np.inf] * len(places))
        seen = unhidden(places + lift[:, None] * view.towards, everything, view)
        return float((weight * np.minimum(apart.min(axis=1), 0.2 * size))[seen].sum())

    return max((View(_ELEVATION, azimuth) for azimuth in _AZIMUTHS), key=score)


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
    """Marks the joints that nothing hides; returns colour and name of each kind."""
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
    meshes = [
        balls(places[those & seen], radius * size, color, detail=3)
        for those, radius, color, _ in kinds
    ]
    draw(ax, view, *meshes, zorder=3)
    return [(color, label) for those, _, color, label in kinds if those.any()]


def _draw_balls(
    ax: Axes,
    view: View,
    robot: DrawnRobot,
    everything: Sequence[tuple[np.ndarray, np.ndarray]],
    size: float,
) -> None:
    """Draws the balls that touch over everything, those that nothing hides."""
    if not len(robot.balls):
        return
    radii = ball_radii(robot, size)
    seen = unhidden(robot.balls + 1.5 * radii[:, None] * view.towards, everything, view)
    draw(ax, view, balls(robot.balls[seen], radii[seen], VERMILION, detail=3), zorder=4)


class PostureCamera:
    """Takes pictures of a robot, all from one side and at one scale.

    Args:
        world: of the robot.
        pixels: width and height of a picture.
        postures: `(N, J)` that are to be in the picture; by default some of all postures.
    """

    def __init__(self, world: World, pixels: int = 480, postures: np.ndarray | None = None):
        self._robot, self._pixels = world.robot, pixels
        self._skins = surfaces_of(world.skins)
        self._shape = RobotShape(world.robot, world.experiment.touching)
        self._view = View()
        if postures is None:
            lower, upper = world.robot.babbled_range
            postures = np.random.default_rng(0).uniform(lower, upper, (_NUM_POSTURES, len(lower)))
        everything = np.concatenate([self._points(q) for q in postures])
        places = self._view.project(everything)[:, :2]
        low, high = places.min(axis=0), places.max(axis=0)
        self._middle, self._size = (low + high) / 2, 1.05 * float((high - low).max())

    def picture(
        self, q: np.ndarray, felt: np.ndarray, trail: np.ndarray | None = None
    ) -> np.ndarray:
        """`(height, width, 3)` uint8, the robot at `(J,)` q, feeling `(S,)` N.

        `trail` `(n, 3)` m are places on the skins, in the world, that are marked.
        """
        figure = self._figure(q, felt, np.zeros((0, 3)) if trail is None else trail)
        canvas = FigureCanvasAgg(figure)
        figure.set_dpi(self._pixels)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    @styled
    def _figure(self, q: np.ndarray, felt: np.ndarray, trail: np.ndarray) -> Figure:
        skin, robot = self._placed(q), self._shape.at(q)
        # One inch wide: the resolution is the number of pixels.
        figure = Figure(figsize=(1.0, 1.0))
        ax = add_scene(figure, figure.add_gridspec(1, 1, left=0, right=1, bottom=0, top=1)[0])
        size, links = self._size, [(link.vertices, link.faces) for link in robot.links]
        meshes = robot_meshes(skin, robot, size, skin_color=_SKIN, link_color=_LINK, edge=_COARSE)
        if len(robot.balls):
            meshes.append(balls(robot.balls, ball_radii(robot, size), VERMILION))
        draw(ax, self._view, *meshes)
        seen = visible(skin.receptors, skin.vertices, skin.faces, self._view, others=links)
        extent = np.repeat([s.extent for s in self._skins], [len(s.receptors) for s in self._skins])
        colors = PRESSURE(np.clip(felt / FIRM, 0.0, 1.0))[:, :3]
        receptors = balls(skin.receptors[seen], _RECEPTOR * extent[seen], colors[seen], detail=1)
        draw(ax, self._view, receptors, zorder=2)
        trail = trail[visible(trail, skin.vertices, skin.faces, self._view, others=links)]
        x, y = self._view.project(trail)[:, :2].T
        ax.scatter(x, y, s=0.15, color=BLUE, zorder=3)
        (x, y), half = self._middle, size / 2
        ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        return figure

    def _placed(self, q: np.ndarray) -> SkinSurface:
        return as_one(all_moved(self._skins, self._robot.skin_positions(q[None])[0]))

    def _points(self, q: np.ndarray) -> np.ndarray:
        robot = self._shape.at(q)
        links = (link.vertices for link in robot.links)
        return np.concatenate([self._placed(q).vertices, robot.joints, robot.balls, *links])
