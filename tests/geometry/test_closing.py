import math
import re

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from selftouch_drake.geometry.closing import RepairedWarning, SimplifiedWarning, closed_surface
from selftouch_drake.geometry.hollow import hollow_skin
from selftouch_drake.geometry.surfaces import capsule, sphere
from selftouch_drake.geometry.triangles import first_self_intersection, sample_triangles


def _assert_closed_and_even(surface, resolution):
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert surface.body_count == 1
    assert surface.volume > 0
    edges = surface.edges_unique_length
    assert 0.7 * resolution < edges.mean() < 1.1 * resolution
    assert edges.max() < 2 * resolution
    assert np.degrees(np.quantile(surface.face_angles, 0.01)) > 19
    assert first_self_intersection(surface.vertices, surface.faces) is None


def _distance(surface, points):
    cloud, _ = sample_triangles(surface.triangles, 1e-3)
    return cKDTree(cloud).query(points)[0]


def _box(extents, at=(0, 0, 0)):
    box = trimesh.creation.box(extents)
    box.apply_translation(at)
    return box


@pytest.mark.parametrize("resolution", [0.012, 0.02])
def test_a_ball_stays_a_ball(resolution):
    surface = closed_surface([sphere(0.1, resolution=0.004)], resolution=resolution)
    _assert_closed_and_even(surface, resolution)
    radius = np.linalg.norm(surface.vertices, axis=1)
    np.testing.assert_allclose(radius, 0.1, rtol=0.01)


def test_a_box_keeps_its_edges():
    box = _box((0.2, 0.16, 0.3), at=(1, -2, 0.5))
    surface = closed_surface([box], resolution=0.015)
    _assert_closed_and_even(surface, 0.015)
    np.testing.assert_allclose(surface.bounds, box.bounds, atol=1e-9)
    assert surface.area == pytest.approx(box.area)
    assert surface.volume == pytest.approx(box.volume)


def _cylinder(radius, height):
    return trimesh.creation.cylinder(radius, height, sections=128)


@pytest.mark.filterwarnings("error::selftouch_drake.geometry.closing.SimplifiedWarning")
@pytest.mark.parametrize(
    ("pieces", "area"),
    [
        ([_box((0.1, 0.1, 0.1))], 0.06),
        ([_box((0.3, 0.2, 0.03))], 0.15),
        ([_cylinder(0.02, 0.3)], 2 * math.pi * 0.02 * 0.32),
        ([_cylinder(0.1, 0.05)], 2 * math.pi * 0.1 * 0.15),
        ([trimesh.creation.icosphere(4, 0.02)], 4 * math.pi * 0.02**2),
        ([trimesh.creation.capsule(0.2, 0.03, count=[64, 64])], 2 * math.pi * 0.03 * 0.26),
        # Three overlapping boxes in the shape of an L, 0.3 m long on either side.
        ([_box((0.1, 0.1, 0.3)), _box((0.3, 0.1, 0.1), at=(0.1, 0, 0.1))], 2 * 0.05 + 0.12),
    ],
)
def test_the_area_is_kept_at_a_coarse_resolution_with_a_skin_below_it(pieces, area):
    surface = closed_surface(pieces, resolution=0.03, thickness=0.01)
    assert surface.area == pytest.approx(area, rel=0.02)
    hollow_skin(surface, 0.01)


def _said(pieces, kind=RepairedWarning, **options):
    with pytest.warns(kind) as caught:
        surface = closed_surface(pieces, resolution=0.03, **options)
    return str(caught[0].message), surface


def test_holes_and_inward_normals_are_said_and_mended():
    inward = _box((0.1, 0.1, 0.1))
    inward.invert()
    text, surface = _said([inward])
    assert text == "surface: 1 piece with normals that point inwards was turned outwards"
    assert surface.area == pytest.approx(0.06)
    holed = _box((0.1, 0.1, 0.1))
    holed.update_faces(np.abs(holed.face_normals[:, 2]) < 0.5)
    text, surface = _said([holed])
    assert text == "surface: 2 holes were closed by flat lids"
    assert surface.area == pytest.approx(0.06)
    mixed = _box((0.1, 0.1, 0.1))
    mixed.faces[::3] = mixed.faces[::3, ::-1]
    text, surface = _said([mixed])
    assert text == "surface: 4 triangles that faced inwards, among others that did not, were turned"
    assert surface.volume == pytest.approx(0.001)


def test_what_rounding_costs_is_said():
    # No skin of 2 cm fits under a plate of 3 cm.
    plate = [_box((0.1, 0.1, 0.1)), _box((0.3, 0.3, 0.03))]
    text, _ = _said(plate, SimplifiedWarning, thickness=0.018)
    assert re.match(r"surface keeps \d\d% of the volume and \d\d% of the area of the link's", text)
    assert text.endswith("give a finer surface.resolution, or a thinner skin")


def test_pieces_that_overlap_touch_or_nest_become_one():
    pieces = [
        _box((0.1, 0.1, 0.3)),
        _box((0.3, 0.1, 0.1), at=(0.1, 0, 0.1)),  # overlaps
        _box((0.1, 0.1, 0.1), at=(0, 0, -0.2)),  # touches
        _box((0.02, 0.02, 0.02)),  # inside the first one
    ]
    surface = closed_surface(pieces, resolution=0.015)
    _assert_closed_and_even(surface, 0.015)
    assert surface.euler_number == 2
    assert surface.volume == pytest.approx(0.003 + 0.002 + 0.001, rel=0.05)


