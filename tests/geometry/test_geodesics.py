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


def test_a_quadrangle_that_bends_inwards_is_not_crossed():
    # Folded to an arrowhead: the line between its far corners would leave both triangles.
    vertices = np.array([[0, 0, 0], [1, 0, 0], [-2, 1, 0], [-2, -1, 0]], dtype=float)
    found = surface_distances(vertices, np.array([[0, 1, 2], [1, 0, 3]]), vertices)
    assert found[2, 3] == pytest.approx(2 * np.sqrt(5))
    assert found[0, 1] == 1.0


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


def test_paths_go_round_a_slit():
    # A square sheet with a slit as wide as one row of triangles, from one side to the middle.
    size = 41
    x, y = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * 0.01
    index = np.arange(size**2).reshape(size, size)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    keep = ~((x == 20) & (y < 20))[:-1, :-1]
    faces = np.concatenate([np.stack([a, b, c], axis=-1)[keep], np.stack([a, c, d], axis=-1)[keep]])
    left, right = np.array([0.20, 0.0, 0]), np.array([0.21, 0.0, 0])
    found = surface_distances(vertices, faces, np.array([left, right]))[0, 1]
    assert 0.4 <= found < 1.05 * 0.41


def test_a_vertex_without_triangles_is_no_place():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.1, 0.1, 0]])
    found = surface_distances(vertices, np.array([[0, 1, 2]]), np.array([[0.1, 0.1, 0], [1, 0, 0]]))
    assert found[0, 1] == 1.0
