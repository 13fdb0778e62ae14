"""Two ways to babble: at given configurations, or under dynamics."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np

from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.robot import ContactProbe, Robot, Simulation, Touches, World

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
        return self.go(self._walk.steps(BATCH))

    def rest_at(self, q: np.ndarray) -> None:
        """Without time nothing has to come to rest."""

    def go(self, path: np.ndarray) -> tuple[np.ndarray, Touches]:
        """The configurations `(N, J)` of a path, and what is felt there."""
        # What is stored is what was felt: float32 configurations are the ones that are probed.
        q = path.astype(np.float32)
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
        return logged(self._simulation, self._probe)

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether a robot can take the posture: its rigid parts stay apart."""
        return self._probe.collision_depth(q) == 0


class LedSource:
    """Lets joint controllers follow paths that are given bit by bit, as `DynamicSource` a walk."""

    def __init__(self, world: World):
        self._probe = world.probe
        # While babbling no joint has slipped.
        joints = dataclasses.replace(world.experiment.joints, offset=0.0)
        experiment = dataclasses.replace(world.experiment, joints=joints)
        self._simulation = Simulation(experiment, world.skins, log_period=SAMPLE_PERIOD)
        self.robot = self._simulation.robot

    def rest_at(self, q: np.ndarray) -> None:
        """Puts the robot at rest at `(J,)` q, and starts its time there."""
        self._simulation.rest_at(q)
        self._simulation.take_log()
        self._num_samples = 0

    def go(self, path: np.ndarray) -> tuple[np.ndarray, Touches]:
        """Passes `(N, J)` configurations, one each sample: where the joints were on the way."""
        for q in path:
            # Counted, so that sums of periods do not drift off the times of the log.
            self._num_samples += 1
            self._simulation.lead_to(q, self._num_samples * SAMPLE_PERIOD)
        return logged(self._simulation, self._probe)

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether a robot can take the posture: its rigid parts stay apart."""
        return self._probe.collision_depth(q) == 0


def logged(simulation: Simulation, probe: ContactProbe) -> tuple[np.ndarray, Touches]:
    """The samples since the last call: measured configurations `(N, J)` and what was felt."""
    log = simulation.take_log()
    q = log.q.astype(np.float32)
    # The contacts, which are the experimenter's, are those of a robot put there.
    return q, dataclasses.replace(probe.touches(q), sensation=log.felt)
