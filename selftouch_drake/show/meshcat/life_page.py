"""A life in a browser: the robot, and beside it the body that the agent knows."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from selftouch_drake.evaluation.life import Quality
from selftouch_drake.robot import World
from selftouch_drake.show.meshcat.skin_drawing import rgba
from selftouch_drake.show.meshcat.stage import VIEW, FeelingRobot, open_meshcat
from selftouch_drake.show.recovered import laid_on_skins
from selftouch_drake.show.skins import surfaces_of
from selftouch_drake.show.style import INK, RECOVERED

if TYPE_CHECKING:
    from selftouch_drake.agent.lifelong import Life

END = "end"
#: s, from frame to frame, and frames of each block of touches.
_FRAME_S, _FRAMES = 1 / 30, 15
#: The body that the agent knows stands this many sizes beside the real one.
_ASIDE = 1.55
_KNOWN = "/known"


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
        self._robot.say(f"{life.num_touches:,} touches: {_mood(life)}")

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


def _mood(life: Life) -> str:
    if life.has_doubts:
        return "this is not what it expects"
    if life.noticed:
        return f"it found: {life.noticed[-1].change.in_words}"
    return "it learns" if life.learner.knows else "it begins"


def show_life(
    live: Callable[[LifePage], object],
    *,
    port: int | None = None,
    announce: Callable[[str], None] = print,
) -> None:
    """Shows a life in a browser, until its end, the `end` button or Ctrl-C.

    Args:
        live: lives, and calls the page with all that happens.
        port: of the page; by default the first free one from 7000 on.
        announce: called with where to look.

    Raises:
        ValueError: the port is taken.
    """
    meshcat = open_meshcat(port)
    announce(f"live at {meshcat.web_url()} (Ctrl-C to end)")
    with contextlib.suppress(KeyboardInterrupt):
        live(LifePage(meshcat))
    announce("ended")
