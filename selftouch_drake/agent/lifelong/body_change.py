"""A change of the body, as the agent describes it: what its readings mean since then (naive)."""

import math
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.chain_change import ChainChange
from selftouch_drake.agent.lifelong.expectation import Expectation, LearnedExpectation, TouchSet
from selftouch_drake.agent.lifelong.new_receptors import FELT, NewReceptors
from selftouch_drake.agent.network import Network

#: A touch from before the change is forgotten if new receptors make up more than this share of it.
_GUESSED = 0.98

#: Share of the touches from before the change, the lightest, that are forgotten if they were moved
#: by a displacement: it is not exact, and a small error leads a light touch off the skin. If half
#: are forgotten, the shape is worse (3.1 %, not 2.9 %, on a torus whose skin slipped).
_LIGHTEST = 0.25

#: Least surprise that counts in a geometric mean.
_LEAST = 0.001

#: Steps in which a displacement is undone: they shrink, because it is smooth.
_UNDOING_STEPS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyChange:
    """What changed in the body: readings of receptors, and what readings of joints mean.

    Attributes:
        expectation: what was expected before the change.
        source: `(S,)` number of the old receptor that each reading now comes from.
        silent: `(S,)` bool, receptors that no longer feel.
        new: receptors that never felt before, and what they would have felt.
        chain: what changed of the chain of joints, if the agent knows one and something did.
        offset: `(J,)` difference between where each joint is and what it reads, if it knows none.
        displacement: networks from standardised configurations to a further difference, in standard
            deviations; their mean counts. There are none if the offset explains all.
        through: expectations, from blunt to sharp, through which the displacement was learned; none
            before it is.
        reach: `(2, J)` least and greatest reading of each joint, before and after the change.
        left: surprise that it leaves, relative to what is usual.
    """

    expectation: Expectation
    source: np.ndarray
    silent: np.ndarray
    new: NewReceptors
    offset: np.ndarray
    chain: ChainChange | None = None
    displacement: tuple[Network, ...] = ()
    through: tuple[LearnedExpectation, ...] = ()
    reach: np.ndarray
    left: float = math.inf

    def expected(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected now at `q` `(n, J)`."""
        return self.readings(self.expectation(self._as_before(q)))

    def surprise_left(self, touches: TouchSet) -> float:
        """Geometric mean of the surprise of touches, if this is what changed.

        Novel touches surprise much in any body; in an arithmetic mean they would hide that all
        others surprise far more than before.
        """
        surprise = self.expectation.surprise(self.expected(touches.q), touches.sensation)
        return float(np.exp(np.log(np.maximum(surprise, _LEAST)).mean()))

    def adapted(self, touches: TouchSet) -> TouchSet:
        """Makes touches from before the change into touches of the changed body.

        Those in which nothing would be felt now are forgotten. If there is a displacement, the
        lightest are forgotten too, and those at readings that no joint had.
        """
        felt = self.readings(touches.sensation)
        # If only a faint receptor at the rim of a touch remains, it says little of its place.
        strength = np.linalg.norm(felt, axis=1)
        holds = strength > 2 * FELT * np.linalg.norm(touches.sensation, axis=1)
        guessed = np.linalg.norm(felt[:, self.new.receptors], axis=1)
        holds &= guessed <= _GUESSED * strength
        if self.displacement and holds.any():
            holds &= strength >= np.quantile(strength[holds], _LIGHTEST)
        q = touches.q[holds]
        if self.chain is not None:
            now, reached = self.chain.moved(q, *self.reach)
            return TouchSet(now[reached].astype(np.float32), felt[holds][reached])
        now = q - self.offset
        if not self.displacement:
            return TouchSet(now.astype(np.float32), felt[holds])
        # Approaches the reading at which `_as_before` gives q.
        for _ in range(_UNDOING_STEPS):
            now = now + q - self._as_before(now)
        moved = TouchSet(now.astype(np.float32), felt[holds])
        return moved[np.all((moved.q >= self.reach[0]) & (moved.q <= self.reach[1]), axis=1)]

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        swapped = np.flatnonzero(self.source != np.arange(len(self.source)))
        found = [
            f"{num} receptor{' is' if num == 1 else 's are'} {what}"
            for num, what in ((self.silent.sum(), "silent"), (self.new.receptors.sum(), "new"))
            if num
        ]
        if len(swapped):
            found.append(f"{len(swapped)} receptors changed places")
        if self.chain is not None:
            found.append(self.chain.in_words)
        # A displacement says more than numbers that were not enough.
        if self.displacement:
            found.append("all joints act as if they were a little elsewhere")
        else:
            found += [
                f"joint {joint} is {self.offset[joint]:+.4f} from what it reads"
                for joint in np.flatnonzero(self.offset)
            ]
        return "; ".join(found) or "nothing that explains it"

    def readings(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is read since the change where the old body would have felt this."""
        felt = self.new.filled_in(sensation[:, self.source])
        return np.where(self.silent, 0.0, felt).astype(np.float32)

    def _as_before(self, q: np.ndarray) -> np.ndarray:
        """`(n, J)` readings of the old body where the changed one reads `q` `(n, J)`."""
        if self.chain is not None:
            return self.chain.as_before(q, *self.reach)
        moved = q + self.offset
        if not self.displacement:
            return moved
        x = self.expectation.standardised(q)
        displaced = np.mean([network(x) for network in self.displacement], axis=0)
        return moved + displaced * self.expectation.scale
