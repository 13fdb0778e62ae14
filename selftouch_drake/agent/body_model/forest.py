"""One tree from chains: skins hung where they fit, hands and joints added one after another."""

import itertools
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.fit import Bodies, Descent, Group, Way, random_twists
from selftouch_drake.agent.body_model.model import BASE
from selftouch_drake.agent.body_model.scene import (
    Scene,
    Solution,
    all_places,
    away_from_kernels,
    kernel_medians,
    neighbour_distance,
)
from selftouch_drake.agent.body_model.structure import Search
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.who_touched import started

# Touches on which hypotheses of where a part hangs compete.
_HUNG = 2500
# A toucher of a part makes at least this share of its touches.
_FEWEST = 0.03
# More touchers must explain so many more touches, at least: of n touches a share of 1 / sqrt(n).
# Without that, a forearm's own hand earned 0.04 of 99 touches of the other one's.
_EARNED = 0.03
# One that comes later than a part, besides, so many of those that are not explained yet: of these,
# wrong joints explain some by chance.
_LATE = 0.5
# Kernels that two chains from one part must share to be joined, and touches of the second that the
# two must explain.
_KERNELS_OF_BOTH, _BRANCHES = 8, 0.3
# Joints that a hypothesis may have too many or too few, compared with a chain found alone.
_APART = 2
# Hypotheses that are fitted to their end.
_FITTED = 8
# Neighbours that nearly commute may change places where a part hangs between them: the bracket of
# their twists, relative to their sizes. Whether they do is left to the touches.
_COMMUTE = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """A tree without a root: links joined by joints, and what they carry.

    Attributes:
        ends: of each joint, the links on its two sides; a way from the first to the second passes
            it forwards.
        number: of links.
        part: the link of each part.
        toucher: the link of each toucher.
    """

    ends: dict[int, tuple[int, int]]
    number: int
    part: dict[int, int]
    toucher: dict[int, int]

    @staticmethod
    def of_chain(way: Way, part: int, num_touchers: int = 1) -> "Links":
        """A part at one end of a chain, touchers at the other."""
        ends = {joint: (index, index + 1) for index, (joint, _) in enumerate(way)}
        touchers = dict.fromkeys(range(num_touchers), len(way))
        return Links(ends, len(way) + 1, {part: 0}, touchers)

    def way(self, start: int, end: int) -> Way:
        """From one link to another."""
        near: dict[int, list[tuple[int, int, int]]] = {}
        for joint, (a, b) in self.ends.items():
            near.setdefault(a, []).append((b, joint, 1))
            near.setdefault(b, []).append((a, joint, -1))
        pile: list[tuple[int, Way, int]] = [(start, (), -1)]
        while pile:
            link, way, before = pile.pop()
            if link == end:
                return way
            for other, joint, sign in near.get(link, []):
                if other != before:
                    pile.append((other, (*way, (joint, sign)), link))
        raise ValueError(f"links {start} and {end} are not joined")

    def hands(self, touchers: Iterable[int]) -> list[list[int]]:
        """Touchers by the link that carries them."""
        by_link: dict[int, list[int]] = {}
        for toucher in touchers:
            by_link.setdefault(self.toucher[toucher], []).append(toucher)
        return list(by_link.values())

    def ways_to(self, part: int, link: int, touchers: Iterable[int]) -> dict[tuple[int, int], Way]:
        """Ways of touchers to a part, if a link wears it."""
        return {(part, u): self.way(link, self.toucher[u]) for u in touchers}

    def reaching(self, link: int) -> list[int]:
        """Touchers that have joints enough on their way to touch all of a part on a link."""
        return [u for u, other in self.toucher.items() if len(self.way(link, other)) >= 3]

    def extended(self, link: int, joints: Sequence[int], *, forwards: bool) -> tuple["Links", int]:
        """More joints in a row from a link on; and the link at their end.

        Args:
            link: where they begin.
            joints: in the order from there.
            forwards: whether a way outwards passes them forwards.
        """
        ends, number = dict(self.ends), self.number
        for joint in joints:
            ends[joint] = (link, number) if forwards else (number, link)
            link, number = number, number + 1
        return replace(self, ends=ends, number=number), link

    def with_part(self, part: int, link: int, joints: Sequence[int]) -> "Links":
        """One more part, behind joints that lead from it to a link."""
        links, skin = self.extended(link, joints[::-1], forwards=False)
        return replace(links, part={**links.part, part: skin})

    def rooted(self, root: int) -> Tree:
        """The same as a rooted tree: the joint of a link is the one that carries it."""
        parent: dict[int, int] = {}
        joint_of, pile = {root: BASE}, [root]
        while pile:
            link = pile.pop()
            for joint, (a, b) in self.ends.items():
                if link in (a, b) and joint not in parent and joint != joint_of[link]:
                    other = b if link == a else a
                    parent[joint] = joint_of[link]
                    joint_of[other] = joint
                    pile.append(other)
        return Tree(
            parent,
            {part: joint_of[link] for part, link in self.part.items()},
            {toucher: joint_of[link] for toucher, link in self.toucher.items()},
        )

    def backwards(self, root: int) -> list[int]:
        """Joints that a way outwards from a root passes backwards."""
        turned = []
        for joint, (a, b) in self.ends.items():
            if len(self.way(root, a)) > len(self.way(root, b)):
                turned.append(joint)
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """A tree with its parameters.

    Attributes:
        links: the tree.
        twists: `(J, 6)` for standardised readings.
        points: `(U, 3)` touchers.
        pairs: pairs of part and toucher that touch.
    """

    links: Links
    twists: np.ndarray
    points: np.ndarray
    pairs: tuple[tuple[int, int], ...]

    def ways(self) -> dict[tuple[int, int], Way]:
        """Ways of all pairs."""
        links = self.links
        return {(p, u): links.way(links.part[p], links.toucher[u]) for p, u in self.pairs}


