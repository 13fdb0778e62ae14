"""Robots in a browser: one with a slider for each joint, and one that lives and learns."""

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.bodies.drake import while_babbling
from selftouch_drake.evaluation.life import Quality
from selftouch_drake.robot import World
from selftouch_drake.run.lifelong import Watcher, mood
from selftouch_drake.show.meshcat.growing_skeleton import draw_growing, onto_home
from selftouch_drake.show.meshcat.live_page import shown_page
from selftouch_drake.show.meshcat.meshcat_scene import draw_parts
from selftouch_drake.show.meshcat.stage import APART, END, FRAME_S, FeelingRobot, Stage
from selftouch_drake.show.recovered import laid_on_skins
from selftouch_drake.show.skins import surfaces_of, typical_extent
from selftouch_drake.show.style import BLUE, FIRM, ORANGE, RECOVERED, VERMILION, VIEW
from selftouch_drake.systems.simulation import Simulation

if TYPE_CHECKING:
    from selftouch_drake.agent.lifelong.life import Life

# Frames of each block of touches.
_FRAMES = 15
# rad or m, step of a slider.
_SLIDER_STEP = 0.001
#: What stands over the page of a robot, and how it fits, for `shown_page`.
ROBOT_FIT: Mapping[str, Any] = {
    "text": "Open the controls (upper right) to move the joints. The more a receptor feels, the "
    f"darker it is, up to {FIRM:g} N.",
    "colors": ((VERMILION, "what touches"),),
    "wide": 1.0,
}
#: Likewise, of a life.
LIFE_FIT: Mapping[str, Any] = {
    "text": "The agent learns from its first touch on. The more a receptor feels, the darker it "
    "is. Thin lines and pale points show how unsure it is.",
    "colors": (
        (VERMILION, "what touches"),
        (RECOVERED, "the skin that it knows so far"),
        (BLUE, "the links"),
        (ORANGE, "the axes"),
    ),
}
# Paths of the skin and of the skeleton that the agent knows.
_KNOWN, _SKELETON = "/known", "/skeleton"


class RobotPage(FeelingRobot):
    """A robot that takes the posture of its sliders."""

    def __init__(self, meshcat: Meshcat, world: World):
        super().__init__(meshcat, world)
        self._probe = world.probe
        names, (lower, upper) = world.robot.joint_names, world.robot.babbled_range
        for name, low, high, value in zip(names, lower, upper, self.home, strict=True):
            meshcat.AddSlider(name, low, high, _SLIDER_STEP, value)
        meshcat.AddButton(END, "Escape")
        self._take(self.home)

    def step(self) -> None:
        """Takes the posture of the sliders, if they have moved."""
        q = np.array([self._meshcat.GetSliderValue(name) for name in self._robot.joint_names])
        # A slider rounds to whole steps, and may end beyond its range.
        q = q.clip(*self._robot.babbled_range)
        if not np.array_equal(q, self._q):
            self._take(q)

    def _take(self, q: np.ndarray) -> None:
        self._q = q
        (felt,) = self._probe.sensations(q[None])
        self.show(q, felt)
        status = f"feels {felt.sum():.1f} N" if felt.any() else "touches nothing"
        if self._probe.impossible(q[None])[0]:
            status = "rigid parts collide:\nthe robot cannot take this posture"
        self.say(status)


def show_robot(world: World, *, announce: Callable[[str], None] = print) -> None:
    """Shows a robot in a browser, until its `end` button or Ctrl-C."""
    with shown_page(
        world.experiment.name,
        announce=announce,
        **ROBOT_FIT,
    ) as meshcat:
        page = RobotPage(meshcat, world)
        while not meshcat.GetButtonClicks(END):
            page.step()
            time.sleep(FRAME_S)


class BabblingRobot(Stage):
    """A robot that babbles under dynamics, in the diagram of `MakeSelfTouchDiagram`.

    Attributes:
        simulation: it shows itself, with what it feels.
    """

    def __init__(self, meshcat: Meshcat, world: World):
        super().__init__(meshcat, world)
        self.simulation = Simulation(
            while_babbling(world.experiment),
            world.skins,
            num_joints=world.robot.num_joints,
            log_period=np.inf,
            meshcat=meshcat,
        )

    def show(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Simulates a frame from rest at `(J,)` q; what was felt there before is not shown."""
        self.simulation.rest_at(q)
        self.simulation.advance(FRAME_S)
        self.simulation.show()


class LifePage(Watcher):
    """Shows the life of an agent.

    A robot that babbled under dynamics is simulated at its touches; of one that babbled without,
    the stored touches are shown.

    Attributes:
        robot: the robot with its current body.
    """

    robot: FeelingRobot | BabblingRobot

    def __init__(self, meshcat: Meshcat):
        self._meshcat = meshcat
        meshcat.AddButton(END, "Escape")

    def enter(self, world: World) -> None:
        """Draws the robot with its current body."""
        self._meshcat.Delete("/drake")
        self._meshcat.Delete("/skins")
        dynamic = world.experiment.babbling.mode == "dynamic"
        self._world = world
        self.robot = (BabblingRobot if dynamic else FeelingRobot)(self._meshcat, world)

    def lived(self, q: np.ndarray, sensation: np.ndarray, life: "Life") -> None:
        """Shows some of the touches from which the agent learned.

        Raises:
            KeyboardInterrupt: the page's `end` was pressed.
        """
        for row in range(0, len(q), max(len(q) // _FRAMES, 1)):
            if self._meshcat.GetButtonClicks(END):
                raise KeyboardInterrupt
            self.robot.show(q[row].astype(float), sensation[row].astype(float))
            time.sleep(FRAME_S)
        self.robot.say(f"{life.num_touches:,} touches: {mood(life)}")

    def scored(self, found: Quality, num_touches: int) -> None:
        """Draws the body that the agent knows so far."""
        self._meshcat.Delete(_KNOWN)
        if found.truth is None:
            return
        skins, size = surfaces_of(self._world.skins), self.robot.size
        home = self._world.robot.skin_positions(self.robot.home[None])[0]
        self._meshcat.SetTransform(_KNOWN, RigidTransform(APART * size * VIEW.axes[0]))
        parts = laid_on_skins(found.body, found.truth, skins, home)
        draw_parts(self._meshcat, _KNOWN, parts, typical_extent(skins))

    def grew(self, model: BodyModel, q: np.ndarray, target: np.ndarray) -> None:
        """Draws the skeleton that the agent knows so far, on the other side of the robot."""
        home, size = self.robot.home, self.robot.size
        onto = onto_home(model, self._world, home, q, target)
        if onto is None:
            self._meshcat.Delete(_SKELETON)
            return
        self._meshcat.SetTransform(_SKELETON, RigidTransform(-APART * size * VIEW.axes[0]))
        draw_growing(self._meshcat, _SKELETON, model, onto, home, size)
