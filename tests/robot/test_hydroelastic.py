"""Contact as pure geometry, compared with Drake."""

import os

import numpy as np
import pytest
import robots
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import HydroelasticContactRepresentation
from scipy.spatial import Delaunay, cKDTree

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.geometry import surfaces
from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.geometry.receptors import place_receptors, receptive_fields
from selftouch_drake.robot import SkinModel
from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.faces import Faces
from selftouch_drake.robot.hydroelastic import cut
from selftouch_drake.robot.soft_skin import (
    add_load,
    distance_to_triangles,
    feel_loads,
    soft_skin,
    tets_near,
)
from selftouch_drake.robot.touchers import rigid_mesh
from selftouch_drake.robot.world import Postures

# 100,000 touches of each robot take hours: SELFTOUCH_MANY_TOUCHES=100000.
NUM_TOUCHES = int(os.environ.get("SELFTOUCH_MANY_TOUCHES", "120"))
EXPERIMENTS = (
    "sphere",
    "cube",
    "cylinder",
    "ellipsoid",
    "torus",
    "torus_two_fingers",
    "double_torus",
    "gantry",
    "two_arms",
    "turning_body",
    "infant",
)


def drake_touches(world, q):
    """Drake's result: all contact surfaces at every configuration."""
    postures = Postures(world.experiment, world.skins)
    surfaces = (
        (row, Faces.of(surface))
        for row, at in enumerate(q)
        for surface in postures.query(at).ComputeContactSurfaces(
            HydroelasticContactRepresentation.kPolygon
        )
    )
    sensor = SensorModel(postures.robot.skins, postures.robot.touchers)
    return sensor.touches(surfaces, world.robot.skin_positions(q))


def assert_same_touches(touches, expected):
    np.testing.assert_array_equal(
        touches.sensation.any(axis=1), expected.sensation.any(axis=1), strict=True
    )
    np.testing.assert_allclose(touches.sensation, expected.sensation, rtol=0, atol=1e-9)
    for name in ("row", "skin", "toucher"):
        np.testing.assert_array_equal(getattr(touches, name), getattr(expected, name))
    np.testing.assert_allclose(touches.p_LC, expected.p_LC, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        # Drake takes seconds for each; the three others have every kind of skin, joint and toucher.
        name
        if name in ("gantry", "infant", "two_arms")
        else pytest.param(name, marks=pytest.mark.slow)
        for name in EXPERIMENTS
    ],
)
def test_touches_are_those_of_drake(name):
    world = robots.shipped(name)
    walk = random_walk(world.experiment, DrakeBody(world), 0)
    found = 0
    while found < NUM_TOUCHES:
        q = walk.steps(300)
        touches = world.probe.touches(q)
        assert_same_touches(touches, drake_touches(world, q))
        found += np.unique(touches.row).size


@pytest.fixture(scope="module")
def wall():
    """The wall of a torus: round, and hollow on one side."""
    surface = surfaces.torus(0.1, 0.05, resolution=0.03)
    return hollow_skin(surface, 0.02)


@pytest.fixture(scope="module")
def model(wall):
    """A skin of that wall, with 30 receptors."""
    surface = trimesh.Trimesh(wall.vertices, wall.faces, process=False)
    return SkinModel(
        name="torus",
        link="torus",
        wall=wall,
        fields=receptive_fields(surface, place_receptors(surface, 30, seed=1)),
        hydroelastic_modulus=3e4,
        is_own_geometry=False,
    )


def anywhere_inside(wall, num_points, seed=0):
    """Points in a wall, and the tetrahedra that contain them."""
    rng = np.random.default_rng(seed)
    tets = rng.integers(len(wall.tetrahedra), size=num_points)
    corners = wall.tet_vertices[wall.tetrahedra[tets]]
    return np.einsum("nk,nki->ni", rng.dirichlet(np.ones(4), num_points), corners), tets


