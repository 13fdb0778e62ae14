import numpy as np
import pytest
from bodies_by_hand import along_sphere, cube, neighbours, shape_error, sphere, torus
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist, squareform
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from selftouch_drake.quotient.layout import (
    classical_embedding,
    curvature_corrected_mds,
    stress_embedding,
)
from selftouch_drake.quotient.paths import geodesics


@settings(max_examples=20, deadline=None)
@given(st.integers(5, 40), st.integers(0, 99))
def test_straight_distances_are_laid_out_exactly(num_points, seed):
    points = np.random.default_rng(seed).normal(size=(num_points, 3))
    distances = squareform(pdist(points))
    classical, stressed = classical_embedding(distances), stress_embedding(distances)
    for found in (classical, stressed):
        assert found.stress < 1e-6
        np.testing.assert_allclose(found.positions.mean(axis=0), 0.0, atol=1e-8)
        np.testing.assert_allclose(squareform(pdist(found.positions)), distances, atol=1e-2)
        assert found.spectrum[0] == 1.0
        assert abs(found.spectrum[3]) < 1e-9


def test_a_sphere_from_exact_geodesics():
    points = sphere(200, radius=0.25)
    found = stress_embedding(along_sphere(points))
    assert shape_error(found.positions, points) < 0.005
    # Great circles do not fit in three dimensions, as the fourth eigenvalue shows.
    assert 0.02 < found.spectrum[3] < 0.2


def test_the_start_of_lowest_stress_is_finished():
    points = torus(200)
    edges, length = neighbours(points, 12)
    distances = geodesics(edges, length, len(points))
    found = stress_embedding(distances)
    alone = [stress_embedding(distances, last_axes=[axis]) for axis in range(4)]
    assert shape_error(found.positions, points) < 0.02
    assert found.stress == pytest.approx(min(one.stress for one in alone), rel=1e-6)
    assert max(one.stress for one in alone) > 2 * found.stress


def test_majorisation_never_loses_to_its_start():
    distances = along_sphere(sphere(60))
    short = stress_embedding(distances, num_trial_iterations=1, num_iterations=1)
    long = stress_embedding(distances, num_trial_iterations=1, num_iterations=60)
    assert long.stress <= short.stress


def test_units_do_not_matter():
    distances = along_sphere(sphere(60))
    metres, millimetres = stress_embedding(distances), stress_embedding(1000 * distances)
    np.testing.assert_allclose(
        pdist(1000 * metres.positions), pdist(millimetres.positions), rtol=1e-3
    )
    assert metres.stress == pytest.approx(millimetres.stress, rel=1e-6)


def test_the_number_of_threads_does_not_matter():
    distances = along_sphere(sphere(300))
    found = []
    for num_threads in (1, 2):
        with threadpool_limits(num_threads, user_api="blas"):
            found.append(stress_embedding(distances).positions)
    np.testing.assert_array_equal(*found)


def test_any_pose_is_the_same_body():
    points = torus(80)
    turned = points @ Rotation.from_euler("xyz", [1, 2, 3]).as_matrix().T + 5.0
    assert shape_error(turned, points) < 1e-9


def test_a_layout_unbends_a_cube():
    points = cube(300)
    edges, length = neighbours(points, 12)
    distances = geodesics(edges, length, len(points))
    errors = [
        shape_error(curvature_corrected_mds(edges, distances, most_passes=n).positions, points)
        for n in (0, 1, 3)
    ]
    assert errors[0] > 1.2 * errors[1] > 1.2 * errors[2]
    np.testing.assert_array_equal(
        curvature_corrected_mds(edges, distances, most_passes=0).positions,
        stress_embedding(distances).positions,
    )


@pytest.mark.parametrize("dimension", [2, 3, 4])
def test_points_are_laid_out_in_as_many_dimensions_as_are_asked_for(dimension):
    points = np.random.default_rng(0).normal(size=(50, dimension))
    distances = squareform(pdist(points))
    for found in (
        classical_embedding(distances, dimension),
        stress_embedding(distances, dimension=dimension),
    ):
        assert found.positions.shape == (50, dimension)
        np.testing.assert_allclose(squareform(pdist(found.positions)), distances, atol=1e-2)


def test_errors():
    with pytest.raises(ValueError, match="num_targets") as error:
        stress_embedding(np.ones((3, 3)) - np.eye(3))
    assert str(error.value) == "num_targets is 3: give at least 4, to lay out a body in space"
    apart = geodesics(np.array([[0, 1], [2, 3]]), np.ones(2), 4)
    with pytest.raises(ValueError, match="infinite") as error:
        stress_embedding(apart)
    assert (
        str(error.value) == "distances are infinite where no path exists: connect the graph first"
    )
