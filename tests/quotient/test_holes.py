import time

import numpy as np
import pytest
from bodies_by_hand import cube, patch, ring, sphere, square, torus
from hypothesis import given, settings
from hypothesis import strategies as st
from ripser import ripser
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from selftouch_drake.quotient.alpha import alpha_filtration, circumspheres
from selftouch_drake.quotient.holes import topology


@pytest.mark.parametrize(
    ("points", "betti", "least_margin"),
    [
        (sphere(200), (1, 0, 1), 5.0),
        (cube(300), (1, 0, 1), 5.0),
        (torus(300), (1, 2, 1), 2.0),
        (torus(1000), (1, 2, 1), 4.0),
        (torus(600, tube=0.06), (1, 2, 1), 2.0),
        (np.vstack([sphere(120), sphere(120) + np.array([5, 0, 0])]), (2, 0, 2), 3.0),
        (np.vstack([sphere(150), torus(300, 2.2, 0.9) + np.array([9, 0, 0])]), (2, 2, 2), 1.5),
        (patch(15), (1, 0, 0), 1.2),
        (square(200)[:, :2], (1, 0, 0), 1.2),
        (ring(30)[:, :2], (1, 1, 0), 5.0),
    ],
    ids=[
        *("sphere", "cube", "torus", "fine", "thin", "two spheres", "sphere and torus", "patch"),
        *("flat", "ring"),
    ],
)
def test_bodies_of_known_topology(points, betti, least_margin):
    found = topology(points)
    assert found.betti == betti
    assert found.margin > least_margin


@pytest.mark.parametrize("points", [sphere(200), cube(300), torus(300), torus(1000)])
def test_the_margin_is_the_shortest_hole_over_the_longest_false_one(points):
    found = topology(points)
    bars = np.concatenate(found.diagram[1:])
    falling = np.sort(bars[:, 1] - bars[:, 0])[::-1]
    num_holes = sum(found.betti[1:])
    # Lengths are in spacings around the place, which vary a little.
    assert found.margin == pytest.approx(falling[num_holes - 1] / falling[num_holes], rel=0.25)


@settings(max_examples=10, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(0, 99))
def test_size_order_and_a_little_noise_do_not_matter(size, seed):
    rng = np.random.default_rng(seed)
    points = rng.permutation(sphere(150) + rng.normal(scale=0.01, size=(150, 3)))
    here, there = topology(points), topology(size * points)
    assert here.betti == there.betti == (1, 0, 1)
    assert there.scale == pytest.approx(size * here.scale, rel=1e-3)


def test_a_hole_left_by_one_missing_kernel_is_no_loop():
    points = sphere(300)
    assert topology(np.delete(points, 150, axis=0)).betti == (1, 0, 1)


def test_a_stretch_of_skin_that_feels_alike_is_no_loop():
    points = torus(1000)
    for middle in points[[100, 500, 800]]:
        alike = np.argsort(np.linalg.norm(points - middle, axis=1))[:12]
        points = np.vstack([np.delete(points, alike, axis=0), middle])
    found = topology(points)
    assert found.betti == (1, 2, 1)
    assert found.margin > 2.0


def test_gaps_of_a_closed_body_are_no_loops():
    points = torus(1000)
    for middle in points[[100, 500, 800]]:
        missing = np.argsort(np.linalg.norm(points - middle, axis=1))[:6]
        points = np.delete(points, missing, axis=0)
    found = topology(points)
    assert found.betti == (1, 2, 1)
    _, loops, ((closed, _), *_) = (
        bars[np.argsort(bars[:, 0] - bars[:, 1])] for bars in found.diagram
    )
    length = loops[:, 1] - loops[:, 0]
    # Of three gaps in a closed surface, two leave a loop; each is filled before the void is born.
    assert (length[2:4] > 1.3 * found.meeting_radius).all()
    assert (loops[2:4, 1] <= closed).all()
    assert found.margin == pytest.approx(length[1] / length[2], rel=0.25)


def test_a_gap_whose_bar_is_longer_than_that_of_the_void_is_no_loop():
    """A ball that was not touched about its poles: one gap fills, the other closes the body."""
    for points in (sphere(70), sphere(80), sphere(90)):
        found = topology(points[np.abs(points[:, 2]) < 0.8])
        assert found.betti == (1, 0, 1)
        assert found.margin < 1.0


