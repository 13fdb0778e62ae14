"""What changed in a body, and what becomes of touches from before the change (naive)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.lifelong.expectation import Expectation, TouchSet, with_unit_norm
from selftouch_drake.agent.network import Network

#: A receptor counts as felt if its reading is at least this share of a sensation; felt in this many
#: touches, it is no chance.
FELT, SURELY = 0.1, 20

#: A touch from before the change is forgotten if new receptors make up more than this share of it.
_GUESSED = 0.98

#: Number of touches since the change from which a guess is made. On a torus on which a patch of 10
#: of 100 receptors was blind, means of 3, 5 and 8 touches are about as good; one is worse.
_ALIKE = 3

#: Share of the touches from before the change, the lightest, that are forgotten if they were moved
#: by a displacement: it is not exact, and a small error leads a light touch off the skin. If half
#: are forgotten, the shape is worse (3.1 %, not 2.9 %, on a torus whose skin slipped).
_LIGHTEST = 0.25

#: Least surprise that counts in a geometric mean.
_LEAST = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class NewReceptors:
    """What new receptors feel in a touch: what they felt in touches that the others felt alike.

    The others feel a little even in the middle of a patch that was blind. On a torus, 1000 touches
    after it began to feel, a guess of half to seven tenths of a touch is off by a cosine distance
    of 0.04 (mean), one of more than nine tenths by 0.07.

    Attributes:
        silent_before: `(S,)` bool, receptors that felt nothing before the change.
        receptors: `(S,)` bool, those of them that are new.
        felt: `(n, S)` touches since the change, of unit L2 norm.
        by_others: k-d tree of what all other receptors felt in them, likewise of unit norm.
    """

    silent_before: np.ndarray
    receptors: np.ndarray
    felt: np.ndarray
    by_others: cKDTree

    @classmethod
    def learned(cls, silent_before: np.ndarray, felt: np.ndarray) -> NewReceptors:
        """Learns from touches since the change, `(n, S)` of unit L2 norm.

        If one receptor surely began to feel, all did that felt anything.
        """
        began = silent_before & ((felt > FELT).sum(axis=0) >= SURELY)
        new = silent_before & felt.any(axis=0) & began.any()
        others = np.where(silent_before, 0.0, felt)
        some = others.any(axis=1) & new.any()
        return cls(silent_before, new, felt[some], cKDTree(with_unit_norm(others[some])))

    def filled_in(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, S)` N, sensations with what the new receptors would feel beside the others.

        It is a mean of the most similar touches, weighted by similarity; 0 if none is similar.
        """
        if self.by_others.n < _ALIKE:
            return sensation
        others = np.where(self.silent_before, 0.0, sensation)
        distance, row = self.by_others.query(with_unit_norm(others), _ALIKE)
        # Unit vectors that have nothing in common are a distance of the root of 2 apart.
        weight = np.maximum(1.0 / np.maximum(distance, 1e-6) ** 2 - 0.5, 0.0)
        alike = np.einsum("nk,nks->ns", weight, self.felt[row])
        by_others = np.linalg.norm(alike[:, ~self.silent_before], axis=1)
        strength = np.linalg.norm(others, axis=1)
        times = np.divide(strength, by_others, out=np.zeros_like(strength), where=by_others > 0)
        return np.where(self.receptors, alike * times[:, None], sensation)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyChange:
    """What changed in the body: readings of receptors, and what readings of joints mean.

    Attributes:
        expectation: what was expected before the change.
        source: `(S,)` number of the old receptor that each reading now comes from.
        silent: `(S,)` bool, receptors that no longer feel.
        new: receptors that never felt before, and what they would have felt.
        offset: `(J,)` difference between where each joint is and what it reads.
        displacement: networks from standardised configurations to a further difference, in standard
            deviations; their mean counts. There are none if the offset explains all.
        through: expectations, from blunt to sharp, through which the displacement was learned; none
            before it is.
        reach: `(2, J)` least and greatest reading of each joint, before and after the change.
        surprise: geometric mean of the surprise of touches since the change, without and with this
            explanation.
    """

    expectation: Expectation
    source: np.ndarray
    silent: np.ndarray
    new: NewReceptors
    offset: np.ndarray
    displacement: tuple[Network, ...] = ()
    through: tuple[Expectation, ...] = ()
    reach: np.ndarray
    surprise: tuple[float, float] = (0.0, 0.0)

    def expected(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected now at `q` `(n, J)`."""
        return self._readings(self.expectation(self._as_before(q)))

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
        felt = self._readings(touches.sensation)
        # If only a faint receptor at the rim of a touch remains, it says little of its place.
        strength = np.linalg.norm(felt, axis=1)
        holds = strength > 2 * FELT * np.linalg.norm(touches.sensation, axis=1)
        guessed = np.linalg.norm(felt[:, self.new.receptors], axis=1)
        holds &= guessed <= _GUESSED * strength
        if self.displacement and holds.any():
            holds &= strength >= np.quantile(strength[holds], _LIGHTEST)
        now = TouchSet(self._as_now(touches.q[holds]), felt[holds])
        if not self.displacement:
            return now
        lower, upper = self.reach
        return now[np.all((now.q >= lower) & (now.q <= upper), axis=1)]

    @property
    def is_a_guess(self) -> bool:
        """Whether more touches of the changed body would make this more exact."""
        return bool(self.displacement) or bool(self.new.receptors.any())

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
        # A displacement says more than numbers that were not enough.
        if self.displacement:
            found.append("all joints act as if they were a little elsewhere")
        else:
            found += [
                f"joint {joint} is {self.offset[joint]:+.4f} from what it reads"
                for joint in np.flatnonzero(self.offset)
            ]
        return "; ".join(found) or "nothing that explains it"

    def _readings(self, sensation: np.ndarray) -> np.ndarray:
        felt = self.new.filled_in(sensation[:, self.source])
        return np.where(self.silent, 0.0, felt).astype(np.float32)

    def _as_before(self, q: np.ndarray) -> np.ndarray:
        moved = q + self.offset
        if not self.displacement:
            return moved
        x = self.expectation.standardised(q)
        displaced = np.mean([network(x) for network in self.displacement], axis=0)
        return moved + displaced * self.expectation.scale

    def _as_now(self, q: np.ndarray) -> np.ndarray:
        """Solves `_as_before(now) = q`; its steps shrink, as the displacement is smooth."""
        now = q - self.offset
        for _ in range(8 if self.displacement else 0):
            now = now + q - self._as_before(now)
        return now.astype(np.float32)
