"""A life: the agent learns from touches as they come, notices that its body changed, and mends.

The agent learns what to expect when it has 5000 touches, and again whenever it has half as many
more. When the alarm is raised, it learns nothing for a while and only collects touches of the
changed body. Then it finds out what changed, makes the remembered touches into touches of the
changed body, and lives on. Nobody announces the change. What it found is not always exact: then it
looks again when it has more touches of the changed body.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from selftouch_drake.agent.lifelong.body_change import BodyChange, explain_change, learned_again
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.receptors import DeadReceptorTest, NewReceptorTest
from selftouch_drake.agent.lifelong.surprise import NUM_STEPS, Alarm, Expectation, with_unit_norm

#: Touches of a body after which the agent learns what to expect, and the factor by which they have
#: grown when it learns that again. With a factor of 2, an agent that explores actively expects as
#: badly at 8000 touches as it did at 5000: its mean surprise is 0.44, not 0.10.
_FIRST, _AGAIN = 5000, 1.5

#: Share of the touches, the last ones, that say what surprise is usual, and their greatest number.
#: The expectation does not learn from them.
_USUAL, _MOST_USUAL = 0.2, 10_000

#: Touches of the changed body from which the agent finds out what changed, and from which it makes
#: a guess more exact.
_TO_UNDERSTAND, _UNDERSTAND_AGAIN = 1000, (2000, 4000)

#: Touches that the agent takes at a time, so that a life does not depend on the size of its chunks.
_BLOCK = 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noticed:
    """A change that the agent noticed.

    Attributes:
        row: number of the touch at which the agent noticed it.
        since: number of the first touch that the agent takes for one of the changed body.
        mended_at: number of touches of the life when the agent had found out what changed.
        mending: what it found; it may become more exact later.
    """

    row: int
    since: int
    mended_at: int
    mending: BodyChange


class Life:
    """An agent that learns, expects, notices and mends, touch by touch.

    Args:
        make_learner: makes a learner that knows nothing; after mending, the agent gives a new one
            the mended touches.
        seed: from which all randomness comes.
        false_alarms: chance of a false alarm of each of three tests in 100,000 touches.
        num_steps: training steps of the expectation; with fewer, the agent notices less.
    """

    def __init__(
        self,
        make_learner: Callable[[], OnlineLearner] = OnlineLearner,
        *,
        seed: int = 0,
        false_alarms: float = 0.01,
        num_steps: int = NUM_STEPS,
    ) -> None:
        self._make_learner, self._seed, self._false_alarms = make_learner, seed, false_alarms
        self._num_steps = num_steps
        self.learner = make_learner()
        #: The changes that the agent noticed, in order.
        self.noticed: list[Noticed] = []
        #: Surprise of each touch, `(n,)` arrays in order; NaN before anything is expected.
        self.surprise: list[np.ndarray] = []
        #: Greatest statistic of each test in each block, as a share of what raises its alarm.
        self.doubts: list[tuple[float, ...]] = []
        self.num_touches = 0
        self._expectation: Expectation | None = None
        self._tests: tuple[Alarm, DeadReceptorTest, NewReceptorTest] | None = None
        self._expects_again_at: float = _FIRST
        # Touches that wait for a full block; the last learned ones; those of a changed body.
        self._waiting = self._last = self._strange = _Touches.none()
        # Remembered touches from before the last change, as they were, and the numbers of strange
        # touches at which the agent makes a guess more exact.
        self._before, self._looks = _Touches.none(), list[int]()
        # Number of the first touch of the body as it is.
        self._born = 0
        self._raised: tuple[int, int] | None = None
        # Number of the learner's touches from before the change.
        self._num_before = 0

    @property
    def has_doubts(self) -> bool:
        """Whether the agent noticed a change and has not yet found out what changed."""
        return self._raised is not None

    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Lives through the next touches.

        Args:
            q: `(n, J)` motor configurations, in the robot's units.
            sensation: `(n, S)` N, what was felt there; no row null.
        """
        touches = self._waiting.and_then(_Touches(np.asarray(q), np.asarray(sensation)))
        while len(touches) >= _BLOCK:
            self._live(touches[:_BLOCK])
            touches = touches[_BLOCK:]
        self._waiting = touches

    def _live(self, block: _Touches) -> None:
        first = self.num_touches
        self.num_touches += len(block)
        if self._raised is None:
            block, strange = self._watched(block, first)
            self._learn(block)
        else:
            strange = block
            self.surprise.append(self._surprised(block))
        if self._raised is not None:
            self._strange = self._strange.and_then(strange)
            if len(self._strange) >= _TO_UNDERSTAND:
                self._mend()
            return
        if self._looks:
            self._strange = self._strange.and_then(block)
            if len(self._strange) >= self._looks[0]:
                self._look_again()
        if self.num_touches - self._born >= self._expects_again_at:
            self._expect()

    def _watched(self, block: _Touches, first: int) -> tuple[_Touches, _Touches]:
        """Cuts a block where the body changed: touches before and after; all before if not."""
        if self._tests is None:
            self.surprise.append(np.full(len(block), np.nan))
            return block, _Touches.none()
        assert self._expectation is not None
        expected = self._expectation(block.q)
        self.surprise.append(self._expectation.surprise(expected, block.sensation))
        tests: tuple[Alarm | DeadReceptorTest | NewReceptorTest, ...] = self._tests
        alarm, silenced, newcomers = self._tests
        rows = (
            alarm.watch(self.surprise[-1], self._expectation.novelty(block.q)),
            silenced.watch(with_unit_norm(expected), block.sensation),
            newcomers.watch(block.sensation),
        )
        self.doubts.append(tuple(test.doubt for test in tests))
        raised = [(row, test) for row, test in zip(rows, tests, strict=True) if row is not None]
        if not raised:
            return block, _Touches.none()
        row, test = min(raised, key=lambda one: one[0])
        since = row + 1 - test.since
        self._raised = first + row, first + since
        self._strange, self._looks = _Touches.none(), []
        self._num_before = self.learner.num_touches + since
        if since < 0:
            # The last touches that it learned may be of the changed body.
            self._last = self._last[: max(len(self._last) + since, _BLOCK)]
        return block[: max(since, 0)], block[max(since, 0) :]

    def _surprised(self, block: _Touches) -> np.ndarray:
        assert self._expectation is not None
        return self._expectation.surprise(self._expectation(block.q), block.sensation)

    def _learn(self, block: _Touches) -> None:
        if len(block):
            self.learner.take(block.q, block.sensation)
            num = int(min(_USUAL * self.learner.num_touches, _MOST_USUAL))
            self._last = self._last.and_then(block)[-num:]

    def _mend(self) -> None:
        assert self._raised is not None
        assert self._expectation is not None
        held = self.learner.remembered()
        before = held.row < self._num_before
        q, sensation = held.columns["q"][before], held.columns["sensation"][before]
        strange = self._strange
        mending = explain_change(
            self._expectation,
            (self._last.q, self._last.sensation),
            (q, sensation),
            strange.q,
            strange.sensation,
            num_steps=self._num_steps,
            seed=self._seed,
        )
        row, self._born = self._raised
        self.noticed.append(
            Noticed(row=row, since=self._born, mended_at=self.num_touches, mending=mending)
        )
        self._before = _Touches(q, sensation)
        self._begin_again(mending)
        self._raised, self._tests = None, None
        self._expect()
        if mending.is_a_guess:
            self._looks = list(_UNDERSTAND_AGAIN)
        else:
            self._before = self._strange = _Touches.none()

    def _look_again(self) -> None:
        """Makes a guess more exact, with more touches of the changed body."""
        found, strange = self.noticed[-1], self._strange
        mending = learned_again(found.mending, strange.q, strange.sensation, seed=self._seed)
        self.noticed[-1] = dataclasses.replace(found, mending=mending)
        self._begin_again(mending)
        self._looks = self._looks[1:]
        if not self._looks:
            self._before = self._strange = _Touches.none()

    def _begin_again(self, mending: BodyChange) -> None:
        """A new learner takes the mended touches, and the touches of the changed body."""
        self.learner = self._make_learner()
        before, strange = self._before, self._strange
        # At once, so that targets are chosen where the body feels now.
        self._learn(_Touches(*mending.mended(before.q, before.sensation)).and_then(strange))
        self._last = strange[len(strange) // 2 :]

    def _expect(self) -> None:
        """Learns what to expect from all remembered touches except the last ones."""
        held = self.learner.remembered()
        early = held.row < self.learner.num_touches - len(self._last)
        expectation = self._expectation = Expectation.learn(
            held.columns["q"][early],
            held.columns["sensation"][early],
            num_steps=self._num_steps,
            seed=self._seed,
        )
        expected, felt = expectation(self._last.q), self._last.sensation
        usual = expectation.surprise(expected, felt)
        chance = self._false_alarms
        if self._tests is None:
            silent = ~np.any(held.columns["sensation"] > 0, axis=0)
            newcomers = NewReceptorTest.after(self.learner.num_touches, silent, false_alarms=chance)
        else:
            newcomers = self._tests[-1]
        self._tests = (
            Alarm.calibrated(usual, expectation.novelty(self._last.q), false_alarms=chance),
            DeadReceptorTest.calibrated(with_unit_norm(expected), felt, false_alarms=chance),
            newcomers,
        )
        self._expects_again_at = max(_FIRST, _AGAIN * (self.num_touches - self._born))


class _Touches:
    """Motor configurations `(n, J)` and what was felt there, `(n, S)`, in order."""

    def __init__(self, q: np.ndarray, sensation: np.ndarray) -> None:
        self.q, self.sensation = q, sensation

    @staticmethod
    def none() -> _Touches:
        return _Touches(np.empty((0, 0)), np.empty((0, 0)))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: Any) -> _Touches:
        return _Touches(self.q[rows], self.sensation[rows])

    def and_then(self, others: _Touches) -> _Touches:
        if not len(self) or not len(others):
            return self if len(self) else others
        return _Touches(
            np.concatenate([self.q, others.q]), np.concatenate([self.sensation, others.sensation])
        )
