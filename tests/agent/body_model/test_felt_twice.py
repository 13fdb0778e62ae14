"""Touches that both skins feel, seen from the side that is touched."""

from types import SimpleNamespace

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, nearest_of
from made_up import NAMES, made_up_model, readings, sphere_points
from modelled import found_by
from scipy.sparse import csr_array
from scipy.spatial.distance import cdist

from selftouch_drake.agent.body_model.asking import ask_for_model
from selftouch_drake.agent.body_model.both_sides.grain import map_of_readings
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.felt_twice import (
    _hands,
    felt_twice,
    from_one_side,
    without_last,
)
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.lesson import ask

# A trunk of two kernels and three receptors, a hand of one kernel and nine receptors in a row.
TRUNK, HAND = 3, 9


def stored(touches, alone=0):
    """What an agent keeps of touches of a hand `(n,)` 0 to 1 along its skin, and what was felt.

    Each has a row of the trunk and one of the hand; some more were felt by the trunk alone.
    """
    random, number = np.random.default_rng(0), len(touches)
    hand = np.maximum(0, 1 - 4 * np.abs(np.linspace(0, 1, HAND) - touches[:, None]))
    trunk = np.eye(TRUNK)[random.integers(TRUNK, size=number + alone)]
    felt = np.hstack([trunk, np.vstack([hand, np.zeros((alone, HAND))])])
    skin = np.repeat([0, 1], [TRUNK, HAND])
    row = np.concatenate([np.arange(number + alone), np.arange(number)])
    representation = SimpleNamespace(
        part=np.array([0, 0, 1]), kernel_row=row, overlap=skin[:, None] == skin,
        target_sensations=np.eye(TRUNK + HAND)[[0, 1, TRUNK]],
    )  # fmt: skip
    kernel = np.repeat([0, 2], [number + alone, number])
    return representation, kernel, csr_array(felt[row])


def test_a_hand_is_read_along_its_skin():
    along = np.random.default_rng(1).uniform(0, 1, 400)
    twice = felt_twice(*stored(along))
    assert not twice.left_out[:400].any()
    assert twice.left_out[400:].all()
    assert (twice.along[400:] == 0).all()
    assert abs(np.corrcoef(twice.along[:400, 0], along)[0, 1]) > 0.95
    assert twice.along[:400].mean(axis=0) == pytest.approx(0, abs=1e-9)


def test_a_map_of_readings_lies_as_receptors_do():
    random = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(np.arange(7.0), np.arange(7.0)), axis=-1).reshape(-1, 2)
    felt = np.maximum(0, 1 - cdist(random.uniform(0, 6, (400, 2)), grid) / 2)
    place = map_of_readings(np.column_stack([felt, np.zeros(400)]))
    assert np.isnan(place[-1]).all()
    flat = np.column_stack([place[:-1], np.ones(len(grid))])
    off = grid - flat @ np.linalg.lstsq(flat, grid, rcond=None)[0]
    assert np.sqrt((off**2).sum(axis=1).mean() / grid.var(axis=0).sum()) < 0.08


def test_touches_of_one_side_are_left_out_and_decide_if_they_are_most():
    along = np.random.default_rng(1).uniform(0, 1, 100)
    assert felt_twice(*stored(along, alone=50)).left_out[100:150].all()
    assert felt_twice(*stored(along, alone=300)) is None


def test_without_a_hand_touches_are_taken_as_ever():
    # Three skins that touch each other alike.
    pairs = np.repeat([(0, 1), (1, 2), (0, 2)], 10, axis=0)
    representation = SimpleNamespace(part=np.arange(3), kernel_row=np.repeat(np.arange(30), 2))
    assert felt_twice(representation, pairs.ravel(), csr_array((60, 3))) is None


def test_a_hand_of_few_receptors_is_a_point():
    representation, kernel, felt = stored(np.full(100, 0.5))
    assert felt_twice(representation, kernel, felt).along.shape[1] == 0


def test_hands_are_the_fewest_parts_that_take_part_in_all_touches():
    met = [(0, 3), (0, 4), (1, 3), (1, 4), (2, 3)] * 10 + [(3, 4)]
    assert _hands(np.array(met), np.array([50, 20, 10, 9, 9])) == [3, 4]
    # Either of two may be the hand: the smaller one is taken.
    assert _hands(np.array([(0, 1)] * 9), np.array([50, 9])) == [1]
    assert _hands(np.array([(0, 1), (1, 2), (0, 2)]), np.array([5, 5, 5])) == []


