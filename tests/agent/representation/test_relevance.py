"""Two point-like hands, each moved by its own joints, touch one skin."""

import dataclasses

import numpy as np
import pytest
from skins import on_sphere, readings, receptors

from selftouch_drake.agent.planning.planner import Planner
from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.quotient import NO_MODE, mattering
from selftouch_drake.agent.representation.relevance import likely_modes

LEFT, RIGHT = slice(0, 3), slice(3, 6)
NUM_ROWS = 24_000


def two_hands(seed=0):
    """Joints of the left and the right hand, one without effect; and the hand that touches."""
    rng = np.random.default_rng(seed)
    points = on_sphere(rng, NUM_ROWS)
    is_left = rng.random(NUM_ROWS) < 0.5
    # A hand in the air stays there when a single joint moves, since hands touch seldom.
    q = rng.uniform(1.2, 2.0, (NUM_ROWS, 7)) * rng.choice([-1, 1], (NUM_ROWS, 7))
    pressed = points * rng.uniform(0.95, 1.0, (NUM_ROWS, 1))
    q[is_left, LEFT] = pressed[is_left]
    q[~is_left, RIGHT] = pressed[~is_left] @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    sensation = readings(points, receptors("sphere", 40), 0.8)
    return q, sensation, is_left


@pytest.fixture(scope="module")
def learned():
    q, sensation, is_left = two_hands()
    representation = QuotientLearner(60, 500).fit(sensation, q).representation_
    return representation, is_left[representation.kernel_row]


def test_each_hand_has_a_mode_of_its_own_joints(learned):
    representation, is_left = learned
    modes = representation.mode_joints.astype(int).tolist()
    assert modes == [[0, 0, 0, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0, 0]]
    known = representation.kernel_mode != NO_MODE
    assert known.mean() > 0.9
    assert np.mean(representation.kernel_mode[known] == is_left[known]) > 0.99


def test_joints_that_do_not_matter_are_no_part_of_distances(learned):
    representation, _ = learned
    x = representation.kernel_sets.x
    left = representation.kernel_mode == 1
    assert np.ptp(x[left][:, 3:], axis=0).max() < 1e-6
    scaled = representation.scaled(representation.kernel_q).astype(np.float32)
    assert np.array_equal(x[left][:, LEFT], scaled[left][:, LEFT])
    unknown = representation.kernel_mode == NO_MODE
    assert np.array_equal(x[unknown], scaled[unknown])


def test_of_an_unknown_mode_all_joints_count():
    x = np.array([[1.0, 2.0], [3.0, 6.0]])
    found = mattering(x, np.array([NO_MODE, 0]), np.array([[True, False]]))
    assert found.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_a_mode_that_hardly_any_touch_of_a_kernel_has_is_a_mistake_there():
    kernel = np.repeat([0, 1], 100)
    mode = np.where(np.arange(200) < 4, 1, 0)
    mode[100:140], mode[50:60] = 1, NO_MODE
    found = likely_modes(mode, kernel)
    assert (found[:4] == NO_MODE).all()
    assert np.array_equal(found[4:], mode[4:])
    assert np.array_equal(likely_modes(np.full(5, NO_MODE), kernel[:5]), np.full(5, NO_MODE))


def test_where_one_hand_moves_all_its_joints_matter():
    q, sensation, is_left = two_hands()
    q, sensation = q[is_left][:, LEFT], sensation[is_left]
    representation = QuotientLearner(60, 400).fit(sensation, q).representation_
    assert representation.mode_joints.tolist() == [[True] * 3]
    assert not representation.kernel_mode.any()


def test_few_touches_say_nothing_of_joints():
    q, sensation, _ = two_hands()
    representation = QuotientLearner(20, 50).fit(sensation[:600], q[:600]).representation_
    assert representation.mode_joints.tolist() == [[True] * 7]


def a_row(representation, kernel, mode):
    members = representation.members(kernel)
    rows = np.arange(members.start, members.stop)
    return rows[representation.kernel_mode[members] == mode][0]


def test_the_other_hand_stays_where_it_is(learned):
    representation, _ = learned
    planner = Planner(representation)
    q_start = representation.kernel_q[a_row(representation, 0, 1)].astype(float)
    for goal in range(1, 60):
        plan = planner.plan(q_start, [0, goal])
        path = plan.path(np.linspace(0.0, plan.waypoint_s[-1], 50))
        assert np.abs(path[:, 3:] - q_start[3:]).max() < 1e-9
        assert np.linalg.norm(path[-1, LEFT]) == pytest.approx(1.0, abs=0.1)


def test_a_hand_that_does_not_get_there_hands_over_to_the_other(learned):
    representation, _ = learned
    # The left hand never touched the kernels on one side.
    kernel = np.repeat(np.arange(60), np.diff(representation.kernel_offsets))
    right_only = representation.target_sensations.argmax(axis=1)[kernel] % 2 == 0
    left = representation.kernel_mode == 1
    mode = np.where(right_only & left, NO_MODE, representation.kernel_mode)
    goal = int(kernel[right_only][0])
    kernels = np.unique(kernel[~right_only])
    narrow = dataclasses.replace(representation, kernel_mode=mode)
    row = a_row(narrow, int(kernels[0]), 1)
    q_start = representation.kernel_q[row].astype(float)
    plan = Planner(narrow).plan(q_start, [int(kernels[0]), goal])
    assert not plan.in_air.any()
    q = plan.waypoints_q
    landed = np.flatnonzero(np.abs(np.diff(q[:, RIGHT], axis=0)).max(axis=1) > 0)[0]
    np.testing.assert_allclose(q[: landed + 2, LEFT], np.tile(q_start[LEFT], (landed + 2, 1)))
    np.testing.assert_allclose(
        q[landed + 2 :, LEFT], np.tile(q[-1, LEFT], (len(q) - landed - 2, 1))
    )
    assert np.linalg.norm(q[-1, RIGHT]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("num_rows", "num_targets"), [(60, 20), (100, 20), (3000, 12)])
def test_what_was_hardly_learned_drops_no_joint_that_matters(num_rows, num_targets):
    q, sensation, _ = two_hands(seed=1)
    learner = QuotientLearner(num_targets).fit(sensation[:num_rows], q[:num_rows])
    for joints in learner.representation_.mode_joints:
        assert joints[LEFT].all() or joints[RIGHT].all()


def test_steps_that_follow_no_link_have_none(learned):
    representation, _ = learned
    unknown = dataclasses.replace(
        representation, kernel_mode=np.full(representation.num_rows, NO_MODE)
    )
    q_start = representation.kernel_q[0].astype(float)
    plan = Planner(unknown).plan(q_start, [0, 1])
    assert (plan.in_air.tolist(), plan.links.tolist()) == ([True], [-1])
    assert not Planner(unknown).plan(q_start, [0, 0]).in_air.any()
