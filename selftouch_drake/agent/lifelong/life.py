"""A life: the agent learns from touches as they come, notices changes of its body, and adapts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.lifelong.alarm import ReceptorTest, SurpriseTest
from selftouch_drake.agent.lifelong.body_change import BodyChange
from selftouch_drake.agent.lifelong.expectation import (
    NUM_STEPS,
    Expectation,
    TouchSet,
    with_unit_norm,
)
from selftouch_drake.agent.lifelong.explanation import explain_change, refined
from selftouch_drake.agent.lifelong.learner import OnlineLearner

#: Touches of a body after which the agent learns what to expect, and the factor by which they have
#: grown when it learns that again. With a factor of 2, an agent that explores actively expects as
#: badly at 8000 touches as it did at 5000: its mean surprise is 0.44, not 0.10.
_FIRST, _AGAIN = 5000, 1.5

#: Share of the touches, the last ones, that say what surprise is usual, and their greatest number.
#: The expectation does not learn from them.
_USUAL, _MOST_USUAL = 0.2, 10_000

#: Touches of the changed body from which the agent explains the change, and from which it makes a
#: guess more exact.
_TO_EXPLAIN, _TO_REFINE = 1000, (2000, 4000)

#: Touches that the agent takes at a time, so that a life does not depend on the size of its chunks.
_BLOCK = 500


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noticed:
    """A change that the agent noticed.

    Attributes:
        row: number of the touch at which the agent noticed it.
        since: number of the first touch that the agent takes for one of the changed body.
        explained_at: number of touches of the life when the agent had explained it.
        change: the explanation; it may become more exact later.
    """

    row: int
    since: int
    explained_at: int
    change: BodyChange


class Life:
    """An agent that learns, expects, notices, explains and adapts, touch by touch.

    Args:
        make_learner: makes a learner that knows nothing; after a change, the agent gives a new one
            the adapted touches.
        seed: from which all randomness comes.
        num_steps: training steps of the expectation; with fewer, the agent notices less.

    Attributes:
        learner: what the agent knows; another one after each change.
        noticed: the changes that the agent noticed, in order.
        surprise: surprise of each touch, `(n,)` arrays in order; NaN before anything is expected.
        doubts: `(3,)` greatest evidence in each block that the body changed, as a share of what
            raises the alarm: by surprise, silent receptors, new receptors.
        num_touches: number of touches up to now.
    """

    def __init__(
        self,
        make_learner: Callable[[], OnlineLearner] = OnlineLearner,
        *,
        seed: int = 0,
        num_steps: int = NUM_STEPS,
    ) -> None:
        self._make_learner, self._seed, self._num_steps = make_learner, seed, num_steps
        self.learner = make_learner()
        self.noticed: list[Noticed] = []
        self.surprise: list[np.ndarray] = []
        self.doubts: list[tuple[float, ...]] = []
        self.num_touches = 0
        self._expectation: Expectation | None = None
        self._tests: tuple[SurpriseTest, ReceptorTest] | None = None
        self._expects_again_at: float = _FIRST
        # Touches that wait for a full block; the last learned ones; those of a changed body.
        self._waiting = self._last = self._strange = TouchSet.none()
        # Remembered touches from before the last change, as they were, and the numbers of strange
        # touches at which the agent makes a guess more exact.
        self._before, self._to_refine = TouchSet.none(), list[int]()
        # Number of the first touch of the body as it is.
        self._born = 0
        self._raised: tuple[int, int] | None = None
        # Number of the learner's touches from before the change.
        self._num_before = 0

    @property
    def has_doubts(self) -> bool:
        """Whether the agent noticed a change and has not yet explained it."""
        return self._raised is not None

    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Takes `(n, J)` q in the robot's units, and `(n, S)` N that was felt; no row is null."""
        touches = self._waiting.and_then(TouchSet(np.asarray(q), np.asarray(sensation)))
        while len(touches) >= _BLOCK:
            self._live(touches[:_BLOCK])
            touches = touches[_BLOCK:]
        self._waiting = touches

    def _live(self, block: TouchSet) -> None:
        first = self.num_touches
        self.num_touches += len(block)
        strange = block
        if self._raised is None:
            block, strange = self._watched(block, first)
            self._learn(block)
        else:
            self._surprised(block)
        if self._raised is not None:
            self._strange = self._strange.and_then(strange)
            if len(self._strange) >= _TO_EXPLAIN:
                self._explain(*self._raised)
            return
        if self._to_refine:
            self._strange = self._strange.and_then(block)
            if len(self._strange) >= self._to_refine[0]:
                self._refine()
        if self.num_touches - self._born >= self._expects_again_at:
            self._expect()

    def _surprised(self, block: TouchSet) -> np.ndarray:
        """`(n, S)` N, what was expected of these touches; keeps how much they surprised."""
        assert self._expectation is not None
        expected = self._expectation(block.q)
        self.surprise.append(self._expectation.surprise(expected, block.sensation))
        return expected

    def _watched(self, block: TouchSet, first: int) -> tuple[TouchSet, TouchSet]:
        """Cuts a block where the body changed: touches before and after; all before if not."""
        if self._expectation is None or self._tests is None:
            self.surprise.append(np.full(len(block), np.nan))
            return block, TouchSet.none()
        expected = with_unit_norm(self._surprised(block))
        by_surprise, by_receptors = self._tests
        rows = (
            (by_surprise.watch(self.surprise[-1], self._expectation.novelty(block.q)), by_surprise),
            (by_receptors.watch(expected, block.sensation), by_receptors),
        )
        self.doubts.append(by_surprise.doubt + by_receptors.doubt)
        raised = [(row, test.since) for row, test in rows if row is not None]
        if not raised:
            return block, TouchSet.none()
        row, num = min(raised, key=lambda one: one[0])
        since = row + 1 - num
        self._raised = first + row, first + since
        self._strange, self._to_refine = TouchSet.none(), []
        self._num_before = self.learner.num_touches + since
        if since < 0:
            # The last touches that it learned may be of the changed body.
            self._last = self._last[: max(len(self._last) + since, _BLOCK)]
        return block[: max(since, 0)], block[max(since, 0) :]

    def _learn(self, block: TouchSet) -> None:
        if len(block):
            self.learner.take(block.q, block.sensation)
            num = int(min(_USUAL * self.learner.num_touches, _MOST_USUAL))
            self._last = self._last.and_then(block)[-num:]

    def _explain(self, row: int, since: int) -> None:
        assert self._expectation is not None
        remembered, number = self._remembered()
        before = self._before = remembered[number < self._num_before]
        change = explain_change(
            self._expectation,
            self._last,
            before,
            self._strange,
            num_steps=self._num_steps,
            seed=self._seed,
        )
        self._born = since
        self.noticed.append(
            Noticed(row=row, since=since, explained_at=self.num_touches, change=change)
        )
        self._raised = self._tests = None
        self._begin_again(change, _TO_REFINE if change.is_a_guess else ())
        self._expect()

    def _refine(self) -> None:
        """Makes a guess more exact, with more touches of the changed body."""
        change = refined(self.noticed[-1].change, self._strange, seed=self._seed)
        self.noticed[-1] = replace(self.noticed[-1], change=change)
        self._begin_again(change, self._to_refine[1:])

    def _begin_again(self, change: BodyChange, to_refine: Sequence[int]) -> None:
        """A new learner takes the adapted touches, and the touches of the changed body."""
        self.learner, strange = self._make_learner(), self._strange
        # At once, so that targets are chosen where the body feels now.
        self._learn(change.adapted(self._before).and_then(strange))
        self._last = strange[len(strange) // 2 :]
        self._to_refine = list(to_refine)
        if not to_refine:
            self._before = self._strange = TouchSet.none()

    def _remembered(self) -> tuple[TouchSet, np.ndarray]:
        """The learner's touches, and `(n,)` their numbers in the order in which it took them."""
        held = self.learner.remembered()
        return TouchSet(held.columns["q"], held.columns["sensation"]), held.row

    def _expect(self) -> None:
        """Learns what to expect from all remembered touches except the last ones."""
        remembered, number = self._remembered()
        early = number < self.learner.num_touches - len(self._last)
        self._expectation = Expectation.learn(
            remembered[early], num_steps=self._num_steps, seed=self._seed
        )
        expected = self._expectation(self._last.q)
        usual = self._expectation.surprise(expected, self._last.sensation)
        # What began to feel shortly before is still new.
        never_felt = (
            ~np.any(remembered.sensation > 0, axis=0)
            if self._tests is None
            else self._tests[1].never_felt
        )
        self._tests = (
            SurpriseTest.calibrated(usual, self._expectation.novelty(self._last.q)),
            ReceptorTest.calibrated(
                with_unit_norm(expected),
                self._last.sensation,
                never_felt,
                self.learner.num_touches,
            ),
        )
        self._expects_again_at = max(_FIRST, _AGAIN * (self.num_touches - self._born))
