"""Paths on the skin, beside the shortest way along it."""

from types import SimpleNamespace

import numpy as np
import pytest

from selftouch_drake.evaluation.paths import OwnPaths, TruePaths
from selftouch_drake.experience.store import Contacts


def contacts(places, skin=None):
    """One contact at each of the places, by one toucher."""
    n = len(places)
    return Contacts(
        offsets=np.arange(n + 1),
        skin=np.zeros(n, dtype=np.int8) if skin is None else skin,
        toucher=np.zeros(n, dtype=np.int8),
        p_LC=np.asarray(places, dtype=np.float32),
    )


def arc(angles, *, wave=0.0):
    """Places on a ball's equator, in a ball of 0.19 m; they may swing to both sides of it."""
    z = 0.19 * wave * np.sin(8.0 * angles)
    x, y = 0.19 * np.cos(angles), 0.19 * np.sin(angles)
    return np.stack([x, y, z], axis=1)


@pytest.fixture(scope="module")
def ball(sphere):
    return TruePaths([sphere, sphere])


def test_the_shortest_way_is_one_and_noise_does_not_lengthen_it(ball):
    there = arc(np.linspace(0.0, 2.0, 1000))
    assert ball.over_shortest(contacts(there)) == pytest.approx(1.0, abs=0.02)
    noisy = there + np.random.default_rng(0).normal(0.0, 0.0005, there.shape)
    assert ball.over_shortest(contacts(noisy)) == pytest.approx(1.0, abs=0.03)


def test_the_long_way_round_and_the_way_back_count(ball):
    round_it = ball.over_shortest(contacts(arc(np.linspace(0.0, 4.5, 1000))))
    assert round_it == pytest.approx(4.5 / (2 * np.pi - 4.5), rel=0.03)
    back = np.concatenate([np.linspace(0.0, 1.5, 400), np.linspace(1.5, 1.0, 200)])
    assert ball.over_shortest(contacts(arc(back))) == pytest.approx(2.0, rel=0.06)
    waves = ball.over_shortest(contacts(arc(np.linspace(0.0, 2.0, 1000), wave=0.2)))
    assert 1.3 < waves < 1.6


def test_the_shortest_way_begins_and_ends_on_the_surface_above_the_places(ball):
    ends = arc(np.array([0.0, 2.0]))
    way = ball.shortest(1, ends)
    radius = np.linalg.norm(way, axis=1)
    assert np.ptp(radius) < 0.01 * radius.mean()
    np.testing.assert_allclose(way[[0, -1]] / radius.mean(), ends / 0.19, atol=0.01)
    along = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert along == pytest.approx(2.0 * radius.mean(), rel=0.03)


def test_paths_that_cannot_be_compared_have_no_ratio(ball):
    there = arc(np.linspace(0.0, 2.0, 50))
    assert ball.over_shortest(contacts(there[:1])) is None
    assert ball.over_shortest(contacts(there[:0])) is None
    assert ball.over_shortest(contacts(there, np.repeat([0, 1], 25).astype(np.int8))) is None
    twice = contacts(there)
    both = Contacts(
        offsets=np.arange(0, 51, 2), skin=twice.skin, toucher=twice.toucher, p_LC=twice.p_LC
    )
    assert ball.over_shortest(both) is None


def test_the_agent_measures_a_ring_by_what_neighbours_feel():
    angle = 2 * np.pi * np.arange(30) / 30
    targets = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    here = np.arange(30)
    ring = np.sort(np.stack([here, (here + 1) % 30], axis=1), axis=1)
    own = OwnPaths(SimpleNamespace(target_sensations=targets, edges=ring))
    assert own.over_shortest(targets[:12]) == pytest.approx(1.0)
    assert own.over_shortest(targets[:21]) == pytest.approx(20 / 10)
    to_and_fro = targets[np.array([0, 1, 0, 1, 2, 3, 4, 3, 4, 5, 6])]
    assert own.over_shortest(to_and_fro) == pytest.approx(1.0)
    assert own.over_shortest(np.concatenate([targets[:14], targets[12:3:-1]])) > 2.5
    assert own.over_shortest(targets[[4, 4]]) is None
    assert own.over_shortest(0 * targets) is None
