"""What the agent expects, how surprised it is, and when surprise is more than chance (naive).

A small network learns what was felt where, and how firmly. The surprise of a touch is the cosine
distance between the felt and the expected sensation, and half the squared difference in firmness:
when a sphere is stretched, its skin feels the same in a posture as before, but more firmly. While
the body stays as it is, surprise keeps the distribution that it had in touches from which the
network did not learn. A sequential test finds the moment at which this distribution changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quantise import strength, unit

#: Units of the hidden layers, touches per training step, and steps. Steps count more than touches:
#: on a cube with 100 receptors, with 8000 touches to learn from, the mean cosine distance to what
#: is felt is 0.13 with 2000 steps of 1024 touches, and 0.05 with 5000 steps of 256 touches, which
#: take 1.3 times as long. With 10,000 steps of 128 touches, mean surprise at the next touches of
#: two active agents is 0.11 and 0.27, with 5000 of 256 it is 0.24 and 0.39.
_HIDDEN = (128, 128, 128)
_BATCH = 128
NUM_STEPS = 10_000

#: Standard deviation of initial hidden weights, relative to the one that preserves the variance.
#: Small ones make a network that expects better between the places that an agent explored. On a
#: torus and a cube with 6400 active touches, mean surprise at the next 1600 is 0.15 and 0.41 with
#: 0.7, and about alike with 0.35, 0.25 and 0.15: 0.09 to 0.11 and 0.14 to 0.16. After 12,000 random
#: touches of a sphere and a torus it is 0.04 and 0.04 with 0.7, 0.04 and 0.03 with 0.25.
_GAIN = 0.25

#: Rise of surprise that the test looks for, in standard deviations of usual surprise. For a rise
#: half as large, the test needs twice as many touches.
_RISE = 0.5

#: Touches are ranked among the usual ones that are about as novel, in so many bands. On a torus
#: that the agent explores actively, surprise is 0.02 in the most familiar quarter of the touches
#: and 0.22 in the most novel one. There an alarm is raised 94 touches after the forearm grew, or
#: 469 with one band.
_BANDS = 4

#: Most touches to which the novelty of a touch is measured.
_MOST_FAMILIAR = 10_000

#: Least expected firmness, and 1 less the greatest.
_LEAST_FIRM = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    """What is felt at a motor configuration, as learned from touches.

    Attributes:
        network: from standardised configurations to a sensation.
        middle: `(J,)` mean of the configurations.
        scale: `(J,)` their standard deviation; 1 where a joint did not move.
        typical: N, median strength of the touches.
        familiar: some of the standardised configurations.
    """

    network: Network
    middle: np.ndarray
    scale: np.ndarray
    typical: float
    familiar: cKDTree

    @classmethod
    def learn(
        cls,
        q: np.ndarray,
        sensation: np.ndarray,
        *,
        like: Expectation | None = None,
        num_steps: int = NUM_STEPS,
        seed: int = 0,
    ) -> Expectation:
        """Learns from touches.

        Args:
            q: `(n, J)` motor configurations, in the robot's units.
            sensation: `(n, S)` N, what was felt there; no row null.
            like: another expectation, whose standards this one takes over.
            num_steps: number of training steps.
            seed: the same seed and touches give the same bytes, on one machine.
        """
        rng = np.random.default_rng(seed)
        if like is not None:
            middle, scale, typical = like.middle, like.scale, like.typical
        else:
            deviation = q.std(axis=0, dtype=float)
            middle, scale = q.mean(axis=0, dtype=float), np.where(deviation > 0, deviation, 1.0)
            typical = float(np.median(strength(sensation)))
        x = _standardised(q, middle, scale)
        found = cls(
            network=Network.random([q.shape[1], *_HIDDEN, sensation.shape[1] + 1], rng, gain=_GAIN),
            middle=middle,
            scale=scale,
            typical=typical,
            familiar=cKDTree(x[:: -(-len(x) // _MOST_FAMILIAR)]),
        )
        felt, network, rows = found.felt(sensation), found.network, np.empty(0, dtype=int)
        mean = felt.mean(axis=0)
        spread = np.float32(np.sqrt(np.square(felt - mean).sum(axis=1).mean()))

        def batch() -> np.ndarray:
            nonlocal rows
            rows = rng.integers(len(x), size=_BATCH)
            return x[rows]

        def slope(outputs: np.ndarray) -> np.ndarray:
            return 2.0 * (outputs - (felt[rows] - mean) / spread) / len(outputs)

        train(network, batch, slope, num_steps)
        network.weights[-1][:] *= spread
        network.biases[-1][:] = network.biases[-1] * spread + mean
        return found

    def standardised(self, q: np.ndarray) -> np.ndarray:
        """`(n, J)` float32, configurations as the network takes them."""
        return _standardised(q, self.middle, self.scale)

    def felt(self, sensation: np.ndarray) -> np.ndarray:
        """`(n, S + 1)` float32, sensations as the network gives them: of unit norm, and firmness.

        Firmness rises with the strength of a touch, from 0 to 1; a touch of typical strength has
        1/2.
        """
        return np.column_stack([unit(sensation), self._firmness(sensation)]).astype(np.float32)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` N, what is expected at `q` `(n, J)`."""
        outputs = self.network(self.standardised(q))
        firmness = outputs[:, -1:].clip(_LEAST_FIRM, 1.0 - _LEAST_FIRM)
        return with_unit_norm(outputs[:, :-1]) * self.typical * firmness / (1.0 - firmness)

    def surprise(self, expected: np.ndarray, sensation: np.ndarray) -> np.ndarray:
        """`(n,)` how much sensations differ from what is expected, both `(n, S)` N."""
        firmer = self._firmness(sensation) - self._firmness(expected)
        return surprise(expected, sensation) + 0.5 * firmer**2

    def novelty(self, q: np.ndarray) -> np.ndarray:
        """`(n,)` distance of configurations `(n, J)` from those it was learned from."""
        return self.familiar.query(self.standardised(q))[0]

    def _firmness(self, sensation: np.ndarray) -> np.ndarray:
        firm = strength(sensation)
        return firm / (firm + self.typical)


