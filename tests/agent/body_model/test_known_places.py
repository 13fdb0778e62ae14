"""What one hand shows of a skin finds the next hand; where a hand is finds what hangs behind."""

import numpy as np
from hand_made_chains import an_arm, misfit, touches
from test_grow import KERNELS, chain, two_arms_on_a_neck, two_skins

from selftouch_drake.agent.body_model import forest
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.fit import Bodies, Descent, Group, Smooth, chain_way
from selftouch_drake.agent.body_model.forest import Links, Mechanism
from selftouch_drake.agent.body_model.known_places import Shown, behind_new_joints
from selftouch_drake.agent.body_model.structure import Search, order_of
from selftouch_drake.agent.body_model.who_touched import started

NECK_AND_ARMS = [0, 1, 2, 3, 4], [0, 1, 5, 6, 7]


def searching(scene):
    return Search(np.ascontiguousarray(scene.q.T.astype(np.float32)), np.random.default_rng(0))


def test_a_hand_that_is_known_tells_which_touches_are_of_others():
    scene, hand, twists, points, _ = two_arms_on_a_neck()
    first = chain(NECK_AND_ARMS[0], twists, points[0], -9.0)
    known = Shown.of(scene, first, np.flatnonzero(hand == 0), 0)
    by_others = known.by_others(scene, np.arange(len(scene.q)))
    assert by_others[hand == 0].mean() < 0.01
    # The rest came near by chance.
    assert by_others[hand == 1].mean() > 0.8


def test_the_next_hand_is_found_from_what_the_first_one_shows():
    scene, hand, twists, points, _ = two_arms_on_a_neck()
    first = chain(NECK_AND_ARMS[0], twists, points[0], -9.0)
    known = Shown.of(scene, first, np.flatnonzero(hand == 0), 0)
    rows = np.flatnonzero(hand == 1)
    found = next(known.chains_to(searching(scene), scene, rows, [7, 1, 6, 0, 5]))
    assert order_of(found.ways[0][0]) == NECK_AND_ARMS[1]
    # In the frame of the first one.
    assert np.allclose(found.points[0, 0], points[1], atol=0.1)
    own = forest.alone(scene, rows, 0, found)
    assert forest.explained(own, started(own, found.twists[0], found.points[0]), 0) > 0.9


def test_nothing_is_looked_for_where_hardly_a_joint_is_new():
    scene, hand, twists, points, _ = two_arms_on_a_neck()
    known = Shown.of(
        scene, chain(NECK_AND_ARMS[0], twists, points[0], -9.0), np.flatnonzero(hand == 0), 0
    )
    rows = np.flatnonzero(hand == 1)
    assert list(known.chains_to(searching(scene), scene, rows, [0, 1, 2, 3, 7])) == []


def test_a_part_behind_new_joints_is_found_from_where_the_hand_is():
    scene, twists, point = two_skins()
    links = Links.of_chain(chain_way([2, 3, 4, 5]), 1)
    known = twists.copy()
    known[:2] = 0
    body = Mechanism(links, known, point[None], ((1, 0),))
    rows = np.flatnonzero(scene.part[scene.target] == 0)
    group = Group.of(rows, scene.target[rows])
    bigger = next(behind_new_joints(searching(scene), scene, group, body, 0, [0], [1, 0]))
    way = bigger.links.way(bigger.links.part[0], bigger.links.toucher[0])
    assert order_of(way) == [0, 1, 2, 3, 4, 5]
    # What was known has not moved, and new joints are where they belong.
    assert np.array_equal(bigger.twists[2:], twists[2:])
    own = scene.q[rows]
    assert misfit(places(own, bigger.twists, point), places(own, twists, point)) < 1.0


def test_what_is_fixed_does_not_move():
    twists, point = an_arm()
    q, target, _ = touches(twists, point, number=1000, kernels=KERNELS)
    begun = twists.copy()
    begun[1] += 0.2
    body = Bodies([[chain_way(range(4))]], begun[None], point[None, None], np.full((1, 1), np.inf))
    q = np.ascontiguousarray(q.T.astype(np.float32))
    search = Search(q, np.random.default_rng(0))
    for group in (Group.of(np.arange(1000), target), Smooth(np.arange(50), np.eye(50) - 1 / 50)):
        found = search.descended([group], body, Descent(steps=50), fixed=[0, 2, 3])
        assert np.array_equal(found.twists[0, [0, 2, 3]], begun[[0, 2, 3]])
        assert np.array_equal(found.points, body.points)
        assert not np.array_equal(found.twists[0, 1], begun[1])
