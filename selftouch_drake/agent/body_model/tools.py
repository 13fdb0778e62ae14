"""Tools: what is taken in hand is a new point that touches, and a known one is known again.

A tool moves with the last link of a known chain. Three numbers say where it touches, and some ten
touches tell them. Which of all is in hand, or whether none is, they tell by likelihood.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain_change import (
    ChainChange,
    Foretold,
    Part,
    new_point,
    price,
)
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.body_model.smoothness import SmoothChain

#: Number of the bare hand among tools.
BARE = -1
# Fewer touches do not tell three numbers.
_FEWEST = 5


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """Where a tool touches.

    Attributes:
        offset: `(3,)` from where the bare hand touches at readings of 0, in the chain's unit.
        covariance: `(3, 3)` of the offset.
    """

    offset: np.ndarray
    covariance: np.ndarray

    def seen_again(self, other: "Tool") -> "Tool":
        """The same tool, by both of two looks at it."""
        weight = self.covariance @ np.linalg.inv(self.covariance + other.covariance)
        offset = self.offset + weight @ (other.offset - self.offset)
        covariance = self.covariance - weight @ self.covariance
        return Tool(offset, (covariance + covariance.T) / 2)


class Hand:
    """What an agent has in hand, and the tools that it knows, of one chain.

    Attributes:
        tools: those known, in the order in which they were first taken.
        holds: number of the one in hand, or `BARE`.
    """

    def __init__(self) -> None:
        self.tools: list[Tool] = []
        self.holds = BARE

    @property
    def offset(self) -> np.ndarray:
        """`(3,)` where the hand touches with what it holds, as of `Tool`."""
        return np.zeros(3) if self.holds == BARE else self.tools[self.holds].offset

    def chain(self, bare: KnownChain) -> KnownChain:
        """The chain with what the hand holds; its touches remain those of the bare hand."""
        point = bare.chain.point + self.offset
        return replace(bare, chain=SmoothChain(bare.chain.twists, point, np.inf))

    def feel(self, bare: KnownChain, usual: Foretold, since: Foretold) -> str:
        """Finds out what is in hand by some ten touches, and says so in one line.

        Args:
            bare: the chain of the bare hand.
            usual: touches of the bare hand, to which the chain was not fitted.
            since: touches with what is in hand.

        Raises:
            ValueError: there are fewer than five touches.
        """
        if len(since.q) < _FEWEST:
            raise ValueError(
                f"{len(since.q)} touches do not tell what is in hand; give {_FEWEST} or more"
            )
        return self.take(_tool(new_point(bare, usual, since), bare), len(since.q))

    def moved(self, change: ChainChange, number: int) -> tuple[str, KnownChain]:
        """As `feel`, if it is known that what touches moved, and no more, from so many touches.

        Returns:
            What is in hand, and the chain with that.
        """
        before, was = change.before, self.offset
        found = _tool(change.parts[0], before)
        said = self.take(Tool(was + found.offset, found.covariance), number)
        point = before.chain.point + self.offset - was
        return said, replace(before, chain=SmoothChain(before.chain.twists, point, np.inf))

    def take(self, found: Tool, number: int) -> str:
        """Recognises what touches at a place that so many touches told, or remembers it."""
        before = self.holds
        self.holds = recognised(self.tools, found, number)
        if self.holds == len(self.tools):
            self.tools.append(found)
            return f"tool {self.holds} is in hand, a new one"
        if self.holds != BARE:
            self.tools[self.holds] = self.tools[self.holds].seen_again(found)
        what = "the hand is bare" if self.holds == BARE else f"tool {self.holds} is in hand"
        return what if self.holds == before else f"{what} again"

    def turned(self, turn: np.ndarray) -> None:
        """Turns the tools with the last link, as `ChainChange.turn` says."""
        self.tools = [
            Tool(turn @ tool.offset, turn @ tool.covariance @ turn.T) for tool in self.tools
        ]


def _tool(part: Part, chain: KnownChain) -> Tool:
    """What touches where the point of a chain moved."""
    return Tool(part.amount * chain.radius, part.covariance * chain.radius**2)


def recognised(tools: Sequence[Tool], found: Tool, number: int) -> int:
    """Which tool `found` is, from so many touches: `BARE`, a number, or that of a new one.

    To be a new one costs the description of three numbers.
    """
    bare = Tool(np.zeros(3), np.zeros((3, 3)))
    least, best = price(3, number), len(tools)
    for which, tool in enumerate([bare, *tools], start=BARE):
        away = found.offset - tool.offset
        off = float(away @ np.linalg.solve(found.covariance + tool.covariance, away))
        if off < least:
            least, best = off, which
    return best
