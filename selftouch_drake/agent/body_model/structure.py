"""Which joints matter for a group of touches, and in which order: a search over chains.

A criterion of a chain falls in steps: with one joint at a wrong place it is stuck half-way whatever
the twists. So a population of orders first finds several half-ripe chains; then all neighbours of
the best ones are tried at once, with the twists of the joints that moved drawn anew; no joint is
left out before the order is ripe.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.fit import (
    Bodies,
    Descent,
    Each,
    Group,
    Smooth,
    Way,
    chain_way,
    descended,
    random_bodies,
    random_twists,
)

# Degrees of freedom while orders compete: fewer hide half-ripe chains, more suffer from wrong
# labels. Measured on nine joints of unknown order.
_SEARCH_TAIL = 20.0
# A population: its size, rounds, and how many bodies of one ancestor go on.
_POPULATION, _ROUNDS, _RELATIVES = 64, 5, 3
# So many times more where few touches make a body cheap, and its order hard to find: of 50 touches
# of three cubes one population found the body in 12 of 18 tries, one of 64 in 8. From so many
# touches on it is not larger.
_LARGER, _LARGE = 3, 256
# Share of a population that stays, and that is bred from it; the rest is drawn anew.
_STAY, _BRED = 0.25, 0.5
# Neighbours of a chain are tried so often at most.
_MOST_PASSES = 10
#: Chains of a population from which neighbours are tried.
CHAINS = 2
#: Populations that a search makes, if none of their chains is good.
POPULATIONS = 2
# A neighbour is taken if its criterion is better by this much; each further joint must earn more.
_GAIN, _EARNED = 0.05, 0.1
#: Fewer touches are not looked at.
FEWEST = 60
#: A joint matters if leaving it out costs more.
MATTERS = 0.02
# What a joint that does not matter gains of a smooth body by chance, times the number of touches:
# one for each of its parameters, twice.
_LUCK = 10.0
# A pair of joints depends on each other within kernels if its statistic exceeds so many standard
# deviations of chance.
_PAIR_SIGMA = 6.0


@dataclass(frozen=True, slots=True)
class Search:
    """What a search works on.

    Attributes:
        q: `(J, R)` float32 standardised readings.
        random: source of all randomness.
        each: maps blocks of bodies.
        tick: called before each descent.
        scale: `(J,)` standard deviations of the readings; None if they are not known.
        sensation: `(R, S)` what was felt; None if it is not known.
    """

    q: np.ndarray
    random: np.random.Generator
    each: Each = map
    tick: Callable[[], None] = lambda: None
    scale: np.ndarray | None = None
    sensation: csr_array | None = None

    @property
    def num_joints(self) -> int:
        """Of all joints."""
        return len(self.q)

    def descended(
        self, groups: Sequence[Group | Smooth], bodies: Bodies, how: Descent, **more
    ) -> Bodies:
        """`fit.descended` with draws of its own."""
        self.tick()
        seed = int(self.random.integers(2**31))
        return descended(self.q, groups, bodies, how, seed, each=self.each, **more)


def order_of(way: Way) -> list[int]:
    """The joints of a chain."""
    return [joint for joint, _ in way]


def pair_statistic(
    q: np.ndarray, group: Group, bins: int = 5, least: int = 30
) -> tuple[np.ndarray, float]:
    """How much pairs of joints depend on each other within kernels.

    In a kernel the toucher stays at one point, so that its joints hold each other.

    Args:
        q: `(J, R)` readings.
        group: touches.
        bins: ranks of each joint fall into so many.
        least: kernels with fewer touches are left out.

    Returns:
        `(J, J)` chi-squared per touch less that of chance, 0 on the diagonal; and its standard
        deviation by chance. NaN if no kernel has enough touches.
    """
    num_joints = len(q)
    total, touches, kernels = np.zeros((num_joints, num_joints)), 0, 0
    for start, end in itertools.pairwise(group.offsets):
        number = end - start
        if number < least:
            continue
        ranks = q[:, group.rows[start:end]].argsort(axis=1).argsort(axis=1) * bins // number
        one_hot = (ranks[:, None, :] == np.arange(bins)[None, :, None]).astype(np.float32)
        flat = one_hot.reshape(num_joints * bins, number)
        table = (flat @ flat.T).reshape(num_joints, bins, num_joints, bins).swapaxes(1, 2)
        expected = number / bins**2
        total += ((table - expected) ** 2 / expected).sum(axis=(2, 3)) - (bins - 1) ** 2
        touches, kernels = touches + number, kernels + 1
    np.fill_diagonal(total, 0)
    if kernels == 0:
        return np.full_like(total, np.nan), np.nan
    return total / touches, float(np.sqrt(2 * (bins - 1) ** 2 * kernels) / touches)


def joints_that_hold(statistic: np.ndarray, noise: float) -> list[int]:
    """Joints that depend on another one more than by chance, and more than all pairs do."""
    if not np.isfinite(noise):
        return list(range(len(statistic)))
    apart = statistic[~np.eye(len(statistic), dtype=bool)]
    low = apart[apart < np.median(apart) + 4 * noise]
    threshold = max(float(np.median(low)), 0.0) + _PAIR_SIGMA * noise
    return [int(j) for j in np.flatnonzero(statistic.max(axis=1) > threshold)]


def population(
    search: Search,
    group: Group | Smooth,
    joints: Sequence[int],
    *,
    rounds: int = _ROUNDS,
    chains: int = CHAINS,
) -> Bodies:
    """Bodies of the best few orders that a population finds, best first.

    Args:
        search: what to work on.
        group: touches of one toucher on one part.
        joints: all of them are in each chain.
        rounds: generations.
        chains: how many bodies, of different orders.
    """
    random = search.random
    how = Descent(steps=250, tail=_SEARCH_TAIL)
    size = _POPULATION
    if isinstance(group, Smooth):
        size = int(size * np.clip(_LARGE / len(group.rows), 1, _LARGER))

    def fresh(number: int) -> Bodies:
        orders = [chain_way(random.permutation(joints)) for _ in range(number)]
        return random_bodies([[way] for way in orders], search.num_joints, 1, random)

    bodies = fresh(2 * size)
    ancestor = np.arange(len(bodies))
    born = len(bodies)
    for turn in range(rounds):
        bodies = search.descended([group], bodies, how)
        stay = _best_of_families(bodies, ancestor, int(_STAY * size))
        if turn == rounds - 1 or _agreed(bodies, ancestor):
            break
        bred = stay[np.minimum(random.geometric(0.12, int(_BRED * size)) - 1, len(stay) - 1)]
        children = bodies.pick(bred)
        seen = {way[0] for way in bodies.ways}
        for child in range(len(children)):
            _mutate(children, child, seen, random)
        number = size - len(stay) - len(bred)
        bodies = Bodies.joined([bodies.pick(stay), children, fresh(number)])
        ancestor = np.concatenate([ancestor[stay], ancestor[bred], born + np.arange(number)])
        born += number
    return bodies.pick(_best_of_families(bodies, ancestor, chains, relatives=1))


def _agreed(bodies: Bodies, ancestor: np.ndarray) -> bool:
    """Whether the best bodies of different ancestors reach the same criterion."""
    best = _best_of_families(bodies, ancestor, 3, relatives=1)
    cost = bodies.loss[best].sum(axis=1)
    return len(best) == 3 and bool(cost[-1] - cost[0] < 0.1)


def _best_of_families(
    bodies: Bodies, ancestor: np.ndarray, number: int, relatives: int = _RELATIVES
) -> np.ndarray:
    """Indices of the best bodies: orders once each, and only so many of one ancestor."""
    chosen: list[int] = []
    seen, count = set(), dict.fromkeys(ancestor.tolist(), 0)
    for index in np.argsort(bodies.loss.sum(axis=1), kind="stable"):
        way, family = bodies.ways[index][0], int(ancestor[index])
        if way in seen or count[family] >= relatives:
            continue
        seen.add(way)
        count[family] += 1
        chosen.append(int(index))
        if len(chosen) == number:
            break
    return np.array(chosen)


def _mutate(bodies: Bodies, index: int, seen: set[Way], random: np.random.Generator) -> None:
    """Gives a body another order that nobody had, and sometimes new twists where it changed."""
    before = order_of(bodies.ways[index][0])
    for _ in range(20):
        order, moved = list(before), set()
        for _ in range(1 if random.random() < 0.6 else 2):
            if random.random() < 0.35:
                first = int(random.integers(len(order) - 1))
                order[first : first + 2] = order[first : first + 2][::-1]
                moved.update(order[first : first + 2])
            else:
                joint = order.pop(int(random.integers(len(order))))
                order.insert(int(random.integers(len(order) + 1)), joint)
                moved.add(joint)
        if chain_way(order) not in seen:
            break
    seen.add(chain_way(order))
    bodies.ways[index] = [chain_way(order)]
    if random.random() < 0.5:
        bodies.twists[index, list(moved)] = 0.5 * random_twists(random, len(moved))


def neighbours(order: list[int], candidates: Iterable[int]) -> list[tuple[list[int], list[int]]]:
    """Chains near one: one joint elsewhere, three in another order, one joint more.

    Returns:
        Orders, and of each the joints whose twists are to be drawn anew. The first is the chain
        itself.
    """
    found: list[tuple[list[int], list[int]]] = [(order, [])]
    length = len(order)
    for joint in order:
        rest = [other for other in order if other != joint]
        for place in range(length):
            moved = [*rest[:place], joint, *rest[place:]]
            # Its twist drawn anew where it is, too: it may sit in a false optimum.
            found.append((moved, [joint]))
    for first in range(length - 2):
        for three in itertools.permutations(order[first : first + 3]):
            changed = [*order[:first], *three, *order[first + 3 :]]
            if changed != order:
                found.append((changed, list(three)))
    for joint in candidates:
        if joint not in order:
            found += [([*order[:k], joint, *order[k:]], [joint]) for k in range(length + 1)]
    return found


def improved(
    search: Search,
    group: Group | Smooth,
    body: Bodies,
    candidates: Sequence[int],
    *,
    passes: int = 0,
) -> Bodies:
    """The best body that neighbours of neighbours lead to.

    Args:
        search: what to work on.
        group: touches of one toucher on one part.
        body: one body, a chain.
        candidates: joints that may be added.
        passes: at most; a default if 0.
    """
    random = search.random
    how = Descent(steps=300, tail=_SEARCH_TAIL, kernels=30)
    for _ in range(passes or _MOST_PASSES):
        order = order_of(body.ways[0][0])
        near = neighbours(order, candidates)
        bodies = body.pick(np.zeros(len(near), dtype=int))
        for index, (changed, moved) in enumerate(near):
            bodies.ways[index] = [chain_way(changed)]
            if moved:
                bodies.twists[index, moved] = 0.6 * random_twists(random, len(moved))
        bodies = search.descended([group], bodies, how)
        cost = bodies.loss.sum(axis=1)
        longer = np.array([len(changed) - len(order) for changed, _ in near])
        need = np.where(longer > 0, _EARNED, _GAIN)
        need[0] = 0
        best = int(np.argmin(cost + need))
        body = bodies.pick([best])
        if best == 0:
            break
    return body


def leave_one_out(search: Search, group: Group | Smooth, body: Bodies) -> tuple[np.ndarray, Bodies]:
    """What leaving each joint of a chain out costs, in the order of the chain; and the body."""
    order = order_of(body.ways[0][0])
    bodies = body.pick(np.zeros(len(order) + 1, dtype=int))
    for index, joint in enumerate(order):
        bodies.ways[index + 1] = [chain_way(other for other in order if other != joint)]
    how = Descent(steps=400, rate=0.02, kernels=60, members=12, tail=_SEARCH_TAIL)
    bodies = search.descended([group], bodies, how)
    cost = bodies.loss.sum(axis=1)
    return cost[1:] - cost[0], bodies.pick([0])


def pruned(search: Search, group: Group | Smooth, body: Bodies) -> Bodies:
    """The body without the joints that do not matter."""
    # With few touches a joint that does not matter explains some of the noise.
    matters = MATTERS + (_LUCK / len(group.rows) if isinstance(group, Smooth) else 0.0)
    while len(body.ways[0][0]) > 2:
        cost, body = leave_one_out(search, group, body)
        idle = np.argsort(cost, kind="stable")
        idle = idle[cost[idle] < matters][: max(1, int((cost < matters).sum() + 1) // 2)]
        if len(idle) == 0:
            break
        order = order_of(body.ways[0][0])
        kept = [joint for index, joint in enumerate(order) if index not in set(idle.tolist())]
        body.ways[0] = [chain_way(kept)]
    return body


def found_chains(
    search: Search,
    group: Group | Smooth,
    joints: Sequence[int],
    *,
    populations: int = POPULATIONS,
    chains: int = CHAINS,
) -> Iterator[Bodies]:
    """One body after another: chains of a population, led on by their neighbours, and polished.

    Whoever asks stops when one is good.

    Args:
        search: what to work on.
        group: touches of one toucher on one part.
        joints: that may matter.
        populations: at most.
        chains: that are led on, of each population.
    """
    for _ in range(populations):
        found = population(search, group, joints, chains=chains)
        for number in range(len(found)):
            body = improved(search, group, found.pick([number]), joints)
            yield polished(search, group, pruned(search, group, body))


def neighbours_swapped(way: Way) -> list[Way]:
    """The ways on which two neighbours have changed places, the first two first."""
    return [
        (*way[:index], way[index + 1], way[index], *way[index + 2 :])
        for index in range(len(way) - 1)
    ]


def swap_costs(search: Search, group: Group | Smooth, body: Bodies) -> np.ndarray:
    """`(L - 1,)` what it costs that neighbours of a chain change places."""
    order = order_of(body.ways[0][0])
    bodies = body.pick(np.zeros(len(order), dtype=int))
    for index, swapped in enumerate(neighbours_swapped(chain_way(order))):
        bodies.ways[index + 1] = [swapped]
    how = Descent(steps=400, rate=0.02, kernels=60, members=12, tail=_SEARCH_TAIL)
    cost = search.descended([group], bodies, how).loss.sum(axis=1)
    return cost[1:] - cost[0]


def polished(search: Search, group: Group | Smooth, body: Bodies) -> Bodies:
    """The body after a long descent that hardly heeds wrong labels."""
    how = Descent(steps=800, rate=0.01, kernels=80, members=16)
    return search.descended([group], body, how)
