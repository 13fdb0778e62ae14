import networkx as nx
import numpy as np
import pytest

from selftouch_drake.agent.representation.embedded import embedded
from selftouch_drake.agent.representation.graphs import to_networkx, without_vectors


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
    assert "position" not in graph.nodes[5]


def test_the_complete_graph_joins_all_and_prices_neighbours(representation):
    graph = to_networkx(representation, complete=True)
    assert graph.number_of_edges() == 120 * 119 / 2
    assert graph.edges[3, 77]["set_distance"] == pytest.approx(representation.set_distance[3, 77])
    priced = sorted(tuple(sorted((i, j))) for i, j, edge in graph.edges.data() if "cost" in edge)
    assert priced == [tuple(edge) for edge in representation.edges.tolist()]


def test_graphml_can_hold_what_the_graph_holds(representation):
    graph = to_networkx(embedded(representation, np.eye(120, 3)))
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
