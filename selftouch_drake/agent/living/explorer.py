"""Exploration by the map: where the agent goes, from what it knows (naive).

The agent is in touch as often as it can be. It goes to what it knows least, a sensation that it
seldom felt or a link that it has no good step for: through the air, or by its own plan along its
skin. There it slides about: a random walk, bent along the skin, so that it meets the same
sensations in other postures. It feels its way: how the last steps changed what it felt says which
way is in and which way is out. Before it knows anything it moves at random, and slides about from
any touch.

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

#: Share of its velocity that a random walk keeps in the time in which it goes a stride, and strides
#: after which it has forgotten where it was.
_PERSISTENCE, _AWAY = 0.9, 20

#: Strides that a small move goes, of each joint. On a torus half of such moves touch. With 4000
#: touches, 3 of 4 of them small moves about the fourth, its shape is off by 3.2 %, with all of them
#: met at random by 4.2 %: neighbours on the skin have postures near each other.
_HOP = 0.67

#: rad, of path length, between places on a plan that it makes for.
_ALONG = 0.2

#: Paces that the agent presses or yields in a step at most.
_PRESSED = 3.0

#: Steps without touch, after which it goes back to the last touch; goings back in a row that found
#: none, after which it gives up; steps that it makes for one place on a plan at most.
_MOST_LOST, _MOST_RETURNS, _MOST_STEPS = 2, 4, 10

#: Share of the goals that it goes to by a plan along its skin, while it is in touch. A plan leads
#: through postures that it knows: in 10 simulated minutes on a torus (seed 1) it meets 23 postures
#: a minute that are 0.5 rad apart if it goes to all goals so, 133 with a quarter, 122 with none.
_BY_PLAN = 0.25

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
        pace: strides, how far each joint moves in one step, as a root of the mean square.
        dwell: steps that it slides about from each place that it came to.
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
        self._wanted, self._lost, self._returns = 0.0, 0, 0
        if agent is not None:
            known = agent.representation
            self._wanted = float(np.median(known.kernel_strength))
            self._visits = np.diff(known.kernel_offsets).astype(float)

    def moves(self) -> Moves:
        """Explores without end."""
        if not self._manner.hops:
            yield from self._go(self._q[None])  # what it feels before it moves
        while True:
            if self._agent is None or self._rng.random() < self._manner.air:
                yield from self._wander()
            elif not self._manner.hops and self._felt.any() and self._rng.random() < _BY_PLAN:
                yield from self._journey(self._agent, self._goal(self._agent))
            else:
                yield from self._search(self._agent)
            if self._felt.any():
                yield from self._roam(self._manner.dwell)

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
        yield from self._go(self._random_walk(round(_AWAY / self._manner.pace)))
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
            walk[step] = q = self._turned_round(q + self._heading())
        return walk

    def _heading(self) -> np.ndarray:
        """`(J,)` the next step of a random walk: as far in its time as random babbling goes."""
        kept = _PERSISTENCE**self._manner.pace
        noise = self._rng.standard_normal(len(self._q))
        self._walk = kept * self._walk + np.sqrt(1.0 - kept**2) * noise
        return self._walk * self._manner.pace * self._joints.stride

    def _turned_round(self, q: np.ndarray) -> np.ndarray:
        """`(J,)` within the limits; the walk turns round where they are met."""
        self._walk[(q < self._joints.lower) | (q > self._joints.upper)] *= -1.0
        return self._within(q)

    def _come_to(self, q: np.ndarray) -> Moves:
        """Goes through the air to a touch, or about it."""
        if not self._manner.hops:
            yield from self._straight(q)
            return
        noise = self._rng.standard_normal((self._manner.hops, len(q)))
        yield from self._go(self._within(q + _HOP * noise * self._joints.stride))

    def _straight(self, q: np.ndarray) -> Moves:
        """Goes through the air, a pace at a time."""
        count = max(int(np.ceil(self._paces(q - self._q))), 1)
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

    def _roam(self, num_steps: int) -> Moves:
        """Slides about: a random walk, bent along the skin."""
        self._returns = 0
        for _ in range(num_steps):
            if not self._touching:
                return
            if not (yield from self._feel_on(self._heading())):
                # What it walked into was no way.
                self._walk = self._rng.standard_normal(len(self._q))

    def _slide(self, way: Iterable[np.ndarray]) -> Moves:
        """Goes along a way and keeps in touch; gives up where it cannot."""
        self._returns = 0
        for aim in way:
            for _ in range(_MOST_STEPS):
                rest = aim - self._q
                paces = self._paces(rest)
                if paces < 0.5:
                    break
                if not self._touching:
                    return
                if not (yield from self._feel_on(rest / max(paces, 1.0))):
                    break

    @property
    def _touching(self) -> bool:
        """Whether it is in touch, or may be again soon."""
        return bool(self._felt.any()) or self._returns < _MOST_RETURNS

    def _feel_on(self, step: np.ndarray) -> Generator[np.ndarray, Met, bool]:
        """Makes a step in touch; False if it had to go back to the last touch."""
        yield from self._go(self._turned_round(self._q + self._in_touch(step))[None])
        if self._felt.any():
            self._lost = self._returns = 0
            return True
        self._lost += 1
        if self._lost < _MOST_LOST:
            return True
        self._lost = 0
        self._returns += 1
        yield from self._straight(self._touch)
        return False

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

    def _paces(self, step: np.ndarray) -> float:
        """How many steps it takes to go so far."""
        strides = step / self._joints.stride
        return float(np.sqrt(np.mean(strides**2))) / self._manner.pace

    def _within(self, q: np.ndarray) -> np.ndarray:
        return q.clip(self._joints.lower, self._joints.upper)