def pieces(triangle, corners):
    """`(T, 3)` of one triangle in tetrahedra `(T, 4, 3)`: area, and centroid in its edges."""
    inverse = np.linalg.inv(np.concatenate([corners, np.ones((len(corners), 4, 1))], axis=2))
    heights = np.einsum("tik,vi->tkv", inverse, np.column_stack([triangle, np.ones(3)]))
    found, polygons = np.zeros((len(corners), 3)), np.empty((2, 8, 2))
    for above, piece in zip(np.ascontiguousarray(heights), found, strict=True):
        if not cut(above, 0, 1, 2, polygons, piece):
            piece[:] = 0.0
    return found


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_pieces_of_a_triangle_make_the_triangle(seed):
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.uniform(size=(12, 3)), np.indices((2, 2, 2)).reshape(3, 8).T])
    corners = points[Delaunay(points).simplices]
    corners = corners[np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) > 1e-12]
    area, u, v = pieces(rng.uniform(size=(3, 3)), corners).T
    assert (area >= 0).all()
    assert area.sum() == pytest.approx(1 / 2, abs=1e-12)
    assert area @ u == pytest.approx(1 / 6, abs=1e-12)
    assert area @ v == pytest.approx(1 / 6, abs=1e-12)


def test_a_triangle_is_cut_as_by_hand():
    tet = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    # At height 1/2 the tetrahedron is half as wide as below.
    flat = np.array([[0, 0, 0.5], [1, 0, 0.5], [0, 1, 0.5]])
    np.testing.assert_allclose(pieces(flat, tet), [[1 / 8, 1 / 6, 1 / 6]], atol=1e-15)
    np.testing.assert_allclose(pieces(flat[[0, 2, 1]], tet), [[1 / 8, 1 / 6, 1 / 6]], atol=1e-15)
    np.testing.assert_array_equal(pieces(np.add(flat, [0, 0, 1]), tet), [[0, 0, 0]])
    inside = 0.1 + 0.1 * flat
    np.testing.assert_allclose(pieces(inside, tet), [[1 / 2, 1 / 3, 1 / 3]], atol=1e-15)


def test_distance_to_a_triangle_by_hand():
    triangle = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]])
    points = [[0.5, 0.5, 3], [1, -4, 0], [2, 2, 0], [-3, -4, 0], [0.5, 0.5, 0], [1, -3, 4]]
    found = distance_to_triangles(np.array(points, dtype=float), triangle)
    np.testing.assert_allclose(found, [3, 4, np.sqrt(2), 5, 0, 5], atol=1e-15)


def test_distance_is_that_to_the_nearest_of_all_triangles(wall):
    triangles = wall.vertices[wall.faces]
    points, _ = anywhere_inside(wall, 200)
    alone = np.min([distance_to_triangles(points, t[None]) for t in triangles], axis=0)
    np.testing.assert_array_equal(distance_to_triangles(points, triangles), alone)


def test_pressure_is_linear_from_none_at_the_boundary_to_the_modulus(wall, model):
    skin = soft_skin(model)
    for corner in range(4):
        p = skin.corners[:, corner]
        pressure = np.einsum("ti,ti->t", skin.pressure[:, :3], p) + skin.pressure[:, 3]
        # Vertices at mid-depth come after the outer ones, and before the inner ones.
        layer = wall.tetrahedra[:, corner] // len(wall.vertices)
        assert np.abs(pressure[layer != 1]).max() < 1e-9 * 3e4
        assert pressure[layer == 1].min() > 0.8 * 3e4
        assert pressure.max() < (1 + 1e-9) * 3e4


def test_the_grid_finds_every_tetrahedron_whose_box_meets_a_box(wall, model):
    skin = soft_skin(model)
    rng = np.random.default_rng(0)
    seen, tets = np.zeros(len(skin.box), dtype=int), np.empty(len(skin.box), dtype=int)
    centres, _ = anywhere_inside(wall, 300)
    for look, centre in enumerate(np.concatenate([centres, rng.uniform(-1, 1, (100, 3))]), 1):
        half = rng.uniform(0, 0.05, 3)
        box = np.concatenate([centre - half, centre + half])
        found = tets[: tets_near(skin, box, look, seen, tets)]
        assert len(np.unique(found)) == len(found)
        # Listed are boxes that meet; what is left out meets the box by a corner of its own alone.
        meets = (box[3:] >= skin.box[:, :3]).all(axis=1) & (box[:3] <= skin.box[:, 3:]).all(axis=1)
        assert meets[found].all()
        inside = ((skin.corners >= box[:3]) & (skin.corners <= box[3:])).all(axis=2).any(axis=1)
        assert np.isin(np.flatnonzero(inside), found).all()


