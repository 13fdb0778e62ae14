"""A life notices that the body changed, explains it, and adapts what it knows."""

import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.lifelong import explanation
from selftouch_drake.agent.lifelong import life as module
from selftouch_drake.agent.lifelong.expectation import TouchSet
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life

pytestmark = pytest.mark.filterwarnings("ignore:the quotient graph fell")


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Lives that are shorter."""
    monkeypatch.setattr(module, "_FIRST", 3000)
    monkeypatch.setattr(module, "_TO_EXPLAIN", 600)
    monkeypatch.setattr(module, "_TO_REFINE", (1200,))
    monkeypatch.setattr(explanation, "_NETWORKS", 1)


def lived(touches, num_steps, chunk=6500):
    life = Life(lambda: OnlineLearner(60), num_steps=num_steps, asks=False)
    for start in range(0, 6500, chunk):
        rows = touches[:6500][start : start + chunk]
        life.take(rows.q, rows.sensation)
    return life


@pytest.mark.slow
def test_a_displacement_is_learned_again(touches, unbent):
    q = np.concatenate([touches.q[:5000], unbent(touches.q[5000:])])
    life = lived(TouchSet(q, touches.sensation), 200)
    (noticed,) = life.noticed
    assert noticed.change.displacement
    # Networks grow with the touches that they were learned from.
    assert noticed.change.displacement[0].weights[0].shape[1] >= round(32 * np.sqrt(1.2))
    moved = noticed.change.adapted(touches[: noticed.since])
    assert life.learner.num_touches == len(moved) + 1500


@pytest.mark.usefixtures("without_networks")
def test_new_receptors_are_filled_in_again(touches):
    sensation = touches.sensation.copy()
    sensation[:5000, [7, 8]] = 0.0
    life = lived(TouchSet(touches.q, sensation)[sensation.any(axis=1)], 200)
    (noticed,) = life.noticed
    new = noticed.change.new
    assert np.flatnonzero(new.receptors).tolist() == [7, 8]
    assert len(new.felt) >= 1200


@pytest.mark.slow
def test_a_life_does_not_depend_on_how_it_is_cut(touches):
    q = touches.q.copy()
    q[4500:, 0] += 0.5
    changed = TouchSet(q, touches.sensation)
    one, other = lived(changed, 150, 250), lived(changed, 150, 730)
    (noticed,) = one.noticed
    assert 4500 <= noticed.row < 5000
    assert noticed.explained_at <= 6000
    assert noticed.change.offset[0] == pytest.approx(-0.5, abs=0.1)
    assert not one.has_doubts
    for field in dataclasses.fields(one.learner.representation):
        mine, its = (getattr(x.learner.representation, field.name) for x in (one, other))
        assert np.array_equal(mine, its)


def test_a_life_takes_one_of_so_many_touches_however_they_are_cut():
    q = np.arange(3000.0).reshape(1500, 2)
    sensation = np.random.default_rng(0).random((1500, 9), dtype=np.float32)
    life = Life(lambda: OnlineLearner(60), every=3)
    for start in range(0, 1500, 7):
        life.take(q[start : start + 7], sensation[start : start + 7])
    held = life.learner.remembered()
    assert life.num_touches == 500
    np.testing.assert_array_equal(held.columns["q"][held.row.argsort()], q[::3])
