"""An agent notices that its body changed, finds out how, and makes its touches those of today."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree
from skins import touch

from selftouch_drake.agent.lifelong import Alarm, Expectation, Life, OnlineLearner, explain_change
from selftouch_drake.agent.lifelong import body_change as mends
from selftouch_drake.agent.lifelong import displacement as displacements
from selftouch_drake.agent.lifelong import life as module
from selftouch_drake.agent.lifelong.body_change import learned_again
from selftouch_drake.agent.lifelong.new_receptors import NewReceptors
from selftouch_drake.agent.lifelong.receptors import DeadReceptorTest, NewReceptorTest
from selftouch_drake.agent.lifelong.surprise import surprise

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")

NUM_OLD, NUM_NEW = 6000, 1500


@pytest.fixture(scope="module")
def touches():
    q, sensation, *_ = touch(["sphere"], NUM_OLD + NUM_NEW, num_receptors=40)
    order = np.random.default_rng(0).permutation(len(q))
    return q[order].astype(np.float32), sensation[order].astype(np.float32)


@pytest.fixture(scope="module")
def expectation(touches):
    q, sensation = touches
    return Expectation.learn(q[:5000], sensation[:5000], num_steps=1600)


@pytest.fixture(scope="module")
def usual(touches, expectation):
    q, sensation = touches
    return expectation.surprise(expectation(q[5000:NUM_OLD]), sensation[5000:NUM_OLD])


def found(expectation, touches, usual, change):
    """What the agent makes of a change, of touches since, and of those of before."""
    q, sensation = touches
    new_q, new = change(q[NUM_OLD:].copy(), sensation[NUM_OLD:].copy())
    felt = new.any(axis=1)
    return explain_change(
        expectation,
        (q[5000:NUM_OLD], sensation[5000:NUM_OLD]),
        (q[:NUM_OLD], sensation[:NUM_OLD]),
        new_q[felt],
        new[felt],
        num_steps=1600,
    )


def test_it_expects_what_it_feels(usual):
    assert np.median(usual) < 0.05


def test_nothing_changed_is_left_as_it_is(expectation, touches, usual):
    mending = found(expectation, touches, usual, lambda q, s: (q, s))
    q, sensation = mending.mended(touches[0][:100], touches[1][:100])
    assert np.array_equal(q, touches[0][:100])
    assert np.array_equal(sensation, touches[1][:100])
    assert mending.in_words == "nothing that explains it"


def test_silent_and_swapped_receptors_are_found(expectation, touches, usual):
    swapped = np.arange(40)
    swapped[[3, 30]] = [30, 3]

    def change(q, sensation):
        sensation = sensation[:, swapped]
        sensation[:, [5, 6]] = 0.0
        return q, sensation

    mending = found(expectation, touches, usual, change)
    assert np.flatnonzero(mending.silent).tolist() == [5, 6]
    assert np.array_equal(mending.source, swapped)
    assert not mending.displacement
    assert not mending.offset.any()
    q, sensation = touches[0][:NUM_OLD], touches[1][:NUM_OLD]
    _, mended = mending.mended(q, sensation)
    _, true = change(q, sensation)
    kept = np.linalg.norm(true, axis=1) > 0.2 * np.linalg.norm(sensation, axis=1)
    assert np.array_equal(mended, true[kept])


def test_one_silent_receptor_is_found(expectation, touches, usual):
    def change(q, sensation):
        sensation[:, 5] = 0.0
        return q, sensation

    mending = found(expectation, touches, usual, change)
    assert mending.in_words == "1 receptor is silent"


def test_a_zero_that_moved_is_one_number(expectation, touches, usual):
    def change(q, sensation):
        q[:, 1] -= 0.3
        return q, sensation

    mending = found(expectation, touches, usual, change)
    assert not mending.displacement
    assert np.flatnonzero(mending.offset).tolist() == [1]
    assert mending.offset[1] == pytest.approx(0.3, abs=0.02)
    now, _ = mending.mended(touches[0][:10], touches[1][:10])
    assert now == pytest.approx(change(touches[0][:10].copy(), None)[0], abs=0.02)


def test_a_new_receptor_is_filled_in_where_it_would_have_felt(touches):
    q, sensation = touches
    blind = sensation.copy()
    blind[:, 7] = 0.0
    some = blind.any(axis=1)
    expectation = Expectation.learn(
        q[:5000][some[:5000]], blind[:5000][some[:5000]], num_steps=1600
    )
    before = q[:NUM_OLD], blind[:NUM_OLD]
    usual = q[5000:NUM_OLD][some[5000:NUM_OLD]], blind[5000:NUM_OLD][some[5000:NUM_OLD]]
    mending = explain_change(expectation, usual, before, q[NUM_OLD:], sensation[NUM_OLD:])
    assert np.flatnonzero(mending.new.receptors).tolist() == [7]
    rows, mended = mending.mended(np.arange(1000)[:, None] * np.ones(q.shape[1]), blind[:1000])
    kept = rows[:, 0].astype(int)
    # Also touches that the new receptor would have felt most are kept, as the others felt them too.
    most = sensation[:, 7] > 0.7 * np.linalg.norm(sensation, axis=1)
    assert most[kept].sum() > 0.9 * (most & some)[:1000].sum() > 5
    off = surprise(mended, sensation[kept])
    assert off[most[kept]].mean() < 0.05
    assert off.mean() < surprise(blind[:1000], sensation[:1000])[some[:1000]].mean() / 10


def test_receptors_that_felt_less_often_are_new_too_and_touches_unlike_all_stay_as_they_are():
    # The last three felt nothing before; one of them still does not.
    once = np.array([[0.6, 0, 0, 0, 0.8, 0]], np.float32)
    often = np.repeat(np.array([[0.8, 0, 0, 0.6, 0, 0], [0, 0.6, 0, 0.8, 0, 0]], np.float32), 20, 0)
    silent_before = np.arange(6) >= 3
    new = NewReceptors.learned(silent_before, np.concatenate([once, often]))
    assert np.flatnonzero(new.receptors).tolist() == [3, 4]
    before = np.array([[0, 3.0, 0, 0, 0, 0], [0, 0, 2.0, 0, 0, 0]], np.float32)
    assert new.filled_in(before) == pytest.approx(
        np.array([[0, 3, 0, 4, 0, 0], [0, 0, 2, 0, 0, 0]])
    )
    assert not NewReceptors.learned(silent_before, once).receptors.any()
    assert np.array_equal(NewReceptors.learned(silent_before, once).filled_in(before), before)


def test_an_agent_that_expects_badly_finds_no_displacement_that_is_not_there(touches):
    q, sensation = (column.copy() for column in touches)
    # Place by place: the last places are not those that the agent learned from.
    _, place = cKDTree(q[:150]).query(q)
    order = np.argsort(place, kind="stable")
    q, sensation = q[order], sensation[order]
    poor = Expectation.learn(q[:5000], sensation[:5000], num_steps=30)
    before = q[:NUM_OLD], sensation[:NUM_OLD]
    usual = q[5000:NUM_OLD], sensation[5000:NUM_OLD]
    q, sensation = q[NUM_OLD:], sensation[NUM_OLD:]
    dead = np.argsort(sensation.sum(axis=0))[-8:]
    sensation[:, dead] = 0.0
    felt = sensation.any(axis=1)
    q, sensation = q[felt], sensation[felt]

    mending = explain_change(poor, usual, before, q, sensation, num_steps=30)
    assert np.array_equal(np.flatnonzero(mending.silent), np.sort(dead))
    assert not mending.displacement
    # A displacement would explain a good part of the surprise.
    fit, others = mends._Touches(q, sensation).divided
    displaced = mends._displaced(dataclasses.replace(mending, through=((poor,),)), fit, 0)
    assert displaced.left(others) < 0.8 * mending.left(others)


def bend(q):
    return q + 0.2 * np.sin(1.5 * q[:, [1, 0, 2, 3, 4]][:, : q.shape[1]])


def unbent(q):
    """Where joints read that act as if they were at `q`."""
    now = q.copy()
    for _ in range(30):
        now = now + q - bend(now)
    return now.astype(np.float32)


def test_a_bent_arm_is_a_displacement_which_more_touches_make_exact(
    expectation, touches, usual, monkeypatch
):
    monkeypatch.setattr(displacements, "_NETWORKS", 1)
    q, sensation = touches[0][:500], touches[1][:500]
    strength = np.linalg.norm(sensation, axis=1)
    firm = strength >= np.quantile(strength, 0.25)

    def moved(mending):
        """The rows that are left, and where they are now."""
        now, felt = mending.mended(q, sensation)
        same = (felt[:, None] == sensation).all(axis=2)
        assert (same.sum(axis=1) == 1).all()
        return same.argmax(axis=1), now

    def off(mending):
        rows, now = moved(mending)
        return np.abs(now - unbent(q[rows]))[:, :3].mean()

    mending = found(expectation, touches, usual, lambda q, s: (unbent(q)[:700], s[:700]))
    assert mending.displacement
    before, after = mending.surprise
    assert after < before / 2
    rows, now = moved(mending)
    assert off(mending) < 0.5 * np.abs(q - unbent(q))[rows, :3].mean()
    again = learned_again(mending, unbent(touches[0][NUM_OLD:]), touches[1][NUM_OLD:])
    assert off(again) < off(mending)
    # Joints without effect do not go astray.
    assert np.array_equal(rows, np.flatnonzero(firm))
    # The light ones are forgotten, and those at readings that the joints never had; no others.
    had = np.concatenate([touches[0][:NUM_OLD], unbent(touches[0][NUM_OLD:][:700])])
    assert mending.reach == pytest.approx(np.array([had.min(axis=0), had.max(axis=0)]))
    narrow = 0.8 * mending.reach
    few_rows, few_now = moved(dataclasses.replace(mending, reach=narrow))
    within = ((now >= narrow[0]) & (now <= narrow[1])).all(axis=1)
    assert 0.1 < within.mean() < 0.9
    assert np.array_equal(few_rows, rows[within])
    assert np.array_equal(few_now, now[within])


@pytest.fixture
def looks(monkeypatch):
    """Numbers of touches of the changed body at which a life, a short one, looks again."""
    monkeypatch.setattr(module, "_FIRST", 3000)
    monkeypatch.setattr(module, "_TO_UNDERSTAND", 600)
    monkeypatch.setattr(module, "_UNDERSTAND_AGAIN", (1200,))
    monkeypatch.setattr(displacements, "_NETWORKS", 1)
    looked = []

    def again(mending, q, sensation, *, seed):
        looked.append(len(q))
        return learned_again(mending, q, sensation, seed=seed)

    monkeypatch.setattr(module, "learned_again", again)
    return looked


def test_a_life_learns_a_displacement_again(touches, looks):
    q, sensation = touches
    q = np.concatenate([q[:5000], unbent(q[5000:])])
    life = Life(lambda: OnlineLearner(60), num_steps=200)
    life.take(q[:6500], sensation[:6500])
    (noticed,) = life.noticed
    assert noticed.mending.displacement
    (num,) = looks
    assert 1200 <= num < 1800
    moved, _ = noticed.mending.mended(q[: noticed.since], sensation[: noticed.since])
    assert life.learner.num_touches == len(moved) + 1500


def test_a_life_fills_in_new_receptors_again(touches, looks):
    q, sensation = touches[0], touches[1].copy()
    sensation[:5000, [7, 8]] = 0.0
    some = sensation.any(axis=1)
    q, sensation = q[some], sensation[some]
    life = Life(lambda: OnlineLearner(60), num_steps=200)
    life.take(q[:6500], sensation[:6500])
    (noticed,) = life.noticed
    new = noticed.mending.new
    assert np.flatnonzero(new.receptors).tolist() == [7, 8]
    (num,) = looks
    assert len(new.felt) == num >= 1200


def test_a_touch_that_is_felt_more_firmly_surprises(expectation, touches):
    q, sensation = touches[0][5000:], touches[1][5000:]
    expected = expectation(q)
    for factor in (1 / 4, 4):
        firmer = expectation.surprise(expected, factor * sensation)
        assert firmer.mean() > expectation.surprise(expected, sensation).mean() + 0.02
        np.testing.assert_allclose(
            surprise(expected, factor * sensation), surprise(expected, sensation), atol=1e-6
        )


def alike(num):
    """The novelty of touches that are equally novel on average."""
    return np.random.default_rng(7).random(num)


def test_the_alarm_is_silent_on_what_is_usual_and_quick_on_what_is_not():
    rng = np.random.default_rng(0)
    for _ in range(5):
        alarm = Alarm.calibrated(rng.exponential(size=2000), alike(2000))
        assert alarm.watch(rng.exponential(size=100_000), alike(100_000)) is None
        row = alarm.watch(2.0 * rng.exponential(size=500), alike(500))
        assert row is not None
        assert row < 150
        assert abs(alarm.since - row - 1) < 50


def test_novel_touches_surprise_and_raise_no_alarm():
    rng = np.random.default_rng(0)

    def touched(num, novel, rise=1.0):
        novelty = np.where(rng.random(num) < novel, rng.uniform(1, 2, num), rng.uniform(0, 1, num))
        return rise * rng.exponential(size=num) * np.where(novelty > 1, 5.0, 1.0), novelty

    alarm = Alarm.calibrated(*touched(2000, 0.5))
    assert alarm.watch(*touched(50_000, 0.8)) is None
    row = alarm.watch(*touched(500, 0.5, rise=2.0))
    assert row is not None
    assert row < 150


def test_touches_that_come_in_runs_count_for_less():
    rng = np.random.default_rng(1)
    runs, novelty = np.repeat(rng.exponential(size=20_000), 5), np.repeat(alike(20_000), 5)
    alarm = Alarm.calibrated(runs[:4000], novelty[:4000])
    assert alarm.correlation > 3
    assert alarm.watch(runs[4000:], novelty[4000:]) is None


def test_receptors_that_are_rare_are_not_new_and_those_that_begin_to_feel_are():
    rng = np.random.default_rng(0)
    rate = np.geomspace(1e-5, 1e-3, 100)
    for _ in range(5):
        # What comes in runs is one encounter.
        felt = (rng.random((20_000, 100)) < rate).repeat(5, axis=0).astype(np.float32)
        watch = NewReceptorTest.after(10_000, ~felt[:10_000].any(axis=0))
        assert watch.silent.any()
        assert watch.watch(felt[10_000:]) is None
        felt[:500][:, watch.silent] = rng.random((500, watch.silent.sum())) < 0.03
        watch = NewReceptorTest.after(10_000, watch.silent)
        row = watch.watch(felt[:500])
        assert row is not None
        assert row < 300
        assert watch.since > row / 2


def encounters(rng, num, miss):
    """What is expected of 30 receptors in runs of five touches, and what they feel."""
    here = rng.random((num // 5, 30)) < 0.1
    felt = here & (rng.random(here.shape) > miss)
    return (np.repeat(one, 5, axis=0).astype(np.float32) for one in (here, felt))


def test_receptors_that_miss_now_and_then_are_not_silent_and_those_that_always_miss_are():
    rng = np.random.default_rng(0)
    miss = np.linspace(0.0, 0.2, 30)
    for dead in (0, 15):
        test = DeadReceptorTest.calibrated(*encounters(rng, 2000, miss))
        assert test.watch(*encounters(rng, 50_000, miss)) is None
        assert 0.1 < test.doubt < 1.0
        expected, felt = encounters(rng, 2000, miss)
        felt[400:, dead] = 0.0
        row = test.watch(expected, felt)
        assert row is not None
        assert 400 < row < 1400
        assert 0 <= test.since - (row + 1 - 400) < 300


def test_receptors_that_fall_silent_together_are_noticed_sooner_than_one():
    rng = np.random.default_rng(2)
    test = DeadReceptorTest.calibrated(*encounters(rng, 2000, 0.2))
    expected, felt = encounters(rng, 2000, 0.2)
    noticed = []
    for dead in (1, 10):
        silent = felt.copy()
        silent[400:, :dead] = 0.0
        watching = dataclasses.replace(test, unfelt=test.unfelt.copy())
        noticed.append(watching.watch(expected, silent) - 400)
        assert 0 <= watching.since - (noticed[-1] + 1) < 100
    assert 0 < noticed[1] < noticed[0] / 4


def test_silence_does_not_depend_on_how_touches_are_cut():
    rng = np.random.default_rng(1)
    expected, felt = encounters(rng, 3000, 0.1)
    felt[1000:, 3] = 0.0
    one, other = (DeadReceptorTest.calibrated(expected[:1000], felt[:1000]) for _ in range(2))
    row = one.watch(expected[1000:], felt[1000:])
    rows = [other.watch(expected[at : at + 7], felt[at : at + 7]) for at in range(1000, 3000, 7)]
    at, last = next((at, found) for at, found in enumerate(rows) if found is not None)
    assert row == 7 * at + last


def test_a_life_notices_mends_and_does_not_depend_on_how_it_is_cut(touches, monkeypatch):
    monkeypatch.setattr(module, "_FIRST", 3000)
    monkeypatch.setattr(module, "_TO_UNDERSTAND", 900)
    monkeypatch.setattr(displacements, "_NETWORKS", 1)
    monkeypatch.setattr(mends, "_THROUGH", 1)
    q, sensation = touches
    q, sensation = q.copy(), sensation.copy()
    q[4500:, 0] += 0.5

    def lived(chunk):
        life = Life(lambda: OnlineLearner(60), num_steps=150)
        for start in range(0, 6500, chunk):
            rows = slice(start, min(start + chunk, 6500))
            life.take(q[rows], sensation[rows])
        return life

    one, other = lived(250), lived(730)
    (noticed,) = one.noticed
    assert 4500 <= noticed.row < 5000
    assert noticed.mended_at <= 6000
    assert noticed.mending.offset[0] == pytest.approx(-0.5, abs=0.1)
    assert not one.has_doubts
    for field in dataclasses.fields(one.learner.representation):
        mine, its = (getattr(x.learner.representation, field.name) for x in (one, other))
        assert np.array_equal(mine, its, equal_nan=field.name == "embedding")
