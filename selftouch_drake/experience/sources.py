"""Two ways to babble: at given configurations, or under dynamics."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np

from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.robot import Robot, Simulation, Touches, World

# Steps in one batch: large enough for numpy, small in memory.
BATCH = 4096
# s, between two samples of a dynamic walk: a fingertip moves by a few millimetres.
SAMPLE_PERIOD = 0.02
# Samples in one batch of a dynamic walk.
DYNAMIC_BATCH = 500


class Source(Protocol):
    """A way to walk: gives configurations and what is felt in them."""

    robot: Robot

    def begin(self, walk: RandomWalk) -> None:
        """Starts at the beginning of `walk`."""

    def next_steps(self) -> tuple[np.ndarray, Touches]:
        """The next `(N, J)` float32 configurations and what is felt in them, null or not."""

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether a robot can take the posture: its rigid parts stay apart."""


class KinematicSource:
    """Sets each step of the walk and evaluates contact there: the paper's S = phi(f(M))."""

    def __init__(self, world: World):
        self._probe = world.probe
        self.robot = world.robot

    def begin(self, walk: RandomWalk) -> None:
        """Starts at the beginning of `walk`."""
        self._walk = walk

    def next_steps(self) -> tuple[np.ndarray, Touches]:
        """The next steps of the walk, and what is felt there."""
        # What is stored is what was felt: float32 configurations are the ones that are probed.
        q = self._walk.steps(BATCH).astype(np.float32)
        return q, self._probe.touches(q)

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether a robot can take the posture: its rigid parts stay apart."""
        return self._probe.collision_depth(q) == 0


class DynamicSource:
    """Lets joint controllers follow the walk in a simulation, and samples state and sensation.

    Babbler -> joint controllers -> plant -> contact results -> TactileSkin -> log, in one diagram.
    """

    def __init__(self, world: World):
        self._probe = world.probe
        self._simulation = Simulation(
            world.experiment, world.skins, log_period=SAMPLE_PERIOD, babbles=True
        )
        self.robot = self._simulation.robot

    def begin(self, walk: RandomWalk) -> None:
        """Puts the robot at rest where the walk begins."""
        self._simulation.babble(walk)

    def next_steps(self) -> tuple[np.ndarray, Touches]:
        """The next samples: the measured configuration and the sensation of the same instant."""
        self._simulation.advance(DYNAMIC_BATCH * SAMPLE_PERIOD)
        log = self._simulation.take_log()
        q = log.q.astype(np.float32)
        # The contacts, which are the experimenter's, are those of a robot put there.
        return q, dataclasses.replace(self._probe.touches(q), sensation=log.felt)

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether a robot can take the posture: its rigid parts stay apart."""
        return self._probe.collision_depth(q) == 0
