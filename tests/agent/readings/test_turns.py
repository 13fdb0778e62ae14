"""Joints that turn round and round: counted on or not, the agent learns the same."""

import numpy as np
import pytest

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.readings.turns import turning, within_a_turn, wrapping


def ring(num_rows=2500):
    """A wheel with 24 receptors that turns several times, and how firmly it is pressed."""
    rng = np.random.default_rng(0)
    steps = np.convolve(rng.normal(size=num_rows + 200), np.hanning(120), "same")[:num_rows]
    angle, depth = np.cumsum(0.02 * steps), 1.3 + np.sin(np.arange(num_rows) / 23)
    places = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    apart = np.abs((angle[:, None] - places + np.pi) % (2 * np.pi) - np.pi)
    return angle, depth, np.maximum(1 - apart / 0.6, 0) * depth[:, None]


def test_a_turn_counted_on_is_learned_as_one_that_begins_again():
    angle, depth, sensation = ring()
    assert np.ptp(angle) > 4 * np.pi
    wrapped = angle - 2 * np.pi * np.floor(angle / (2 * np.pi) + 0.5)
    one, other = (
        Agent.learn(np.column_stack([q, depth]), sensation, num_targets=30).representation
        for q in (angle, wrapped)
    )
    np.testing.assert_array_equal(one.kernel_q, other.kernel_q)
    np.testing.assert_array_equal(one.joint_scale, other.joint_scale)


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0, 1024.0])
def test_the_turn_of_a_joint_is_found(turn):
    angle, depth, sensation = ring()
    counted = angle * turn / (2 * np.pi)
    counted = counted.round() if turn > 400 else counted
    q = np.column_stack([counted, depth])
    np.testing.assert_allclose(turning(q, sensation), [turn, 0.0])
    inside = within_a_turn(q, np.array([turn, 0.0]))
    assert np.ptp(inside[:, 0]) <= turn
    np.testing.assert_array_equal(inside[:, 1], depth)
    np.testing.assert_allclose(np.cos(2 * np.pi * (inside[:, 0] - counted) / turn), 1.0)
    follows = np.ones(len(q) - 1, dtype=bool)
    np.testing.assert_allclose(wrapping(inside, follows), [turn, 0.0])
    assert not wrapping(q, follows).any()


@pytest.mark.parametrize("width", [1.5, 6.0, 20.0])
def test_what_does_not_come_back_is_no_turn(width):
    """A slide in mm, on skins from fine to coarse."""
    angle, depth, _ = ring()
    along = np.abs(angle[:, None] - np.linspace(angle.min(), angle.max(), 60))
    sensation = np.maximum(1 - along / width, 0) * depth[:, None]
    q = np.column_stack([angle, depth])
    assert not turning(q, sensation).any()
    assert within_a_turn(q, np.zeros(2)) is q


def test_a_joint_that_does_not_matter_is_left_as_it_is():
    """It moves by more than 2 pi, because it is in degrees."""
    angle, depth, sensation = ring()
    sway = 40 * np.sin(np.arange(len(angle)) / 61)
    q = np.column_stack([angle, depth, sway])
    np.testing.assert_allclose(turning(q, sensation), [2 * np.pi, 0.0, 0.0])
