"""A robot in one posture, with what its skins feel, as a picture of pixels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from selftouch_drake.robot import World
from selftouch_drake.show.page.meshes import ColoredMesh, balls, rod, shell, surface
from selftouch_drake.show.page.scene import add_scene, draw, visible
from selftouch_drake.show.robot_shape import DrawnRobot, RobotShape
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one, surfaces_of
from selftouch_drake.show.style import FIRM, PALE, PRESSURE, SKIN, VERMILION, styled
from selftouch_drake.show.view import View

# Sizes as shares of the picture: rods, the longest edge of what is sorted by depth, and the least
# radius of a ball that touches.
_ROD, _EDGE, _BALL = 0.02, 0.05, 0.016
# Of a skin's receptors, as a share of its longest side.
_RECEPTOR = 0.02
# Postures that show where the robot gets.
_NUM_POSTURES = 100


class PostureCamera:
    """Takes pictures of a robot, all from one side and at one scale.

    Args:
        world: of the robot.
        pixels: width and height of a picture.
    """

    def __init__(self, world: World, pixels: int = 480):
        self._robot, self._pixels = world.robot, pixels
        self._skins = surfaces_of(world.skins)
        self._shape = RobotShape(world.robot, world.experiment.touching)
        self._view = View()
        lower, upper = world.robot.babbled_range
        postures = np.random.default_rng(0).uniform(lower, upper, (_NUM_POSTURES, len(lower)))
        everything = np.concatenate([self._points(q) for q in postures])
        places = self._view.project(everything)[:, :2]
        low, high = places.min(axis=0), places.max(axis=0)
        self._middle, self._size = (low + high) / 2, 1.05 * float((high - low).max())

    def picture(self, q: np.ndarray, felt: np.ndarray) -> np.ndarray:
        """`(height, width, 3)` uint8, the robot at `(J,)` q, feeling `(S,)` N."""
        figure = self._figure(self._placed(q), self._shape.at(q), felt)
        canvas = FigureCanvasAgg(figure)
        figure.set_dpi(self._pixels)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def _placed(self, q: np.ndarray) -> SkinSurface:
        return as_one(all_moved(self._skins, self._robot.skin_positions(q[None])[0]))

    def _points(self, q: np.ndarray) -> np.ndarray:
        robot = self._shape.at(q)
        return np.concatenate(
            [
                self._placed(q).vertices,
                robot.joints,
                robot.balls,
                *(s.vertices for s in robot.links),
            ]
        )

    @styled
    def _figure(self, skin: SkinSurface, robot: DrawnRobot, felt: np.ndarray) -> Figure:
        # One inch wide: the resolution is the number of pixels.
        figure = Figure(figsize=(1.0, 1.0))
        ax = add_scene(figure, figure.add_gridspec(1, 1, left=0, right=1, bottom=0, top=1)[0])
        size, links = self._size, [(link.vertices, link.faces) for link in robot.links]
        draw(
            ax,
            self._view,
            surface(skin.vertices, skin.faces, SKIN),
            *(
                shell(link.vertices, link.faces, VERMILION if link.touches else PALE, _EDGE * size)
                for link in robot.links
            ),
            *(rod(a, b, _ROD * size, PALE) for a, b in robot.rods),
            *self._balls(robot),
        )
        seen = visible(skin.receptors, skin.vertices, skin.faces, self._view, others=links)
        extent = np.repeat([s.extent for s in self._skins], [len(s.receptors) for s in self._skins])
        colors = PRESSURE(np.clip(felt / FIRM, 0.0, 1.0))[:, :3]
        receptors = balls(skin.receptors[seen], _RECEPTOR * extent[seen], colors[seen], detail=1)
        draw(ax, self._view, receptors, zorder=2)
        (x, y), half = self._middle, size / 2
        ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        return figure

    def _balls(self, robot: DrawnRobot) -> Iterator[ColoredMesh]:
        if len(robot.balls):
            radii = np.maximum(robot.radii, _BALL * self._size)
            yield balls(robot.balls, radii, VERMILION, detail=2)
