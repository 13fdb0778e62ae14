"""Touches made with one limb at a time: which joints moved, and chains that meet at a part."""

import numpy as np
import pytest
from made_up import sphere_points, twist
from scipy.sparse import csr_array
from scipy.spatial.distance import cdist

from selftouch_drake.agent.body_model.chain import adjoint, places
from selftouch_drake.agent.body_model.one_limb import (
    Limb,
    joined,
    largest_first,
    moved_together,
)
from selftouch_drake.agent.body_model.smoothness import SmoothChain

LEFT, RIGHT = (0, 1, 2), (3, 4, 5)


def one_limb_at_a_time(number=20, each=10, seed=0):
    """`(n, 6)` touches: in turn one limb moves, the other stands in a posture of its own."""
    random = np.random.default_rng(seed)
    q = []
    for turn in range(number):
        block = random.uniform(-1, 1, (each, 6))
        standing = list(RIGHT if turn % 2 else LEFT)
        block[:, standing] = block[0, standing] + 0.001 * random.normal(size=(each, 3))
        q.append(block)
    return np.concatenate(q)


def test_what_stands_still_parts_the_limbs():
    moved = moved_together(one_limb_at_a_time())
    assert sorted(moved.sets) == [LEFT, RIGHT]
    of_right = [moved.sets.index(RIGHT), moved.sets.index(LEFT)] * 10
    assert (moved.of_touch == np.repeat(of_right, 10)).mean() > 0.95


def test_joints_that_are_left_alone_for_a_while_stay_in_their_limb():
    q = one_limb_at_a_time()
    q[20:60, 5] = 0.3  # the right limb moves with two of its joints
    moved = moved_together(q)
    assert sorted(moved.sets) == [LEFT, RIGHT]
    assert (moved.of_touch[40:50] == moved.sets.index(RIGHT)).all()


def test_limbs_that_share_a_joint_are_not_told_apart():
    q = one_limb_at_a_time()
    q[:, 3] = np.random.default_rng(5).uniform(-1, 1, len(q))  # as a waist that always moves
    assert len(moved_together(q).sets) == 1


@pytest.mark.parametrize("step", [None, 0.05, 0.001])
def test_where_all_joints_move_there_are_no_limbs(step):
    q = np.random.default_rng(0).uniform(-1, 1, (400, 6))
    if step is not None:
        q = np.sin(np.cumsum(step * q + 0.3 * step, axis=0))
    moved = moved_together(q)
    assert moved.sets == []
    assert (moved.of_touch == -1).all()


def test_few_touches_of_one_limb_are_no_limb():
    assert moved_together(one_limb_at_a_time(number=2)).sets == []


def test_chains_meet_where_they_felt_the_same():
    random = np.random.default_rng(1)
    true = np.array(
        [twist(random.normal(size=3), side + 0.2 * random.normal(size=3), 1.2)
         for side in np.repeat([[-0.2, 0, 0], [0.2, 0, 0]], 3, axis=0)]
    )  # fmt: skip
    tip = np.array([0.0, 0.2, 0.9])
    q = one_limb_at_a_time(60)
    which = np.repeat(np.arange(60) % 2, 10)
    at = np.concatenate([
        places(q[which == limb][:, list(joints)], true[list(joints)], tip)
        for limb, joints in enumerate([RIGHT, LEFT])
    ])  # fmt: skip
    rows = [np.arange(300), np.arange(300, 600)]
    q = np.concatenate([q[which == 0], q[which == 1]])
    receptor, _ = sphere_points(60, radius=1.6)
    sensation = csr_array(np.maximum(0, 2.0 - cdist(at, receptor)))
    # The left limb was found in a frame of its own, mirrored and of another size.
    motion = np.diag([0.5, 0.5, -0.5, 1.0])
    motion[:3, 3] = 0.3, -0.2, 0.1
    elsewhere = np.zeros((6, 6))
    elsewhere[list(LEFT)] = adjoint(motion, true[list(LEFT)])
    there = motion[:3, :3] @ tip + motion[:3, 3]
    limbs = [
        Limb(list(RIGHT), SmoothChain(true[list(RIGHT)], tip, 0.0), rows[0]),
        Limb(list(LEFT), SmoothChain(elsewhere[list(LEFT)], there, 0.0), rows[1]),
    ]
    body = joined(q, sensation, 4, limbs)
    assert body.pairs == ((4, 0), (4, 1))
    assert [joint for joint, _ in body.ways()[4, 1]] == list(LEFT)
    found = places(q[rows[1]][:, list(LEFT)], body.twists[list(LEFT)], body.points[1])
    off = np.linalg.norm(found - at[rows[1]], axis=1)
    assert np.median(off) < 0.1
    assert np.abs(body.twists[list(RIGHT)] - true[list(RIGHT)]).max() == 0


def test_the_part_with_most_receptors_comes_first():
    readings = np.zeros((40, 5))
    readings[:30, 0] = 1.0  # touched most
    readings[30:, 1:] = 1.0
    part = np.repeat([0, 1], [30, 10])
    assert largest_first(csr_array(readings), part) == [1, 0]
