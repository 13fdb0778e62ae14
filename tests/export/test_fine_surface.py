"""Surfaces through touches: on what is curved and sharp, with a rim, and from too few."""

import numpy as np
import pytest
import trimesh
from made_up import sphere_points

from selftouch_drake.export import fine_surface
from selftouch_drake.export.fine_surface import fitted_to_touches


def pressed(place, normal, deepest, seed=0):
    """Places that lie up to so deep under a surface, or as far above it."""
    depth = np.random.default_rng(seed).uniform(-deepest, deepest, len(place))
    return place + depth[:, None] * normal


def deeper_on_one_side(place, normal, seed=0):
    """Touches that begin at a surface, and get 0.1 deep on one side of it, 0.02 on the other."""
    depth = np.random.default_rng(seed).uniform(0, 1, len(place))
    depth *= np.where(place[:, 0] > 0, 0.1, 0.02)
    return place - depth[:, None] * normal


def test_a_coarse_ball_becomes_round_wherever_touches_get():
    coarse = trimesh.creation.icosphere(subdivisions=1, radius=0.97)
    place, normal = sphere_points(4000)
    touches = deeper_on_one_side(place, normal)
    fine, below = fitted_to_touches(coarse, touches)
    assert fine.is_watertight
    assert fine.euler_number == 2
    assert len(fine.vertices) > 500
    far = np.linalg.norm(fine.vertices, axis=1)
    assert far.std() < 0.006  # touches are 0.04 deeper on one side, on average
    assert far.mean() == pytest.approx(1.0, abs=0.01)
    assert far.mean() - below == pytest.approx(np.linalg.norm(touches, axis=1).mean(), abs=0.002)


def test_edges_that_a_coarse_surface_cuts_off_come_back():
    box = trimesh.creation.box(extents=(2.0, 2.0, 2.0))
    place, face = trimesh.sample.sample_surface(box, 4000, seed=0)
    touches = pressed(place, box.face_normals[face], 0.03)
    cut = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    cut.vertices = cut.vertices * np.minimum(1 / np.abs(cut.vertices).max(axis=1), 1.25)[:, None]
    fine, _ = fitted_to_touches(cut, touches)
    edge = [
        np.linalg.norm(np.sort(np.abs(mesh.vertices))[:, 1:], axis=1).max() for mesh in (cut, fine)
    ]
    assert edge[0] < 1.25
    assert edge[1] > 1.36  # 1.414 if nothing is rounded
    assert fine.is_watertight


def test_a_rim_stays_and_few_touches_change_nothing():
    place, normal = sphere_points(4000)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.97)
    half = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] > 0])
    above = place[:, 2] > -0.1
    fine, _ = fitted_to_touches(half, pressed(place, normal, 0.03)[above])
    assert not fine.is_watertight
    assert len(fine.split(only_watertight=False)) == 1
    assert np.linalg.norm(fine.vertices, axis=1) == pytest.approx(1.03, abs=0.03)
    assert fine.vertices[:, 2].min() == pytest.approx(half.vertices[:, 2].min(), abs=0.05)
    assert fitted_to_touches(half, place[:9]) == (half, 0.0)


def test_a_surface_that_would_cross_itself_is_made_coarser_and_at_last_given_back(monkeypatch):
    place, _ = sphere_points(1000)
    ball, sizes, crossing = trimesh.creation.icosphere(subdivisions=1, radius=0.97), [], 2

    def first_crossing(vertices, faces):
        sizes.append(len(vertices))
        return vertices[0] if len(sizes) <= crossing else None

    monkeypatch.setattr(fine_surface, "first_self_intersection", first_crossing)
    assert len(fitted_to_touches(ball, place)[0].vertices) == sizes[2] < sizes[0]
    sizes, crossing = [], 99
    assert fitted_to_touches(ball, place) == (ball, 0.0)
