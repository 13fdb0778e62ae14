"""Exploration: the agent decides from what it knows where to go (naive).

The agent goes to what it knows least: a sensation that it seldom felt, or a link for which it has
no good step. A move is a few configurations. An explorer yields it, and is sent what was felt on
the way. It does not know what makes the move. Where time counts, a `Walker` stays in contact; where
only touches count, a `PostureSampler` tries postures anywhere.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: What the explorer is sent: `(n, J)` configurations that were passed, and `(n, S)` N, what was
#: felt there.
Met = tuple[np.ndarray, np.ndarray]

#: What the explorer yields: `(n, J)` configurations to pass.
Moves = Generator[np.ndarray, Met, None]

#: Share of its velocity that a random walk keeps while it goes one stride, and number of strides
#: after which it is far from where it was.
_PERSISTENCE, _AWAY = 0.9, 20

#: Number of steps for which a walker slides about at each place, and chance that it walks to its
#: next place at random through the air.
_DWELL, _AIR = 750, 0.1

#: Most paces by which the agent presses harder or eases off in one step.
_PRESSED = 3.0

#: Steps without contact after which the agent goes back to the last touch, and returns in a row
#: that found no contact after which it gives up.
_MOST_LOST, _MOST_RETURNS = 2, 4

#: Share of the goals that are ends of poor links; the others are sensations seldom felt.
_LINKS = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointRanges:
    """What the agent knows about its joints without touch: their limits, and how far they step.

    Attributes:
        lower: `(J,)` lower limits, in the robot's units.
        upper: `(J,)` upper limits, likewise.
        stride: `(J,)` a step of a random walk, likewise.
        pace: strides, root mean square over the joints, of a step after which the agent feels.
    """

    lower: np.ndarray
    upper: np.ndarray
    stride: np.ndarray
    pace: float = 1.0


class Explorer(ABC):
    """Moves an agent through one round, in which what it knows stays the same.

    Args:
        agent: what the agent knows; None if nothing.
        joints: limits and strides of the robot's joints.
        q: `(J,)` where the joints are.
        felt: `(S,)` N, what is felt there.
        rng: from which all randomness comes.
    """

    def __init__(
        self,
        agent: Agent | None,
        joints: JointRanges,
        q: np.ndarray,
        felt: np.ndarray,
        rng: np.random.Generator,
    ) -> None:
        self._agent, self._joints, self._rng = agent, joints, rng
        self._q, self._felt = np.asarray(q, dtype=float), felt
        # The last touch.
        self._touch = self._q

    @abstractmethod
    def moves(self) -> Moves:
        """Explores without end."""

    def _go(self, path: np.ndarray) -> Moves:
        """Moves."""
        q, felt = yield path
        self._arrive(q, felt)

    def _arrive(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Takes note of where it is after a move, what it feels there, and its last touch."""
        if len(q):
            self._q, self._felt = q[-1].astype(float), felt[-1]
            if (touching := np.flatnonzero(felt.any(axis=1))).size:
                self._touch = q[touching[-1]].astype(float)

    def _within(self, q: np.ndarray) -> np.ndarray:
        return q.clip(self._joints.lower, self._joints.upper)


