"""Rehearsal: the agent acts, notices where it felt nothing, and plans round that place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from selftouch_drake.agent.motions import Execution
from selftouch_drake.agent.representation import QuotientRepresentation, felt_kernels, step_links
from selftouch_drake.agent.sliding import Slides

Mind = TypeVar("Mind")

#: A link on which contact was lost costs this many times more from then on.
LOSS_FACTOR = 8.0
# Six losses: beyond that a link is as good as cut, and the costs stay far from overflow.
_MOST_PENALTY = LOSS_FACTOR**6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RehearsalMemory:
    """What the agent remembers of its rehearsals, for every later plan.

    Attributes:
        link_penalty: `(L,)` factors on the cost of the links of its planner, 1 or more.
        slides: practised ways between touches whose straight connection loses contact.
        num_tries: number of executed motions behind it.
        belongs_to: fingerprint of the representation whose links these are.
    """

    link_penalty: np.ndarray
    slides: Slides
    num_tries: int
    belongs_to: str

    @classmethod
    def blank(cls, representation: QuotientRepresentation) -> RehearsalMemory:
        """The memory of an agent that has rehearsed nothing."""
        links = step_links(representation)
        return cls(
            link_penalty=np.ones(len(links)),
            slides=Slides.none(len(representation.joint_scale)),
            num_tries=0,
            belongs_to=_fingerprint(representation, links),
        )

    def after(self, lost_links: np.ndarray) -> RehearsalMemory:
        """The memory after one more try, which lost contact on `lost_links` `(n,)`."""
        return replace(self.avoiding(lost_links), num_tries=self.num_tries + 1)

    def avoiding(self, links: np.ndarray) -> RehearsalMemory:
        """The memory in which `links` `(n,)` cost more."""
        penalty = self.link_penalty.copy()
        penalty[links] = np.minimum(LOSS_FACTOR * penalty[links], _MOST_PENALTY)
        return replace(self, link_penalty=penalty)

    def same_as(self, other: RehearsalMemory) -> bool:
        """Whether plans are the same with it as with another memory of the agent."""
        same = len(self.slides.ends) == len(other.slides.ends)
        return same and np.array_equal(self.link_penalty, other.link_penalty)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields as arrays, by name."""
        return {
            "link_penalty": self.link_penalty,
            **{f"slide_{f.name}": getattr(self.slides, f.name) for f in fields(Slides)},
            "num_tries": np.array(self.num_tries),
            "belongs_to": np.array(self.belongs_to),
        }

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, np.ndarray], representation: QuotientRepresentation
    ) -> RehearsalMemory:
        """What `to_arrays` gave; other names are ignored.

        Raises:
            ForeignMemoryError: it remembers the links of another representation.
            ValueError: an array is missing, or is none of a memory; the text names it.
        """
        blank = cls.blank(representation)
        if missing := [name for name in blank.to_arrays() if name not in arrays]:
            raise ValueError(f"{missing[0]} is missing")
        penalty, num_tries, belongs_to = (
            np.asarray(arrays[name]) for name in ("link_penalty", "num_tries", "belongs_to")
        )
        if str(belongs_to) != blank.belongs_to or penalty.shape != blank.link_penalty.shape:
            raise ForeignMemoryError("the rehearsals are of another representation")
        if num_tries.shape != () or num_tries.dtype.kind not in "iu" or num_tries < 0:
            raise ValueError(f"num_tries is {num_tries.tolist()}, not a whole number, 0 or more")
        if penalty.dtype.kind != "f" or not (np.isfinite(penalty) & (penalty >= 1)).all():
            raise ValueError("link_penalty holds what is no factor, 1 or more")
        slides = Slides(**{f.name: np.asarray(arrays[f"slide_{f.name}"]) for f in fields(Slides)})
        slides.check(representation.kernel_q.shape[1], representation.num_targets)
        return cls(
            link_penalty=penalty,
            slides=slides,
            num_tries=int(num_tries),
            belongs_to=str(belongs_to),
        )


class ForeignMemoryError(ValueError):
    """A memory of rehearsals with another representation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Try:
    """One executed plan, as the agent itself can judge it.

    Attributes:
        contact: share of the time with expected touch in which something was felt.
        reached: whether the last sensation was nearest to the goal.
        lost_links: `(n,)` rows of the planner's `links` on which nothing was felt; the
            last link of the plan if the goal was missed.
        lost_steps: `(n,)` steps of the plan on which nothing was felt.
        execution: of the plan.
    """

    contact: float
    reached: bool
    lost_links: np.ndarray
    lost_steps: np.ndarray
    execution: Execution

    @property
    def perfect(self) -> bool:
        """Whether nothing can be improved."""
        return self.reached and self.contact == 1.0


def judge(execution: Execution, representation: QuotientRepresentation) -> Try:
    """Judges an executed plan by what was felt along it.

    Args:
        execution: of the plan.
        representation: the one that the plan was made with.
    """
    motion, links = execution.motion, execution.motion.links
    lost_touch = motion.touching & ~execution.felt.any(axis=1)
    reached = motion.goal in felt_kernels(representation, execution.felt[-1])
    lost = np.zeros(len(links), dtype=bool)
    lost_steps = np.unique(motion.step[lost_touch]) if len(links) else np.empty(0, dtype=int)
    lost[lost_steps] = True
    if len(links):
        lost[-1] |= not reached
    return Try(
        contact=execution.contact,
        reached=reached,
        lost_links=np.unique(links[lost & (links >= 0)]),
        lost_steps=lost_steps,
        execution=execution,
    )


def rehearse(
    attempt: Callable[[Mind], Try | None],
    learn: Callable[[Try, Mind], Mind],
    mind: Mind,
    *,
    max_tries: int,
) -> tuple[list[Try], Mind]:
    """Tries until no contact is lost; each try uses what the earlier ones taught.

    Args:
        attempt: plans, executes and judges; returns None if there is no way.
        learn: returns what is known after a try.
        mind: what is known at first; an agent, or its memory.
        max_tries: largest number of tries, at least one.

    Returns:
        The tries in order (`best` chooses the one to keep), and what is known after them.

    Raises:
        ValueError: `max_tries` is below one.
    """
    if max_tries < 1:
        raise ValueError(f"max_tries is {max_tries}: give at least 1")
    tries: list[Try] = []
    while len(tries) < max_tries and not (tries and tries[-1].perfect):
        one = attempt(mind)
        if one is None:
            break
        tries.append(one)
        mind = learn(one, mind)
    return tries, mind


def best(tries: list[Try]) -> Try:
    """The try to keep: one that reached its goal, with the most contact; the first of equals."""
    return max(tries, key=lambda one: (one.reached, one.contact))


def _fingerprint(representation: QuotientRepresentation, links: np.ndarray) -> str:
    """Identifies the targets of a representation, and the links between them."""
    digest = hashlib.sha256()
    for array in (representation.target_sensations, representation.joint_scale, links):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
