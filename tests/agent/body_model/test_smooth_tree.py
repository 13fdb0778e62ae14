"""Parts join the limbs that were found on one part where all are smooth at once."""

import numpy as np
import pytest
from hand_made_chains import felt
from scipy.sparse import block_diag, csr_array

from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.fit import random_twists
from selftouch_drake.agent.body_model.forest import Links, Mechanism
from selftouch_drake.agent.body_model.smooth_tree import (
    UNTOLD,
    Touched,
    _Arrangement,
    _moved,
    _Place,
    with_parts,
)
from selftouch_drake.agent.body_model.structure import Search

EACH = 200
NUM_JOINTS = 9
TWISTS = random_twists(np.random.default_rng(4), NUM_JOINTS)
HANDS = np.random.default_rng(5).standard_normal((2, 3))
# A trunk is touched by two limbs; one of them wears a part, and a joint moves a head alone.
LIMBS = ((0, 1, 2, 3), (4, 5, 6, 7))
TRUNK, FOREARM, HEAD = 0, 1, 2
WAYS = {
    (TRUNK, 0): ((0, 1), (1, 1), (2, 1), (3, 1)),
    (TRUNK, 1): ((4, 1), (5, 1), (6, 1), (7, 1)),
    (FOREARM, 1): ((1, -1), (0, -1), (4, 1), (5, 1), (6, 1), (7, 1)),
    (HEAD, 0): ((8, 1), (0, 1), (1, 1), (2, 1), (3, 1)),
    (HEAD, 1): ((8, 1), (4, 1), (5, 1), (6, 1), (7, 1)),
}


def touches(way, point, seed):
    """Readings of all joints with which a point touches a ball, and the places there."""
    random = np.random.default_rng(seed)
    order, sign = zip(*way, strict=True)
    twists = TWISTS[list(order)] * np.array(sign)[:, None]
    q, y = np.zeros((0, NUM_JOINTS)), np.zeros((0, 3))
    cloud = places(random.uniform(-1.5, 1.5, (2000, len(order))), twists, point)
    center = np.median(cloud, axis=0)
    radius = np.median(np.linalg.norm(cloud - center, axis=1))
    while len(q) < EACH:
        tried = random.uniform(-1.5, 1.5, (20_000, NUM_JOINTS))
        there = places(tried[:, order], twists, point)
        on = np.abs(np.linalg.norm(there - center, axis=1) / radius - 1) < 0.01
        q, y = np.concatenate([q, tried[on]]), np.concatenate([y, there[on]])
    return q[:EACH], y[:EACH]


@pytest.fixture(scope="module")
def experience():
    """Readings, sensations, and rows of each pair of a part and a hand."""
    found = {pair: touches(way, HANDS[pair[1]], n) for n, (pair, way) in enumerate(WAYS.items())}
    sensation = block_diag([felt(y) for _, y in found.values()], format="csr")
    rows = {pair: np.arange(n * EACH, (n + 1) * EACH) for n, pair in enumerate(WAYS)}
    return np.concatenate([q for q, _ in found.values()]), csr_array(sensation), rows


def limbs(orders):
    """The trunk with its limbs, in these orders."""
    links = Links({}, 1, {TRUNK: 0}, {})
    for hand, order in enumerate(orders):
        links, end = links.extended(0, order, forwards=True)
        links.toucher[hand] = end
    return Mechanism(links, TWISTS, HANDS, ((TRUNK, 0), (TRUNK, 1)))


def grown(experience, orders):
    q, sensation, rows = experience
    head = Touched({0: rows[HEAD, 0], 1: rows[HEAD, 1]}, new=[8], alone=[8])
    others = {HEAD: head, FOREARM: Touched({UNTOLD: rows[FOREARM, 1]})}
    search = Search(np.ascontiguousarray(q.T.astype(np.float32)), np.random.default_rng(0))
    own = [rows[TRUNK, hand] for hand in (0, 1)]
    return with_parts(search, sensation, others, limbs(orders), own, list(range(NUM_JOINTS)))


