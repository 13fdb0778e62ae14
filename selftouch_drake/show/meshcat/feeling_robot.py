"""A robot in Meshcat, in any posture, with its sensation."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from selftouch_drake.robot import World
from selftouch_drake.show.meshcat.skin_drawing import SkinDrawing
from selftouch_drake.show.meshcat.stage import VIEW, RobotDrawing, draw_balls, set_stage
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.skins import all_moved, as_one, surfaces_of
from selftouch_drake.show.style import FIRM


class FeelingRobot:
    """A robot that can be posed and coloured by sensations.

    Args:
        meshcat: where it is drawn.
        world: of the robot.

    Attributes:
        home: `(J,)` rad or m, the posture that its model has by default.
        middle: `(3,)` m, of its skins in that posture.
        size: m, their longest side.
    """

    def __init__(self, meshcat: Meshcat, world: World):
        self._meshcat, self._robot = meshcat, world.robot
        self._drawing = RobotDrawing(meshcat, world.experiment, world.skins)
        skins = surfaces_of(world.skins)
        self._skins = SkinDrawing(meshcat, "/skins", skins)
        self._balls = draw_balls(meshcat, RobotShape(self._robot, world.experiment.touching))
        plant = self._robot.plant
        self.home = plant.GetPositions(plant.CreateDefaultContext())
        at_home = as_one(all_moved(skins, self._robot.skin_positions(self.home[None])[0]))
        low, high = at_home.vertices.min(axis=0), at_home.vertices.max(axis=0)
        self.middle, self.size = (low + high) / 2, float((high - low).max())
        set_stage(meshcat, VIEW, self.middle, self.size)

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Shows the robot at `(J,)` q, feeling `(S,)` N."""
        self._drawing.put(q)
        self._skins.move(self._robot.skin_positions(q[None])[0])
        places = self._robot.toucher_positions(q[None])[0]
        for number, path in self._balls.items():
            self._meshcat.SetTransform(path, RigidTransform(places[number]))
        self._skins.show(felt / FIRM)
