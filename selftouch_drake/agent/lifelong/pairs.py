"""Seeks new pairs of places that touch each other: both sides of a touch count (naive).

A skin that touches a skin is felt in two places, and what presses one presses the other: strengths
rise and fall alike, as they do by chance nowhere else. So the agent tells which places touch each
other even if it lies on something, or touches itself elsewhere too. It remembers the posture that
it had asked for, asks for that of a rare pair again, a little varied, and so finds what lies beside
it. It knows no part of its body: places are pools of receptors that feel the same touches.
"""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.sparse.csgraph import connected_components

from selftouch_drake.agent.lifelong.explorer import Explorer, Moves

#: Touches before there are places, and most remembered touches.
_FIRST, _MOST_TOUCHES = 200, 40_000

#: Receptors are of one pool if both feel this share of the touches that either of them feels; it is
#: compared on so many touches.
_OF_ONE_PLACE, _MOST_COMPARED = 0.5, 5000

#: Share of postures that are drawn at random, and share of a joint's range by which such a draw may
#: pass each limit: there the joint rests at its limit, where parts of a body meet.
_AT_RANDOM, _BEYOND = 0.3, 2.0

#: About a remembered posture: standard deviation of each joint as a share of its range, and most
#: joints that are drawn at random.
_SPREAD, _MOST_REDRAWN = 0.1, 5

#: Looks while a posture is held.
_HELD = 8

#: Between two looks, a strength that changes by less than the first share tells nothing; shares
#: that differ by less than the second are alike.
_CHANGES, _ALIKE = 0.05, 0.02

#: Two places touch each other if their strengths change alike at least so often while a posture is
#: held, and in this share of the looks. On MIMo, after 10,000 random steps, two thirds of such
#: pairs were in contact; of places that began to feel something at the same moment, a quarter.
_LEAST_ALIKE, _MOSTLY_ALIKE = 2, 0.3


