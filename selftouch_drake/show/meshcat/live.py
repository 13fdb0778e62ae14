"""The live agent: it plans and slides, in a browser, to whatever sensation is asked of it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from selftouch_drake.evaluation import cosine_distance
from selftouch_drake.robot.kinematics import FingertipKinematics
from selftouch_drake.robot.living import LivingAgent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.motions import Motion, Pilot
from selftouch_drake.show.material import Material
from selftouch_drake.show.scenery import Scenery, firm_touch
from selftouch_drake.show.sensation_figures import far_apart
from selftouch_drake.show.server import open_meshcat

# Controls, as the browser labels them.
TARGET, SPEED = "target sensation", "speed"
ANOTHER, TOUR, END = "another sensation", "tour on/off", "end"
# s, from one look at the controls to the next, and from frame to frame.
FRAME_S = 1 / 30
# s, at rest between the motions of a tour.
_REST_S = 1.0
# Stops of a tour: as unlike as can be, so that it goes all round the body.
_NUM_STOPS = 24
# Frames from one drawing of the fingertips' trace to the next.
_TRACE_EVERY = 6


class LiveShow:
    """An agent in Meshcat with controls, advanced frame by frame.

    It rests on its skin until a sensation is asked for, by the slider, a button or the tour, then
    plans and slides there. A motion that has begun is brought to its end first.

    Args:
        meshcat: where it is shown.
        run: a run that has learned.
        announce: told of every motion, in a line.

    Raises:
        ValueError: the run has not learned, or its experience is not there.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        run: RunDirectory,
        announce: Callable[[str], None] = lambda line: None,
    ):
        material = Material(run)
        self._known = known = material.representation
        self._pilot = Pilot(run)
        self._full = firm_touch(known)
        self._meshcat, self._announce = meshcat, announce
        self._scenery = Scenery(meshcat, material)
        self._scenery.draw_legend(self._full)
        members = known.members(0)
        firm = np.argmin(np.abs(known.kernel_strength[members] - self._full))
        q = known.kernel_q[members][firm].astype(float)
        self.arm = LivingAgent(run.experiment, *material.body, q, meshcat)
        self._kinematics = FingertipKinematics.of(self.arm.agent)
        self._stops = far_apart(known.target_sensations, _NUM_STOPS).tolist()
        self._motion: Motion | None = None
        self._log: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._goal, self._rested_s = 0, 0.0
        self._touring = True
        self._controls()
        self._tell("tour: Open Controls (upper right) to choose a sensation")

    def _controls(self) -> None:
        meshcat, last = self._meshcat, self._known.num_targets - 1
        meshcat.AddSlider(TARGET, 0, last, 1, 0, "ArrowLeft", "ArrowRight")
        meshcat.AddSlider(SPEED, 0.25, 4.0, 0.25, 1.0)
        meshcat.AddButton(ANOTHER, "KeyA")
        meshcat.AddButton(TOUR, "KeyT")
        meshcat.AddButton(END, "Escape")
        self._clicks = dict.fromkeys((ANOTHER, TOUR), 0)
        self._rate = 1.0
        self.arm.set_rate(self._rate)

    @property
    def goal(self) -> int:
        """The target sensation that was last asked for."""
        return self._goal

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._motion is not None

    @property
    def ended(self) -> bool:
        """Whether the end was asked for."""
        return self._meshcat.GetButtonClicks(END) > 0

    def step(self) -> None:
        """Goes on by one frame: reads the controls, acts, and shows what is felt."""
        wanted = self._wanted()
        if self._motion is None and wanted is not None:
            self._begin(wanted)
        self.arm.advance(FRAME_S * self._rate)
        felt = self.arm.felt
        self._scenery.felt.show(felt / self._full)
        if self._scenery.mind is not None and felt.any():
            here = self._scenery.mind[np.argmax(self._known.target_sensations @ felt)]
            self._meshcat.SetTransform("/mind/here", RigidTransform(here))
        if self._motion is None:
            self._rested_s += FRAME_S
        else:
            self._follow(self._motion, felt)

    def _wanted(self) -> int | None:
        """The sensation to go to now; None if there is nothing to do."""
        rate = self._meshcat.GetSliderValue(SPEED)
        if rate != self._rate:
            self._rate = rate
            self.arm.set_rate(rate)
        if self._clicked(TOUR):
            self._touring = not self._touring
            self._tell(f"tour {'on' if self._touring else 'off'}")
        chosen = round(self._meshcat.GetSliderValue(TARGET))
        if self._clicked(ANOTHER):
            chosen = self._next_stop()
            self._meshcat.SetSliderValue(TARGET, chosen)
        if chosen != self._goal:
            self._touring = False
            return chosen
        if self._touring and self._motion is None and self._rested_s >= _REST_S:
            return self._next_stop()
        return None

    def _clicked(self, button: str) -> bool:
        before, self._clicks[button] = self._clicks[button], self._meshcat.GetButtonClicks(button)
        return self._clicks[button] > before

    def _next_stop(self) -> int:
        self._stops.append(self._stops.pop(0))
        return self._stops[0] if self._stops[0] != self._goal else self._stops[1]

    def _begin(self, goal: int) -> None:
        self._goal, self._rested_s = goal, 0.0
        self._meshcat.SetSliderValue(TARGET, goal)
        agent = self.arm.agent
        q_start = np.clip(self.arm.q_commanded, agent.lower, agent.upper)
        try:
            motion = self._pilot.motion_from(agent, q_start, self.arm.felt, goal)
        except ValueError as reason:
            self._tell(str(reason))
            return
        self._tell(f"to sensation {goal}")
        self._scenery.draw_path("/plan", self._kinematics.positions(motion["q"]))
        self.arm.follow(motion["time_s"], motion["q"], motion["v"])
        self._motion, self._log = motion, []

    def _follow(self, motion: Motion, felt: np.ndarray) -> None:
        """Shows what was expected for now, and ends the motion when its time is over."""
        row = min(int(np.searchsorted(motion["time_s"], self.arm.time_s)), len(motion["s"]) - 1)
        expected = motion["predicted"][row]
        self._scenery.expected.show(expected)
        self._log.append((felt.copy(), expected, self.arm.q.copy()))
        over = self.arm.time_s > motion["time_s"][-1]
        if over or len(self._log) % _TRACE_EVERY == 2:
            q = np.array([entry[2] for entry in self._log])
            self._scenery.draw_trace("/plan", self._kinematics.positions(q))
        if over:
            self._finish()

    def _finish(self) -> None:
        felt, expected = (np.array([entry[k] for entry in self._log]) for k in (0, 1))
        touching = np.any(felt, axis=1)
        there = int(np.argmax(self._known.target_sensations @ felt[-1]))
        end = "reached" if there == self._goal else f"came to {there}"
        if not touching[-1]:
            end = "came off the skin"
        both = touching & expected.any(axis=1)
        told = f"sensation {self._goal}: {end}, in contact {touching.mean():.0%}"
        if both.any():
            likeness = 1.0 - cosine_distance(felt[both], expected[both]).mean()
            told += f"\nlikeness to what it expected: cosine {likeness:.2f}"
        self._tell(told)
        self._motion = None

    def _tell(self, text: str) -> None:
        self._announce(text.replace("\n", "; "))
        self._scenery.tell(text)


def play(
    run: RunDirectory, *, port: int | None = None, announce: Callable[[str], None] = print
) -> None:
    """Shows the agent of a run live in a browser, until its `end` button or Ctrl-C.

    Args:
        run: a run that has learned.
        port: of the page; by default the first free one from 7000 on.
        announce: told where to look, and then of every motion.

    Raises:
        ValueError: the run has not learned, or the port is taken.
    """
    # What is missing is told before a page is opened.
    Pilot(run)
    meshcat = open_meshcat(port)
    show = LiveShow(meshcat, run, announce)
    announce(f"{run.experiment.name}, live at {meshcat.web_url()} (Ctrl-C to end)")
    with contextlib.suppress(KeyboardInterrupt):
        while not show.ended:
            show.step()
    announce("ended")
