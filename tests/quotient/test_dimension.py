import numpy as np
import pytest
from bodies_by_hand import (
    along_sphere,
    bowl,
    cube,
    flat_torus,
    neighbours,
    patch,
    ring,
    sphere,
    square,
    torus,
    trefoil,
)
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.quotient.dimension import intrinsic_dimension, skin_dimension, space_dimension
from selftouch_drake.quotient.graph import neighbour_edges
from selftouch_drake.quotient.layout import curvature_corrected_mds
from selftouch_drake.quotient.paths import geodesics


def measured(points, noise=0.05, seed=0):
    """Edges between neighbours and distances along them, with lengths wrong by a share."""
    apart = squareform(pdist(points))
    edges = neighbour_edges(apart)
    error = np.exp(noise * np.random.default_rng(seed).standard_normal(len(edges)))
    return edges, geodesics(edges, apart[edges[:, 0], edges[:, 1]] * error, len(points))


def dimensions(points, **kwargs):
    """Dimension of the skin and of the space that are found."""
    edges, distances = measured(points, **kwargs)
    skin = skin_dimension(distances)
    layout = curvature_corrected_mds(edges, distances, dimension=skin + 1)
    return skin, space_dimension(edges, distances, layout, skin)


@pytest.mark.parametrize(
    ("line", "num_points"), [(ring, 13), (ring, 40), (ring, 150), (trefoil, 200)]
)
def test_a_line_has_one_dimension_and_lies_in_a_plane(line, num_points):
    assert dimensions(line(num_points), noise=0.1) == (1, 2)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.15])
@pytest.mark.parametrize("num_points", [20, 150])
@pytest.mark.parametrize("body", [sphere, cube, torus])
def test_a_closed_surface_needs_three_dimensions_however_noisy(body, num_points, noise):
    assert dimensions(body(num_points), noise=noise) == (2, 3)


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_a_flat_patch_needs_two_dimensions_and_a_bowl_three(noise):
    assert dimensions(square(150), noise=noise) == (2, 2)
    assert dimensions(bowl(150), noise=noise) == (2, 3)


def test_a_bent_sheet_is_flat_to_who_knows_distances_along_it():
    assert dimensions(patch(12), noise=0.02) == (2, 2)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_flat_torus_needs_four_dimensions(noise):
    assert dimensions(flat_torus(150), noise=noise) == (2, 4)


@pytest.mark.parametrize("body", [sphere, cube, torus])
@pytest.mark.parametrize("num_points", [60, 100, 300, 1000])
def test_surfaces_have_two(body, num_points):
    edges, length = neighbours(body(num_points), 8)
    assert 1.8 < intrinsic_dimension(geodesics(edges, length, num_points)) < 2.4


def test_exact_geodesics_of_a_sphere():
    assert intrinsic_dimension(along_sphere(sphere(500))) == pytest.approx(2.0, abs=0.15)


def test_a_ring_has_one_and_a_solid_three():
    angle = np.arange(300)
    steps = np.abs(angle[:, None] - angle)
    around = np.minimum(steps, 300 - steps) * 1.0
    assert intrinsic_dimension(around, 1) == pytest.approx(1, abs=0.05)
    assert intrinsic_dimension(around[::3, ::3], 1) == pytest.approx(1, abs=0.1)
    solid = np.stack(np.meshgrid(*3 * [np.arange(9.0)]), axis=-1).reshape(-1, 3)
    assert 2.5 < intrinsic_dimension(squareform(pdist(solid))) < 3.3


def test_too_few_kernels():
    with pytest.raises(ValueError, match="num_targets") as error:
        intrinsic_dimension(np.ones((49, 49)))
    assert str(error.value) == "num_targets is 49: give at least 50, to estimate a dimension"
