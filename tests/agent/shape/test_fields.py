import numpy as np
import pytest
from bodies_by_hand import sphere
from scipy.spatial.distance import cdist

from selftouch_drake.agent.shape.fields import corrected_lengths
from selftouch_drake.quotient.graph import neighbour_edges
from selftouch_drake.quotient.paths import geodesics
from selftouch_drake.quotient.sensations import angles


def receptors():
    """At random on a unit sphere, and so denser in some places than in others."""
    places = np.random.default_rng(0).normal(size=(70, 3))
    return places / np.linalg.norm(places, axis=1, keepdims=True)


def sensations(places):
    """What receptors feel that are alike: less with the distance along the sphere."""
    distance = np.arccos(np.clip(places @ receptors().T, -1, 1))
    felt = np.clip(0.9 - distance, 0, None) ** 2
    return felt / np.linalg.norm(felt, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def nodes():
    """Places on a sphere, neighbours and true lengths."""
    places = sphere(300)
    distance = cdist(places, places)
    edges = neighbour_edges(distance)
    return places, edges, distance[edges[:, 0], edges[:, 1]]


def off(edges, length, true):
    """Scatter of long paths about the true ones, as a share."""
    found, right = (geodesics(edges, each, 300) for each in (length, true))
    return np.log(found[right > 1.0] / right[right > 1.0]).std()


def test_lengths_do_not_depend_on_where_receptors_are_dense(nodes):
    places, edges, true = nodes
    targets = sensations(places)
    felt = angles(targets, edges)
    corrected = corrected_lengths(targets, np.arange(300), edges, felt)
    assert off(edges, felt, true) > 0.04
    assert off(edges, corrected, true) < 0.025


def test_a_bad_first_estimate_is_corrected(nodes):
    places, edges, true = nodes
    first = true * np.exp(0.2 * places[edges[:, 0], 2])
    corrected = corrected_lengths(sensations(places), np.arange(300), edges, first)
    assert off(edges, first, true) > 0.04
    assert off(edges, corrected, true) < 0.025


def test_dead_receptors_change_nothing(nodes):
    places, edges, true = nodes
    targets = sensations(places)
    dead = np.insert(targets, [0, 7], 0.0, axis=1)
    alive, beside = (
        corrected_lengths(felt, np.arange(300), edges, true) for felt in (targets, dead)
    )
    np.testing.assert_allclose(beside, alive, rtol=1e-9)


def test_touches_at_two_places_have_no_model(nodes):
    places, edges, true = nodes
    both = sensations(places) + sensations(places @ np.diag([-1, -1, 1]))
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    assert corrected_lengths(both, np.arange(300), edges, true) is None


def test_pieces_of_a_kernel_keep_their_place(nodes):
    """The sensation that they share belongs to none of their places."""
    places, edges, true = nodes
    kernel = np.concatenate([[0, 0], np.arange(1, 299)])
    targets = sensations(np.concatenate([places[:1], places[2:]]))
    corrected = corrected_lengths(targets, kernel, edges, true)
    assert off(edges, corrected, true) < 0.025


def test_kernels_that_are_all_cut_have_no_model(nodes):
    places, edges, true = nodes
    kernel = np.arange(300) // 2
    assert corrected_lengths(sensations(places[::2]), kernel, edges, true) is None
