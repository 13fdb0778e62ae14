"""Surfaces through touches: on what is curved and sharp, with a rim, and from too few."""

import numpy as np
import pytest
import trimesh
from made_up import sphere_points

from selftouch_drake.export.fine_surface import fitted_to_touches


def pressed(place, normal, deepest, seed=0):
    """Places that lie up to so deep under a surface, or as far above it."""
    depth = np.random.default_rng(seed).uniform(-deepest, deepest, len(place))
    return place + depth[:, None] * normal


def test_a_coarse_ball_becomes_round():
    coarse = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    place, normal = sphere_points(6000)
    fine = fitted_to_touches(coarse, pressed(place, normal, 0.05))
    assert fine.is_watertight
    assert fine.euler_number == 2
    assert len(fine.vertices) > 500
    far = np.linalg.norm(fine.vertices, axis=1)
    assert np.sqrt(np.square(far - 1.0).mean()) < 0.006  # touches are 0.03 off
    assert abs(far.mean() - 1.0) < 0.002
    middle = np.linalg.norm(coarse.triangles_center, axis=1)
    assert middle.min() < 0.95


def test_edges_that_a_coarse_surface_cuts_off_come_back():
    box = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    place, face = trimesh.sample.sample_surface(box, 8000, seed=0)
    touches = pressed(place, box.face_normals[face], 0.03)
    # Its edges are cut off by 0.2.
    cut = trimesh.convex.convex_hull(
        [p for p in box.subdivide().subdivide().subdivide().vertices if np.abs(p).sum() < 2.6]
    )
    off = [np.abs(np.abs(mesh.vertices).max(axis=1) - 1.0) for mesh in (cut, fitted_to_touches(cut, touches))]
    assert off[0].max() > 3 * off[1].max()


def test_a_rim_stays_and_few_touches_change_nothing():
    place, normal = sphere_points(4000)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.97)
    half = ball.slice_plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    above = place[:, 2] > 0
    fine = fitted_to_touches(half, pressed(place, normal, 0.03)[above])
    assert not fine.is_watertight
    assert len(fine.split(only_watertight=False)) == 1
    assert np.linalg.norm(fine.vertices, axis=1) == pytest.approx(1.0, abs=0.03)
    assert fitted_to_touches(half, place[:9]) is half
