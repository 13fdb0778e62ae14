"""Touches made with some joints alone, while the others stood still.

Who moves one limb at a time says who touched: a joint that stood still changed nothing. So each set
of joints that moved together has a chain of its own, found from few touches by what they feel like,
and chains of one part meet where they felt the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.chain import adjoint, places
from selftouch_drake.agent.body_model.forest import Links, Mechanism, robust_similarity
from selftouch_drake.agent.body_model.smoothness import Sensed, SmoothChain
from selftouch_drake.agent.body_model.structure import Search

# A joint stood still where it stayed within this share of its range for so many touches, in which
# another joint crossed that share of its own: of a slow walk all joints stay for a while.
_STILL, _IN_A_ROW, _CROSSED = 0.005, 4, 0.2
# A set of joints moved together for at least so many touches, and this share of all. Sets with less
# than this share together are chance: where joints turn round they stay for a while.
_FEWEST, _LEAST_SHARE, _TOGETHER = 20, 0.05, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """Which joints moved.

    Attributes:
        sets: joints that moved together while others stood still; no joint is in two of them.
        of_touch: `(n,)` the set of each touch; -1 for a touch of no set.
    """

    sets: Sequence[tuple[int, ...]]
    of_touch: np.ndarray

    def at(self, rows: np.ndarray) -> "Moved":
        """The same of touches in another order, of which these were `rows`."""
        of_touch = np.empty_like(self.of_touch)
        of_touch[rows] = self.of_touch
        return Moved(self.sets, of_touch)


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """The chain of one limb, from the part that it touches.

    Attributes:
        order: of its joints.
        chain: of these.
        rows: touches that it made.
    """

    order: list[int]
    chain: SmoothChain
    rows: np.ndarray

    def places(self, q: np.ndarray) -> np.ndarray:
        """`(n, 3)` where it made its touches, of `(n, J)` readings of all touches."""
        return places(q[self.rows][:, self.order], self.chain.twists, self.chain.point)


def moved_together(q: np.ndarray) -> Moved:
    """Sets of joints that moved while others stood still.

    Args:
        q: `(n, J)` readings of touches, one after the other.
    """
    ever = np.ptp(q, axis=0) > 0
    stood = _stood_still(q)
    moved = ever & ~stood
    some = np.flatnonzero(stood[:, ever].any(axis=1) & moved.any(axis=1))
    found, count = np.unique(moved[some], axis=0, return_counts=True)
    often = found[count >= max(_FEWEST, _LEAST_SHARE * len(q))]
    # What moved together once is one limb: who moves it may leave some of its joints alone.
    _, limb = connected_components(often.T.astype(int) @ often)
    sets = [np.flatnonzero(limb == number) for number in np.unique(limb[often.any(axis=0)])]
    of_touch = np.full(len(q), -1)
    for number, joints in enumerate(sets):
        others = np.setdiff1d(np.arange(q.shape[1]), joints)
        of_touch[some[~moved[np.ix_(some, others)].any(axis=1)]] = number
    if (of_touch >= 0).mean() < _TOGETHER:
        return Moved([], np.full(len(q), -1))
    return Moved([tuple(joints.tolist()) for joints in sets], of_touch)


def _stood_still(q: np.ndarray) -> np.ndarray:
    """`(n, J)` whether a joint stood still while others moved."""
    span = np.ptp(q, axis=0)
    share = q / np.where(span > 0, span, 1.0)
    stood = np.zeros(q.shape, dtype=bool)
    for joint, column in enumerate(share.T):
        begin = 0
        for end in range(1, len(column) + 1):
            if end < len(column) and abs(column[end] - column[begin]) <= _STILL:
                continue
            if end - begin >= _IN_A_ROW and np.ptp(share[begin:end], axis=0).max() > _CROSSED:
                stood[begin:end, joint] = True
            begin = end
    return stood


def of_limbs(
    search: Search, q: np.ndarray, sensation: csr_array, part: np.ndarray, moved: Moved
) -> Mechanism | None:
    """One body of the chains of all limbs that reach one part; None if fewer than two do.

    Args:
        search: what to work on.
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        part: `(n,)` part that each touch is on.
        moved: which joints moved.
    """
    for shared in largest_first(sensation, part):
        by_limb = _by_limb(part == shared, moved)
        if len(by_limb) < 2:
            continue
        limbs = []
        for joints, rows in by_limb.items():
            alone = replace(search, q=np.ascontiguousarray(search.q[:, rows]))
            found = few.found_by_sensation(alone, q[rows], sensation[rows], list(joints))
            search.tick()
            if found is not None and found.judgement.accepted:
                chain = SmoothChain(found.twists[found.order], found.point, np.inf)
                limbs.append(Limb(found.order, chain, rows))
            elif not limbs:
                break
        if len(limbs) > 1:
            return joined(q, sensation, shared, limbs)
    return None


def largest_first(sensation: csr_array, part: np.ndarray) -> list[int]:
    """Parts by the number of receptors that felt anything there.

    A part that moves has no chain of one limb alone. The trunk's skin is the largest, mostly.

    Args:
        sensation: `(n, S)` readings of the receptors.
        part: `(n,)` part that each touch is on.
    """
    felt = {int(p): sensation[part == p].sum(axis=0) > 0 for p in np.unique(part)}
    return sorted(felt, key=lambda p: -np.count_nonzero(felt[p]))


def _by_limb(on_part: np.ndarray, moved: Moved) -> dict[tuple[int, ...], np.ndarray]:
    """Rows of the touches of each limb that are enough to judge its chain."""
    rows = {
        joints: np.flatnonzero(on_part & (moved.of_touch == number))
        for number, joints in enumerate(moved.sets)
    }
    return {
        joints: own for joints, own in rows.items() if len(own) >= few.needed_for(len(joints))[1]
    }


def joined(q: np.ndarray, sensation: csr_array, part: int, limbs: Sequence[Limb]) -> Mechanism:
    """One body of several chains from one part, brought together where they felt the same.

    Args:
        q: `(n, J)` standardised readings.
        sensation: `(n, S)` readings of the receptors.
        part: that all chains begin at.
        limbs: the chains.
    """
    first, *others = limbs
    links = Links.of_chain(tuple((joint, 1) for joint in first.order), part)
    twists, points = np.zeros((q.shape[1], 6)), [first.chain.point]
    twists[first.order] = first.chain.twists
    sensed, own = Sensed.of(sensation[first.rows]), first.places(q)
    for number, other in enumerate(others, start=1):
        wanted = sensed.predicted(own, sensed.like(sensation[other.rows]))
        motion = robust_similarity(other.places(q), wanted)
        links, end = links.extended(links.part[part], other.order, forwards=True)
        links = replace(links, toucher={**links.toucher, number: end})
        twists[other.order] = adjoint(motion, other.chain.twists)
        points.append(motion[:3, :3] @ other.chain.point + motion[:3, 3])
    pairs = tuple((part, toucher) for toucher in range(len(points)))
    return Mechanism(links, twists, np.array(points), pairs)
