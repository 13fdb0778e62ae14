import numpy as np
import pytest
from bodies_by_hand import shape_error, sphere
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.shape import metrics
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS, locally_scaled
from selftouch_drake.agent.shape.recovery import DistrustWarning, recover
from selftouch_drake.experiment import schema
from selftouch_drake.quotient.dimension import intrinsic_dimension
from selftouch_drake.quotient.graph import combined_distance, neighbour_edges
from selftouch_drake.quotient.holes import topology

pytestmark = pytest.mark.usefixtures("module_without_networks")


@pytest.fixture(scope="module")
def touched(module_without_networks):
    """A learned unit sphere; the first three joints are the place touched."""
    rng = np.random.default_rng(0)
    place, receptors = sphere(12_000), sphere(40)
    sensation = np.clip(place @ receptors.T, 0, None) ** 4 * rng.uniform(0.2, 1, (12_000, 1))
    q = np.hstack([place, rng.uniform(-0.3, 0.3, (12_000, 2))])
    return QuotientLearner(250).fit(sensation, q).representation_, place


def true_positions(representation, place):
    rows = [representation.kernel_row[representation.members(k)] for k in range(250)]
    return np.array([place[r].mean(axis=0) for r in rows])


@pytest.fixture(scope="module")
def reported():
    """The fractions that were reported while each metric recovered a body."""
    return {metric: [] for metric in SHAPE_METRICS}


@pytest.fixture(scope="module")
def bodies(touched, reported):
    return {
        metric: recover(touched[0], metric, holes=False, progress=reported[metric].append).parts[0]
        for metric in SHAPE_METRICS
    }


@pytest.mark.parametrize(
    ("metric", "most"),
    [
        ("literal", 0.15),
        ("motor", 0.06),
        ("learned", 0.06),
        ("sensorimotor", 0.03),
    ],
)
def test_every_metric_recovers_a_touched_sphere(touched, bodies, metric, most):
    distances = bodies[metric].distances
    assert distances.shape == (250, 250)
    np.testing.assert_allclose(distances, distances.T, rtol=1e-6)
    assert (np.diag(distances) == 0).all()
    assert shape_error(bodies[metric].embedding.positions, true_positions(*touched)) < most


@pytest.mark.parametrize("metric", ["motor", "learned", "sensorimotor"])
def test_every_pruned_metric_finds_topology_and_dimension(bodies, metric):
    found = topology(bodies[metric].embedding.positions)
    assert found.betti == (1, 0, 1)
    assert found.margin > 3
    assert 1.75 < intrinsic_dimension(bodies[metric].distances) < 2.4


def test_metrics_are_those_of_the_experiment():
    assert set(SHAPE_METRICS) == set(schema.SHAPE_METRICS)


def test_the_same_seed_learns_the_same_on_any_number_of_threads(touched, bodies):
    with threadpool_limits(2, user_api="blas"):
        again = recover(touched[0], "learned", seed=0, holes=False)
    np.testing.assert_array_equal(again.distances, bodies["learned"].distances)
    np.testing.assert_array_equal(again.positions, bodies["learned"].positions)


@pytest.fixture
def maps(monkeypatch):
    """Quotient maps that replace the learned ones, in order; used ones are removed."""
    given = []

    def take(sets, **_):
        return sets.at(given.pop(0))

    monkeypatch.setattr(metrics, "quotient_coordinates", take)
    return given


def test_another_network_is_tried_where_the_first_folds(touched, maps):
    representation, place = touched
    true = place[representation.kernel_row]
    folded, spare = true * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0] * np.abs(true), true.copy()
    maps += [folded, true, spare]
    part = recover(representation, "learned", holes=False).parts[0]
    assert part.doubt is None
    assert len(maps) == 1
    assert shape_error(part.positions, true_positions(*touched)) < 0.03


def test_another_network_is_tried_where_the_first_stretches_the_body(touched, maps):
    """Neighbours are right, but cells are three times as long from pole to pole as across."""
    representation, place = touched
    true = place[representation.kernel_row]
    south = np.cross(np.cross(true, [0.0, 0.0, 1.0]), true)
    along = np.random.default_rng(0).normal(scale=0.2, size=(len(true), 1))
    spare = true.copy()
    maps += [true + along * south, true, spare]
    part = recover(representation, "learned", holes=False).parts[0]
    assert part.doubt is None
    assert len(maps) == 1
    assert shape_error(part.positions, true_positions(*touched)) < 0.03


def test_without_a_map_that_knows_neighbours_the_metric_is_sensorimotor(touched, maps):
    representation, _ = touched
    rng = np.random.default_rng(0)
    place = touched[1][representation.kernel_row]
    folded = np.hstack([place[:, :2], np.abs(place[:, 2:])])
    for given, num_spare in ([folded, folded], 0), (list(rng.normal(size=(2, *place.shape))), 1):
        # A network that learned nothing is no reason to train another.
        maps[:] = given
        with pytest.warns(
            DistrustWarning, match="feel nothing in common; the sensorimotor metric is"
        ):
            part = recover(representation, "learned", holes=False).parts[0]
        assert part.doubt is not None
        assert len(maps) == num_spare
    instead = recover(representation, "sensorimotor", holes=False).parts[0]
    np.testing.assert_array_equal(part.positions, instead.positions)


