"""Environments with a goal: a wanted sensation."""

from functools import cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space

from selftouch_drake.envs.environment import Observation, SelfTouchEnv
from selftouch_drake.envs.postures import FirmTouches, TouchingPairs, touching_pairs
from selftouch_drake.systems.simulation import LOG_PERIOD

#: Likeness at which a sensation counts as the wanted one.
REACHED = 0.9


def likeness(achieved: np.ndarray, desired: np.ndarray) -> np.ndarray:
    """`(...)` cosines of sensations `(..., S)` of unit L2 norm, 0 to 1; 0 where one is null."""
    return np.sum(np.multiply(achieved, desired, dtype=float), axis=-1).clip(0.0, 1.0)


class ReachEnv(SelfTouchEnv):
    """Like `SelfTouchEnv`, with a reward for feeling a wanted sensation.

    An observation has two more entries, as in Gymnasium's environments with goals: `desired_goal`
    `(S,)`, the wanted sensation, and `achieved_goal` `(S,)`, the felt one. They have unit L2 norm,
    because the strength does not count, or are zero if nothing is felt.

    The reward of a step is the likeness of the two: their cosine. An episode never terminates.
    `info` also has `likeness`, and `is_success`: whether the likeness is 0.9 or more.

    The goal is the sensation of a random posture that touches firmly, or
    `options={"goal": sensation}` `(S,)`.
    """

    def compute_reward(
        self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any
    ) -> np.ndarray | float:
        """The reward for a felt sensation `(..., S)` and a wanted one `(..., S)`.

        Learners with hindsight experience replay need it; `info` is not used.
        """
        found = likeness(achieved_goal, desired_goal)
        return float(found) if found.ndim == 0 else found

    def _spaces(self) -> dict[str, Space]:
        goal = Box(0.0, 1.0, (self.experiment.num_receptors,), np.float32)
        return {**super()._spaces(), "achieved_goal": goal, "desired_goal": goal}

    def _options(self) -> dict[str, int]:
        return {**super()._options(), "goal": self.experiment.num_receptors}

    def _known(self, options: dict[str, Any] | None) -> dict[str, np.ndarray]:
        known = super()._known(options)
        if "goal" in known and (np.any(known["goal"] < 0) or not known["goal"].any()):
            raise ValueError(
                f"options['goal'] is {known['goal'].tolist()}: give a sensation in N, without "
                "negative readings, not all 0"
            )
        return known

    def _starting_posture(self, options: dict[str, np.ndarray]) -> np.ndarray:
        self._goal = self._wanted(options)
        return super()._starting_posture(options)

    def _wanted(
        self, options: dict[str, np.ndarray], pairs: TouchingPairs | None = None
    ) -> np.ndarray:
        """The goal of an episode; in a random one, the given pairs touch."""
        if "goal" in options:
            return unit_goal(options["goal"])
        _, touches = self._firm_touches.next(self.np_random, pairs)
        return unit_goal(touches.sensation[0])

    @cached_property
    def _firm_touches(self) -> FirmTouches:
        return FirmTouches(self.world)

    def _judge(self, observation: Observation, felt: np.ndarray) -> tuple[float, bool]:
        goals = observation["achieved_goal"], observation["desired_goal"]
        return float(self.compute_reward(*goals, {})), False

    def _observation(self) -> Observation:
        plain = super()._observation()
        return {
            **plain,
            "achieved_goal": unit_goal(plain["touch"]),
            "desired_goal": self._goal.copy(),
        }

    def _info(self) -> dict[str, Any]:
        found = float(likeness(unit_goal(self._felt), self._goal))
        return {**super()._info(), "likeness": found, "is_success": found >= REACHED}


class SlideEnv(ReachEnv):
    """Like `ReachEnv`, but an episode ends as soon as nothing is felt.

    The robot starts in touch, and an episode terminates when nothing is felt at one of the looks
    that are taken every 0.01 s. If both start and goal are left to chance, the same skin is touched
    by the same toucher in both.
    """

    _look_period = LOG_PERIOD

    def _starting_posture(self, options: dict[str, np.ndarray]) -> np.ndarray:
        if "q" in options:
            q = options["q"]
            touches = self.world.probe.touches(q[None])
            if not touches.sensation.any():
                raise ValueError(
                    f"options['q'] is {q.tolist()}, where nothing touches: give a touching start"
                )
        else:
            q, touches = self._firm_touches.next(self.np_random)
            # A goal with the same several pairs would hardly ever be found.
            while len(touching_pairs(touches)) > 1:
                q, touches = self._firm_touches.next(self.np_random)
        self._goal = self._wanted(options, touching_pairs(touches))
        return q

    def _judge(self, observation: Observation, felt: np.ndarray) -> tuple[float, bool]:
        reward, _ = super()._judge(observation, felt)
        return reward, not felt.any(axis=1).all()


def unit_goal(sensation: np.ndarray) -> np.ndarray:
    """`(..., S)` float32 of unit L2 norm; zero where nothing is felt."""
    norm = np.linalg.norm(sensation, axis=-1, keepdims=True)
    return (sensation / np.where(norm > 0, norm, 1.0)).astype(np.float32).clip(0.0, 1.0)
