"""Several limbs from few touches, though nobody says which of them touched.

In a neighbourhood of sensations the joints of the limb that touched hold each other, and those of
the others do not: densities tell the limbs apart, roughly, and make some touches nearly sure. A
chain that explains most of these by what they feel like shows which touches are not its own, and
which others are. What is left over is that of the next limb.
"""

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.density import limbs, telling_cores, who_touched
from selftouch_drake.agent.body_model.fit import Bodies, Group, Smooth
from selftouch_drake.agent.body_model.forest import Mechanism
from selftouch_drake.agent.body_model.one_limb import Limb, joined
from selftouch_drake.agent.body_model.smooth_tree import (
    UNTOLD,
    WELL_MADE,
    Touched,
    with_parts,
)
from selftouch_drake.agent.body_model.smoothness import Sensed, SmoothChain, finished
from selftouch_drake.agent.body_model.structure import (
    Search,
    joints_that_hold,
    pair_statistic,
    pruned,
)

#: With more touches kernels are as good. Two arms were found from 3,000 and from 10,000.
MOST = 12_000
# Touches of a part that are looked at, in neighbourhoods of so many, or of fewer if there are too
# few of them. With 60 each three joints of a limb tell 93 to 98 % of the surest touches of two arms
# right, with 90 97 to 99, and with 120 often too few neighbourhoods are left.
_LOOKED_AT, _NEIGHBOURHOOD, _SMALLER, _FEWEST_NEIGHBOURHOODS = 4000, 90, 60, 12
# Clusterings that are tried until so many touches are surely of one limb: joints that tell the
# limbs are found in most of them. Of an infant's torso 88 to 94 % are sure then, of a body between
# two arms, from 3,000 touches, 39 % and more, and of a forearm, which one hand alone touches, at
# most a tenth: limbs are not looked for where fewer are.
_CLUSTERINGS, _WELL_TOLD, _HARDLY_TOLD = 8, 0.8, 0.15
# Joints that tell a limb, and the probability above which a touch is nearly surely its own.
_TELLING, _NEARLY_SURE = 3, 0.99
# Joints of a known limb that tell its touches on another part, and the share of them that are
# nearly sure if several hands touched it.
_CORE, _TOLD = 4, 0.4
# A touch is a chain's own if it is not farther from where its sensation says than so many times the
# median of touches that are, in standard deviations of the process.
_OWN = 3.0
# Share of near touches, left out in turn, from which a chain is taken at once, and at all: where
# neighbours are in a wrong order, other parts tell. The whole body is judged.
_AGREED, _HOPE = 0.5, 0.25
# So often limbs are looked for, unless the tree is well made.
_TRIES = 3
# Touches by which chains are searched, and fitted while they find their own touches; rounds of
# that, and steps of each.
_SEARCHED, _FITTED, _ROUNDS, _STEPS = 256, 500, 3, 40


# Matrices of few touches are small: threads that share in one wait for each other.
@threadpool_limits.wrap(limits=1, user_api="blas")
def of_several_limbs(
    search: Search, q: np.ndarray, sensation: csr_array, part: np.ndarray, used: np.ndarray
) -> Mechanism | None:
    """One body of the chains of limbs that touched one part; None if fewer than two are found.

    Parts on which most touches are surely of one limb come first: behind joints that move the skin
    itself, as a head's, limbs are hardly told apart.

    Args:
        search: what to work on.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        part: `(n,)` part that each touch is on.
        used: `(n,)` bool, touches that may be looked at.
    """
    rows_of = {
        int(number): search.random.permutation(np.flatnonzero(used & (part == number)))
        for number in np.unique(part)
    }
    mixed = [
        (number, touches)
        for number, rows in rows_of.items()
        if (touches := _Touches.of(search, q, sensation, rows)) is not None
    ]
    mixed.sort(key=lambda one: -one[1].surely_told())
    able = {number for number, rows in rows_of.items() if len(rows) >= few.FEWEST}
    for number, touches in mixed:
        if touches.surely_told() < _HARDLY_TOLD:
            break
        tried = [_Tried(len(able), np.inf, None)]
        for _ in range(_TRIES):
            found = [replace(limb, rows=touches.rows[limb.rows]) for limb in touches.chains()]
            if len(found) < 2:
                continue
            orders = [limb.order for limb in found]
            others = {
                other: by_hand(search, sensation, rows, orders)
                for other, rows in rows_of.items()
                if other != number
            }
            body = joined(q, sensation, number, found)
            own = [limb.rows for limb in found]
            loss, body = with_parts(search, sensation, others, body, own, _moving(q))
            tried.append(_Tried(len(able - set(body.links.part)), loss, body))
            if tried[-1].missing == 0 and loss < WELL_MADE:
                break
        best = min(tried, key=lambda one: (one.missing, one.loss))
        if best.body is not None:
            return best.body
    return None


