"""Exploration by the map: where the agent goes, from what it knows (naive).

The agent is in touch as often as it can be. From a touch it sets out for what it knows least: a
sensation that it seldom felt, or a link that it has no good step for. It goes there by its own
plan, along its skin, and feels its way: how the last steps changed what it felt says which way is
in and which way is out. There it slides about at random, so that it meets the same sensations in
other postures. Before it knows anything it moves at random, and slides about from any touch.

A move is a few configurations. The explorer yields it, and is sent what was felt on the way: it
does not know what carries it out.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Plan

#: What it is sent: `(n, J)` configurations that were passed and `(n, S)` N, what was felt there.
Met = tuple[np.ndarray, np.ndarray]

#: What it yields: `(n, J)` configurations to pass.
Moves = Generator[np.ndarray, Met, None]

#: Steps that a slide about a place leads away, at most.
_FAR = 8

#: Steps of a random walk, after which it has forgotten where it was.
_AWAY = 20

#: Strides that a small move goes, of each joint. On a torus half of such moves touch. With 4000
#: touches, 3 of 4 of them small moves about the fourth, its shape is off by 3.2 %, with all of them
#: met at random by 4.2 %: neighbours on the skin have postures near each other.
_HOP = 0.67

#: rad, of path length, between places on a plan that it makes for.
_ALONG = 0.2

#: Strides, as a share of the pace, that the agent presses or yields in a step at most.
_PRESSED = 0.6

#: Strides without touch, after which it goes back to the last touch; goings back, after which it
#: gives up.
_MOST_LOST, _MOST_RETURNS = 2, 4

#: Share of the goals that are ends of poor links; the others are sensations seldom felt.
_LINKS = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joints:
    """What the agent knows of its joints without touch: how far they go, and how it moves them.

    Attributes:
        lower: `(J,)` in the robot's units.
        upper: `(J,)` likewise.
        stride: `(J,)` likewise; a step of a random walk.
    """

    lower: np.ndarray
    upper: np.ndarray
    stride: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How an agent explores, by what costs it more: to touch, or to pass the time.

    Attributes:
        pace: strides, how far it moves in one step while in touch.
        dwell: steps in which it slides about a place.
        air: how often it walks to its next place at random through the air.
        walked: steps of such a walk, until it looks whether it met something.
        hops: small moves about each touch that it comes to, which need not stay in touch. Then it
            makes no journeys.
    """

    pace: float
    dwell: int
    air: float
    walked: int
    hops: int


