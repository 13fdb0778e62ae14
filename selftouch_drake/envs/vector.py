"""Many robots that may touch themselves at once, without dynamics."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from selftouch_drake.envs.environment import (
    PERIOD_S,
    Observation,
    SelfTouchEnv,
    Truth,
    checked_action,
)
from selftouch_drake.envs.goals import REACHED, ReachEnv, SlideEnv, likeness, unit_goal
from selftouch_drake.robot.imperfections import remembered, slip

_TASKS = {"": SelfTouchEnv, "Reach": ReachEnv, "Slide": SlideEnv}
# A robot whose rigid parts meet stops within this share of its step.
_HALVINGS = 4


class SelfTouchVectorEnv(VectorEnv[Observation, np.ndarray, np.ndarray]):
    """Robots without dynamics, with the observations, actions and rewards of one environment.

    Joints follow their actions exactly, within their limits. A robot stops on its way where rigid
    parts of it meet. Touches are those of Drake at the same posture. Skins do not push back: what
    presses a hollow skin hard enough gets inside. Readings have no delay, and `Slide` looks once
    per step.

    A robot whose episode ended starts another one at the next step, which ignores its action
    (`AutoresetMode.NEXT_STEP`). `reset(options={"reset_mask": mask})` resets some robots at once.
    Other options are those of the environment, and hold for all robots that are reset.

    Args:
        num_envs: N, the number of robots.
        task: `Reach`, `Slide`, or none.
        experiment: as in `SelfTouchEnv`.
        overrides: as in `SelfTouchEnv`.
        period_s: as in `SelfTouchEnv`.
        max_episode_steps: after which an episode is truncated; never by default.

    Raises:
        ExperimentError: a field of the experiment is wrong; the text names field, value and remedy.
        ValueError: `num_envs` or `period_s` is too small.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 - Gymnasium's

    def __init__(
        self,
        num_envs: int = 1,
        *,
        experiment: str | Path,
        task: Literal["", "Reach", "Slide"] = "",
        overrides: Mapping[str, Any] | None = None,
        period_s: float = PERIOD_S,
        max_episode_steps: int | None = None,
    ):
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}: give 1 or more")
        # It says what a robot sees, may be asked and starts with, and never runs.
        self._one = one = _TASKS[task](experiment, overrides=overrides, period_s=period_s)
        self.num_envs, self.world = num_envs, one.world
        self.single_observation_space = one.observation_space
        self.single_action_space = one.action_space
        self.observation_space = batch_space(one.observation_space, num_envs)
        self.action_space = batch_space(one.action_space, num_envs)
        self._longest = np.inf if max_episode_steps is None else max_episode_steps
        self._slip = slip(one.experiment, self.world.robot.num_joints)
        sizes = [skin.fields.num_receptors for skin in self.world.skins]
        self._first_receptors = np.cumsum([0, *sizes[:-1]])
        self._q = np.zeros((num_envs, self.world.robot.num_joints))
        self._v = np.zeros_like(self._q)
        self._goal = np.zeros((num_envs, one.experiment.num_receptors), dtype=np.float32)
        self._steps = np.zeros(num_envs, dtype=int)
        self._touches = np.zeros((num_envs, len(sizes)), dtype=int)
        self._ended = np.ones(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Puts robots at rest and begins their episodes.

        Args:
            seed: seed of all episodes from now on; by default the random stream continues.
            options: `reset_mask` `(N,)` bool, the robots to reset; others as in `SelfTouchEnv`.

        Raises:
            ValueError: an option is unknown, or not a posture that this robot can take.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] is {mask.tolist()}: give ({self.num_envs},) booleans, at "
                "least one of them True"
            )
        self._begin(np.flatnonzero(mask), options)
        observation, felt = self._look()
        return observation, self._info(observation, felt)

    def step(
        self, actions: np.ndarray
    ) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Moves all joints for one period.

        Args:
            actions: `(N, J)` shares of the joints' velocity limits, from -1 to 1.

        Returns:
            The observations, the rewards `(N,)`, whether each episode terminated `(N,)` and was
            truncated `(N,)`, and `info` with one entry per robot.

        Raises:
            ValueError: the actions have another shape, or are not finite.
        """
        wanted = self._q + self._one._step_size * checked_action(actions, self.action_space)
        before, moving = self._q, ~self._ended
        self._q = self._as_far_as_possible(wanted.clip(*self._one._range))
        self._v = (self._q - before) / self._one.period_s
        self._begin(np.flatnonzero(self._ended), {})
        self._steps += moving
        observation, felt = self._look()
        self._touches[moving] += np.logical_or.reduceat(felt, self._first_receptors, axis=1)[moving]
        info = self._info(observation, felt)
        reward = info.get("likeness", np.zeros(self.num_envs)) * moving
        terminated = np.zeros(self.num_envs, dtype=bool)
        if isinstance(self._one, SlideEnv):
            terminated = moving & ~felt.any(axis=1)
        truncated = self._steps >= self._longest
        self._ended = terminated | truncated
        return observation, reward, terminated, truncated, info

    def truth(self) -> Truth:
        """The truth, which the agent never sees; one row, or instant, per robot."""
        q = self._q - self._slip
        return Truth(
            q=q,
            v=self._v.copy(),
            touches=self.world.probe.touches(q),
            skin_poses=self.world.robot.skin_positions(q),
        )

    def _begin(self, rows: np.ndarray, options: dict[str, Any]) -> None:
        """Begins an episode of some robots."""
        self._one.np_random = self.np_random
        known = self._one._known(options)
        for row in rows:
            q = self._one._starting_posture(known)
            if "q" in known and self.world.probe.impossible((q - self._slip)[None])[0]:
                raise ValueError(
                    f"options['q'] is {q.tolist()}, where rigid parts run into each other: give "
                    "another posture"
                )
            self._q[row] = q
            if isinstance(self._one, ReachEnv):
                self._goal[row] = self._one._goal
        self._v[rows] = 0.0
        self._steps[rows] = self._touches[rows] = 0
        self._ended[rows] = False

    def _as_far_as_possible(self, wanted: np.ndarray) -> np.ndarray:
        """`(N, J)` where the robots get on their straight ways to the wanted configurations."""
        hit = np.flatnonzero(self.world.probe.impossible(wanted - self._slip))
        if len(hit):
            start, way = self._q[hit], wanted[hit] - self._q[hit]
            share = np.zeros((len(hit), 1))
            for halving in range(1, _HALVINGS + 1):
                farther = share + 0.5**halving
                free = ~self.world.probe.impossible(start + farther * way - self._slip)
                share[free] = farther[free]
            wanted[hit] = start + share * way
        return wanted

    def _look(self) -> tuple[Observation, np.ndarray]:
        """The observations, and whether each receptor feels anything, `(N, S)`."""
        q = self._q - self._slip
        felt = self.world.probe.sensations(q)
        seen = remembered(self._one.experiment, self._q)
        observation = {
            "observation": self._one._within("observation", np.concatenate([seen, self._v], 1)),
            "touch": self._one._within("touch", felt),
        }
        if isinstance(self._one, ReachEnv):
            observation["achieved_goal"] = unit_goal(observation["touch"])
            observation["desired_goal"] = self._goal.copy()
        return observation, felt > 0

    def _info(self, observation: Observation, felt: np.ndarray) -> dict[str, Any]:
        every = np.ones(self.num_envs, dtype=bool)
        touches: dict[str, np.ndarray] = {}
        for skin, count in zip(self.world.skins, self._touches.T.copy(), strict=True):
            touches |= {skin.name: count, f"_{skin.name}": every}
        found: dict[str, Any] = {"steps": self._steps.copy(), "touches": touches}
        if isinstance(self._one, ReachEnv):
            found["likeness"] = likeness(observation["achieved_goal"], observation["desired_goal"])
            found["is_success"] = found["likeness"] >= REACHED
        return found | {f"_{key}": every for key in found}


class ReachVectorEnv(SelfTouchVectorEnv):
    """Many robots that reach a wanted sensation; arguments as in `SelfTouchVectorEnv`."""

    def __init__(self, num_envs: int = 1, **kwargs: Any):
        super().__init__(num_envs, task="Reach", **kwargs)


class SlideVectorEnv(SelfTouchVectorEnv):
    """Many robots that slide to a wanted sensation; arguments as in `SelfTouchVectorEnv`."""

    def __init__(self, num_envs: int = 1, **kwargs: Any):
        super().__init__(num_envs, task="Slide", **kwargs)
