"""A chain is known from some hundred touches on, follows them, and says which to make next."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import a_ball, an_arm, misfit, sample
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model import few, known_chain
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.known_chain import ChainLearner, found_chain, spread_out
from selftouch_drake.agent.body_model.next_touch import informative, next_touches, reachable

LIMITS = {"lower": np.full(4, -1.5), "upper": np.full(4, 1.5)}


@pytest.fixture(scope="module")
def arm():
    """Touches of an arm: readings, sensations, and where they lie."""
    q, sensation, y, _ = sample(1200)
    return q, sensation.toarray(), y


@pytest.fixture(scope="module")
def learner(arm):
    found = ChainLearner()
    found.take(arm[0][:160], arm[1][:160])
    return found


@pytest.fixture
def known(learner):
    return learner.known


def test_a_chain_is_known_once_touches_accept_it(arm, learner, known):
    early = ChainLearner()
    early.take(arm[0][:99], arm[1][:99])
    assert early.known is None
    assert sorted(known.joints) == [0, 1, 2, 3]
    assert not known.slides.any()
    assert misfit(known.places(arm[0][200:]), arm[2][200:]) < 2


def test_it_follows_the_touches_to_the_same_bytes(arm, known):
    chain = known.chain
    bent = replace(known, chain=replace(chain, twists=1.02 * chain.twists))
    again, other = (bent.fitted_to(arm[0][:300], arm[1][:300]) for _ in range(2))
    off = [misfit(one.places(arm[0][400:]), arm[2][400:]) for one in (bent, again)]
    assert off[1] < 0.4 < off[0]
    np.testing.assert_array_equal(again.chain.twists, other.chain.twists)


def test_only_the_last_touches_count_and_a_chain_that_fails_is_given_up(arm, known, monkeypatch):
    monkeypatch.setattr(known_chain, "_LAST", 150)
    asked = []
    monkeypatch.setattr(known_chain, "found_chain", lambda q, *_, **more: asked.append(len(q)))
    one = ChainLearner()
    one.known, one._due = known, 300
    one.take(arm[0][:200], arm[1][:200])
    assert one.known is not None
    assert len(one.known.q) == 150
    order = np.random.default_rng(0).permutation(150)
    one.take(arm[0][200:350][order], arm[1][200:350])
    assert one.known is None
    assert asked == [150]
    one.take(arm[0][:10], arm[1][:10])
    assert len(asked) == 1


def test_postures_are_put_where_they_should_touch(arm, known):
    q, _, _ = arm
    wanted = known.places(q[500:540])
    start = (q[500:540] + 0.2 * np.random.default_rng(0).standard_normal((40, 4))).clip(-1.5, 1.5)
    there = known.put(start, wanted, **LIMITS)
    before, after = (np.linalg.norm(known.places(x) - wanted, axis=1) for x in (start, there))
    assert np.median(after) < 0.01 * np.median(before)
    assert (np.abs(there) <= 1.5).all()
    # The shortest way.
    assert np.linalg.norm(there - start, axis=1).mean() < 0.6


def test_places_are_spread_out_by_hand():
    line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [10, 0, 0]])
    assert spread_out(line, 3).tolist() == [0, 4, 3]
    assert spread_out(line, 2, line[[4]]).tolist() == [0, 3]
    assert sorted(spread_out(line, 9).tolist()) == [0, 1, 2, 3, 4]


def test_next_touches_lie_on_the_skin_in_postures_near_those_lived(arm, known):
    random = np.random.default_rng(1)
    found = reachable(known, 300, random, LIMITS["lower"], LIMITS["upper"])
    assert len(found.q) > 120
    twists, point = an_arm()
    center, radius = a_ball(np.random.default_rng(0), twists, point)
    height = np.linalg.norm(places(found.q, twists, point) - center, axis=1) / radius - 1
    assert np.median(np.abs(height)) < 0.1
    assert np.median(cKDTree(known.q).query(found.q)[0]) < 0.8
    middle = known.places(known.q).mean(axis=0)
    out, deep = (np.linalg.norm(at - middle, axis=1) for at in (found.place, found.inner))
    assert (deep < out).mean() > 0.95


def test_half_is_for_the_joints_and_half_for_the_skin(known, monkeypatch):
    random = np.random.default_rng(2)
    chosen = next_touches(known, 40, random, **LIMITS)
    assert chosen.q.shape == (40, 4)
    lived = cKDTree(known.places(known.q))
    far = lived.query(chosen.place)[0]
    assert np.median(far[20:]) > 1.5 * np.median(far[:20])
    # Touches on the way count.
    again = next_touches(known, 40, np.random.default_rng(2), **LIMITS, planned=chosen.place)
    apart = cKDTree(chosen.place).query(again.place[20:])[0]
    assert apart.min() > 0.02 * known.radius
    np.testing.assert_array_equal(
        next_touches(known, 40, np.random.default_rng(2), **LIMITS).q, chosen.q
    )


def test_informative_touches_make_joints_surer_than_others(arm, known):
    q, sensation, y = arm
    # Joints that turn alike are surer by that than by touches.
    known = replace(known, alike=False)
    pool = np.arange(160, 1000)
    best = pool[informative(known, q[pool], 30, np.random.default_rng(0))]
    assert len(set(best.tolist())) == 30
    off = []
    for more in (best, *(np.random.default_rng(n).choice(pool, 30) for n in range(3))):
        rows = np.concatenate([np.arange(160), more])
        fitted = known.fitted_to(q[rows], sensation[rows])
        off.append(misfit(fitted.places(q[1000:]), y[1000:]))
    assert off[0] < 0.85 * np.mean(off[1:])


def test_a_body_that_does_not_move_has_no_chain():
    assert known_chain.found_chain(np.ones((120, 3)), np.ones((120, 9))) is None


def test_too_few_touches_of_many_joints_are_not_searched(monkeypatch):
    def searched(*args, **kwargs):
        raise AssertionError("a chain that nothing could judge was looked for")

    monkeypatch.setattr(few, "found_by_sensation", searched)
    random = np.random.default_rng(0)
    assert found_chain(random.standard_normal((100, 14)), random.random((100, 5))) is None
