"""How good what an agent knows is at a moment of its life, in the body that it then has."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.records import Record
from selftouch_drake.agent.shape.recovery import RecoveredBody
from selftouch_drake.evaluation.motion import contact_along, random_pairs
from selftouch_drake.evaluation.shape import KernelTruth, kernel_truth, shape_errors
from selftouch_drake.experience.store import Contacts
from selftouch_drake.robot import World

if TYPE_CHECKING:
    from selftouch_drake.agent.lifelong.learner import OnlineLearner

# No luck of a network's start is in this metric, and it takes a few seconds.
_METRIC = "sensorimotor"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quality:
    """What an agent knows, held against a world.

    Attributes:
        body: the body that it recovers.
        truth: where its kernels touch now; None if one of them touches nothing any more.
        error: shape error of the skin that is off most, as a share of its size; NaN without truth.
        contact: share of planned paths in contact, without practice and dynamics; NaN if none was
            planned.
    """

    body: RecoveredBody
    truth: KernelTruth | None
    error: float
    contact: float


def quality(learner: "OnlineLearner", world: World, num_pairs: int) -> Quality:
    """Scores what a learner knows of the body as it is now; it must know something.

    Paths are planned between `num_pairs` pairs of start and goal.
    """
    known = learner.representation
    body = Agent.of(known).recover(_METRIC)
    felt = world.probe.touches(known.kernel_q)
    contacts = Contacts.of_rows(felt, np.arange(known.num_rows))
    try:
        truth = kernel_truth(known, contacts, world.receptor_skin)
    except ValueError:
        truth = None
    errors = {} if truth is None else shape_errors(body.positions, known.part, truth)
    return Quality(
        body=body,
        truth=truth,
        error=max(errors.values(), default=float("nan")),
        contact=planned_contact(learner, world, num_pairs),
    )


def planned_contact(learner: "OnlineLearner", world: World, num_pairs: int) -> float:
    """Share of planned paths in contact, in the kinematic world; NaN if there is no path."""
    agent, shares = Agent.of(learner.representation), list[float]()
    for start, goal in random_pairs(world.experiment, agent.representation, num_pairs):
        try:
            plan = agent.plan(start, goal)
        except ValueError:  # no way leads there yet
            continue
        shares.append(contact_along(world, plan))
    return float(np.mean(shares)) if shares else float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LifeCurves(Record):
    """The life of an agent as curves over its touches.

    Attributes:
        touches: `(M,)` touches at the moments at which it was scored.
        coverage: `(M,)` share of all receptors that have felt something by then.
        error: `(M,)` shape error; see `Quality`.
        contact: `(M,)` share of planned paths in contact.
        block_touches: `(B,)` touches at the end of each block.
        surprise: `(B,)` mean surprise in each block; NaN before anything is expected.
        changed: `(C,)` touches at which the body changed.
        noticed: `(D,)` touches at which the agent noticed a change.
        mended: `(D,)` touches at which it had found out what changed.
    """

    touches: np.ndarray
    coverage: np.ndarray
    error: np.ndarray
    contact: np.ndarray
    block_touches: np.ndarray
    surprise: np.ndarray
    changed: np.ndarray
    noticed: np.ndarray
    mended: np.ndarray
