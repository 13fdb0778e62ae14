import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from selftouch_drake.agent.planning import timing
from selftouch_drake.agent.planning.timing import speed_shares, time_path
from selftouch_drake.quotient.smooth import smooth_path

VELOCITY = np.array([1.0, 1.5, 2.0])
ACCELERATION = np.array([4.0, 5.0, 6.0])


def random_path(seed, num_waypoints, step):
    rng = np.random.default_rng(seed)
    return smooth_path(np.cumsum(step * rng.normal(size=(num_waypoints, 3)), axis=0))


def timed(path, **options):
    limits = {"velocity_limit": VELOCITY, "acceleration_limit": ACCELERATION}
    return time_path(path, **limits | options)


def assert_commands_within_limits(motion):
    shares = speed_shares(motion.time_s, motion.q, motion.v, VELOCITY, ACCELERATION)
    assert max(shares) <= 1.0


def rates(motion, path):
    """Velocity and acceleration of the motion along its path, every millisecond."""
    time_s = np.arange(0.0, motion.s_of_t.x[-1], 1e-3)
    s, speed = motion.s_of_t(time_s), motion.s_of_t(time_s, 1)[:, None]
    slope, bend = path(s, 1), path(s, 2)
    return slope * speed, bend * speed**2 + slope * motion.s_of_t(time_s, 2)[:, None]


def assert_within_limits(motion, path):
    v, a = rates(motion, path)
    assert np.all(np.abs(v) <= VELOCITY * (1.0 + 1e-6))
    assert np.all(np.abs(a) <= ACCELERATION * (1.0 + 1e-6))


paths = st.builds(
    random_path, st.integers(0, 10**6), st.integers(2, 10), st.sampled_from([0.003, 0.05, 0.5])
)


@settings(max_examples=20, deadline=None)
@given(paths)
def test_a_timed_path_goes_from_rest_to_rest_within_its_limits(path):
    motion = timed(path)
    assert_within_limits(motion, path)
    assert_commands_within_limits(motion)
    assert np.all(np.diff(motion.time_s) > 0.0)
    assert np.all(np.diff(motion.s) >= 0.0)
    assert np.allclose(motion.v[[0, -1]], 0.0, atol=1e-6)
    assert np.allclose(motion.q[0], path(path.t[0]), atol=1e-9)
    assert np.allclose(motion.q[-1], path(path.t[-1]), atol=1e-6)
    assert np.allclose(motion.q, path(motion.s), atol=1e-12)


def test_the_fallback_takes_over_when_there_is_no_fastest_progress(monkeypatch):
    path = random_path(1, 6, 0.3)
    fastest = timed(path)
    monkeypatch.setattr(timing, "fastest_progress", lambda *_, **__: None)
    motion = timed(path)
    assert_within_limits(motion, path)
    assert_commands_within_limits(motion)
    assert fastest.time_s[-1] < motion.time_s[-1] < 4 * fastest.time_s[-1]


def test_a_fifth_of_each_limit_is_kept_in_reserve():
    motion = timed(smooth_path(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])))
    shares = speed_shares(motion.time_s, motion.q, motion.v, VELOCITY, ACCELERATION)
    assert shares == pytest.approx((0.8, 0.8), rel=0.02)


def test_accelerations_are_eased():
    path = random_path(1, 10, 0.5)
    _, a = rates(timed(path), path)
    assert np.all(np.abs(a[0]) < 0.02 * ACCELERATION)
    # Without easing the first acceleration comes within one of these steps.
    assert np.abs(np.diff(a, axis=0) / ACCELERATION).max() < 0.1


@pytest.mark.parametrize("name", ["velocity_limit", "acceleration_limit"])
def test_limits_that_no_motion_can_live_with_are_refused(name):
    with pytest.raises(ValueError, match=r"^the motion would take .* s, more than 600 s: raise"):
        timed(random_path(1, 4, 0.5), **{name: np.full(3, 1e-7)})


def test_the_samples_are_evenly_spaced_in_time():
    motion = timed(random_path(3, 6, 0.4), rate_hz=250.0)
    assert np.allclose(np.diff(motion.time_s)[:-1], 1.0 / 250.0)
    assert motion.time_s[-1] == motion.s_of_t.x[-1]


def test_a_path_to_nowhere_rests():
    q = np.array([0.1, 0.2, 0.3])
    motion = timed(smooth_path(q[None]))
    assert 0.0 < motion.time_s[-1] < 0.1
    assert np.allclose(motion.q, q)
    assert np.allclose(motion.v, 0.0)


def test_the_same_path_is_timed_the_same():
    path = random_path(5, 6, 0.4)
    assert np.array_equal(timed(path).q, timed(path).q)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"velocity_limit": np.ones(2)},
            "velocity_limit is [1.0, 1.0]: give 3 positive limits, one per joint",
        ),
        (
            {"acceleration_limit": np.array([1.0, 0.0, 1.0])},
            "acceleration_limit is [1.0, 0.0, 1.0]: give 3 positive limits, one per joint",
        ),
        ({"rate_hz": 0.0}, "rate_hz is 0.0: give a positive number"),
    ],
)
def test_errors_say_what_to_do(options, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        timed(random_path(0, 3, 0.3), **options)


def test_shares_are_of_the_joint_that_takes_most():
    # From rest at 4 rad/s^2 for a second; joint 0 stays.
    time_s = np.linspace(0.0, 1.0, 11)
    q = np.stack([0.5 * np.ones(11), 2.0 * time_s**2], axis=1)
    v = np.stack([np.zeros(11), 4.0 * time_s], axis=1)
    shares = speed_shares(time_s, q, v, np.array([1.0, 2.0]), np.array([5.0, 4.0]))
    assert shares == pytest.approx((2.0, 1.0))


def test_what_happens_between_samples_counts():
    # The samples rest; the cubic between them goes there and back.
    time_s, v = np.array([0.0, 0.3, 1.0]), np.zeros((3, 2))
    q = np.array([[0.0, 2.0], [0.3, 2.0], [0.3, 2.0]])
    velocity, acceleration = speed_shares(time_s, q, v, np.ones(2), np.ones(2))
    assert velocity == pytest.approx(1.5, rel=1e-4)
    assert acceleration == pytest.approx(20.0)
