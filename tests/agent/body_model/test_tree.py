"""Trees of joints: ways, roots, frames; who touched by densities; skins hung where they fit."""

import numpy as np
import pytest
from hand_made_chains import an_arm, touches

from selftouch_drake.agent.body_model.chain import adjoint, places
from selftouch_drake.agent.body_model.density import limbs, who_touched
from selftouch_drake.agent.body_model.find import _commuting, _may_change
from selftouch_drake.agent.body_model.fit import Group, random_twists
from selftouch_drake.agent.body_model.forest import (
    Links,
    Mechanism,
    hung,
    robust_similarity,
    twist_similarity,
)
from selftouch_drake.agent.body_model.model import BASE
from selftouch_drake.agent.body_model.scene import Scene
from selftouch_drake.agent.body_model.tree import Tree, for_readings

# Part 0 on link 0; joints 0, 1, 2 lead to toucher 0; joints 3, 4 to toucher 1; joint 5 turns link 0
# against part 1.
LINKS = Links(
    {0: (0, 1), 1: (1, 2), 2: (2, 3), 3: (0, 4), 4: (4, 5), 5: (6, 0)},
    7,
    {0: 0, 1: 6},
    {0: 3, 1: 5},
)


def test_ways_through_links_pass_joints_in_both_directions():
    assert LINKS.way(3, 5) == ((2, -1), (1, -1), (0, -1), (3, 1), (4, 1))
    assert LINKS.way(6, 3) == ((5, 1), (0, 1), (1, 1), (2, 1))
    assert LINKS.way(2, 2) == ()


def test_links_can_be_rooted_anywhere():
    tree = LINKS.rooted(0)
    assert tree.parent == {0: BASE, 1: 0, 2: 1, 3: BASE, 4: 3, 5: BASE}
    assert tree.part == {0: BASE, 1: 5}
    assert tree.toucher == {0: 2, 1: 4}
    assert LINKS.backwards(0) == [5]
    # The joint that is passed backwards has its twist turned round, so that ways agree.
    assert tree.way(tree.part[1], tree.toucher[0]) == ((5, -1), (0, 1), (1, 1), (2, 1))


def test_a_joint_is_added_between_a_tree_and_a_skin():
    links, skin = LINKS.extended(2, [8, 7], forwards=False)
    assert links.way(skin, 3) == ((7, 1), (8, 1), (2, 1))


def test_a_tree_for_raw_readings_carries_points_to_the_same_places():
    random = np.random.default_rng(0)
    tree = Tree({0: BASE, 1: 0, 2: 0}, {0: 1}, {0: 2})
    twists, point = random_twists(random, 3), random.standard_normal(3)
    center, scale = random.standard_normal(3), random.uniform(0.5, 2, 3)
    motion = np.eye(4)
    motion[:3, :3] *= 0.3
    motion[:3, 3] = [1, 2, 3]
    raw, carried = for_readings(tree, twists, center, scale, motion)
    way = tree.way(tree.part[0], tree.toucher[0])
    assert way == ((1, -1), (2, 1))
    joints, signs = [1, 2], np.array([-1, 1])
    q = random.standard_normal((20, 3))
    z = (q - center) / scale
    there = places(z[:, joints], twists[joints], point, signs)
    end = carried[2][:3, :3] @ point + carried[2][:3, 3]
    found = places(q[:, joints], raw[joints], end, signs)
    assert found == pytest.approx(there @ carried[1][:3, :3].T + carried[1][:3, 3], abs=1e-10)


@pytest.mark.parametrize("hand", [1, -1])
def test_frames_are_found_from_points_and_from_twists(hand):
    random = np.random.default_rng(4)
    motion = np.eye(4)
    turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
    motion[:3, :3] = 1.7 * hand * np.sign(np.linalg.det(turn)) * turn
    motion[:3, 3] = random.standard_normal(3)
    twists, points = random_twists(random, 4), random.standard_normal((30, 3))
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    moved[:3] += 5
    assert robust_similarity(points, moved) == pytest.approx(motion, abs=1e-9)
    assert twist_similarity(twists, adjoint(motion, twists)) == pytest.approx(motion, abs=1e-9)


def test_limbs_are_groups_of_joints_that_hold_each_other():
    statistic = np.full((7, 7), 0.01)
    statistic[:3, :3], statistic[4:, 4:] = 0.3, 0.2
    np.fill_diagonal(statistic, 0)
    assert limbs(statistic, 0.001) == [[0, 1, 2], [4, 5, 6]]


def a_scene_of_two_arms():
    """Two arms, joints 0 to 3 and 4 to 7, touch one sphere; who touched; the chain of both."""
    random = np.random.default_rng(0)
    twists, point = an_arm()
    q, target, _ = touches(twists, point, number=5000)
    own, other = random.uniform(-1.5, 1.5, (2, len(q), 4))
    who = random.random(len(q)) < 0.5
    own, other = np.where(who[:, None], other, q), np.where(who[:, None], q, other)
    return np.concatenate([own, other], axis=1), target, who, (twists, point)


def test_densities_tell_who_touched_without_a_model():
    q, target, who, _ = a_scene_of_two_arms()
    z = np.ascontiguousarray(((q - q.mean(axis=0)) / q.std(axis=0)).T.astype(np.float32))
    group = Group.of(np.arange(len(q)), target)
    share = who_touched(z, group, [[0, 1, 2], [4, 5, 6]])
    sure = share.max(axis=1) > 0.85
    right = (share.argmax(axis=1) == who[group.rows])[sure].mean()
    assert sure.mean() > 0.3
    assert right > 0.97


def test_a_skin_is_hung_where_it_explains_most_touches():
    q, target, _, (twists, point) = a_scene_of_two_arms()
    both = np.concatenate([twists, twists])
    links = Links({j: (0 if j in (0, 4) else j, j + 1) for j in range(8)}, 9, {}, {0: 4, 1: 8})
    body = Mechanism(links, both, np.stack([point, point]), ())
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), {})
    share, found = hung(scene, body, 0, np.random.default_rng(0))
    assert found.links.part == {0: 0}
    assert found.pairs == ((0, 0), (0, 1))
    assert share > 0.85


def test_only_joints_that_commute_may_change_places():
    axis, other = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    through = np.array([0.5, 0.2, 0])
    coaxial = np.r_[axis, np.cross(through, axis)]
    crossing = np.r_[other, np.cross(through, other)]
    slide, across = np.r_[np.zeros(3), axis], np.r_[np.zeros(3), other]
    tree = Tree.chain([0, 1, 2, 3, 4])
    twists = np.stack([coaxial, -2 * coaxial, crossing, slide, across])
    assert _commuting(tree, twists).tolist() == [0, 0, -1, 1, 1]


def test_groups_of_joints_that_may_change_places_join_whole():
    groups = np.array([0, 0, 1, 1, -1])
    _may_change(groups, 1, 2)
    assert len(set(groups[:4].tolist())) == 1
    _may_change(groups, 3, 4)
    assert len(set(groups.tolist())) == 1
