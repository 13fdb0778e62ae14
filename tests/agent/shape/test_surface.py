import numpy as np
import pytest
from bodies_by_hand import cube, sphere, torus

from selftouch_drake.agent.shape.surface import fitted_surface, rolled_surface
from selftouch_drake.quotient.holes import topology


def euler(faces: np.ndarray) -> int:
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


def volume(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = points[faces].transpose(1, 0, 2)
    return float(np.einsum("fx,fx->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("points", "characteristic", "solid"),
    [
        (sphere(300), 2, 4 / 3 * np.pi),
        (cube(300), 2, 0.44**3),
        (torus(300), 0, 2 * np.pi**2 * 0.22 * 0.09**2),
    ],
    ids=["sphere", "cube", "torus"],
)
def test_the_surface_is_closed_outward_and_encloses_the_body(points, characteristic, solid):
    faces = fitted_surface(points, topology(points))
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    # Closed and consistently oriented: every edge occurs once in each direction.
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert {tuple(e) for e in directed} == {tuple(e) for e in directed[:, ::-1]}
    assert euler(faces) == characteristic
    assert len(np.unique(faces)) > 0.97 * len(points)
    assert volume(points, faces) == pytest.approx(solid, rel=0.15)


def test_a_wide_ball_does_not_enter_the_hole_of_a_torus():
    points = torus(300)
    assert euler(rolled_surface(points, 10.0)) == 2


def test_a_ball_that_falls_through_everywhere_leaves_nothing():
    assert rolled_surface(sphere(100), 1e-3).shape == (0, 3)
