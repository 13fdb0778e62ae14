"""The judgement: what joints alone explain is believed, and what a memory knows as well is not."""

import re

import numpy as np
import pytest
from hand_made_chains import an_arm, misfit, touches

from selftouch_drake.agent.body_model.assemble import reasons
from selftouch_drake.agent.body_model.chain import places
from selftouch_drake.agent.body_model.find import judge_part, judge_parts
from selftouch_drake.agent.body_model.fit import chain_way
from selftouch_drake.agent.body_model.judge import (
    ACCEPTED,
    ACCEPTED_OF_PROVED,
    CHOICE,
    VERDICT,
    Sample,
    held_out,
    judged,
)
from selftouch_drake.agent.body_model.planes import in_a_plane
from selftouch_drake.agent.body_model.scene import Scene, all_places
from selftouch_drake.agent.body_model.who_touched import started

KERNELS = 150


def verdict(q, target, twists, point, outlier=None, seed=0):
    """The judgement of a chain as it is, on readings and labels."""
    random = np.random.default_rng(seed)
    test = held_out(q / q.std(axis=0), random) > 0
    who = np.zeros(len(q), dtype=int) if outlier is None else np.where(outlier, -1, 0)
    whole = Sample(
        q=q / q.std(axis=0), target=target, places=places(q, twists, point)[:, None], toucher=who
    )
    return judged(
        whole.some(np.flatnonzero(~test)), whole.some(np.flatnonzero(test)),
        parameters=6 * len(twists) + 3, number=KERNELS,
    )  # fmt: skip


def crowded(postures, joints=4, number=4000):
    """Touches at a few postures for each kernel, drawn at random: no body makes them."""
    random = np.random.default_rng(3)
    at = random.uniform(-1.5, 1.5, (KERNELS, postures, joints))
    target = random.integers(0, KERNELS, number)
    which = random.integers(0, postures, number)
    return at[target, which] + 0.02 * random.standard_normal((number, joints)), target, which


def test_a_right_chain_is_accepted_with_wrong_labels_too():
    twists, point = an_arm(joints=5)
    q, target, _ = touches(twists, point)
    found = verdict(q, target, twists, point)
    assert found.accepted, found.reason
    assert found.inliers == 1.0
    random = np.random.default_rng(5)
    wrong = random.random(len(q)) < 0.2
    target[wrong] = random.permutation(target[wrong])
    found = verdict(q, target, twists, point, outlier=wrong)
    assert found.accepted, found.reason
    assert 0.1 < 1 - found.inliers < 0.3


def test_a_chain_with_a_wrong_axis_is_rejected():
    twists, point = an_arm(joints=5)
    q, target, _ = touches(twists, point)
    twists[2] = np.roll(twists[2], 1)
    assert not verdict(q, target, twists, point).accepted


def test_touches_that_crowd_prove_nothing():
    q, target, _ = crowded(1)
    found = verdict(q, target, *an_arm(seed=8))
    assert not found.accepted
    assert "prove nothing" in found.reason


@pytest.mark.parametrize(("joints", "open_to_memory"), [(3, True), (4, False)])
def test_a_short_chain_is_not_called_wrong_where_touches_prove_nothing(joints, open_to_memory):
    # With three joints a place has one or two postures, which a regression learns.
    twists, point = an_arm(joints=joints)
    q, target, _ = touches(twists, point)
    bend = 0.05 * np.random.default_rng(2).standard_normal(twists.shape)
    found = verdict(q, target, twists + bend, point)
    assert not found.accepted
    assert 0.4 < found.near < 0.8
    told = re.match(
        r"rejected: the touches prove nothing: (\d+) of (\d+) held-out touches need joints to be "
        r"explained \(50% needed\).*one posture; [\d.]+% of \d+ held-out touches lie nearer",
        reasons([found]),
    )
    assert bool(told) == open_to_memory
    assert ("prove nothing" in found.reason) == open_to_memory
    if told:
        assert 20 < int(told[1]) < 0.5 * int(told[2])


@pytest.mark.parametrize(("joints", "open_to_memory"), [(2, True), (4, False)])
def test_a_chain_that_is_wrong_altogether_hides_no_single_posture(joints, open_to_memory):
    # Its places are such that no regression finds them.
    q, target, _ = touches(*an_arm(joints=joints))
    twists, point = an_arm(seed=8, joints=joints)
    found = verdict(q, target, 25 * twists, point)
    assert not found.accepted
    assert ("prove nothing" in found.reason) == open_to_memory


