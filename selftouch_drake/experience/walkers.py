"""Ways to babble: at given configurations, or under dynamics."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.robot import ContactProbe, Robot, Simulation, Touches, World

# Steps in one batch: large enough for numpy, small in memory.
BATCH = 4096
# s between two samples of a dynamic walk, in which a fingertip moves by a few millimetres.
SAMPLE_PERIOD = 0.02
# Samples in one batch of a dynamic walk.
DYNAMIC_BATCH = 500


class Steps(NamedTuple):
    """Steps of a walk, and what is felt there.

    Attributes:
        q: `(N, J)` float32, the configurations.
        touching: `(n,)` the steps at which something is felt, ascending.
        touches: the sensations of these steps.
    """

    q: np.ndarray
    touching: np.ndarray
    touches: Touches

    @staticmethod
    def of(q: np.ndarray, touches: Touches) -> Steps:
        """From the sensations of all steps, null or not."""
        touching = np.flatnonzero(touches.sensation.any(axis=1))
        return Steps(q, touching, touches.of_rows(touching))


class Walker:
    """Moves the robot of a world, and returns configurations with their sensations.

    Attributes:
        robot: the robot.
    """

    def __init__(self, world: World, robot: Robot):
        self._probe = world.probe
        self.robot = robot

    def possible(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` bool, whether the robot can take a configuration: rigid parts do not collide."""
        return self._probe.collision_depth(q) == 0


class KinematicWalker(Walker):
    """Evaluates contact at each step of the walk: the paper's S = phi(f(M))."""

    def __init__(self, world: World):
        super().__init__(world, world.robot)

    def begin(self, walk: RandomWalk) -> None:
        """Starts at the beginning of `walk`."""
        self._walk = walk

    def next_steps(self) -> Steps:
        """The next steps of the walk."""
        q = self._walk.steps(BATCH).astype(np.float32)
        return Steps(q, *self._probe.felt(q))

    def rest_at(self, q: np.ndarray) -> None:
        """Does nothing: without time, nothing has to come to rest."""

    def go(self, path: np.ndarray) -> tuple[np.ndarray, Touches]:
        """The configurations `(N, J)` of a path, and their sensations."""
        # Contact is evaluated at the stored, that is the rounded, configurations.
        q = path.astype(np.float32)
        return q, self._probe.touches(q)


class DynamicWalker(Walker):
    """Joint controllers follow the walk in a simulation; state and sensation are sampled.

    Path -> joint controllers -> plant -> contact results -> TactileSkin -> log, in one diagram.
    """

    def __init__(self, world: World):
        # While babbling no joint has slipped.
        joints = dataclasses.replace(world.experiment.joints, offset=0.0)
        execution = dataclasses.replace(world.experiment.execution, touch_servo=False)
        experiment = dataclasses.replace(world.experiment, joints=joints, execution=execution)
        self._simulation = Simulation(experiment, world.skins, log_period=SAMPLE_PERIOD)
        super().__init__(world, self._simulation.robot)
        self._step_duration = experiment.babbling.step_duration

    def begin(self, walk: RandomWalk) -> None:
        """Puts the robot at rest at the beginning of the walk."""
        self._walk, self._num_steps = walk, 0
        self.rest_at(walk.steps(1)[0])

    def next_steps(self) -> Steps:
        """The next samples: the measured configuration and the sensation of the same instant."""
        num_steps = max(1, round(DYNAMIC_BATCH * SAMPLE_PERIOD / self._step_duration))
        # Counted, so that sums of periods do not drift.
        ends = self._step_duration * (self._num_steps + 1 + np.arange(num_steps))
        self._num_steps += num_steps
        self._simulation.lead_through(self._walk.steps(num_steps), ends)
        return Steps.of(*logged(self._simulation, self._probe))

    def rest_at(self, q: np.ndarray) -> None:
        """Puts the robot at rest at `(J,)` q, and starts its time there."""
        self._simulation.rest_at(q)
        # Where a walk begins was not walked to.
        self._simulation.take_log()
        self._num_samples = 0

    def go(self, path: np.ndarray) -> tuple[np.ndarray, Touches]:
        """Passes `(N, J)` configurations, one per sample; returns the samples on the way."""
        times = SAMPLE_PERIOD * (self._num_samples + 1 + np.arange(len(path)))
        self._num_samples += len(path)
        self._simulation.lead_through(path, times)
        return logged(self._simulation, self._probe)


def logged(simulation: Simulation, probe: ContactProbe) -> tuple[np.ndarray, Touches]:
    """The samples since the last call: measured configurations `(N, J)` and sensations."""
    log = simulation.take_log()
    q = log.q.astype(np.float32)
    # Contacts (the truth) are recomputed at the measured configurations.
    return q, dataclasses.replace(probe.touches(q), sensation=log.felt)
