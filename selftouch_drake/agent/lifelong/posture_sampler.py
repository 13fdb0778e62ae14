"""Exploration where only touches count: steps that touch nothing cost nothing (naive).

Places that are met at random lie far apart in motor space. The agent then knows two neighbours on
the skin in very different postures, and takes them for farther apart than they are. So it looks
about each place that it meets. What it knows still has gaps: two kernels are linked, but their
nearest postures are far apart, and a plan that leaps from one to the other may leave the skin on
the way. So the agent also looks between the postures of linked kernels. On a body of several parts,
some receptors are hard to reach: it looks about touches of receptors that seldom felt anything, as
the way to others leads there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csc_array
from scipy.spatial.distance import cdist

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.lifelong.explorer import Explorer, Moves
from selftouch_drake.agent.planning.route import firm_members
from selftouch_drake.agent.representation.quotient import NO_MODE, QuotientRepresentation

#: Touches about each place that is met at random, and length of a small move there, strides in each
#: joint. 8 to 40 touches at 0.2 rad make good shapes of torus and cube, from 5000 touches and from
#: 20,000; 4 touches make worse shapes, and so do moves of 0.3 and 0.4 rad.
_TOUCHES, _ABOUT = 20, 1.33

#: Touches in each gap, strides of a small move there, and gaps for each place; so half of all
#: touches lie in gaps. On two tori with 20,000 touches, planned paths are in contact for 98.7 and
#: 98.6 % of the time without gaps, for 99.3 and 99.0 % with them. With one touch in each gap the
#: shape is worse, as the nearest postures are then nearer by design.
_IN_GAP, _BETWEEN, _GAPS = 4, 0.67, 5

#: Small moves per wanted touch after which the agent gives up.
_TRIES = 12

#: Random postures that are tried in one move.
_AT_ONCE = 5


class PostureSampler(Explorer):
    """Tries postures anywhere, without a way from one to the next; arguments as for `Explorer`."""

    def moves(self) -> Moves:
        """Explores without end."""
        agent = self._agent
        # The more parts a body has, the more places the agent may not have met.
        parts = 1 if agent is None else max(agent.representation.num_parts, 1)
        about = max(_TOUCHES // parts, 2) - 1
        seldom_felt = self._seldom_felt(agent) if agent is not None and parts > 1 else None
        while True:
            yield from self._meet()
            yield from self._look_about(self._touch, _ABOUT, about)
            if seldom_felt is not None:
                yield from self._look_about(next(seldom_felt), _ABOUT, about)
            if agent is not None and len(agent.representation.edges):
                for _ in range(_GAPS // parts):
                    yield from self._look_between(agent)

    def _meet(self) -> Moves:
        """Tries postures at random until one touches."""
        before = self._touch
        shape = _AT_ONCE, len(self._q)
        while self._touch is before:
            yield from self._go(self._rng.uniform(self._joints.lower, self._joints.upper, shape))

    def _seldom_felt(self, agent: Agent) -> Iterator[np.ndarray]:
        """Yields `(J,)` remembered touches of receptors that seldom felt anything."""
        felt = csc_array(agent.kernel_sensation)
        often = np.diff(felt.indptr).astype(float)
        need = np.divide(1.0, np.square(often), out=np.zeros_like(often), where=often > 0)
        while True:
            receptor = self._rng.choice(len(need), p=need / need.sum())
            row = self._rng.choice(felt.indices[slice(*felt.indptr[receptor : receptor + 2])])
            yield agent.representation.kernel_q[row].astype(float)

    def _look_about(self, q: np.ndarray, strides: float, num_touches: int) -> Moves:
        """Tries postures about `q` until `num_touches` of them touched."""
        for _ in range(_TRIES * num_touches):
            noise = self._rng.standard_normal(len(q))
            yield from self._go(self._within(q + strides * noise * self._joints.stride)[None])
            num_touches -= bool(self._felt.any())
            if not num_touches:
                return

    def _look_between(self, agent: Agent) -> Moves:
        """Tries postures between a touch of one end of a link and firm touches of the other."""
        known = agent.representation
        row, head = self._gap(known)
        mode = int(known.kernel_mode[row])
        if mode == NO_MODE:
            return
        ahead = firm_members(known, head, mode)
        if not len(ahead):
            return
        start = known.kernel_q[row].astype(float)
        matters = known.mode_joints[mode]
        near = cdist(
            known.scaled(start)[None, matters], known.scaled(known.kernel_q[ahead])[:, matters]
        )
        end = known.kernel_q[ahead[near.argmin()]]
        between = np.where(matters, (start + end) / 2, start)
        yield from self._look_about(between, _BETWEEN, _IN_GAP)

    def _gap(self, known: QuotientRepresentation) -> tuple[int, int]:
        """The row of a touch of one end of a link, and the kernel at the other end."""
        tail, head = self._rng.permutation(self._rng.choice(known.edges)).tolist()
        mode = int(self._rng.choice(known.kernel_mode[known.members(tail)]))
        return int(self._rng.choice(firm_members(known, tail, mode))), head
