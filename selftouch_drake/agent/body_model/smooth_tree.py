"""A tree from few touches: other parts join the limbs that were found on one part.

A chain to one part may bend its skin without a trace: wrong orders of neighbours explain as much as
the right one. Where several parts are touched through the same joints, they leave nothing to bend.
So all parts are made smooth at once, while orders of joints and links of parts compete.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.few import FEWEST, SEARCHED_NOISE
from selftouch_drake.agent.body_model.fit import Bodies, Descent, Smooth, Way, random_twists
from selftouch_drake.agent.body_model.forest import Links, Mechanism
from selftouch_drake.agent.body_model.smoothness import Sensed
from selftouch_drake.agent.body_model.structure import Search, order_of

#: Stands for the hand of touches of which nobody knows who made them: one hand did.
UNTOLD = -1
# Touches of each part by a hand that are looked at, and how often others are if no part joins.
_LOOKED_AT, _DRAWN = 200, 2
# Another arrangement is taken if it is better by this much, or with a joint more if touches of each
# part by each hand are by more, and so often at most; if none is, more twists are drawn so often.
_GAIN, _EARNED, _MOST_PASSES, _IDLE = 0.1, 0.3, 20, 3
# All neighbours of an arrangement have so many steps, and so many of the best ones more.
_FIRST, _BEST = Descent(steps=100), 10
# A part is tried if the criterion of its touches is lower, and joins if it becomes smooth. At 0
# places are as smooth as draws of the process: parts of right infants had -3.7 to 0.9, and on
# wrong joints 1.6 and more.
_JOINS, _SMOOTH = 5.0, 1.0
#: A tree is well made if the criterion of the worst touches by one hand on one part is lower: that
#: of right infants was -2.4 to 0.8, of wrong ones 2.7 and more.
WELL_MADE = 1.5
# A way has so many joints at least, to touch all of a part.
_FEWEST_JOINTS = 3
# Joints that may move a part alone, at most, and random starts of each order of these.
_MOST_OWN, _STARTS = 3, 10


@dataclass(frozen=True, slots=True)
class Touched:
    """Touches of a part that waits for its place.

    Attributes:
        rows: of each limb whose hand made some, `(n,)` in any order; all of `UNTOLD`, if hands were
            not told apart.
        new: joints of no limb that matter to these touches, so that they may move the part alone.
        alone: those of them that matter to touches by several hands, so that no limb has them.
    """

    rows: dict[int, np.ndarray]
    new: list[int] = field(default_factory=list)
    alone: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a part is.

    Attributes:
        limb: the limb that wears it.
        behind: joints of that limb between the first part and it; 0: it is beside the first one.
        own: joints that move it alone, from it to the limb.
    """

    limb: int = 0
    behind: int = 0
    own: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class _Arrangement:
    """Limbs that leave the first part, and what they wear.

    Attributes:
        orders: joints of each limb, from the first part outwards.
        worn: where each part is, the first one first.
        touched: pairs of a part and the limb whose hand touched it.
    """

    orders: tuple[tuple[int, ...], ...]
    worn: dict[int, _Place]
    touched: tuple[tuple[int, int], ...]

    def way(self, part: int, hand: int) -> Way:
        """From a part to a hand."""
        place, order = self.worn[part], self.orders[hand]
        own = tuple((joint, 1) for joint in place.own)
        if hand == place.limb:
            return (*own, *((joint, 1) for joint in order[place.behind :]))
        back = self.orders[place.limb][: place.behind][::-1]
        return (*own, *((joint, -1) for joint in back), *((joint, 1) for joint in order))

    def places(self) -> list[_Place]:
        """Links that may wear a part."""
        behind = [
            _Place(limb, number + 1)
            for limb, order in enumerate(self.orders)
            for number in range(len(order))
        ]
        return [_Place(), *behind]

    def with_part(self, part: int, place: _Place, hands: Iterable[int]) -> "_Arrangement":
        """One more part."""
        pairs = tuple((part, hand) for hand in hands)
        return replace(self, worn={**self.worn, part: place}, touched=(*self.touched, *pairs))

    def reached(self, part: int) -> bool:
        """Whether hands that touched a part have joints enough for that."""
        hands = (hand for other, hand in self.touched if other == part)
        return all(len(self.way(part, hand)) >= _FEWEST_JOINTS for hand in hands)

    def near(
        self, spare: Iterable[int], *, wide: bool
    ) -> list[tuple["_Arrangement", list[int], float]]:
        """This one, and those with one joint or part moved, or one joint more or less.

        Each with joints whose twists are to be drawn anew, and how much better it has to be.

        Args:
            spare: joints that the arrangement does not have.
            wide: draw anew whatever a joint passes, too.
        """
        others = [*self._with_a_joint_moved(wide), *self._with_a_joint_more(spare)]
        others += self._with_a_part_moved()
        reached = [one for one in others if all(map(one[0].reached, self.worn))]
        return [(self, [], 0.0), *reached]

    def _with_a_joint_moved(self, wide: bool) -> Iterator[tuple["_Arrangement", list[int], float]]:
        for limb, order in enumerate(self.orders):
            for changed, joint in _moved(order):
                moved = self._with_order(limb, changed)
                # Parts that it passes keep the number of joints before them, or these joints.
                variants = _each_once([moved, *moved.kept(self, limb, joint)])
                ends = sorted((order.index(joint), changed.index(joint)))
                passed = list(order[ends[0] : ends[1] + 1])
                yield from ((one, passed if wide else [joint], _GAIN) for one in variants)
                if len(passed) == 2:
                    # Neighbours that change places may keep their axes where they stand.
                    yield from ((one, [], _GAIN) for one in variants)
        for part, place in self._others():
            for own in itertools.permutations(place.own) if place.own else ():
                yield self._with_place(part, replace(place, own=own)), list(own), _GAIN

    def _with_a_joint_more(
        self, spare: Iterable[int]
    ) -> Iterator[tuple["_Arrangement", list[int], float]]:
        """And with one less of those that move a part alone."""
        for joint in spare:
            for limb, order in enumerate(self.orders):
                for number in range(len(order) + 1):
                    longer = self._with_order(limb, (*order[:number], joint, *order[number:]))
                    for one in longer.kept(self, limb, joint):
                        yield one, [joint], _EARNED * len(self.touched)
        for part, place in self._others():
            pairs = sum(other == part for other, _ in self.touched)
            for joint in place.own:
                own = tuple(other for other in place.own if other != joint)
                yield self._with_place(part, replace(place, own=own)), [], -_EARNED * pairs

    def _with_a_part_moved(self) -> Iterator[tuple["_Arrangement", list[int], float]]:
        for part, place in self._others():
            for there in self.places():
                there = replace(there, own=place.own)
                # All limbs leave the link of the first part.
                near = there.limb == place.limb or 0 in (there.behind, place.behind)
                if there != place and near:
                    yield self._with_place(part, there), [], _GAIN

    def _others(self) -> list[tuple[int, _Place]]:
        """All parts but the first, and where they are."""
        return list(self.worn.items())[1:]

    def joints(self) -> list[int]:
        """All of the arrangement."""
        owns = (place.own for place in self.worn.values())
        return list(itertools.chain(*self.orders, *owns))

    def _with_place(self, part: int, place: _Place) -> "_Arrangement":
        return replace(self, worn={**self.worn, part: place})

    def _with_order(self, limb: int, order: tuple[int, ...]) -> "_Arrangement":
        return replace(self, orders=(*self.orders[:limb], order, *self.orders[limb + 1 :]))

    def kept(self, before: "_Arrangement", limb: int, joint: int) -> Iterator["_Arrangement"]:
        """This one with parts behind the joints that they were behind, but for one joint.

        Parts beside that joint may be on either side of it.

        Args:
            before: where they were.
            limb: in which the joint moved.
            joint: that moved.
        """
        order = self.orders[limb]
        worn, beside = dict(self.worn), list[int]()
        for part, place in before.worn.items():
            if place.limb == limb and place.behind:
                between = set(before.orders[limb][: place.behind]) - {joint}
                behind = max((order.index(other) + 1 for other in between), default=0)
                worn[part] = replace(place, limb=limb if behind else 0, behind=behind)
                if behind < len(order) and order[behind] == joint:
                    beside.append(part)
        for number in range(len(beside) + 1):
            for some in itertools.combinations(beside, number):
                moved = {
                    part: replace(worn[part], limb=limb, behind=worn[part].behind + 1)
                    for part in some
                }
                yield replace(self, worn={**worn, **moved})


