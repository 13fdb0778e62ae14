"""What the agent expects, how surprised it is, and when surprise is more than chance (naive).

A small network learns what was felt where. The surprise of a touch is the cosine distance between
the felt and the expected sensation. While the body stays as it is, surprise keeps the distribution
that it had in touches from which the network did not learn. A sequential test finds the moment at
which this distribution changed. Few touches feel a new receptor, so surprise hardly rises; another
test looks for new receptors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quantise import unit

#: Units of the hidden layers, touches per training step, and steps. On a torus with 100 receptors,
#: with 60,000 touches and 2000 steps, the median cosine distance to what is felt is 0.031. Steps
#: count more than touches: with 8000 touches the mean is 0.22 with 800 steps, 0.37 with 400 steps.
_HIDDEN = (128, 128, 128)
_BATCH = 1024
NUM_STEPS = 2000

#: Rise of surprise that the test looks for, in standard deviations of usual surprise. For a rise
#: half as large, the test needs twice as many touches.
_RISE = 0.5

#: Touches of a receptor that are fewer touches apart than this count as one encounter.
_TOGETHER = 10

#: Receptors whose encounters have less than this chance in an unchanged body say when it changed.
_LIKELY = 0.05


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
        cls, q: np.ndarray, sensation: np.ndarray, *, num_steps: int = NUM_STEPS, seed: int = 0
    ) -> Expectation:
        """Learns from touches.

        Args:
            q: `(n, J)` motor configurations, in the robot's units.
            sensation: `(n, S)` N, what was felt there; no row null.
            num_steps: number of training steps.
            seed: the same seed and touches give the same bytes, on one machine.
        """
        rng = np.random.default_rng(seed)
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

    Attributes:
        usual: `(n,)` surprise in a body that did not change, in ascending order.
        correlation: variance of a sum of usual surprises over that of independent ones, 1 or more.
        threshold: h.
        level: value of the sum, 0 or more.
        since: touches since the sum was last 0: those of a body that may have changed.
    """

    usual: np.ndarray
    correlation: float
    threshold: float
    level: float = 0.0
    since: int = 0

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
        alarm = cls(usual=ordered, correlation=1.0, threshold=math.log(lifetime / false_alarms))
        z = alarm._normal(usual)
        together = sum(float(np.mean(z[:-lag] * z[lag:])) for lag in range(1, 11))
        alarm.correlation = max(1.0, 1.0 + 2.0 * together / max(float(np.mean(z * z)), 1e-9))
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
        ratio = (_RISE * self._normal(surprise) - _RISE**2 / 2.0) / self.correlation
        for row, step in enumerate(ratio.tolist()):
            self.level = max(self.level + step, 0.0)
            self.since = self.since + 1 if self.level else 0
            if self.level > self.threshold:
                return row
        return None


@dataclass(slots=True, kw_only=True, eq=False)
class Newcomers:
    """A test: has a receptor that never felt anything begun to feel?

    In a body that stays as it is, touches might have come in any order. Then a receptor that was
    first met m of n touches ago was met k + 1 times since with a chance of about (m / n)^k.

    Attributes:
        silent: `(S,)` bool, receptors that never felt anything before the watch.
        threshold: log of the chance at which the alarm is raised.
        num_touches: n, number of touches of the whole life.
        met: `(S,)` number of encounters with each silent receptor.
        first: `(S,)` number of the touch of its first encounter.
        last: `(S,)` number of the last touch that it felt.
        since: touches since the change, up to and including the one that raised the alarm.
    """

    silent: np.ndarray
    threshold: float
    num_touches: int
    met: np.ndarray
    first: np.ndarray
    last: np.ndarray
    since: int = 0

    @classmethod
    def after(
        cls, num_touches: int, silent: np.ndarray, *, false_alarms: float = 0.01
    ) -> Newcomers:
        """Begins to watch.

        Args:
            num_touches: number of touches of the life up to now.
            silent: `(S,)` bool, receptors that never felt anything in it.
            false_alarms: chance of a false alarm in the life.
        """
        return cls(
            silent=silent,
            # A tenth of the chance, as every encounter is another occasion for a false alarm.
            threshold=math.log(0.1 * false_alarms / len(silent)),
            num_touches=num_touches,
            met=np.zeros(len(silent), dtype=int),
            first=np.zeros(len(silent), dtype=int),
            last=np.full(len(silent), -_TOGETHER),
        )

    def watch(self, sensation: np.ndarray) -> int | None:
        """Takes the next touches `(n, S)`; returns the first row that raises the alarm, or None."""
        felt = (sensation > 0) & self.silent
        for row in np.flatnonzero(felt.any(axis=1)).tolist():
            now = self.num_touches + row
            self.first[felt[row] & (self.met == 0)] = now
            self.met += felt[row] & (now - self.last >= _TOGETHER)
            self.last[felt[row]] = now
            chance = (self.met - 1) * np.log((now + 1 - self.first) / (now + 1))
            if chance.min() < self.threshold:
                self.since = now + 1 - int(self.first[chance < math.log(_LIKELY)].min())
                return row
        self.num_touches += len(sensation)
        return None
