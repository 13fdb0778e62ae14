"""A body that changed is the chain as it was, but for the fewest numbers."""

import numpy as np
import pytest
from hand_made_chains import ArmOnBall
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.chain_change import Change, explained, foretold
from selftouch_drake.agent.body_model.known_chain import found_chain

NUM_BEFORE, NUM_SINCE = 400, 60


@pytest.fixture(scope="module")
def known():
    return found_chain(*ArmOnBall().touches(NUM_BEFORE))


@pytest.fixture(scope="module")
def usual():
    return ArmOnBall().touches(200, seed=5)


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
    assert change.kind == Change.ZERO
    assert change.joint == joint
    assert change.amount == pytest.approx(0.1, abs=max(4 * change.sigma[0], 0.01))
    assert 0 < change.sigma[0] < 0.02
    assert change.in_words.startswith(f"the zero of joint {joint} moved by +0.")
    lower, upper = np.full(4, -2.0), np.full(4, 2.0)
    now, reached = change.moved(q, lower, upper)
    np.testing.assert_allclose(now[:, joint], q[:, joint] - change.amount)
    np.testing.assert_allclose(change.as_before(now, lower, upper), q)
    assert reached.all()
    assert not change.moved(q, lower, np.full(4, -1.9))[1].any()


def test_a_longer_fingertip_and_a_longer_link_are_told_apart(known, usual):
    offset = np.array([0.1, -0.05, 0.05])

    def tip(arm):
        arm.point = arm.point + offset

    def link(arm):
        shifted(arm.twists, 2, offset)
        arm.point = arm.point + offset

    change, _ = found(known, usual, tip)
    assert change.kind == Change.TOUCHER
    size = np.linalg.norm(offset) / ArmOnBall().radius
    assert np.linalg.norm(change.amount) == pytest.approx(size, rel=0.3)
    assert change.in_words.startswith("what touches moved by 0.")
    change, arm = found(known, usual, link)
    assert (change.kind, change.joint) == (Change.LINK, 1)
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

    assert found(known, usual, slipped)[0].kind == Change.SKIN
    change, _ = found(known, usual, stretched)
    assert change.kind == Change.STRETCHED_SKIN
    assert np.exp(-change.amount[3]) == pytest.approx(1.1, abs=0.02)

    def turned(arm):
        a = 0.15
        turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        arm.receptors = arm.receptors @ turn.T

    change, _ = found(known, usual, turned)
    assert change.kind == Change.TURNED_SKIN
    assert np.linalg.norm(change.amount[:3]) == pytest.approx(0.15, abs=0.03)
    assert "degrees" in change.in_words


def test_receptors_are_compared_as_they_were(known):
    q, felt = ArmOnBall().touches(50, seed=3)
    sensed = known.sensed.like(csr_array(felt))
    off = known.sensed.predicted(known.places(known.q), sensed) - known.places(q)
    assert np.median(np.linalg.norm(off, axis=1)) < 0.05 * known.radius