def _each_once(arrangements: Sequence[_Arrangement]) -> list[_Arrangement]:
    return [one for number, one in enumerate(arrangements) if one not in arrangements[:number]]


def _moved(order: tuple[int, ...]) -> list[tuple[tuple[int, ...], int]]:
    """Orders with one joint elsewhere, and that joint; each where it is, too."""
    found = [(order, joint) for joint in order]
    for joint in order:
        rest = [other for other in order if other != joint]
        for place in range(len(order)):
            changed = (*rest[:place], joint, *rest[place:])
            if changed != order:
                found.append((changed, joint))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Tree:
    """An arrangement with its parameters.

    Attributes:
        arrangement: orders, and where parts are.
        body: one, whose ways are those of the arrangement.
        groups: touches of each pair that touched.
    """

    arrangement: _Arrangement
    body: Bodies
    groups: list[Smooth]

    def loss_of(self, part: int) -> float:
        """The criterion of a part's worst touches by one hand."""
        own = [number for number, pair in enumerate(self.arrangement.touched) if pair[0] == part]
        return float(self.body.loss[0, own].max())

    def worst(self) -> float:
        """The criterion of the worst touches by one hand on one part."""
        return float(self.body.loss.max())


def with_parts(
    search: Search,
    sensation: csr_array,
    others: dict[int, Touched],
    body: Mechanism,
    own: Sequence[np.ndarray],
    moving: Sequence[int],
) -> tuple[float, Mechanism]:
    """The body of limbs found on one part, with other parts that its hands touched.

    And the criterion of its worst touches by one hand on one part.

    Args:
        search: what to work on.
        sensation: `(n, S)` readings of the receptors.
        others: the other parts.
        body: limbs that leave one part.
        own: touches of that part by each hand.
        moving: joints that move.
    """
    alone = {joint for part in others.values() for joint in part.alone}
    fit = _Fit(search, sensation, [joint for joint in moving if joint not in alone])
    tree = fit.improved(_begun(fit, body, own))
    if tree.worst() >= _JOINS:
        # Even wrong orders make one part smooth: these are no chains of rigid links.
        return tree.worst(), _mechanism(tree)
    in_vain = 0
    while in_vain < _DRAWN:
        # Touches are drawn anew each time: a few of another hand make a part rough.
        bigger = _with_one(fit, tree, fit.waiting(others, tree))
        in_vain = in_vain + 1 if bigger is None else 0
        tree = bigger or tree
    if len(tree.arrangement.worn) > 1:
        # Only now do all parts tell.
        tree = fit.improved(tree, idle=_IDLE)
    return tree.worst(), _mechanism(tree)


