import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from selftouch_drake.quotient.paths import component_labels, geodesics


def test_components_are_named_by_size():
    assert component_labels(np.array([[1, 2], [2, 4]]), 5).tolist() == [1, 0, 0, 2, 0]


def test_geodesics_are_those_of_dijkstra_to_the_last_bit():
    rng = np.random.default_rng(3)
    # More kernels than are searched from at once, and some that nothing joins.
    edges = np.unique(np.sort(rng.integers(280, size=(900, 2)), axis=1), axis=0)
    edges = edges[edges[:, 0] < edges[:, 1]]
    length = rng.uniform(0.1, 2.0, len(edges))
    graph = csr_array((length, tuple(edges.T)), shape=(300, 300))
    found = geodesics(edges, length, 300)
    assert np.isinf(found).any()
    np.testing.assert_array_equal(found, dijkstra(graph, directed=False))


def test_geodesics_by_hand():
    edges = np.array([[0, 1], [1, 2], [0, 2]])
    found = geodesics(edges, np.array([1.0, 2.0, 9.0]), 4)
    assert found.tolist() == [
        [0.0, 1.0, 3.0, np.inf],
        [1.0, 0.0, 2.0, np.inf],
        [3.0, 2.0, 0.0, np.inf],
        [np.inf, np.inf, np.inf, 0.0],
    ]


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 12), st.integers(0, 99))
def test_the_quotient_distance_is_a_pseudo_metric(num_kernels, seed):
    minimum = np.random.default_rng(seed).uniform(0.1, 1.0, (num_kernels, num_kernels))
    minimum = np.minimum(minimum, minimum.T)
    np.fill_diagonal(minimum, 0.0)
    edges = np.argwhere(np.triu(np.ones((num_kernels, num_kernels)), 1))
    found = geodesics(edges, minimum[edges[:, 0], edges[:, 1]], num_kernels)
    np.testing.assert_allclose(found, found.T)
    assert (np.diag(found) == 0).all()
    assert (found <= minimum + 1e-12).all()
    through = found[:, :, None] + found[None, :, :]
    assert (found <= through.min(axis=1) + 1e-9).all()
