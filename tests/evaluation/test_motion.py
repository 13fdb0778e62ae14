import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from selftouch_drake.agent.motions import Motion
from selftouch_drake.evaluation import (
    calibration,
    cosine_distance,
    in_link_frames,
    off_skin,
    progress_along,
    score_motion,
    spatial_jerk_reduction,
    summarise,
)
from selftouch_drake.geometry import hollow_skin, sphere, wall_points

TARGETS = np.eye(3)


def motion(predicted, goal, in_air=None):
    """A motion of one step per instant, to kernel `goal`."""
    num_times = len(predicted)
    nodes = np.full(num_times, goal)
    s = np.arange(float(num_times))
    q = np.zeros((num_times, 2))
    return Motion(
        nodes=nodes,
        links=np.full(num_times - 1, -1),
        in_air=np.zeros(num_times - 1, dtype=bool) if in_air is None else np.array(in_air),
        waypoints_q=q,
        waypoint_s=s,
        time_s=s,
        s=s,
        q=q,
        v=q,
        predicted=np.asarray(predicted, dtype=float),
        predicted_spread=np.ones(num_times),
    )


def test_a_motion_is_scored_by_what_was_felt():
    felt = np.array([[2.0, 0, 0], [0, 0, 0], [0, 3.0, 0], [0, 0, 1.0]])
    predicted = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 0, 1.0], [0, 0, 5.0]])
    score = score_motion(motion(predicted, 2), felt, TARGETS)
    assert (score.contact, score.reached) == (0.75, True)
    assert score.prediction_error == pytest.approx(1 / 3)
    assert not score_motion(motion(predicted, 1), felt, TARGETS).reached


def test_what_happens_in_the_air_does_not_count():
    felt = np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 1.0]])
    predicted = np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 1.0]])
    flown = score_motion(motion(predicted, 2, [False, True, True]), felt, TARGETS)
    assert flown.contact == 1.0
    assert score_motion(motion(predicted, 2), felt, TARGETS).contact == 0.5


def test_a_motion_that_ends_off_the_skin_reached_nothing():
    felt = np.array([[1.0, 0, 0], [0, 0, 0]])
    assert not score_motion(motion(felt + 1.0, 0), felt, TARGETS).reached


def test_a_motion_that_never_touches_predicted_nothing():
    score = score_motion(motion(np.ones((3, 3)), 0), np.zeros((3, 3)), TARGETS)
    assert (score.contact, score.reached, score.prediction_error) == (0.0, False, 1.0)


def test_the_summary_has_the_mean_and_the_worst():
    felt = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    lost = felt * [[1.0], [0.0]]
    scores = [score_motion(motion(felt, 1), f, TARGETS) for f in (felt, lost)]
    assert summarise(scores, "execution") == {
        "execution_num_pairs": 2,
        "execution_reach_rate": 0.5,
        "execution_contact_mean": 0.75,
        "execution_contact_worst": 0.5,
        "execution_prediction_error_mean": 0.0,
    }