def test_a_part_on_a_limb_and_one_behind_a_joint_of_its_own_join(experience):
    loss, body = grown(experience, LIMBS)
    assert loss < 0
    assert body.ways() == WAYS


def test_other_parts_tell_the_order_of_joints(experience):
    loss, body = grown(experience, ((0, 2, 1, 3), LIMBS[1]))
    assert loss < 0
    assert body.ways() == WAYS


def test_a_joint_that_was_left_out_comes_back(experience):
    _, body = grown(experience, ((0, 1, 3), LIMBS[1]))
    assert body.ways() == WAYS


def test_what_no_hand_touched_stays_out(experience):
    q, sensation, rows = experience
    shuffled = sensation[np.random.default_rng(0).permutation(sensation.shape[0])]
    search = Search(np.ascontiguousarray(q.T.astype(np.float32)), np.random.default_rng(0))
    own = [rows[TRUNK, hand] for hand in (0, 1)]
    others = {FOREARM: Touched({UNTOLD: rows[FOREARM, 1]})}
    _, body = with_parts(search, shuffled, others, limbs(LIMBS), own, list(range(NUM_JOINTS)))
    assert set(body.links.part) == {TRUNK}


ARRANGEMENT = _Arrangement(
    LIMBS,
    {TRUNK: _Place(), FOREARM: _Place(0, 2), HEAD: _Place(0, 0, (8,))},
    tuple(WAYS),
)


def test_ways_lead_from_parts_to_hands():
    assert {pair: ARRANGEMENT.way(*pair) for pair in WAYS} == WAYS


def neighbours(arrangement):
    return [one for one, _, _ in arrangement.near([], wide=False)]


def test_a_part_beside_the_first_one_may_be_on_any_limb():
    beside = {one.worn[HEAD] for one in neighbours(ARRANGEMENT) if one.orders == LIMBS}
    assert {_Place(0, 1, (8,)), _Place(1, 1, (8,))} <= beside


def test_hands_keep_joints_enough_to_touch_all_of_a_part():
    behind_three = _Arrangement(
        LIMBS, {TRUNK: _Place(), HEAD: _Place(0, 1)}, ((TRUNK, 0), (TRUNK, 1), (HEAD, 0))
    )
    # Behind one joint more the hand of its own limb has two left.
    assert all(len(one.way(HEAD, 0)) >= 3 for one in neighbours(behind_three))


def test_either_of_two_neighbours_may_be_the_one_that_moved():
    swaps = [joint for order, joint in _moved((0, 1, 2)) if order == (1, 0, 2)]
    assert swaps == [0, 1]


def test_a_joint_that_passes_a_part_may_leave_it_on_either_side():
    # Joints 0 and 1 change places, of which either moved; the part was behind both.
    worn = _Arrangement(LIMBS, {TRUNK: _Place(), FOREARM: _Place(0, 1)}, ((TRUNK, 0), (FOREARM, 1)))
    swapped = [one for one in neighbours(worn) if one.orders[0] == (1, 0, 2, 3)]
    assert {one.worn[FOREARM].behind for one in swapped} == {0, 1, 2}


def test_a_part_that_all_hands_are_too_near_to_waits(experience):
    q, sensation, rows = experience
    search = Search(np.ascontiguousarray(q.T.astype(np.float32)), np.random.default_rng(0))
    own = [rows[TRUNK, hand] for hand in (0, 1)]
    others = {FOREARM: Touched({0: rows[FOREARM, 1]})}
    short = limbs(((0, 1), LIMBS[1]))
    _, body = with_parts(search, sensation, others, short, own, [0, 1, 4, 5, 6, 7])
    assert set(body.links.part) == {TRUNK}


def test_neighbours_that_change_places_are_also_tried_with_their_axes_where_they_were():
    two = _Arrangement(LIMBS, {TRUNK: _Place()}, ((TRUNK, 0), (TRUNK, 1)))
    found = two.near([], wide=False)
    drawn = [fresh for one, fresh, _ in found if one.orders[0] == (1, 0, 2, 3)]
    assert sorted(drawn) == [[], [], [0], [1]]
    assert all(fresh for one, fresh, _ in found if one.orders[0] == (1, 2, 0, 3))
