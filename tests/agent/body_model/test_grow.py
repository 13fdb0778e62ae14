"""A tree grows from one chain; where little hangs on it, a sharper chain is looked for."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import an_arm, touches

from selftouch_drake.agent.body_model import forest, grow
from selftouch_drake.agent.body_model.fit import Bodies, chain_way
from selftouch_drake.agent.body_model.scene import Scene
from selftouch_drake.agent.body_model.structure import Search, order_of

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
