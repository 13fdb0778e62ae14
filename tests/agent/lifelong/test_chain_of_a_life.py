"""Where a chain of joints is known, a change of the body is the fewest numbers of that chain."""

import numpy as np
import pytest
from hand_made_chains import ArmOnBall

from selftouch_drake.agent.body_model.chain_change import Change
from selftouch_drake.agent.body_model.known_chain import found_chain
from selftouch_drake.agent.lifelong import life as module
from selftouch_drake.agent.lifelong.expectation import (
    ChainExpectation,
    LearnedExpectation,
    TouchSet,
)
from selftouch_drake.agent.lifelong.explanation import (
    Earlier,
    LivedChain,
    explain_change,
    guess_change,
)
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life


@pytest.fixture(scope="module")
def before():
    return TouchSet(*ArmOnBall().touches(2400))


@pytest.fixture(scope="module")
def known(before):
    some = before[:400]
    return LivedChain(found_chain(some.q, some.sensation), some)


@pytest.fixture(scope="module")
def expectation(before):
    return LearnedExpectation(before[:2000], num_steps=500)


def found(expectation, before, known, since):
    return explain_change(Earlier(expectation, before[2000:], before, known), since, num_steps=500)


def test_a_chain_expects_in_new_postures_what_is_felt_where_they_lead(before, known):
    lived, new = (before[rows] for rows in (before.q[:, 0] < 0.0, before.q[:, 0] > 0.3))
    surprise = [
        np.median(one.surprise(one(new.q), new.sensation))
        for one in (
            ChainExpectation(known.chain, lived),
            LearnedExpectation(lived, num_steps=500),
        )
    ]
    assert surprise[0] < 0.2 * surprise[1]


def test_a_zero_moves_touches_by_that_much_though_receptors_died(before, known, expectation):
    q, felt = ArmOnBall().touches(200, seed=4)
    q[:, 1] -= 0.3
    dead = [5, 20]
    felt[:, dead] = 0.0
    change = found(expectation, before, known, TouchSet(q, felt)[felt.any(axis=1)])
    assert change.chain is not None
    (part,) = change.chain.parts
    assert (part.kind, part.joint) == (Change.ZERO, 1)
    assert part.amount == pytest.approx(0.3, abs=0.03)
    assert "the zero of joint 1 moved by +0." in change.in_words
    assert not change.displacement
    adapted = change.adapted(before[:100])
    assert (adapted.sensation[:, np.flatnonzero(change.silent)] == 0).all()
    assert set(np.flatnonzero(change.silent)) <= set(dead)


def guessed(expectation, before, known, since):
    return guess_change(Earlier(expectation, before[2000:], before, known), since)


def test_some_thirty_touches_are_enough_to_name_what_moved(before, known, expectation):
    q, felt = ArmOnBall().touches(35, seed=4)
    q[:, 1] -= 0.3
    change = guessed(expectation, before, known, TouchSet(q, felt))
    (part,) = change.chain.parts
    assert (part.kind, part.joint) == (Change.ZERO, 1)
    assert part.amount == pytest.approx(0.3, abs=0.05)
    assert change.left == change.chain.left < 1.5


def test_no_joint_is_guessed_where_receptors_died_or_nothing_changed(before, known, expectation):
    q, felt = ArmOnBall().touches(120, seed=4)
    assert guessed(expectation, before, known, TouchSet(q, felt)) is None
    felt[:, ::6] = 0.0
    some = TouchSet(q, felt)[felt.any(axis=1)]
    assert guessed(expectation, before, known, some) is None


def test_no_joint_is_guessed_where_touches_feel_like_none_before(before, known):
    expectation = ChainExpectation(known.chain, before[:2000])
    q, felt = ArmOnBall().touches(120, seed=4)
    q[:, 1] -= 0.3
    assert guessed(expectation, before, known, TouchSet(q, felt)) is not None
    felt[:, ::4] = np.roll(felt[:, ::4], 1, axis=1)
    assert guessed(expectation, before, known, TouchSet(q, felt)) is None


def test_touches_of_a_longer_fingertip_are_moved_to_where_they_are_felt(before, known, expectation):
    arm = ArmOnBall()
    arm.point = arm.point + np.array([0.2, -0.1, 0.1])
    since = TouchSet(*arm.touches(150, seed=4))
    change = found(expectation, before, known, since)
    assert change.chain is not None
    assert [part.kind for part in change.chain.parts] == [Change.TOUCHER]
    adapted = change.adapted(before[:300])
    touching = [arm.feel(one).any(axis=1).mean() for one in (adapted.q, before.q[:300])]
    assert len(adapted) > 200
    assert touching[1] < 0.85 < 0.93 < touching[0]
    assert change.left < 2
    # What touches moved, and no more: a life takes it for a tool, and knows the chain with it.
    life = Life()
    life._strange = since
    assert life._taken_in_hand(change, known) == "tool 0 is in hand, a new one"
    with_tool = life._chain.chain
    np.testing.assert_allclose(with_tool.chain.point, known.chain.chain.point + life.hand.offset)
    off = [
        np.median(chain.misplaced(since.q, since.sensation)[0])
        for chain in (with_tool, known.chain)
    ]
    assert off[0] < 0.5 * off[1]


@pytest.mark.slow
def test_a_life_explains_a_change_as_soon_as_it_is_noticed_and_ever_more_exactly(monkeypatch):
    monkeypatch.setattr(module, "_FIRST", 1500)
    q, felt = ArmOnBall().touches(2400, seed=1)
    q[2000:, 1] -= 0.4
    life = Life(lambda: OnlineLearner(40), num_steps=300)
    life.take(q[:2100], felt[:2100])
    (first,) = life.noticed
    assert 2000 <= first.row < first.explained_at <= 2100
    life.take(q[2100:], felt[2100:])
    (later,) = life.noticed
    assert (later.explained_at, later.withdrawn) == (first.explained_at, ())
    few, more = (noticed.change.chain.parts[0] for noticed in (first, later))
    assert (few.kind, few.joint) == (more.kind, more.joint) == (Change.ZERO, 1)
    assert more.sigma < 0.7 * few.sigma
    assert more.amount == pytest.approx(0.4, abs=0.02)
    assert not life.has_doubts


@pytest.mark.slow
def test_a_false_explanation_is_withdrawn_when_touches_go_on_to_disagree(monkeypatch):
    first = []

    def misled(earlier, since, *, newest=0):
        if not first:
            # As if the next joint's zero had moved.
            first.append(len(since))
            q = since.q.copy()
            q[:, 1] += 0.4
            q[:, 2] -= 0.4
            since = TouchSet(q, since.sensation)
        return guess_change(earlier, since, newest=newest)

    monkeypatch.setattr(module, "_FIRST", 1500)
    monkeypatch.setattr(module, "guess_change", misled)
    q, felt = ArmOnBall().touches(2600, seed=1)
    q[2000:, 1] -= 0.4
    life = Life(lambda: OnlineLearner(40), num_steps=300)
    life.take(q, felt)
    (noticed,) = life.noticed
    (withdrawn,) = noticed.withdrawn
    named = [
        [(part.kind, part.joint) for part in change.chain.parts]
        for change in (withdrawn, noticed.change)
    ]
    assert named == [[(Change.ZERO, 2)], [(Change.ZERO, 1)]]
    assert 2000 <= noticed.row < 2000 + first[0] < noticed.explained_at <= 2600
    assert not life.has_doubts
