"""Grows one tree for all parts: a sharp chain first, then skins, hands and joints that fit it."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from selftouch_drake.agent.body_model.blunt import in_better_order, spread
from selftouch_drake.agent.body_model.density import (
    NEARLY_SURE,
    SURE,
    limbs,
    telling_cores,
    who_touched,
)
from selftouch_drake.agent.body_model.few import SEARCHED_NOISE
from selftouch_drake.agent.body_model.fit import Bodies, Group, Smooth
from selftouch_drake.agent.body_model.forest import (
    Links,
    Mechanism,
    alone,
    attached,
    dense_rows,
    explained,
    hung,
    joined,
    with_late_touchers,
)
from selftouch_drake.agent.body_model.known_places import Shown, behind_new_joints
from selftouch_drake.agent.body_model.refine import refined
from selftouch_drake.agent.body_model.scene import Scene, Solution
from selftouch_drake.agent.body_model.smoothness import Sensed
from selftouch_drake.agent.body_model.structure import (
    Search,
    found_chains,
    joints_that_hold,
    order_of,
    pair_statistic,
    population,
)
from selftouch_drake.agent.body_model.who_touched import started

# A body that explains some of a new part is bundled so often at most, and must not explain so much
# less of any other part then.
_MOST_BUNDLES, _WORSE = 3, 0.05
# Touches that a chain is searched with, and that a bundle is refined with while the tree grows.
_SEARCHED, _BUNDLED = 20_000, 15_000
# Touches by which hands are told apart, and joints that tell them: all of some kernels, for
# densities need many of each. With 40 touches of each kernel a fifth of the surest of five arms is
# wrong, with 200 one in fifty.
_TOLD_APART, _CORES_COMPARED = 60_000, 20_000
# Parts with fewer touches are only hung, and limbs with fewer have no chain.
_FEWEST, _FEWEST_OF_LIMB = 600, 300
# A touch that a known hand did not make is of a limb above this probability. Of the iCub's head,
# none to one of 21,000 such touches was of the known hand.
_LIKELY = 0.5
# Touches whose sensations lead a search for the chain of a hand.
_FELT = 500
# Share of explained touches above which a chain is a seed.
_SEED = 0.75
#: Share of explained touches above which a part joins the tree.
JOINS = 0.7
# A chain that explains less by one point of its hand may explain more by several; if it is right it
# explains this share by one, and a larger one by several: of ten chains of the iCub's left hand the
# right one reached 0.93, and that of a joint left out 0.77.
_HOPE, _SEED_OF_SEVERAL = 0.2, 0.82
# One that explains more is taken at once. Where none does, but one explains the second share,
# chains are searched so often.
_WELL, _HOPE_OF_SEVERAL, _SEARCHES = 0.95, 0.5, 3
#: Points of one link that touch, at most.
MOST_TOUCHERS = 4
# Up to so many joints, orders of all of them compete.
_ALL_TRIED = 16
# Parts whose chains compete to be the seed.
_PROBED = 6
# A tree that holds parts with more than this share of the touches began with a right chain. Where
# one holds less, more chains are looked for, of so many parts. On the infant (seed 3) the first
# chains of both upper arms had joints at wrong places; of up to four more the sharpest were right.
_MOST_HANG, _LOOKED_AGAIN = 0.5, 2
# New joints that are tried in all orders, at most.
_MOST_NEW = 3
# Bodies with a part behind new joints that are looked at.
_BEST = 3


def grown(
    search: Search, scene: Scene, tested: np.ndarray, moving: list[int], *, hands: bool = False
) -> Mechanism | None:
    """One body that explains as many parts as possible; None if no part gives a chain.

    Args:
        search: what to work on.
        scene: all touches; its ways are not read.
        tested: `(R,)` bool, held-out touches: not used.
        moving: joints that move.
        hands: no part has the chain of one hand alone: it has been looked for.
    """
    grower = _Grower(search, scene, tested, moving)
    best, most = None, 0.0
    for seed in grower.seeds(hands):
        body = grower.full(seed)
        share = grower.share(body)
        if share > most:
            best, most = body, share
        if most > _MOST_HANG:
            break
    return best


def full(
    body: Mechanism, search: Search, scene: Scene, tested: np.ndarray, moving: list[int]
) -> Mechanism:
    """A body with all parts that can be added to it; arguments are those of `grown`."""
    grower = _Grower(search, scene, tested, moving)
    return grower.full(grower.bundled(body))


@dataclass(frozen=True, slots=True, eq=False)
class _Limb:
    """What is known of a limb before its chain.

    Attributes:
        group: touches that it surely made.
        surely: joints that hold each other among these.
        joints: that may matter; some act only together with others, which no pair shows.
    """

    group: Group
    surely: list[int]
    joints: list[int]


class _Grower:
    """What is known of the parts while a tree grows."""

    def __init__(self, search: Search, scene: Scene, tested: np.ndarray, moving: list[int]):
        self.search, self.scene, self.moving = search, scene, moving
        part = scene.part[scene.target]
        used = np.flatnonzero(~tested)
        self.rows = {int(p): used[part[used] == p] for p in np.unique(part)}
        self.parts = sorted(self.rows, key=lambda p: -len(self.rows[p]))
        self.groups, self.holding, self.held, self.statistic = {}, {}, {}, {}
        for p in self.parts:
            some = np.sort(search.random.permutation(self.rows[p])[:_SEARCHED])
            self.groups[p] = Group.of(some, scene.target[some])
            self.statistic[p] = pair_statistic(search.q, self.groups[p], least=20)
            held = [j for j in joints_that_hold(*self.statistic[p]) if j in moving]
            # Some joints act only together with others, which no pair shows: few are all tried.
            self.holding[p] = held if len(held) >= 3 and len(moving) > _ALL_TRIED else moving
            self.held[p] = held
        self.chains: dict[int, Bodies] = {}
        self.given_up: set[int] = set()

    def seeds(self, hands: bool = False) -> Iterator[Mechanism]:
        """Trees of one part: the one that a population finds sharpest, by one hand or several.

        Whoever asks stops when one grows well.

        Args:
            hands: it is several.
        """
        ripe = [
            p
            for p in self.parts
            if len(self.rows[p]) >= _FEWEST and self.groups[p].num_kernels >= 8
        ]
        if hands or len(self.moving) > _ALL_TRIED:
            # Hardly any chain is as long, and the search for one takes minutes.
            bodies = (self.of_several_hands(p) for p in ripe[:2])
            yield from itertools.islice((body for body in bodies if body is not None), 1)
        if hands:
            return
        probe = {}
        for p in ripe:
            found = population(self.search, self.groups[p], self.holding[p], rounds=2)
            probe[p] = float(found.loss.sum(axis=1).min())
        by_probe = sorted(ripe, key=lambda p: probe[p])
        # Cheap trials first: a mixture of hands has no chain, however long one looks for it. Of
        # several chains the sharpest one begins: a blunt one may have a wrong order. One by several
        # points of a hand is sharper, right or wrong: of an infant's it had left out the wrist.
        sharp = [p for p in by_probe[:_PROBED] if self.chain(p, 1) is not None]
        sharp.sort(key=lambda p: (self._num_points(p), self._loss(p)))
        if sharp:
            yield self._of_chain(sharp[0])
            for p in sharp[:_LOOKED_AGAIN]:
                if self.look_again(p) or p != sharp[0]:
                    yield self._of_chain(p)
            return
        trials = itertools.chain(
            (self._of_chain(p) for p in ripe[:2] if self.blunt_chain(p) is not None),
            (self.of_several_hands(p) for p in ripe[:2]),
            (self._of_chain(p) for p in by_probe if self.chain(p) is not None),
        )
        yield from itertools.islice((body for body in trials if body is not None), 1)

    def full(self, body: Mechanism) -> Mechanism:
        """The body with all parts that can be added to it, one after another."""
        while True:
            complete = with_late_touchers(self._training, body, self.search.random)
            if complete is not body:
                body = self.bundled(complete)
            waiting = [part for part in self.parts if part not in body.links.part]
            bigger = self.with_hung(body, waiting) or self.with_attached(body, waiting)
            if bigger is None:
                return body
            body = bigger

    def share(self, body: Mechanism) -> float:
        """Share of all touches whose parts hang in a body."""
        counts = {part: len(rows) for part, rows in self.rows.items()}
        return sum(counts[part] for part in body.links.part) / sum(counts.values())

    def chain(self, part: int, most: int = 0) -> Bodies | None:
        """The chain of a part alone, if one explains its touches.

        Args:
            part: which part.
            most: chains that are looked at; all that the search gives if 0.
        """
        if self.chains.get(part) is not None or part in self.given_up:
            return self.chains.get(part)
        if len(self.rows[part]) >= _FEWEST and self.groups[part].num_kernels >= 8:
            bodies = found_chains(self.search, self.groups[part], self.holding[part])
            for body in itertools.islice(bodies, most or None):
                proved, _ = self._proved(body, self.groups[part].rows, part)
                if proved is not None:
                    self.chains[part] = proved
                    break
        if not most:
            self.given_up.add(part)
        return self.chains.get(part)

    def blunt_chain(self, part: int) -> Bodies | None:
        """The chain of a part alone, by a hand that is no point, if one explains its touches."""
        held, joints = self.held[part], self.holding[part]
        limb = _Limb(self.groups[part], held if len(held) >= 3 else joints, joints)
        found = next((chain for chain in self._searched(limb, part) if chain is not None), None)
        if found is not None:
            self.chains[part] = found
        return found

    def _proved(self, chain: Bodies, rows: np.ndarray, part: int) -> tuple[Bodies | None, float]:
        """The chain if it explains touches of a part, by one point of a hand or by several.

        And the share that it explains.
        """
        own = alone(self.scene, rows, part, chain)
        solution = started(own, chain.twists[0], chain.points[0])
        share = explained(own, solution, part)
        if share > _SEED:
            return chain, share
        if share < _HOPE:
            return None, share
        some = dense_rows(self.scene.target, rows, self.search.random)
        own = alone(self.scene, some, part, chain)
        own, solution = spread(own, solution, part, MOST_TOUCHERS, self.search.random)
        share = explained(own, solution, part)
        if share < _SEED_OF_SEVERAL:
            return None, share
        return _one_body(own, solution, part), share

    def look_again(self, part: int) -> bool:
        """Looks for more chains of a part that has one, and keeps the sharpest; whether it is new.

        The first chain that explains most touches may have two joints at wrong places.
        """
        before, points = self.chains[part], self._num_points(part)
        for body in found_chains(self.search, self.groups[part], self.holding[part]):
            proved, _ = self._proved(body, self.groups[part].rows, part)
            if proved is None or proved.points.shape[1] > points:
                continue
            if proved.loss.sum() < self._loss(part):
                self.chains[part] = proved
        return self.chains[part] is not before

    def _loss(self, part: int) -> float:
        """The criterion of a part's chain."""
        return float(self.chains[part].loss.sum())

    def _num_points(self, part: int) -> int:
        """Points of the hand of a part's chain."""
        return self.chains[part].points.shape[1]

    def _of_chain(self, part: int) -> Mechanism:
        """A body of the chain of a part."""
        chain = self.chains[part]
        links = Links.of_chain(chain.ways[0][0], part, chain.points.shape[1])
        pairs = tuple((part, toucher) for toucher in links.toucher)
        return self.bundled(Mechanism(links, chain.twists[0], chain.points[0], pairs))

    def of_several_hands(self, part: int) -> Mechanism | None:
        """A body of several chains that meet at a part, told apart by densities of their joints.

        A hand that is a point is found at once. Of others one is searched until it has a chain;
        that shows where the part's kernels lie, and with them the next hand is found much sooner.
        """
        cores = limbs(*self.statistic[part])
        if len(cores) < 2:
            return None
        cores = telling_cores(self.search.q, self._dense(part, _CORES_COMPARED), cores)
        if len(cores) < 2:
            return None
        group = self._dense(part, _TOLD_APART)
        share = who_touched(self.search.q, group, cores)
        each = [
            (limb, self._searched(limb, part), group.rows[share[:, number] > _LIKELY])
            for number, limb in enumerate(self._limbs(group, share, cores))
            if len(limb.group.rows) >= _FEWEST_OF_LIMB and limb.group.num_kernels >= 8
        ]
        chains, known = dict[int, tuple[Bodies, np.ndarray]](), None
        # Once more, for those that failed before another one was found.
        for turn in range(_SEARCHES + 1):
            for number, (limb, searched, likely) in enumerate(each):
                if number in chains:
                    continue
                found = None
                if turn and chains:
                    if known is None:
                        known = Shown.of(self.scene, *next(iter(chains.values())), part)
                    found = self._taught(limb, known, likely)
                if found is None:
                    chain = next(searched, None)
                    found = None if chain is None else (chain, limb.group.rows)
                if found is not None:
                    chains[number] = found
        if not chains:
            return None
        body = self.bundled(joined(self.scene, part, list(chains.values())))
        some = dense_rows(self.scene.target, self.rows[part], self.search.random)
        return body if self._explained(body, part, some) > _SEED else None

    def _limbs(self, group: Group, share: np.ndarray, cores: list[list[int]]) -> list[_Limb]:
        """The touches that each limb surely made, and the joints that may matter to it."""
        groups, held = list[Group](), list[set[int]]()
        for limb, core in enumerate(cores):
            sure = group.rows[self._sure(share, limb)]
            own = Group.of(sure, self.scene.target[sure])
            groups.append(own)
            held.append(set(core))
            if own.num_kernels:
                # Where one hand alone touched, joints of the others hold nothing.
                found = joints_that_hold(*pair_statistic(self.search.q, own, least=20))
                held[-1].update(found)
        found_limbs = []
        for limb, own in enumerate(groups):
            others = set[int]().union(*(held[:limb] + held[limb + 1 :]))
            surely = [j for j in self.moving if j in held[limb]]
            joints = [j for j in self.moving if j in held[limb] or j not in others]
            found_limbs.append(_Limb(own, surely if len(surely) >= 3 else joints, joints))
        return found_limbs

    @staticmethod
    def _sure(share: np.ndarray, limb: int) -> np.ndarray:
        """`(n,)` bool, the touches that a limb made surely; less surely where these are few."""
        own = share.argmax(axis=1) == limb
        surely = own & (share[:, limb] > SURE)
        return surely if surely.sum() >= _FEWEST else own & (share[:, limb] > NEARLY_SURE)

    def _explained(self, body: Mechanism, part: int, rows: np.ndarray) -> float:
        """Share of some touches of a part that a body explains as it is."""
        ways = {pair: way for pair, way in body.ways().items() if pair[0] == part}
        scene = replace(self.scene.some(rows), ways=ways)
        return explained(scene, started(scene, body.twists, body.points), part)

    def _searched(self, limb: _Limb, part: int) -> Iterator[Bodies | None]:
        """The chain of one hand, after each search for it; where its hand is no point, the best.

        A hand is a point unless no chain of all joints says so: by several, a chain without one of
        them may explain as much. By one point many a population misses the chain of a hand that is
        none, and a chain with two joints at wrong places explains nearly as much as the right one.
        """
        best, most, hope = None, 0.0, 0.0
        felt = self._as_felt(limb.group)
        for group, tried in [(limb.group, limb.joints), *[(felt, limb.surely)] * (_SEARCHES - 1)]:
            for chain in found_chains(self.search, group, tried):
                proved, share = self._proved(chain, limb.group.rows, part)
                if proved is chain:
                    yield chain
                    return
                hope = max(hope, share)
                if proved is None:
                    continue
                ordered, share = self._well_ordered(proved, limb.group.rows, part)
                if share > most:
                    best, most = ordered, share
                if most > _WELL and tried is not limb.joints:
                    yield best
                    return
            if most > _WELL or (group is felt and hope < _HOPE_OF_SEVERAL):
                break
            yield None
        yield best

    def _as_felt(self, group: Group) -> Group | Smooth:
        """Some touches of a group by what was felt, if that is known: slower, fewer false optima.

        Of the iCub's head, with the order of ten joints given, one start in twelve found the body
        by kernels, and twelve in 24 by 800 sensations.
        """
        if self.search.sensation is None:
            return group
        some = np.sort(self.search.random.permutation(group.rows)[:_FELT])
        return Smooth(some, Sensed.of(self.search.sensation[some]).precision(SEARCHED_NOISE))

    def _taught(
        self, limb: _Limb, known: Shown, rows: np.ndarray
    ) -> tuple[Bodies, np.ndarray] | None:
        """The chain of one hand to places that another one has shown, and its touches of these.

        Args:
            limb: whose hand it is.
            known: the places.
            rows: touches that are likely of the limb.
        """
        rows = rows[known.by_others(self.scene, rows)]
        best, most = None, 0.0
        if len(rows) >= _FEWEST_OF_LIMB:
            for chain in known.chains_to(self.search, self.scene, rows, limb.surely):
                proved, _ = self._proved(chain, rows, known.part)
                if proved is chain:
                    return chain, rows
                if proved is None:
                    continue
                ordered, share = self._well_ordered(proved, rows, known.part)
                agreed = best is not None and ordered.ways == best.ways
                if share > most:
                    best, most = ordered, share
                if agreed or most > _WELL:
                    break
        return None if best is None else (best, rows)

    def _well_ordered(self, chain: Bodies, rows: np.ndarray, part: int) -> tuple[Bodies, float]:
        """The chain of a hand of several points in the best order, and what it explains."""
        own = alone(self.scene, rows, part, chain)
        solution = started(own, chain.twists[0], chain.points[0])
        own, solution = in_better_order(self.search, own, solution, part)
        return _one_body(own, solution, part), explained(own, solution, part)

    def with_hung(self, body: Mechanism, waiting: list[int]) -> Mechanism | None:
        """The body with those parts hung that need nothing new; None if there are none."""
        added, nearly = False, list[tuple[float, int, Mechanism]]()
        for part in waiting:
            best = hung(self._training, body, part, self.search.random)
            self.search.tick()
            if best is not None and best[0] > JOINS:
                body, added = best[1], True
            elif best is not None and not set(self.held[part]) - set(body.links.ends):
                nearly.append((best[0], part, best[1]))
        if added:
            return self.bundled(body)
        for share, part, bigger in sorted(nearly, key=lambda one: -one[0]):
            if share > _HOPE:
                some = dense_rows(self.scene.target, self.rows[part], self.search.random)
                settled = self._settled(body, bigger, part, some)
                if settled is not None:
                    return settled
        return None

    def _settled(
        self, body: Mechanism, bigger: Mechanism, part: int, rows: np.ndarray
    ) -> Mechanism | None:
        """The body with a part, bundled until it explains some of its touches; or None.

        Parts that the body has must not be explained worse: a part at a wrong link bends the rest.
        """
        for _ in range(_MOST_BUNDLES):
            bigger = self.bundled(bigger)
            share = self._explained(bigger, part, rows)
            if share < _HOPE:
                return None
            if share > JOINS:
                return bigger if self._keeps(body, bigger) else None
        return None

    def _keeps(self, body: Mechanism, bigger: Mechanism) -> bool:
        """Whether a bigger body explains all parts of a body as well."""
        for part in body.links.part:
            rows = dense_rows(self.scene.target, self.rows[part], self.search.random)
            before, after = (self._explained(one, part, rows) for one in (body, bigger))
            if after < before - _WORSE:
                return False
        return True

    def with_attached(self, body: Mechanism, waiting: list[int]) -> Mechanism | None:
        """The body with one part that brings new joints; None if there is none."""
        # Parts that have a chain of their own come first: their new joints are known.
        waiting = [part for part in waiting if self.groups[part].num_kernels >= 8]
        for part in sorted(waiting, key=lambda p: (p not in self.chains, len(self.rows[p]))):
            for bigger in self._attachments(body, part):
                some = dense_rows(self.scene.target, self.rows[part], self.search.random)
                if self._explained(bigger, part, some) > JOINS:
                    return self.bundled(bigger)
                settled = self._settled(body, bigger, part, some)
                if settled is not None:
                    return settled
        return None

    def _attachments(self, body: Mechanism, part: int) -> Iterator[Mechanism]:
        """Bodies with the part and its new joints, the best first.

        Whoever asks stops when one is good.
        """
        known = set(body.links.ends)
        new = [joint for joint in self.held[part] if joint not in known]
        if part not in self.chains and 0 < len(new) <= _MOST_NEW:
            # Between the tree and the skin. All touches of one hand, if densities tell them.
            hand, group = self._most_of_one_hand(body, part)
            found = behind_new_joints(self.search, self.scene, group, body, part, hand, new)
            for bigger in itertools.islice(found, _BEST):
                yield self._with_all_hands(bigger, part)
        chain = self.chain(part, 1)
        if chain is None:
            return
        order = order_of(chain.ways[0][0])
        shared = [joint for joint in order if joint in known]
        new = [joint for joint in order if joint not in known]
        if not shared or len(new) > _MOST_NEW:
            return
        middle = np.mean([order.index(joint) for joint in shared])
        inner = [joint for joint in new if order.index(joint) < middle]
        outer = [joint for joint in new if order.index(joint) > middle]
        yield from attached(
            self.search, self.groups[part], body, part,
            inner=inner, outer=outer, shared=shared,
        )[:3]  # fmt: skip

    def _most_of_one_hand(self, body: Mechanism, part: int) -> tuple[list[int], Group]:
        """The touchers of the hand of most touches that densities tell surely, and these."""
        group, links = self.groups[part], body.links
        hands = links.hands(links.toucher)
        if len(hands) < 2:
            return hands[0], group
        group = self._dense(part, _TOLD_APART)
        statistic, _ = self.statistic[part]
        cores = []
        for hand in hands:
            link = links.toucher[hand[0]]
            ways = [links.way(link, other) for other in links.toucher.values() if other != link]
            # The joints nearest to the hand that no other hand has.
            own = order_of(min(ways, key=len))
            own = own[: max(3, len(own) // 2)]
            cores.append(sorted(sorted(own, key=lambda j: -statistic[j].max())[:3]))
        share = who_touched(self.search.q, group, cores)
        sure = [self._sure(share, limb) for limb in range(len(cores))]
        most = int(np.argmax([np.sum(of_one) for of_one in sure]))
        rows = group.rows[sure[most]]
        one = Group.of(rows, self.scene.target[rows])
        if one.num_kernels < 8:
            return hands[most], group
        return hands[most], one

    def _dense(self, part: int, number: int) -> Group:
        """All touches of some kernels of a part, so many or a few more."""
        rows = self.rows[part]
        target = self.scene.target[rows]
        kernels = self.search.random.permutation(np.unique(target))
        total = np.cumsum(np.bincount(target)[kernels])
        kept = kernels[: max(8, int(np.searchsorted(total, number)) + 1)]
        rows = rows[np.isin(target, kept)]
        return Group.of(rows, self.scene.target[rows])

    def _with_all_hands(self, body: Mechanism, part: int) -> Mechanism:
        """The body with every toucher that may have touched the part."""
        pairs = [pair for pair in body.pairs if pair[0] != part]
        touchers = body.links.reaching(body.links.part[part])
        return replace(body, pairs=(*pairs, *((part, u) for u in touchers)))

    @cached_property
    def _training(self) -> Scene:
        return self.scene.some(np.sort(np.concatenate(list(self.rows.values()))))

    def bundled(self, body: Mechanism) -> Mechanism:
        """The body after a few steps of least squares over all its parts."""
        parts = set(body.links.part)
        rows = [
            self.search.random.permutation(self.rows[p])[: _BUNDLED // len(parts)] for p in parts
        ]
        scene = replace(self.scene.some(np.sort(np.concatenate(rows))), ways=body.ways())
        solution = started(scene, body.twists, body.points)
        solution = refined(scene, solution, steps=6, tick=self.search.tick)
        return replace(body, twists=solution.twists, points=solution.points)


def _one_body(own: Scene, solution: Solution, part: int) -> Bodies:
    """The chain of touches of a part by one hand, as a search has it."""
    loss = solution.criterion[[part]][None]
    return Bodies([[own.ways[part, 0]]], solution.twists[None], solution.points[None], loss)
