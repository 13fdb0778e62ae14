import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    HydroelasticContactRepresentation,
    Mesh,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from scipy.spatial import cKDTree

from selftouch_drake.geometry import hollow, surfaces
from selftouch_drake.geometry.triangles import first_self_intersection, sample_triangles
from selftouch_drake.resources import EXPERIMENTS

STANDARD_BODIES = {
    "sphere": lambda: surfaces.sphere(0.25),
    "cube": lambda: surfaces.cube(0.44),
    "torus": lambda: surfaces.torus(0.22, 0.09),
    "ellipsoid": lambda: surfaces.ellipsoid((0.30, 0.24, 0.20)),
    "cylinder": lambda: surfaces.cylinder(0.2, 0.4),
}


def _assert_sound(skin: hollow.HollowSkin) -> None:
    """All tetrahedra have positive volume; together they fill the wall between the surfaces."""
    outer = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    inner = trimesh.Trimesh(skin.inner_vertices, skin.faces, process=False)
    volumes = hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra)
    assert skin.tetrahedra.shape == (6 * len(skin.faces), 4)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(outer.volume - inner.volume, rel=1e-9)
    mean_area = (outer.area + inner.area) / 2
    assert volumes.sum() == pytest.approx(mean_area * skin.thickness, rel=0.02)
    assert first_self_intersection(skin.inner_vertices, skin.faces) is None
    _assert_conforming(skin)


def _assert_conforming(skin: hollow.HollowSkin) -> None:
    """Every triangle is shared by two tetrahedra, but for those of the two surfaces."""
    triangles = np.sort(skin.tetrahedra[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]])
    unique, count = np.unique(triangles.reshape(-1, 3), axis=0, return_counts=True)
    num_vertices = len(skin.vertices)
    outside = np.concatenate([skin.faces, skin.faces + 2 * num_vertices])
    expected = np.unique(np.sort(outside), axis=0)
    assert count.max() == 2
    np.testing.assert_array_equal(unique[count == 1], expected)


@pytest.mark.parametrize("name", STANDARD_BODIES)
def test_standard_bodies_have_a_sound_skin(name):
    _assert_sound(hollow.hollow_skin(STANDARD_BODIES[name](), 0.03))


def test_cube_has_an_exact_cube_inside():
    skin = hollow.hollow_skin(surfaces.cube(0.44), 0.03)
    np.testing.assert_allclose(skin.inner_vertices, skin.vertices * 0.38 / 0.44, atol=1e-9)
    outermost = np.abs(skin.inner_vertices).max(axis=1)
    np.testing.assert_allclose(outermost, 0.19, rtol=0, atol=1e-12)
    middle = skin.tet_vertices[len(skin.vertices) : 2 * len(skin.vertices)]
    np.testing.assert_allclose(middle, skin.vertices * 0.41 / 0.44, atol=1e-9)
    volumes = hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra)
    assert volumes.sum() == pytest.approx(0.44**3 - 0.38**3)


def test_a_cube_of_corners_only_shrinks_too():
    skin = hollow.hollow_skin(surfaces.cube(0.5, resolution=0.5), 0.03)
    np.testing.assert_allclose(np.abs(skin.inner_vertices), 0.22)


def test_inner_sphere_and_cylinder_are_a_thickness_smaller():
    skin = hollow.hollow_skin(surfaces.sphere(0.25), 0.03)
    np.testing.assert_allclose(np.linalg.norm(skin.inner_vertices, axis=1), 0.22, atol=1e-4)
    skin = hollow.hollow_skin(surfaces.cylinder(0.2, 0.4), 0.03)
    x, y, z = skin.inner_vertices.T
    assert np.hypot(x, y).max() == pytest.approx(0.17, abs=1e-4)
    np.testing.assert_allclose(np.abs(z).max(), 0.17)


def test_a_reflex_edge_is_mitred(tmp_path):
    # An L of three cubes of 0.3 m: the inner L keeps the outer one's shape, 0.03 m inside.
    solid = manifold3d.Manifold.cube((0.6, 0.3, 0.3)) + manifold3d.Manifold.cube((0.3, 0.6, 0.3))
    mesh = solid.to_mesh()
    path = tmp_path / "l.ply"
    trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts).export(path)
    skin = hollow.hollow_skin(surfaces.mesh_file(path), 0.03)
    _assert_sound(skin)
    inner = trimesh.Trimesh(skin.inner_vertices, skin.faces, process=False)
    assert inner.volume == pytest.approx((0.54 * 0.24 + 0.24 * 0.30) * 0.24, rel=1e-5)


def test_a_body_of_genus_two_has_a_sound_skin(tmp_path):
    surface = _two_tori(tmp_path)
    assert surface.euler_number == -2
    skin = hollow.hollow_skin(surface, 0.03)
    assert hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra).min() > 0
    _assert_conforming(skin)