class TouchPairs:
    """What the agent knows of pairs of places.

    Attributes:
        num_touches: number of touches taken so far.
        pool: `(S,)` the place of each receptor, as of `pools`.
        seen: for each pair of places, a touch of each posture in which they touched each other.
    """

    def __init__(self) -> None:
        self.num_touches = 0
        self.pool = np.empty(0, dtype=int)
        self.seen: dict[tuple[int, int], list[int]] = {}
        # Remembered sensations, and postures asked for then.
        self._felt = csr_array((0, 0), dtype=np.float32)
        self._asked = np.empty((0, 0), dtype=np.float32)
        self._next_pools = _FIRST

    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Learns from `(n, J)` postures asked for and `(n, S)` what was felt meanwhile."""
        felt, asked, first = csr_array(sensation, dtype=np.float32), q, len(self._asked)
        if first:
            felt = vstack([self._felt, felt], format="csr")
            asked = np.concatenate([self._asked, asked])
        self.num_touches += len(q)
        if self.num_touches >= self._next_pools:
            felt, asked, first = felt[-_MOST_TOUCHES:], asked[-_MOST_TOUCHES:], 0
            self.pool, self.seen = pools(felt), {}
            self._next_pools = self.num_touches + len(asked)
        self._felt, self._asked = felt, asked
        if len(self.pool):
            self._find_pairs(first)

    def posture(self, touch: int) -> np.ndarray:
        """`(J,)` the posture asked for at a touch."""
        return self._asked[touch].astype(float)

    def _find_pairs(self, first: int) -> None:
        """Notes the pairs in touches from number `first` on."""
        strength = in_pools(self._felt[first:], self.pool)
        asked = self._asked[first:]
        changes = np.flatnonzero((asked[1:] != asked[:-1]).any(axis=1)) + 1
        for start, end in pairwise([0, *changes.tolist(), len(asked)]):
            for pair in touching_pairs(strength[start:end]):
                self.seen.setdefault(pair, []).append(first + start)


def touching_pairs(strength: np.ndarray) -> list[tuple[int, int]]:
    """The pairs of places that touch each other while one posture is held.

    By `(n, P)` N, what each place feels at each look; of one look alone they are all that feel
    something.
    """
    places = np.flatnonzero(strength.any(axis=0))
    if len(strength) == 1:
        return list(combinations(places.tolist(), 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.diff(np.log(strength[:, places]), axis=0)
        known = np.isfinite(change)
        changed = known & (np.abs(change) > _CHANGES)
        apart = np.abs(change[:, :, None] - change[:, None])
    known = known[:, :, None] & known[:, None] & (changed[:, :, None] | changed[:, None])
    alike = (known & (apart < _ALIKE)).sum(axis=0)
    touch = (alike >= _LEAST_ALIKE) & (alike >= _MOSTLY_ALIKE * known.sum(axis=0))
    return [(int(places[i]), int(places[j])) for i, j in np.argwhere(np.triu(touch, 1))]


@dataclass(eq=False, kw_only=True)
class PairSeeker(Explorer):
    """Goes where it met rare pairs of places, and varies the posture.

    Attributes:
        pairs: what it knows of pairs.
        timed: whether the body needs time to go to a posture and to press there.
    """

    pairs: TouchPairs
    timed: bool = True

    def moves(self) -> Moves:
        """Explores without end."""
        pairs = list(self.pairs.seen)
        often = np.array([len(self.pairs.seen[pair]) for pair in pairs], dtype=float)
        while True:
            if not pairs or self.rng.random() < _AT_RANDOM:
                posture = self._anywhere()
            else:
                need = 1.0 / (1.0 + often) ** 2
                pair = self.rng.choice(len(pairs), p=need / need.sum())
                often[pair] += 1.0
                posture = self._varied(
                    self.pairs.posture(self.rng.choice(self.pairs.seen[pairs[pair]]))
                )
            yield from self._go(posture[None])
            if self.timed:
                yield from self._go(np.tile(posture, (_HELD, 1)))

    def _anywhere(self) -> np.ndarray:
        share = self.rng.uniform(-_BEYOND, 1.0 + _BEYOND, len(self.q)).clip(0.0, 1.0)
        return self.lower + share * (self.upper - self.lower)

    def _varied(self, posture: np.ndarray) -> np.ndarray:
        noise = _SPREAD * (self.upper - self.lower) * self.rng.standard_normal(len(posture))
        redrawn = self.rng.permutation(len(posture))[: self.rng.integers(_MOST_REDRAWN + 1)]
        posture = (posture + noise).clip(self.lower, self.upper)
        posture[redrawn] = self._anywhere()[redrawn]
        return posture


def pools(sensation: csr_array) -> np.ndarray:
    """`(S,)` the pool of each receptor: neighbours that feel alike, and their neighbours.

    The more touches there are, the better neighbours are told apart, or known to be neighbours.
    Receptors that felt nothing yet share the last pool.

    Args:
        sensation: `(n, S)` N, sparse.
    """
    some = np.unique(np.linspace(0, sensation.shape[0] - 1, _MOST_COMPARED).astype(int))
    felt = (sensation[some] > 0).astype(np.float32)
    together = (felt.T @ felt).tocoo()
    count = np.asarray(felt.sum(axis=0)).ravel()
    either = count[together.row] + count[together.col] - together.data
    alike = together.data >= _OF_ONE_PLACE * either
    graph = csr_array(
        (np.ones(int(alike.sum())), (together.row[alike], together.col[alike])),
        shape=together.shape,
    )
    _, pool = connected_components(graph, directed=False)
    return np.unique(np.where(count > 0, pool, len(count)), return_inverse=True)[1]


def in_pools(sensation: csr_array, pool: np.ndarray) -> np.ndarray:
    """`(n, P)` N, what the receptors of each pool feel together, from `(n, S)` N, sparse.

    `pool` is as of `pools`.
    """
    of_receptor = csr_array((np.ones(len(pool), np.float32), (np.arange(len(pool)), pool)))
    return (sensation @ of_receptor).toarray()
