import numpy as np
from by_hand import ring_by_hand
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.quotient.links import leap_penalty, link_lengths, step_links


def test_leaps_are_edges_between_far_off_sensations():
    chord = ring_by_hand(20, links=[(k, (k + 1) % 20) for k in range(20)] + [(0, 9)])
    penalty = leap_penalty(link_lengths(chord.target_sensations, chord.edges))
    is_chord = (chord.edges == [0, 9]).all(axis=1)
    assert np.all(penalty[~is_chord] == 1.0)
    assert penalty[is_chord] > 2.0


def test_links_join_what_feels_alike_and_what_the_graph_joins():
    chord = ring_by_hand(20, links=[(0, 9)])
    links = {tuple(link) for link in step_links(chord.target_sensations, chord.edges).tolist()}
    assert {(0, 9), (0, 1), (0, 2), (0, 19)} <= links
    assert (0, 10) not in links
    assert all(i < j for i, j in links)


def test_a_step_leads_to_the_ring_of_neighbours_but_not_past_the_next():
    """Kernels spread evenly over a ball, linked by what they feel alone."""
    i = np.arange(400) + 0.5
    turn, z = i * np.pi * (1 + np.sqrt(5)), 1 - 2 * i / 400
    place = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1)
    felt = np.clip(place @ place.T, 0.0, None) ** 3
    targets = felt / np.linalg.norm(felt, axis=1, keepdims=True)
    links = step_links(targets, np.empty((0, 2), dtype=int))
    apart = squareform(pdist(place))
    spacing = np.median(np.sort(apart, axis=1)[:, 6])
    linked = np.zeros((400, 400), dtype=bool)
    linked[tuple(links.T)] = True
    assert linked[np.triu(apart < spacing, 1)].all()
    assert not linked[apart > 2.0 * spacing].any()
