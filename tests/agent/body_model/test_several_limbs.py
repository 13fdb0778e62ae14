"""Several limbs from few touches, though nobody says which of them touched."""

import numpy as np
import pytest
from hand_made_chains import ArmOnBall, misfit
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.few import clearly_off, judged_in_turn
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.several_limbs import (
    by_hand,
    neighbourhoods_of_parts,
    of_several_limbs,
)
from selftouch_drake.agent.body_model.smooth_tree import UNTOLD
from selftouch_drake.agent.body_model.structure import Search

EACH = 700
ARMS = ArmOnBall(1), ArmOnBall(2)


def touches_of_two_arms(each=EACH, seed=0):
    """`(n, 8)` readings, `(n, S)` sensations and the arm that touched, in any order."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.5, 1.5, (2 * each, 8))
    felt = []
    for number, arm in enumerate(ARMS):
        own = slice(number * each, (number + 1) * each)
        q[own, 4 * number : 4 * number + 4], one = arm.touches(each, seed=seed + number)
        felt.append(one)
    order = random.permutation(2 * each)
    who = np.repeat([0, 1], each)
    return q[order], csr_array(np.concatenate(felt))[order], who[order]


def search_of(q):
    return Search(np.ascontiguousarray(q.T.astype(np.float32)), np.random.default_rng(0))


def test_two_arms_that_touch_one_ball_are_told_apart():
    q, felt, who = touches_of_two_arms()
    used = np.random.default_rng(1).random(len(q)) < 0.95
    body = of_several_limbs(search_of(q), q, felt, np.full(len(q), 3), used)
    assert body is not None
    ways = {way[0][0] // 4: (toucher, way) for (_, toucher), way in body.ways().items()}
    assert sorted(ways) == [0, 1]
    for number, (toucher, way) in ways.items():
        order = [joint for joint, _ in way]
        assert set(order) <= set(range(4 * number, 4 * number + 4))
        own = q[who == number]
        found = places(own[:, order], body.twists[order], body.points[toucher])
        true = ARMS[number].places(own[:, 4 * number : 4 * number + 4])
        assert misfit(found, true) < 3


@pytest.mark.slow
def test_a_body_of_two_arms_is_found_and_accepted():
    q, felt, who = touches_of_two_arms(1500)
    part = np.zeros(len(q), dtype=int)
    target, of_label = neighbourhoods_of_parts(felt, part, 10, np.random.default_rng(0))
    names = [f"joint {number}" for number in range(8)]
    model = find_body_model(q, felt, target, of_label, joint_names=names)
    assert model.accepted, model.reason
    assert sorted(joint // 4 for joint in model.toucher_link) == [0, 1]
    hands = model.toucher_link[model.kernel_toucher] // 4
    known = model.kernel_toucher >= 0
    assert known.mean() > 0.8  # labels of so few touches are wide
    assert (hands == who)[known].mean() > 0.98


def test_one_arm_is_no_several():
    q, felt = ARMS[0].touches(2 * EACH)
    part = np.zeros(len(q), dtype=int)
    assert of_several_limbs(search_of(q), q, csr_array(felt), part, part == 0) is None


def test_known_limbs_tell_whose_touches_of_another_part_are():
    q, felt, who = touches_of_two_arms()
    orders = [[0, 1, 2, 3], [4, 5, 6, 7]]
    told = by_hand(search_of(q), felt, np.arange(len(q)), orders).rows
    assert sorted(told) == [0, 1]
    for limb, rows in told.items():
        assert len(rows) > 0.4 * EACH
        assert (who[rows] == limb).mean() > 0.97


def test_hands_are_told_only_where_their_own_limbs_hold_each_other():
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (2 * EACH, 8))
    orders = [[0, 1, 2, 3], [4, 5, 6, 7]]
    q[:, :4], felt = ARMS[0].touches(2 * EACH)
    of_one = by_hand(search_of(q), csr_array(felt), np.arange(len(q)), orders).rows
    assert list(of_one) == [0]
    q = np.random.default_rng(0).permutation(q)
    of_none = by_hand(search_of(q), csr_array(felt), np.arange(len(q)), orders).rows
    assert list(of_none) == [UNTOLD]


def test_a_hand_that_hardly_touched_says_nothing_of_joints():
    random = np.random.default_rng(0)
    q = random.uniform(-1.5, 1.5, (2 * EACH, 12))
    q[:, :4], felt = ARMS[0].touches(2 * EACH)
    told = by_hand(search_of(q), csr_array(felt), np.arange(len(q)), [[0, 1, 2, 3], [4, 5, 6, 7]])
    assert 0 in told.rows
    assert told.new == told.alone == []


def test_a_joint_that_matters_to_one_hand_alone_may_be_the_hands():
    q, felt, _ = touches_of_two_arms()
    told = by_hand(search_of(q), felt, np.arange(len(q)), [[0, 1, 2], [4, 5, 6, 7]])
    assert sorted(told.rows) == [0, 1]
    assert told.new == [3]
    assert told.alone == []


def test_few_touches_are_none():
    q, felt, _ = touches_of_two_arms()
    part = np.zeros(len(q), dtype=int)
    few = np.arange(len(q)) < 300
    assert of_several_limbs(search_of(q), q, felt, part, few) is None


def test_labels_are_of_touches_that_feel_alike_on_one_part():
    _, felt, _ = touches_of_two_arms()
    part = np.arange(felt.shape[0]) % 2
    label, part_of = neighbourhoods_of_parts(felt, part, 8, np.random.default_rng(0))
    assert (part_of[label] == part).all()
    assert 4 < np.bincount(label).mean() < 12
    for number in range(3):
        mine = felt[label == number].toarray()
        among = np.linalg.norm(mine - mine.mean(axis=0), axis=1).mean()
        all_of_part = felt[part == part_of[number]].toarray()
        assert among < 0.7 * np.linalg.norm(all_of_part - all_of_part.mean(axis=0), axis=1).mean()


@pytest.mark.parametrize(("right", "accepted"), [(True, True), (False, False)])
def test_touches_left_out_judge_a_tree(right, accepted):
    # In so many joints, half of which are idle, memory knows little.
    q, felt, who = touches_of_two_arms()
    q, felt = q[who == 0], felt[who == 0]
    place = ARMS[0].places(q[:, :4])
    random = np.random.default_rng(0)
    if not right:
        place = place + 0.3 * random.standard_normal(place.shape)
    judges = random.random(len(q)) < 0.2
    found = judged_in_turn(felt, q, place, place[None], judges, random)
    assert found.accepted == accepted
    assert found.tested == judges.sum()


def test_too_few_left_out_judge_nothing():
    q, felt = ARMS[0].touches(200)
    place = ARMS[0].places(q)
    judges = np.arange(len(q)) < 10
    found = judged_in_turn(csr_array(felt), q, place, place[None], judges, np.random.default_rng(0))
    assert not found.accepted
    assert "too few" in found.reason
    assert not clearly_off(found)


@pytest.mark.parametrize(("amount", "off"), [(0.0, False), (0.1, False), (0.3, True)])
def test_only_touches_that_clearly_say_no_have_the_last_word(amount, off):
    q, felt = ARMS[0].touches(EACH)
    random = np.random.default_rng(0)
    place = ARMS[0].places(q)
    place = place + amount * random.standard_normal(place.shape)
    judges = random.random(len(q)) < 0.1
    found = judged_in_turn(csr_array(felt), q, place, place[None], judges, random)
    assert clearly_off(found) == off
