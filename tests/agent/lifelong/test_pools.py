"""Receptors that feel alike share a pool."""

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.lifelong.pairs import in_pools, pools


def touched_lines(num_touches, *, rng, width=0.05):
    """Two lines of 300 receptors each; a touch presses one of them, or rarely both."""
    places = np.linspace(0.0, 1.0, 300)
    at = rng.random((num_touches, 2, 1))
    felt = np.abs(places - at) < width
    only = rng.random(num_touches)
    felt[only < 0.45, 0] = False
    felt[only > 0.55, 1] = False
    return csr_array(felt.reshape(num_touches, -1).astype(float))


def test_neighbours_share_a_pool_and_lines_do_not():
    pool = pools(touched_lines(2000, rng=np.random.default_rng(0)))
    assert not set(pool[:300]) & set(pool[300:])
    assert len(np.unique(pool)) == 2


def test_few_touches_are_finer():
    touches = touched_lines(40, rng=np.random.default_rng(1), width=0.02)
    pool = pools(touches)
    assert 10 < len(np.unique(pool)) < 300
    # Receptors that felt the same touches are one place.
    columns = touches.toarray().T
    same = np.flatnonzero((columns == columns[100]).all(axis=1))
    assert len(set(pool[same])) == 1


def test_receptors_that_felt_nothing_share_the_last_pool():
    touches = touched_lines(500, rng=np.random.default_rng(2))
    silent = csr_array((500, 50))
    pool = pools(csr_array(np.hstack([touches.toarray(), silent.toarray()])))
    assert set(pool[-50:]) == {pool.max()}
    assert pool.max() not in pool[:-50]


def test_a_pool_feels_what_its_receptors_feel():
    sensation = csr_array(np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(
        in_pools(sensation, np.array([0, 0, 1])), [[3.0, 0.0], [0.0, 3.0], [0.0, 0.0]]
    )
