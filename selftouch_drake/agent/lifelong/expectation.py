"""What the agent felt, what it expects to feel, and how much a touch surprises it (naive)."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.network import Network, toward, train
from selftouch_drake.quotient.sensations import strength, unit

#: Units of the hidden layers, touches per training step, and steps. Steps count more than touches:
#: mean surprise at the next touches of two active agents is 0.11 and 0.27 with 10,000 steps of 128
#: touches, 0.24 and 0.39 with 5000 of 256.
_HIDDEN = (128, 128, 128)
_BATCH = 128
NUM_STEPS = 10_000

#: Standard deviation of initial hidden weights, relative to the one that preserves the variance.
#: With small ones the network expects better between the places that an agent explored: mean
#: surprise at the next touches of a torus and a cube is 0.15 and 0.41 with 0.7, 0.11 and 0.16 with
#: 0.25.
_GAIN = 0.25

#: Most touches to which the novelty of a touch is measured.
_MOST_FAMILIAR = 10_000

#: Touches near a place whose mean is expected there. Two or five are about as good.
_NEAREST = 3

#: Least expected firmness, and 1 less the greatest.
_LEAST_FIRM = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class TouchSet:
    """Touches in order; by default none, without joints and receptors.

    Attributes:
        q: `(n, J)` motor configurations, in the robot's units.
        sensation: `(n, S)` N, what was felt there.
    """

    q: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    sensation: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | np.ndarray) -> "TouchSet":
        return TouchSet(self.q[rows], self.sensation[rows])

    def and_then(self, others: "TouchSet") -> "TouchSet":
        """These touches and others after them."""
        if not len(self) or not len(others):
            return self if len(self) else others
        return TouchSet(
            np.concatenate([self.q, others.q]), np.concatenate([self.sensation, others.sensation])
        )


class Expectation(ABC):
    """What is felt at a motor configuration, and how firmly.

    The *surprise* of a touch is the cosine distance between the felt and the expected sensation,
    and half the squared difference in firmness: when a sphere is stretched, its skin feels the same
    in a posture as before, but more firmly. Firmness rises with the strength of a touch, from 0 to
    1; a touch of typical strength has 1/2.

    It knows touches without null sensations. It takes its standards from the expectation `like`, if
    one is given. The same seed and touches give the same bytes, on one machine.

    Attributes:
        scale: `(J,)` standard deviation of the configurations; 1 where a joint did not move.
    """

    def __init__(self, touches: TouchSet, like: "Expectation | None" = None) -> None:
        deviation = touches.q.std(axis=0, dtype=float)
        self._middle = touches.q.mean(axis=0, dtype=float)
        self.scale = np.where(deviation > 0, deviation, 1.0)
        self._typical = float(np.median(strength(touches.sensation)))
        if like is not None:
            self._middle, self.scale, self._typical = like._middle, like.scale, like._typical

    @abstractmethod
    def novelty(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` distance of configurations `(n, J)` from those of the touches that it knows."""

    @abstractmethod
    def _as_learned_at(self, q: np.ndarray) -> np.ndarray:
        """`(n, S + 1)` what is expected, as of `as_learned`, before it has unit L2 norm."""

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected at `q` `(n, J)`."""
        outputs = self._as_learned_at(q)
        firmness = outputs[:, -1:].clip(_LEAST_FIRM, 1.0 - _LEAST_FIRM)
        return with_unit_norm(outputs[:, :-1]) * self._typical * firmness / (1.0 - firmness)

    def standardised(self, q: np.ndarray) -> np.ndarray:
        """`(n, J)` float32, configurations with mean 0 and variance 1."""
        return ((q - self._middle) / self.scale).astype(np.float32)

    def as_learned(self, touches: TouchSet) -> np.ndarray:
        """`(n, S + 1)` float32, sensations of unit L2 norm, and firmness."""
        firmness = self._firmness(touches.sensation)
        return np.column_stack([unit(touches.sensation), firmness]).astype(np.float32)

    def surprise(self, expected: np.ndarray, sensation: np.ndarray) -> np.ndarray:
        """`(n,)` how much sensations differ from what is expected, both `(n, S)` N."""
        firmer = self._firmness(sensation) - self._firmness(expected)
        return cosine_distance(expected, sensation) + 0.5 * firmer**2

    def _firmness(self, sensation: np.ndarray) -> np.ndarray:
        firm = strength(sensation)
        return firm / (firm + self._typical)


class LearnedExpectation(Expectation):
    """What a small network expects, which learned from touches.

    Attributes:
        network: from standardised configurations to a sensation of unit L2 norm, and firmness.
    """

    def __init__(
        self,
        touches: TouchSet,
        *,
        like: Expectation | None = None,
        num_steps: int = NUM_STEPS,
        seed: int = 0,
    ) -> None:
        super().__init__(touches, like)
        rng = np.random.default_rng(seed)
        x, wanted = self.standardised(touches.q), self.as_learned(touches)
        self._familiar = cKDTree(x[:: -(-len(x) // _MOST_FAMILIAR)])
        self.network = Network.random([x.shape[1], *_HIDDEN, wanted.shape[1]], rng, gain=_GAIN)
        mean = wanted.mean(axis=0)
        spread = np.float32(np.sqrt(np.square(wanted - mean).sum(axis=1).mean()))
        train(
            self.network,
            x,
            lambda: rng.integers(len(x), size=_BATCH),
            toward((wanted - mean) / spread, np.arange(len(x))),
            num_steps,
        )
        self.network.weights[-1][:] *= spread
        self.network.biases[-1][:] = self.network.biases[-1] * spread + mean

    def novelty(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` distance of standardised configurations."""
        return self._familiar.query(self.standardised(q))[0]

    def _as_learned_at(self, q: np.ndarray) -> np.ndarray:
        return self.network(self.standardised(q))


