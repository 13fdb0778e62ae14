import warnings

import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.quotient.graph import (
    DisconnectedWarning,
    combined_distance,
    connected_edges,
    neighbour_edges,
)
from selftouch_drake.quotient.paths import component_labels


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
    distance = combined_distance(set_distance, targets)
    assert distance[0, 1] < distance[0, 3]
    distance[part[:, None] != part] = np.inf
    assert neighbour_edges(distance).max() == 3


def test_neighbours_at_no_distance_are_not_oneself():
    assert neighbour_edges(np.zeros((3, 3)), 1, 0).tolist() == [[0, 1]]


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
        "the quotient graph fell into 3 components, with 2, 2, 1 kernels, and was joined by the "
        "bridges 1-2, 3-4: babble longer, or give fewer targets"
    )


def test_bridges_of_no_length_join_too():
    with pytest.warns(DisconnectedWarning):
        joined = connected_edges(np.empty((0, 2), dtype=int), np.zeros((4, 4)))
    assert component_labels(joined, 4).tolist() == [0, 0, 0, 0]
