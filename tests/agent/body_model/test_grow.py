"""A tree grows from one chain; where little hangs on it, a sharper chain is looked for."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hand_made_chains import an_arm, nearest_of, touches
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from selftouch_drake.agent.body_model import forest, grow
from selftouch_drake.agent.body_model.blunt import in_better_order, spread, with_more_points
from selftouch_drake.agent.body_model.chain import adjoint, places
from selftouch_drake.agent.body_model.density import telling_cores
from selftouch_drake.agent.body_model.fit import Bodies, Group, chain_way
from selftouch_drake.agent.body_model.scene import Scene, neighbour_distance
from selftouch_drake.agent.body_model.structure import Search, order_of
from selftouch_drake.agent.body_model.who_touched import started

KERNELS = 60
RIGHT, WRONG = [0, 1, 2, 3, 4, 5], [0, 1, 4, 3, 2, 5]


def two_skins():
    """Touches of a skin before joint 0 of an arm, and of a second one between joints 1 and 2."""
    twists, point = an_arm(joints=6)
    q, target, _ = touches(twists, point, number=2000, kernels=KERNELS)
    near_q, near, _ = touches(twists[2:], point, number=3000, kernels=KERNELS)
    idle = np.random.default_rng(5).uniform(-1.5, 1.5, (len(near_q), 2))
    q = np.concatenate([q, np.column_stack([idle, near_q])])
    target = np.concatenate([target, near + KERNELS])
    return Scene(q, target, np.repeat([0, 1], KERNELS), {}), twists, point


def chain(order, twists, point, loss):
    return Bodies([[chain_way(order)]], twists[None], point[None, None], np.array([[loss]]))


@pytest.mark.parametrize("first", [WRONG, RIGHT])
def test_another_chain_is_looked_for_where_nothing_hangs_on_the_first(first, monkeypatch):
    scene, twists, point = two_skins()
    asked = []

    def chains(search, group, joints):
        part = int(scene.part[scene.target[group.rows[0]]])
        asked.append(part)
        if part == 0:
            order = first if asked.count(0) == 1 else RIGHT
            yield chain(order, twists, point, -1.0 if order == WRONG else -2.0)

    monkeypatch.setattr(grow, "found_chains", chains)
    monkeypatch.setattr(grow, "population", lambda *args, **more: chain(RIGHT, twists, point, -1.0))
    # Any chain may begin: real ones that do have joints at wrong places that show but little.
    monkeypatch.setattr(grow, "_SEED", -1.0)
    search = Search(scene.q.T.astype(np.float32), np.random.default_rng(0))
    body = grow.grown(search, scene, np.zeros(len(scene.q), dtype=bool), RIGHT)
    assert body is not None
    assert sorted(body.links.part) == [0, 1]
    assert order_of(body.links.way(body.links.part[0], body.links.toucher[0])) == RIGHT
    assert order_of(body.links.way(body.links.part[1], body.links.toucher[0])) == RIGHT[2:]
    # Nothing more is looked for where the first chain is right.
    assert asked.count(0) == (1 if first == RIGHT else 2)


def test_a_blunter_chain_does_not_replace_a_sharper_one(monkeypatch):
    scene, twists, point = two_skins()
    search = Search(scene.q.T.astype(np.float32), np.random.default_rng(0))
    grower = grow._Grower(search, scene, np.zeros(len(scene.q), dtype=bool), RIGHT)
    sharp = grower.chains[0] = chain(RIGHT, twists, point, -2.0)
    sharper = replace(sharp, loss=np.array([[-2.5]]))
    for found, kept in (([], sharp), ([chain(RIGHT, twists, point, -1.0)], sharp),
                        ([sharper, sharp], sharper)):  # fmt: skip
        monkeypatch.setattr(grow, "found_chains", lambda *args, given=found: given)
        assert grower.look_again(0) == (kept is sharper)
        assert grower.chains[0] is kept
    # A chain that explains too little is not taken, however sharp.
    bent = chain(WRONG, twists, point, -9.0)
    monkeypatch.setattr(grow, "found_chains", lambda *args: [bent])
    assert not grower.look_again(0)
    # Nor one by several points of a hand.
    blunt = replace(sharper, points=np.repeat(point[None, None], 4, axis=1))
    monkeypatch.setattr(grower, "_proved", lambda *args: (blunt, 1.0))
    assert not grower.look_again(0)


def test_a_tree_begins_with_a_chain_by_one_point_of_a_hand(monkeypatch):
    scene, twists, point = two_skins()
    search = Search(scene.q.T.astype(np.float32), np.random.default_rng(0))
    grower = grow._Grower(search, scene, np.zeros(len(scene.q), dtype=bool), RIGHT)
    grower.chains[0] = chain(RIGHT, twists, point, -1.0)
    several = chain(WRONG, twists, point, -9.0)
    grower.chains[1] = replace(several, points=np.repeat(point[None, None], 4, axis=1))
    monkeypatch.setattr(grow, "population", lambda *args, **more: chain(RIGHT, twists, point, -1.0))
    monkeypatch.setattr(grower, "bundled", lambda body: body)
    assert list(next(grower.seeds()).links.part) == [0]


def test_hypotheses_compete_with_the_best_start_of_each():
    loss = np.array([3.0, 1.0, 1.5, 2.0, 0.5])
    assert forest._best_of_each(["a", "b", "b", "c", "b"], loss) == [4, 3, 0]


def test_a_hand_that_came_later_than_a_part_touches_it_if_that_explains_more():
    arms = [an_arm(seed=seed, joints=4) for seed in (1, 2)]
    made = [touches(*arm, number=1500, kernels=KERNELS, seed=7) for arm in arms]
    idle = np.random.default_rng(3).uniform(-1.5, 1.5, (1500, 4))
    # Each kernel is touched by one hand alone: half of them are enough to hang the part.
    q = np.concatenate([np.column_stack([made[0][0], idle]), np.column_stack([idle, made[1][0]])])
    target = np.concatenate([made[0][1], KERNELS + made[1][1]])
    scene = Scene(q, target, np.zeros(2 * KERNELS, dtype=int), {})
    links = forest.Links.of_chain(chain_way([0, 1, 2, 3]), 0)
    links, end = links.extended(0, [4, 5, 6, 7], forwards=True)
    links = replace(links, toucher={**links.toucher, 1: end})
    twists, points = np.concatenate([arm[0] for arm in arms]), np.array([arm[1] for arm in arms])
    body = forest.Mechanism(links, twists, points, ((0, 0),))
    random = np.random.default_rng(0)
    assert forest.with_late_touchers(scene, body, random).pairs == ((0, 0), (0, 1))
    # A hand that explains nothing is left out.
    elsewhere = replace(body, twists=np.concatenate([twists[:4], an_arm(seed=5, joints=4)[0]]))
    assert forest.with_late_touchers(scene, elsewhere, random) is elsewhere


def carried(motion, point):
    return motion[:3, :3] @ point + motion[:3, 3]


@cache
def two_arms_on_a_neck(points_of_a_hand=1):
    """Touches of a ball on a neck of two joints by two arms of three.

    `Scene`, whose hand touched, twists, points, and where on the ball. Joints 0 and 1 are the
    neck's; 2, 3, 4 the first arm's. Each touch is by one hand.
    """
    random = np.random.default_rng(4)
    first, point = an_arm(seed=1, joints=5)
    own, other = an_arm(seed=2, joints=3)
    twists = np.concatenate([first, own])
    near = random.standard_normal((points_of_a_hand, 3))
    points = np.concatenate([point + near, other + near[::-1]])
    q, y, hand = [], [], []
    center, radius = None, None
    for number, arm in enumerate(([0, 1, 2, 3, 4], [0, 1, 5, 6, 7])):
        tried = random.uniform(-1.5, 1.5, (400_000, 8))
        which = number * points_of_a_hand + random.integers(points_of_a_hand, size=len(tried))
        there = places(tried[:, arm], twists[arm], points[which])
        if center is None:
            center = np.median(there, axis=0)
            radius = np.median(np.linalg.norm(there - center, axis=1))
        on = np.abs(np.linalg.norm(there - center, axis=1) / radius - 1) < 0.02
        q.append(tried[on][:4000])
        y.append(there[on][:4000])
        hand += [number] * len(q[-1])
    target = nearest_of(np.concatenate(y), KERNELS)
    scene = Scene(np.concatenate(q), target, np.zeros(KERNELS, dtype=int), {})
    return scene, np.array(hand), twists, points, np.concatenate(y)


def what_is_felt(y):
    """Readings of 60 receptors about as far apart as their fields are wide."""
    receptors = y[np.random.default_rng(1).choice(len(y), 60, replace=False)]
    apart = np.linalg.norm(y[:, None] - receptors, axis=2) / np.std(y)
    return csr_array(np.exp(-2 * apart**2) * (apart < 1.2))


def test_chains_of_two_hands_that_share_a_neck_become_one_tree():
    scene, hand, twists, points, _ = two_arms_on_a_neck()
    # The second chain was found alone: in another frame, of another size, and mirrored.
    motion = np.eye(4)
    motion[:3, :3] = 0.7 * Rotation.random(rng=1).as_matrix() @ np.diag([1, 1, -1])
    motion[:3, 3] = [3, -1, 2]
    chains = [
        (chain([0, 1, 2, 3, 4], twists, points[0], -9.0), np.flatnonzero(hand == 0)),
        (
            chain([0, 1, 5, 6, 7], adjoint(motion, twists), carried(motion, points[1]), -8.0),
            np.flatnonzero(hand == 1),
        ),
    ]
    body = forest.joined(scene, 0, chains)
    assert order_of(body.links.way(body.links.part[0], body.links.toucher[0])) == [0, 1, 2, 3, 4]
    assert order_of(body.links.way(body.links.part[0], body.links.toucher[1])) == [0, 1, 5, 6, 7]
    assert np.allclose(body.twists, twists, atol=0.06)
    assert np.allclose(body.points, points, atol=0.1)


def test_a_hand_that_is_no_point_is_given_several():
    scene, hand, twists, points, _ = two_arms_on_a_neck(points_of_a_hand=3)
    way = chain_way([0, 1, 2, 3, 4])
    own = replace(scene.some(np.flatnonzero(hand == 0)), ways={(0, 0): way})
    blunt = started(own, twists, points[:3].mean(axis=0)[None])
    assert forest.explained(own, blunt, 0) < 0.6
    wider, solution = spread(own, blunt, 0, 3, np.random.default_rng(0))
    assert forest.explained(wider, solution, 0) > 0.85
    assert len(wider.touchers(0)) == 3


def test_limbs_are_told_by_the_joints_that_tell_most_touches_surely():
    scene, *_ = two_arms_on_a_neck()
    some = np.arange(0, len(scene.q), 2)
    q, group = scene.q.T.astype(np.float32), Group.of(some, scene.target[some])
    # The neck was given to one of them, and one limb fell into two: each limb's own joints are.
    cores = telling_cores(q, group, [[0, 2, 3], [1, 5, 6, 7], [3, 4]])
    assert sorted(cores) == [[2, 3, 4], [5, 6, 7]]


def test_joints_of_a_hand_that_is_no_point_find_their_places():
    scene, hand, twists, points, _ = two_arms_on_a_neck(points_of_a_hand=3)
    ways = dict.fromkeys(((0, 0), (0, 1), (0, 2)), chain_way([0, 2, 1, 3, 4]))
    own = replace(scene.some(np.flatnonzero(hand == 0)), ways=ways)
    assert own.blunt
    search = Search(scene.q.T.astype(np.float32), np.random.default_rng(0))
    ordered, solution = in_better_order(search, own, started(own, twists, points[:3]), 0)
    assert order_of(ordered.ways[0, 0]) == [0, 1, 2, 3, 4]
    assert forest.explained(ordered, solution, 0) > 0.85


@pytest.mark.long
@pytest.mark.slow
def test_two_hands_that_are_no_points_are_found_by_what_was_felt():
    """With nothing given, by a search that is led by sensations, and what one hand shows."""
    scene, _, _, _, y = two_arms_on_a_neck(points_of_a_hand=4)
    felt = what_is_felt(y)
    q = np.ascontiguousarray(scene.q.T.astype(np.float32))
    search = Search(q, np.random.default_rng(0), sensation=felt)
    tested = np.arange(len(scene.q)) % 5 == 0
    body = grow.grown(search, scene, tested, list(range(8)), hands=True)
    assert body is not None
    hands = body.links.hands(body.links.toucher)
    ways = {order_of_hand(body, hand[0]) for hand in hands}
    assert ways == {(0, 1, 2, 3, 4), (0, 1, 5, 6, 7)}


def order_of_hand(body, toucher):
    return tuple(order_of(body.links.way(body.links.part[0], body.links.toucher[toucher])))


def test_hands_that_are_no_points_get_more_of_them_once_a_tree_stands():
    scene, _, twists, points, _ = two_arms_on_a_neck(points_of_a_hand=3)
    links = forest.Links.of_chain(chain_way([0, 1, 2, 3, 4]), 0, 3)
    links, hand = links.extended(2, [5, 6, 7], forwards=True)
    tree = replace(links, toucher={**links.toucher, 3: hand, 4: hand, 5: hand}).rooted(0)
    own = replace(scene, ways=tree.ways([(0, toucher) for toucher in range(6)]))
    solution = started(own, twists, points)
    more, wider, found = with_more_points(tree, own, solution, 5, np.random.default_rng(0))
    assert sorted(more.toucher.values()) == [4] * 5 + [7] * 5
    assert forest.explained(wider, found, 0) > 0.9
    moved = np.linalg.norm(found.place - solution.place, axis=1)
    assert np.median(moved) < neighbour_distance(solution.place) / 3
