"""Surfaces of skins and touchers."""

import dataclasses

import numpy as np
import pytest
import trimesh
from made_up import made_up_model, sphere_points

from selftouch_drake.export.surface import (
    PartSurface,
    part_surface,
    toucher_surface,
    with_receptors_on,
)


def on_a_ball(keep=lambda normal: np.ones(len(normal), dtype=bool), number=300):
    """A model whose one part lies on a ball, or on some of it."""
    place, normal = sphere_points(number, 2.0, (1.0, 0.0, 0.0))
    kept = keep(normal)
    return made_up_model(
        kernel_part=np.zeros(kept.sum(), dtype=int), kernel_place=place[kept],
        kernel_normal=normal[kept], part_link=np.array([-1]), accepted_by_part=np.array([True]),
        held_out=np.ones(1), inliers=np.ones(1), criterion=np.ones(1), num_touches=np.array([9]),
        receptor_part=np.full(5, -1),
    )  # fmt: skip


def test_a_closed_skin_is_a_closed_surface_that_looks_outward():
    mesh = part_surface(on_a_ball(), 0).mesh
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 8, rel=0.05)


@pytest.mark.parametrize(("depth", "radius"), [(0.25, 2.25), (-0.25, 1.75)])
def test_the_surface_is_above_the_centres_by_their_depth(depth, radius):
    mesh = part_surface(on_a_ball(), 0).raised(depth)
    far = np.linalg.norm(mesh.vertices - [1.0, 0.0, 0.0], axis=1)
    np.testing.assert_allclose(far, radius, rtol=0.01)


def test_a_patch_of_skin_has_a_rim_and_looks_outward():
    mesh = part_surface(on_a_ball(lambda normal: normal[:, 2] > 0.4), 0).mesh
    assert not mesh.is_watertight
    outward = np.einsum("fi,fi->f", mesh.face_normals, mesh.triangles_center - [1.0, 0.0, 0.0])
    assert (outward > 0).all()


def test_there_is_no_surface_through_a_plane_or_a_few_places():
    flat = on_a_ball()
    flat = dataclasses.replace(flat, kernel_place=flat.kernel_place * [1.0, 1.0, 0.0])
    assert part_surface(flat, 0) is None
    assert part_surface(on_a_ball(number=9), 0) is None
    assert part_surface(dataclasses.replace(on_a_ball(), dimension=2), 0) is None


def test_receptors_lie_on_the_surface_that_touches_tell_and_look_outward():
    model = on_a_ball()
    outward = model.kernel_normal[:5]
    # The mean of touches about a place of a ball lies below it; sides were guessed.
    place = 1.7 * outward + [1.0, 0.0, 0.0]
    wrong = outward * [[1], [-1], [1], [-1], [np.nan]]
    model = dataclasses.replace(
        model, receptor_part=np.array([0, 0, 0, 0, -1]), receptor_place=place, receptor_normal=wrong
    )
    place, normal = sphere_points(3000)
    depth = np.random.default_rng(0).uniform(0.0, 0.1, (3000, 1))
    surface = part_surface(model, 0, (2.0 - depth) * normal + [1.0, 0.0, 0.0])
    found = with_receptors_on(model, {0: surface})
    far = np.linalg.norm(found.receptor_place - [1.0, 0.0, 0.0], axis=1)
    np.testing.assert_allclose(far[:4], 1.95, atol=0.01)
    assert np.einsum("ni,ni->n", found.receptor_normal, outward)[:4].min() > 0.98
    assert far[4] == pytest.approx(1.7)
    assert np.linalg.norm(surface.raised(0.05).vertices - [1.0, 0, 0], axis=1) == pytest.approx(
        2.0, abs=0.02
    )


def test_a_mirror_image_of_a_surface_looks_outward():
    surface = part_surface(on_a_ball(), 0).similar(metres=0.5, mirrored=True)
    assert surface.mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.05)
    assert surface.mesh.vertices.mean(axis=0) == pytest.approx([-0.5, 0.0, 0.0], abs=0.02)


def test_a_toucher_is_a_ball_or_what_its_shape_says():
    ball = toucher_surface(np.zeros(5), 0.01)
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 0.01)
    shape = np.array([0.002, 0.0, 0.0, 0.0, 0.0])  # longer along x, shorter along y
    np.testing.assert_allclose(
        toucher_surface(shape, 0.01).extents, [0.024, 0.016, 0.02], atol=1e-4
    )


def test_a_receptor_where_no_toucher_came_lies_where_the_surface_would_go_on():
    box = trimesh.creation.box((2, 2, 1))
    top = box.submesh([box.face_normals[:, 2] > 0.9], append=True)
    places, normals = PartSurface(mesh=top).nearest(np.array([[1.5, 0.2, 0.7], [0.3, 0.2, 0.1]]))
    np.testing.assert_allclose(places, [[1.5, 0.2, 0.5], [0.3, 0.2, 0.5]], atol=1e-12)
    np.testing.assert_allclose(normals, [[0, 0, 1], [0, 0, 1]], atol=1e-12)
