import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.geometry import cube, hollow_skin, wall_points


def test_points_cover_the_three_layers():
    skin = hollow_skin(cube(0.44, resolution=0.05), 0.03, 0.01)
    spacing = 0.01
    points = wall_points(skin, spacing)
    level = np.abs(points).max(axis=1)
    layers = np.array([0.22, 0.205, 0.19])
    assert np.abs(level[:, None] - layers).min(axis=1).max() < 1e-9
    assert (np.abs(level[:, None] - layers) < 1e-9).sum(axis=0).min() > 6 * (0.38 / spacing) ** 2
    # No point of a layer is farther from these than the corner of an equilateral triangle.
    for layer in range(3):
        rng = np.random.default_rng(layer)
        corners = skin.tet_vertices[skin.faces + layer * len(skin.vertices)]
        face = rng.integers(len(corners), size=2000)
        inside = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), 2000), corners[face])
        distance, _ = cKDTree(points).query(inside)
        assert distance.max() <= spacing / np.sqrt(3) + 1e-9


def test_the_vertices_are_among_them():
    skin = hollow_skin(cube(0.44, resolution=0.05), 0.03, 0.01)
    distance, _ = cKDTree(wall_points(skin, 0.02)).query(skin.tet_vertices)
    assert distance.max() == 0
