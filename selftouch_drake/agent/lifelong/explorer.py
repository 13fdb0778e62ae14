"""Exploration: the agent decides from what it knows where to go (naive).

A move is a few configurations. An explorer yields it, and is sent what was felt on the way. It does
not know what makes the move. Where time counts, a `ContactExplorer` stays in contact, and goes to
what it knows least: a sensation that it seldom felt, or a link for which it has no good step. Where
only touches count, a `ModelExplorer` makes those that teach most about joints and skin.
"""

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.body_model.next_touch import Reachable, next_touches
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: The explorer yields `(n, J)` configurations to pass. It is sent those that were passed, likewise,
#: and what was felt there, `(n, S)` N.
Moves = Generator[np.ndarray, tuple[np.ndarray, np.ndarray], None]

#: Share of its velocity that a random walk keeps while it goes one stride.
_PERSISTENCE = 0.9

#: Strides after which a random walk is far from where it was.
_AWAY = 20

#: Steps for which an explorer slides about that often returns to what it knows, where it notices
#: changes. It learns better what to expect: on a torus, the mean surprise at the next samples is
#: 0.39 after 15,000 samples at 50 Hz, but 0.62 after 20,000 with 750 steps.
RESTLESS = 50

#: Probability that an explorer walks to its next place at random through the air.
_AIR = 0.1

#: Most paces by which the agent presses harder or eases off in one step.
_PRESSED = 3.0

#: Steps without contact after which the agent goes back to the last touch.
_MOST_LOST = 2

#: The agent gives up after so many returns in a row that found no contact. A body that travels does
#: not come back to the very posture: giving up after one takes more than half as many motions more.
_MOST_RETURNS = 4

#: Share of the goals that are ends of poor links; the others are sensations felt seldom.
_LINKS = 0.3

#: Touches about a touch of a receptor that seldom felt anything; length of a small move there, in
#: strides of each joint: 0.2 rad; and small moves for each wanted touch.
_SELDOM, _ABOUT, _TRIES = 10, 1.33, 12

#: Steps of a random walk in one move.
_AT_ONCE = 5

#: Postures that are chosen at a time: one large batch loses what choosing gains.
_BATCH = 50

#: Steps from a place where nothing is felt to one beneath the skin.
_INWARDS = 5

#: Share of a joint's range by which a posture may be drawn beyond each limit. It then rests at the
#: limit.
_BEYOND = 2.0

#: Samples while a posture is held.
_HELD = 8


