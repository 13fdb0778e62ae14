"""The robot with its skins and what touches them: as a figure, and as pixels in any posture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from selftouch_drake.lazy import trimesh
from selftouch_drake.robot import World
from selftouch_drake.show.page.scene import (
    add_scene,
    balls,
    draw,
    scale_bar,
    surface,
    unhidden,
    visible,
)
from selftouch_drake.show.robot_shape import DrawnRobot, RobotShape
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one, surfaces_of
from selftouch_drake.show.style import (
    BLUE,
    FIRM,
    INK,
    ORANGE,
    PRESSURE,
    VERMILION,
    View,
    styled,
)

# Sizes as shares of the whole picture's: joints, rods, and the longest edge of what is sorted by
# depth.
_JOINT, _ROD, _EDGE = 0.036, 0.02, 0.04
# Degrees above the horizon, and round the vertical: never along an axis, where boxes look flat.
_ELEVATION = 18.0
_AZIMUTHS = [quarter + angle for quarter in (-90, 0, 90, 180) for angle in (22, 34, 45, 56, 68)]
_VIEWS = [View(_ELEVATION, azimuth) for azimuth in _AZIMUTHS]
# How far from its centre the housing of a joint ends, as such a share.
_HOUSING = 0.06
# A ball that touches is drawn at least so large, as a share of the whole picture.
_BALL = 0.016
# m; marks of larger robots are as large as for this size.
_LARGEST = 1.1
# Of a skin's receptors, as a share of its longest side.
_RECEPTOR = 0.016
# Postures that show where the robot gets.
_NUM_POSTURES = 100
# Of skins and of links.
_SKIN, _LINK = "#EBCBAA", "#7FA8CC"


@dataclass(frozen=True, slots=True, eq=False)
class Touching:
    """A robot in a posture in which it may touch itself.

    Attributes:
        skins: in the world.
        robot: the rest of it.
        felt: `(S,)` N, what the receptors of all skins feel; None if that is unknown.
    """

    skins: Sequence[SkinSurface]
    robot: DrawnRobot
    felt: np.ndarray | None = None

    @property
    def place(self) -> np.ndarray | None:
        """`(3,)` m, where the skin is touched; None if no receptor feels anything."""
        if self.felt is None or not self.felt.any():
            return None
        skin = as_one(self.skins)
        place = skin.receptors[self.felt.argmax()]
        if len(self.robot.balls):
            # Receptors may be few: what touches is nearer to the place.
            place = min(self.robot.balls, key=lambda ball: float(np.linalg.norm(ball - place)))
        return skin.vertices[np.linalg.norm(skin.vertices - place, axis=1).argmin()]


def how_well_seen(posture: Touching) -> float:
    """How well the touch of a posture is seen from its best side; 0 if there is none to see."""
    if posture.place is None:
        return 0.0
    return _view(posture)[1]


@styled
def agent(posture: Touching) -> Figure:
    """The agent: skins in the world, receptors, joints, what touches, and where (paper, fig. 2)."""
    skins, robot = posture.skins, posture.robot
    skin = as_one(skins)
    triangles = _triangles(skin, robot)
    size = _size(robot, triangles)
    view, _ = _view(posture)
    figure = Figure(figsize=(5.6, 5.0), layout="constrained")
    ax = add_scene(figure, figure.add_gridspec(1, 1)[0])
    colors = np.tile(to_rgb(INK), (len(skin.receptors), 1))
    _draw_robot(ax, view, skins, robot, size, colors)
    marks = _draw_joints(ax, view, robot, triangles, size)
    scale_bar(ax)
    if len(robot.balls) or any(robot.touches):
        marks.append((VERMILION, "what touches"))
    marks.append((INK, f"receptors ({len(skin.receptors)})"))
    handles = [ax.scatter([], [], s=30, color=color, label=label) for color, label in marks]
    if posture.place is not None:
        x, y = view.project(posture.place[None])[0, :2]
        ax.scatter([x], [y], s=320, facecolors="none", edgecolors=VERMILION, zorder=6)
        handles.append(
            ax.scatter([], [], s=60, facecolors="none", edgecolors=VERMILION, label="the touch")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=3, columnspacing=1.2)
    return figure


def _size(robot: DrawnRobot, triangles: np.ndarray) -> float:
    """Size of the whole picture, m."""
    points = np.concatenate([robot.joints, robot.balls, triangles.reshape(-1, 3)])
    return min(float(np.ptp(points, axis=0).max()), _LARGEST)


def _draw_robot(
    ax: Axes,
    view: View,
    skins: Sequence[SkinSurface],
    robot: DrawnRobot,
    size: float,
    colors: np.ndarray,
) -> None:
    """Draws skins, links, what touches in orange, and visible receptors in colours `(S, 3)`."""
    skin = as_one(skins)
    meshes = [surface(skin.vertices, skin.faces, _SKIN)]
    for link, touches in zip(robot.links, robot.touches, strict=True):
        color = VERMILION if touches else _LINK
        meshes.append(surface(*link, color, max_edge=_EDGE * size))
    for ends in robot.rods:
        rod = trimesh.creation.cylinder(_ROD * size, segment=ends, sections=24)
        meshes.append(surface(rod.vertices, rod.faces, _LINK, max_edge=_ROD * size))
    draw(ax, view, *meshes)
    # What presses a skin is partly in it: balls are drawn over everything.
    triangles, radii = _triangles(skin, robot), _ball_radii(robot, size)
    out = unhidden(robot.balls + 1.5 * radii[:, None] * view.towards, triangles, view)
    draw(ax, view, balls(robot.balls[out], radii[out], VERMILION, detail=3), zorder=4)
    seen = visible(skin.receptors, skin.vertices, skin.faces, view, others=robot.links)
    extent = np.repeat([each.extent for each in skins], [len(each.receptors) for each in skins])
    receptors = balls(skin.receptors[seen], _RECEPTOR * extent[seen], colors[seen], detail=1)
    draw(ax, view, receptors, zorder=2)


def _triangles(skin: SkinSurface, robot: DrawnRobot) -> np.ndarray:
    """`(M, 3, 3)` m, all that may hide something."""
    everything = [*robot.links, (skin.vertices, skin.faces)]
    return np.concatenate([vertices[faces] for vertices, faces in everything])


def _ball_radii(robot: DrawnRobot, size: float) -> np.ndarray:
    """`(B,)` m, of the balls that touch, large enough to be seen in a picture of `size` m."""
    return np.maximum(robot.radii, _BALL * size)


def _view(posture: Touching) -> tuple[View, float]:
    """The side from which the touch and most joints are seen, apart from one another; how well."""
    robot, skin = posture.robot, as_one(posture.skins)
    triangles = _triangles(skin, robot)
    size = _size(robot, triangles)
    joints = np.unique(robot.joints.round(6), axis=0)
    place = np.zeros((0, 3)) if posture.place is None else posture.place[None]
    places = np.concatenate([joints, robot.balls, place])
    lift = np.concatenate(
        [
            np.full(len(joints), _HOUSING * size),
            1.5 * _ball_radii(robot, size),
            np.full(len(place), 2 * _BALL * size),
        ]
    )
    # The touch matters most, and then what touches.
    weight = np.repeat([1.0, 2.0, 10.0], [len(joints), len(robot.balls), len(place)])

    def score(view: View) -> float:
        picture = view.project(places)[:, :2]
        apart = np.linalg.norm(picture[:, None] - picture, axis=2) + np.diag([np.inf] * len(places))
        # The touch lies where what touches is.
        apart[:, len(joints) + len(robot.balls) :] = np.inf
        near = np.minimum(apart.min(axis=1), 0.2 * size)
        near[len(joints) + len(robot.balls) :] = 0.2 * size
        seen = unhidden(places + lift[:, None] * view.towards, triangles, view)
        return float((weight * near)[seen].sum() / size)

    scores = [score(view) for view in _VIEWS]
    best = int(np.argmax(scores))
    return _VIEWS[best], scores[best]


def _draw_joints(
    ax: Axes, view: View, robot: DrawnRobot, triangles: np.ndarray, size: float
) -> list[tuple[str, str]]:
    """Marks the joints that nothing hides; returns colour and name of each kind."""
    places, which = np.unique(robot.joints.round(6), axis=0, return_inverse=True)
    turns = np.array([robot.turns[which.ravel() == k].all() for k in range(len(places))])
    # Through the housing of the joint itself, but not through another link.
    seen = unhidden(places + _HOUSING * size * view.towards, triangles, view)
    kinds = ((turns, BLUE, "joints that turn"), (~turns, ORANGE, "joints that slide"))
    meshes = [
        balls(places[those & seen], _JOINT * size, color, detail=3) for those, color, _ in kinds
    ]
    draw(ax, view, *meshes, zorder=3)
    return [(color, label) for those, color, label in kinds if those.any()]


class PostureCamera:
    """Takes pictures of a robot, all from one side and at one scale.

    Args:
        pixels: width and height of a picture.
        postures: `(N, J)` that are to be in the picture; by default some of all postures.
    """

    def __init__(self, world: World, pixels: int = 480, postures: np.ndarray | None = None):
        self._robot, self._pixels = world.robot, pixels
        self._skins = surfaces_of(world.skins)
        self._shape = RobotShape(world)
        self._view = View()
        if postures is None:
            lower, upper = world.robot.babbled_range
            postures = np.random.default_rng(0).uniform(lower, upper, (_NUM_POSTURES, len(lower)))
        everything = np.concatenate([self._points(q) for q in postures])
        places = self._view.project(everything)[:, :2]
        low, high = places.min(axis=0), places.max(axis=0)
        self._middle, self._size = (low + high) / 2, 1.05 * float((high - low).max())

    @styled
    def picture(
        self, q: np.ndarray, felt: np.ndarray, trail: np.ndarray | None = None
    ) -> np.ndarray:
        """`(height, width, 3)` uint8, the robot at `(J,)` q, feeling `(S,)` N.

        `trail` `(n, 3)` m are places on the skins, in the world, that are marked.
        """
        # One inch wide: the resolution is the number of pixels.
        figure = Figure(figsize=(1.0, 1.0), dpi=self._pixels)
        ax = add_scene(figure, figure.add_gridspec(1, 1, left=0, right=1, bottom=0, top=1)[0])
        skins, robot = self._placed(q), self._shape.at(q)
        colors = PRESSURE(np.clip(felt / FIRM, 0.0, 1.0))[:, :3]
        _draw_robot(ax, self._view, skins, robot, self._size, colors)
        if trail is not None:
            skin = as_one(skins)
            seen = visible(trail, skin.vertices, skin.faces, self._view, others=robot.links)
            x, y = self._view.project(trail[seen])[:, :2].T
            ax.scatter(x, y, s=0.15, color=BLUE, zorder=3)
        (x, y), half = self._middle, self._size / 2
        ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def _placed(self, q: np.ndarray) -> list[SkinSurface]:
        return all_moved(self._skins, self._robot.skin_positions(q[None])[0])

    def _points(self, q: np.ndarray) -> np.ndarray:
        robot = self._shape.at(q)
        links = (vertices for vertices, _ in robot.links)
        skins = (skin.vertices for skin in self._placed(q))
        return np.concatenate([robot.joints, robot.balls, *skins, *links])
