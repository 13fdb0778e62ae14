import numpy as np
import pytest
from scipy.sparse import csr_array

from selftouch_drake.agent.motions import NO_KERNEL
from selftouch_drake.agent.planning.planner import Planner
from selftouch_drake.agent.planning.prediction import predict_sensation, recall_sensation
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation

SENSORS = 2 * np.pi * np.arange(12) / 12


def felt_at(q):
    """The sensation on the ring of `make_ring`: a narrow bump at the finger."""
    angle = np.arctan2(q[..., 1], q[..., 0])
    bump = np.exp(8.0 * (np.cos(angle[..., None] - SENSORS) - 1.0))
    return bump / np.linalg.norm(bump, axis=-1, keepdims=True)


def remembered_by(representation):
    return csr_array(felt_at(representation.kernel_q.astype(float)))


@pytest.fixture(scope="module")
def dense(make_ring):
    """A ring with many configurations, spread over the whole circle."""
    ring = make_ring(num_kernels=8, members=80)
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * (np.repeat(np.arange(8), 80) + rng.uniform(-0.5, 0.5, 640)) / 8
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros(640)], axis=1)
    object.__setattr__(ring, "kernel_q", around.astype(np.float32))
    object.__setattr__(
        ring, "target_sensations", felt_at(make_ring(8, 1, kind=EmbeddedRepresentation).embedding)
    )
    return ring


def error(predicted, plan, s):
    return np.mean(1.0 - np.sum(predicted * felt_at(plan.path(s)), axis=1))


def test_remembered_sensations_foretell_more_than_targets(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 3])
    s = np.linspace(0.0, plan.waypoint_s[-1], 200)
    remembered = remembered_by(dense)
    by_targets = error(predict_sensation(dense, plan, s).sensation, plan, s)
    by_memory = error(predict_sensation(dense, plan, s, remembered).sensation, plan, s)
    assert by_memory < 0.3 * by_targets
    assert by_memory < 0.01


def test_a_prediction_begins_with_what_is_felt_now(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 3])
    remembered = remembered_by(dense)
    (first,) = predict_sensation(dense, plan, np.zeros(1), remembered).sensation
    assert np.allclose(first, remembered[[5]].toarray(), atol=1e-6)
    # Away from stored configurations, the target sensation is predicted.
    elsewhere = Planner(dense).plan(dense.kernel_q[5] + 0.01, [0, 3])
    (first,) = predict_sensation(dense, elsewhere, np.zeros(1), remembered).sensation
    assert np.allclose(first, dense.target_sensations[0], atol=1e-6)


def test_predictions_have_unit_length_and_no_negative_reading(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 4])
    s = np.linspace(0.0, plan.waypoint_s[-1], 100)
    predicted = predict_sensation(dense, plan, s, remembered_by(dense)).sensation
    assert predicted.min() >= 0.0
    assert np.allclose(np.linalg.norm(predicted, axis=1), 1.0)


def test_staying_feels_the_same(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 0])
    remembered = remembered_by(dense)
    predicted = predict_sensation(dense, plan, np.zeros(3), remembered).sensation
    assert np.allclose(predicted, remembered[[5]].toarray(), atol=1e-6)


@pytest.mark.parametrize("remembers", [False, True])
def test_nothing_is_predicted_before_the_first_touch(dense, remembers):
    remembered = remembered_by(dense) if remembers else None
    plan = Planner(dense).plan(np.array([1.5, 0.0, 0.4]), [None, 2])
    assert plan.nodes[0] == NO_KERNEL
    s = np.linspace(0.0, plan.waypoint_s[-1], 300)
    predicted = predict_sensation(dense, plan, s, remembered).sensation
    before = s < plan.waypoint_s[1]
    assert not predicted[before].any()
    assert np.allclose(np.linalg.norm(predicted[~before], axis=1), 1.0)


def test_the_agent_is_surer_at_waypoints_than_between(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 3])
    remembered = remembered_by(dense)
    at = predict_sensation(dense, plan, plan.waypoint_s, remembered).spread
    halfway = (plan.waypoint_s[1:] + plan.waypoint_s[:-1]) / 2.0
    between = predict_sensation(dense, plan, halfway, remembered).spread
    assert np.all(at > 0.0)
    assert between.min() > at.max()
    apart = 1.0 - np.sum(felt_at(plan.waypoints_q[1:]) * felt_at(plan.waypoints_q[:-1]), axis=1)
    assert np.allclose(between, apart + 0.1 * apart.mean(), atol=1e-6)


def test_what_was_felt_on_the_way_is_expected_there_again(dense):
    plan = Planner(dense).plan(dense.kernel_q[5], [0, 3])
    places = np.linspace(0.0, plan.waypoint_s[-1], 60)
    felt = 3.0 * felt_at(plan.path(places))
    s = np.linspace(0.0, plan.waypoint_s[-1], 211)
    found = recall_sensation(plan, s, places, felt)
    assert error(found.sensation, plan, s) < 1e-4
    assert np.allclose(np.linalg.norm(found.sensation, axis=1), 1.0)
    assert np.all(found.spread > 0.0)


def test_what_was_felt_in_the_air_is_not_expected(dense):
    plan = Planner(dense).plan(np.array([1.5, 0.0, 0.4]), [None, 2])
    places = np.linspace(0.0, plan.waypoint_s[-1], 60)
    found = recall_sensation(plan, places, places, felt_at(plan.path(places))).sensation
    assert not found[places < plan.waypoint_s[1]].any()