def _standardised(q: np.ndarray, middle: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return ((q - middle) / scale).astype(np.float32)


def with_unit_norm(expected: np.ndarray) -> np.ndarray:
    """`(n, S)` without negative readings and of unit L2 norm; null where nothing is left."""
    expected = np.maximum(expected, 0.0)
    return expected / np.maximum(np.linalg.norm(expected, axis=1, keepdims=True), 1e-9)


def surprise(expected: np.ndarray, sensation: np.ndarray) -> np.ndarray:
    """`(n,)` cosine distance between what is expected and what is felt, `(n, S)`; 1 if null."""
    felt = np.linalg.norm(sensation, axis=1) * np.linalg.norm(expected, axis=1)
    along = np.einsum("ns,ns->n", expected, sensation)
    return 1.0 - np.divide(along, felt, out=np.zeros(len(felt)), where=felt > 0)


@dataclass(slots=True, kw_only=True, eq=False)
class Alarm:
    """A cumulative sum test (Page, 1954): has surprise risen for good?

    Each surprise is ranked among the usual ones, and its rank is turned into a normally distributed
    number, so that no single touch can raise the alarm. For independent numbers, the sum of log
    likelihood ratios passes h once in e^h touches or less often (Lorden, 1971). Successive touches
    surprise alike; so each counts for less, by their correlation, measured on the usual ones.
    What is usual is known only from some touches. If these surprised less than most, unchanged
    touches seem to surprise more, and false alarms become more frequent by a factor of
    e^(2 h b / rise) where the mean is off by b. Two standard errors are taken off, so that the
    chance of a false alarm, averaged over what those touches may have been, stays below e^-h (for
    an error of at most 1 / h). Touches far from all known ones surprise more, and an agent that
    explores does not always meet as many of them. So a touch is ranked among the usual ones that
    are about as novel.

    Attributes:
        usual: surprise in a body that did not change, in ascending order; an array for each band
            of novelty.
        bands: novelty at the borders of these bands, ascending.
        correlation: variance of a sum of usual surprises over that of independent ones, 1 or more.
        error: standard error of the mean of the usual ones, as normally distributed numbers.
        threshold: h.
        level: value of the sum, 0 or more.
        since: touches since the sum was last 0: those of a body that may have changed.
        doubt: greatest sum in the touches last watched, as a share of the threshold.
    """

    usual: list[np.ndarray]
    bands: np.ndarray
    correlation: float
    error: float
    threshold: float
    level: float = 0.0
    since: int = 0
    doubt: float = 0.0

    @classmethod
    def calibrated(
        cls,
        usual: np.ndarray,
        novelty: np.ndarray,
        *,
        false_alarms: float = 0.01,
        lifetime: int = 100_000,
    ) -> Alarm:
        """Learns what is usual.

        Args:
            usual: `(n,)` surprise of touches in order, from which the network did not learn.
            novelty: `(n,)` of these touches.
            false_alarms: chance of a false alarm in a lifetime.
            lifetime: number of touches.
        """
        bands = np.quantile(novelty, np.arange(1, _BANDS) / _BANDS)
        band = np.searchsorted(bands, novelty)
        alarm = cls(
            usual=[np.sort(usual[band == b]) for b in range(_BANDS)],
            bands=bands,
            correlation=1.0,
            error=0.0,
            threshold=math.log(lifetime / false_alarms),
        )
        z = alarm._normal(usual, novelty)
        together = sum(float(np.mean(z[:-lag] * z[lag:])) for lag in range(1, 11))
        alarm.correlation = max(1.0, 1.0 + 2.0 * together / max(float(np.mean(z * z)), 1e-9))
        alarm.error = math.sqrt(alarm.correlation / len(usual))
        return alarm

    def _normal(self, surprise: np.ndarray, novelty: np.ndarray) -> np.ndarray:
        band, share = np.searchsorted(self.bands, novelty), np.empty(len(surprise))
        for number, usual in enumerate(self.usual):
            rows = band == number
            share[rows] = (np.searchsorted(usual, surprise[rows]) + 0.5) / (len(usual) + 1)
        return ndtri(share)

    def watch(self, surprise: np.ndarray, novelty: np.ndarray) -> int | None:
        """Takes the next touches.

        Args:
            surprise: `(n,)` surprise of each touch.
            novelty: `(n,)` likewise.

        Returns:
            The first row at which the alarm is raised, or None. `since` then counts the touches
            since the change, up to and including that row.
        """
        z = self._normal(surprise, novelty) - 2.0 * self.error
        ratio = (_RISE * z - _RISE**2 / 2.0) / self.correlation
        self.doubt = 0.0
        for row, step in enumerate(ratio.tolist()):
            self.level = max(self.level + step, 0.0)
            self.doubt = max(self.doubt, self.level / self.threshold)
            self.since = self.since + 1 if self.level else 0
            if self.level > self.threshold:
                return row
        return None
