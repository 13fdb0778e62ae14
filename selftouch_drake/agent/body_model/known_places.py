"""A chain to places that are known: what one hand has shown of a skin teaches the next hand.

Once the chain of one hand is found, it tells where the kernels of a part lie. Where another hand
touched them, only its own joints are unknown: all that carries the part, up to the link where the
two limbs part, is undone. In whatever frame and scale, its places must then be an affine function
of the known ones, which is the criterion of few touches with another precision. It has hardly any
false optima: of a chain of seven joints all starts found the one body, where kernels without places
led one start in twelve to it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.fit import Bodies, Smooth, Way
from selftouch_drake.agent.body_model.forest import alone, robust_similarity
from selftouch_drake.agent.body_model.scene import (
    Scene,
    all_places,
    neighbour_distance,
    way_places,
)
from selftouch_drake.agent.body_model.structure import Search, found_chains, order_of
from selftouch_drake.agent.body_model.who_touched import started

# A hand did not make a touch that is so many times farther from its kernel than kernels lie apart.
_FAR = 2.0
# Touches that a search looks at: of 1,500 it takes five times as long, and finds the same.
_LOOKED_AT = 600


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
        place = self.place[own.target]
        away = np.linalg.norm(
            all_places(own, self.chain.twists[0], self.chain.points[0]) - place, axis=2
        ).min(axis=0)
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


def _but_affine(places: np.ndarray) -> np.ndarray:
    """`(n, n)` precision of places that should be an affine function of `(n, 3)` known ones."""
    basis = np.linalg.qr(np.column_stack([np.ones(len(places)), places]))[0]
    return np.eye(len(places)) - basis @ basis.T
