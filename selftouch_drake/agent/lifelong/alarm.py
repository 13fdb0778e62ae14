"""When surprise is more than chance: two sequential tests (naive).

Both are cumulative sums of log likelihood ratios: of a body that changed, over one that did not. A
sum that falls below 0 begins again at 0. In a body that does not change it passes h once in e^h
steps or less often (Lorden, 1971).
"""

import math

import numpy as np
from scipy.special import ndtri

from selftouch_drake.agent.body_model.chain_change import off_alike

#: Rise of surprise that the test looks for, in standard deviations of usual surprise. For a rise
#: half as large, the test needs twice as many touches.
_RISE = 0.5

#: Touches are ranked among the usual ones that are about as novel, in so many bands. After the
#: forearm of a torus grew, which the agent explored actively, an alarm is raised after 94 touches,
#: or after 469 with one band.
_BANDS = 4

#: Share of usual touches whose places are foretold surely enough to say whether they are right.
_FORETOLD = 0.95

#: A receptor is met anew once this many touches passed without meeting it.
_TOGETHER = 10

#: A receptor is surely expected if its reading is at least this share of a sensation. On a torus
#: with 100 receptors this happens in 20 to 25 encounters per 1000 touches; the receptor misses one
#: in a hundred of them (median; one in twenty at the worst receptor).
_SURELY = 0.2

#: It is expected nowhere surely but in touches so familiar that at most this share of what was
#: expected there was missed. Of a torus that an agent under dynamics explored for 5000 touches, it
#: knew half of what it then met: 3 % were missed there, 60 % in more novel touches.
_UNSURE = 1 / 20

#: Least share of encounters that a receptor is believed to miss. Misses come in runs: on a cube, in
#: 100,000 touches, a receptor that had missed none of 29 encounters missed four in a row.
_MISSED = 1 / 32

#: Share of the touches in which a receptor that began to feel is met for the first time or again.
_BEGINS = 1 / 20

#: Chance of a false alarm of each sum in a lifetime, and what a sum passes with at most this chance
#: in a lifetime of so many touches.
_FALSE_ALARMS = 0.01
THRESHOLD = math.log(100_000 / _FALSE_ALARMS)


class SurpriseTest:
    """Has surprise risen for good (Page, 1954)?

    Novel touches surprise more: so each surprise is ranked among the usual ones of touches about as
    novel. Its rank is turned into a normally distributed number, so that no single touch can raise
    the alarm. Successive touches surprise alike: so each counts for less, by their correlation.
    What is usual is known only from some touches: where their mean is off by b, false alarms become
    more frequent by a factor of e^(2 h b / rise). Two standard errors are taken off, so that the
    mean chance of a false alarm stays below e^-h (for an error of at most 1 / h).

    Args:
        usual: `(n,)` surprise of touches in order, in a body that did not change; the network has
            not learned from them.
        novelty: `(n,)` of these touches.
        correlation: the least that it can be, if touches are not in the order in which they came.

    Attributes:
        correlation: variance of a sum of usual surprises over that of independent ones, 1 or more.
        since: touches since the sum was last 0.
        doubt: `(1,)` greatest sum in the touches last watched, as a share of the threshold.
    """

    def __init__(self, usual: np.ndarray, novelty: np.ndarray, *, correlation: float = 1.0) -> None:
        self._borders = np.quantile(novelty, np.arange(1, _BANDS) / _BANDS)
        band = np.searchsorted(self._borders, novelty)
        self._usual = [np.sort(usual[band == number]) for number in range(_BANDS)]
        z = self._normal(usual, novelty)
        self.correlation = max(off_alike(z), correlation)
        self._error = math.sqrt(self.correlation / len(usual))
        self._level, self.since = 0.0, 0
        self.doubt: tuple[float, ...] = (0.0,)

    def _normal(self, surprise: np.ndarray, novelty: np.ndarray) -> np.ndarray:
        band, share = np.searchsorted(self._borders, novelty), np.empty(len(surprise))
        for number, usual in enumerate(self._usual):
            rows = band == number
            share[rows] = (np.searchsorted(usual, surprise[rows]) + 0.5) / (len(usual) + 1)
        return ndtri(share)

    def watch(self, surprise: np.ndarray, novelty: np.ndarray) -> int | None:
        """Takes the next touches, `(n,)` each; returns the first row that raises the alarm."""
        z = self._normal(surprise, novelty) - 2.0 * self._error
        most, raised = 0.0, None
        for row, step in enumerate(((_RISE * z - _RISE**2 / 2.0) / self.correlation).tolist()):
            self._level = max(self._level + step, 0.0)
            self.since = self.since + 1 if self._level else 0
            most = max(most, self._level)
            if most > THRESHOLD:
                raised = row
                break
        self.doubt = (most / THRESHOLD,)
        return raised


class PlaceTest(SurpriseTest):
    """Is what touches for good elsewhere than what is felt says?

    As surprise, by how far a chain of joints misplaces touches, among those whose place sensations
    foretell about as surely. Where they foretell it less surely than almost ever before, the skin
    is new, and nothing is said.

    Args:
        off: `(n,)` how far usual touches are misplaced, in order.
        unsure: `(n,)` variance of the places that sensations foretell.
        correlation: as of `SurpriseTest`.
    """

    def __init__(self, off: np.ndarray, unsure: np.ndarray, *, correlation: float = 1.0) -> None:
        super().__init__(off, unsure, correlation=correlation)
        self._limit, self._middle = np.quantile(unsure, _FORETOLD), float(np.median(off))

    def watch(self, surprise: np.ndarray, novelty: np.ndarray) -> int | None:
        """As of `SurpriseTest`, by how far touches are misplaced and how unsurely foretold."""
        return super().watch(np.where(novelty > self._limit, self._middle, surprise), novelty)


