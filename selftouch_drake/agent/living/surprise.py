"""What the agent expects, how surprised it is, and when surprise is more than chance (naive).

A small network learns what was felt where. A touch surprises by the cosine distance between what is
felt and what was expected. In a body that stays as it is, surprise has the distribution that it had
in touches from which the network did not learn. A sequential test finds the moment from which on it
has not. Few touches feel a receptor that is new, so that surprise hardly rises: another test looks
for those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.representation.quantise import unit

#: Three hidden layers of 128, and touches of each step. On a torus of 100 receptors, from 60,000
#: touches and in 2000 steps, the median cosine distance to what is felt is 0.031. Steps count more
#: than touches: the mean of 8000 touches and 800 steps is 0.22, of 400 steps 0.37.
_HIDDEN = (128, 128, 128)
_BATCH = 1024
NUM_STEPS = 2000

#: Rise of surprise that is looked for, in standard deviations of its usual spread. The test needs
#: twice as many touches for half of it.
_RISE = 0.5

#: Touches of a receptor that are nearer to each other than this are of one encounter.
_TOGETHER = 10

#: A receptor that is known to be new by this chance counts where the change began.
_LIKELY = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    """What is felt at a motor configuration, as learned from touches.

    Attributes:
        network: from standardised configurations to a sensation.
        middle: `(J,)` mean of the configurations.
        scale: `(J,)` their deviation; 1 where a joint did not move.
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
            num_steps: of training.
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
    """`(n,)` cosine distance between what is expected and felt, both `(n, S)`; 1 if null."""
    felt = np.linalg.norm(sensation, axis=1) * np.linalg.norm(expected, axis=1)
    along = np.einsum("ns,ns->n", expected, sensation)
    return 1.0 - np.divide(along, felt, out=np.zeros(len(felt)), where=felt > 0)


@dataclass(slots=True, kw_only=True, eq=False)
class Alarm:
    """A cumulative sum test (Page, 1954): has surprise risen for good?

    Surprise counts by its rank among usual ones, as a normal number, so that no single touch can
    raise the alarm. Of independent numbers the sum of log likelihood ratios passes h once in e^h
    touches or less often (Lorden, 1971). Successive touches surprise alike: their correlation,
    measured on the usual ones, makes each of them count for less.

    Attributes:
        usual: `(n,)` rising, surprise in a body that did not change.
        correlation: variance of a sum of usual surprises over that of independent ones, 1 or more.
        threshold: h.
        level: of the sum, 0 or more.
        since: touches since it was last 0: those of a body that may have changed.
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
            usual: `(n,)` surprise at touches as they came, from which nothing was learned.
            false_alarms: chance of a false alarm in a lifetime.
            lifetime: touches.
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
            surprise: `(n,)`.

        Returns:
            The first row at which the alarm is raised, None if it is not. `since` then counts the
            touches since the change, up to and with that row.
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
    """Has a receptor that never felt anything begun to feel?

    In a body that stays as it is, touches might have come in any order: that a receptor was met
    k + 1 times since it was first met, m of n touches ago, has a chance of about (m / n)^k.

    Attributes:
        silent: `(S,)` bool, receptors that never felt anything before the watch.
        threshold: log of the chance at which the alarm is raised.
        num_touches: n, of all the life.
        met: `(S,)` encounters with each of them.
        first: `(S,)` number of the touch of the first.
        last: `(S,)` number of the last touch that each felt.
        since: touches since the change, up to and with the one that raised the alarm.
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
            num_touches: of the life up to now.
            silent: `(S,)` bool, receptors that never felt anything in it.
            false_alarms: chance of a false alarm in the life.
        """
        return cls(
            silent=silent,
            # A tenth, as every encounter is another occasion.
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
