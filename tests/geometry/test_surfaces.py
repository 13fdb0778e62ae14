import math

import numpy as np
import pytest
import trimesh

from selftouch_drake.geometry import closing, hollow, surfaces
from selftouch_drake.geometry.triangles import first_self_intersection

# surface, Euler number, volume in m³, half extents in m
STANDARD_BODIES = {
    "sphere": (surfaces.sphere(0.25), 2, 4 / 3 * math.pi * 0.25**3, (0.25, 0.25, 0.25)),
    "cube": (surfaces.cube(0.44), 2, 0.44**3, (0.22, 0.22, 0.22)),
    "torus": (surfaces.torus(0.22, 0.09), 0, 2 * math.pi**2 * 0.22 * 0.09**2, (0.31, 0.31, 0.09)),
    "ellipsoid": (
        surfaces.ellipsoid((0.30, 0.24, 0.20)),
        2,
        4 / 3 * math.pi * 0.30 * 0.24 * 0.20,
        (0.30, 0.24, 0.20),
    ),
    "cylinder": (surfaces.cylinder(0.2, 0.4), 2, math.pi * 0.2**2 * 0.4, (0.2, 0.2, 0.2)),
    "capsule": (
        surfaces.capsule(0.1, 0.3),
        2,
        math.pi * 0.1**2 * (0.3 + 4 / 3 * 0.1),
        (0.1, 0.1, 0.25),
    ),
}


@pytest.mark.parametrize("name", STANDARD_BODIES)
def test_standard_bodies_are_closed_even_and_of_the_right_size(name):
    surface, euler_number, volume, half_extents = STANDARD_BODIES[name]
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.euler_number == euler_number
    assert surface.volume == pytest.approx(volume, rel=0.02)
    np.testing.assert_allclose(surface.bounds[1], half_extents, rtol=2e-3)
    np.testing.assert_allclose(surface.bounds.sum(axis=0), 0, atol=1e-12)
    edges = surface.edges_unique_length
    assert 0.018 < edges.mean() < 0.024
    assert edges.min() > 0.5 * edges.mean()
    assert edges.max() < 1.6 * edges.mean()
    assert np.degrees(surface.face_angles.min()) > 30


def test_vertices_lie_on_the_surface():
    np.testing.assert_allclose(np.linalg.norm(surfaces.sphere(0.25).vertices, axis=1), 0.25)
    x, y, z = surfaces.torus(0.22, 0.09).vertices.T
    np.testing.assert_allclose(np.hypot(np.hypot(x, y) - 0.22, z), 0.09)
    x, y, z = surfaces.cylinder(0.2, 0.4).vertices.T
    on_side = np.isclose(np.hypot(x, y), 0.2)
    on_cap = np.isclose(np.abs(z), 0.2)
    assert (on_side | on_cap).all()
    assert (on_side & on_cap).sum() == 2 * 6 * round(math.pi / 3 * 0.2 / 0.02)


@pytest.mark.parametrize(
    ("radius", "length", "resolution"), [(0.03, 0.2, 0.01), (0.05, 0.02, 0.02), (0.03, 0.3, 0.03)]
)
def test_capsules_of_all_sizes_are_even_and_true(radius, length, resolution):
    surface = surfaces.capsule(radius, length, resolution=resolution)
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.volume > 0
    x, y, z = surface.vertices.T
    along = np.clip(z, -length / 2, length / 2)
    np.testing.assert_allclose(np.linalg.norm([x, y, z - along], axis=0), radius)
    np.testing.assert_allclose(surface.bounds[:, 2], [-length / 2 - radius, length / 2 + radius])
    assert np.degrees(surface.face_angles.min()) > 40
    edges = surface.edges_unique_length
    assert edges.max() < 1.5 * edges.mean()


