"""The live agent: in a browser, it plans and slides to any sensation that a user chooses."""

from collections.abc import Callable, Mapping
from itertools import cycle
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat
from scipy.interpolate import CubicHermiteSpline

from selftouch_drake.agent.lifelong.expectation import cosine_distance
from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.pilot import Pilot
from selftouch_drake.agent.planning.timing import BRAKING_S, braking
from selftouch_drake.geometry.farthest import farthest_points
from selftouch_drake.show.meshcat.meshcat_scene import MeshcatScene
from selftouch_drake.show.meshcat.stage import END, FRAME_S
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import touch_paths
from selftouch_drake.show.style import BLUE, GREEN, ORANGE, VERMILION

# Controls, as the browser labels them, beside the end button.
TARGET, SPEED, TOUR = "target sensation", "speed", "tour on/off"
# s of rest between two motions of a tour.
_REST_S = 1.0
# Stops of a tour: as different as possible, so that it covers the whole body.
_NUM_STOPS = 24
# Frames between two drawings of the trace.
_TRACE_EVERY = 6


#: What stands over the page, and how it fits, for `shown_page`.
PLAY_FIT: Mapping[str, Any] = {
    "text": "The agent touches itself. The more a receptor feels, the darker it is.",
    "colors": (
        (GREEN, "start"),
        (BLUE, "plan and goal"),
        (ORANGE, "path that it took"),
        (VERMILION, "what touches; on the recovered body, where it feels itself"),
    ),
    "wide": 1.3,
    "beside": True,
}


