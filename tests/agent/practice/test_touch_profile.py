"""The sensations of the finger of `test_sliding` beside its way along a ball."""

import numpy as np
import pytest
from test_practice import SLIDER, a_pair, a_plan
from test_sliding import deep

from selftouch_drake.agent.motions import Motion
from selftouch_drake.agent.practice.touch_profile import felt_across

OFFSETS = np.linspace(-0.06, 0.06, 13)


@pytest.fixture(scope="module")
def motion():
    plan = a_plan(a_pair())
    s = np.linspace(0.0, plan.waypoint_s[-1], 60)
    return Motion(
        plan=plan,
        time_s=s,
        s=s,
        q=plan.path(s),
        v=plan.path.derivative()(s),
        predicted=np.zeros((60, 2)),
        predicted_spread=np.zeros(60),
    )


def test_the_way_across_is_the_one_that_leads_through_the_skin(motion):
    found = felt_across(motion, OFFSETS, SLIDER)
    x = np.array([motion.q[np.flatnonzero(motion.time_s == t)[0]] for t in found.time_s])
    np.testing.assert_allclose(np.linalg.norm(found.across, axis=1), 1.0)
    # The fourth joint moves nothing.
    assert np.abs(found.across[:, 3]).max() < 1e-6
    # Along it the depth changes nearly as fast as along its own slope.
    h = 1e-4
    slope = np.stack([deep(x + h * d) - deep(x - h * d) for d in np.eye(4)], axis=1) / (2 * h)
    along = np.abs(np.sum(slope * found.across, axis=1)) / np.linalg.norm(slope, axis=1)
    assert np.median(along) > 0.9
    assert (np.sum(found.across[1:] * found.across[:-1], axis=1) > 0).all()


def test_what_is_felt_there_is_what_the_slider_feels(motion):
    found = felt_across(motion, OFFSETS, SLIDER)
    row = np.flatnonzero(motion.time_s == found.time_s[2])[0]
    there = motion.q[row] + OFFSETS[:, None] * found.across[2]
    felt = SLIDER.feel(there).sensation
    np.testing.assert_allclose(found.strength[2], np.linalg.norm(felt, axis=1))


def test_nothing_is_felt_for_in_the_air(motion):
    in_air = Motion.from_arrays(motion.to_arrays() | {"in_air": np.ones(1, dtype=bool)})
    found = felt_across(in_air, OFFSETS, SLIDER)
    assert not found.strength[:-1].any()
