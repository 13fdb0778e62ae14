"""Joints at the times of the skin: between rows that have them, never across what is unknown."""

import numpy as np
import pytest

from selftouch_drake.experience.containers.contents import Clock
from selftouch_drake.experience.joining import Stream, interpolated, together
from selftouch_drake.experience.recording_error import RecordingError

TIME_S = np.arange(100) / 10
AT = np.arange(200) / 20.0


def stream(values, time_s=TIME_S, name="a", stamp_s=None):
    return Stream(values=values, clock=Clock(name=name, time_s=time_s, stamp_s=stamp_s))


def test_joints_are_interpolated_each_between_its_own_rows():
    values = np.column_stack([TIME_S, 5 - 2 * TIME_S])
    values[1::2, 1] = np.nan
    order = np.random.default_rng(0).permutation(100)
    found = interpolated(values[order], TIME_S[order], AT[:190])
    np.testing.assert_allclose(found, np.column_stack([AT, 5 - 2 * AT])[:190], atol=1e-12)
    # Nothing is known before the first row and after the last.
    assert np.isnan(interpolated(values, TIME_S, np.array([-0.1, 9.95]))).all()


def test_nothing_is_interpolated_over_a_gap_or_the_end_of_a_turn():
    time_s = np.where(np.arange(100) < 50, TIME_S, TIME_S + 30)
    found = interpolated(TIME_S[:, None], time_s, np.array([4.85, 20.0, 34.99, 35.05]))[:, 0]
    np.testing.assert_allclose(found, [4.85, np.nan, np.nan, 5.05])
    angle = (2 * TIME_S + np.pi) % (2 * np.pi) - np.pi
    found = interpolated(angle[:, None], TIME_S, AT[:199])[:, 0]
    ends = np.abs(np.diff(angle)) > 3
    assert np.flatnonzero(np.isnan(found)).tolist() == (2 * np.flatnonzero(ends) + 1).tolist()


def test_a_joint_of_two_positions_has_no_end_of_a_turn():
    values = (np.arange(100) // 3 % 2)[:, None].astype(float)
    assert np.isfinite(interpolated(values, TIME_S, AT[:199])).all()


def test_boards_give_the_readings_nearest_in_time():
    slow = stream(np.arange(50)[:, None], np.arange(50) / 5.0, "slow")
    fast = stream(np.arange(100)[:, None], TIME_S + 0.04, "fast")
    found = together([stream(TIME_S[:, None])], [fast, slow], "a.bag")
    np.testing.assert_allclose(found.time_s, np.arange(50) / 5.0)
    np.testing.assert_allclose(found.q[:, 0], found.time_s)
    np.testing.assert_allclose(found.readings[1:, 0], 2 * np.arange(50)[1:])
    np.testing.assert_allclose(found.readings[:, 1], np.arange(50))
    assert "interpolated at the times of slow" in found.notes[-1]
    # A board that was off gives none.
    part = stream(np.arange(60)[:, None], TIME_S[:60], "fast")
    found = together([stream(TIME_S[:, None])], [part, slow], "a.bag")
    assert np.isnan(found.readings[31:, 0]).all()


def test_clocks_are_used_as_far_as_they_agree():
    joints = stream(TIME_S[:, None], TIME_S + 0.01, "joints", TIME_S)
    for apart, back, source in ((0.0, 0, "stamps"), (2.0, 0, "arrival"), (0.0, 50, "arrival")):
        stamps = np.roll(TIME_S, back) - apart
        skin = stream(TIME_S[:, None], TIME_S + 0.02, "skin", stamps)
        found = together([joints], [skin], "a.bag")
        assert source in found.time_from
        expected = TIME_S if source == "stamps" else TIME_S + 0.02
        np.testing.assert_allclose(found.time_s, expected)
    # A simulation that runs at a third of real time.
    slow = stream(TIME_S[:, None], 3 * TIME_S, "joints", TIME_S)
    found = together([slow], [stream(TIME_S[:, None], 3 * TIME_S, "skin")], "a.bag")
    assert "although the stamps of joints pass 0.333 times as fast" in found.notes[0]
    with pytest.raises(RecordingError, match="times of skin that begin again; write each piece"):
        together([joints], [stream(TIME_S[:, None], np.roll(TIME_S, 50), "skin")], "a.bag")
    with pytest.raises(RecordingError, match="times of skin and of a that do not overlap"):
        together([stream(TIME_S[:, None])], [stream(TIME_S[:, None], TIME_S + 99, "skin")], "a")