class LiveShow:
    """An agent in Meshcat with controls, advanced frame by frame.

    It rests on its skin until the slider or the tour asks for a sensation. Then it plans
    and slides there. Another target interrupts a motion: the agent slows down on its path,
    and plans from where it comes to rest.

    The pilot plans; `announce` is called with a line about every motion.

    Attributes:
        simulation: the robot.
        goal: the latest target sensation.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        data: RunData,
        pilot: Pilot,
        announce: Callable[[str], None] = lambda line: None,
    ):
        known = data.representation
        self._pilot, self._announce, self._meshcat = pilot, announce, meshcat
        self._data = data
        self._scene = MeshcatScene(meshcat, data, beside_panel=True)
        self.simulation = self._scene.simulation
        members = known.members(0)
        firm = np.argmin(np.abs(known.kernel_strength[members] - self._scene.full))
        self.simulation.rest_at(known.kernel_q[members][firm].astype(float))
        targets = known.target_sensations
        self._stops = cycle(
            farthest_points(
                lambda row: np.linalg.norm(targets - targets[row], axis=1), _NUM_STOPS
            ).tolist()
        )
        self._motion: Motion | None = None
        self._braking = False
        self._log: list[tuple[np.ndarray, np.ndarray, int]] = []
        self.goal, self._rested_s = 0, 0.0
        self._touring = True
        meshcat.AddSlider(TARGET, 0, known.num_targets - 1, 1, 0, "ArrowLeft", "ArrowRight")
        meshcat.AddSlider(SPEED, 0.25, 4.0, 0.25, 1.0)
        meshcat.AddButton(TOUR, "KeyT")
        meshcat.AddButton(END, "Escape")
        self._tour_clicks, self._rate = 0, 1.0
        self.simulation.set_rate(self._rate)
        self._say("on tour; to choose a sensation,\nopen the controls (upper right)")

    @property
    def moving(self) -> bool:
        """Whether a motion is under way, or coming to rest."""
        return self._motion is not None or self._braking

    @property
    def ended(self) -> bool:
        """Whether the user pressed the end button."""
        return self._meshcat.GetButtonClicks(END) > 0

    def step(self) -> None:
        """Advances by one frame: reads the controls, acts, and shows the sensation."""
        wanted = self._wanted()
        if wanted is not None:
            self.goal, self._rested_s = wanted, 0.0
            self._meshcat.SetSliderValue(TARGET, wanted)
            if self._motion is not None:
                self.simulation.follow(*braked(self._motion, self.simulation.time_s))
                self._motion, self._braking = None, True
            elif not self._braking:
                self._begin()
        self.simulation.advance(FRAME_S * self._rate)
        # The diagram publishes at whole frames; what stands beside the robot is of this instant.
        self.simulation.show()
        felt = self.simulation.felt
        self._scene.show(self.simulation.q, felt)
        if self._braking:
            if self.simulation.time_s > BRAKING_S:
                self._braking = False
                self._begin()
        elif self._motion is not None:
            self._follow(self._motion, felt)
        else:
            self._rested_s += FRAME_S

    def _wanted(self) -> int | None:
        """The sensation to go to now; None if there is nothing new to do."""
        rate = self._meshcat.GetSliderValue(SPEED)
        if rate != self._rate:
            self._rate = rate
            self.simulation.set_rate(rate)
        if (clicks := self._meshcat.GetButtonClicks(TOUR)) > self._tour_clicks:
            self._tour_clicks = clicks
            self._touring = not self._touring
            self._say(f"tour {'on' if self._touring else 'off'}")
        chosen = round(self._meshcat.GetSliderValue(TARGET))
        if chosen != self.goal:
            self._touring = False
            return chosen
        if self._touring and not self.moving and self._rested_s >= _REST_S:
            return next(stop for stop in self._stops if stop != self.goal)
        return None

    def _begin(self) -> None:
        simulation, robot = self.simulation, self._data.world.robot
        q_start = np.clip(simulation.q_commanded, robot.lower, robot.upper)
        try:
            motion = self._pilot.plan_feeling(q_start, simulation.felt, self.goal).motion
        except ValueError as reason:
            self._say(str(reason))
            return
        through = ", through the air" if motion.plan.in_air.any() else ""
        self._say(f"to sensation {self.goal}{through}")
        self._scene.clear_paths()
        self._scene.draw_path(touch_paths(self._data.world, motion.q), len(motion.q))
        simulation.follow(motion.time_s, motion.q, motion.v)
        self._motion, self._log = motion, []

    def _follow(self, motion: Motion, felt: np.ndarray) -> None:
        """Shows the expected sensation, and ends the motion when its time is over."""
        row = min(int(np.searchsorted(motion.time_s, self.simulation.time_s)), len(motion.s) - 1)
        self._scene.expected.show(motion.predicted[row])
        self._log.append((felt.copy(), self.simulation.q.copy(), row))
        over = self.simulation.time_s > motion.time_s[-1]
        if over or len(self._log) % _TRACE_EVERY == 2:
            q = np.array([entry[1] for entry in self._log])
            self._scene.draw_trace(touch_paths(self._data.world, q))
        if over:
            self._finish(motion)

    def _finish(self, motion: Motion) -> None:
        felt, rows = np.array([e[0] for e in self._log]), [e[2] for e in self._log]
        expected, meant = motion.predicted[rows], motion.touching[rows]
        touching = np.any(felt, axis=1)
        there = int(self._scene.nearest(felt[-1]))
        end = "reached" if there == self.goal else f"stopped at {there}"
        if not touching[-1]:
            end = "came off the skin"
        where = "" if meant.all() else " where touch was expected"
        contact = touching[meant].mean() if meant.any() else 1.0
        text = f"sensation {self.goal}: {end}, in contact {contact:.0%}{where}"
        both = touching & expected.any(axis=1)
        if both.any():
            likeness = 1.0 - cosine_distance(felt[both], expected[both]).mean()
            text += f"\nsimilarity to what it expected: {likeness:.2f} (cosine)"
        self._say(text)
        self._motion = None

    def _say(self, text: str) -> None:
        self._announce(text.replace("\n", "; "))
        self._scene.say(text)


def braked(motion: Motion, time_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A motion from `time_s` s on, slowed down to a stop on its own path and so on the skin.

    Returns:
        `(N,)` s from 0, `(N, J)` configurations and `(N, J)` their velocities.
    """
    since, at, share = braking(time_s, motion.time_s[-1])
    path = CubicHermiteSpline(motion.time_s, motion.q, motion.v)
    return since, path(at), path(at, 1) * share[:, None]