def test_receptors_feel_as_their_fields_say(wall, model):
    fields, skin = model.fields, soft_skin(model, 5)
    points, tets = anywhere_inside(wall, 3000)
    force = np.random.default_rng(1).uniform(0.1, 2, len(points))
    felt = np.zeros((len(points), 5 + 30 + 2))
    load, loaded, parts = np.zeros(len(fields.vertices)), np.empty(9, dtype=int), np.empty(3)
    for row, (p, tet) in enumerate(zip(points, tets, strict=True)):
        num_loaded = add_load(skin, tet, p, force[row], parts, load, loaded, 0)
        feel_loads(skin, load, loaded, num_loaded, felt, row)
        assert not load.any()
    expected = fields.weights_at(points).toarray() * force[:, None]
    np.testing.assert_allclose(felt[:, 5:35], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(felt.sum(axis=1), force, rtol=1e-12)
    assert not felt[:, [0, 4, 35, 36]].any()


def test_few_faces_are_left_to_search(wall, model):
    fields, skin = model.fields, soft_skin(model)
    points, tets = anywhere_inside(wall, 3000)
    _, nearest = cKDTree(fields.vertices[fields.faces].mean(axis=1)).query(points)
    for face, tet in zip(nearest, tets, strict=True):
        few = skin.nearest_faces[skin.nearest_ends[tet] : skin.nearest_ends[tet + 1]]
        assert face in few
    assert np.diff(skin.nearest_ends).mean() < len(fields.faces) / 20


def test_patches_hold_every_face_once():
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = rigid_mesh(ball.vertices, ball.faces)
    patch = np.repeat(np.arange(len(mesh.face_ends) - 1), np.diff(mesh.face_ends))
    corners = mesh.points[mesh.faces + mesh.point_ends[patch][:, None]]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    np.testing.assert_allclose(mesh.areas, area)
    assert np.sort(mesh.areas) == pytest.approx(np.sort(2 * ball.area_faces))
    assert (np.einsum("fi,fi->f", mesh.normals, corners.mean(axis=1)) > 0.9).all()
    assert mesh.areas.sum() == pytest.approx(2 * ball.area)


def test_what_is_felt_is_what_touches_has_in_those_rows(world):
    q = robots.configurations(world)
    rows, felt = world.probe.felt_rows(q)
    touches = world.probe.touches(q)
    np.testing.assert_array_equal(rows, np.flatnonzero(touches.sensation.any(axis=1)))
    np.testing.assert_array_equal(felt.sensation, touches.sensation[rows])
    np.testing.assert_array_equal(rows[felt.row], touches.row)
    np.testing.assert_array_equal(felt.p_LC, touches.p_LC)


@pytest.mark.parametrize("name", ["infant", "turning_body"])
def test_what_touches_is_seen_without_its_readings(name):
    world = robots.shipped(name)
    q = random_walk(world.experiment, DrakeBody(world), 3).steps(3000)
    rows, touches = world.probe.touching(q)
    assert (touches is None) == (name == "infant")
    np.testing.assert_array_equal(rows, world.probe.felt_rows(q)[0])
    assert len(rows) > 20
    felt_rows, felt = DrakeBody(world).feel(q).touches()
    np.testing.assert_array_equal(felt_rows, rows)
    some = felt.of_rows(np.arange(5))
    np.testing.assert_array_equal(some.sensation, world.probe.sensations(q[rows[:5]]))
    assert some.contacts.skin.size >= 5