def test_one_of_two_postures_is_not_enough():
    # Any map at all makes each posture of a kernel small; it calls the other one an outlier.
    q, target, which = crowded(2)
    twists, point = an_arm(seed=8)
    assert not verdict(q, target, twists, point, outlier=which == 1).accepted


@pytest.mark.parametrize("noise_of_other", [0.0, 0.06])
def test_joints_that_other_parts_proved_make_a_judgement_milder(noise_of_other):
    # Two skins on one link; the readings shake where the second one is touched.
    twists, point = an_arm(joints=5)
    number = 3000
    both = [touches(twists, point, number=number, seed=s, kernels=KERNELS) for s in (0, 1)]
    q = np.concatenate([one[0] for one in both])
    target = np.concatenate([both[0][1], KERNELS + both[1][1]])
    random = np.random.default_rng(2)
    q[:number] += noise_of_other * random.standard_normal((number, 5))
    q[number:] += 0.06 * random.standard_normal((number, 5))
    way = chain_way(range(5))
    part = np.repeat([0, 1], KERNELS)
    whole = Scene(q, target, part, {(0, 0): way, (1, 0): way})
    test = held_out(q, random) > 0
    scene, tests = whole.some(np.flatnonzero(~test)), whole.some(np.flatnonzero(test))
    solution = started(scene, twists, point[None])
    alone = judge_part(scene, tests, solution, 1)
    assert ACCEPTED_OF_PROVED < alone.near < ACCEPTED
    assert not alone.accepted
    found = judge_parts(scene, tests, solution)
    proved = noise_of_other == 0
    assert [found[0].accepted, found[1].accepted] == [proved, proved]
    assert ("75% needed" if proved else "88% needed") in found[1].reason


def test_who_chooses_does_not_judge():
    random = np.random.default_rng(0)
    for number in (300, 1000, 20_000):
        purpose = held_out(random.standard_normal((number, 5)), random)
        choice, tested = (purpose == CHOICE).mean(), (purpose == VERDICT).mean()
        assert 0 < choice < tested
        assert 0.05 < choice + tested < 0.25


def a_planar_arm():
    random = np.random.default_rng(1)
    through = random.standard_normal((4, 3)) * [1, 1, 0]
    axis = np.tile([0.0, 0.0, 1.0], (4, 1))
    twists = np.concatenate([axis, np.cross(through, axis)], axis=1)
    return twists, random.standard_normal(3) * [1, 1, 0]


def test_a_chain_in_a_plane_is_made_flat():
    twists, point = a_planar_arm()
    q, target, y = touches(twists, point, kernels=60)
    random = np.random.default_rng(2)
    scene = Scene(q, target, np.zeros(60, dtype=int), {(0, 0): chain_way(range(4))})
    bent = started(scene, twists + 0.02 * random.standard_normal(twists.shape), point[None])
    flat, fixed = in_a_plane(scene, bent)
    places_found = all_places(scene, flat.twists, flat.points)[0]
    assert not places_found[:, 2].any()
    assert fixed.sum() == 4 * 3 + 1
    assert misfit(places_found, y) < 1.0
    # The skin is a line, whose normals lie in the plane.
    assert np.abs(flat.normal[:, 2]).max() < 1e-6


def test_an_arm_in_space_is_not_flat():
    twists, point = an_arm()
    q, target, _ = touches(twists, point, number=1000, kernels=60)
    scene = Scene(q, target, np.zeros(60, dtype=int), {(0, 0): chain_way(range(4))})
    assert in_a_plane(scene, started(scene, twists, point[None])) is None


def test_hands_of_several_points_must_explain_more():
    twists, point = an_arm()
    q, target, _ = touches(twists, point, kernels=KERNELS)
    part, way = np.zeros(KERNELS, dtype=int), chain_way(range(4))
    test = held_out(q, np.random.default_rng(2)) > 0
    for number, needed in ((2, "88% needed"), (3, "93% needed")):
        whole = Scene(q, target, part, dict.fromkeys(((0, u) for u in range(number)), way))
        scene, tests = whole.some(np.flatnonzero(~test)), whole.some(np.flatnonzero(test))
        near = point + 0.02 * np.arange(number)[:, None]
        assert needed in judge_part(scene, tests, started(scene, twists, near), 0).reason