class ChainExpectation(Expectation):
    """What was felt where a chain of joints brings what touches: the mean of the nearest touches.

    Postures that no touch was near are familiar if their place is. On a torus that an agent under
    dynamics explored for 8000 touches, usual surprise was 0.004, and that of a network 0.31.
    """

    def __init__(self, chain: KnownChain, touches: TouchSet) -> None:
        super().__init__(touches)
        self._chain, self._felt = chain, self.as_learned(touches)
        self._familiar = cKDTree(chain.places(touches.q.astype(float)) / chain.radius)

    def novelty(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` distance of places, in radii of the skin."""
        return self._nearest(q)[0][:, -1]

    def _as_learned_at(self, q: np.ndarray) -> np.ndarray:
        return self._felt[self._nearest(q)[1]].mean(axis=1)

    def unlike(self, sensation: np.ndarray) -> np.ndarray:
        """`(n,)` how far sensations `(n, S)` are from the nearest one known, in any posture."""
        # Of roots, in which a faint receptor counts.
        known, felt = (unit(np.sqrt(one)) for one in (self._felt[:, :-1], sensation))
        return np.array([1.0 - (known @ one).max() for one in felt])

    def _nearest(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = self._chain.places(q.astype(float)) / self._chain.radius
        return self._familiar.query(place, min(_NEAREST, self._familiar.n))


def with_unit_norm(expected: np.ndarray) -> np.ndarray:
    """`(n, S)` without negative readings and of unit L2 norm; null where nothing is left."""
    expected = np.maximum(expected, 0.0)
    return expected / np.maximum(np.linalg.norm(expected, axis=1, keepdims=True), 1e-9)


def cosine_distance(expected: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(n,)` cosine distance between what is expected and what is felt, `(n, S)`; 1 if null."""
    felt = np.linalg.norm(sensation, axis=1) * np.linalg.norm(expected, axis=1)
    along = np.einsum("ns,ns->n", expected, sensation)
    return 1.0 - np.divide(along, felt, out=np.zeros(len(felt)), where=felt > 0)
