import dataclasses
import warnings
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.agent.representation.graphs import (
    DisconnectedWarning,
    component_labels,
    connected_edges,
    geodesics,
    locally_scaled,
    neighbour_edges,
    step_links,
    surface_neighbours,
    to_networkx,
    without_vectors,
)


def line(*positions: float) -> np.ndarray:
    return squareform(pdist(np.array(positions)[:, None]))


@pytest.mark.parametrize(
    ("num_mutual", "num_kept", "edges"),
    [
        (1, 0, [[0, 1]]),  # the nearest of 2 is 1, but the nearest of 1 is 0
        (0, 1, [[0, 1], [1, 2], [2, 3]]),
        (2, 1, [[0, 1], [0, 2], [1, 2], [2, 3]]),
        (9, 0, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]),
        (0, 0, []),
    ],
)
def test_neighbour_edges_by_hand(num_mutual, num_kept, edges):
    assert neighbour_edges(line(0.0, 1.0, 2.5, 9.0), num_mutual, num_kept).tolist() == edges


def test_kernels_that_feel_different_are_far_apart():
    # Kernel 3 is nearest to kernel 0 in motor space, but feels unlike it; 4 is of another part.
    set_distance = line(0.0, 0.6, 2.0, 0.5, 0.7)
    angle = np.array([0.0, 0.5, 1.0, 1.5, 0.1])
    targets = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    part = np.array([0, 0, 0, 0, 1])
    edges, near = surface_neighbours(set_distance, targets, part)
    assert edges.max() == 3
    assert near[0, 1] < near[0, 3]
    assert np.isinf(near[4, :4]).all()
    assert np.isinf(near[:4, 4]).all()


def test_neighbours_at_no_distance_are_not_oneself():
    assert neighbour_edges(np.zeros((3, 3)), 1, 0).tolist() == [[0, 1]]


def test_components_are_named_by_size():
    assert component_labels(np.array([[1, 2], [2, 4]]), 5).tolist() == [1, 0, 0, 2, 0]


def test_connected_graph_is_left_alone():
    edges = np.array([[0, 1], [1, 2]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert connected_edges(edges, line(0.0, 1.0, 2.0)) is edges


def test_parts_are_joined_by_the_shortest_bridges():
    edges = np.array([[0, 1], [2, 3]])
    with pytest.warns(DisconnectedWarning) as caught:
        joined = connected_edges(edges, line(0.0, 1.0, 3.0, 4.0, 9.0))
    assert joined.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert str(caught[0].message) == (
        "the quotient graph fell into 3 components, of 2, 2, 1 kernels, joined by bridges "
        "1-2, 3-4: babble longer, or give fewer targets"
    )


def test_bridges_of_no_length_join_too():
    with pytest.warns(DisconnectedWarning):
        joined = connected_edges(np.empty((0, 2), dtype=int), np.zeros((4, 4)))
    assert component_labels(joined, 4).tolist() == [0, 0, 0, 0]


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


def test_local_scale_evens_out_crowded_and_sparse_places():
    edges = np.array([[0, 1], [1, 2], [3, 4], [4, 5]])
    length = line(0.0, 1.0, 2.0, 10.0, 15.0, 20.0)[edges[:, 0], edges[:, 1]]
    scaled = locally_scaled(length, edges)
    np.testing.assert_allclose(scaled, 1.0)


def test_a_step_leads_to_the_ring_of_neighbours_but_not_past_the_next():
    """Kernels spread evenly over a ball, linked by what they feel alone."""
    i = np.arange(400) + 0.5
    turn, z = i * np.pi * (1 + np.sqrt(5)), 1 - 2 * i / 400
    place = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1)
    felt = np.clip(place @ place.T, 0.0, None) ** 3
    links = step_links(
        SimpleNamespace(
            target_sensations=felt / np.linalg.norm(felt, axis=1, keepdims=True),
            part=np.zeros(400, dtype=int),
            edges=np.empty((0, 2), dtype=int),
        )
    )
    apart = squareform(pdist(place))
    spacing = np.median(np.sort(apart, axis=1)[:, 6])
    linked = np.zeros((400, 400), dtype=bool)
    linked[tuple(links.T)] = True
    assert linked[np.triu(apart < spacing, 1)].all()
    assert not linked[apart > 2.0 * spacing].any()


def test_networkx_carries_what_the_representation_holds(representation):
    graph = to_networkx(representation)
    assert isinstance(graph, nx.Graph)
    assert list(graph) == list(range(representation.num_targets))
    assert np.array(sorted(tuple(sorted(e)) for e in graph.edges)).tolist() == (
        representation.edges.tolist()
    )
    assert nx.is_connected(graph)
    i, j = representation.edges[0]
    assert graph.edges[i, j] == {
        "cost": pytest.approx(representation.edge_cost[0]),
        "set_distance": pytest.approx(representation.set_distance[i, j]),
    }
    members = representation.members(5)
    assert graph.nodes[5]["size"] == members.stop - members.start
    assert graph.nodes[5]["target_sensation"] is not None
    assert graph.nodes[5]["position"].shape == (3,)


def test_the_complete_graph_joins_all_and_prices_neighbours(representation):
    graph = to_networkx(representation, complete=True)
    assert graph.number_of_edges() == 120 * 119 / 2
    assert graph.edges[3, 77]["set_distance"] == pytest.approx(representation.set_distance[3, 77])
    priced = sorted(tuple(sorted((i, j))) for i, j, edge in graph.edges.data() if "cost" in edge)
    assert priced == [tuple(edge) for edge in representation.edges.tolist()]


def test_graphml_can_hold_what_the_graph_holds(representation):
    graph = to_networkx(dataclasses.replace(representation, embedding=np.eye(120, 3)))
    text = "".join(nx.generate_graphml(without_vectors(graph)))
    found = nx.parse_graphml(text, node_type=int)
    assert list(found) == list(graph)
    assert {frozenset(edge) for edge in found.edges} == {frozenset(edge) for edge in graph.edges}
    i, j = representation.edges[7]
    assert found.edges[i, j] == graph.edges[i, j]
    node = found.nodes[1]
    assert node["size"] == graph.nodes[1]["size"]
    assert [node[f"position_{axis}"] for axis in range(3)] == [0.0, 1.0, 0.0]
    felt = [node[f"target_sensation_{receptor}"] for receptor in range(30)]
    np.testing.assert_array_equal(felt, representation.target_sensations[1])
