"""Tries: the agent judges what it executed by what it felt."""

from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.representation.touches import felt_kernels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Try:
    """One executed plan, judged by the agent itself.

    Attributes:
        contact: share of the time with expected touch in which something was felt.
        reached: whether the motion ended in its goal; see `reached`.
        lost_steps: `(n,)` steps of the plan on which contact was lost.
        execution: what was executed and felt.
    """

    contact: float
    reached: bool
    lost_steps: np.ndarray
    execution: Execution

    @property
    def perfect(self) -> bool:
        """Whether the goal was reached without losing contact."""
        return self.reached and self.contact == 1.0


def reached(motion: Motion, felt: np.ndarray, representation: QuotientRepresentation) -> bool:
    """Whether a motion ends in its goal: one of the target sensations nearest to the last.

    `(T, S)` N was felt along it; the representation is the one used to make the plan.
    """
    return motion.plan.goal in felt_kernels(representation, felt[-1])


def judged_try(execution: Execution, representation: QuotientRepresentation) -> Try:
    """Judges an executed plan by the sensations along it; it was made with this representation."""
    motion = execution.motion
    lost = motion.touching & ~execution.felt.any(axis=1)
    if not len(motion.plan.links):  # a plan to stay
        lost[:] = False
    return Try(
        contact=execution.contact,
        reached=reached(motion, execution.felt, representation),
        lost_steps=np.unique(motion.step[lost]),
        execution=execution,
    )


def best(tries: list[Try]) -> Try:
    """The try to keep: one that reached its goal, with the most contact; the first of equals."""
    return max(tries, key=lambda one: (one.reached, one.contact))