def explained(scene: Scene, solution: Solution, part: int, *, of_known: bool = True) -> float:
    """Share of a part's touches nearer to their own kernel than kernels lie to each other.

    Args:
        scene: touches.
        solution: of these.
        part: which part.
        of_known: only touches of kernels whose places are known count.
    """
    near, known = near_own(scene, solution, part)
    return float(near.sum() / max(known.sum() if of_known else len(known), 1))


def near_own(scene: Scene, solution: Solution, part: int) -> tuple[np.ndarray, np.ndarray]:
    """Which touches of a part are nearer to their own kernel than kernels lie to each other.

    Both `(n,)` bool, of the part's rows; the second is where the place of the kernel is known.
    Arguments are those of `explained`.
    """
    rows = scene.rows(part)
    touchers = scene.touchers(part)
    Y = all_places(scene, solution.twists, solution.points)[touchers][:, rows]
    target = scene.target[rows]
    own = solution.share[np.ix_(rows, touchers)]
    y = Y[own.argmax(axis=1), np.arange(len(rows))]
    y[own.sum(axis=1) < 0.5] = np.nan
    middle = kernel_medians(y, target, len(scene.part), least=4)
    found = np.isfinite(middle).all(axis=1)
    known = found[target]
    if found.sum() < 8:
        return np.zeros(len(rows), dtype=bool), known
    apart = neighbour_distance(middle[found])
    return away_from_kernels(Y, middle, target) < apart, known


