"""Active babbling: rounds in which the agent goes where it knows least, kept where they touch.

What the agent knows in a round depends on the rounds stored before and on nothing else. So a
stopped run takes the stored rounds in again and goes on, to the same bytes.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np
import yaml

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.living import Explorer, Joints, LivingLearner, Manner, Searcher
from selftouch_drake.agent.representation import DisconnectedWarning
from selftouch_drake.experience import (
    ExperienceReader,
    Shard,
    WalkCounts,
    collect,
    write_shard,
)
from selftouch_drake.experience.collect import WORLD_LOCK, keep_touches, known_world, step_sizes
from selftouch_drake.experience.sources import SAMPLE_PERIOD, KinematicSource, LedSource
from selftouch_drake.experiment import Experiment, experiment_from_fields
from selftouch_drake.robot import Touches, World

#: Target sensations and touches of each that the agent finds its way by while it explores: what is
#: learned from the experience afterwards has its own.
_NUM_TARGETS, _KERNEL_SIZE = 150, 300

#: Touches before the agent goes by what it knows.
_AT_RANDOM = 500

#: Without time the agent searches, and has no manner but that of the walk before it knows anything
#: in goal babbling, which is measured beside it. Under dynamics it stays in touch.
KINEMATIC = Manner(pace=1.0, dwell=0, air=0.95, walked=20, hops=2)
DYNAMIC = Manner(pace=0.2, dwell=750, air=0.1, walked=1, hops=0)


class Exploration:
    """An agent in its world, which explores in rounds and learns from each.

    Args:
        experiment: what it lives in.
        explorer: how it goes where; by default as suits its world.
        world: of the experiment; by default it is built.
    """

    def __init__(
        self,
        experiment: Experiment,
        explorer: type[Explorer] | None = None,
        world: World | None = None,
    ):
        world = world or World(experiment)
        dynamic = experiment.babbling.mode == "dynamic"
        self._explorer = explorer or (Explorer if dynamic else Searcher)
        self.experiment = experiment
        self.source = LedSource(world) if dynamic else KinematicSource(world)
        self.manner = KINEMATIC
        if dynamic:
            # It feels its way: each sample decides on the next, as fast as random babbling goes.
            pace = SAMPLE_PERIOD / experiment.babbling.step_duration
            self.manner = dataclasses.replace(DYNAMIC, pace=pace)
        lower, upper = world.robot.babbled_range
        self._joints = Joints(lower=lower, upper=upper, stride=step_sizes(experiment, world.robot))
        (seed,) = experiment.random_stream("explorer").generate_state(1)
        self.learner = LivingLearner(_NUM_TARGETS, _KERNEL_SIZE, seed=int(seed))
        self.round = 0
        self._q: np.ndarray | None = None

    def remember(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Takes in the next round, as it is stored: `(n, J)` q and `(n, S)` N."""
        self.learner.take(q, sensation)
        self._q = q[-1]
        self.round += 1

    def explore(self, num_rows: int) -> Shard:
        """The next round: goes on until `num_rows` configurations touched that the robot can take.

        Raises:
            NeverTouchesError: there was no touch in very many steps.
        """
        rng = np.random.default_rng(self.experiment.random_stream("walk", self.round))
        joints, source = self._joints, self.source
        start = rng.uniform(joints.lower, joints.upper) if self._q is None else self._q
        source.rest_at(start)
        nothing = np.zeros(self.experiment.num_receptors)
        moves = self._explorer(self._agent(), joints, self.manner, start, nothing, rng).moves()
        path = next(moves)

        def next_steps() -> tuple[np.ndarray, Touches]:
            nonlocal path
            q, touches = source.go(path)
            # In a posture that it cannot take, a robot feels nothing.
            path = moves.send((q, np.where(source.possible(q)[:, None], touches.sensation, 0.0)))
            return q, touches

        return keep_touches(next_steps, source.possible, self.experiment, self.round, num_rows)

    def _agent(self) -> Agent | None:
        """What it knows; None before it has touched enough to go by."""
        if self.learner.num_touches < _AT_RANDOM or not self.learner.knows:
            return None
        with warnings.catch_warnings():
            # While it explores, a graph in pieces is what it wants to mend.
            warnings.simplefilter("ignore", DisconnectedWarning)
            return Agent.of(
                self.learner.representation, kernel_sensation=self.learner.kernel_sensation
            )


def explore(
    experiment: Experiment,
    folder: Path,
    *,
    fingerprint: str,
    executor: Executor,
    progress: Callable[[int], None] = lambda num_rows: None,
    world: World | None = None,
) -> WalkCounts:
    """Collects what is missing of an active run's experience; arguments and errors as `collect`."""
    return collect(
        experiment,
        folder,
        fingerprint=fingerprint,
        executor=executor,
        progress=progress,
        world=world,
        make=_explore_and_store,
        in_turn=True,
    )


def _explore_and_store(
    text: str, run: str, number: int, num_rows: int, fingerprint: str
) -> WalkCounts:
    with WORLD_LOCK:
        life = _life(text, run)
        if life.round > number:  # a stored round is missing: it is lived again from the start
            _life.cache_clear()
            life = _life(text, run)
        if life.round < number:
            stored = ExperienceReader(Path(run) / "experience").touches()
            for sensation, q in islice(stored, life.round, number):
                life.remember(q, sensation)
        shard = life.explore(num_rows)
        life.remember(shard.q, shard.sensation)
    write_shard(Path(run), shard, fingerprint=fingerprint)
    return shard.counts


@lru_cache(maxsize=1)
def _life(text: str, run: str) -> Exploration:
    """The life of a run, begun once a process."""
    experiment = experiment_from_fields(yaml.safe_load(text))
    return Exploration(experiment, world=known_world(text, experiment))
