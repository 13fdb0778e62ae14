import numpy as np
import pytest
import trimesh

from selftouch_drake.geometry.geodesics import surface_distances


def test_along_a_sphere_are_great_circles():
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.25)
    points = mesh.vertices[::40]
    found = surface_distances(mesh.vertices, mesh.faces, 1.01 * points)
    unit = points / 0.25
    true = 0.25 * np.arccos(np.clip(unit @ unit.T, -1, 1))
    np.testing.assert_allclose(found, found.T)
    far = true > 0.05
    ratio = found[far] / true[far]
    assert ratio.min() > 0.99
    assert ratio.max() < 1.05
    assert np.median(ratio) < 1.02


def test_round_the_edge_of_a_box_not_through_it():
    mesh = trimesh.creation.box((0.4, 0.4, 0.4)).subdivide_to_size(0.04)
    top, side = [0.0, 0.0, 0.2], [0.2, 0.0, 0.0]
    found = surface_distances(mesh.vertices, mesh.faces, np.array([top, side]))
    assert found[0, 1] == pytest.approx(0.4, rel=0.03)


def test_points_at_one_vertex_are_no_distance_apart():
    mesh = trimesh.creation.icosphere(subdivisions=1)
    found = surface_distances(mesh.vertices, mesh.faces, mesh.vertices[[3, 3, 5]])
    assert found[0, 1] == 0.0
    assert found[0, 2] == found[1, 2] > 0.0


def test_connected_parts_are_at_infinite_distance():
    one = trimesh.creation.icosphere(subdivisions=2)
    other = one.copy()
    other.apply_translation((5, 0, 0))
    both = one + other
    points = np.array([[1.0, 0, 0], [-1.0, 0, 0], [4.0, 0, 0], [6.0, 0, 0]])
    found = surface_distances(both.vertices, both.faces, points)
    assert np.isinf(found[:2, 2:]).all()
    assert found[0, 1] == pytest.approx(np.pi, rel=0.03)
    assert found[2, 3] == pytest.approx(np.pi, rel=0.03)