def test_an_open_bowl_is_no_void():
    points = sphere(400)
    bowl = points[points[:, 2] < 0.7]
    assert topology(bowl).betti == (1, 0, 0)


def test_a_pipe_open_at_both_ends_is_one_loop():
    points = sphere(400)
    pipe = points[np.abs(points[:, 2]) < 0.7]
    assert topology(pipe).betti == (1, 1, 0)


def test_a_tetrahedron_by_hand():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    points = np.vstack([corners, [[50, 0, 0.0]]])
    h0, h1, h2 = topology(points).diagram
    edge = np.sqrt(2)
    # Edges of length 2 sqrt(2) meet half way, faces close at their circumradius sqrt(8 / 3), and
    # the void is filled at the circumradius sqrt(3).
    np.testing.assert_allclose(np.sort(h0[:, 1])[:3], edge, rtol=1e-4)
    assert np.isinf(h0[:, 1]).sum() == 1
    np.testing.assert_allclose(h1[:3], [[edge, np.sqrt(8 / 3)]] * 3, rtol=1e-4)
    np.testing.assert_allclose(h2, [[np.sqrt(8 / 3), np.sqrt(3)]], rtol=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.integers(6, 40), st.integers(0, 99))
def test_h0_is_the_minimum_spanning_tree(num_points, seed):
    points = np.random.default_rng(seed).normal(size=(num_points, 3))
    h0, _, _ = topology(points).diagram
    tree = minimum_spanning_tree(squareform(pdist(points))).data
    np.testing.assert_allclose(np.sort(h0[:-1, 1]), np.sort(tree) / 2, atol=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.integers(6, 30), st.integers(0, 99))
def test_the_filtration_is_valid(num_points, seed):
    points = np.random.default_rng(seed).normal(size=(num_points, 3))
    appears = alpha_filtration(points)
    for simplex, value in appears.items():
        for left_out in simplex if len(simplex) > 1 else ():
            face = tuple(v for v in simplex if v != left_out)
            assert appears[face] <= value * (1 + 1e-9)
    # The Euler characteristic of a triangulated ball.
    counts = np.bincount([len(simplex) for simplex in appears])[1:]
    assert counts @ [1, -1, 1, -1] == 1


def test_true_bars_agree_with_the_rips_complex():
    points = torus(250)
    alpha = topology(points).diagram
    rips = ripser(points, maxdim=1)["dgms"]
    # Rips scales are diameters, alpha scales are radii: up to a factor of sqrt(3 / 2), the loops
    # are the same.
    for found, expected in ((alpha[1], rips[1] / 2),):
        longest = [bars[np.argsort(bars[:, 0] - bars[:, 1])[:2]] for bars in (found, expected)]
        np.testing.assert_allclose(longest[0], longest[1], rtol=0.25)


def test_circumspheres_by_hand():
    points = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2.0]])
    centre, radius2 = circumspheres(points, np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(centre, [[1, 1, 1]])
    np.testing.assert_allclose(radius2, [3])
    centre, radius2 = circumspheres(points, np.array([[0, 1]]))
    np.testing.assert_allclose(centre, [[1, 0, 0]])
    np.testing.assert_allclose(radius2, [1])


@pytest.mark.slow
def test_a_thousand_kernels_take_seconds():
    start = time.perf_counter()
    topology(torus(1000))
    assert time.perf_counter() - start < 15


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.eye(3), "points have shape (3, 3): give at least 5 points, as (K, 2) or (K, 3)"),
        (np.full((9, 3), np.nan), "points hold NaN or infinity: embed the representation first"),
        (
            np.random.default_rng(0).normal(size=(9, 3)) * [1, 1, 0],
            "points lie in a plane: give points that spread in 3 dimensions",
        ),
    ],
)
def test_errors(points, message):
    with pytest.raises(ValueError, match="points") as error:
        topology(points)
    assert str(error.value) == message


def test_a_tetrahedron_that_is_almost_flat_has_a_sphere():
    corners = np.array([[0, 0, 0], [0.2, 0.1, 0], [0.1, 0.2, 0], [0.15, 0.15, 1e-9]], dtype=float)
    centre, radius2 = circumspheres(corners, np.array([[0, 1, 2, 3]]))
    apart = np.linalg.norm(corners - centre, axis=1)
    np.testing.assert_allclose(apart, np.sqrt(radius2[0]), rtol=1e-6)
