import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from selftouch_drake.geometry.patches import betti_of_patch, touched_patch
from selftouch_drake.geometry.surfaces import sphere, torus

SPHERE = sphere(0.25, resolution=0.03)
TORUS = torus(0.22, 0.09, resolution=0.03)


def _betti_by_rank(faces):
    """From the ranks of the boundary maps with coefficients in Z/2: the definition."""
    edges, edge_of = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
        axis=0,
        return_inverse=True,
    )
    corners, edge_ends = np.unique(edges, return_inverse=True)
    first = np.zeros((len(corners), len(edges)), dtype=bool)
    first[edge_ends.reshape(-1, 2), np.arange(len(edges))[:, None]] = True
    second = np.zeros((len(edges), len(faces)), dtype=bool)
    second[edge_of.reshape(-1, 3), np.arange(len(faces))[:, None]] = True
    rank1, rank2 = _rank(first), _rank(second)
    return len(corners) - rank1, len(edges) - rank1 - rank2, len(faces) - rank2


def _rank(matrix):
    matrix, rank = matrix.copy(), 0
    for column in range(matrix.shape[1]):
        pivot = np.flatnonzero(matrix[rank:, column])
        if len(pivot):
            row = rank + pivot[0]
            matrix[[rank, row]] = matrix[[row, rank]]
            below = rank + 1 + np.flatnonzero(matrix[rank + 1 :, column])
            matrix[below] ^= matrix[rank]
            rank += 1
    return rank


def _patch(surface, touched):
    """The triangles that were touched all over."""
    return surface.faces[touched[surface.faces].all(axis=1)]


def _shapes():
    z = SPHERE.vertices[:, 2]
    x, y = TORUS.vertices[:, :2].T
    top, belt = _patch(SPHERE, z > 0.1), _patch(SPHERE, np.abs(z) < 0.1)
    caps = _patch(SPHERE, np.abs(z) > 0.1)
    two = np.concatenate([SPHERE.faces, top + len(SPHERE.vertices)])
    return {
        "sphere": (SPHERE.faces, (1, 0, 1)),
        "torus": (TORUS.faces, (1, 2, 1)),
        "disc": (top, (1, 0, 0)),
        "tube": (belt, (1, 1, 0)),
        "two discs": (caps, (2, 0, 0)),
        "sphere and disc": (two, (2, 0, 1)),
        "half torus": (_patch(TORUS, x > 0), (1, 1, 0)),
        "torus with a hole": (_patch(TORUS, np.hypot(x - 0.31, y) > 0.06), (1, 2, 0)),
        "sphere with two holes": (_patch(SPHERE, np.abs(z) < 0.22), (1, 1, 0)),
        "two spheres at one vertex": (
            np.concatenate([SPHERE.faces, np.where(SPHERE.faces, SPHERE.faces + 9999, 0)]),
            (1, 0, 2),
        ),
        "nothing": (np.empty((0, 3), dtype=int), (0, 0, 0)),
    }


@pytest.mark.parametrize("name", _shapes())
def test_holes_of_known_shapes(name):
    faces, expected = _shapes()[name]
    assert betti_of_patch(faces) == expected


@pytest.mark.parametrize("seed", range(5))
def test_holes_of_ragged_patches_are_those_of_the_definition(seed):
    ball = trimesh.creation.icosphere(subdivisions=2)
    touched = np.random.default_rng(seed).random(len(ball.vertices)) < 0.8
    faces = _patch(ball, touched)
    assert betti_of_patch(faces) == _betti_by_rank(faces)


FINE = sphere(0.25, resolution=0.012)


def _sampled(allowed, num_touches, seed=0):
    """Touches at random places on a sphere of 0.25 m, where `allowed(p)` says so."""
    rng = np.random.default_rng(seed)
    p = rng.standard_normal((num_touches, 3))
    p *= 0.25 / np.linalg.norm(p, axis=1, keepdims=True)
    _, nearest = cKDTree(FINE.vertices).query(p[allowed(p)])
    return np.bincount(nearest, minlength=len(FINE.vertices))


@pytest.mark.parametrize(("num_touches", "radius"), [(2500, 0.04), (10_000, 0.02)])
def test_gaps_between_few_touches_are_no_holes(num_touches, radius):
    counts = _sampled(lambda p: p[:, 2] > -0.15, num_touches)
    ragged = _patch(FINE, counts > 0)
    assert betti_of_patch(ragged) != (1, 0, 0)
    touched = touched_patch(FINE.vertices, FINE.faces, counts, radius=radius)
    assert touched[counts > 0].all()
    assert betti_of_patch(_patch(FINE, touched)) == (1, 0, 0)
    assert FINE.vertices[touched, 2].min() > -0.16


def test_a_hole_wider_than_the_disc_stays_as_wide_as_it_was():
    def beside_the_hole(p):
        return np.linalg.norm(p - (0.25, 0, 0), axis=1) > 0.06

    touched = touched_patch(
        FINE.vertices, FINE.faces, _sampled(beside_the_hole, 20_000), radius=0.03
    )
    # A sphere with one hole is a disc.
    faces = _patch(FINE, touched)
    assert betti_of_patch(faces) == (1, 0, 0)
    rim = np.linalg.norm(FINE.vertices[faces] - (0.25, 0, 0), axis=2).min()
    assert 0.045 < rim < 0.07
    wider = touched_patch(FINE.vertices, FINE.faces, _sampled(beside_the_hole, 20_000), radius=0.08)
    assert wider.all()


def test_stray_touches_are_no_parts():
    counts = _sampled(lambda p: p[:, 2] > 0, 5000)
    counts[FINE.vertices[:, 2].argmin()] = 1
    touched = touched_patch(FINE.vertices, FINE.faces, counts, radius=0.03)
    assert betti_of_patch(_patch(FINE, touched)) == (1, 0, 0)
    assert FINE.vertices[touched, 2].min() > -0.03


def test_no_touch_is_no_patch():
    none = np.zeros(len(FINE.vertices), dtype=int)
    assert not touched_patch(FINE.vertices, FINE.faces, none, radius=0.03).any()


def test_a_radius_below_the_edges_is_refused():
    counts = np.ones(len(FINE.vertices))
    with pytest.raises(ValueError, match=r"^radius is 0\.001 m, less than the mean edge"):
        touched_patch(FINE.vertices, FINE.faces, counts, radius=0.001)