class _Tried(NamedTuple):
    """A body, the number of parts that it lacks, and the criterion of its worst touches."""

    missing: int
    loss: float
    body: Mechanism | None


def _moving(q: np.ndarray) -> list[int]:
    return np.flatnonzero(np.ptp(q, axis=0) > 0).tolist()


def by_hand(
    search: Search, sensation: csr_array, rows: np.ndarray, orders: list[list[int]]
) -> Touched:
    """Touches of one part by the hands of limbs whose orders are known, if these can be told.

    Args:
        search: what to work on.
        sensation: `(n, S)` readings of the receptors.
        rows: touches of the part, in any order.
        orders: joints of each limb, those nearest to the part where limbs were found first.
    """
    untold = Touched({UNTOLD: rows})
    rows = rows[:_LOOKED_AT]
    number = _num_neighbourhoods(len(rows))
    if not number:
        return untold
    labels = Sensed.of(sensation[rows]).neighbourhoods(number, search.random)
    standard = np.ascontiguousarray(search.q[:, rows])
    group = Group.of(np.arange(len(rows)), labels)
    share = _shares(standard, group, [order[:_CORE] for order in orders])
    if _surely_told(share) < _TOLD:
        return untold
    limb = np.where(share.max(axis=1) > _NEARLY_SURE, share.argmax(axis=1), UNTOLD)
    known, holding = set(itertools.chain(*orders)), Counter[int]()
    for one in range(len(orders)):
        own = np.flatnonzero(limb == one)
        statistic, noise = pair_statistic(standard, Group.of(own, labels[own]), least=20)
        # Too few touches by a hand say nothing of joints.
        if np.isfinite(noise):
            holding.update(set(joints_that_hold(statistic, noise)) - known)
    return Touched(
        {one: rows[limb == one] for one in range(len(orders)) if (limb == one).any()},
        new=sorted(holding),
        alone=sorted(joint for joint, hands in holding.items() if hands > 1),
    )


