import numpy as np
import pytest
from scipy.spatial import cKDTree

from selftouch_drake.geometry.triangles import sample_triangles

# Compact, long, flat to the point of being a line, tiny, and far from the origin.
TRIANGLES = np.array(
    [
        [[0, 0, 0], [1, 0, 0], [0.4, 0.8, 0]],
        [[0, 0, 1], [3, 0, 1], [0, 0.02, 1]],
        [[0, 0, 2], [1, 0, 2], [0.5, 1e-9, 2]],
        [[0, 0, 3], [1e-3, 0, 3], [0, 1e-3, 3]],
        [[9, 9, 9], [9, 9.5, 9.3], [9.6, 9, 9]],
    ]
)


def _inside(num_points, seed=0):
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(0.5 * np.ones(3), (len(TRIANGLES), num_points))
    return np.einsum("fnk,fki->fni", weights, TRIANGLES)


@pytest.mark.parametrize("spacing", [0.03, 0.2])
def test_samples_are_near_every_point_of_their_triangle(spacing):
    points, face = sample_triangles(TRIANGLES, spacing)
    for index, inside in enumerate(_inside(2000)):
        own = points[face == index]
        distance, _ = cKDTree(own).query(np.concatenate([inside, TRIANGLES[index]]))
        assert distance.max() <= spacing * (1 + 1e-9)
        nearest, _ = cKDTree(inside).query(own)
        assert nearest.max() < 0.1


def test_samples_are_few():
    areas = np.linalg.norm(
        np.cross(TRIANGLES[:, 1] - TRIANGLES[:, 0], TRIANGLES[:, 2] - TRIANGLES[:, 0]), axis=1
    )
    points, _ = sample_triangles(TRIANGLES, 0.01)
    longest = np.linalg.norm(np.roll(TRIANGLES, 1, axis=1) - TRIANGLES, axis=2).max(axis=1)
    assert len(points) < 1.5 * areas.sum() / 2 / 0.01**2 + 3 * longest.sum() / 0.01


def test_each_triangle_may_have_its_own_spacing():
    spacing = np.array([0.1, 0.2, 0.3, 1e-4, 5.0])
    together, face = sample_triangles(TRIANGLES, spacing)
    for index in range(len(TRIANGLES)):
        alone, _ = sample_triangles(TRIANGLES[index : index + 1], spacing[index])
        np.testing.assert_array_equal(together[face == index], alone)