def test_cube_is_a_regular_grid_with_sharp_edges():
    surface = surfaces.cube(0.44)
    outermost = np.isclose(np.abs(surface.vertices), 0.22, rtol=0, atol=1e-12).sum(axis=1)
    # 21 x 21 inside each of 6 faces, 21 on each of 12 edges, 8 corners.
    np.testing.assert_array_equal(np.bincount(outermost), [0, 6 * 21**2, 12 * 21, 8])
    steps = surface.vertices / 0.02
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_resolution_sets_the_edge_length():
    for resolution in (0.01, 0.03):
        edges = surfaces.sphere(0.25, resolution=resolution).edges_unique_length
        assert edges.mean() == pytest.approx(resolution, rel=0.1)


def test_the_same_call_gives_the_same_bytes():
    first, again = surfaces.cylinder(0.2, 0.4), surfaces.cylinder(0.2, 0.4)
    assert first.vertices.tobytes() == again.vertices.tobytes()
    assert first.faces.tobytes() == again.faces.tobytes()


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl"])
def test_mesh_file_keeps_its_frame_refined_and_closed(tmp_path, suffix):
    path = tmp_path / f"box.{suffix}"
    box = trimesh.creation.box(extents=(0.4, 0.3, 0.2))
    box.apply_translation((1, 2, 3))
    box.export(path)
    surface = surfaces.mesh_file(path)
    assert surface.is_watertight
    np.testing.assert_allclose(surface.extents, (0.4, 0.3, 0.2), atol=1e-6)
    np.testing.assert_allclose(surface.bounds.mean(axis=0), (1, 2, 3), atol=1e-6)
    assert surface.volume == pytest.approx(0.024, rel=1e-5)
    assert surface.edges_unique_length.max() <= 0.028 + 1e-9


def test_mesh_file_is_scaled_about_its_origin(tmp_path):
    box = trimesh.creation.box(extents=(400, 300, 200))
    box.apply_translation((1000, 2000, 3000))
    box.export(tmp_path / "box.stl")
    surface = surfaces.mesh_file(tmp_path / "box.stl", scale=0.001)
    np.testing.assert_allclose(surface.bounds, [(0.8, 1.85, 2.9), (1.2, 2.15, 3.1)], atol=1e-6)


def test_mesh_file_simplifies_a_scan_in_place(tmp_path):
    path = tmp_path / "scan.ply"
    scan = trimesh.creation.icosphere(subdivisions=6, radius=0.25)
    rough = 1 + 1e-3 * np.random.default_rng(0).standard_normal((len(scan.vertices), 1))
    scan.vertices = scan.vertices * rough + (5, 0, 0)
    scan.export(path)
    with pytest.warns(closing.SimplifiedWarning) as caught:
        surface = surfaces.mesh_file(path, resolution=0.03)
    message = str(caught[0].message).replace(str(path), "FILE")
    assert message == (
        f"surface.mesh FILE was simplified from 81920 to {len(surface.faces)} triangles, for edges "
        "of 0.03 m"
    )
    assert surface.is_watertight
    assert surface.euler_number == 2
    assert 1500 < len(surface.faces) < 3500
    radius = np.linalg.norm(surface.vertices - (5, 0, 0), axis=1)
    np.testing.assert_allclose(radius, 0.25, rtol=0.01)
    assert hollow.hollow_skin(surface, 0.03).thickness == 0.03


def test_a_mesh_that_is_hardly_finer_than_asked_is_left_as_it_is(tmp_path, recwarn):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.25)
    ball.export(tmp_path / "ball.ply")
    surface = surfaces.mesh_file(tmp_path / "ball.ply", resolution=0.015)
    assert len(surface.faces) == 20480
    assert not recwarn


def test_mesh_file_turns_an_inverted_mesh_over(tmp_path):
    path = tmp_path / "inverted.stl"
    box = trimesh.creation.box(extents=(0.4, 0.4, 0.4))
    box.invert()
    assert box.volume < 0
    box.export(path)
    assert surfaces.mesh_file(path).volume == pytest.approx(0.064, rel=1e-5)


