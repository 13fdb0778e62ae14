from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.spatial import cKDTree

from selftouch_drake.agent.lifelong.expectation import cosine_distance
from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.evaluation.executed import (
    in_link_frames,
    off_skin,
)
from selftouch_drake.evaluation.motion import (
    contact_along,
    score_motion,
    share_within_scale,
    summarise,
)
from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.geometry.surfaces import sphere
from selftouch_drake.quotient.smooth import polyline, smooth_path

KNOWN = SimpleNamespace(target_sensations=np.eye(3), num_set_aside=0, part=np.zeros(3, int))


def motion(predicted, *, goal=2, in_air=(False, False, False)):
    """Four instants of a plan of three steps, from kernel 0 to `goal`."""
    s = np.array([0.0, 1.0, 2.0, 3.0])
    return Motion(
        plan=Plan(
            nodes=np.array([0, 1, 0, goal]),
            links=np.full(3, -1),
            in_air=np.array(in_air),
            modes=np.full(len(np.array([0, 1, 0, goal])) - 1, -1),
            imagined=np.zeros(len(np.array([0, 1, 0, goal])), bool),
            waypoints_q=np.zeros((4, 1)),
            waypoint_s=s,
            path=smooth_path(np.zeros((4, 1))),
        ),
        time_s=0.1 * s,
        s=s,
        q=np.zeros((4, 1)),
        v=np.zeros((4, 1)),
        predicted=np.asarray(predicted, dtype=float),
        predicted_spread=np.ones(4),
    )


FELT = np.array([[2.0, 0, 0], [0, 0, 0], [0, 3.0, 0], [0, 0, 1.0]])


def test_a_motion_is_scored_by_what_was_felt():
    predicted = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 0, 1.0], [0, 0, 5.0]])
    score = score_motion(motion(predicted), FELT, KNOWN)
    assert (score.contact, score.reached) == (0.75, True)
    assert score.prediction_error == pytest.approx(1 / 3)
    assert not score_motion(motion(predicted, goal=1), FELT, KNOWN).reached


def test_a_motion_that_ends_off_the_skin_reached_nothing():
    felt = np.array([[1.0, 0, 0]] * 3 + [[0, 0, 0]])
    assert not score_motion(motion(np.ones((4, 3)), goal=0), felt, KNOWN).reached


def test_a_motion_that_never_touches_predicted_nothing():
    score = score_motion(motion(np.ones((4, 3)), goal=0), np.zeros((4, 3)), KNOWN)
    assert (score.contact, score.reached, score.prediction_error) == (0.0, False, 1.0)


