"""A body that changed is the chain as it was, but for the fewest numbers."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_chains import ArmOnBall
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.chain_change import (
    Change,
    explained,
    foretold,
    off_alike,
)

NUM_SINCE = 60


def found(known, usual, change, seed=6):
    """What is found of an arm after `change` of it, and touches since."""
    arm = ArmOnBall()
    change(arm)
    since = arm.touches(NUM_SINCE, seed=seed)
    return explained(known, *foretold(known, usual, since)), arm


def shifted(twists, place, offset):
    """What comes after a joint is moved."""
    motion = np.eye(4)
    motion[:3, 3] = offset
    twists[place:] = adjoint(motion, twists[place:])


def test_nothing_changed_is_no_change(known, usual):
    for seed in range(6, 10):
        assert found(known, usual, lambda arm: None, seed)[0] is None


@pytest.mark.parametrize("joint", range(4))
def test_a_zero_that_moved_is_one_number(known, usual, joint):
    q, felt = ArmOnBall().touches(NUM_SINCE, seed=6)
    q[:, joint] -= 0.1
    change = explained(known, *foretold(known, usual, (q, felt)))
    (part,) = change.parts
    assert part.kind == Change.ZERO
    assert part.joint == joint
    assert part.amount == pytest.approx(0.1, abs=max(4 * part.sigma[0], 0.01))
    assert 0 < part.sigma[0] < 0.02
    assert change.in_words.startswith(f"the zero of joint {joint} moved by +0.")
    lower, upper = np.full(4, -2.0), np.full(4, 2.0)
    now, reached = change.moved(q, lower, upper)
    np.testing.assert_allclose(now[:, joint], q[:, joint] - part.amount)
    np.testing.assert_allclose(change.as_before(now, lower, upper), q)
    assert reached.all()
    assert not change.moved(q, lower, np.full(4, -1.9))[1].any()


def test_errors_that_are_alike_in_touches_that_follow_each_other_earn_no_numbers(known, usual):
    q, felt = ArmOnBall().touches(NUM_SINCE, seed=6)
    q[:, 1] -= 0.1
    before, since = foretold(known, usual, (q, felt))
    # As a finger that slides: what is left out changes slowly from touch to touch.
    random = np.random.default_rng(3)
    runs = [
        np.repeat(random.standard_normal((-(-len(some.q) // 8), 3)), 8, axis=0)[: len(some.q)]
        for some in (before, since)
    ]
    off = [
        replace(some, place=some.place + 2 * run @ np.linalg.inv(some.root))
        for some, run in zip((before, since), runs, strict=True)
    ]
    assert (
        off_alike(off[0].errors(known).reshape(-1, 3))
        > 4
        > 2
        > off_alike(before.errors(known).reshape(-1, 3))
    )
    change = explained(known, *off)
    (part,) = change.parts
    assert (part.kind, part.joint) == (Change.ZERO, 1)
    assert part.sure
    assert part.amount == pytest.approx(0.1, abs=4 * part.sigma[0])
    # The standard error says how few touches that is worth.
    (exact,) = explained(known, before, since).parts
    assert part.sigma[0] > 3 * exact.sigma[0]


def test_a_longer_fingertip_and_a_longer_link_are_told_apart(known, usual):
    offset = np.array([0.1, -0.05, 0.05])

    def tip(arm):
        arm.point = arm.point + offset

    def link(arm):
        shifted(arm.twists, 2, offset)
        arm.point = arm.point + offset

    change, _ = found(known, usual, tip)
    (part,) = change.parts
    assert part.kind == Change.TOUCHER
    size = np.linalg.norm(offset) / ArmOnBall().radius
    assert np.linalg.norm(part.amount) == pytest.approx(size, rel=0.3)
    assert change.in_words.startswith("what touches moved by 0.")
    change, arm = found(known, usual, link)
    assert [(part.kind, part.joint) for part in change.parts] == [(Change.LINK, 1)]
    # Where something was felt, the same is felt now.
    q, _ = ArmOnBall().touches(200, seed=8)
    now, reached = change.moved(q, np.full(4, -2.0), np.full(4, 2.0))
    assert reached.mean() > 0.9
    height = np.linalg.norm(ArmOnBall().places(q), axis=1)
    moved, unmoved = (np.linalg.norm(arm.places(one), axis=1) - height for one in (now, q))
    assert np.median(np.abs(moved)) < 0.01
    assert np.median(np.abs(unmoved)) > 0.02
    again = change.as_before(now, np.full(4, -2.0), np.full(4, 2.0))
    off = np.linalg.norm(known.places(again) - known.places(q), axis=1)
    assert np.median(off) < 0.01 * known.radius


def test_a_skin_that_slipped_turned_or_stretched_is_the_skin(known, usual):
    def slipped(arm):
        arm.center = arm.center + np.array([0.1, 0.08, 0.0])

    def stretched(arm):
        arm.radius = 1.1 * arm.radius

    assert [part.kind for part in found(known, usual, slipped)[0].parts] == [Change.SKIN]
    (part,) = found(known, usual, stretched)[0].parts
    assert part.kind == Change.STRETCHED_SKIN
    assert np.exp(-part.amount[3]) == pytest.approx(1.1, abs=0.02)

    def turned(arm):
        a = 0.15
        turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        arm.receptors = arm.receptors @ turn.T

    change, _ = found(known, usual, turned)
    (part,) = change.parts
    assert part.kind == Change.TURNED_SKIN
    assert np.linalg.norm(part.amount[:3]) == pytest.approx(0.15, abs=0.03)
    assert "degrees" in change.in_words


def test_receptors_are_compared_as_they_were(known):
    q, felt = ArmOnBall().touches(50, seed=3)
    sensed = known.sensed.like(csr_array(felt))
    off = known.sensed.predicted(known.places(known.q), sensed) - known.places(q)
    assert np.median(np.linalg.norm(off, axis=1)) < 0.05 * known.radius
    misplaced, unsure = known.misplaced(q, felt)
    np.testing.assert_allclose(misplaced, np.linalg.norm(off, axis=1) / known.radius)
    # What never felt together says less of its place.
    strange = np.random.default_rng(0).permuted(felt, axis=1)
    assert np.median(known.misplaced(q, strange)[1]) > 3 * np.median(unsure)


def test_two_things_that_changed_are_told_where_one_is_not_enough(known, usual):
    offset = np.array([0.1, -0.05, 0.05])
    arm = ArmOnBall()
    arm.point = arm.point + offset
    q, felt = arm.touches(NUM_SINCE, seed=6)
    q[:, 0] -= 0.15
    change = explained(known, *foretold(known, usual, (q, felt)))
    assert {(part.kind, part.joint) for part in change.parts} == {
        (Change.TOUCHER, -1),
        (Change.ZERO, 0),
    }
    zero = next(part for part in change.parts if part.kind == Change.ZERO)
    assert zero.amount == pytest.approx(0.15, abs=0.03)
    assert "; " in change.in_words
    q, felt = ArmOnBall().touches(NUM_SINCE, seed=6)
    q[:, 0] -= 0.15
    q[:, 3] += 0.2
    change = explained(known, *foretold(known, usual, (q, felt)))
    found_zeros = {part.joint: float(part.amount[0]) for part in change.parts}
    assert found_zeros == pytest.approx({0: 0.15, 3: -0.2}, abs=0.03)
    now, _ = change.moved(q, np.full(4, -2.0), np.full(4, 2.0))
    np.testing.assert_allclose(change.as_before(now, np.full(4, -2.0), np.full(4, 2.0)), q)