def _message(call, *args, **kwargs):
    with pytest.raises(ValueError, match=r"^surface\.") as caught:
        call(*args, **kwargs)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_wrong_dimensions_are_named():
    assert _message(surfaces.sphere, -1) == "surface.radius is -1; give positive lengths in metres"
    assert (
        _message(surfaces.cube, math.nan) == "surface.side is nan; give positive lengths in metres"
    )
    assert (
        _message(surfaces.cylinder, 0.2, 0)
        == "surface.height is 0; give positive lengths in metres"
    )
    assert (
        _message(surfaces.ellipsoid, (0.3, 0, 0.2))
        == "surface.semi_axes is (0.3, 0, 0.2); give positive lengths in metres"
    )
    assert (
        _message(surfaces.torus, 0.1, 0.2)
        == "surface.minor_radius is 0.2 m, which closes the hole of a torus with "
        "surface.major_radius 0.1 m; make it smaller"
    )
    assert (
        _message(surfaces.cube, 440)
        == "surface.resolution 0.02 m cuts it into 5808000000 triangles, more than 50000; "
        "give a coarser resolution, and all lengths in metres"
    )


def test_wrong_mesh_files_are_named(tmp_path):
    def message(name, content):
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            content.export(path)
        return _message(surfaces.mesh_file, path).replace(str(path), "FILE")

    box = trimesh.creation.box(extents=(0.4, 0.4, 0.4))
    lidless = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    far = box.copy()
    far.apply_translation((1, 0, 0))
    large = box.copy()
    large.apply_scale(1000)
    table = {
        ("none.obj", None): "does not exist; give the path of a mesh file",
        ("box.step", b""): "is not one of .obj, .ply, .stl; convert it",
        ("empty.obj", b"# no triangles\n"): "has no triangles; export it again as triangles",
        ("open.stl", lidless): "is open; close its holes so that it is watertight",
        ("two.stl", box + far): "has 2 pieces; join them into one",
        ("klein.ply", _klein_bottle()): "has no inside; orient all its triangles outwards",
        ("large.stl", large): "is 400 m across, which makes 5542562584 triangles at 0.02 m; "
        "set surface.scale, or a coarser surface.resolution",
    }
    for (name, content), expected in table.items():
        assert message(name, content) == f"surface.mesh FILE {expected}"
    unreadable = message("noise.ply", b"\x00\x01 not a mesh")
    assert unreadable.startswith("surface.mesh FILE cannot be read (")
    assert unreadable.endswith("); export it again")
    # A torus whose tube is wider than its ring runs through itself round its axis.
    spindle = trimesh.creation.torus(0.1, 0.15, major_sections=32, minor_sections=32)
    crossing = message("spindle.stl", spindle)
    assert crossing.startswith("surface.mesh FILE intersects itself near (")
    assert crossing.endswith("; repair it so that its surface never crosses itself")


def _klein_bottle() -> trimesh.Trimesh:
    """A closed surface without inside: a figure of eight, turned over on its way round."""
    size = 24
    u, v = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    a, b = 2 * np.pi * u / size, 2 * np.pi * v / size
    r = 0.3 + 0.1 * (np.cos(a / 2) * np.sin(b) - np.sin(a / 2) * np.sin(2 * b))
    z = 0.1 * (np.sin(a / 2) * np.sin(b) + np.cos(a / 2) * np.sin(2 * b))
    vertices = np.stack([r * np.cos(a), r * np.sin(a), z], axis=-1).reshape(-1, 3)
    vertices += 1e-3 * np.random.default_rng(0).standard_normal(vertices.shape)

    def index(i, j):
        wraps = i >= size
        return (i % size) * size + np.where(wraps, -j, j) % size

    corners = index(u, v), index(u + 1, v), index(u + 1, v + 1), index(u, v + 1)
    p, q, r, s = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([p, q, r], axis=1), np.stack([p, r, s], axis=1)])
    return trimesh.Trimesh(vertices, faces, process=False)


def test_self_intersection_is_found_where_it_is():
    below = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    across = np.array([[0.0, 0, -1], [0, 0, 1], [0, 3, 1]])
    faces = np.arange(6).reshape(2, 3)
    hit = first_self_intersection(np.concatenate([below, across]), faces)
    assert hit is not None
    for clear in ((2, 0, 0), (0, 0, 1.5), (0, 1.5, 0)):
        assert first_self_intersection(np.concatenate([below, across + clear]), faces) is None