@dataclass(eq=False)
class Explorer(ABC):
    """Moves an agent through one round, in which what it knows stays the same.

    Attributes:
        agent: what the agent knows; None if nothing.
        q: `(J,)` where the joints are, in the robot's units.
        felt: `(S,)` N, what is felt there.
        rng: from which all randomness comes.
        lower: `(J,)` lower limits of the joints, in the robot's units.
        upper: `(J,)` upper limits, likewise.
        stride: `(J,)` a step of a random walk, likewise.
        pace: strides, root mean square over the joints, of a step after which the agent feels.
    """

    agent: Agent | None
    q: np.ndarray
    felt: np.ndarray
    rng: np.random.Generator
    lower: np.ndarray
    upper: np.ndarray
    stride: np.ndarray
    pace: float = 1.0

    def __post_init__(self) -> None:
        # The last touch.
        self.touch = self.q = np.asarray(self.q, dtype=float)
        self._walk = np.zeros(len(self.q))

    @abstractmethod
    def moves(self) -> Moves:
        """Explores without end."""

    def _go(self, path: np.ndarray) -> Moves:
        self._arrive(*(yield path))

    def _random_walk(self, num_steps: int) -> np.ndarray:
        """`(n, J)` the next configurations of a random walk that turns round at the limits."""
        walk = [self.q]
        for _ in range(num_steps):
            walk.append(self._turned_round(walk[-1] + self._heading()))
        return np.array(walk[1:])

    def _heading(self) -> np.ndarray:
        """`(J,)` the next step of a random walk, as fast as random babbling."""
        kept = _PERSISTENCE**self.pace
        noise = self.rng.standard_normal(len(self.q))
        self._walk = kept * self._walk + np.sqrt(1.0 - kept**2) * noise
        return self._walk * self.pace * self.stride

    def _turned_round(self, q: np.ndarray) -> np.ndarray:
        """`(J,)` `q` within the limits; joints that pass a limit turn round."""
        self._walk[(q < self.lower) | (q > self.upper)] *= -1.0
        return q.clip(self.lower, self.upper)

    def _arrive(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Takes note of where it is after a move, what it feels there, and its last touch."""
        if len(q):
            self.q, self.felt = q[-1].astype(float), felt[-1]
            if (touching := np.flatnonzero(felt.any(axis=1))).size:
                self.touch = q[touching[-1]].astype(float)


@dataclass(eq=False)
class ContactExplorer(Explorer):
    """Stays in contact as much as it can.

    It goes to what it knows least through the air. There it slides about: it walks at random, bent
    along the skin, so that it meets the same sensations in other postures. From how the last steps
    changed what it felt, it learns which way is into the skin and which way is out. Before it knows
    anything it moves at random, and slides about from any touch.

    Attributes:
        dwell: steps for which it slides about at each place.
    """

    dwell: int = 750

    def __post_init__(self) -> None:
        super().__post_init__()
        # How fast the felt force grows along each joint, N per stride.
        self._slope = np.zeros(len(self.q))
        self._wanted = 0.0
        if self.agent is not None:
            representation = self.agent.representation
            self._wanted = float(np.median(representation.kernel_strength))
            self._visits = np.diff(representation.kernel_offsets).astype(float)

    def moves(self) -> Moves:
        """Explores without end."""
        yield from self._go(self.q[None])  # asks what is felt before the first move
        while True:
            if self.agent is None or self.rng.random() < _AIR:
                yield from self._wander()
            else:
                known = self.agent.representation
                goal = self._goal(known)
                rows = known.members(goal)
                row = self.rng.integers(rows.start, rows.stop)
                self._visits[goal] += 1.0
                self._slope[:] = 0.0
                yield from self._straight(known.kernel_q[row].astype(float))
            if self.felt.any():
                yield from self._roam()

    def _wander(self) -> Moves:
        """Walks at random until it meets another touch, and goes back to that touch."""
        # Near the last touch the walk would meet the same place again.
        yield from self._go(self._random_walk(round(_AWAY / self.pace)))
        self._slope[:] = 0.0
        left = self.touch
        while self.touch is left:
            yield from self._go(self._random_walk(1))
        yield from self._straight(self.touch)

    def _straight(self, q: np.ndarray) -> Moves:
        """Goes through the air, a pace at a time."""
        strides = (q - self.q) / self.stride
        count = max(int(np.ceil(np.sqrt(np.mean(strides**2)) / self.pace)), 1)
        share = np.linspace(0.0, 1.0, count + 1)[1:, None]
        yield from self._go(self.q + share * (q - self.q))

    def _goal(self, known: QuotientRepresentation) -> int:
        """A kernel that was seldom visited, or an end of a poor link."""
        if self.rng.random() < _LINKS and len(known.edges):
            # The ends of a poor link have no postures near each other; there are better ones in
            # between.
            worst = np.argsort(-known.edge_cost, kind="stable")[: max(len(known.edges) // 10, 1)]
            return int(self.rng.choice(known.edges[self.rng.choice(worst)]))
        need = 1.0 / (1.0 + self._visits) ** 2
        return int(self.rng.choice(len(need), p=need / need.sum()))

    def _roam(self) -> Moves:
        """Slides about: walks at random, bent along the skin."""
        lost = returns = 0
        for _ in range(self.dwell):
            yield from self._go(self._turned_round(self.q + self._in_touch(self._heading()))[None])
            if self.felt.any():
                lost = returns = 0
                continue
            lost += 1
            if lost == _MOST_LOST:
                lost, returns = 0, returns + 1
                yield from self._straight(self.touch)
                if returns == _MOST_RETURNS and not self.felt.any():
                    return
                # This direction left the skin; take another one.
                self._walk = self.rng.standard_normal(len(self.q))

    def _in_touch(self, step: np.ndarray) -> np.ndarray:
        """`(J,)` the step, bent along the skin so that the agent feels as much as usual."""
        steepness = float(np.linalg.norm(self._slope))
        if not steepness > 0.0:
            return step
        stride, up = self.stride, self._slope / steepness
        along = step / stride
        along = along - up * (up @ along)
        short = (self._wanted - float(np.linalg.norm(self.felt))) / steepness
        most = _PRESSED * self.pace
        return (along + up * np.clip(short, -most, most)) * stride

    def _arrive(self, q: np.ndarray, felt: np.ndarray) -> None:
        """Learns from each step which way is into the skin, too (Broyden's update)."""
        here, before = self.q, float(np.linalg.norm(self.felt))
        strength = np.linalg.norm(felt, axis=1)
        for there, after in zip(q.astype(float), strength, strict=True):
            step = (there - here) / self.stride
            size = float(step @ step)
            # In a smaller step, noise would change what is felt more than the skin does.
            if size < (0.5 * self.pace) ** 2 and after > 0.0:
                continue
            if size > 0.0 and (before > 0.0 or after > 0.0):
                self._slope += (after - before - self._slope @ step) / size * step
            here, before = there, after
        super()._arrive(q, felt)
        if self.agent is None and strength.any():
            self._wanted = max(self._wanted, 0.5 * float(strength.max()))


@dataclass(eq=False)
class ModelExplorer(Explorer):
    """Makes the touches that teach most, as far as the chain of its body says; none costs time.

    Before it knows one it walks at random. On a body of several parts, of which one chain does not
    tell, some receptors are hard to reach: there it looks about touches of receptors that seldom
    felt anything, too, as the way to others leads there.

    Attributes:
        chain: what it knows of its joints; None if nothing.
    """

    chain: KnownChain | None = None

    def moves(self) -> Moves:
        """Explores without end."""
        if self.chain is None:
            yield from self._without_chain()
            return
        planned = np.zeros((0, 3))
        while True:
            wanted = next_touches(
                self.chain, _BATCH, self.rng, lower=self.lower, upper=self.upper, planned=planned
            )
            planned = np.concatenate([planned, wanted.place])
            for row in self._tour(wanted.q):
                yield from self._touch(self.chain, wanted.some(row))

    def _without_chain(self) -> Moves:
        agent = self.agent
        parts = 1 if agent is None else agent.representation.num_parts
        seldom_felt = None if agent is None or parts < 2 else self._seldom_felt(agent)
        while True:
            before = self.touch
            while self.touch is before:
                yield from self._go(self._random_walk(_AT_ONCE))
            if seldom_felt is not None:
                here = self.q
                yield from self._look_about(next(seldom_felt), max(_SELDOM // parts, 1))
                yield from self._go(here[None])

    def _seldom_felt(self, agent: Agent) -> Iterator[np.ndarray]:
        """Yields `(J,)` remembered touches of receptors that seldom felt anything."""
        felt = csc_array(agent.kernel_sensation)
        often = np.diff(felt.indptr).astype(float)
        need = np.divide(1.0, np.square(often), out=np.zeros_like(often), where=often > 0)
        while True:
            receptor = self.rng.choice(len(need), p=need / need.sum())
            row = self.rng.choice(felt.indices[slice(*felt.indptr[receptor : receptor + 2])])
            yield agent.representation.kernel_q[row].astype(float)

    def _look_about(self, q: np.ndarray, num_touches: int) -> Moves:
        """Tries postures about `q` until `num_touches` of them touched."""
        for _ in range(_TRIES * num_touches):
            tried = q + _ABOUT * self.rng.standard_normal(len(q)) * self.stride
            yield from self._go(tried.clip(self.lower, self.upper)[None])
            if self.felt.any():
                num_touches -= 1
            if not num_touches:
                return

    def _tour(self, q: np.ndarray) -> Iterator[np.ndarray]:
        """Yields the numbers of `(n, J)` postures, the nearest one first."""
        left, here = np.arange(len(q)), self.q
        while len(left):
            away = np.linalg.norm((q[left] - here) / self.stride, axis=1)
            nearest = int(away.argmin())
            here = q[left[nearest]]
            yield left[[nearest]]
            left = np.delete(left, nearest)

    def _touch(self, chain: KnownChain, wanted: Reachable) -> Moves:
        """Goes there and, if nothing is felt, on beneath the skin until something is."""
        q = wanted.q
        for share in np.linspace(0.0, 1.0, _INWARDS + 1):
            if share > 0:
                place = wanted.place + share * (wanted.inner - wanted.place)
                q = chain.put(q, place, self.lower, self.upper)
            yield from self._go(q)
            if self.felt.any():
                return


@dataclass(eq=False)
class PostureHolder(Explorer):
    """Goes to postures drawn at random, most joints at their limits, where parts of a body meet.

    A body that needs time to go there and to press is given it.

    Attributes:
        timed: whether it does.
    """

    timed: bool = True

    def moves(self) -> Moves:
        """Explores without end."""
        while True:
            share = self.rng.uniform(-_BEYOND, 1.0 + _BEYOND, len(self.q)).clip(0.0, 1.0)
            posture = self.lower + share * (self.upper - self.lower)
            yield from self._go(posture[None])
            if self.timed:
                yield from self._go(np.tile(posture, (_HELD, 1)))