def _num_neighbourhoods(touches: int) -> int:
    """Neighbourhoods of the touches of a part; 0 if these are too few."""
    numbers = (touches // each for each in (_NEIGHBOURHOOD, _SMALLER))
    return next((number for number in numbers if number >= _FEWEST_NEIGHBOURHOODS), 0)


def _shares(q: np.ndarray, group: Group, cores: list[list[int]]) -> np.ndarray:
    """`(n, U)` probability that each limb made each touch; 0 for touches of no neighbourhood."""
    share = np.zeros((q.shape[1], len(cores)))
    share[group.rows] = who_touched(q, group, cores)
    return share


def _surely_told(share: np.ndarray) -> float:
    return float((share > _NEARLY_SURE).any(axis=1).mean())


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
    """Touches of one part that several limbs made.

    Attributes:
        rows: `(n,)` of these touches among all.
        search: what to work on: these touches alone.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        sensed: the same, as the process compares them.
        share: `(n, U)` probability that each limb made each touch.
        cores: joints that tell the limbs.
    """

    rows: np.ndarray
    search: Search
    q: np.ndarray
    sensation: csr_array
    sensed: Sensed
    share: np.ndarray
    cores: list[list[int]]

    @staticmethod
    def of(
        search: Search, q: np.ndarray, sensation: csr_array, rows: np.ndarray
    ) -> "_Touches | None":
        """Some touches of a part, in any order; None if they do not show several limbs."""
        rows = np.sort(rows[:_LOOKED_AT])
        number = _num_neighbourhoods(len(rows))
        if not number:
            return None
        felt, sensed = sensation[rows], Sensed.of(sensation[rows])
        own = replace(search, q=np.ascontiguousarray(search.q[:, rows]), sensation=felt)
        best: tuple[float, np.ndarray, list[list[int]]] | None = None
        for _ in range(_CLUSTERINGS):
            group = Group.of(np.arange(len(rows)), sensed.neighbourhoods(number, search.random))
            cores = limbs(*pair_statistic(own.q, group, least=20))
            if len(cores) < 2:
                continue
            cores = telling_cores(own.q, group, [core[:_TELLING] for core in cores])
            if len(cores) < 2:
                continue
            share = _shares(own.q, group, cores)
            sure = _surely_told(share)
            if best is None or sure > best[0]:
                best = sure, share, cores
            if sure > _WELL_TOLD:
                break
        if best is None:
            return None
        return _Touches(rows, own, q[rows], felt, sensed, *best[1:])

    def surely_told(self) -> float:
        """Share of the touches that are nearly surely of one limb."""
        return _surely_told(self.share)

    def chains(self) -> list[Limb]:
        """The limbs that were found, each with its chain and touches."""
        most_sure_first = np.argsort(-(self.share > _NEARLY_SURE).sum(axis=0), kind="stable")
        found = dict[int, Limb]()
        # Once more, for those that failed before another one was found.
        for turn in range(2):
            if turn and not found:
                break
            for limb in most_sure_first.tolist():
                if limb not in found:
                    chain = self._chain(*self._of_limb(limb, found))
                    if chain is not None:
                        found[limb] = chain
        return list(found.values())

    def _of_limb(self, limb: int, found: dict[int, Limb]) -> tuple[np.ndarray, list[int]]:
        """Touches most of which a limb made, and joints that may be its own."""
        free, joints = np.ones(len(self.q), dtype=bool), set(range(self.q.shape[1]))
        for other in set(range(len(self.cores))) - {limb}:
            joints -= set(found[other].order if other in found else self.cores[other])
            if other in found:
                free[found[other].rows] = False
        # Where all others are known, what is left over is this one's.
        last = len(found) == len(self.cores) - 1
        likely = free if last else free & (self.share[:, limb] > _NEARLY_SURE)
        return np.flatnonzero(likely), [j for j in _moving(self.q) if j in joints]

    def _chain(self, rows: np.ndarray, joints: Sequence[int]) -> Limb | None:
        """The first chain with which its own touches agree, else the best.

        Most of the rows are of one limb.
        """
        if len(rows) < few.needed_for(len(joints))[1]:
            return None
        some = self._some(rows, _SEARCHED)
        smooth = self.sensed.some(some).precision(few.SEARCHED_NOISE)
        best, most = None, _HOPE
        for body in few.found_chains(self.search, some, smooth, list(joints)):
            own = self._own(rows, body)
            if len(own) < few.FEWEST:
                continue
            some = self._some(own, _SEARCHED)
            group = Smooth(some, self.sensed.some(some).precision(few.SEARCHED_NOISE))
            agreed, limb = self._judged(own, pruned(self.search, group, body))
            if agreed > most:
                best, most = limb, agreed
            if most > _AGREED:
                break
        return best

    def _judged(self, own: np.ndarray, body: Bodies) -> tuple[float, Limb]:
        """A chain fitted to its own touches, and the share of touches left out that agree."""
        some = self._some(own, _FITTED)
        order, chain = few.rough_chain(body)
        q, sensed = self.q[some][:, order], self.sensed.some(some)
        chain = finished(q, sensed.precision(), chain)
        labels = few.neighbourhoods(sensed, self.search.random)
        verdict = few.left_out_in_turn(q, sensed, labels, chain)
        return verdict.near * min(1.0, 2 * verdict.inliers), Limb(order, chain, own)

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
