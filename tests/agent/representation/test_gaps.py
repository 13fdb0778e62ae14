"""Receptors on a line, 1 apart; touches between two of them are felt by both."""

import numpy as np
from by_hand import laid_by_hand

from selftouch_drake.agent.representation.gaps import doubts_of_parts
from selftouch_drake.quotient.holes import Topology

NUM_RECEPTORS, OF_PART = 24, 12


def _body():
    """Two parts of twelve kernels each, one at each receptor."""
    q = np.arange(NUM_RECEPTORS, dtype=float)[:, None, None] + np.linspace(0, 0.1, 3)[:, None]
    chain = np.arange(NUM_RECEPTORS - 1)
    edges = np.stack([chain, chain + 1], axis=1)
    return laid_by_hand(
        list(q),
        edges[edges[:, 1] != OF_PART],
        target_sensations=np.eye(NUM_RECEPTORS),
        part=np.arange(NUM_RECEPTORS) // OF_PART,
        overlap=np.eye(NUM_RECEPTORS, dtype=bool),
    )


def _touches(across: float) -> np.ndarray:
    """200 touches of each receptor, some with its neighbour; the gap between parts has fewer."""
    rows = []
    for receptor in range(NUM_RECEPTORS):
        touch = np.tile(np.eye(NUM_RECEPTORS)[receptor], (200, 1))
        if receptor + 1 < NUM_RECEPTORS:
            share = across if receptor + 1 == OF_PART else 0.5
            touch[: int(200 * share), receptor + 1] = 0.5
        rows.append(touch)
    return np.concatenate(rows)


def test_a_gap_that_touches_reach_across_is_a_doubt():
    (line,) = doubts_of_parts(_body(), _touches(0.4), [None, None])
    assert line.startswith("parts 0 and 1 may be one with a gap between its receptors: ")
    assert doubts_of_parts(_body(), _touches(0.1), [None, None]) == []


def test_a_part_that_falls_into_pieces_is_a_doubt():
    bars = (np.zeros((0, 2)),) * 3
    found = Topology(betti=(2, 0, 0), margin=3.0, scale=1.0, meeting_radius=1.0, diagram=bars)
    assert doubts_of_parts(_body(), _touches(0.0), [found, None]) == [
        "part 0 counts as one, but its places fall into 2 pieces"
    ]
