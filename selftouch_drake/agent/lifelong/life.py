"""A life: the agent learns from touches as they come, notices changes of its body, and adapts."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain_change import Change
from selftouch_drake.agent.body_model.known_chain import found_chain
from selftouch_drake.agent.body_model.tools import Hand
from selftouch_drake.agent.lifelong.alarm import PlaceTest, ReceptorTest, SurpriseTest
from selftouch_drake.agent.lifelong.body_change import BodyChange
from selftouch_drake.agent.lifelong.expectation import (
    NUM_STEPS,
    ChainExpectation,
    Expectation,
    LearnedExpectation,
    TouchSet,
    with_unit_norm,
)
from selftouch_drake.agent.lifelong.explanation import (
    ENOUGH,
    Earlier,
    LivedChain,
    explain_change,
    guess_change,
    refined,
)
from selftouch_drake.agent.lifelong.learner import OnlineLearner

#: Touches of a body after which the agent learns what to expect.
_FIRST = 5000

#: It learns that again each time the touches have grown by this factor. With a factor of 2, an
#: agent that explores actively expects as badly at 8000 touches as it did at 5000: its mean
#: surprise is 0.44, not 0.10.
_AGAIN = 1.5

#: The last touches, this share of all, say what surprise is usual: the expectation does not learn
#: from them.
_USUAL = 0.2

#: Most touches that say what surprise is usual.
_MOST_USUAL = 10_000

#: Touches of the changed body from which the agent explains the change.
_TO_EXPLAIN = 1000

#: Touches of the changed body from which it tries to explain the change by its chain alone.
_TO_GUESS = (30, 100, 300)

#: Touches from before a change from which the chain of the body is found.
_OF_CHAIN = 600

#: Touches of the changed body from which it makes a guess more exact.
_TO_REFINE = (2000, 4000)

#: Touches that the agent takes at a time, so that a life does not depend on the size of its chunks.
_BLOCK = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noticed:
    """A change that the agent noticed.

    Attributes:
        row: number of the touch at which the agent noticed it.
        since: number of the first touch that the agent takes for one of the changed body.
        explained_at: number of touches of the life when the agent had explained it.
        change: the explanation; it may become more exact later.
        in_hand: what is in hand since then, if what touches moved and nothing else; else empty.
        withdrawn: explanations of this change that it believed before, and then withdrew.
    """

    row: int
    since: int
    explained_at: int
    change: BodyChange
    in_hand: str = ""
    withdrawn: tuple[BodyChange, ...] = ()

    @property
    def in_words(self) -> str:
        """What the agent found, in one line."""
        return f"{self.change.in_words} ({self.in_hand})" if self.in_hand else self.change.in_words


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Guess:
    """An explanation by few touches, which more may refute.

    Attributes:
        earlier: what the agent knew before the change.
        hand: what it had in hand.
        strange: all touches since the change.
    """

    earlier: Earlier
    hand: Hand
    strange: TouchSet


class Life:
    """An agent that learns, expects, notices, explains and adapts, touch by touch.

    Args:
        make_learner: makes a learner that knows nothing; after a change, the agent gives a new one
            the adapted touches.
        seed: from which all randomness comes.
        num_steps: training steps of the expectation; with fewer, the agent notices less.
        every: of so many touches in a row it takes one; others of a body that is felt many times in
            each step tell it nothing new, and seem to confirm what they repeat.
        asks: whether it asks, after a change, for the chain of its joints.

    Attributes:
        learner: what the agent knows; another one after each change.
        noticed: the changes that the agent noticed, in order.
        surprise: surprise of each touch, `(n,)` arrays in order; NaN before anything is expected.
        doubts: `(3,)` greatest evidence in each block that the body changed, as a share of what
            raises the alarm: by surprise, silent receptors, new receptors.
        hand: the tools that the agent knows, and which it has in hand.
        num_touches: number of touches that it took up to now.
    """

    def __init__(
        self,
        make_learner: Callable[[], OnlineLearner] = OnlineLearner,
        *,
        seed: int = 0,
        num_steps: int = NUM_STEPS,
        every: int = 1,
        asks: bool = True,
    ) -> None:
        self.every, self._num_given, self._asks = every, 0, asks
        self._make_learner, self._seed, self._num_steps = make_learner, seed, num_steps
        self.learner = make_learner()
        self.noticed: list[Noticed] = []
        self.surprise: list[np.ndarray] = []
        self.doubts: list[tuple[float, ...]] = []
        self.hand = Hand()
        self.num_touches = 0
        self._watching: tuple[Expectation, SurpriseTest, ReceptorTest] | None = None
        # Likewise, whether the chain takes what touches to where it is felt; None without a chain.
        self._placed: PlaceTest | None = None
        # How much surprise, and places, of touches that follow each other are alike.
        self._correlation = 1.0, 1.0
        self._expects_again_at: float = _FIRST
        # `(S,)` receptors that had felt nothing when the agent first knew what to expect.
        self._never_felt: np.ndarray | None = None
        # Touches that wait for a full block; the last learned ones; those of a changed body.
        self._waiting = self._last = self._strange = TouchSet()
        # Remembered touches from before the last change, as they were, and the numbers of strange
        # touches at which the agent makes a guess more exact.
        self._before = TouchSet()
        self._to_refine: Sequence[int] = ()
        # Likewise, at which it guesses; and the chain of the body, once found. That which explained
        # a change becomes the chain of the changed body, in the same frame.
        self._to_guess: Sequence[int] = ()
        self._chain: LivedChain | None = None
        # The last explanation, as long as few touches tell it.
        self._guessed: _Guess | None = None
        # Whether it is to ask for one; touches that accept none are not asked again.
        self._asks_for_chain = asks
        # Number of the first touch of the body as it is.
        self._born = 0
        # Where the alarm was raised, and the first touch of the changed body, if unexplained.
        self._raised: tuple[int, int] | None = None
        # Number of the learner's touches from before the change.
        self._num_before = 0

    @property
    def has_doubts(self) -> bool:
        """Whether the agent noticed a change and has not yet explained it."""
        return self._raised is not None

    def take(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Takes `(n, J)` q in the robot's units, and `(n, S)` N that was felt; no row is null."""
        rows = slice(-self._num_given % self.every, None, self.every)
        self._num_given += len(q)
        touches = self._waiting.and_then(TouchSet(np.asarray(q), np.asarray(sensation))[rows])
        while len(touches) >= _BLOCK:
            self._live(touches[:_BLOCK])
            touches = touches[_BLOCK:]
        self._waiting = touches

    def _live(self, block: TouchSet) -> None:
        self.num_touches += len(block)
        changed = self._watch(block)
        self._learn(block[:changed])
        if self._guessed is not None:
            strange = self._guessed.strange.and_then(block)
            self._guessed = replace(self._guessed, strange=strange)
        if self._raised is not None:
            self._strange = self._strange.and_then(block[changed:])
            if len(self._strange) >= _TO_EXPLAIN:
                self._explain(*self._raised, *self._explanation())
            elif self._to_guess and len(self._strange) >= self._to_guess[0]:
                self._to_guess = self._to_guess[1:]
                if not self._tells_again(newest=len(self._strange)):
                    self._guess()
            return
        if self._guessed is not None:
            num = len(self._guessed.strange)
            if any(num - len(block) < due <= num for due in (*_TO_GUESS, _TO_EXPLAIN)):
                self._tells_again()
            if num >= _TO_EXPLAIN:
                self._guessed = None  # touches went on to agree
        if self._to_refine:
            self._strange = self._strange.and_then(block)
            if len(self._strange) >= self._to_refine[0]:
                # More touches of the changed body make a guess more exact.
                self._to_refine = self._to_refine[1:]
                change = refined(self.noticed[-1].change, self._strange, seed=self._seed)
                self.noticed[-1] = replace(self.noticed[-1], change=change)
                self._begin_again(change)
        if self.num_touches - self._born >= self._expects_again_at:
            self._expect()

    def _watch(self, block: TouchSet) -> int:
        """The row from which on the touches are of a changed body; their number if none is."""
        if self._watching is None:
            self.surprise.append(np.full(len(block), np.nan))
            return len(block)
        expectation, rise, receptors = self._watching
        expected = expectation(block.q)
        self.surprise.append(expectation.surprise(expected, block.sensation))
        if self._raised is not None:
            return 0
        novelty = expectation.novelty(block.q)
        rows: list[tuple[int | None, SurpriseTest | ReceptorTest]] = [
            (rise.watch(self.surprise[-1], novelty), rise),
            (receptors.watch(with_unit_norm(expected), block.sensation, novelty), receptors),
        ]
        doubt = rise.doubt
        if self._placed is not None and self._chain is not None:
            misplaced = self._chain.chain.misplaced(block.q, block.sensation)
            rows.append((self._placed.watch(*misplaced), self._placed))
            doubt = max(doubt, self._placed.doubt)
        self.doubts.append(doubt + receptors.doubt)
        raised = [(row, test.since) for row, test in rows if row is not None]
        if not raised:
            return len(block)
        row, num = min(raised, key=lambda one: one[0])
        since, first = row + 1 - num, self.num_touches - len(block)
        self._raised = first + row, first + since
        self._strange, self._to_refine = TouchSet(), ()
        self._to_guess = _TO_GUESS
        self._num_before = self.learner.num_touches + since
        if since < 0:
            # The last touches that it learned may be of the changed body.
            self._last = self._last[: max(len(self._last) + since, _BLOCK)]
        return max(since, 0)

    def _learn(self, block: TouchSet) -> None:
        if len(block):
            self.learner.take(block.q, block.sensation)
            num = int(min(_USUAL * self.learner.num_touches, _MOST_USUAL))
            self._last = self._last.and_then(block)[-num:]

    def _explanation(self) -> tuple[BodyChange, Earlier]:
        """What changed, by the strange touches, and what was known before."""
        earlier = self._look_back()
        change = explain_change(earlier, self._strange, num_steps=self._num_steps, seed=self._seed)
        return change, earlier

    def _guess(self) -> None:
        """Explains the change by what moved of the chain, if that explains the strange touches."""
        assert self._raised is not None
        earlier = self._look_back()
        if earlier.known is None:
            self._to_guess = ()
            return
        change = guess_change(earlier, self._strange)
        if change is not None:
            self._guessed = _Guess(
                earlier=earlier, hand=copy.deepcopy(self.hand), strange=self._strange
            )
            self._explain(*self._raised, change, earlier)

    def _tells_again(self, newest: int = 0) -> bool:
        """Whether all touches since the last change explain it anew.

        If they name something else, what was believed is withdrawn. If so many of the newest raised
        an alarm, these must be explained as well as all.
        """
        if self._guessed is None:
            return False
        guess, was = self._guessed, self.noticed[-1]
        change = guess_change(guess.earlier, guess.strange, newest=newest)
        if change is None:
            return False
        same = _moved(change) == _moved(was.change)
        self.noticed.pop()
        self._strange, self._before = guess.strange, guess.earlier.before
        self.hand = copy.deepcopy(guess.hand)
        withdrawn = was.withdrawn if same else (*was.withdrawn, was.change)
        self._explain(was.row, was.since, change, guess.earlier, withdrawn)
        if same:
            self.noticed[-1] = replace(self.noticed[-1], explained_at=was.explained_at)
        return True

    def _look_back(self) -> Earlier:
        """What the agent knew before the change."""
        assert self._watching is not None
        remembered, number = self._remembered()
        self._before = remembered[number < self._num_before]
        self._chain = self._chain or self._chain_of(self._before)
        return Earlier(self._watching[0], self._last, self._before, self._chain)

    def _explain(
        self,
        row: int,
        since: int,
        change: BodyChange,
        earlier: Earlier,
        withdrawn: tuple[BodyChange, ...] = (),
    ) -> None:
        self.noticed.append(
            Noticed(
                row=row,
                since=since,
                explained_at=self.num_touches,
                change=change,
                in_hand=self._taken_in_hand(change, earlier.known),
                withdrawn=withdrawn,
            )
        )
        if len(self._strange) >= _TO_EXPLAIN:
            self._guessed = None
        self._born, self._raised, self._never_felt = since, None, None
        guess = change.displacement or change.new.receptors.any()
        self._to_refine = _TO_REFINE if guess else ()
        self._begin_again(change)
        self._expect()

    def _taken_in_hand(self, change: BodyChange, before: LivedChain | None) -> str:
        """What the agent finds in its hand after a change; the chain becomes that of the change."""
        self._chain, self._asks_for_chain = None, self._asks
        unexplained = change.chain is None and change.left > ENOUGH
        if before is None or change.displacement or unexplained:
            # Tools are places in the frame of one chain.
            self.hand = Hand()
            return ""
        said, moved = "", change.chain
        chain = before.chain if moved is None else moved.after
        if moved is not None and [part.kind for part in moved.parts] == [Change.TOUCHER]:
            said, chain = self.hand.moved(moved, len(self._strange))
        elif moved is not None:
            self.hand.turned(moved.turn)
        adapted = change.adapted(before.touches)
        if len(adapted) >= _OF_CHAIN // 2:
            self._chain = LivedChain(chain.felt_as(adapted.q, adapted.sensation), adapted)
        else:
            self.hand = Hand()
        return said

    def _chain_of(self, touches: TouchSet) -> LivedChain | None:
        """The chain of the body's joints, if touches of one part accept one."""
        several = self.learner.representation.num_parts > 1
        if not self._asks_for_chain or several:
            return None
        rows = np.random.default_rng(self._seed).permutation(len(touches))[:_OF_CHAIN]
        some = touches[np.sort(rows)]
        chain = found_chain(some.q.astype(float), some.sensation.astype(float), seed=self._seed)
        self._asks_for_chain = chain is not None
        return None if chain is None else LivedChain(chain, some)

    def _begin_again(self, change: BodyChange) -> None:
        """A new learner takes the adapted touches, and the touches of the changed body."""
        self.learner, strange = self._make_learner(), self._strange
        # At once, so that targets are chosen where the body feels now. In no order, as the last
        # ones say what is usual as long as there are few strange ones.
        adapted = change.adapted(self._before)
        order = np.random.default_rng(self._seed).permutation(len(adapted))
        self._learn(adapted[order].and_then(strange))
        few = max(_TO_EXPLAIN - len(strange), 0)
        self._last = adapted[order][len(adapted) - few :].and_then(strange)[-_TO_EXPLAIN // 2 :]
        if not self._to_refine:
            self._before = self._strange = TouchSet()

    def _remembered(self) -> tuple[TouchSet, np.ndarray]:
        """The learner's touches, each once, and `(n,)` their numbers in the order it took them."""
        held = self.learner.remembered()
        first = held.distinct
        return TouchSet(held.columns["q"], held.columns["sensation"])[first], held.row[first]

    def _expect(self) -> None:
        """Learns what to expect from all remembered touches except the last ones."""
        (remembered, number), last = self._remembered(), self._last
        early = remembered[number < self.learner.num_touches - len(last)]
        self._chain, self._placed = self._chain or self._chain_of(early), None
        expectation: Expectation
        if self._chain is not None:
            expectation = ChainExpectation(self._chain.chain, early)
        else:
            expectation = LearnedExpectation(early, num_steps=self._num_steps, seed=self._seed)
        expected = expectation(last.q)
        if self._never_felt is None:  # later, what began to feel shortly before is still new
            self._never_felt = ~np.any(remembered.sensation > 0, axis=0)
        felt, num_touches = last.sensation, self.learner.num_touches
        usual, novelty = expectation.surprise(expected, felt), expectation.novelty(last.q)
        # Soon after a change, the last touches are not in the order in which they came.
        ordered = self.num_touches - self._born >= len(last)
        surprising, misplacing = (1.0, 1.0) if ordered else self._correlation
        rise = SurpriseTest(usual, novelty, correlation=surprising)
        if self._chain is not None:
            off = self._chain.chain.misplaced(last.q, felt)
            self._placed = PlaceTest(*off, correlation=misplacing)
            misplacing = self._placed.correlation
        self._correlation = rise.correlation, misplacing
        self._watching = (
            expectation,
            rise,
            ReceptorTest(with_unit_norm(expected), felt, novelty, self._never_felt, num_touches),
        )
        self._expects_again_at = max(_FIRST, _AGAIN * (self.num_touches - self._born))


def _moved(change: BodyChange) -> set[tuple[Change, int]]:
    """What moved of the chain, and at which joint."""
    parts = () if change.chain is None else change.chain.parts
    return {(part.kind, part.joint) for part in parts}
