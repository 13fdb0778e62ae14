"""Neighbours whose order touches do not tell."""

import numpy as np
from hand_made_chains import an_arm, touches

from selftouch_drake.agent.body_model.scene import Scene
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.untold_orders import untold_neighbours
from selftouch_drake.agent.body_model.who_touched import started


def untold(twists, point, order=(0, 1, 2, 3)):
    """Pairs of an arm that touches a ball, told in an order."""
    q, target, _ = touches(twists, point, noise=0.01)
    tree = Tree.chain(list(order))
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), tree.ways([(0, 0)]))
    solution = started(scene, twists, point[None])
    return untold_neighbours(tree, scene, solution, np.random.default_rng(0))


def test_touches_tell_the_order_of_joints_that_turn_far():
    assert untold(*an_arm()) == []


def test_they_do_not_tell_that_of_joints_that_turn_little():
    twists, point = an_arm()
    twists[[1, 2]] *= 0.02
    assert (2, 1) in untold(twists, point)
    assert (1, 2) in untold(twists, point, order=(0, 2, 1, 3))


def test_what_no_touch_needs_is_not_told():
    twists, point = an_arm()
    q, target, _ = touches(twists, point)
    tree = Tree.chain([0, 1, 2, 3])
    scene = Scene(q, target, np.zeros(target.max() + 1, dtype=int), tree.ways([(0, 0)]))
    solution = started(scene, twists, point[None])
    none = scene.some(np.arange(10))
    assert len(untold_neighbours(tree, none, solution, np.random.default_rng(0))) == 3