def _with_one(
    fit: "_Fit", tree: _Tree, waiting: dict[int, tuple[dict[int, Smooth], list[int]]]
) -> _Tree | None:
    """The tree with one more part; None if no waiting one becomes smooth.

    Args:
        fit: what to work with.
        tree: so far.
        waiting: of each part its touches by each hand, and joints that may move it alone.
    """
    # Where hands were told apart joints may move the part alone: that is asked of a sharp body.
    for told in (False, True):
        tried = [
            fit.best_place(tree, part, its, new)
            for part, (its, new) in sorted(waiting.items())
            if told == (UNTOLD not in its)
        ]
        for loss, part, bigger in sorted(tried, key=lambda one: one[0]):
            if loss < _JOINS:
                # If it stays rough, joints are in wrong orders, which other parts may tell first.
                # On a wrong link it bends what was smooth.
                improved = fit.improved(bigger)
                kept = improved.worst() < max(WELL_MADE, tree.worst())
                if kept and improved.loss_of(part) < _SMOOTH:
                    return improved
    return None


def _begun(fit: "_Fit", body: Mechanism, own: Sequence[np.ndarray]) -> _Tree:
    """The limbs that leave one part."""
    (first,) = body.links.part
    base, ends = body.links.part[first], body.links.toucher
    hands = range(len(own))
    orders = tuple(tuple(order_of(body.links.way(base, ends[hand]))) for hand in hands)
    pairs = tuple((first, hand) for hand in hands)
    loss = np.full((1, len(own)), np.inf)
    return _Tree(
        _Arrangement(orders, {first: _Place()}, pairs),
        Bodies([[]], body.twists[None], body.points[None], loss),
        [fit.group(rows) for rows in own],
    )


