"""What is known tells the rest: where a skin lies the next hand, where a hand is the next skin.

Once the chain of one hand is found, it tells where the kernels of a part lie. Where another hand
touched them, only its own joints are unknown: all that carries the part, up to the link where the
two limbs part, is undone. In whatever frame and scale, its places must then be an affine function
of the known ones, which is the criterion of few touches with another precision. It has hardly any
false optima: of a chain of seven joints all starts found the one body, where kernels without places
led one start in twelve to it.

Likewise a hand of the tree tells where it is when it touches a part behind new joints. Three slides
that read its place stand for all the joints between.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.fit import (
    Bodies,
    Descent,
    Group,
    Smooth,
    Way,
    chain_way,
    random_bodies,
)
from selftouch_drake.agent.body_model.forest import Mechanism, alone, robust_similarity
from selftouch_drake.agent.body_model.scene import (
    Scene,
    all_places,
    away_from_kernels,
    neighbour_distance,
    way_places,
)
from selftouch_drake.agent.body_model.structure import Search, found_chains, order_of
from selftouch_drake.agent.body_model.who_touched import started

# A hand did not make a touch that is so many times farther from its kernel than kernels lie apart.
_FAR = 2.0
# Touches that a search looks at: of 1,500 it takes five times as long, and finds the same.
_LOOKED_AT = 600
# New joints between a tree and a part: so many draws of each order, how large twists begin, how
# they descend, and how many go on.
_DRAWN, _BEGUN, _BEST = 3, 0.6, 6
_DESCENT = Descent(steps=300, tail=8.0, kernels=30)


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What the chain of one hand shows of a part.

    Attributes:
        part: which part.
        chain: from it to the hand.
        place: `(K, 3)` of kernels; NaN where it touched none.
    """

    part: int
    chain: Bodies
    place: np.ndarray

    @staticmethod
    def of(scene: Scene, chain: Bodies, rows: np.ndarray, part: int) -> "Shown":
        """From touches that the hand made."""
        own = alone(scene, rows, part, chain)
        return Shown(part, chain, started(own, chain.twists[0], chain.points[0]).place)

    def by_others(self, scene: Scene, rows: np.ndarray) -> np.ndarray:
        """`(n,)` bool, touches of known kernels that the hand cannot have made."""
        own = alone(scene, rows, self.part, self.chain)
        Y = all_places(own, self.chain.twists[0], self.chain.points[0])
        away = away_from_kernels(Y, self.place, own.target)
        known = np.isfinite(self.place).all(axis=1)
        return away > _FAR * neighbour_distance(self.place[known])

    def chains_to(
        self, search: Search, scene: Scene, rows: np.ndarray, joints: Sequence[int]
    ) -> Iterator[Bodies]:
        """Chains of another hand, in the frame of this one's; whoever asks stops when one is good.

        Args:
            search: what to work on.
            scene: touches; its ways are not read.
            rows: `(n,)` those of the other hand, of known kernels.
            joints: that may matter. Those with which the known chain begins are of both.
        """
        shared = self._shared(joints)
        own = [joint for joint in joints if joint not in order_of(shared)]
        if len(own) < 2:
            return
        some = np.sort(search.random.permutation(rows)[:_LOOKED_AT])
        there = self._undone(scene, some, shared)
        for found in found_chains(search, Smooth(some, _but_affine(there)), own):
            yield self._brought(found, scene, some, there, shared)

    def _shared(self, joints: Sequence[int]) -> Way:
        """The beginning of the known chain that other joints have in common with it."""
        (way,) = self.chain.ways[0]
        other = [k for k, (joint, _) in enumerate(way) if joint not in joints]
        return way[: min(other, default=len(way))]

    def _undone(self, scene: Scene, rows: np.ndarray, shared: Way) -> np.ndarray:
        """`(n, 3)` known places where the limbs part."""
        back = tuple((joint, -sign) for joint, sign in reversed(shared))
        place = self.place[scene.target[rows]]
        return way_places(scene, self.chain.twists[0], place, rows, back)

    def _brought(
        self, found: Bodies, scene: Scene, rows: np.ndarray, there: np.ndarray, shared: Way
    ) -> Bodies:
        """A chain that was found in a frame of its own, from the part on."""
        (way,) = found.ways[0]
        point = found.points[0, 0]
        motion = robust_similarity(way_places(scene, found.twists[0], point, rows, way), there)
        twists, own = self.chain.twists.copy(), order_of(way)
        twists[0, own] = adjoint(motion, found.twists[0, own])
        there = motion[:3, :3] @ point + motion[:3, 3]
        return Bodies([[(*shared, *way)]], twists, there[None, None], found.loss)