def test_a_cavity_is_filled():
    inside = sphere(0.06)
    inside.invert()
    surface = closed_surface([trimesh.util.concatenate([sphere(0.1), inside])], resolution=0.02)
    assert surface.volume == pytest.approx(4 / 3 * math.pi * 0.1**3, rel=0.03)


def test_a_handle_stays():
    ring = trimesh.creation.torus(0.1, 0.03)
    surface = closed_surface([ring], resolution=0.012)
    _assert_closed_and_even(surface, 0.012)
    assert surface.euler_number == 0


def test_an_open_tube_gets_lids():
    tube = trimesh.creation.cylinder(radius=0.05, height=0.3, sections=64)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    assert not tube.is_watertight
    surface = closed_surface([tube], resolution=0.012)
    _assert_closed_and_even(surface, 0.012)
    assert surface.volume == pytest.approx(math.pi * 0.05**2 * 0.3, rel=0.04)


def test_loose_triangles_become_their_hull():
    # A box of 12 triangles, each a piece of its own and shrunk: nothing that lids could close.
    box = _box((0.2, 0.2, 0.2))
    corners = box.triangles
    corners = corners.mean(axis=1, keepdims=True) + 0.9 * (corners - corners.mean(1, keepdims=True))
    loose = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    surface = closed_surface([loose], resolution=0.02)
    _assert_closed_and_even(surface, 0.02)
    assert surface.volume == pytest.approx(loose.convex_hull.volume, rel=0.06)


def test_edges_shared_by_four_triangles_and_inverted_pieces_do_no_harm():
    # Two boxes that share an edge, merged, one inside out: as in many CAD exports.
    other = _box((0.1, 0.1, 0.1), at=(0.1, 0.1, 0))
    other.invert()
    both = _box((0.1, 0.1, 0.1)) + other + _box((0.1, 0.1, 0.1), at=(0.05, 0.05, 0))
    both.merge_vertices()
    surface = closed_surface([both], resolution=0.012)
    _assert_closed_and_even(surface, 0.012)
    assert surface.volume == pytest.approx(0.0025, rel=0.06)


def test_parts_that_do_not_touch_are_named():
    with pytest.raises(ValueError, match=r"^surface has 2 parts") as caught:
        closed_surface([_box((0.1, 0.1, 0.1)), _box((0.1, 0.1, 0.1), at=(0.3, 0, 0))])
    message = str(caught.value)
    assert message.startswith(
        "surface has 2 parts that do not touch each other, or only where they are thinner than "
        "0.028 m: near (0.00"
    )
    assert ") and (0.30" in message
    assert message.endswith(") m; give a mesh file that joins them, or a finer resolution")


def test_what_cannot_be_made_is_named():
    def message(*args, **kwargs):
        with pytest.raises(ValueError, match=r"^surface") as caught:
            closed_surface(*args, **kwargs)
        return str(caught.value)

    box = _box((0.2, 0.2, 0.01))
    assert message([]) == "surface has no triangles; choose a shape, or another link"
    assert message([box], resolution=0.0) == (
        "surface.resolution is 0.0; give a positive length in metres"
    )
    assert message([box], thickness=0.01) == (
        "surface is thinner than 0.028 m everywhere, too thin for triangles of 0.02 m and a skin "
        "of 0.01 m; give a finer surface.resolution, or a thinner skin"
    )
    assert message([_box((200, 200, 200))]) == (
        "surface.resolution is too fine for geometry 200 m across: it needs 3e+13 cells; give "
        "a coarser one, and all lengths in metres"
    )


def test_thin_parts_are_left_out_with_a_warning():
    hammer = [_box((0.1, 0.1, 0.1)), _box((0.4, 0.1, 0.01), at=(0.2, 0, 0))]
    with pytest.warns(SimplifiedWarning, match=r"keeps [56]\d% of the volume"):
        surface = closed_surface(hammer, resolution=0.02, thickness=0.01)
    assert surface.volume == pytest.approx(0.001, rel=0.2)
    assert surface.extents.max() < 0.12


# A limb as robots have: a tube, a joint across it, a hollow, and a thin fin.
def _limb():
    tube = trimesh.creation.cylinder(radius=0.035, height=0.2, sections=40)
    joint = trimesh.creation.cylinder(radius=0.04, height=0.09, sections=40)
    joint.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (1, 0, 0)))
    joint.apply_translation((0, 0, 0.1))
    return [tube, joint, _box((0.004, 0.12, 0.1)), _box((0.08, 0.05, 0.03), at=(0, 0, -0.1))]


@pytest.mark.filterwarnings("ignore::selftouch_drake.geometry.closing.SimplifiedWarning")
@pytest.mark.parametrize("resolution", [0.013, 0.02, 0.03])
@pytest.mark.parametrize("thickness", [0.005, 0.01, 0.015])
def test_a_skin_fits_under_it(resolution, thickness):
    surface = closed_surface(_limb(), resolution=resolution, thickness=thickness)
    assert surface.is_watertight
    skin = hollow_skin(surface, thickness)
    gap = np.linalg.norm(skin.inner_vertices - skin.vertices, axis=1)
    assert gap.min() > 0.9 * thickness


def test_the_same_call_gives_the_same_bytes():
    first, again = (closed_surface([capsule(0.05, 0.2)], resolution=0.02) for _ in range(2))
    assert first.vertices.tobytes() == again.vertices.tobytes()
    assert first.faces.tobytes() == again.faces.tobytes()