def _two_tori(tmp_path) -> trimesh.Trimesh:
    ring = surfaces.torus(0.2, 0.1)
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(ring.vertices), ring.faces.astype(np.uint64))
    )
    solid = solid.translate((-0.2, 0, 0)) + solid.translate((0.2, 0, 0))
    mesh = solid.refine_to_length(0.02).to_mesh64()
    surface = trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts.astype(int))
    trimesh.smoothing.filter_laplacian(surface, iterations=10)
    path = tmp_path / "two_tori.stl"
    surface.export(path)
    return surfaces.mesh_file(path)


@settings(max_examples=5, deadline=None)
@given(
    radius=st.floats(0.15, 0.3),
    stretch=st.floats(0.8, 1.3),
    thickness=st.floats(0.01, 0.04),
)
def test_any_wide_ellipsoid_has_a_sound_skin(radius, stretch, thickness):
    surface = surfaces.ellipsoid((radius, radius * stretch, radius), resolution=0.03)
    _assert_sound(hollow.hollow_skin(surface, thickness))


def test_walls_that_do_not_fit_are_refused():
    def message(surface, thickness):
        with pytest.raises(ValueError, match=r"^thickness is") as caught:
            hollow.hollow_skin(surface, thickness)
        return str(caught.value)

    assert (
        message(surfaces.cube(0.44), -0.03)
        == "thickness is -0.03 m; give a positive length in metres"
    )
    for surface in (surfaces.torus(0.22, 0.025), surfaces.cube(0.05), surfaces.cylinder(0.2, 0.05)):
        crushed = message(surface, 0.03)
        assert crushed.startswith("thickness is 0.03 m, thicker than the surface allows near (")
        assert crushed.endswith(") m; make the skin thinner or the surface larger")


def test_walls_just_wide_enough_are_accepted():
    for surface in (
        surfaces.torus(0.22, 0.045),
        surfaces.cube(0.082),
        surfaces.cylinder(0.2, 0.082),
    ):
        skin = hollow.hollow_skin(surface, 0.03)
        assert hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra).min() > 0


def test_a_cavity_may_be_narrow():
    skin = hollow.hollow_skin(surfaces.cube(0.062), 0.03)
    assert np.abs(skin.inner_vertices).max() == pytest.approx(0.001)


@pytest.mark.parametrize("count", [(16, 8), (32, 32)])
@pytest.mark.parametrize("thickness", [0.005, 0.03])
def test_a_capsule_of_long_triangles_has_a_sound_skin(count, thickness):
    surface = trimesh.creation.capsule(height=0.3, radius=0.06, count=list(count))
    assert surface.edges_unique_length.max() > 0.25
    skin = hollow.hollow_skin(surface, thickness)
    assert hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra).min() > 0
    inner = trimesh.Trimesh(skin.inner_vertices, skin.faces, process=False)
    assert inner.volume > 0
    assert first_self_intersection(skin.inner_vertices, skin.faces) is None
    cloud, _ = sample_triangles(surface.triangles, 1e-3)
    depth, _ = cKDTree(cloud).query(skin.inner_vertices)
    assert depth.min() > 0.89 * thickness
    assert depth.max() < 1.2 * thickness


@pytest.mark.parametrize("radius", [0.04, 0.06])
def test_an_even_capsule_has_a_wall_as_thick_as_asked(radius):
    skin = hollow.hollow_skin(surfaces.capsule(radius, 0.3), 0.03)
    x, y, z = skin.inner_vertices.T
    along = np.clip(z, -0.15, 0.15)
    depth = radius - np.linalg.norm([x, y, z - along], axis=0)
    np.testing.assert_allclose(depth, 0.03, rtol=0.1)


# Of the first version, at 0.03 m: vertices; steps from outer to inner vertices, and volumes of
# tetrahedra, both sorted and weighted by their rank. Stored experience was felt by these skins.
FIRST_WALLS = {
    "sphere": (1002, 15084.04408737984, 135.6321674255766),
    "cube": (1352, 37755.5243782534, 258.4639440007188),
    "torus": (960, 14220.215548984981, 131.27151139121108),
    "ellipsoid": (1002, 15389.654227032233, 132.79702057494953),
    "cylinder": (884, 14631.554460264239, 110.12659806455127),
    "double_torus": (2458, 95298.58777616454, 319.90475329656545),
}