def behind_new_joints(
    search: Search,
    scene: Scene,
    group: Group,
    body: Mechanism,
    part: int,
    hand: Sequence[int],
    joints: Sequence[int],
) -> Iterator[Mechanism]:
    """Bodies with a part that a hand of theirs touches, behind new joints, the best first.

    Args:
        search: what to work on.
        scene: touches; its ways are not read.
        group: touches of the part by the hand; others are outliers.
        body: the tree so far.
        part: to be added.
        hand: touchers of one link. Which of them touched is not known: each is tried, and their
            middle.
        joints: new ones, between the tree and the part.
    """
    links, points = body.links, list(body.points[hand])
    if len(hand) > 1:
        points.append(body.points[hand].mean(axis=0))
    carrier = links.toucher[hand[0]]
    trials = list[tuple[float, int, np.ndarray, Bodies]]()
    for link in range(links.number):
        way = links.way(link, carrier)
        if not way:
            continue
        for point in points:
            place = way_places(scene, body.twists, point, group.rows, way)
            found = _behind(search, group, place, joints)
            trials.append((float(found.loss[0, 0]), link, place, found))
    for _, link, place, found in sorted(trials, key=lambda trial: trial[0]):
        yield _with_part(body, part, hand, link, place, found)


def _behind(search: Search, group: Group, place: np.ndarray, joints: Sequence[int]) -> Bodies:
    """The best order of new joints before three slides that read the place of a hand."""
    number = search.num_joints
    known = range(number, number + 3)
    center = place.mean(axis=0)
    q = np.vstack([search.q[:, group.rows], ((place - center) / place.std()).T]).astype(np.float32)
    ways = [[chain_way((*order, *known))] for order in itertools.permutations(joints)]
    bodies = random_bodies(ways * _DRAWN, number + 3, 1, search.random)
    bodies.twists[:] *= _BEGUN
    bodies.twists[:, number:] = np.eye(6)[3:]
    bodies.points[:] = 0.0
    numbered = replace(group, rows=np.arange(len(group.rows)))
    there = replace(search, q=np.ascontiguousarray(q))
    best = there.descended([numbered], bodies, _DESCENT, fixed=known).best(_BEST)
    longer = replace(_DESCENT, steps=600, rate=0.02)
    return there.descended([numbered], best, longer, fixed=known).best()


def _with_part(
    body: Mechanism,
    part: int,
    hand: Sequence[int],
    link: int,
    place: np.ndarray,
    found: Bodies,
) -> Mechanism:
    """The body with a part behind new joints, which were found in a frame of their own."""
    new = order_of(found.ways[0][0])[:-3]
    motion = np.eye(4)
    motion[:3] = np.column_stack([place.std() * np.eye(3), place.mean(axis=0)])
    twists = body.twists.copy()
    twists[new] = adjoint(motion, found.twists[0, new])
    links = body.links.with_part(part, link, new)
    pairs = (*body.pairs, *((part, toucher) for toucher in hand))
    return Mechanism(links, twists, body.points, pairs)


def _but_affine(places: np.ndarray) -> np.ndarray:
    """`(n, n)` precision of places that should be an affine function of `(n, 3)` known ones."""
    basis = np.linalg.qr(np.column_stack([np.ones(len(places)), places]))[0]
    return np.eye(len(places)) - basis @ basis.T
