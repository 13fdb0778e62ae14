"""A robot that may touch itself, as a Gymnasium environment."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space
from pydrake.geometry import Meshcat

from selftouch_drake.envs.postures import possible_posture
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.robot import Touches, World
from selftouch_drake.robot.imperfections import remembered
from selftouch_drake.robot.models import one_line
from selftouch_drake.show.meshcat.stage import Stage, open_meshcat
from selftouch_drake.show.page.robot_pictures import PostureCamera
from selftouch_drake.systems.simulation import Simulation

# s between actions: four times as often as a person corrects a movement.
PERIOD_S = 0.05
# N, an upper bound of the readings of a skin that does not saturate.
_LARGEST_READING = 1000.0
# Contact can push joints beyond their limits, and throw them back. Observations are clipped at
# these shares of the range and of the velocity limit.
_BEYOND_RANGE, _BEYOND_VELOCITY = 0.1, 10.0
_REFUSED = "robot.directives holds a robot that Drake refuses"

Observation = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """The truth, which the agent never sees, for scoring.

    Attributes:
        q: `(J,)` rad or m, true joint positions.
        v: `(J,)` rad/s or m/s, true velocities.
        touches: contacts at this instant: skins, touchers and positions in the frame of the skin's
            link. The sensation is that of a robot at rest at `q`.
        skin_poses: `(skins, 3, 4)` poses of the links that wear skins, in the world.
    """

    q: np.ndarray
    v: np.ndarray
    touches: Touches
    skin_poses: np.ndarray


class SelfTouchEnv(gymnasium.Env[Any, np.ndarray]):
    """A robot under dynamics with soft skins and without a task: the reward is always 0.

    An observation is a dictionary of float32:

    - `observation` `(2J,)`: measured joint positions, rad or m, and velocities, rad/s or m/s.
    - `touch` `(S,)` N: the readings of all skins, in order.

    An action `(J,)`, from -1 to 1, is the velocity of each joint until the next action, as a share
    of its limit. Joint controllers follow it, within their effort limits and against contact
    forces. Commands stay within the limits of the joints.

    An episode starts at rest in a random possible posture, or in `options={"q": posture}`, and
    never terminates; registered environments are truncated. `info` has `steps`, and `touches`, the
    number of steps in which each skin was touched.

    Args:
        experiment: the name of a shipped experiment, or the path of a YAML file.
        overrides: a nested mapping of fields to change, as `{"seed": 1}`.
        period_s: s between two actions; a multiple of the simulation's time step.
        render_mode: `human` for Meshcat, in a browser and in real time, `rgb_array` for pictures.

    Raises:
        ExperimentError: a field of the experiment is wrong; the text names field, value and remedy.
        ValueError: `period_s` is too small, or `render_mode` is unknown.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012 - Gymnasium's
    observation_space: Dict
    # s between two looks at the sensation; by default one per step.
    _look_period: float = np.inf

    def __init__(
        self,
        experiment: str | Path,
        *,
        overrides: Mapping[str, Any] | None = None,
        period_s: float = PERIOD_S,
        render_mode: str | None = None,
    ):
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is {render_mode!r}: give human, rgb_array or None")
        self.experiment: Experiment = load_experiment(experiment, overrides)
        time_step = self.experiment.execution.time_step
        if not period_s >= time_step:
            raise ValueError(f"period_s is {period_s}: give {time_step} s or more")
        self._plant_steps = round(period_s / time_step)
        num_looks = max(1, round(period_s / self._look_period))
        # The plant's steps after which a robot looks.
        self._looks = np.unique(np.linspace(0, self._plant_steps, num_looks + 1).round()[1:])
        self.period_s = self._plant_steps * time_step
        self.metadata = {**self.metadata, "render_fps": round(1 / self.period_s)}
        self.render_mode = render_mode
        self.world = World(self.experiment)
        with one_line(_REFUSED):
            robot = self.world.robot
        self._range = robot.babbled_range
        self._step_size = self.period_s * self.world.limits.velocity
        self.action_space = Box(-1.0, 1.0, (robot.num_joints,), np.float32)
        self.observation_space = Dict(self._spaces())
        self._num_steps, self._due = 0, 0.0
        self._receptor_skin = self.world.receptor_skin
        self._touches = np.zeros(len(self.world.skins), dtype=int)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Puts the robot at rest and begins an episode.

        Args:
            seed: seed of all episodes from now on; by default the random stream continues.
            options: `q` `(J,)` rad or m, the start; where there is a goal, `goal` `(S,)`, the
                wanted sensation, of any strength.

        Raises:
            ValueError: an option is unknown, or not a posture of this robot.
        """
        super().reset(seed=seed)
        options = self._known(options)
        self._simulation.rest_at(self._starting_posture(options))
        self._feel()
        self._num_steps = 0
        self._touches[:] = 0
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Moves the joints for one period.

        Args:
            action: `(J,)` shares of the joints' velocity limits, from -1 to 1.

        Raises:
            ValueError: the action has another shape, or is not finite.
        """
        start = self._simulation.q_commanded
        moved = start + self._step_size * checked_action(action, self.action_space)
        way = moved.clip(*self._range) - start
        felt = []
        # Computed as Drake counts its steps, so that all periods have the same number of steps.
        for done in self._looks:
            until = (
                self._num_steps * self._plant_steps + done
            ) * self.experiment.execution.time_step
            self._simulation.lead_through(start + done / self._plant_steps * way, until)
            felt.append(self._feel())
        self._num_steps += 1
        touched = np.unique(self._receptor_skin[np.any(felt, axis=0)])
        self._touches[touched] += 1
        observation = self._observation()
        reward, terminated = self._judge(observation, np.array(felt))
        if self.render_mode == "human":
            self.render()
        return observation, reward, terminated, False, self._info()

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Shows the robot and its sensation; `(height, width, 3)` uint8 for `rgb_array`."""
        if self.render_mode == "rgb_array":
            return self._camera.picture(self._simulation.q, self._felt)
        if self.render_mode == "human":
            # No faster than the clock.
            now = time.monotonic()
            time.sleep(max(self._due - now, 0.0))
            self._due = max(now, self._due) + self.period_s
            self._simulation.show()
        return None

    def truth(self) -> Truth:
        """The truth, which the agent never sees; reading it changes nothing."""
        q = self._simulation.q.copy()
        return Truth(
            q=q,
            v=self._simulation.v.copy(),
            touches=self.world.probe.touches(q[None]),
            skin_poses=self.world.robot.skin_positions(q[None])[0],
        )

    def actions_along(self, time_s: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The actions that follow a motion, from its start.

        Args:
            time_s: `(T,)` s, from 0.
            q: `(T, J)` rad or m, where the joints are commanded to be; no faster than they may.

        Returns:
            `(N, J)` float32; the motion ends in the last of N periods.
        """
        ends = self.period_s * np.arange(np.ceil(time_s[-1] / self.period_s - 1e-9) + 1)
        at_ends = np.stack([np.interp(ends, time_s, each) for each in q.T], axis=1)
        return (np.diff(at_ends, axis=0) / self._step_size).clip(-1.0, 1.0).astype(np.float32)

    def _spaces(self) -> dict[str, Space]:
        lower, upper = self._range
        margin = _BEYOND_RANGE * (upper - lower)
        fastest = _BEYOND_VELOCITY * self._step_size / self.period_s
        lowest = np.concatenate([lower - margin, -fastest]).astype(np.float32)
        highest = np.concatenate([upper + margin, fastest]).astype(np.float32)
        saturation = [
            np.full(each.num_receptors, largest if np.isinf(most) else most)
            for each in self.experiment.skins.values()
            for most in [each.reading.most]
            for largest in [each.imperfections.saturation or _LARGEST_READING]
        ]
        most = np.concatenate(saturation).astype(np.float32)
        return {
            "observation": Box(lowest, highest, dtype=np.float32),
            "touch": Box(np.zeros_like(most), most, dtype=np.float32),
        }

    def _known(self, options: dict[str, Any] | None) -> dict[str, np.ndarray]:
        """The checked options of a reset."""
        known, sizes = dict(options or {}), self._options()
        for name in sorted(known):
            if name not in sizes:
                raise ValueError(f"options has {name!r}: known are {', '.join(sorted(sizes))}")
            known[name] = np.asarray(known[name], dtype=float)
            if known[name].shape != (sizes[name],) or not np.isfinite(known[name]).all():
                given = known[name].tolist()
                raise ValueError(f"options[{name!r}] is {given}: give {sizes[name]} finite numbers")
        if "q" in known and np.any(known["q"] != known["q"].clip(*self._range)):
            raise ValueError(
                f"options['q'] is {known['q'].tolist()}: keep between {self._range[0].tolist()} "
                f"and {self._range[1].tolist()}"
            )
        return known

    def _options(self) -> dict[str, int]:
        """Names of the options of `reset`, and their sizes."""
        return {"q": len(self._step_size)}

    def _starting_posture(self, options: dict[str, np.ndarray]) -> np.ndarray:
        return options["q"] if "q" in options else possible_posture(self.world, self.np_random)

    def _feel(self) -> np.ndarray:
        """Takes a look; `(S,)` N.

        For the readings of its own skins Drake solves for contact forces anew, which takes as long
        as a third of a step; the same readings follow from the posture.
        """
        if any(skin.imperfections.delay for skin in self.experiment.skins.values()):
            self._felt = self._simulation.felt
        else:
            self._felt = self.world.probe.sensations(self._simulation.q[None])[0]
        return self._felt

    def _judge(self, observation: Observation, felt: np.ndarray) -> tuple[float, bool]:
        """The reward of a step with sensations `(T, S)` N, and whether it ends the episode."""
        return 0.0, False

    def _observation(self) -> Observation:
        simulation = self._simulation
        (q,) = remembered(self.experiment, simulation.q_read[None])
        return {
            "observation": self._within("observation", np.concatenate([q, simulation.v])),
            "touch": self._within("touch", self._felt),
        }

    def _within(self, name: str, values: np.ndarray) -> np.ndarray:
        space = self.observation_space[name]
        assert isinstance(space, Box)
        return values.astype(np.float32).clip(space.low, space.high)

    def _info(self) -> dict[str, Any]:
        names = [skin.name for skin in self.world.skins]
        touches = dict(zip(names, self._touches.tolist(), strict=True))
        return {"steps": self._num_steps, "touches": touches}

    @cached_property
    def _simulation(self) -> Simulation:
        with one_line(_REFUSED):
            return Simulation(
                self.experiment,
                self.world.skins,
                num_joints=self.world.robot.num_joints,
                log_period=np.inf,
                meshcat=self._browser if self.render_mode == "human" else None,
            )

    @cached_property
    def _browser(self) -> Meshcat:
        meshcat = open_meshcat()
        print(f"{self.experiment.name} at {meshcat.web_url()}")  # noqa: T201 - where to look
        Stage(meshcat, self.world)
        return meshcat

    @cached_property
    def _camera(self) -> PostureCamera:
        return PostureCamera(self.world)


def checked_action(action: np.ndarray, space: Space) -> np.ndarray:
    """Actions from -1 to 1; a ValueError if they have another shape, or are not finite."""
    action = np.asarray(action, dtype=float)
    if action.shape != space.shape or not np.isfinite(action).all():
        raise ValueError(f"action is {action.tolist()}: give {space.shape} numbers, -1 to 1")
    return action.clip(-1.0, 1.0)