class ReceptorTest:
    """Have receptors fallen silent, or begun to feel?

    Each receptor has two sums. *Silence:* in a body that stays as it is, a receptor misses few of
    the encounters in which it is surely expected. Each miss adds the log likelihood ratio of a
    receptor that feels nothing any more; when the receptor feels, its sum is 0 again. *Beginning:*
    a receptor that felt nothing in n touches is met once in n touches at most, and once in 20 if
    it began to feel.

    Receptors may change one at a time or together. If each of S falls silent with a chance of 1 /
    S, and misses are independent, the likelihood ratio of all is the product of 1 + (e^sum - 1) /
    S. Receptors that were never met begin together, where a touch meets a place for the first time;
    the mean of e^sum holds however they depend on each other.

    Args:
        expected: `(n, S)` of unit L2 norm, what was expected in touches in order, from which the
            network did not learn.
        sensation: `(n, S)` what was felt.
        novelty: `(n,)` of these touches.
        never_felt: `(S,)` bool, receptors that felt nothing in the whole life.
        num_touches: number of touches of the whole life.

    Attributes:
        since: touches since the change, up to and including the one that raised the alarm.
        doubt: `(2,)` greatest log of both ratios in the touches last watched, as a share of h.
    """

    def __init__(
        self,
        expected: np.ndarray,
        sensation: np.ndarray,
        novelty: np.ndarray,
        never_felt: np.ndarray,
        num_touches: int,
    ) -> None:
        surely, order = expected > _SURELY, novelty.argsort()
        missing, wanted = (
            one.sum(axis=1)[order].cumsum() for one in (surely & ~(sensation > 0), surely)
        )
        known = order[: np.flatnonzero(np.append(0, missing) <= _UNSURE * np.append(0, wanted))[-1]]
        # Greatest novelty of a touch that is familiar.
        self._familiar = np.inf if len(known) == len(order) else novelty[known].max(initial=0.0)
        # In rows, the sums of silence and those of beginning. Touches since each receptor was
        # surely expected, and felt; at most 10.
        self._apart = np.full((2, len(never_felt)), _TOGETHER)
        met = self._encounters(expected, sensation > 0, novelty)[:, 0]
        missed = met & ~(sensation > 0)
        share = (missed.sum(axis=0) + 1) / (met.sum(axis=0) + 2)
        begins = max(math.log(_BEGINS * num_touches), 0.0)
        # What an encounter adds: one that was missed, and one with a receptor that never felt.
        self._weight = np.stack(
            [-np.log(np.maximum(share, _MISSED)), np.where(never_felt, begins, 0.0)]
        )
        # The first encounter proves nothing; every further one is another occasion.
        self._threshold = np.array([THRESHOLD, math.log(10 / _FALSE_ALARMS) + begins])
        self._level = np.zeros(self._weight.shape)
        # Touches since each receptor felt, and since its second sum was 0.
        self._age = np.zeros(self._weight.shape, dtype=int)
        self.since = 0
        self.doubt: tuple[float, ...] = (0.0, 0.0)

    def watch(self, expected: np.ndarray, sensation: np.ndarray, novelty: np.ndarray) -> int | None:
        """Takes the next touches `(n, S)`; returns the first row that raises the alarm."""
        felt = sensation > 0
        met = self._encounters(expected, felt, novelty)
        met[:, 0] &= ~felt
        added = np.where(met, self._weight, 0.0) - np.array([[0.0], [_BEGINS]])
        most = np.zeros(2)
        for row in range(len(felt)):
            self._age += 1
            self._age[0, felt[row]] = 0
            if not met[row].any() and not self._level.any():
                self._age[1] = 0
                continue
            self._level = np.maximum(self._level + added[row], 0.0)
            self._level[0, felt[row]] = 0.0
            self._age[1, self._level[1] == 0.0] = 0
            odds = np.expm1(self._level)
            ratio = np.log1p(odds[0] / felt.shape[1]).sum(), np.log1p(odds[1].mean())
            most = np.maximum(most, ratio / self._threshold)
            if most.max() > 1.0:
                break
        self.doubt = tuple(most.tolist())
        if not most.max() > 1.0:
            return None
        # All that is surely of the changed body: receptors that fell silent may have felt shortly
        # before, those that began to feel never did.
        which = int(most.argmax())
        age = self._age[which, self._level[which] > self._level[which].max() / 2]
        self.since = int(age.max() if which else age.min())
        return row

    def _encounters(
        self, expected: np.ndarray, felt: np.ndarray, novelty: np.ndarray
    ) -> np.ndarray:
        """`(n, 2, S)` bool, where a receptor is surely expected, or felt, first in a while."""
        surely = (expected > _SURELY) & (novelty <= self._familiar)[:, None]
        there = np.stack([surely, felt], axis=1)
        number = np.arange(len(there))[:, None, None]
        row = np.where(there, number, -_TOGETHER)
        last = np.maximum.accumulate(np.concatenate([-self._apart[None], row]))
        self._apart = np.minimum(len(there) - last[-1], _TOGETHER)
        return there & (number - last[:-1] >= _TOGETHER)
