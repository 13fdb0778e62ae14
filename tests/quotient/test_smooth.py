import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from selftouch_drake.quotient.smooth import path_length, polyline, smooth_path

# Multiples of a microradian, up to a radian.
joints = st.floats(-1.0, 1.0).map(lambda angle: round(angle, 6))
waypoints = st.integers(1, 12).flatmap(lambda n: arrays(float, (n, 3), elements=joints))


@settings(deadline=None)
@given(waypoints)
def test_the_path_starts_and_ends_exactly_at_the_given_configurations(w):
    path = smooth_path(w)
    assert np.array_equal(path.c[[0, -1]], w[[0, -1]])
    assert np.allclose(path(path.t[[0, -1]]), w[[0, -1]], rtol=0.0, atol=1e-14)


@settings(deadline=None)
@given(waypoints)
def test_the_path_keeps_to_the_limits_that_its_waypoints_keep(w):
    lower, upper = w.min(axis=0), w.max(axis=0)
    path = smooth_path(w, limits=(lower, upper))
    q = path(np.linspace(path.t[0], path.t[-1], 2000))
    assert np.all(q >= lower - 1e-9)
    assert np.all(q <= upper + 1e-9)


def test_limits_bind_where_smoothing_would_overshoot():
    w = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 1.0], [3.0, 0.0]])
    s = np.linspace(0.0, path_length(w)[-1], 1000)
    assert smooth_path(w)(s)[:, 1].max() > 1.0
    limits = np.array([0.0, 0.0]), np.array([3.0, 1.0])
    assert smooth_path(w, limits=limits)(s)[:, 1].max() <= 1.0 + 1e-12


def test_a_limit_gives_way_to_a_waypoint_beyond_it():
    w = np.array([[0.0, 0.0], [2.0, 0.0]])
    path = smooth_path(w, limits=(np.zeros(2), np.ones(2)))
    assert np.array_equal(path(path.t[-1]), [2.0, 0.0])


def test_a_straight_line_stays_straight():
    w = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]])
    path = smooth_path(w)
    s = np.linspace(0.0, path.t[-1], 100)
    assert np.allclose(path(s), polyline(w, path_length(w))(s), atol=1e-9)


def test_the_path_follows_the_polyline_and_rounds_its_corners():
    w = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    path, s = smooth_path(w), np.linspace(0.0, 2.0, 400)
    assert np.linalg.norm(path(s) - polyline(w, path_length(w))(s), axis=1).max() < 0.1
    loose = smooth_path(w, knot_spacing=0.5)
    assert np.abs(loose(s, 3)).max() < 0.2 * np.abs(path(s, 3)).max()


def test_the_length_of_the_path_parameter_is_that_of_the_polyline():
    w = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])
    assert path_length(w).tolist() == [0.0, 5.0, 6.0]
    assert smooth_path(w).t[-1] == 6.0


def test_a_tiny_move_is_as_well_behaved_as_any():
    w = np.array([[0.0, 0.0], [1e-9, 0.0], [1e-9, 2e-9]])
    path = smooth_path(w)
    large = smooth_path(w * 1e7)
    assert np.allclose(path.c, large.c * 1e-7, rtol=1e-9, atol=1e-18)


def test_repeated_waypoints_count_once():
    w = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert np.array_equal(smooth_path(np.repeat(w, 2, axis=0)).c, smooth_path(w).c)


def test_nowhere_to_go_is_a_constant_path():
    path = smooth_path(np.array([[0.3, -0.2]] * 3))
    assert np.allclose(path([0.0, 0.5, 1.0]), [0.3, -0.2], rtol=0.0, atol=1e-15)