class Walker(Explorer):
    """Stays in contact as much as it can.

    It goes to what it knows least through the air. There it slides about: it walks at random, bent
    along the skin, so that it meets the same sensations in other postures. From how the last steps
    changed what it felt, it learns which way is into the skin and which way is out. Before it knows
    anything it moves at random, and slides about from any touch.
    """

    def __init__(self, *known: Any) -> None:
        super().__init__(*known)
        self._pace = self._joints.pace
        self._walk = np.zeros(len(self._q))
        # How fast the felt force grows along each joint, N per stride.
        self._slope = np.zeros(len(self._q))
        self._wanted = 0.0
        if self._agent is not None:
            representation = self._agent.representation
            self._wanted = float(np.median(representation.kernel_strength))
            self._visits = np.diff(representation.kernel_offsets).astype(float)

    def moves(self) -> Moves:
        """Explores without end."""
        yield from self._go(self._q[None])  # asks what is felt before the first move
        while True:
            if self._agent is None or self._rng.random() < _AIR:
                yield from self._wander()
            else:
                known = self._agent.representation
                goal = self._goal(known)
                rows = known.members(goal)
                row = self._rng.integers(rows.start, rows.stop)
                self._visits[goal] += 1.0
                self._slope[:] = 0.0
                yield from self._straight(known.kernel_q[row].astype(float))
            if self._felt.any():
                yield from self._roam()

    def _wander(self) -> Moves:
        """Walks at random until it meets another touch, and goes back to that touch."""
        # Near the last touch the walk would meet the same place again.
        yield from self._go(self._random_walk(round(_AWAY / self._pace)))
        self._slope[:] = 0.0
        left = self._touch
        while self._touch is left:
            yield from self._go(self._random_walk(1))
        yield from self._straight(self._touch)

    def _random_walk(self, num_steps: int) -> np.ndarray:
        """`(n, J)` the next configurations of a random walk that turns round at the limits."""
        walk = np.empty((num_steps, len(self._q)))
        q = self._q
        for step in range(len(walk)):
            walk[step] = q = self._turned_round(q + self._heading())
        return walk

    def _heading(self) -> np.ndarray:
        """`(J,)` the next step of a random walk, as fast as random babbling."""
        kept = _PERSISTENCE**self._pace
        noise = self._rng.standard_normal(len(self._q))
        self._walk = kept * self._walk + np.sqrt(1.0 - kept**2) * noise
        return self._walk * self._pace * self._joints.stride

    def _turned_round(self, q: np.ndarray) -> np.ndarray:
        """`(J,)` `q` within the limits; joints that pass a limit turn round."""
        self._walk[(q < self._joints.lower) | (q > self._joints.upper)] *= -1.0
        return self._within(q)

    def _straight(self, q: np.ndarray) -> Moves:
        """Goes through the air, a pace at a time."""
        strides = (q - self._q) / self._joints.stride
        count = max(int(np.ceil(np.sqrt(np.mean(strides**2)) / self._pace)), 1)
        share = np.linspace(0.0, 1.0, count + 1)[1:, None]
        yield from self._go(self._q + share * (q - self._q))

    def _goal(self, known: QuotientRepresentation) -> int:
        """A kernel that was seldom visited, or an end of a poor link."""
        if self._rng.random() < _LINKS and len(known.edges):
            # The ends of a poor link have no postures near each other; there are better ones in
            # between.
            worst = np.argsort(-known.edge_cost, kind="stable")[: max(len(known.edges) // 10, 1)]
            return int(self._rng.choice(known.edges[self._rng.choice(worst)]))
        need = 1.0 / (1.0 + self._visits) ** 2
        return int(self._rng.choice(len(need), p=need / need.sum()))

    def _roam(self) -> Moves:
        """Slides about: walks at random, bent along the skin."""
        lost = returns = 0
        for _ in range(_DWELL):
            yield from self._go(self._turned_round(self._q + self._in_touch(self._heading()))[None])
            if self._felt.any():
                lost = returns = 0
                continue
            lost += 1
            if lost == _MOST_LOST:
                lost, returns = 0, returns + 1
                yield from self._straight(self._touch)
                if returns == _MOST_RETURNS and not self._felt.any():
                    return
                # This direction left the skin; take another one.
                self._walk = self._rng.standard_normal(len(self._q))

    def _in_touch(self, step: np.ndarray) -> np.ndarray:
        """`(J,)` the step, bent along the skin so that the agent feels as much as usual."""
        steepness = float(np.linalg.norm(self._slope))
        if not steepness > 0.0:
            return step
        stride, up = self._joints.stride, self._slope / steepness
        along = step / stride
        along = along - up * (up @ along)
        short = (self._wanted - float(np.linalg.norm(self._felt))) / steepness
        most = _PRESSED * self._pace
        return (along + up * np.clip(short, -most, most)) * stride

    def _go(self, path: np.ndarray) -> Moves:
        """Moves, and learns from each step which way is into the skin (Broyden's update)."""
        here, before = self._q, float(np.linalg.norm(self._felt))
        q, felt = yield path
        strength = np.linalg.norm(felt, axis=1)
        for there, after in zip(q.astype(float), strength, strict=True):
            step = (there - here) / self._joints.stride
            size = float(step @ step)
            # In a smaller step, noise would change what is felt more than the skin does.
            if size < (0.5 * self._pace) ** 2 and after > 0.0:
                continue
            if size > 0.0 and (before > 0.0 or after > 0.0):
                self._slope += (after - before - self._slope @ step) / size * step
            here, before = there, after
        self._arrive(q, felt)
        if self._agent is None and strength.any():
            self._wanted = max(self._wanted, 0.5 * float(strength.max()))
