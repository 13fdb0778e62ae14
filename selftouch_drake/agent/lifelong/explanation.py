"""Explains why touches surprise: tries what may have changed, from simple to complicated (naive).

Any fit lowers surprise, the more so the worse the agent expects. So each explanation is fitted a
second time, to touches from before the change, and only the ratio of the two surprises counts.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize_scalar

from selftouch_drake.agent.body_model.chain_change import ChainChange, explained, foretold
from selftouch_drake.agent.body_model.known_chain import KnownChain
from selftouch_drake.agent.lifelong.body_change import BodyChange
from selftouch_drake.agent.lifelong.expectation import (
    NUM_STEPS,
    ChainExpectation,
    Expectation,
    LearnedExpectation,
    TouchSet,
    with_unit_norm,
)
from selftouch_drake.agent.lifelong.new_receptors import FELT, SURELY, NewReceptors
from selftouch_drake.agent.network import Network, train
from selftouch_drake.quotient.sensations import unit

#: A more complicated explanation is taken if it leaves less than this share of the ratio of
#: surprises.
_WORTH = 0.9

#: The search for explanations ends once the ratio of surprises is at most this.
ENOUGH = 1.1

#: A reading moved if its cosine with what another receptor should feel exceeds by this much the
#: cosine with what its own receptor should feel.
_BETTER = 0.3

#: Usual touches that say how exactly sensations foretell places, and most touches since a change by
#: which a chain explains it. What a chain leaves out, such as how the skin gives way, is little,
#: but with more touches it earns numbers of its own: of 1000 touches of a cube whose skin slipped
#: it was stretched by 0.992, too.
_USUAL, _SINCE = 400, 300

#: One in so many touches, the first ones, may still be of the body as it was: an alarm tells only
#: roughly when the body changed. On a cube up to 11 of 61 were.
_EARLY = 4

#: A chain alone explains a change if it leaves touches off by this multiple of what is usual, in
#: squares. Right ones left 0.8 to 1.1 after 50 touches of a cube.
_LEFT = 1.5

#: A sensation is unlike all before if fewer than this share of usual ones are so far from those
#: known: with a tenth of the receptors dead or exchanged half to nine tenths of some hundred
#: touches of a torus were, while its finger slid; up to 0.17 if a link of a cube grew, or nothing
#: changed.
_UNLIKE, _MANY_UNLIKE = 0.05, 0.3

#: Offsets of a joint are tried within so many standard deviations to either side.
_REACH = 1.0

#: Number of offsets that are tried for each joint.
_TRIED = 41

#: Touches for the first search of each joint's offset.
_FEW = 400

#: A blunt expectation has the training steps of a sharp one divided by this.
_BLUNT = 2

#: Networks of a displacement, of which the mean counts. After the forearm of a torus grew, what is
#: felt at moved touches is off by a cosine distance of 0.0025 (median), of 0.0032 with three.
_NETWORKS = 6

#: Hidden units of such a network, and its training steps, for 1000 touches; both grow with the
#: square root of the number of touches. On a cube that was stretched, with 5000 touches since, 81 %
#: of the earlier touches still touch once they are moved, and 82 % with twice as many of both.
_HIDDEN, _NUM_STEPS = 32, 500

#: Touches per training step.
_BATCH = 512

#: Weight of the squared displacement, in standard deviations, beside the squared error of what is
#: expected, for 1000 touches; it falls with the square root of their number. Without it, joints
#: without effect on a touch go astray: of 3000 touches of a cube, 1510 are kept and touch, not 1680
#: (1000 touches since).
_PENALTY = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class LivedChain:
    """A chain, and the touches from before the change to which it was fitted."""

    chain: KnownChain
    touches: TouchSet


@dataclass(frozen=True, slots=True, eq=False)
class Earlier:
    """What an agent knew before a change.

    Attributes:
        expectation: what it expected.
        usual: the last touches, in order, from which the expectation did not learn.
        before: the touches that it remembered.
        known: the chain of its joints; None if it knows none.
    """

    expectation: Expectation
    usual: TouchSet
    before: TouchSet
    known: LivedChain | None = None


def explain_change(
    earlier: Earlier, since: TouchSet, *, num_steps: int = NUM_STEPS, seed: int = 0
) -> BodyChange:
    """Finds out what changed, by touches since the change; none of them is null.

    As many of the usual touches count as there are touches since. The steps train an expectation.
    If a chain is known, what moved is the fewest numbers of it that explain where touches are felt.
    """
    expectation, before, known = earlier.expectation, earlier.before, earlier.known
    fitted, judged = _divided(since)
    usual_fitted, usual_judged = _divided(earlier.usual[-len(since) :])
    unchanged = _unchanged(expectation, before, fitted)
    by_chance = replace(
        unchanged,
        # Before the change, receptors that are new felt nothing.
        new=NewReceptors(np.zeros_like(unchanged.silent), unit(fitted.sensation)),
        # Other networks would learn from the touches that are compared with. Twice, for as many
        # steps as through a blunt and a sharp one.
        through=(expectation, expectation) if isinstance(expectation, LearnedExpectation) else (),
    )
    best = _Explanation.judged(unchanged, by_chance, judged, usual_judged)
    displaced = partial(_displaced_through_expectations, before, num_steps, seed)
    way = partial(_by_chain, known, earlier.usual) if known is not None else None
    for tried in (_rewired, way) if way else (_rewired, _with_offset, displaced):
        if best.ratio <= ENOUGH:
            break
        found = _Explanation.judged(
            tried(best.change, fitted),
            tried(best.by_chance, usual_fitted),
            judged,
            usual_judged,
        )
        if found.ratio < _WORTH * best.ratio:
            best = found
    if way and best.change.chain is not None:
        # Those that judged it make its numbers more exact.
        again = way(replace(best.change, chain=None), since)
        best = replace(best, change=again if again.chain is not None else best.change)
    # One silent receptor of many leaves hardly any surprise.
    silent = best.change.silent | _silent(best.change, since)
    change = replace(best.change, silent=silent, left=best.ratio)
    return refined(change, since, seed=seed)


def guess_change(earlier: Earlier, since: TouchSet, *, newest: int = 0) -> BodyChange | None:
    """What moved of the chain, if that alone explains few touches.

    Surprise says little of few touches; by how far they are misplaced, some thirty are enough.

    Args:
        earlier: with a chain.
        since: touches since the change; none of them is null.
        newest: so many of the last are to be explained as well as all.
    """
    assert earlier.known is not None
    if _feels_otherwise(earlier, since[len(since) // _EARLY :]):
        return None
    unchanged = _unchanged(earlier.expectation, earlier.before, since)
    # A receptor that was not felt since may be silent: nothing of the chain is to explain that.
    heard = replace(unchanged, silent=~np.any(since.sensation, axis=0))
    found = _by_chain(earlier.known, earlier.usual, heard, since[len(since) // _EARLY :])
    if unchanged.new.receptors.any() or found.chain is None or found.chain.left > _LEFT:
        return None
    if newest and _left_by(found.chain, earlier, since[-newest:]) > _LEFT:
        return None
    return replace(found, silent=unchanged.silent, left=found.chain.left)


def _unchanged(expectation: Expectation, before: TouchSet, since: TouchSet) -> BodyChange:
    """A body that is as it was, but for receptors that are new."""
    silent_before = ~np.any(before.sensation > 0, axis=0)
    return BodyChange(
        expectation=expectation,
        source=np.arange(len(silent_before)),
        silent=np.zeros_like(silent_before),
        new=NewReceptors(silent_before, unit(since.sensation)),
        offset=np.zeros(since.q.shape[1]),
        reach=np.stack([before.q.min(axis=0), before.q.max(axis=0)]),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Explanation:
    """A change that may explain surprising touches.

    Attributes:
        change: as fitted to touches since the change.
        by_chance: the same explanation as fitted to usual touches, where nothing changed.
        ratio: of the surprise that the first leaves over that which the second leaves.
    """

    change: BodyChange
    by_chance: BodyChange
    ratio: float

    @classmethod
    def judged(
        cls, change: BodyChange, by_chance: BodyChange, since: TouchSet, usual: TouchSet
    ) -> Self:
        """Judges a change by touches to which it was not fitted."""
        ratio = change.surprise_left(since) / by_chance.surprise_left(usual)
        return cls(change=change, by_chance=by_chance, ratio=ratio)


def _displaced_through_expectations(
    before: TouchSet, num_steps: int, seed: int, change: BodyChange, touches: TouchSet
) -> BodyChange:
    """As `_displaced`; a change without expectations gets a blunt and a sharp one.

    They learn from touches before the change; `num_steps` train the sharp one.
    """
    through = change.through or tuple(
        LearnedExpectation(before, like=change.expectation, num_steps=steps, seed=seed)
        for steps in (num_steps // _BLUNT, num_steps)
    )
    return _displaced(replace(change, through=through), touches, seed)


def refined(change: BodyChange, since: TouchSet, *, seed: int = 0) -> BodyChange:
    """Makes a displacement, or a guess of what new receptors feel, more exact with more touches.

    No sensation of `since` is null; `seed` is for the training.
    """
    new = NewReceptors(change.new.silent_before, unit(since.sensation))
    q = np.concatenate([change.reach, since.q])
    change = replace(change, new=new, reach=np.stack([q.min(axis=0), q.max(axis=0)]))
    return _displaced(change, since, seed) if change.displacement else change


def _divided(touches: TouchSet) -> tuple[TouchSet, TouchSet]:
    """Two thirds, to which explanations are fitted, and every third touch, to judge them."""
    judge = np.arange(len(touches)) % 3 == 2
    return touches[~judge], touches[judge]


def _rewired(change: BodyChange, touches: TouchSet) -> BodyChange:
    """Finds silent receptors, and readings that changed places."""
    expected, felt = with_unit_norm(change.expected(touches.q)), unit(touches.sensation)
    both = expected.T @ felt
    both /= np.outer(np.linalg.norm(expected, axis=0), np.linalg.norm(felt, axis=0)) + 1e-9
    _, was = linear_sum_assignment(-both.T)
    reading = np.arange(len(was))
    moved = both[was, reading] > both[reading, reading] + _BETTER
    # Where a reading moved, its own receptor must be the source of another moved reading.
    while moved.any() and (lost := moved & ~np.isin(reading, was[moved])).any():
        moved &= ~lost
    source = np.where(moved, was, reading)
    return replace(change, source=source, silent=_silent(change, touches))


def _by_chain(
    known: LivedChain, usual: TouchSet, change: BodyChange, touches: TouchSet
) -> BodyChange:
    """Finds what moved of a chain, by touches that are felt as they would be since the change."""
    felt = change.readings(known.touches.sensation)
    left = np.any(felt, axis=1)
    adapted = known.chain.felt_as(known.touches.q[left], felt[left])
    same = TouchSet(usual.q, change.readings(usual.sensation))
    same = same[np.any(same.sensation, axis=1)][-_USUAL:]
    some = np.linspace(0, len(touches) - 1, min(len(touches), _SINCE)).astype(int)
    found = explained(
        adapted,
        *foretold(adapted, (same.q, same.sensation), (touches.q[some], touches.sensation[some])),
    )
    q = np.concatenate([change.reach, touches.q])
    return replace(change, chain=found, reach=np.stack([q.min(axis=0), q.max(axis=0)]))


def _feels_otherwise(earlier: Earlier, since: TouchSet) -> bool:
    """Whether sensations are unlike those before: a chain that moves leaves them as they are."""
    expectation = earlier.expectation
    if not isinstance(expectation, ChainExpectation):
        return False
    usual, now = (expectation.unlike(some.sensation) for some in (earlier.usual, since))
    return float(np.mean(now > np.quantile(usual, 1 - _UNLIKE))) > _MANY_UNLIKE


def _left_by(change: ChainChange, earlier: Earlier, touches: TouchSet) -> float:
    """How far a change leaves touches off, in squares, as a multiple of what is usual."""
    usual = earlier.usual[-_USUAL:]
    return change.left_of(
        *foretold(change.before, (usual.q, usual.sensation), (touches.q, touches.sensation))
    )


def _silent(change: BodyChange, touches: TouchSet) -> np.ndarray:
    """`(S,)` bool, receptors that should have felt and never did."""
    expected = with_unit_norm(change.expected(touches.q))
    return ((expected > FELT).sum(axis=0) >= SURELY) & ~touches.sensation.any(axis=0)


def _with_offset(change: BodyChange, touches: TouchSet) -> BodyChange:
    """Finds joints whose zeros moved, one after another, as long as surprise falls."""
    axes = np.diag(change.expectation.scale)

    def left(offset: np.ndarray, num: int | None = None) -> float:
        return replace(change, offset=offset).surprise_left(touches[:num])

    best, least = change.offset, left(change.offset)
    for _ in axes:
        tried = [best + by * axis for axis in axes for by in np.linspace(-_REACH, _REACH, _TRIED)]
        found = min(tried, key=lambda offset: left(offset, _FEW))
        axis = axes[np.abs(found - best).argmax()]
        finer = minimize_scalar(
            lambda by, found=found, axis=axis: left(found + by * axis),
            bounds=(-2 * _REACH / (_TRIED - 1), 2 * _REACH / (_TRIED - 1)),
            method="bounded",
            options={"maxiter": 12},
        )
        if finer.fun > _WORTH * least:
            break
        best, least = found + finer.x * axis, finer.fun
    return replace(change, offset=best)


def _displaced(change: BodyChange, touches: TouchSet, seed: int) -> BodyChange:
    """Learns where the joints would have to be for the agent to expect what it feels.

    A blunt expectation shows from farther away where to go, a sharp one where exactly. So the
    displacement is learned through one after the other.
    """
    expectation, rng = change.expectation, np.random.default_rng(seed)
    # What readings would have been before they changed places; silent and new ones say nothing,
    # nor does firmness if there are any.
    unknown = change.silent | change.new.receptors
    wanted = expectation.as_learned(touches)
    counts = np.full(wanted.shape[1], not unknown.any(), np.float32)
    wanted[:, change.source] = wanted[:, :-1].copy()
    counts[change.source] = ~unknown
    x = expectation.standardised(touches.q)
    start = expectation.standardised(touches.q + change.offset)
    num_joints, growth = x.shape[1], math.sqrt(len(x) / 1000)

    def trained() -> Network:
        network = Network.random([num_joints, round(_HIDDEN * growth), num_joints], rng)
        network.weights[-1][:] = 0.0
        for expects in (one.network for one in change.through):

            def slope(
                displaced: np.ndarray, rows: np.ndarray, expects: Network = expects
            ) -> np.ndarray:
                outputs, _, slopes = expects.forward(start[rows] + displaced)
                off = 2.0 * counts * (outputs - wanted[rows]) / len(rows)
                pull = 2.0 * _PENALTY / growth / len(rows) * displaced
                return expects.slope_of_inputs(off, slopes) + pull

            draw = partial(rng.integers, len(x), size=_BATCH)
            train(network, x, draw, slope, round(_NUM_STEPS * growth))
        return network

    return replace(change, displacement=tuple(trained() for _ in range(_NETWORKS)))
