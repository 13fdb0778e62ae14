import numpy as np
import pytest
from bodies_by_hand import shape_error

from selftouch_drake.quotient import learn, recover
from selftouch_drake.quotient.layout import classical_embedding
from selftouch_drake.quotient.lengths import literal


@pytest.fixture(scope="module")
def shape(representation):
    return recover(representation)


def places(representation):
    members = map(representation.members, range(representation.num_targets))
    place = np.array([representation.kernel_q[rows, :3].mean(axis=0) for rows in members])
    return place / np.linalg.norm(place, axis=1, keepdims=True)


def test_a_sphere_is_recovered_from_bare_arrays(representation, shape):
    assert (shape.skin_dimension, shape.space_dimension) == (2, 3)
    assert shape.topology.betti == (1, 0, 1)
    assert shape.topology.margin > 3
    assert 1.6 < shape.dimension < 2.6
    # 30 receptors at random: the skin is uneven.
    assert shape_error(shape.positions, places(representation)) < 0.08


def test_the_papers_own_metric_is_of_the_complete_graph(representation):
    graph = literal(representation)
    assert len(graph.edges) == 120 * 119 / 2
    sets = representation.kernel_sets
    for (i, j), length in zip(graph.edges[::997], graph.length[::997], strict=True):
        apart = np.linalg.norm(sets.configurations(i)[:, None] - sets.configurations(j), axis=2)
        assert length == pytest.approx(apart.min(), rel=1e-4)

    def lay_out(edges, distances, dimension):
        return classical_embedding(distances, dimension)

    found = recover(representation, literal, lay_out)
    assert shape_error(found.positions, places(representation)) < 0.1


def test_a_ring_is_a_line_in_a_plane():
    turn = np.random.default_rng(0).uniform(0, 2 * np.pi, 3000)
    q = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    receptors = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    found = recover(learn(q, np.exp(4 * np.cos(turn[:, None] - receptors)), num_targets=60))
    assert (found.skin_dimension, found.space_dimension) == (1, 2)
    assert found.topology.betti == (1, 1, 0)
