"""A tool is a point that touches: learned in ten touches, put away, and known again."""

import numpy as np
import pytest
from hand_made_chains import ArmOnBall

from selftouch_drake.agent.body_model.chain_change import explained, foretold
from selftouch_drake.agent.body_model.tools import BARE, Hand, Tool, recognised

STICK, HOOK = np.array([0.25, -0.1, 0.05]), np.array([-0.1, 0.2, 0.2])


def touched(known, usual, offset, number=10, seed=6):
    """Touches of an arm that holds something."""
    arm = ArmOnBall()
    arm.point = arm.point + offset
    return foretold(known, usual, arm.touches(number, seed=seed))


def test_ten_touches_teach_a_tool_and_tell_it_again(known, usual):
    hand, bare = Hand(), np.zeros(3)
    said = [
        hand.feel(known, *touched(known, usual, offset, seed=seed))
        for seed, offset in enumerate([bare, STICK, bare, HOOK, STICK, HOOK, bare], start=20)
    ]
    assert said == [
        "the hand is bare",
        "tool 0 is in hand, a new one",
        "the hand is bare again",
        "tool 1 is in hand, a new one",
        "tool 0 is in hand again",
        "tool 1 is in hand again",
        "the hand is bare again",
    ]
    assert len(hand.tools) == 2
    for tool, true in zip(hand.tools, (STICK, HOOK), strict=True):
        # A chain has a unit of its own, as its skin has.
        size = np.linalg.norm(tool.offset) / known.radius
        assert size == pytest.approx(np.linalg.norm(true) / ArmOnBall().radius, rel=0.1)


def test_the_chain_with_a_tool_touches_where_it_is_felt(known, usual):
    hand = Hand()
    usual_touches, since = touched(known, usual, STICK, number=20)
    hand.feel(known, usual_touches, since)
    with_tool = hand.chain(known)
    before, after = (np.abs(since.errors(one)).mean() for one in (known, with_tool))
    assert after < 0.5 * before
    assert after < 1.2  # usual errors


def test_a_tool_that_is_seen_again_is_known_better(known, usual):
    hand = Hand()
    hand.feel(known, *touched(known, usual, STICK, seed=3))
    once = np.trace(hand.tools[0].covariance)
    hand.feel(known, *touched(known, usual, STICK, seed=4))
    assert np.trace(hand.tools[0].covariance) < 0.8 * once
    assert hand.holds == 0


def test_what_touches_moved_from_a_tool_to_another(known, usual):
    """As in a life: a change is told from the chain as it was, with what it held."""
    hand = Hand()
    change = explained(known, *touched(known, usual, STICK, number=60))
    said, chain = hand.moved(change, 60)
    assert said == "tool 0 is in hand, a new one"
    arm = ArmOnBall()
    arm.point = arm.point + STICK
    chain = chain.felt_as(*arm.touches(300, seed=12))
    again = explained(chain, *foretold(chain, arm.touches(200, seed=9), usual))
    said, bare = hand.moved(again, 200)
    assert said == "the hand is bare again"
    np.testing.assert_allclose(bare.chain.point, known.chain.point)


def test_a_turned_hand_turns_its_tools():
    hand = Hand()
    tool = Tool(np.array([1.0, 0.0, 0.0]), np.diag([1e-4, 4e-4, 9e-4]))
    assert hand.take(tool, 10) == "tool 0 is in hand, a new one"
    hand.turned(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(hand.offset, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.diag(hand.tools[0].covariance), [4e-4, 1e-4, 9e-4])


def test_the_likeliest_tool_is_the_one_whose_errors_explain_it():
    near = Tool(np.array([0.1, 0.0, 0.0]), 1e-6 * np.eye(3))
    vague = Tool(np.array([0.2, 0.0, 0.0]), 1e-2 * np.eye(3))
    found = Tool(np.array([0.12, 0.0, 0.0]), 1e-6 * np.eye(3))
    assert recognised([near, vague], found, 10) == 1
    assert recognised([near], found, 10) == 1
    assert recognised([], Tool(np.full(3, 1e-4), 1e-6 * np.eye(3)), 10) == BARE


def test_few_touches_are_refused(known, usual):
    with pytest.raises(ValueError, match="4 touches do not tell what is in hand"):
        Hand().feel(known, *touched(known, usual, STICK, number=4))
