"""A part of the graph that is skins of two links is torn apart where a tree tells them apart."""

from dataclasses import replace

import numpy as np
import pytest
from test_grow import KERNELS, RIGHT, two_skins

from selftouch_drake.agent.body_model.fit import chain_way
from selftouch_drake.agent.body_model.forest import Links, Mechanism
from selftouch_drake.agent.body_model.structure import Search
from selftouch_drake.agent.body_model.torn_parts import torn_apart


@pytest.fixture(scope="module")
def arm():
    """Touches of two skins, and the arm as a tree that wears neither."""
    scene, twists, point = two_skins()
    links = replace(Links.of_chain(chain_way(RIGHT), 0), part={})
    return scene, Mechanism(links, twists, point[None], ())


def torn(scene, body):
    search = Search(scene.q.T.astype(np.float32), np.random.default_rng(0))
    return torn_apart(body, search, scene, np.zeros(len(scene.q), dtype=bool), RIGHT)


def test_two_skins_in_one_part_become_two_parts(arm):
    scene, body = arm
    one_part = replace(scene, part=np.zeros(2 * KERNELS, dtype=int))
    part, found = torn(one_part, body)
    links, hand = found.links, found.links.toucher[0]
    skin = [part[:KERNELS], part[KERNELS:]]
    wears = [np.bincount(own).argmax() for own in skin]
    assert sorted(wears) == [0, 1]
    assert all((own == which).mean() > 0.9 for own, which in zip(skin, wears, strict=True))
    assert [len(links.way(links.part[which], hand)) for which in wears] == [6, 4]


def test_a_part_that_no_link_explains_stays_whole(arm):
    scene, body = arm
    shuffled = np.random.default_rng(1).permutation(scene.target)
    one_part = replace(scene, target=shuffled, part=np.zeros(2 * KERNELS, dtype=int))
    part, found = torn(one_part, body)
    assert not part.any()
    assert found is body


def test_parts_in_the_tree_are_left_alone(arm):
    scene, body = arm
    hand = len(RIGHT)
    there = replace(body.links, part={0: 0, 1: 2})
    whole = replace(body, links=there, pairs=((0, 0), (1, 0)))
    assert there.toucher == {0: hand}
    part, found = torn(scene, whole)
    assert found is whole
    assert np.array_equal(part, scene.part)
