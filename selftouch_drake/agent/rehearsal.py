"""Rehearsal: the agent acts, notices where it felt nothing, and plans around that place."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.representation import QuotientRepresentation, felt_kernels, step_links
from selftouch_drake.agent.sliding import Slides

#: A link on which contact was lost costs this many times more from then on.
LOSS_FACTOR = 8.0
# Six losses: beyond that a link is as good as cut, and the costs stay far from overflow.
_MOST_PENALTY = LOSS_FACTOR**6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RehearsalMemory:
    """What the agent remembers from its rehearsals; every later plan uses it.

    Attributes:
        link_penalty: `(L,)` factors on the cost of the links of its planner, 1 or more.
        slides: practised ways between touches, where straight ones lose contact.
        num_tries: number of motions executed to learn it.
        belongs_to: fingerprint of the representation that these links belong to.
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
        """The memory after one more try that lost contact on `lost_links` `(n,)`."""
        return replace(self.avoiding(lost_links), num_tries=self.num_tries + 1)

    def avoiding(self, links: np.ndarray) -> RehearsalMemory:
        """The memory in which `links` `(n,)` cost more."""
        penalty = self.link_penalty.copy()
        penalty[links] = np.minimum(LOSS_FACTOR * penalty[links], _MOST_PENALTY)
        return replace(self, link_penalty=penalty)

    def same_as(self, other: RehearsalMemory) -> bool:
        """Whether plans are the same with this memory as with another of the same agent."""
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
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ForeignMemoryError: the arrays belong to another representation.
            ValueError: an array is missing or invalid; the text names it.
        """
        blank = cls.blank(representation)
        if missing := [name for name in blank.to_arrays() if name not in arrays]:
            raise ValueError(f"{missing[0]} is missing")
        penalty, num_tries, belongs_to = (
            np.asarray(arrays[name]) for name in ("link_penalty", "num_tries", "belongs_to")
        )
        if str(belongs_to) != blank.belongs_to or penalty.shape != blank.link_penalty.shape:
            raise ForeignMemoryError("the rehearsals belong to another representation")
        if num_tries.shape != () or num_tries.dtype.kind not in "iu" or num_tries < 0:
            raise ValueError(f"num_tries is {num_tries.tolist()}, expected a whole number >= 0")
        if penalty.dtype.kind != "f" or not (np.isfinite(penalty) & (penalty >= 1)).all():
            raise ValueError("link_penalty must hold finite factors, 1 or more")
        slides = Slides(**{f.name: np.asarray(arrays[f"slide_{f.name}"]) for f in fields(Slides)})
        slides.check(representation.kernel_q.shape[1], representation.num_targets)
        return cls(
            link_penalty=penalty,
            slides=slides,
            num_tries=int(num_tries),
            belongs_to=str(belongs_to),
        )


class ForeignMemoryError(ValueError):
    """A memory that belongs to another representation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Try:
    """One executed plan, judged by the agent itself.

    Attributes:
        contact: share of the time with expected touch in which something was felt.
        reached: whether the motion ended in its goal; see `reached`.
        lost_links: `(n,)` rows of the planner's `links` on which contact was lost, and the last
            link of the plan if the goal was missed.
        lost_steps: `(n,)` steps of the plan on which contact was lost.
        execution: what was executed and felt.
    """

    contact: float
    reached: bool
    lost_links: np.ndarray
    lost_steps: np.ndarray
    execution: Execution

    @property
    def perfect(self) -> bool:
        """Whether the goal was reached without losing contact."""
        return self.reached and self.contact == 1.0


def reached(motion: Motion, felt: np.ndarray, representation: QuotientRepresentation) -> bool:
    """Whether a motion ends in its goal: one of the target sensations nearest to the last.

    Args:
        motion: what was planned, T instants.
        felt: `(T, S)` N, sensations along it.
        representation: the one used to make the plan.
    """
    return motion.goal in felt_kernels(representation, felt[-1])


def judge(execution: Execution, representation: QuotientRepresentation) -> Try:
    """Judges an executed plan by the sensations along it.

    Args:
        execution: what was executed and felt.
        representation: the one used to make the plan.
    """
    motion, links = execution.motion, execution.motion.links
    lost_touch = motion.touching & ~execution.felt.any(axis=1)
    arrived = reached(motion, execution.felt, representation)
    lost = np.zeros(len(links), dtype=bool)
    lost_steps = np.unique(motion.step[lost_touch]) if len(links) else np.empty(0, dtype=int)
    lost[lost_steps] = True
    if len(links):
        lost[-1] |= not arrived
    return Try(
        contact=execution.contact,
        reached=arrived,
        lost_links=np.unique(links[lost & (links >= 0)]),
        lost_steps=lost_steps,
        execution=execution,
    )


def best(tries: list[Try]) -> Try:
    """The try to keep: one that reached its goal, with the most contact; the first of equals."""
    return max(tries, key=lambda one: (one.reached, one.contact))


def _fingerprint(representation: QuotientRepresentation, links: np.ndarray) -> str:
    """Hash of the target sensations, joint scale and links of a representation."""
    digest = hashlib.sha256()
    for array in (representation.target_sensations, representation.joint_scale, links):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
