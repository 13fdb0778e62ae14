"""Several limbs from few touches, though nobody says which of them touched.

In a neighbourhood of sensations the joints of the limb that touched hold each other, and those of
the others do not: densities tell the limbs apart, roughly, and make some touches nearly sure. A
chain that explains most of these by what they feel like shows which touches are not its own, and
which others are. What is left over is that of the next limb.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.density import limbs, telling_cores, who_touched
from selftouch_drake.agent.body_model.fit import Bodies, Group, Smooth
from selftouch_drake.agent.body_model.forest import Mechanism
from selftouch_drake.agent.body_model.one_limb import Limb, joined, largest_first
from selftouch_drake.agent.body_model.smoothness import Sensed, SmoothChain, finished
from selftouch_drake.agent.body_model.structure import (
    Search,
    pair_statistic,
    pruned,
)

#: With more touches kernels are as good. Two arms were found from 3,000 and from 10,000.
MOST = 12_000
# Touches of a part that are looked at, in neighbourhoods of so many, of which some are needed.
# With 60 each three joints of a limb tell 93 to 98 % of the surest touches of two arms right, with
# 90 97 to 99, and with 120 often too few neighbourhoods are left.
_LOOKED_AT, _NEIGHBOURHOOD, _FEWEST_NEIGHBOURHOODS = 4000, 90, 12
# Joints that tell a limb, and the probability above which a touch is nearly surely its own.
_TELLING, _NEARLY_SURE = 3, 0.99
# A touch is a chain's own if it is not farther from where its sensation says than so many times the
# median of touches that are, in standard deviations of the process.
_OWN = 3.0
# Share of near touches, left out in turn, from which a chain is grown; the whole body is judged.
_AGREED = 0.5
# Touches by which chains are searched, and fitted while they find their own touches; rounds of
# that, and steps of each.
_SEARCHED, _FITTED, _ROUNDS, _STEPS = 256, 500, 3, 40


# Matrices of few touches are small: threads that share in one wait for each other.
@threadpool_limits.wrap(limits=1, user_api="blas")
def of_several_limbs(
    search: Search, q: np.ndarray, sensation: csr_array, part: np.ndarray, used: np.ndarray
) -> Mechanism | None:
    """One body of the chains of limbs that touched one part; None if fewer than two are found.

    Args:
        search: what to work on.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        part: `(n,)` part that each touch is on.
        used: `(n,)` bool, touches that may be looked at.
    """
    shared = largest_first(sensation, part)[0]
    rows = np.flatnonzero(used & (part == shared))
    rows = np.sort(search.random.permutation(rows)[:_LOOKED_AT])
    own = replace(search, q=np.ascontiguousarray(search.q[:, rows]), sensation=sensation[rows])
    found = _Touches(own, q[rows], sensation[rows], Sensed.of(sensation[rows])).chains()
    if len(found) < 2:
        return None
    limbs = [replace(limb, rows=rows[limb.rows]) for limb in found]
    return joined(q, sensation, shared, limbs)


def neighbourhoods_of_parts(
    sensation: csr_array, part: np.ndarray, each: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Labels for few touches: those of a part that feel alike.

    Args:
        sensation: `(n, S)` readings of the receptors.
        part: `(n,)` part that each touch is on.
        each: touches of a label, in the mean.
        random: where clusters begin.

    Returns:
        `(n,)` label of each touch, and `(K,)` part of each label.
    """
    label, part_of = np.zeros(len(part), dtype=int), list[int]()
    for number in np.unique(part):
        rows = np.flatnonzero(part == number)
        sensed = Sensed.of(sensation[rows])
        own = sensed.neighbourhoods(max(len(rows) // each, 1), random)
        label[rows] = len(part_of) + own
        part_of += [int(number)] * (int(own.max()) + 1)
    return label, np.array(part_of)


@dataclass(frozen=True, slots=True, eq=False)
class _Touches:
    """Touches of one part.

    Attributes:
        search: what to work on: these touches alone.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        sensed: the same, as the process compares them.
    """

    search: Search
    q: np.ndarray
    sensation: csr_array
    sensed: Sensed

    def chains(self) -> list[Limb]:
        """The limbs that were found, each with its chain and touches."""
        share, cores = self._limbs()
        most_sure_first = np.argsort(-(share > _NEARLY_SURE).sum(axis=0), kind="stable").tolist()
        found = dict[int, Limb]()
        # Once more, for those that failed before another one was found.
        for turn in range(2):
            if turn and not found:
                break
            for limb in most_sure_first:
                if limb not in found:
                    chain = self._chain(*self._of_limb(limb, share[:, limb], cores, found))
                    if chain is not None:
                        found[limb] = chain
        return list(found.values())

    def _of_limb(
        self, limb: int, share: np.ndarray, cores: list[list[int]], found: dict[int, Limb]
    ) -> tuple[np.ndarray, list[int]]:
        """Touches most of which a limb made, and joints that may be its own."""
        free, joints = np.ones(len(self.q), dtype=bool), set(range(self.q.shape[1]))
        for other in set(range(len(cores))) - {limb}:
            joints -= set(found[other].order if other in found else cores[other])
            if other in found:
                free[found[other].rows] = False
        # Where all others are known, what is left over is this one's.
        likely = free if len(found) == len(cores) - 1 else free & (share > _NEARLY_SURE)
        return np.flatnonzero(likely), [j for j in sorted(joints) if np.ptp(self.q[:, j]) > 0]

    def _limbs(self) -> tuple[np.ndarray, list[list[int]]]:
        """`(n, U)` probability that each limb made each touch, and joints that tell the limbs."""
        none: tuple[np.ndarray, list[list[int]]] = np.zeros((len(self.q), 0)), []
        number = len(self.q) // _NEIGHBOURHOOD
        if number < _FEWEST_NEIGHBOURHOODS:
            return none
        labels = self.sensed.neighbourhoods(number, self.search.random)
        group = Group.of(np.arange(len(self.q)), labels)
        cores = limbs(*pair_statistic(self.search.q, group, least=20))
        if len(cores) < 2:
            return none
        cores = telling_cores(self.search.q, group, [core[:_TELLING] for core in cores])
        if len(cores) < 2:
            return none
        share = np.empty((len(self.q), len(cores)))
        share[group.rows] = who_touched(self.search.q, group, cores)
        return share, cores

    def _chain(self, rows: np.ndarray, joints: Sequence[int]) -> Limb | None:
        """The first chain with which its own touches agree; most of the rows are of one limb."""
        if len(rows) < few.needed_for(len(joints))[1]:
            return None
        some = self._some(rows, _SEARCHED)
        smooth = self.sensed.some(some).precision(few.SEARCHED_NOISE)
        for body in few.found_chains(self.search, some, smooth, list(joints)):
            own = self._own(rows, body)
            if len(own) < few.FEWEST:
                continue
            some = self._some(own, _SEARCHED)
            group = Smooth(some, self.sensed.some(some).precision(few.SEARCHED_NOISE))
            limb = self._judged(own, pruned(self.search, group, body))
            if limb is not None:
                return limb
        return None

    def _judged(self, own: np.ndarray, body: Bodies) -> Limb | None:
        """A chain fitted to its own touches, if those left out agree; None if not."""
        some = self._some(own, _FITTED)
        order, chain = few.rough_chain(body)
        q, sensed = self.q[some][:, order], self.sensed.some(some)
        chain = finished(q, sensed.precision(), chain)
        labels = few.neighbourhoods(sensed, self.search.random)
        verdict = few.left_out_in_turn(q, sensed, labels, chain)
        if not verdict.near * min(1.0, 2 * verdict.inliers) > _AGREED:
            return None
        return Limb(order, chain, own)

    def _own(self, rows: np.ndarray, body: Bodies) -> np.ndarray:
        """The touches of a chain, which made most of the rows."""
        order, chain = few.rough_chain(body)
        among = np.zeros(len(self.q), dtype=bool)
        among[rows] = True
        for turn in range(_ROUNDS):
            own = self._agree(self._some(rows, _FITTED), order, chain)
            # A chain that others bend may explain few: the first round drops, later ones find.
            rows = np.flatnonzero(own & among if turn == 0 else own)
            if len(rows) < few.FEWEST:
                break
            some = self._some(rows, _FITTED)
            precision = self.sensed.some(some).precision()
            chain = finished(self.q[some][:, order], precision, chain, _STEPS)
        return rows

    def _agree(self, some: np.ndarray, order: list[int], chain: SmoothChain) -> np.ndarray:
        """`(n,)` bool, touches where a chain leads to where their sensations say.

        Some touches say where sensations are; each of these is compared with all others of them.
        """
        place = places(self.q[:, order], chain.twists, chain.point)
        known = self.sensed.some(some)
        away = place - known.predicted(place[some], self.sensed)
        variance = known.unsure(self.sensed)
        precision = known.precision()
        # Of a Gaussian process left out in turn (Rasmussen and Williams 2006, equation 5.12).
        variance[some] = 1 / np.diag(precision)
        away[some] = (precision @ place[some]) * variance[some, None]
        distance = np.linalg.norm(away, axis=1) / np.sqrt(variance)
        return distance < _OWN * np.median(distance[some])

    def _some(self, rows: np.ndarray, most: int) -> np.ndarray:
        return np.sort(self.search.random.permutation(rows)[:most])
