"""Shows an environment in a browser."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from selftouch_drake.robot import World
from selftouch_drake.show import FeelingRobot, open_meshcat


class BrowserView:
    """Shows a robot in Meshcat, no faster than the clock.

    Args:
        world: of the robot.
        period_s: s, from one showing to the next.
        announce: called with where to look.
    """

    def __init__(self, world: World, period_s: float, announce: Callable[[str], None] = print):
        meshcat = open_meshcat()
        self._robot, self._period_s, self._due = FeelingRobot(meshcat, world), period_s, 0.0
        announce(f"{world.experiment.name} at {meshcat.web_url()}")

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Shows the robot at `(J,)` q, feeling `(S,)` N, when its time has come."""
        now = time.monotonic()
        time.sleep(max(self._due - now, 0.0))
        self._due = max(now, self._due) + self._period_s
        self._robot.show(q, felt)