def met(hand, trunk):
    """Readings of a skin of 30 receptors in a row, then of nine, that are met at 0 to 1 along."""
    felt = [
        np.maximum(0, 1 - reach * np.abs(np.linspace(0, 1, number) - at[:, None]))
        for at, number, reach in ((trunk, 30, 10), (hand, HAND, 4))
    ]
    return np.hstack(felt)


def test_before_anything_is_learned_touches_are_seen_from_the_side_that_hands_touch():
    random = np.random.default_rng(2)
    hand, trunk = random.uniform(0, 1, (2, 400))
    felt = met(hand, trunk)
    felt[:50, 30:] = 0  # touched by something else
    side = from_one_side(felt)
    assert side.row.tolist() == list(range(50, 400))
    assert (side.sensation[:, 30:] == 0).all()
    assert (side.sensation[:, :30] == felt[50:, :30]).all()
    assert abs(np.corrcoef(side.along[:, 0], hand[50:])[0, 1]) > 0.95


def test_where_most_touches_have_one_side_all_are_taken_as_they_are():
    random = np.random.default_rng(2)
    felt = met(*random.uniform(0, 1, (2, 400)))
    felt[:300, 30:] = 0
    assert from_one_side(felt) is None
    assert from_one_side(felt[:, :30]) is None


def met_by_a_broad_hand(number):
    """Readings of an arm, where its broad hand was met `(n, 2)`, and where that was `(n, 3)`."""
    random = np.random.default_rng(0)
    twists, point = an_arm()
    # A hand as broad as the reach of the arm, met anywhere.
    hand = random.uniform(-1, 1, (60_000, 2))
    q = random.uniform(-1.5, 1.5, (len(hand), 4))
    there = places(q, twists, point + hand @ [[0.7, 0.2, 0.0], [0.0, 0.3, 0.7]])
    middle = np.median(there, axis=0)
    radius = np.median(np.linalg.norm(there - middle, axis=1))
    on = np.abs(np.linalg.norm(there - middle, axis=1) / radius - 1) < 0.02
    return q[on][:number], hand[on][:number], ((there - middle) / radius)[on][:number]


def test_a_body_is_found_behind_a_broad_hand():
    q, hand, there = met_by_a_broad_hand(1500)
    target = nearest_of(there, 60)
    part = np.zeros(60, dtype=int)
    names = [f"joint {n}" for n in range(6)]
    read = find_body_model(np.hstack([q, hand]), None, target, part, joint_names=names)
    model = without_last(read, 2)
    assert model.accepted
    count = np.bincount(target)[:, None]
    true = np.stack([np.bincount(target, axis) for axis in there.T], axis=1) / count
    assert misfit(model.kernel_place, true) < 5


@pytest.mark.slow
def test_a_lesson_finds_a_body_behind_a_broad_hand():
    q, hand, there = met_by_a_broad_hand(300)
    ball, grid = sphere_points(80, radius=1.0)[0], np.linspace(-1, 1, 5)
    palm = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    felt = np.hstack([np.maximum(0, 1 - cdist(there, ball) / 0.5), 1 - cdist(hand, palm) / 0.8])
    names = [f"joint {n}" for n in range(4)]
    model = ask(q, felt, names)
    assert model.accepted
    assert list(model.joint_names) == names
    known = np.isfinite(model.receptor_place[:80]).all(axis=1)
    assert misfit(model.receptor_place[:80][known], ball[known]) < 10
    assert not ask(q, felt[:, :80], names).accepted


def test_a_model_without_its_last_joints_is_the_same_where_these_read_nothing():
    model, q = made_up_model(), readings(20)
    q[:, 4:] = 0
    fewer = without_last(model, 2)
    assert fewer.joint_names == NAMES[:4]
    # Its second hand was on the last joint, and is on the base now.
    assert fewer.toucher_link.tolist() == [2, -1]
    target = np.zeros(20, dtype=int)
    np.testing.assert_allclose(fewer.place(q[:, :4], target), model.place(q, target), atol=1e-9)
    assert fewer.covariance.shape == (30, 30)


def test_what_a_hand_felt_is_among_the_readings_and_not_in_the_model(monkeypatch):
    asked = []

    def find(**given):
        asked.append(given)
        return made_up_model(num_kernels=12)

    found_by(monkeypatch, find)
    along = np.random.default_rng(1).uniform(0, 1, 200)
    representation, _, felt = stored(along)
    representation.kernel_q = np.zeros((400, 5), dtype=np.float32)
    representation.kernel_offsets, representation.num_targets = np.array([0, 200, 200, 400]), 3
    model = ask_for_model(representation, felt, joint_names=NAMES[:5])
    added = asked[0]["q"].shape[1] - 5
    assert added > 0
    assert asked[0]["double"].sum() == 200
    assert model.joint_names == NAMES[: 6 - added]
