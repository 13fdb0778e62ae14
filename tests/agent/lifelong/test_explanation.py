"""An agent finds out how its body changed, and makes its touches those of today."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree

from selftouch_drake.agent.lifelong import explanation
from selftouch_drake.agent.lifelong.expectation import LearnedExpectation, TouchSet, cosine_distance
from selftouch_drake.agent.lifelong.explanation import Earlier, explain_change
from selftouch_drake.agent.lifelong.new_receptors import NewReceptors

NUM_OLD = 6000
#: Steps that train an expectation.
NUM_STEPS = 1000


@pytest.fixture(scope="module")
def expectation(touches):
    return LearnedExpectation(touches[:5000], num_steps=NUM_STEPS)


def found(expectation, touches, change):
    """What the agent makes of a change, of touches since, and of those of before."""
    new = touches[NUM_OLD:]
    since = TouchSet(*change(new.q.copy(), new.sensation.copy()))
    since = since[since.sensation.any(axis=1)]
    before = touches[:NUM_OLD]
    return explain_change(Earlier(expectation, before[5000:], before), since, num_steps=NUM_STEPS)


def test_it_expects_what_it_feels(touches, expectation):
    last = touches[5000:NUM_OLD]
    usual = expectation.surprise(expectation(last.q), last.sensation)
    assert np.median(usual) < 0.05


def test_nothing_changed_is_left_as_it_is(expectation, touches):
    change = found(expectation, touches, lambda q, s: (q, s))
    adapted = change.adapted(touches[:100])
    assert np.array_equal(adapted.q, touches.q[:100])
    assert np.array_equal(adapted.sensation, touches.sensation[:100])
    assert change.in_words == "nothing that explains it"


def test_silent_and_swapped_receptors_are_found(expectation, touches):
    swapped = np.arange(40)
    swapped[[3, 30]] = [30, 3]

    def altered(q, sensation):
        sensation = sensation[:, swapped]
        sensation[:, [5, 6]] = 0.0
        return q, sensation

    change = found(expectation, touches, altered)
    assert np.flatnonzero(change.silent).tolist() == [5, 6]
    assert np.array_equal(change.source, swapped)
    assert not change.displacement
    assert not change.offset.any()
    before = touches[:NUM_OLD]
    _, true = altered(before.q, before.sensation)
    kept = np.linalg.norm(true, axis=1) > 0.2 * np.linalg.norm(before.sensation, axis=1)
    assert np.array_equal(change.adapted(before).sensation, true[kept])


def test_one_silent_receptor_is_found(expectation, touches):
    def altered(q, sensation):
        sensation[:, 5] = 0.0
        return q, sensation

    change = found(expectation, touches, altered)
    assert change.in_words == "1 receptor is silent"


def test_a_zero_that_moved_is_one_number(expectation, touches):
    def altered(q, sensation):
        q[:, 1] -= 0.3
        return q, sensation

    change = found(expectation, touches, altered)
    assert not change.displacement
    assert np.flatnonzero(change.offset).tolist() == [1]
    assert change.offset[1] == pytest.approx(0.3, abs=0.02)
    now = change.adapted(touches[:10]).q
    assert now == pytest.approx(altered(touches.q[:10].copy(), None)[0], abs=0.02)


def test_a_new_receptor_is_filled_in_where_it_would_have_felt(touches):
    q, sensation = touches.q, touches.sensation
    blind = sensation.copy()
    blind[:, 7] = 0.0
    some = blind.any(axis=1)
    before = TouchSet(q, blind)[:NUM_OLD]
    expectation = LearnedExpectation(before[:5000][some[:5000]], num_steps=NUM_STEPS)
    usual = before[5000:][some[5000:NUM_OLD]]
    change = explain_change(Earlier(expectation, usual, before), touches[NUM_OLD:])
    assert np.flatnonzero(change.new.receptors).tolist() == [7]
    numbers = np.arange(1000)[:, None] * np.ones(q.shape[1])
    adapted = change.adapted(TouchSet(numbers, blind[:1000]))
    kept = adapted.q[:, 0].astype(int)
    # Also touches that the new receptor would have felt most are kept, as the others felt them too.
    most = sensation[:, 7] > 0.7 * np.linalg.norm(sensation, axis=1)
    assert most[kept].sum() > 0.9 * (most & some)[:1000].sum() > 5
    off = cosine_distance(adapted.sensation, sensation[kept])
    assert off[most[kept]].mean() < 0.05
    unadapted = cosine_distance(blind[:1000], sensation[:1000])[some[:1000]]
    assert off.mean() < unadapted.mean() / 10


def test_receptors_that_felt_less_often_are_new_too_and_touches_unlike_all_stay_as_they_are():
    # The last three felt nothing before; one of them still does not.
    once = np.array([[0.6, 0, 0, 0, 0.8, 0]], np.float32)
    often = np.repeat(np.array([[0.8, 0, 0, 0.6, 0, 0], [0, 0.6, 0, 0.8, 0, 0]], np.float32), 20, 0)
    silent_before = np.arange(6) >= 3
    new = NewReceptors(silent_before, np.concatenate([once, often]))
    assert np.flatnonzero(new.receptors).tolist() == [3, 4]
    before = np.array([[0, 3.0, 0, 0, 0, 0], [0, 0, 2.0, 0, 0, 0]], np.float32)
    assert new.filled_in(before) == pytest.approx(
        np.array([[0, 3, 0, 4, 0, 0], [0, 0, 2, 0, 0, 0]])
    )
    assert not NewReceptors(silent_before, once).receptors.any()
    assert np.array_equal(NewReceptors(silent_before, once).filled_in(before), before)


@pytest.mark.slow
def test_an_agent_that_expects_badly_finds_no_displacement_that_is_not_there(touches):
    # Place by place: the last places are not those that the agent learned from.
    _, place = cKDTree(touches.q[:150]).query(touches.q)
    touches = touches[np.argsort(place, kind="stable")]
    before, since = touches[:NUM_OLD], touches[NUM_OLD:]
    poor = LearnedExpectation(before[:5000], num_steps=30)
    dead = np.argsort(since.sensation.sum(axis=0))[-8:]
    sensation = since.sensation.copy()
    sensation[:, dead] = 0.0
    since = TouchSet(since.q, sensation)[sensation.any(axis=1)]

    change = explain_change(Earlier(poor, before[5000:], before), since, num_steps=30)
    assert np.array_equal(np.flatnonzero(change.silent), np.sort(dead))
    assert not change.displacement
    # A displacement would explain a good part of the surprise.
    fit, others = explanation._divided(since)
    displaced = explanation._displaced(dataclasses.replace(change, through=(poor,)), fit, 0)
    assert displaced.surprise_left(others) < 0.8 * change.surprise_left(others)


@pytest.mark.slow
def test_a_bent_arm_is_a_displacement_which_more_touches_make_exact(
    expectation, touches, unbent, monkeypatch
):
    monkeypatch.setattr(explanation, "_NETWORKS", 1)
    some = touches[:500]
    q, sensation = some.q, some.sensation
    strength = np.linalg.norm(sensation, axis=1)
    firm = strength >= np.quantile(strength, 0.25)

    def moved(change):
        """The rows that are left, and where they are now."""
        adapted = change.adapted(some)
        same = (adapted.sensation[:, None] == sensation).all(axis=2)
        assert (same.sum(axis=1) == 1).all()
        return same.argmax(axis=1), adapted.q

    def off(change):
        rows, now = moved(change)
        return np.abs(now - unbent(q[rows]))[:, :3].mean()

    change = found(expectation, touches, lambda q, s: (unbent(q)[:700], s[:700]))
    assert change.displacement
    since = touches[NUM_OLD:]
    felt = TouchSet(unbent(since.q), since.sensation)
    unexplained = dataclasses.replace(change, displacement=(), offset=np.zeros(5))
    assert change.surprise_left(felt[:700]) < unexplained.surprise_left(felt[:700]) / 2
    rows, now = moved(change)
    assert off(change) < 0.5 * np.abs(q - unbent(q))[rows, :3].mean()
    again = explanation.refined(change, felt)
    assert off(again) < off(change)
    # Joints without effect do not go astray.
    assert np.array_equal(rows, np.flatnonzero(firm))
    # The light ones are forgotten, and those at readings that the joints never had; no others.
    had = np.concatenate([touches.q[:NUM_OLD], unbent(since.q[:700])])
    assert change.reach == pytest.approx(np.array([had.min(axis=0), had.max(axis=0)]))
    narrow = 0.8 * change.reach
    few_rows, few_now = moved(dataclasses.replace(change, reach=narrow))
    within = ((now >= narrow[0]) & (now <= narrow[1])).all(axis=1)
    assert 0.1 < within.mean() < 0.9
    assert np.array_equal(few_rows, rows[within])
    assert np.array_equal(few_now, now[within])


def test_a_touch_that_is_felt_more_firmly_surprises(expectation, touches):
    q, sensation = touches.q[5000:], touches.sensation[5000:]
    expected = expectation(q)
    for factor in (1 / 4, 4):
        firmer = expectation.surprise(expected, factor * sensation)
        assert firmer.mean() > expectation.surprise(expected, sensation).mean() + 0.02
        np.testing.assert_allclose(
            cosine_distance(expected, factor * sensation),
            cosine_distance(expected, sensation),
            atol=1e-6,
        )