class Explorer:
    """Moves an agent for some time in which what it knows stays the same.

    Args:
        agent: what it knows; None if nothing.
        joints: of the robot.
        manner: how it explores.
        q: `(J,)` where the joints are.
        felt: `(S,)` N, what is felt there.
        rng: of all that is random.
    """

    def __init__(
        self,
        agent: Agent | None,
        joints: Joints,
        manner: Manner,
        q: np.ndarray,
        felt: np.ndarray,
        rng: np.random.Generator,
    ) -> None:
        self._agent, self._joints, self._manner, self._rng = agent, joints, manner, rng
        self._q, self._felt = np.asarray(q, dtype=float), felt
        self._walk = np.zeros(len(q))
        #: By how much more is felt along each joint, N per stride, and the last touch.
        self._slope = np.zeros(len(q))
        self._touch = self._q
        self._wanted, self._steps = 0.0, 0
        if agent is not None:
            known = agent.representation
            self._wanted = float(np.median(known.kernel_strength))
            self._visits = np.diff(known.kernel_offsets).astype(float)

    def moves(self) -> Moves:
        """Explores without end."""
        while True:
            if self._agent is None or self._rng.random() < self._manner.air:
                yield from self._wander()
            elif self._manner.hops or not self._felt.any():
                yield from self._search(self._agent)
            else:
                yield from self._journey(self._agent, self._goal(self._agent))
            self._steps = 0
            while self._felt.any() and self._steps < self._manner.dwell:
                aim = self._rng.standard_normal(len(self._q))
                aim *= _FAR * self._manner.pace / np.linalg.norm(aim)
                yield from self._slide([self._q + aim * self._joints.stride], self._manner.dwell)

    def _search(self, agent: Agent) -> Moves:
        """Goes through the air to a remembered touch."""
        goal = self._goal(agent)
        rows = agent.representation.members(goal)
        row = int(self._rng.integers(rows.start, rows.stop))
        self._visits[goal] += 1.0
        self._slope[:] = 0.0
        yield from self._come_to(agent.representation.kernel_q[row].astype(float))

    def _wander(self) -> Moves:
        """Walks at random until it meets another touch, and goes back to that."""
        # Near the last touch it would meet the same again.
        yield from self._go(self._random_walk(_AWAY))
        self._slope[:] = 0.0
        left = self._touch
        while self._touch is left:
            yield from self._go(self._random_walk(self._manner.walked))
        yield from self._come_to(self._touch)

    def _random_walk(self, num_steps: int) -> np.ndarray:
        """`(n, J)` the next configurations of a walk that turns round at the limits."""
        walk = np.empty((num_steps, len(self._q)))
        q = self._q
        for step in range(len(walk)):
            noise = self._rng.standard_normal(len(q))
            self._walk = 0.9 * self._walk + np.sqrt(1.0 - 0.9**2) * noise
            q = q + self._walk * self._joints.stride
            out = (q < self._joints.lower) | (q > self._joints.upper)
            self._walk[out] *= -1.0
            walk[step] = q = self._within(q)
        return walk

    def _come_to(self, q: np.ndarray) -> Moves:
        """Goes through the air to a touch, or about it."""
        if not self._manner.hops:
            yield from self._straight(q)
            return
        noise = self._rng.standard_normal((self._manner.hops, len(q)))
        yield from self._go(self._within(q + _HOP * noise * self._joints.stride))

    def _straight(self, q: np.ndarray) -> Moves:
        """Goes through the air, a stride at a time."""
        count = max(int(np.ceil(self._strides(q - self._q))), 1)
        share = np.linspace(0.0, 1.0, count + 1)[1:, None]
        yield from self._go(self._q + share * (q - self._q))

    def _goal(self, agent: Agent) -> int:
        """A kernel of the part that is touched, one that it knows little of."""
        known = agent.representation
        if self._rng.random() < _LINKS and len(known.edges):
            # Its two ends have no postures near each other: there are better ones in between.
            worst = np.argsort(-known.edge_cost, kind="stable")[: max(len(known.edges) // 10, 1)]
            return int(self._rng.choice(known.edges[self._rng.choice(worst)]))
        need = 1.0 / (1.0 + self._visits) ** 2
        return int(self._rng.choice(len(need), p=need / need.sum()))

    def _journey(self, agent: Agent, goal: int) -> Moves:
        """Goes to a kernel by a plan, and feels its way."""
        try:
            plan = agent.plan_from(self._q, self._felt, goal)
        except ValueError:
            return
        self._visits[goal] += 1.0
        yield from self._slide(self._along(plan))

    def _along(self, plan: Plan) -> Iterator[np.ndarray]:
        """Configurations of a plan, near each other."""
        length = float(plan.waypoint_s[-1])
        yield from plan.path(np.linspace(0.0, length, max(int(length / _ALONG), 1) + 1))[1:]

    def _slide(self, way: Iterable[np.ndarray], most: float = np.inf) -> Moves:
        """Goes along a way and keeps in touch; gives up where it cannot, or after `most` steps."""
        returns = 0
        for aim in way:
            lost = 0
            for _ in range(4 * _FAR):
                rest = aim - self._q
                far = self._strides(rest)
                if far < 0.5 * self._manner.pace:
                    break
                if self._steps >= most or returns >= _MOST_RETURNS:
                    return
                self._steps += 1
                step = rest * min(self._manner.pace / far, 1.0)
                yield from self._go(self._within(self._q + self._in_touch(step))[None])
                lost = 0 if self._felt.any() else lost + 1
                if lost >= _MOST_LOST:
                    returns += 1
                    yield from self._straight(self._touch)
                    break

    def _in_touch(self, step: np.ndarray) -> np.ndarray:
        """The step, bent along the skin, and pressed on or eased off."""
        steepness = float(np.linalg.norm(self._slope))
        if not steepness > 0.0:
            return step
        stride, up = self._joints.stride, self._slope / steepness
        along = step / stride
        along = along - up * (up @ along)
        short = (self._wanted - float(np.linalg.norm(self._felt))) / steepness
        most = _PRESSED * self._manner.pace
        return (along + up * np.clip(short, -most, most)) * stride

    def _go(self, path: np.ndarray) -> Moves:
        """Moves, and learns from each step which way is in."""
        q, felt = yield path
        if not len(q):
            return
        strength = np.linalg.norm(felt, axis=1)
        here, before = self._q, float(np.linalg.norm(self._felt))
        for there, after in zip(q.astype(float), strength, strict=True):
            step = (there - here) / self._joints.stride
            size = float(step @ step)
            # Of a smaller step the noise would say more than the skin.
            if size < (0.5 * self._manner.pace) ** 2 and after > 0.0:
                continue
            if size > 0.0 and (before > 0.0 or after > 0.0):
                self._slope += (after - before - self._slope @ step) / size * step
            here, before = there, after
        self._q, self._felt = q[-1].astype(float), felt[-1]
        if (touching := np.flatnonzero(strength)).size:
            self._touch = q[touching[-1]].astype(float)
            if self._agent is None:
                self._wanted = max(self._wanted, 0.5 * float(strength.max()))

    def _strides(self, step: np.ndarray) -> float:
        return float(np.linalg.norm(step / self._joints.stride))

    def _within(self, q: np.ndarray) -> np.ndarray:
        return q.clip(self._joints.lower, self._joints.upper)
