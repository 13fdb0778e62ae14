"""Trials: random pairs of start and goal, planned, executed, rehearsed and scored.

First tries are independent of each other and may be made in several processes. Rehearsals follow in
order, because each remembers the earlier ones. Only the parts of their scores stay in memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.rehearsal import Try, best
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.experiment import Experiment
from selftouch_drake.files import content_digest
from selftouch_drake.robot import World
from selftouch_drake.run.acting import Pilot
from selftouch_drake.run.artifacts import load_agent, save_plan
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn
from selftouch_drake.run.first_tries import FirstTries, FirstTry
from selftouch_drake.run.worlds import make_world
from selftouch_drake.threads import OncePerThread

# First tries that may wait for the rehearsals of earlier pairs.
_MOST_AHEAD = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial(FirstTry):
    """The result of one pair of start and goal, with the rehearsal that follows the first try.

    Attributes:
        remembering: the agent's judgement of the first try with the memory of the rehearsals of all
            pairs before.
        kept: of the best try.
        num_tries: of the rehearsal.
        off_skin_kept_s: as `off_skin_s`, for the best try.
    """

    remembering: tuple[float, bool]
    kept: tuple[float, bool]
    num_tries: int
    off_skin_kept_s: float | None


def try_pairs(
    run: RunDirectory,
    world: World,
    agent: Agent,
    progress: Callable[[float, str], None],
    executor: Executor | None = None,
) -> tuple[list[Trial], list[tuple[int, int]]]:
    """Plans, executes and rehearses random pairs, and scores each against what was felt.

    The agent begins with a blank memory, whatever the run remembers, so that the metrics are the
    same every time. First tries are planned without memory; rehearsals remember earlier ones. The
    run keeps the first try of each pair, because the metrics describe it.

    Args:
        run: where the plans are kept.
        world: where they are executed.
        agent: the agent that plans.
        progress: called with the fraction done and the current task.
        executor: where first tries are made; by default here, one after another. Other processes
            load the agent from the run.

    Returns:
        The trials, and the pairs for which no way was found.

    Raises:
        ChildProcessError: a process of the executor was killed.
    """
    tries, learned = FirstTries(world, agent), content_digest(run.representation)
    _tries.keep(tries, run, learned)
    rehearsing, max_tries = Pilot(tries.agent, world), run.experiment.execution.max_tries
    pairs = random_pairs(run.experiment, agent.representation)
    trials, without_way = list[Trial](), list[tuple[int, int]]()
    with (
        closing(_in_order(partial(_first_try, run, learned), pairs, executor or InTurn())) as found,
    ):
        for number, (start, goal) in enumerate(pairs):
            progress(number / len(pairs), f"sensation {start} to {goal}")
            if (result := next(found)) is None:
                without_way.append((start, goal))
                continue
            first, known = result
            save_plan(run, known.execution, start, goal)
            rehearsed = rehearsing.rehearse(start, goal, max_tries=max_tries, known=known)
            rehearsed = rehearsed or [known]
            kept = best(rehearsed)
            trials.append(
                Trial(
                    **vars(first),
                    remembering=_judgement(rehearsed[0]),
                    kept=_judgement(kept),
                    num_tries=len(rehearsed),
                    off_skin_kept_s=tries.off_skin_s(kept.execution),
                )
            )
    return trials, without_way


def _in_order(
    job: Callable[[tuple[int, int]], Any],
    pairs: Sequence[tuple[int, int]],
    executor: Executor,
) -> Generator[Any, None, None]:
    """Yields the result of each pair; the executor works on a few pairs ahead."""
    ahead = deque[Future[Any]]()
    try:
        for pair in pairs:
            ahead.append(executor.submit(job, pair))
            if len(ahead) > _MOST_AHEAD:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    except BrokenExecutor:
        raise ChildProcessError(
            "an evaluating process was killed, perhaps because memory ran out; repeat the command"
        ) from None
    finally:
        for future in ahead:
            future.cancel()


def _first_try(
    run: RunDirectory, learned: str, pair: tuple[int, int]
) -> tuple[FirstTry, Try] | None:
    return _tries(run, learned).first(*pair)


@OncePerThread
def _tries(run: RunDirectory, learned: str) -> FirstTries:
    """First tries of the agent of a run; `learned` identifies what it learned."""
    return FirstTries(make_world(run), load_agent(run))


def random_pairs(
    experiment: Experiment, representation: QuotientRepresentation
) -> list[tuple[int, int]]:
    """Pairs of start and goal for the trials, drawn from the seed without repetition.

    Both are on one part of the body that was recovered: no touch leads from part to part.
    """
    num_targets, part = representation.num_targets, representation.part
    random = np.random.default_rng(experiment.random_stream("pairs"))
    # The goals of a start are all kernels but itself.
    column, start = np.arange(num_targets - 1), np.arange(num_targets)[:, None]
    goals = column + (column >= start)
    within = (part[goals] == part[start]) & (part[start] < representation.num_parts)
    codes = np.flatnonzero(within)
    wanted = min(experiment.evaluation.num_pairs, len(codes))
    chosen = codes[random.choice(len(codes), size=wanted, replace=False)]
    starts = chosen // (num_targets - 1)
    return list(zip(starts.tolist(), goals.ravel()[chosen].tolist(), strict=True))


def _judgement(one: Try) -> tuple[float, bool]:
    return one.contact, one.reached