def test_what_happens_in_the_air_does_not_count():
    predicted = np.array([[1.0, 0, 0], [0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    # The second step lifts off and lands: the instant at its start is in the air.
    flown = motion(predicted, in_air=(False, True, False))
    score = score_motion(flown, FELT, KNOWN)
    assert (score.contact, score.reached, score.prediction_error) == (1.0, True, 0.0)
    # What is felt there, where nothing was expected, is no error of the prediction.
    brushed = FELT.copy()
    brushed[1] = [0, 0, 9.0]
    assert score_motion(flown, brushed, KNOWN) == score
    # Where it lands it is held to its word.
    missed = FELT.copy()
    missed[2] = 0.0
    assert score_motion(flown, missed, KNOWN).contact == pytest.approx(2 / 3)
    # At the end touch is expected, even of the last step.
    landed = motion(predicted, in_air=(True, True, True))
    assert score_motion(landed, np.zeros((4, 3)), KNOWN).contact == 0.0
    assert score_motion(landed, FELT, KNOWN).contact == 1.0


def test_a_path_through_the_air_loses_no_contact():
    """Felt below 1.5, and where the flight ends."""
    waypoints_q, s = np.array([[0.0], [1.0], [2.0], [3.0]]), np.arange(4.0)

    def felt(q):
        return ((q < 1.5) | (q == 3.0)).astype(float)

    world = SimpleNamespace(probe=SimpleNamespace(sensations=felt))
    path = polyline(waypoints_q, s)
    for in_air, share in (([False] * 3, 0.5), ([False, True, True], 1.0)):
        plan = Plan(
            nodes=np.arange(4),
            links=np.full(3, -1),
            in_air=np.array(in_air),
            modes=np.full(len(np.arange(4)) - 1, -1),
            imagined=np.zeros(len(np.arange(4)), bool),
            waypoints_q=waypoints_q,
            waypoint_s=s,
            path=path,
        )
        assert contact_along(world, plan) == pytest.approx(share, abs=0.01)


def test_the_summary_reports_the_mean_and_the_worst():
    felt = np.array([[1.0, 0, 0], [0, 1.0, 0]] * 2)
    lost = felt * [[1.0], [0.0], [1.0], [0.0]]
    scores = [score_motion(motion(felt, goal=1), f, KNOWN) for f in (felt, lost)]
    assert summarise(scores, "execution") == {
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
    return cKDTree(hollow_skin(sphere(0.25), 0.03).samples(0.003))


RADIUS = np.array([0.01])


@pytest.mark.parametrize(
    ("distance", "off"),
    [(0.30, True), (0.26, False), (0.235, False), (0.215, False), (0.18, True), (0.0, True)],
)
def test_off_the_skin_is_in_the_cavity_or_far_outside(wall, distance, off):
    direction = np.array([0.48, 0.6, 0.64])
    p_LT = np.tile(distance * direction, (11, 1, 1, 1))
    np.testing.assert_array_equal(off_skin(p_LT, RADIUS, [wall]), np.full(11, off))


def test_a_ball_is_off_by_its_own_radius(wall):
    # 15 mm off the wall: a large ball grazes, a small one has left.
    p_LT = np.full((1, 1, 1, 3), 0.265) * [0.0, 0.0, 1.0]
    assert off_skin(p_LT, np.array([0.005]), [wall]).all()
    assert not off_skin(p_LT, np.array([0.01]), [wall]).any()


def test_one_of_two_fingers_on_one_of_two_skins_is_enough(wall):
    there, away = [0.0, 0.0, 0.25], [0.0, 0.0, 0.35]
    # Instants, skins, balls.
    p_LT = np.array(
        [
            [[away, there], [away, away]],
            [[away, away], [there, away]],
            [[away, away], [away, away]],
        ]
    )
    off = off_skin(p_LT, np.array([0.01, 0.01]), [wall, wall])
    np.testing.assert_array_equal(off, [False, False, True])


def test_places_in_the_frames_of_links_that_move():
    rng = np.random.default_rng(0)
    X_WL = [
        [RigidTransform(RollPitchYaw(rng.uniform(-3, 3, 3)), rng.normal(size=3)) for _ in range(2)]
        for _ in range(5)
    ]
    p_WT = rng.normal(size=(5, 3, 3))
    found = in_link_frames(p_WT, np.array([[X.GetAsMatrix34() for X in row] for row in X_WL]))
    assert found.shape == (5, 2, 3, 3)
    for t, row in enumerate(X_WL):
        for link, X in enumerate(row):
            np.testing.assert_allclose(found[t, link], X.inverse().multiply(p_WT[t].T).T)


def test_a_calibrated_band_holds_what_it_promises():
    rng = np.random.default_rng(0)
    errors = [0.01 * rng.chisquare(2, 500) for _ in range(10)]
    held = share_within_scale(errors)
    assert held[0.5] == pytest.approx(0.5, abs=0.04)
    assert held[0.9] == pytest.approx(0.9, abs=0.04)
    # Twice the error on what is new: the agent was too sure.
    worse = errors[:5] + [2.0 * error for error in errors[5:]]
    assert share_within_scale(worse)[0.9] < 0.8


def test_one_motion_calibrates_nothing():
    assert share_within_scale([np.ones(3)]) == {}
    assert share_within_scale([np.ones(0), np.ones(0)]) == {}