def dense_rows(
    target: np.ndarray, rows: np.ndarray, random: np.random.Generator, most: int = _HUNG
) -> np.ndarray:
    """Touches of some kernels, many of each: what a judgement of kernels needs."""
    kernels = random.permutation(np.unique(target[rows]))
    count = np.bincount(target[rows])
    size = max(8, min(40, most // max(len(kernels), 1)))
    kept = kernels[: max(20, most // size)]
    picked = [
        random.permutation(rows[target[rows] == kernel])[:size]
        for kernel in kept
        if count[kernel] >= 5
    ]
    return np.sort(np.concatenate(picked)) if picked else rows[:0]


def places_of_parts(body: Mechanism) -> list[tuple[int, Mechanism]]:
    """Links that may wear a part, each with the body of which it is one."""
    return [(link, body) for link in range(body.links.number)] + swapped(body)


def swapped(body: Mechanism) -> list[tuple[int, Mechanism]]:
    """Bodies in which two neighbours that nearly commute change places, with the link between.

    Nothing that the body carries yet tells their order, as with two shoulders on one axis: a part
    that hangs between them will.
    """
    links, found = body.links, []
    carrying = {*links.part.values(), *links.toucher.values()}
    for link in range(links.number):
        around = [joint for joint, ends in links.ends.items() if link in ends]
        if link in carrying or len(around) != 2:
            continue
        one, other = around
        if not _nearly_commute(body.twists, list(links.ends), one, other):
            continue
        ends = dict(links.ends)
        (a, b), (c, d) = ends[one], ends[other]
        # Along the way through the link: each joint is passed as it was before.
        before, after = (a if b == link else b), (d if c == link else c)
        ends[other] = (before, link) if c == link else (link, before)
        ends[one] = (link, after) if b == link else (after, link)
        found.append((link, replace(body, links=replace(links, ends=ends))))
    return found


def _nearly_commute(twists: np.ndarray, joints: list[int], one: int, other: int) -> bool:
    """Whether two joints' order makes little difference, measured in the size of the body."""
    turning = [j for j in joints if np.linalg.norm(twists[j, :3]) > 1e-6]
    w, v = twists[turning, :3], twists[turning, 3:]
    feet = np.cross(w, v) / (w**2).sum(axis=1, keepdims=True)
    motion = np.eye(4)
    motion[:3, 3] = -feet.mean(axis=0)
    size = max(np.sqrt(((feet - feet.mean(axis=0)) ** 2).sum(axis=1).mean()), 1e-9)
    (w, v), (x, y) = (np.split(adjoint(motion, twists[j]), 2) for j in (one, other))
    bracket = np.r_[np.cross(w, x), (np.cross(w, y) - np.cross(x, v)) / size]
    amount = [np.linalg.norm(np.r_[t[0], t[1] / size]) for t in ((w, v), (x, y))]
    return bool(np.linalg.norm(bracket) < _COMMUTE * amount[0] * amount[1])


def hung(
    scene: Scene, body: Mechanism, part: int, random: np.random.Generator
) -> tuple[float, Mechanism] | None:
    """The body with one more part, where that explains most touches; nothing is fitted.

    Args:
        scene: touches; its ways are not read.
        body: a tree without the part.
        part: to be hung.
        random: which touches hypotheses compete on.

    Returns:
        The share of touches that is explained, and the body; None if no link will do.
    """
    some = scene.some(dense_rows(scene.target, scene.rows(part), random))
    if len(some.q) == 0:
        return None
    found = (_hung_there(some, one, part, link) for link, one in places_of_parts(body))
    return max((one for one in found if one), key=lambda one: one[0], default=None)


def _hung_there(
    some: Scene, body: Mechanism, part: int, link: int
) -> tuple[float, Mechanism] | None:
    """The same on one link."""
    best: tuple[float, Mechanism] | None = None
    earned = max(_EARNED, len(some.q) ** -0.5)
    links = body.links
    hands = links.hands(sorted(links.reaching(link)))
    while hands:
        touchers = sorted(itertools.chain(*hands))
        there = replace(links, part={**links.part, part: link})
        tried = replace(some, ways=links.ways_to(part, link, touchers))
        solution = started(tried, body.twists, body.points)
        value = explained(tried, solution, part) - earned * (len(hands) - 1)
        if best is None or value > best[0]:
            pairs = (*body.pairs, *((part, u) for u in touchers))
            best = value, replace(body, links=there, pairs=pairs)
        if len(hands) == 1:
            break
        # Without the one that touches least; and each alone, if there are two.
        share = [solution.frequency[part][hand].sum() for hand in hands]
        hands.pop(int(np.argmin(share)))
    return best


def with_late_touchers(scene: Scene, body: Mechanism, random: np.random.Generator) -> Mechanism:
    """The body in which touchers that came later than a part touch it, where that explains more.

    Where each kernel of a part is touched by one hand alone, half of them are enough to hang it,
    before the other hand is known.

    Args:
        scene: touches; its ways are not read.
        body: the tree.
        random: which touches are looked at.
    """
    links = body.links
    for part, link in links.part.items():
        own = [u for p, u in body.pairs if p == part]
        late = links.hands(u for u in links.reaching(link) if u not in own)
        if not late:
            continue
        some = scene.some(dense_rows(scene.target, scene.rows(part), random))
        before = _covered(some, body, part, own)
        for hand in late:
            after = _covered(some, body, part, [*own, *hand])
            if after > before + max(_EARNED, _LATE * (1.0 - before)):
                own, before = [*own, *hand], after
                body = replace(body, pairs=(*body.pairs, *((part, u) for u in hand)))
    return body


def _covered(some: Scene, body: Mechanism, part: int, touchers: list[int]) -> float:
    """Share of all touches of a part that are explained if these touchers made them."""
    links = body.links
    tried = replace(some, ways=links.ways_to(part, links.part[part], touchers))
    return explained(tried, started(tried, body.twists, body.points), part, of_known=False)


def robust_similarity(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """`(4, 4)` the similarity, maybe a mirror image, that brings points to others; robust."""
    kept = np.arange(len(found))
    motion = np.eye(4)
    for _ in range(6):
        a, b = found[kept], wanted[kept]
        u, s, vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
        scale = s.sum() / ((a - a.mean(axis=0)) ** 2).sum()
        motion[:3, :3] = scale * (u @ vt).T
        motion[:3, 3] = b.mean(axis=0) - motion[:3, :3] @ a.mean(axis=0)
        away = np.linalg.norm(found @ motion[:3, :3].T + motion[:3, 3] - wanted, axis=1)
        kept = np.flatnonzero(away <= 2.5 * np.median(away) + 1e-12)
    return motion


def twist_similarity(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """`(4, 4)` the similarity that brings twists to others, maybe mirrored; least squares."""
    u, _, vt = np.linalg.svd(found[:, :3].T @ wanted[:, :3])
    turn = (u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt).T
    # v of the others is scale * turn @ v + offset x w; a negative scale is a mirror image.
    w = wanted[:, :3]
    zero = np.zeros(len(w))
    crossed = np.stack(
        [
            np.stack([zero, w[:, 2], -w[:, 1]], axis=1),
            np.stack([-w[:, 2], zero, w[:, 0]], axis=1),
            np.stack([w[:, 1], -w[:, 0], zero], axis=1),
        ],
        axis=1,
    )
    table = np.concatenate([(found[:, 3:] @ turn.T)[:, :, None], crossed], axis=2).reshape(-1, 4)
    scale, *offset = np.linalg.lstsq(table, wanted[:, 3:].ravel(), rcond=None)[0]
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = scale * turn, offset
    return motion


def joined(scene: Scene, part: int, limbs: Sequence[tuple[Bodies, np.ndarray]]) -> Mechanism:
    """One body of several chains from one part, brought to common places of its kernels.

    Chains may share joints: each leaves the body where that explains most of its touches.

    Args:
        scene: touches; its ways are not read.
        part: that all chains begin at.
        limbs: chains, the sharpest first, each with the touches that it was fitted to.
    """
    (first, rows), *others = limbs
    links = Links.of_chain(first.ways[0][0], part, first.points.shape[1])
    pairs = tuple((part, toucher) for toucher in links.toucher)
    body = Mechanism(links, first.twists[0].copy(), first.points[0], pairs)
    places = _medians(scene, first, rows)
    for chain, its_rows in others:
        its = _medians(scene, chain, its_rows)
        both = np.isfinite(places).all(axis=1) & np.isfinite(its).all(axis=1)
        if both.sum() < _KERNELS_OF_BOTH:
            continue
        motion = robust_similarity(its[both], places[both])
        trials = [
            _branched(scene.some(its_rows), body, part, chain, motion, link)
            for link in range(body.links.number)
        ]
        share, best = max(trials, key=lambda trial: trial[0])
        if share > _BRANCHES:
            body = best
    return body


def _branched(
    own: Scene, body: Mechanism, part: int, chain: Bodies, motion: np.ndarray, link: int
) -> tuple[float, Mechanism]:
    """The body with a chain that leaves it at a link, and the share of the chain's touches."""
    joints = [joint for joint, _ in chain.ways[0][0] if joint not in body.links.ends]
    links, end = body.links.extended(link, joints, forwards=True)
    new = range(len(body.points), len(body.points) + chain.points.shape[1])
    links = replace(links, toucher={**links.toucher, **dict.fromkeys(new, end)})
    twists = body.twists.copy()
    twists[joints] = adjoint(motion, chain.twists[0, joints])
    there = chain.points[0] @ motion[:3, :3].T + motion[:3, 3]
    pairs = (*body.pairs, *((part, toucher) for toucher in new))
    branched = Mechanism(links, twists, np.concatenate([body.points, there]), pairs)
    if len(links.way(links.part[part], end)) < 3:
        return 0.0, branched
    ways = {pair: way for pair, way in branched.ways().items() if pair[1] in new}
    tried = replace(own, ways=ways)
    return explained(tried, started(tried, twists, branched.points), part), branched


def alone(scene: Scene, rows: np.ndarray, part: int, chain: Bodies) -> Scene:
    """Touches of a part by the touchers of one chain."""
    touchers = range(chain.points.shape[1])
    return replace(scene.some(rows), ways={(part, u): chain.ways[0][0] for u in touchers})


def _medians(scene: Scene, chain: Bodies, rows: np.ndarray) -> np.ndarray:
    own = alone(scene, rows, int(scene.part[scene.target[rows[0]]]), chain)
    return started(own, chain.twists[0], chain.points[0]).place


def attached(
    search: Search,
    group: Group,
    body: Mechanism,
    part: int,
    *,
    inner: Sequence[int],
    outer: Sequence[int],
    shared: Sequence[int],
) -> list[Mechanism]:
    """Bodies with a part whose way has joints that the tree does not have yet, best first.

    Args:
        search: what to work on.
        group: touches of the part by one toucher; others are outliers.
        body: the tree so far.
        part: to be added.
        inner: new joints between the tree and the part.
        outer: new joints between the tree and a new toucher; none: a known toucher touched.
        shared: joints of the tree that a chain found alone has.
    """
    links = body.links
    ends = range(links.number) if outer else sorted(set(links.toucher.values()))
    hypotheses = []
    for start, end in itertools.product(range(links.number), ends):
        middle = links.way(start, end)
        joints = {joint for joint, _ in middle}
        if len(joints ^ set(shared)) > _APART:
            continue
        if start == end and not (inner and outer):
            continue
        for first in itertools.permutations(inner):
            for last in itertools.permutations(outer):
                way = (*((j, 1) for j in first), *middle, *((j, 1) for j in last))
                if len(way) >= 3:
                    hypotheses.append((start, end, first, last, way))
    if not hypotheses:
        return []
    random, fresh = search.random, [*inner, *outer]
    repeats = 3 if len(hypotheses) < 60 else 1
    hypotheses = hypotheses * repeats
    bodies = Bodies(
        [[h[4]] for h in hypotheses],
        np.repeat(body.twists[None], len(hypotheses), axis=0),
        np.zeros((len(hypotheses), 1, 3)),
        np.full((len(hypotheses), 1), np.inf),
    )
    size = np.sqrt((body.points**2).sum(axis=1).mean())
    for index, (_, end, _, last, _) in enumerate(hypotheses):
        bodies.twists[index, fresh] = 0.6 * random_twists(random, len(fresh))
        known = [u for u, link in links.toucher.items() if link == end]
        if last or not known:
            bodies.points[index, 0] = body.points.mean(axis=0) + size * random.standard_normal(3)
        else:
            bodies.points[index, 0] = body.points[known[int(random.integers(len(known)))]]
    how = Descent(steps=300, tail=8.0, kernels=30)
    tried = search.descended([group], bodies, how)
    order = _best_of_each([h[:4] for h in hypotheses], tried.loss[:, 0])[:_FITTED]
    tried = search.descended([group], tried.pick(order), replace(how, steps=600, rate=0.02))
    ranked = np.argsort(tried.loss[:, 0], kind="stable")
    return [_with(body, part, hypotheses[order[k]], tried.pick([k])) for k in ranked]


def _best_of_each(hypotheses: Sequence[Hashable], loss: np.ndarray) -> list[int]:
    """The sharpest start of each hypothesis, by number, the sharpest first."""
    best = dict[Hashable, int]()
    for number in np.argsort(loss, kind="stable").tolist():
        best.setdefault(hypotheses[number], number)
    return list(best.values())


def _with(body: Mechanism, part: int, hypothesis, tried: Bodies) -> Mechanism:
    """The body with a part and new joints, whose twists come from a fit of the part alone.

    The fit began in the frame of the body and left it: the joints of both tell the way back.
    """
    start, end, first, last, _ = hypothesis
    links = body.links.with_part(part, start, first)
    links, hand = links.extended(end, last, forwards=True)
    twists, points = body.twists.copy(), body.points
    fresh = [*first, *last]
    both = [joint for joint, _ in hypothesis[4] if joint not in fresh]
    motion = twist_similarity(tried.twists[0, both], body.twists[both])
    twists[fresh] = adjoint(motion, tried.twists[0, fresh])
    point = motion[:3, :3] @ tried.points[0, 0] + motion[:3, 3]
    if last:
        toucher = len(points)
        points = np.concatenate([points, point[None]])
        links = replace(links, toucher={**links.toucher, toucher: hand})
        pairs: tuple[tuple[int, int], ...] = ((part, toucher),)
    else:
        pairs = tuple((part, u) for u, link in body.links.toucher.items() if link == end)
    return Mechanism(links, twists, points, (*body.pairs, *pairs))
