"""The chain of joints that an agent knows while it explores: from a hundred touches on.

It is looked for until touches that are left out accept one. From then on it follows the touches:
the last ones fit it anew, from where it was, in a fraction of a second.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.chain import derivatives, places
from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.agent.body_model.reach import put_onto
from selftouch_drake.agent.body_model.smoothness import (
    Sensed,
    SmoothChain,
    finished,
    tangent,
)
from selftouch_drake.agent.body_model.standard_readings import StandardReadings
from selftouch_drake.agent.body_model.structure import Search

# Touches before a chain is looked for, and by which factor they grow until it is looked for again,
# or judged again.
_FIRST, _AGAIN = 100, 2
# The last touches, to which a chain is fitted.
_LAST = 1000
# Steps of least squares that bring a toucher to a place.
_PUT = 8
# Steps in which new touches are taken in.
_TAKEN_IN = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownChain:
    """A chain that n touches accept: L joints of the J that the body has, p parameters.

    Places are those of the toucher's centre, in the frame of the skin's link and a unit of its own.

    Attributes:
        joints: its joints, the one next to the skin first.
        chain: its twists and point, for standardised readings.
        slides: `(L,)` bool, joints that slide; the others turn.
        center: `(J,)` of the readings.
        scale: `(J,)` of the readings.
        q: `(n, J)` readings in the touches that it was fitted to.
        sensed: what they felt like.
        strength: `(n,)` greatest reading in each.
        alike: whether its joints turn alike by what they read.
    """

    joints: list[int]
    chain: SmoothChain
    slides: np.ndarray
    center: np.ndarray
    scale: np.ndarray
    q: np.ndarray
    sensed: Sensed
    strength: np.ndarray
    alike: bool = False

    @property
    def unit(self) -> np.ndarray | None:
        """`(L,)` how far standardised readings turn its joints, if they turn alike."""
        return self.scale[self.joints] if self.alike else None

    @property
    def radius(self) -> float:
        """Root mean square distance of the touches' places from their middle."""
        return float(np.sqrt(self.places(self.q).var(axis=0).sum()))

    def standard(self, q: np.ndarray) -> np.ndarray:
        """`(m, L)` standardised readings of its joints, of `(m, J)`."""
        return ((q - self.center) / self.scale)[:, self.joints]

    def places(self, q: np.ndarray) -> np.ndarray:
        """`(m, 3)` where the toucher is at `(m, J)` readings."""
        return places(self.standard(q), self.chain.twists, self.chain.point)

    def slopes(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`(m, 3)` places at `(m, J)` readings, and `(m, 3, p)` slopes by what touch can tell."""
        place, by_twist, by_point, _ = derivatives(
            self.standard(q), self.chain.twists, self.chain.point
        )
        slope = np.concatenate([by_twist.reshape(len(q), 3, -1), by_point], axis=2)
        return place, slope @ tangent(self.chain, self.slides, self.unit)

    def misplaced(self, q: np.ndarray, sensation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far the chain takes the toucher from where sensations say; its own touches say where.

        Args:
            q: `(m, J)` readings.
            sensation: `(m, S)` what was felt.

        Returns:
            `(m,)` distances in radii, and `(m,)` how unsure sensations are, as of `Sensed.unsure`.
        """
        felt = self.sensed.like(csr_array(sensation.astype(float)))
        there = self.sensed.predicted(self.places(self.q), felt)
        off = np.linalg.norm(self.places(q.astype(float)) - there, axis=1)
        return off / self.radius, self.sensed.unsure(felt)

    def put(
        self, q: np.ndarray, place: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> np.ndarray:
        """`(m, J)` postures near `(m, J)` q with the toucher at `(m, 3)` places, if it gets there.

        They stay within limits `(J,)`.
        """
        low, high = (self.standard(limit[None])[0] for limit in (lower, upper))
        x, signs = np.ascontiguousarray(self.standard(q)), np.ones(len(self.joints))
        ball, unused = np.zeros((3, 3)), np.zeros((len(q), 3))
        twists, point = self.chain.twists, self.chain.point
        put_onto(x, twists, signs, point, ball, place, unused, low, high, _PUT)
        found = q.copy()
        found[:, self.joints] = self.center[self.joints] + self.scale[self.joints] * x
        return found.clip(lower, upper)

    def felt_as(self, q: np.ndarray, sensation: np.ndarray) -> "KnownChain":
        """The same chain, with `(n, J)` readings and `(n, S)` sensations in place of its own."""
        sensed = Sensed.of(csr_array(sensation))
        return replace(self, q=q.astype(float), sensed=sensed, strength=sensation.max(axis=1))

    def fitted_to(self, q: np.ndarray, sensation: np.ndarray) -> "KnownChain":
        """The chain as `(n, J)` readings and `(n, S)` sensations have it, from where it was."""
        sensed = Sensed.of(csr_array(sensation))
        chain = finished(
            self.standard(q), sensed.precision(), self.chain, _TAKEN_IN, slides=self.slides,
            unit=self.unit,
        )  # fmt: skip
        return replace(self, chain=chain, q=q, sensed=sensed, strength=sensation.max(axis=1))


class ChainLearner:
    """Learns the chain of a body from touches as they come. The same touches give the same bytes.

    Args:
        seed: of all randomness.

    Attributes:
        known: the chain; None before touches accept one.
    """

    def __init__(self, *, seed: int = 0) -> None:
        self.known: KnownChain | None = None
        self._seed, self._num, self._due = seed, 0, _FIRST
        self._q, self._sensation = np.zeros((0, 0)), np.zeros((0, 0))

    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Learns from the next touches: `(n, J)` readings, and `(n, S)` what was felt."""
        if not len(q):
            return
        self._num += len(q)
        q, sensation = np.asarray(q, dtype=float), np.asarray(sensation, dtype=float)
        if len(self._q):
            q = np.concatenate([self._q, q])
            sensation = np.concatenate([self._sensation, sensation])
        self._q, self._sensation = q[-_LAST:], sensation[-_LAST:]
        # Matrices are small: more threads wait for each other, and sum in an order of their own.
        with threadpool_limits(limits=1, user_api="blas"):
            self._learn()

    def _learn(self) -> None:
        """Follows the last touches, and looks for a chain or judges it anew when that is due."""
        due = self._num >= self._due
        if self.known is not None:
            self.known = self.known.fitted_to(self._q, self._sensation)
            if due and not self._accepted(self.known):
                self.known = None
        if due:
            self._due = _AGAIN * self._num
            if self.known is None:
                self.known = found_chain(self._q, self._sensation, seed=self._seed)

    def _accepted(self, known: KnownChain) -> bool:
        """Whether touches still agree, of those that do not crowd."""
        spread = spread_out(known.places(known.q), len(known.q) // 2)
        sensed = known.sensed.some(spread)
        labels = few.neighbourhoods(sensed, np.random.default_rng(self._seed))
        verdict = few.left_out_in_turn(
            known.standard(known.q[spread]), sensed, labels, known.chain, unit=known.unit
        )
        return verdict.accepted


def found_chain(q: np.ndarray, sensation: np.ndarray, *, seed: int = 0) -> KnownChain | None:
    """The chain that `(n, J)` readings and `(n, S)` sensations accept; None if they accept none."""
    readings = StandardReadings.of(q)
    moving = len(readings.moving)
    # A chain of all joints, even if they turn alike, could not be judged by fewer touches.
    if not moving or len(q) < few.needed_for(moving, alike=moving)[1]:
        return None
    search = Search(readings.single(), np.random.default_rng(seed), scale=readings.scale)
    felt = csr_array(sensation)
    found = few.found_by_sensation(search, readings.q, felt, readings.moving)
    if found is None or not found.judgement.accepted:
        return None
    return KnownChain(
        joints=found.order,
        chain=SmoothChain(found.twists[found.order], found.point, np.inf),
        slides=found.kind[found.order] == JointKind.SLIDES,
        center=readings.center,
        scale=readings.scale,
        q=q,
        sensed=Sensed.of(felt),
        strength=sensation.max(axis=1),
        alike=found.alike,
    )


def spread_out(place: np.ndarray, number: int, known: np.ndarray | None = None) -> np.ndarray:
    """`(number,)` of `(n, 3)` places, each the farthest from those before it, and from known ones.

    Args:
        place: to choose from.
        number: of places, at most.
        known: `(m, 3)` places; none by default.
    """
    far = np.full(len(place), np.inf)
    if known is not None and len(known):
        for start in range(0, len(known), 1000):
            some = known[start : start + 1000]
            away = np.linalg.norm(place[:, None] - some[None], axis=2).min(axis=1)
            far = np.minimum(far, away)
    chosen = []
    for _ in range(min(number, len(place))):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(place - place[chosen[-1]], axis=1))
        far[chosen[-1]] = -1.0
    return np.array(chosen, dtype=int)
