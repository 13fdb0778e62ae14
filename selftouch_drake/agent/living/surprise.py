"""What the agent expects, how surprised it is, and when surprise is more than chance (naive).

A small network learns what was felt where. The surprise of a touch is the cosine distance between
the felt and the expected sensation. While the body stays as it is, surprise keeps the distribution
that it had in touches from which the network did not learn. A sequential test finds the moment at
which this distribution changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quantise import unit

#: Units of the hidden layers, touches per training step, and steps. Steps count more than touches:
#: on a cube with 100 receptors, with 8000 touches to learn from, the mean cosine distance to what
#: is felt is 0.13 with 2000 steps of 1024 touches, and 0.05 with 5000 steps of 256 touches, which
#: take 1.3 times as long.
_HIDDEN = (128, 128, 128)
_BATCH = 256
NUM_STEPS = 5000

#: Rise of surprise that the test looks for, in standard deviations of usual surprise. For a rise
#: half as large, the test needs twice as many touches.
_RISE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    """What is felt at a motor configuration, as learned from touches.

    Attributes:
        network: from standardised configurations to a sensation.
        middle: `(J,)` mean of the configurations.
        scale: `(J,)` their standard deviation; 1 where a joint did not move.
    """

    network: Network
    middle: np.ndarray
    scale: np.ndarray

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
            like: another expectation, whose middle and scale this one takes over.
            num_steps: number of training steps.
            seed: the same seed and touches give the same bytes, on one machine.
        """
        rng = np.random.default_rng(seed)
        if like is not None:
            middle, scale = like.middle, like.scale
        else:
            deviation = q.std(axis=0, dtype=float)
            middle, scale = q.mean(axis=0, dtype=float), np.where(deviation > 0, deviation, 1.0)
        felt = unit(sensation)
        mean = felt.mean(axis=0)
        spread = np.float32(np.sqrt(np.square(felt - mean).sum(axis=1).mean()))
        network = Network.random([q.shape[1], *_HIDDEN, felt.shape[1]], rng)
        found = cls(network=network, middle=middle, scale=scale)
        x, rows = found.standardised(q), np.empty(0, dtype=int)

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
        return ((q - self.middle) / self.scale).astype(np.float32)

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """`(n, S)` unit L2 norm, what is expected at `q` `(n, J)`."""
        expected = np.maximum(self.network(self.standardised(q)), 0.0)
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
    an error of at most 1 / h).

    Attributes:
        usual: `(n,)` surprise in a body that did not change, in ascending order.
        correlation: variance of a sum of usual surprises over that of independent ones, 1 or more.
        error: standard error of the mean of the usual ones, as normally distributed numbers.
        threshold: h.
        level: value of the sum, 0 or more.
        since: touches since the sum was last 0: those of a body that may have changed.
        doubt: greatest sum in the touches last watched, as a share of the threshold.
    """

    usual: np.ndarray
    correlation: float
    error: float
    threshold: float
    level: float = 0.0
    since: int = 0
    doubt: float = 0.0

    @classmethod
    def calibrated(
        cls, usual: np.ndarray, *, false_alarms: float = 0.01, lifetime: int = 100_000
    ) -> Alarm:
        """Learns what is usual.

        Args:
            usual: `(n,)` surprise of touches in order, from which the network did not learn.
            false_alarms: chance of a false alarm in a lifetime.
            lifetime: number of touches.
        """
        ordered = np.sort(usual)
        threshold = math.log(lifetime / false_alarms)
        alarm = cls(usual=ordered, correlation=1.0, error=0.0, threshold=threshold)
        z = alarm._normal(usual)
        together = sum(float(np.mean(z[:-lag] * z[lag:])) for lag in range(1, 11))
        alarm.correlation = max(1.0, 1.0 + 2.0 * together / max(float(np.mean(z * z)), 1e-9))
        alarm.error = math.sqrt(alarm.correlation / len(usual))
        return alarm

    def _normal(self, surprise: np.ndarray) -> np.ndarray:
        rank = np.searchsorted(self.usual, surprise) + 0.5
        return ndtri(rank / (len(self.usual) + 1))

    def watch(self, surprise: np.ndarray) -> int | None:
        """Takes the next touches.

        Args:
            surprise: `(n,)` surprise of each touch.

        Returns:
            The first row at which the alarm is raised, or None. `since` then counts the touches
            since the change, up to and including that row.
        """
        z = self._normal(surprise) - 2.0 * self.error
        ratio = (_RISE * z - _RISE**2 / 2.0) / self.correlation
        self.doubt = 0.0
        for row, step in enumerate(ratio.tolist()):
            self.level = max(self.level + step, 0.0)
            self.doubt = max(self.doubt, self.level / self.threshold)
            self.since = self.since + 1 if self.level else 0
            if self.level > self.threshold:
                return row
        return None