def test_cosine_distance_has_no_scale():
    a = np.array([[1.0, 0.0], [3.0, 3.0], [1.0, 0.0]])
    b = np.array([[9.0, 0.0], [1.0, 1.0], [0.0, 2.0]])
    assert cosine_distance(a, b) == pytest.approx([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def wall():
    return cKDTree(wall_points(hollow_skin(sphere(0.25), 0.03, 0.01), 0.005))


@pytest.mark.parametrize(
    ("radius", "off"),
    [(0.30, True), (0.26, False), (0.235, False), (0.215, False), (0.18, True), (0.0, True)],
)
def test_off_the_skin_is_in_the_cavity_or_far_outside(wall, radius, off):
    p_LT = radius * np.array([[[[0.48, 0.6, 0.64]]]])
    assert off_skin(p_LT, np.array([0.01]), [wall]).tolist() == [off]


def test_one_of_two_balls_on_one_of_two_skins_is_enough(wall):
    there, away = [0.0, 0.0, 0.25], [0.0, 0.0, 0.35]
    radius = np.array([0.01, 0.01])
    p_LT = np.array([[[away, away], [away, there]], [[away, away], [away, away]]])
    assert off_skin(p_LT, radius, [wall, wall]).tolist() == [False, True]


def test_points_are_seen_from_moving_links():
    rng = np.random.default_rng(0)
    X_WL = [RigidTransform(RollPitchYaw(*rng.normal(size=3)), rng.normal(size=3)) for _ in range(6)]
    p_WT = rng.normal(size=(3, 4, 3))
    poses = np.array([X.GetAsMatrix34() for X in X_WL]).reshape(3, 2, 3, 4)
    found = in_link_frames(p_WT, poses)
    for t in range(3):
        for link in range(2):
            expected = X_WL[2 * t + link].inverse().multiply(p_WT[t].T).T
            np.testing.assert_allclose(found[t, link], expected, atol=1e-12)


def test_spatial_jerk_compares_paths_and_not_their_speed():
    waypoints_q = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])

    def to_space(q):
        return np.concatenate([q, np.zeros((len(q), 1))], axis=1)

    round_corners = CubicSpline(np.arange(4.0), waypoints_q)
    slow, fast = np.linspace(0.0, 3.0, 400), 3.0 * np.linspace(0.0, 1.0, 500) ** 2
    reductions = [
        spatial_jerk_reduction(s, to_space(round_corners(s)), waypoints_q, np.arange(4.0), to_space)
        for s in (slow, fast)
    ]
    assert reductions[0] > 10.0
    assert reductions == pytest.approx([reductions[0]] * 2, rel=0.02)
    dense = np.linspace(0.0, 3.0, 3001)
    corners = np.stack([np.interp(dense, np.arange(4.0), w) for w in waypoints_q.T], axis=1)
    same = spatial_jerk_reduction(dense, to_space(corners), waypoints_q, np.arange(4.0), to_space)
    assert same == pytest.approx(1.0, rel=0.05)


def test_an_arm_that_lags_behind_has_come_less_far():
    time_s = np.linspace(0.0, 1.0, 201)

    def at_time(t):
        return 10 * t**3 - 15 * t**4 + 6 * t**5

    def path(s):
        return np.stack([np.cos(s), np.sin(s)], axis=1)

    late = (time_s - 0.02).clip(0.0)
    off = 1.002 * path(at_time(late))
    found = progress_along(at_time(time_s), path(at_time(time_s)), off)
    assert found == pytest.approx(at_time(late), abs=1e-4)
    # One that goes back has come as far as it was.
    assert np.all(np.diff(progress_along(time_s, path(time_s), path(time_s[::-1]))) >= 0.0)


def test_an_arm_that_stays_has_nowhere_to_come():
    s, q = np.zeros(2), np.ones((2, 3))
    assert np.array_equal(progress_along(s, q, q + 0.001), s)


def test_a_calibrated_band_holds_what_it_promises():
    rng = np.random.default_rng(0)
    spreads = [rng.uniform(0.5, 2.0, 500) for _ in range(10)]
    errors = [0.01 * spread * rng.chisquare(2, 500) for spread in spreads]
    held = calibration(errors, spreads)
    assert held[0.5] == pytest.approx(0.5, abs=0.04)
    assert held[0.9] == pytest.approx(0.9, abs=0.04)
    # Twice the error on what is new: the agent was too sure.
    worse = errors[:5] + [2.0 * error for error in errors[5:]]
    assert calibration(worse, spreads)[0.9] < 0.8


def test_one_motion_calibrates_nothing():
    assert calibration([np.ones(3)], [np.ones(3)]) == {}
    assert calibration([np.ones(0), np.ones(0)], [np.ones(0), np.ones(0)]) == {}
