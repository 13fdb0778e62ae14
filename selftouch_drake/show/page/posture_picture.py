"""A robot in one posture, with what its skins feel, as a picture of pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from selftouch_drake.robot import World
from selftouch_drake.show.page.meshes import balls
from selftouch_drake.show.page.robot_figure import ball_radii, robot_meshes
from selftouch_drake.show.page.scene import add_scene, draw, visible
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one, surfaces_of
from selftouch_drake.show.style import BLUE, FIRM, PRESSURE, VERMILION, styled
from selftouch_drake.show.view import View

# Longest edge of what is sorted by depth, as a share of the picture.
_EDGE = 0.05
# Of a skin's receptors, as a share of its longest side.
_RECEPTOR = 0.02
# Postures that show where the robot gets.
_NUM_POSTURES = 100
# Of skins and of links.
_SKIN, _LINK = "#EBCBAA", "#7FA8CC"


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
        meshes = robot_meshes(skin, robot, size, skin_color=_SKIN, link_color=_LINK, edge=_EDGE)
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
