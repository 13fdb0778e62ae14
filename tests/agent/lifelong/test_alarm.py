"""Two tests tell that a body changed, and are silent as long as it does not."""

import copy

import numpy as np
import pytest

from selftouch_drake.agent.lifelong.alarm import THRESHOLD, PlaceTest, ReceptorTest, SurpriseTest


def alike(num):
    """The novelty of touches that are equally novel on average."""
    return np.random.default_rng(7).random(num)


def test_the_threshold_is_passed_by_chance_once_in_a_hundred_lifetimes():
    """A sum of log likelihood ratios passes h once in e^h steps or less often (Lorden, 1971)."""
    assert np.exp(-THRESHOLD) * 100_000 == pytest.approx(0.01)


def test_the_alarm_is_silent_on_what_is_usual_and_quick_on_what_is_not():
    rng = np.random.default_rng(0)
    for _ in range(5):
        alarm = SurpriseTest(rng.exponential(size=2000), alike(2000))
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

    alarm = SurpriseTest(*touched(2000, 0.5))
    assert alarm.watch(*touched(50_000, 0.8)) is None
    row = alarm.watch(*touched(500, 0.5, rise=2.0))
    assert row is not None
    assert row < 150


def test_a_chain_that_misplaces_touches_is_noticed_and_skin_that_is_new_is_not():
    rng = np.random.default_rng(0)
    test = PlaceTest(rng.exponential(size=1000), rng.random(1000))
    assert test.watch(rng.exponential(size=5000), rng.random(5000)) is None
    assert test.watch(np.full(500, 20.0), np.full(500, 3.0)) is None
    row = test.watch(5 * rng.exponential(size=300), rng.random(300))
    assert row is not None
    assert row < 100


def test_touches_that_come_in_runs_count_for_less():
    rng = np.random.default_rng(1)
    runs, novelty = np.repeat(rng.exponential(size=20_000), 5), np.repeat(alike(20_000), 5)
    alarm = SurpriseTest(runs[:4000], novelty[:4000])
    assert alarm.correlation > 3
    # In no order they do not tell; what was known before holds.
    shuffled = rng.permutation(4000)
    some = runs[shuffled], novelty[shuffled]
    assert SurpriseTest(*some).correlation < 2
    assert SurpriseTest(*some, correlation=alarm.correlation).correlation == alarm.correlation
    assert alarm.watch(runs[4000:], novelty[4000:]) is None


def test_receptors_that_are_rare_are_not_new_and_those_that_begin_to_feel_are():
    rng = np.random.default_rng(0)
    rate = np.geomspace(1e-5, 1e-3, 40)
    for _ in range(2):
        # What comes in runs is one encounter.
        felt = (rng.random((20_000, 40)) < rate).repeat(5, axis=0).astype(np.float32)
        never_felt = ~felt[:10_000].any(axis=0)
        assert never_felt.any()
        nothing, known = np.zeros_like(felt), np.zeros(len(felt))
        test = ReceptorTest(nothing[:1000], felt[:1000], known[:1000], never_felt, 10_000)
        assert test.watch(nothing[10_000:], felt[10_000:], known[10_000:]) is None
        felt[:500][:, never_felt] = rng.random((500, never_felt.sum())) < 0.03
        test = ReceptorTest(nothing[:1000], felt[:1000], known[:1000], never_felt, 10_000)
        row = test.watch(nothing[:500], felt[:500], known[:500])
        assert row is not None
        assert row < 300
        assert test.since > row / 2


def calibrated(expected, felt):
    """A test of receptors that have all felt something."""
    never_felt = np.zeros(felt.shape[1], dtype=bool)
    return ReceptorTest(expected, felt, np.zeros(len(felt)), never_felt, len(felt))


def watch(test, expected, felt):
    """What the test says of touches as familiar as all others."""
    return test.watch(expected, felt, np.zeros(len(felt)))


def encounters(rng, num, miss):
    """What is expected of 30 receptors in runs of five touches, and what they feel."""
    here = rng.random((num // 5, 30)) < 0.1
    felt = here & (rng.random(here.shape) > miss)
    return (np.repeat(one, 5, axis=0).astype(np.float32) for one in (here, felt))


def test_receptors_that_miss_now_and_then_are_not_silent_and_those_that_always_miss_are():
    rng = np.random.default_rng(0)
    miss = np.linspace(0.0, 0.2, 30)
    for dead in (0, 15):
        test = calibrated(*encounters(rng, 2000, miss))
        assert watch(test, *encounters(rng, 50_000, miss)) is None
        assert 0.1 < test.doubt[0] < 1.0
        expected, felt = encounters(rng, 2000, miss)
        felt[400:, dead] = 0.0
        row = watch(test, expected, felt)
        assert row is not None
        assert 400 < row < 1400
        assert 0 <= test.since - (row + 1 - 400) < 300


def test_receptors_that_fall_silent_together_are_noticed_sooner_than_one():
    rng = np.random.default_rng(2)
    test = calibrated(*encounters(rng, 2000, 0.2))
    expected, felt = encounters(rng, 2000, 0.2)
    noticed = []
    for dead in (1, 10):
        silent = felt.copy()
        silent[400:, :dead] = 0.0
        watching = copy.deepcopy(test)
        noticed.append(watch(watching, expected, silent) - 400)
        assert 0 <= watching.since - (noticed[-1] + 1) < 100
    assert 0 < noticed[1] < noticed[0] / 4


def test_silence_does_not_depend_on_how_touches_are_cut():
    rng = np.random.default_rng(1)
    expected, felt = encounters(rng, 3000, 0.1)
    felt[1000:, 3] = 0.0
    one, other = (calibrated(expected[:1000], felt[:1000]) for _ in range(2))
    row = watch(one, expected[1000:], felt[1000:])
    rows = [watch(other, expected[at : at + 7], felt[at : at + 7]) for at in range(1000, 3000, 7)]
    at, last = next((at, found) for at, found in enumerate(rows) if found is not None)
    assert row == 7 * at + last


def test_what_is_missed_in_novel_touches_is_no_silence_and_in_familiar_ones_it_is():
    rng = np.random.default_rng(3)

    def touches(num, dead=()):
        novelty = rng.random(num // 5).repeat(5)
        expected, felt = encounters(rng, num, 0.01)
        # Beyond 0.5 the agent guesses.
        felt[novelty > 0.5] *= np.float32(0.0)
        felt[:, dead] = 0.0
        return expected, felt, novelty

    never_felt = np.zeros(30, dtype=bool)
    expected, felt, novelty = touches(2000)
    test = ReceptorTest(expected, felt, novelty, never_felt, 2000)
    assert test.watch(*touches(20_000)) is None
    assert test.doubt[0] < 0.8
    row = test.watch(*touches(2000, dead=(4, 5, 6)))
    assert row is not None
    assert row < 1000
