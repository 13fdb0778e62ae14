"""Tasks that are the same for every planner: those of `selftouch evaluate`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.planning.members import goal_members
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.run.directory import RunDirectory

# Goal configurations offered to a peer; more slow OMPL's nearest-neighbour search of its goal tree.
NUM_GOALS = 20


@dataclass(frozen=True)
class Question:
    """A task for all planners: `(J,)` start and `(n, J)` possible ends."""

    start: int
    goal: int
    q_start: np.ndarray
    goal_q: np.ndarray


def questions(
    run: RunDirectory, representation: QuotientRepresentation, num_pairs: int
) -> list[Question]:
    """The first pairs that `selftouch evaluate` tries, with the same start configurations."""
    asked = []
    for start, goal in random_pairs(run.experiment, representation)[:num_pairs]:
        members = representation.kernel_q[representation.members(start)]
        stream = run.experiment.random_stream("start", start, goal)
        rng = np.random.default_rng(stream)
        q_start = members[rng.integers(len(members))].astype(float)
        goal_rows = rng.permutation(goal_members(representation, goal))[:NUM_GOALS]
        goal_q = representation.kernel_q[goal_rows].astype(float)
        asked.append(Question(start, goal, q_start, goal_q))
    return asked


def measure_cpu(work: Callable[[], object]) -> float:
    """CPU time in s."""
    began = time.process_time()
    work()
    return time.process_time() - began
