import numpy as np
import pytest
from bodies import along_sphere, cube, neighbours, sphere, torus
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.agent.representation import geodesics
from selftouch_drake.agent.shape import intrinsic_dimension


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
    assert intrinsic_dimension(np.minimum(steps, 300 - steps) * 1.0) == pytest.approx(1, abs=0.1)
    solid = np.stack(np.meshgrid(*3 * [np.arange(9.0)]), axis=-1).reshape(-1, 3)
    assert 2.5 < intrinsic_dimension(squareform(pdist(solid))) < 3.3


def test_too_few_kernels():
    with pytest.raises(ValueError, match="num_targets") as error:
        intrinsic_dimension(np.ones((49, 49)))
    assert str(error.value) == "num_targets is 49: give at least 50, to estimate a dimension"
