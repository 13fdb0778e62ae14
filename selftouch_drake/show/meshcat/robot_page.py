"""A robot in a browser, with a slider for each joint and the sensation of each posture."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat

from selftouch_drake.robot import World
from selftouch_drake.show.meshcat.stage import FeelingRobot, open_meshcat

END = "end"
# s between two readings of the sliders.
_FRAME_S = 1 / 30
# rad or m, step of a slider.
_SLIDER_STEP = 0.001


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
    meshcat = open_meshcat()
    page = RobotPage(meshcat, world)
    announce(f"{world.experiment.name} at {meshcat.web_url()} (Ctrl-C to end)")
    with contextlib.suppress(KeyboardInterrupt):
        while not page.ended:
            page.step()
            time.sleep(_FRAME_S)
    announce("ended")