@dataclass(frozen=True, slots=True)
class _Fit:
    """Fits of trees to what was felt.

    Attributes:
        search: what to work on.
        sensation: `(n, S)` readings of the receptors.
        of_limbs: joints that limbs may have.
    """

    search: Search
    sensation: csr_array
    of_limbs: Sequence[int]

    def group(self, rows: np.ndarray) -> Smooth:
        """Some touches of a part by a hand."""
        some = np.sort(self.search.random.permutation(rows)[:_LOOKED_AT])
        return Smooth(some, Sensed.of(self.sensation[some]).precision(SEARCHED_NOISE))

    def waiting(
        self, others: dict[int, Touched], tree: _Tree
    ) -> dict[int, tuple[dict[int, Smooth], list[int]]]:
        """Of each part that a tree lacks some touches by each hand, and joints that may move it."""
        found = {}
        for part, touched in others.items():
            rows = {hand: its for hand, its in touched.rows.items() if len(its) >= FEWEST}
            if rows and part not in tree.arrangement.worn:
                found[part] = {hand: self.group(its) for hand, its in rows.items()}, touched.new
        return found

    def improved(self, tree: _Tree, idle: int = 1) -> _Tree:
        """The best tree that steps from one arrangement to the next lead to.

        Args:
            tree: where it begins.
            idle: so often in a row no better one must be found.
        """
        arrangement, body, in_vain = tree.arrangement, tree.body, 0
        hands = [hand for _, hand in arrangement.touched]
        for _ in range(_MOST_PASSES):
            known = arrangement.joints()
            spare = [joint for joint in self.of_limbs if joint not in known]
            near = arrangement.near(spare, wide=in_vain > 0)
            bodies = body.pick(np.zeros(len(near), dtype=int))
            for number, (one, fresh, _) in enumerate(near):
                bodies.ways[number] = [one.way(*pair) for pair in one.touched]
                bodies.twists[number, fresh] = self._drawn(len(fresh))
            order, last = self._best(tree.groups, bodies, hands)
            cost = last.loss.sum(axis=1) + [near[number][2] for number in order]
            best = int(np.argmin(cost))
            arrangement, body = near[order[best]][0], last.pick([best])
            in_vain = in_vain + 1 if best == 0 else 0
            # Where something is rough yet, the right twist may not have been drawn.
            if in_vain >= (idle if body.loss.max() < _SMOOTH else _IDLE):
                break
        return _Tree(arrangement, body, tree.groups)

    def best_place(
        self, tree: _Tree, part: int, groups: dict[int, Smooth], new: Sequence[int]
    ) -> tuple[float, int, _Tree]:
        """Where touches of a part are smoothest: their criterion, the part, and the bigger tree.

        Args:
            tree: without the part.
            part: which part.
            groups: its touches by each hand; of `UNTOLD` any hand may have made all.
            new: joints that may move it alone, if hands were told apart.
        """
        if UNTOLD in groups:
            hands = range(len(tree.arrangement.orders))
            tried = [self._tried(tree, part, {hand: groups[UNTOLD]}, [()]) for hand in hands]
            return min(tried, key=lambda one: one[0])
        # Those that hardly move the part seem to matter to none of its touches.
        known, movable = tree.arrangement.joints(), sorted({*self.of_limbs, *new})
        left = [joint for joint in movable if joint not in known]
        if len(left) > _MOST_OWN:
            left = [joint for joint in left if joint in new]
        owns = _orders_of_some(left)
        return self._tried(tree, part, groups, owns)

    def _tried(
        self,
        tree: _Tree,
        part: int,
        groups: dict[int, Smooth],
        owns: Sequence[tuple[int, ...]],
    ) -> tuple[float, int, _Tree]:
        """The same, for hands that are known and given joints that move the part alone."""
        before = tree.arrangement
        arrangements = [
            before.with_part(part, replace(place, own=own), groups)
            for own in owns
            for place in before.places()
            for _ in range(_STARTS if own else 1)
        ]
        arrangements = [one for one in arrangements if one.reached(part)]
        if not arrangements:
            return np.inf, part, tree
        bodies = tree.body.pick(np.zeros(len(arrangements), dtype=int))
        bodies = replace(bodies, loss=np.full((len(arrangements), len(groups)), np.inf))
        for number, one in enumerate(arrangements):
            own = list(one.worn[part].own)
            bodies.ways[number] = [one.way(part, hand) for hand in groups]
            bodies.twists[number, own] = self._drawn(len(own))
        # Where the part brings joints of its own, all others stay.
        fixed = before.joints() if any(owns) else ()
        order, fitted = self._best(list(groups.values()), bodies, list(groups), fixed=fixed)
        # As joints of limbs do, each of its own has to earn itself.
        loss = fitted.loss.mean(axis=1)
        earned = [_EARNED * len(arrangements[number].worn[part].own) for number in order]
        best = int(np.argmin(loss + earned))
        # Else the fit left the frame of the body, and brings nothing to it.
        body = fitted.pick([best]) if fixed else bodies.pick([order[best]])
        bigger = _Tree(arrangements[order[best]], body, [*tree.groups, *groups.values()])
        return float(loss[best]), part, bigger

    def _best(
        self, groups: Sequence[Smooth], bodies: Bodies, hands: Sequence[int], **more
    ) -> tuple[np.ndarray, Bodies]:
        """Numbers of the first and of the best other bodies, and these after a long descent."""
        first = self.search.descended(groups, bodies, _FIRST, touchers=hands, **more)
        order = np.argsort(first.loss[1:].sum(axis=1), kind="stable")[:_BEST] + 1
        order = np.concatenate([[0], order])
        picked = first.pick(order)
        return order, self.search.descended(groups, picked, Descent(), touchers=hands, **more)

    def _drawn(self, number: int) -> np.ndarray:
        """Twists drawn anew."""
        return 0.6 * random_twists(self.search.random, number)


def _orders_of_some(joints: Sequence[int]) -> list[tuple[int, ...]]:
    """All orders of all of some joints, none of them among these."""
    if len(joints) > _MOST_OWN:
        return [()]
    numbers = range(len(joints) + 1)
    return [own for number in numbers for own in itertools.permutations(joints, number)]


def _mechanism(tree: _Tree) -> Mechanism:
    """The same with a tree of links."""
    arrangement, links = tree.arrangement, Links({}, 1, {}, {})
    carrying = dict[tuple[int, int], int]()
    for limb, order in enumerate(arrangement.orders):
        end = carrying[limb, 0] = 0
        for number, joint in enumerate(order, start=1):
            links, end = links.extended(end, [joint], forwards=True)
            carrying[limb, number] = end
        links = replace(links, toucher={**links.toucher, limb: end})
    for part, place in arrangement.worn.items():
        links = links.with_part(part, carrying[place.limb, place.behind], place.own)
    return Mechanism(links, tree.body.twists[0], tree.body.points[0], arrangement.touched)
