import numpy as np
import pytest

from selftouch_drake.agent.clusters import clusters


@pytest.mark.parametrize("dimension", [2, 6])
def test_groups_of_points_are_found(dimension):
    rng = np.random.default_rng(1)
    centres = 10 * np.eye(6)[:4, :dimension]
    centres[dimension:] += 10 * (1 + np.arange(4 - min(dimension, 4)))[:, None]
    group = rng.permutation(np.repeat(np.arange(4), [5, 50, 200, 400]))
    points = centres[group] + rng.standard_normal((len(group), dimension))
    found = clusters(points, 4)
    assert len(np.unique(np.stack([group, found]), axis=1).T) == 4
    np.testing.assert_array_equal(clusters(points, 4), found)


def test_a_strip_is_cut_into_equal_lengths():
    x = np.random.default_rng(2).random(3000)
    found = clusters(np.stack([3 * x, 0.1 * x[::-1]], axis=1), 3)
    ends = sorted((x[found == c].min(), x[found == c].max()) for c in range(3))
    np.testing.assert_allclose(ends, [[0, 1 / 3], [1 / 3, 2 / 3], [2 / 3, 1]], atol=0.03)


def test_one_point_many_times_is_one_cluster():
    assert (clusters(np.ones((7, 2)), 3) == 0).all()
