"""Two tests of each receptor: has it begun to feel, or has it fallen silent (naive)?

Few touches feel any one receptor, so surprise hardly rises when it changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: Touches of a receptor that are fewer touches apart than this count as one encounter.
_TOGETHER = 10

#: Receptors whose encounters have less than this chance in an unchanged body say when it changed.
_LIKELY = 0.05

#: A receptor is surely expected if its reading is at least this share of a sensation. On a torus
#: with 100 receptors this happens in 20 to 25 encounters per 1000 touches; the receptor misses one
#: in a hundred of them (median; one in twenty at the worst receptor).
_SURELY = 0.2

#: Least share of encounters that a receptor is believed to miss. Misses come in runs: on a cube, in
#: 100,000 touches, a receptor that had missed none of 29 encounters missed four in a row.
_MISSED = 1 / 32


@dataclass(slots=True, kw_only=True, eq=False)
class NewReceptorTest:
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
        doubt: least log of a chance in the touches last watched, as a share of the threshold.
    """

    silent: np.ndarray
    threshold: float
    num_touches: int
    met: np.ndarray
    first: np.ndarray
    last: np.ndarray
    since: int = 0
    doubt: float = 0.0

    @classmethod
    def after(
        cls, num_touches: int, silent: np.ndarray, *, false_alarms: float = 0.01
    ) -> NewReceptorTest:
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
        self.doubt = 0.0
        for row in np.flatnonzero(felt.any(axis=1)).tolist():
            now = self.num_touches + row
            self.first[felt[row] & (self.met == 0)] = now
            self.met += felt[row] & (now - self.last >= _TOGETHER)
            self.last[felt[row]] = now
            chance = (self.met - 1) * np.log((now + 1 - self.first) / (now + 1))
            self.doubt = max(self.doubt, float(chance.min()) / self.threshold)
            if self.doubt > 1.0:
                self.since = now + 1 - int(self.first[chance < math.log(_LIKELY)].min())
                return row
        self.num_touches += len(sensation)
        return None


@dataclass(slots=True, kw_only=True, eq=False)
class DeadReceptorTest:
    """A cumulative sum test: have receptors fallen silent?

    In a body that stays as it is, a receptor misses few of the encounters in which it is surely
    expected. Each miss adds the log likelihood ratio of a receptor that feels nothing any more to
    its sum; when the receptor feels, its sum is 0 again. In a body that stays as it is, the sum of
    a receptor passes h once in e^h encounters or less often (Lorden, 1971).

    Receptors may fall silent one at a time or together. If each of S does so with a chance of 1 /
    S, independently of the others, the likelihood ratio is the product of 1 + (e^sum - 1) / S over
    all receptors. The alarm is raised when the log of this product passes h. After 10 of 100
    receptors died in an actively explored torus, that took 189 touches (median of 13 moments), and
    377 when the sum of one receptor had to pass h + log S.

    Attributes:
        weight: `(S,)` what a missed encounter adds: log of 1 / share missed in usual touches.
        threshold: h.
        level: `(S,)` sum of each receptor.
        unfelt: `(S,)` number of touches since each receptor felt.
        unexpected: `(S,)` number of touches since each was surely expected, at most 10.
        since: touches since the change, up to and including the one that raised the alarm.
        doubt: greatest log of the product in the touches last watched, as a share of the threshold.
    """

    weight: np.ndarray
    threshold: float
    level: np.ndarray
    unfelt: np.ndarray
    unexpected: np.ndarray
    since: int = 0
    doubt: float = 0.0

    @classmethod
    def calibrated(
        cls,
        expected: np.ndarray,
        sensation: np.ndarray,
        *,
        false_alarms: float = 0.01,
        lifetime: int = 100_000,
    ) -> DeadReceptorTest:
        """Learns how often receptors miss an encounter.

        Args:
            expected: `(n, S)` of unit L2 norm, what was expected in touches in order, from which
                the network did not learn.
            sensation: `(n, S)` what was felt.
            false_alarms: chance of a false alarm in a lifetime.
            lifetime: number of touches.
        """
        num = expected.shape[1]
        test = cls(
            weight=np.zeros(num),
            threshold=math.log(lifetime / false_alarms),
            level=np.zeros(num),
            unfelt=np.zeros(num, dtype=int),
            unexpected=np.full(num, _TOGETHER),
        )
        met = test._encounters(expected)
        missed = met & ~(sensation > 0)
        share = (missed.sum(axis=0) + 1) / (met.sum(axis=0) + 2)
        test.weight = -np.log(np.maximum(share, _MISSED))
        return test

    def watch(self, expected: np.ndarray, sensation: np.ndarray) -> int | None:
        """Takes the next touches `(n, S)`; returns the first row that raises the alarm, or None."""
        felt = sensation > 0
        added = np.where(self._encounters(expected) & ~felt, self.weight, 0.0)
        self.doubt = 0.0
        for row in range(len(felt)):
            self.level = np.where(felt[row], 0.0, self.level + added[row])
            self.unfelt = np.where(felt[row], 0, self.unfelt + 1)
            together = float(np.log1p(np.expm1(self.level) / len(self.level)).sum())
            self.doubt = max(self.doubt, together / self.threshold)
            if self.doubt > 1.0:
                self.since = int(self.unfelt[self.level > self.level.max() / 2].min())
                return row
        return None

    def _encounters(self, expected: np.ndarray) -> np.ndarray:
        """`(n, S)` bool, the first touch of each encounter in which a receptor is expected."""
        sure, num = expected > _SURELY, len(expected)
        row = np.where(sure, np.arange(num)[:, None], -_TOGETHER)
        last = np.maximum.accumulate(np.vstack([-self.unexpected, row]))
        self.unexpected = np.minimum(num - last[-1], _TOGETHER)
        return sure & (np.arange(num)[:, None] - last[:-1] >= _TOGETHER)
