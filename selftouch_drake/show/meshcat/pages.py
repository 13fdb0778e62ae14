"""Robots in a browser: one with a slider for each joint, and one that lives and learns."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from selftouch_drake.evaluation.life import Quality
from selftouch_drake.robot import World
from selftouch_drake.run.lifelong import mood
from selftouch_drake.show.meshcat.skin_drawing import rgba
from selftouch_drake.show.meshcat.stage import VIEW, FeelingRobot, shown_page
from selftouch_drake.show.recovered import laid_on_skins
from selftouch_drake.show.skins import surfaces_of
from selftouch_drake.show.style import INK, RECOVERED

if TYPE_CHECKING:
    from selftouch_drake.agent.lifelong import Life

END = "end"
# s, from frame to frame, and frames of each block of touches.
_FRAME_S, _FRAMES = 1 / 30, 15
# rad or m, step of a slider.
_SLIDER_STEP = 0.001
#: The body that the agent knows stands this many sizes beside the real one.
_ASIDE = 1.55
_KNOWN = "/known"


class RobotPage:
    """A robot that takes the posture of its sliders.

    Args:
        meshcat: where it is shown.
        world: of the robot.

    Attributes:
        meshcat: where it is shown.
    """

    def __init__(self, meshcat: Meshcat, world: World):
        self.meshcat, self._world = meshcat, world
        self._robot = robot = world.robot
        self._drawing = FeelingRobot(meshcat, world)
        self._q = self._drawing.home
        lower, upper = robot.babbled_range
        for name, low, high, value in zip(robot.joint_names, lower, upper, self._q, strict=True):
            meshcat.AddSlider(name, low, high, _SLIDER_STEP, value)
        meshcat.AddButton(END, "Escape")
        self.show(self._q)

    @property
    def status(self) -> str:
        """What is written below the robot."""
        return self._drawing.status

    @property
    def ended(self) -> bool:
        """Whether the user pressed the end button."""
        return self.meshcat.GetButtonClicks(END) > 0

    def step(self) -> None:
        """Takes the posture of the sliders, if they have moved."""
        q = np.array([self.meshcat.GetSliderValue(name) for name in self._robot.joint_names])
        # A slider rounds to whole steps, and may end beyond its range.
        q = q.clip(*self._robot.babbled_range)
        if not np.array_equal(q, self._q):
            self.show(q)

    def show(self, q: np.ndarray) -> None:
        """Shows the robot at `(J,)` q with its sensation."""
        self._q = q
        (felt,) = self._world.probe.sensations(q[None])
        self._drawing.show(q, felt)
        (depth,) = self._world.probe.collision_depth(q[None])
        status = f"feels {felt.sum():.1f} N" if felt.any() else "touches nothing"
        if depth > 0:
            status = "rigid parts run into each other: no posture of this robot"
        self._drawing.say(status)


def show_robot(world: World, *, announce: Callable[[str], None] = print) -> None:
    """Shows a robot in a browser, until its `end` button or Ctrl-C.

    Args:
        world: of the robot.
        announce: called with where to look.
    """
    with shown_page(world.experiment.name, announce=announce) as meshcat:
        page = RobotPage(meshcat, world)
        while not page.ended:
            page.step()
            time.sleep(_FRAME_S)


class LifePage:
    """Shows the life of an agent.

    Args:
        meshcat: where it is shown.
        frame_s: s, from frame to frame.
    """

    def __init__(self, meshcat: Meshcat, *, frame_s: float = _FRAME_S):
        self._meshcat, self._frame_s = meshcat, frame_s
        meshcat.AddButton(END, "Escape")

    @property
    def status(self) -> str:
        """What is written below the robot."""
        return self._robot.status

    def enter(self, world: World) -> None:
        """Draws the robot with its current body."""
        self._meshcat.Delete("/drake")
        self._meshcat.Delete("/skins")
        self._world, self._robot = world, FeelingRobot(self._meshcat, world)

    def lived(self, q: np.ndarray, sensation: np.ndarray, life: Life) -> None:
        """Shows some of the touches from which the agent learned.

        Raises:
            KeyboardInterrupt: the page's `end` was pressed.
        """
        for row in range(0, len(q), max(len(q) // _FRAMES, 1)):
            if self._meshcat.GetButtonClicks(END):
                raise KeyboardInterrupt
            self._robot.show(q[row].astype(float), sensation[row].astype(float))
            time.sleep(self._frame_s)
        self._robot.say(f"{life.num_touches:,} touches: {mood(life)}")

    def scored(self, found: Quality, num_touches: int) -> None:
        """Draws the body that the agent knows so far."""
        self._meshcat.Delete(_KNOWN)
        if found.truth is None:
            return
        skins, robot = surfaces_of(self._world.skins), self._robot
        home = self._world.robot.skin_positions(robot.home[None])[0]
        self._meshcat.SetTransform(_KNOWN, RigidTransform(_ASIDE * robot.size * VIEW.axes[0]))
        for part in laid_on_skins(found.body, found.truth, skins, home):
            both_sides = np.vstack([part.faces, part.faces[:, ::-1]])
            path = f"{_KNOWN}/part_{part.part}"
            color = rgba(RECOVERED, 0.6)
            self._meshcat.SetTriangleMesh(path, part.places.T, both_sides.T, color)
            self._meshcat.SetTriangleMesh(
                f"{path}/edges", part.places.T, part.faces.T, rgba(INK), wireframe=True
            )