def test_no_network_is_trained_where_near_touches_feel_unlike(maps):
    """Fifteen joints that all matter: the nearest of 3000 touches is far away."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (3000, 15))
    place = q.reshape(-1, 5, 3).sum(axis=1)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    sensation = np.clip(place @ sphere(100).T - 0.9, 0, None)
    felt = sensation.any(axis=1)
    representation = QuotientLearner(100).fit(sensation[felt], q[felt]).representation_
    with pytest.warns(DistrustWarning, match="of the touches feel nothing in common with the near"):
        recover(representation, "learned", holes=False)


def test_a_distorted_map_does_not_count(touched, maps):
    representation, place = touched
    distorted = place[representation.kernel_row]
    distorted = distorted * np.exp(1.5 * distorted[:, 2:])
    maps += [distorted, distorted]
    with pytest.warns(DistrustWarning, match=r"differ by .*%; the sensorimotor metric is used"):
        part = recover(representation, "learned", holes=False).parts[0]
    assert not maps
    assert shape_error(part.positions, true_positions(*touched)) < 0.03


def test_sensations_keep_edges_on_the_surface(touched):
    """An arm that by chance comes near the antipode feels something else there."""
    representation, place = touched
    true = true_positions(representation, place)
    far = np.argmax(np.linalg.norm(true - true[0], axis=1))
    distance = representation.set_distance.copy()
    distance[0, far] = distance[far, 0] = np.sort(distance[0])[8]
    pair = sorted([0, int(far)])
    assert pair in neighbour_edges(distance).tolist()
    combined = combined_distance(distance, representation.target_sensations)
    assert pair not in neighbour_edges(combined).tolist()


@pytest.mark.usefixtures("bodies")
@pytest.mark.parametrize("metric", ["motor", "learned", "sensorimotor"])
def test_progress_rises_to_one(reported, metric):
    assert reported[metric] == sorted(reported[metric])
    assert reported[metric][-1] == 1.0


def test_an_embedded_representation_is_otherwise_the_same(touched, bodies):
    representation, _ = touched
    found = recover(representation, "motor", holes=False).embed(representation)
    np.testing.assert_array_equal(found.embedding, bodies["motor"].embedding.positions)
    assert found.edges is representation.edges


def test_errors(touched):
    with pytest.raises(ValueError, match="metric") as error:
        recover(touched[0], "visual")
    assert str(error.value) == (
        "metric 'visual' is unknown: choose one of literal, motor, learned, sensorimotor"
    )
    single = QuotientLearner(6).fit(np.eye(6), np.arange(6.0)[:, None]).representation_
    with pytest.raises(ValueError, match="one configuration") as error:
        recover(single, "learned")
    assert str(error.value) == (
        "kernel_q holds one configuration per kernel: the learned metric needs several; "
        "babble longer, or ask for fewer targets"
    )


def test_lengths_are_shortened_where_map_and_sets_show_a_rim():
    rng = np.random.default_rng(0)
    points = sphere(600)
    edges = neighbour_edges(np.linalg.norm(points[:, None] - points, axis=2))
    felt = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    across = (points[edges, 2] > 0).sum(axis=1) == 1
    rims, stretched = np.where(across, 0.6, 1.0), np.exp(0.3 * points[edges, 2].mean(axis=1))

    def shortened(by_map, by_sets):
        by_map, by_sets = (
            felt * by * np.exp(rng.normal(0, noise, len(felt)))
            for by, noise in ((by_map, 0.1), (by_sets, 0.2))
        )
        set_distance = np.zeros((600, 600))
        set_distance[edges[:, 0], edges[:, 1]] = by_sets
        graph = metrics.BodyGraph(edges=edges, length=by_map, kernel=np.arange(600))
        return metrics._with_rims(felt, graph, set_distance) / felt

    assert (shortened(1.0, 1.0) < 1).mean() < 0.02
    assert (shortened(stretched, stretched) < 1).mean() < 0.02  # all around is stretched alike
    assert (shortened(rims, 1.0) < 1).mean() < 0.02  # a bad network alone shows no rim
    shorter = shortened(rims, rims)
    assert shorter[~across].mean() > 0.99
    assert 0.6 < shorter[across].mean() < 0.9


def test_local_scale_evens_out_crowded_and_sparse_places():
    edges = np.array([[0, 1], [1, 2], [3, 4], [4, 5]])
    place = np.array([0.0, 1.0, 2.0, 10.0, 15.0, 20.0])
    length = place[edges[:, 1]] - place[edges[:, 0]]
    np.testing.assert_allclose(locally_scaled(length, edges), 1.0)