@pytest.mark.parametrize("name", FIRST_WALLS)
def test_the_papers_bodies_keep_their_walls(name):
    coarse = {
        "sphere": lambda: surfaces.sphere(0.25, resolution=0.03),
        "cube": lambda: surfaces.cube(0.44, resolution=0.03),
        "torus": lambda: surfaces.torus(0.22, 0.09, resolution=0.03),
        "ellipsoid": lambda: surfaces.ellipsoid((0.30, 0.24, 0.20), resolution=0.03),
        "cylinder": lambda: surfaces.cylinder(0.2, 0.4, resolution=0.03),
        "double_torus": lambda: surfaces.mesh_file(
            EXPERIMENTS / "meshes" / "double_torus.ply", resolution=0.03
        ),
    }
    skin = hollow.hollow_skin(coarse[name](), 0.03)
    steps = np.sort(np.linalg.norm(skin.inner_vertices - skin.vertices, axis=1))
    volumes = np.sort(hollow.tet_volumes(skin.tet_vertices, skin.tetrahedra))
    num_vertices, step_sum, volume_sum = FIRST_WALLS[name]
    assert len(skin.vertices) == num_vertices
    assert steps @ np.arange(num_vertices) == pytest.approx(step_sum, rel=1e-9)
    assert volumes @ np.arange(len(volumes)) == pytest.approx(volume_sum, rel=1e-9)


def test_vtk_text_is_exact(tmp_path):
    skin = hollow.hollow_skin(surfaces.cube(0.5, resolution=0.5), 0.03)
    path = tmp_path / "skin.vtk"
    path.write_text(hollow.vtk_text(skin))
    lines = path.read_text().splitlines()
    assert lines[:5] == [
        "# vtk DataFile Version 3.0",
        "Hollow skin, 0.03 m thick",
        "ASCII",
        "DATASET UNSTRUCTURED_GRID",
        "POINTS 24 double",
    ]
    points = np.array([line.split() for line in lines[5:29]], dtype=float)
    np.testing.assert_array_equal(points, skin.tet_vertices)
    assert lines[29] == "CELLS 72 360"
    cells = np.array([line.split() for line in lines[30:102]], dtype=int)
    np.testing.assert_array_equal(cells, np.insert(skin.tetrahedra, 0, 4, axis=1))
    assert lines[102:] == ["CELL_TYPES 72"] + ["10"] * 72


def test_drake_feels_the_wall_and_nothing_inside(tmp_path):
    ring = surfaces.torus(0.22, 0.09, resolution=0.03)
    (tmp_path / "skin.vtk").write_text(hollow.vtk_text(hollow.hollow_skin(ring, 0.03)))
    in_wall, in_tube, in_hole, outside = _contact_surfaces(
        tmp_path / "skin.vtk", [(0.22, 0, 0.095), (0.22, 0, 0), (0, 0, 0), (0.22, 0, 0.11)]
    )
    (surface,) = in_wall
    pressures = [
        surface.poly_e_MN().EvaluateCartesian(face, surface.centroid(face))
        for face in range(surface.num_faces())
    ]
    assert min(pressures) > 0
    # 5 mm deep, where the pressure rises from zero to the modulus within 15 mm.
    assert max(pressures) == pytest.approx(3e4 * 5 / 15, rel=0.35)
    assert in_tube == in_hole == outside == []


def _contact_surfaces(path, fingertips):
    """The contacts of a rigid fingertip of 1 cm, at each `p_WF`, with the skin in `path`."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    soft, hard = ProximityProperties(), ProximityProperties()
    AddCompliantHydroelasticProperties(0.01, 3e4, soft)
    AddRigidHydroelasticProperties(0.01, hard)
    skin = GeometryInstance(RigidTransform(), Mesh(str(path)), "skin")
    skin.set_proximity_properties(soft)
    scene_graph.RegisterAnchoredGeometry(source, skin)
    frame = scene_graph.RegisterFrame(source, GeometryFrame("fingertip"))
    tip = GeometryInstance(RigidTransform(), Sphere(0.01), "fingertip")
    tip.set_proximity_properties(hard)
    scene_graph.RegisterGeometry(source, frame, tip)
    context = scene_graph.CreateDefaultContext()
    query_port = scene_graph.get_query_output_port()
    contacts = []
    for p_WF in fingertips:
        poses = FramePoseVector()
        poses.set_value(frame, RigidTransform(np.array(p_WF, dtype=float)))
        scene_graph.get_source_pose_port(source).FixValue(context, poses)
        query = query_port.Eval(context)
        kind = HydroelasticContactRepresentation.kPolygon
        contacts.append(query.ComputeContactSurfaces(kind))
    return contacts


def test_samples_cover_the_three_layers():
    skin = hollow.hollow_skin(surfaces.cube(0.44, resolution=0.05), 0.03)
    spacing = 0.006
    points = skin.samples(spacing)
    level = np.abs(points).max(axis=1)
    layers = np.array([0.22, 0.205, 0.19])
    assert np.abs(level[:, None] - layers).min(axis=1).max() < 1e-9
    assert (np.abs(level[:, None] - layers) < 1e-9).sum(axis=0).min() > 6 * (0.38 / 0.01) ** 2
    for layer in range(3):
        rng = np.random.default_rng(layer)
        corners = skin.tet_vertices[skin.faces + layer * len(skin.vertices)]
        face = rng.integers(len(corners), size=2000)
        inside = np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), 2000), corners[face])
        distance, _ = cKDTree(points).query(inside)
        assert distance.max() <= spacing
