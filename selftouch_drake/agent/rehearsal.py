"""Rehearsal: the agent acts, notices where it felt nothing, and plans round that place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from selftouch_drake.agent.planning import near_links
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.files import load_arrays, save_arrays

#: A link on which contact was lost costs this many times more from then on.
LOSS_FACTOR = 8.0
# Six losses: beyond that a link is as good as cut, and the costs stay far from overflow.
_MOST_PENALTY = LOSS_FACTOR**6

_NO_MEMORY = "{} is no memory of rehearsals; delete it, and rehearse again"

Motion = TypeVar("Motion")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RehearsalMemory:
    """What the agent remembers of its rehearsals; it outlasts them, and serves every later plan.

    Attributes:
        link_penalty: `(L,)` factors on the cost of the links of its planner, 1 or more.
        num_tries: motions that were executed to learn it.
        belongs_to: fingerprint of the representation whose links these are.
    """

    link_penalty: np.ndarray
    num_tries: int
    belongs_to: str

    @classmethod
    def blank(cls, representation: QuotientRepresentation) -> RehearsalMemory:
        """The memory of an agent that has rehearsed nothing."""
        links = near_links(representation)
        return cls(
            link_penalty=np.ones(len(links)),
            num_tries=0,
            belongs_to=_fingerprint(representation, links),
        )

    def after(self, lost_links: np.ndarray) -> RehearsalMemory:
        """The memory after one more try, which lost contact on `lost_links` `(n,)`."""
        penalty = self.link_penalty.copy()
        penalty[lost_links] = np.minimum(LOSS_FACTOR * penalty[lost_links], _MOST_PENALTY)
        return replace(self, link_penalty=penalty, num_tries=self.num_tries + 1)

    def save(self, path: Path) -> None:
        """Writes the memory, whole or not at all."""
        save_arrays(
            path,
            {
                "link_penalty": self.link_penalty,
                "num_tries": np.array(self.num_tries),
                "belongs_to": np.array(self.belongs_to),
            },
        )

    @classmethod
    def load(cls, path: Path, representation: QuotientRepresentation) -> RehearsalMemory:
        """Reads what `save` wrote.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: the file is damaged, or remembers the links of another representation.
        """
        try:
            arrays = load_arrays(path, ("link_penalty", "num_tries", "belongs_to"))
        except ValueError:
            raise ValueError(_NO_MEMORY.format(path)) from None
        penalty, num_tries = arrays["link_penalty"], arrays["num_tries"]
        links = near_links(representation)
        if str(arrays["belongs_to"]) != _fingerprint(representation, links) or (
            penalty.shape != (len(links),)
        ):
            raise ValueError(
                f"{path} remembers rehearsals of another representation; delete it, and rehearse "
                "again"
            )
        if (num_tries.shape, num_tries.dtype.kind, penalty.dtype.kind) != ((), "i", "f") or not (
            np.isfinite(penalty).all() and (penalty >= 1).all()
        ):
            raise ValueError(_NO_MEMORY.format(path))
        return cls(
            link_penalty=penalty, num_tries=int(num_tries), belongs_to=str(arrays["belongs_to"])
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Try(Generic[Motion]):
    """One executed plan, as the agent itself can judge it.

    Attributes:
        contact: share of the time in which something was felt.
        reached: whether the last sensation was nearest to the one that was wanted.
        lost_links: `(n,)` rows of the planner's `links` on which nothing was felt; the
            last link of the plan if the goal was missed.
        motion: what was executed and felt.
    """

    contact: float
    reached: bool
    lost_links: np.ndarray
    motion: Motion

    @property
    def perfect(self) -> bool:
        """Whether there is nothing left to do better."""
        return self.reached and self.contact == 1.0


def judge(
    motion: Motion,
    *,
    felt: np.ndarray,
    s: np.ndarray,
    waypoint_s: np.ndarray,
    links: np.ndarray,
    goal: int,
    target_sensations: np.ndarray,
) -> Try[Motion]:
    """Judges an executed plan by what was felt along it.

    Args:
        motion: what was executed, handed through.
        felt: `(T, S)` N, sensations along the motion.
        s: `(T,)` rad, where on the path the arm was meant to be.
        waypoint_s: `(W,)` rad, where on the path each waypoint is.
        links: `(W - 1,)` row in the planner's `links` of each step, -1 for none.
        goal: the target sensation that was wanted.
        target_sensations: `(K, S)` unit L2 norm.
    """
    touching = np.any(felt, axis=1)
    reached = bool(touching[-1] and np.argmax(target_sensations @ felt[-1]) == goal)
    lost = np.zeros(len(links), dtype=bool)
    if len(links):
        step = np.searchsorted(waypoint_s, s, side="right") - 1
        lost[np.unique(step[~touching].clip(0, len(links) - 1))] = True
        lost[-1] |= not reached
    return Try(
        contact=float(touching.mean()),
        reached=reached,
        lost_links=np.unique(links[lost & (links >= 0)]),
        motion=motion,
    )


def rehearse(
    attempt: Callable[[RehearsalMemory], Try[Motion]], memory: RehearsalMemory, *, max_tries: int
) -> tuple[list[Try[Motion]], RehearsalMemory]:
    """Tries until nothing is lost any more, each time with what the tries before have taught.

    Args:
        attempt: plans with the given memory, executes and judges.
        memory: what is remembered from before.
        max_tries: most tries, at least one.

    Returns:
        The tries in order (`best` tells which one to keep), and the memory after them.

    Raises:
        ValueError: `max_tries` is below one.
    """
    if max_tries < 1:
        raise ValueError(f"max_tries is {max_tries}: give at least 1")
    tries: list[Try[Motion]] = []
    while len(tries) < max_tries and not (tries and tries[-1].perfect):
        tries.append(attempt(memory))
        memory = memory.after(tries[-1].lost_links)
    return tries, memory


def best(tries: list[Try[Motion]]) -> Try[Motion]:
    """The try to keep: one that reached its goal, with the most contact; the first of equals."""
    return max(tries, key=lambda one: (one.reached, one.contact))


def _fingerprint(representation: QuotientRepresentation, links: np.ndarray) -> str:
    """Identifies the targets of a representation, and the links between them."""
    digest = hashlib.sha256()
    for array in (representation.target_sensations, links):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
